"""The report's section on obstacles draws what happened, and its numbers are those of the metrics."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from drawings import SVG, drawn, strokes, texts
from hypothesis import given
from hypothesis import strategies as st
from pages import check_page

from pipeline.project import Project
from pipeline.report import Figure, Section, Table, assemble
from stages import STAGES
from stages.artifacts.metrics import read_metrics
from stages.artifacts.rollouts import RecordedRollout, read_rollouts, read_scenes
from stages.figures.avoidance_deviations import avoidance
from stages.figures.avoidance_tables import range_table, systems_tables
from stages.figures.clearance import Line, clearance_panel, method_colour, method_keys
from stages.figures.conditions import among_obstacles, push_of, when
from stages.figures.deviation import Deviation, Resolved
from stages.figures.deviations import deviations
from stages.figures.flow import Path, Scene, flow_panel, frame, legend, outline
from stages.figures.intervals import share, tally
from stages.figures.numbers import MISSING, number, percent
from stages.figures.obstacles_section import obstacles_section, obstacles_sentence
from stages.figures.results import Results, read_results
from stages.figures.sections import lead, sections
from stages.figures.style import colour
from stages.figures.tables import facts, metrics
from stages.policy.avoidance.parameters import (
    ApfParameters,
    Avoidance,
    Box,
    CbfParameters,
    Ellipsoid,
    Obstacle,
    RoasParameters,
    RoasPlusParameters,
    Sphere,
)
from stages.policy.avoidance.scene import shapes_of
from stages.policy.avoidance.shapes import Shapes, distance_at, spheres
from stages.rollout.parameters import (
    Condition,
    Displacement,
    Held,
    LpvdsController,
    Noise,
    RandomScenes,
    RolloutParameters,
)
from stages.trajectory import Array

CHAIN = """
preset = "robust"
description = "Spheres & <boxes> on the way"
[ingest]
motion = "Line"
[midpoint]
samples = 100
[mixture]
kind = "em"
components = 4
[dynamics]
kind = "qlf"
[rollout]
max_duration = 6.0
controllers = [{ kind = "lpvds" }]
"""
METHODS = """
avoidances = [
    { kind = "none" },
    { kind = "apf", name = "near", range = 0.003 },
    { kind = "apf", name = "far", range = 0.02 },
    { kind = "roas" },
    { kind = "cbf" },
    { kind = "roas+", name = "stay", detour = false },
    { kind = "roas+" },
]
"""
GOAL = '{ name = "goal", obstacles = [{ kind = "sphere", centre = [0.0, 0.0], radius = 0.01 }] }'
STANDING = '{ name = "standing", scenes = { fewest = 2, most = 3, smallest = 0.1 } }'
MOVING = '{ name = "moving", scenes = { fewest = 1, most = 2, speed = 0.5 } }'
EXPERIMENTS = {
    "kinds": f"""{CHAIN}{METHODS}
conditions = [{{ name = "none" }}, {STANDING}, {MOVING}, {GOAL}]
[sweep]
"dynamics.kind" = ["qlf", "pqlf"]
"ingest.motion" = ["Line", "Leaf_1"]
""",
    "space": f"""{CHAIN}
avoidances = [{{ kind = "none" }}, {{ kind = "roas+" }}]
conditions = [{STANDING}]
[sweep]
"ingest.depth" = ["Sine", ""]
"mixture.components" = [1, 4]
""",
    "free": CHAIN,
    "blocked": f"{CHAIN}\nconditions = [{{ name = 'none' }}, {GOAL}]\n",
}
NAMES = {"none": "nothing", "roas": "ROAS as printed", "cbf": "CBF-QP", "roas+": "ROAS+"}
ORDER = ["none", "near", "far", "roas", "cbf", "stay", "roas+"]
MARKED = f"fill: {colour('series-1')}; stroke: {colour('ink')}"
CROSSED = f"fill: {colour('ink')}; stroke: {colour('surface')}"
OBSTACLE = f"fill: {colour('muted')}; opacity: 0.45"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    root = tmp_path_factory.mktemp("obstacles")
    for name, text in EXPERIMENTS.items():
        (root / "runs" / name).mkdir(parents=True)
        (root / "runs" / name / "experiment.toml").write_text(text, encoding="utf-8")
    return Project.open(root, STAGES)


def run(project: Project, name: str) -> Results:
    experiment = project.experiment(name)
    project.bring_up(experiment, "evaluate", jobs=1)
    return read_results(project, experiment)


@pytest.fixture(scope="module")
def results(project: Project) -> Results:
    """Two motions and two kinds of dynamics, seven methods, three conditions with obstacles and one without."""
    return run(project, "kinds")


@pytest.fixture(scope="module")
def section(results: Results) -> Section:
    found = obstacles_section(results)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def space(project: Project) -> Results:
    """One motion in the plane and in space, learned and linear."""
    return run(project, "space")


def tables(section: Section) -> list[Table]:
    return [block for block in section.blocks if isinstance(block, Table)]


def figures(section: Section) -> list[Figure]:
    return [block for block in section.blocks if isinstance(block, Figure)]


def rows_of(results: Results, kind: str = "qlf", **wanted: str) -> list[dict[str, Any]]:
    """From the artifacts alone: rows of all points of a kind that have these values, each with its point."""
    rows = [
        {**row, "point": p.point.id} for p in results.of_kind(kind).points for row in read_metrics(p.files["metrics"])
    ]
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def counted(rows: Sequence[dict[str, Any]], *outcomes: str) -> int:
    return sum(row["outcome"] in outcomes for row in rows)


def rollouts_of(results: Results, condition: str, avoidance: str) -> list[RecordedRollout]:
    """Of the first point of the experiment's own kind."""
    found, _ = read_rollouts(results.own.points[0].files["rollouts"])
    return [r for r in found if (r.condition, r.avoidance) == (condition, avoidance)]


# --- pictures -------------------------------------------------------------------------------------------------------


def scene(d: int = 3, obstacles: Shapes | None = None, traps: Array | None = None) -> Scene:
    return Scene(
        train=[np.linspace([-0.05] + [0.01] * (d - 1), [0.0] * d, 50)],
        test=[],
        means=np.zeros((0, d)),
        covariances=np.zeros((0, d, d)),
        goal=np.zeros(d),
        velocity=lambda x: -x,
        obstacles=obstacles,
        traps=traps,
    )


def path(d: int = 3, **changes: Any) -> Path:
    executed = np.linspace([-0.05] + [0.0] * (d - 1), [0.0] * d, 50)
    return replace(Path(x=None, executed=executed, displaced=-1, duration=0.5), **changes)


def panel(shown: Scene, drawn_path: Path, plane: tuple[int, int] = (0, 1)) -> str:
    extent = frame(shown, [[drawn_path]], plane)
    return flow_panel(shown, [drawn_path], "Title", "series-2", extent, plane, 2)


def count(styles: Sequence[str], what: str) -> int:
    return sum(what in style for style in styles)


# In space: the flow, which takes longest, is not drawn.
TWO = spheres(np.array([[-0.02, 0.0, 0.0], [-0.04, 0.005, 0.0]]), np.array([0.005, 0.003]))


def test_obstacles_are_drawn_and_those_that_move_also_where_they_end() -> None:
    bare = drawn(panel(scene(), path()))
    assert count(bare, OBSTACLE) == 0
    standing = panel(scene(obstacles=TWO), path())
    assert count(drawn(standing), OBSTACLE) == 2
    assert strokes(standing, "muted") == 0
    moving = TWO._replace(velocities=np.array([[0.0, 0.01, 0.0], [0.0, 0.0, 0.0]]))
    document = panel(scene(obstacles=moving), path())
    assert count(drawn(document), OBSTACLE) == 2
    assert sum("stroke-dasharray" in s and f"stroke: {colour('muted')}" in s for s in drawn(document)) == 1
    assert strokes(document, "muted") == 2  # the dashed outline and the arrow's line
    assert strokes(panel(scene(obstacles=moving), path(duration=0.0)), "muted") == 0


def test_traps_ends_and_detours_are_marked() -> None:
    marks = drawn(panel(scene(), path()), "use")
    assert (count(marks, MARKED), count(marks, CROSSED)) == (0, 1)  # the star of the goal is drawn as a cross is
    traps = np.array([[-0.01, 0.0, 0.0], [-0.02, 0.001, 0.0]])
    assert count(drawn(panel(scene(traps=traps), path()), "use"), MARKED) == 2
    assert count(drawn(panel(scene(), path(stopped=True)), "use"), CROSSED) == 2
    detour = np.arange(50) > 40
    assert strokes(panel(scene(), path(detour=detour)), "series-1") == 1
    assert strokes(panel(scene(), path(detour=detour & False)), "series-1") == 0


def test_same_obstacles_same_bytes() -> None:
    moving = TWO._replace(velocities=np.full((2, 3), 0.01))
    one, two = (panel(scene(obstacles=moving, traps=np.zeros((1, 3))), path(stopped=True)) for _ in range(2))
    assert one == two


def test_obstacles_in_the_plane_are_drawn_over_the_flow() -> None:
    flat = spheres(np.array([[-0.02, 0.0]]), np.array([0.005]))
    document = panel(scene(2, flat), path(2))
    assert count(drawn(document), OBSTACLE) == 1
    assert strokes(document, "faint") > 20  # stream lines


def test_legend_names_obstacles_crosses_traps_and_detours_where_there_are_some() -> None:
    def added(shown: Scene, one: Path) -> list[str]:
        usual = {key.label for key in legend(scene(), [path()])}
        return [key.label.partition(",")[0] for key in legend(shown, [one]) if key.label not in usual]

    assert added(scene(obstacles=TWO), path()) == ["obstacles"]
    assert added(scene(obstacles=TWO), path(stopped=True)) == ["obstacles", "end short of the goal"]
    assert added(scene(obstacles=TWO, traps=np.empty((0, 3))), path(detour=np.zeros(50, dtype=bool))) == ["obstacles"]
    everything = added(scene(obstacles=TWO, traps=np.zeros((1, 3))), path(detour=np.ones(50, dtype=bool)))
    assert everything == ["obstacles", "traps: minima of V on obstacles", "detour"]


def test_frame_holds_every_obstacle() -> None:
    far = spheres(np.array([[0.2, -0.3, 0.0]]), np.array([0.01]))
    (_, x1), (y0, _) = frame(scene(obstacles=far), [[path()]], (0, 1))
    assert x1 > 0.2
    assert y0 < -0.3


def test_outlines_by_hand() -> None:
    turned = (
        Sphere(centre=(0.1, 0.2), radius=0.03),
        Box(centre=(0.0, 0.0), half_extents=(0.04, 0.01), rounding=0.002, rotation=(math.pi / 2,)),
        Ellipsoid(centre=(0.0, 0.0), semi_axes=(0.04, 0.01), rotation=(math.pi / 6,)),
    )
    shapes = shapes_of(turned, 2, "obstacles")
    sphere, box, ellipse = (outline(shapes, index, (0, 1), 361) for index in range(3))
    assert np.linalg.norm(sphere - [0.1, 0.2], axis=1) == pytest.approx(np.full(361, 0.03))
    assert np.abs(box).max(axis=0) == pytest.approx([0.012, 0.042], rel=1e-4)
    reach = [math.hypot(0.04 * math.cos(math.pi / 6), 0.005), math.hypot(0.04 * 0.5, 0.01 * math.cos(math.pi / 6))]
    assert np.abs(ellipse).max(axis=0) == pytest.approx(reach, rel=1e-4)
    assert np.array_equal(sphere[0], sphere[-1]) or sphere[0] == pytest.approx(sphere[-1])  # closed


@st.composite
def obstacles(draw: st.DrawFn, d: int) -> Obstacle:
    lengths = st.floats(0.001, 0.1)
    centre = tuple(draw(st.floats(-0.2, 0.2)) for _ in range(d))
    sizes = tuple(draw(lengths) for _ in range(d))
    if d == 2:
        rotation: tuple[float, ...] = (draw(st.floats(-4.0, 4.0)),)
    else:
        quaternion = np.array([draw(st.floats(0.1, 1.0)) * draw(st.sampled_from([-1, 1])) for _ in range(4)])
        rotation = tuple((quaternion / np.linalg.norm(quaternion)).tolist())
    kind = draw(st.sampled_from(["sphere", "box", "ellipsoid"]))
    if kind == "sphere":
        return Sphere(centre=centre, radius=sizes[0])
    if kind == "box":
        return Box(centre=centre, half_extents=sizes, rounding=draw(st.floats(0.0, 0.02)), rotation=rotation)
    return Ellipsoid(centre=centre, semi_axes=sizes, rotation=rotation)


@given(obstacles(2))
def test_an_outline_in_the_plane_lies_on_the_surface(obstacle: Obstacle) -> None:
    shapes = shapes_of([obstacle], 2, "obstacles")
    for point in outline(shapes, 0, (0, 1), 40):
        assert distance_at(shapes, 0, point.copy(), np.empty(2)) == pytest.approx(0.0, abs=1e-9)


@given(obstacles(3), st.sampled_from([(0, 1), (0, 2), (1, 2)]), st.integers(0, 2**32 - 1))
def test_an_outline_in_space_holds_the_shadow_of_the_obstacle(
    obstacle: Obstacle, plane: tuple[int, int], seed: int
) -> None:
    shapes = shapes_of([obstacle], 3, "obstacles")
    edge = outline(shapes, 0, plane, 121)
    angle = np.linspace(0.0, 2.0 * math.pi, 121)
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    farthest = (edge @ directions.T).max(axis=0)
    generator, reach = np.random.default_rng(seed), float(shapes.measures[0, 1])
    for point in shapes.centres[0] + reach * generator.uniform(-1.0, 1.0, size=(100, 3)):
        if distance_at(shapes, 0, point, np.empty(3)) <= 0.0:
            assert (directions @ point[list(plane)] <= farthest + 1e-9).all()


def line(method: str, kind: str, end: float, stopped: bool, clearance: Array | None = None) -> Line:
    time = np.linspace(0.0, end, 20)
    clearance = np.linspace(0.05, 0.04, 20) if clearance is None else clearance
    return Line(method=method, kind=kind, time=time, clearance=clearance, stopped=stopped)


def label_height(document: str, text: str) -> float:
    """Distance of a text from the top of a picture, points."""
    root = ElementTree.fromstring(document)
    (found,) = [e for e in root.iter(f"{SVG}text") if "".join(e.itertext()) == text]
    return float(found.get("y", "nan"))


def test_clearance_panel_draws_every_method_and_crosses_those_that_stopped() -> None:
    lines = [
        line("a", "apf", 1.0, True),
        line("b", "apf", 2.0, False),
        line("c", "apf", 9.0, True),
        line("roas+", "roas+", 1.5, False),
    ]
    document = clearance_panel(lines, "Title", 2)
    assert [strokes(document, name) for name in ("series-4", "series-2")] == [3, 1]
    dashes = [s for s in drawn(document) if f"stroke: {colour('series-4')}" in s]
    assert [("stroke-dasharray" in style) for style in dashes] == [False, True, True]
    assert len({style.partition("stroke:")[0] for style in dashes}) == 3
    assert count(drawn(document, "use"), f"fill: {colour('series-4')}") == 2
    assert count(drawn(document), f"fill: {colour('muted')}; opacity: 0.35") == 1  # inside
    found = texts(document)
    assert {"Title", "time [s]", "clearance [mm]", "50"} <= set(found)
    assert "2.00" in found  # the longest that did not stop; one that waits in a trap would make the others small
    assert "8" not in found
    assert label_height(document, "50") < label_height(document, "0")


def test_clearance_over_all_of_the_time_where_every_roll_out_stopped() -> None:
    assert "8" in texts(clearance_panel([line("a", "apf", 1.0, True), line("c", "apf", 9.0, True)], "Title", 2))
    assert clearance_panel([line("a", "apf", 0.0, True)], "Title", 2)  # it never began


def test_clearance_of_a_roll_out_that_begins_inside_is_not_upside_down() -> None:
    recovering = line("roas+", "roas+", 1.0, False, np.linspace(-0.01, 0.01, 20))
    document = clearance_panel([recovering], "Title", 2)
    assert label_height(document, "0") < label_height(document, "\u221210")


def test_methods_of_one_kind_are_told_apart_in_the_legend() -> None:
    keys = method_keys({"apf": "apf", "roas+": "roas+", "wide": "apf", "wider": "apf", "widest": "apf", "own": "?"})
    assert [(key.label, key.colour, key.mark) for key in keys] == [
        ("APF", "series-4", "line"),
        ("ROAS+", "series-2", "line"),
        ("wide", "series-4", "dashed"),
        ("wider", "series-4", "dotted"),
        ("widest", "series-4", "dotted"),
        ("own", "muted", "line"),
    ]
    assert len({method_colour(kind) for kind in ("roas+", "roas", "apf", "cbf", "modulation", "none")}) == 6


# --- conditions and deviations in words -----------------------------------------------------------------------------

BLOCK = Condition(name="one", obstacles=(Sphere(centre=(0.05, 0.0), radius=0.01),))


def test_conditions_with_obstacles() -> None:
    push = Displacement(offset=(0.0, -0.02))
    assert among_obstacles(BLOCK)
    assert among_obstacles(Condition(scenes=RandomScenes()))
    assert not among_obstacles(Condition(disturbances=(push,)))


def test_one_push_of_a_condition() -> None:
    push, held = Displacement(offset=(0.0, -0.02)), Held(offset=(0.01, 0.0), duration=1.0)
    for one, offset in ((push, [0.0, -0.02]), (held, [0.01, 0.0])):
        found = push_of(Condition(disturbances=(one,)))
        assert found is not None
        assert found.tolist() == offset
    for none in ((), (push, held), (Noise(std=0.1, duration=1.0),), (Displacement(offset=(0.0, 0.0)),)):
        assert push_of(Condition(disturbances=none)) is None


def test_when_a_disturbance_comes() -> None:
    path_of = "of the arc length of the controller's own undisturbed path"
    assert when(Displacement(offset=(0.0, 0.1))) == f"at 0.5 {path_of}"
    assert when(Displacement(offset=(0.0, 0.1), at_fraction=0.25)) == f"at 0.25 {path_of}"
    assert when(Noise(std=0.1, duration=1.0, at_time=1.5)) == "1.5 s after the start"
    near = when(Held(offset=(0.0, 0.1), duration=1.0, at_state=(0.01, -0.02)))
    assert near == "where the controller's own undisturbed path is nearest to [10, \u221220]\u00a0mm"


def departures(*methods: Avoidance, conditions: Sequence[Condition] = (Condition(), BLOCK)) -> list[Deviation]:
    return avoidance(RolloutParameters(avoidances=methods, conditions=tuple(conditions)))


def test_deviations_of_avoidance_follow_the_methods() -> None:
    def where(*methods: Avoidance) -> list[str]:
        return [row.where for row in departures(*methods)]

    assert where(RoasParameters()) == ["(20)-(22)"]
    assert where(RoasPlusParameters()) == ["(19)-(23)", "(25)"]
    assert where(RoasPlusParameters(detour=False)) == ["(19)-(23)"]
    assert where(ApfParameters(), CbfParameters()) == []
    both: list[Avoidance] = [RoasParameters(), RoasParameters(name="roas-mm", unit=0.001), RoasPlusParameters()]
    assert where(*both) == ["(20)-(22)", "(19)-(21)", "(19)-(23)", "(25)"]
    (unit,) = [row for row in departures(*both) if row.where == "(19)-(21)"]
    assert unit.here == "`roas-mm`: evaluated in units of 0.001 m."


def test_nothing_departs_where_there_is_no_obstacle() -> None:
    assert departures(RoasParameters(), RoasPlusParameters(), conditions=[Condition()]) == []
    assert departures(RoasPlusParameters(), conditions=[Condition(scenes=RandomScenes())]) != []


def test_deviations_of_avoidance_and_disturbances_stand_among_the_others(results: Results) -> None:
    parameters = {
        **results.shown.point.parameters,
        "rollout": RolloutParameters(
            controllers=(LpvdsController(),),
            conditions=(replace(BLOCK, disturbances=(Held(offset=(0.0, 0.1), duration=1.0),)),),
        ),
    }
    rows = deviations(parameters, [Resolved(top_speed=0.1, couplings={})])
    places = [row.where for row in rows]
    middle = places.index("Figs 2, 3")
    assert places[middle : middle + 4] == ["Figs 2, 3", "(19)-(23)", "(25)", "III-A"]
    assert rows[middle].here.startswith("The executed state is displaced, dragged or shaken, at 0.5 of the arc length")


# --- the section ----------------------------------------------------------------------------------------------------


def test_table_of_methods_says_what_the_metrics_say(results: Results, section: Section) -> None:
    table = tables(section)[0]
    conditions = ("standing", "moving", "goal")
    assert [row[:2] for row in table.rows] == [(c, NAMES.get(m, m)) for c in conditions for m in ORDER]
    cells = {(row[0], row[1]): dict(zip(table.columns, row, strict=True)) for row in table.rows}
    plain = {(r["point"], r["demo"]): r["duration_s"] for r in rows_of(results, condition="none")}
    assert len(plain) == 8
    for condition in conditions[:2]:
        for method in ORDER:
            rows = rows_of(results, condition=condition, avoidance=method)
            cell = cells[condition, NAMES.get(method, method)]
            assert len(rows) == 8  # two motions, four starts
            assert counted(rows, "goal-inside", "start-inside", "swallowed") == 0
            hit, arrived = counted(rows, "collided", "infeasible", "too-fast"), counted(rows, "arrived")
            assert cell["roll-outs"] == "8"
            assert cell["collided"] == share(hit, 8)
            assert cell["converged without collision"] == share(arrived, 8)
            assert cell["trapped"] == str(counted(rows, "trapped"))
            assert cell["out of time"] == str(counted(rows, "timeout", "diverged"))
            assert hit + arrived + counted(rows, "trapped", "timeout", "diverged") == 8
            assert cell["refused"] == MISSING
            assert cell["flagged"] == str(sum(row["flagged_steps"] > 0 for row in rows))
            assert cell["largest rise of V [mm²]"] == number(1e6 * max(row["lyapunov_rise_max"] for row in rows))
            assert cell["least clearance [mm]"] == number(min(row["clearance_min_mm"] for row in rows))
            there = [row for row in rows if row["outcome"] == "arrived"]
            if there:
                ratio = np.mean([row["duration_s"] / plain[row["point"], row["demo"]] for row in there])
                assert cell["time [x]"] == number(float(ratio))
                assert cell["DTW [mm]"] == number(math.fsum(row["dtw_mm"] for row in there) / len(there), 4)
            else:
                assert (cell["time [x]"], cell["DTW [mm]"]) == (MISSING, MISSING)
    nothing, ours = cells["standing", "nothing"], cells["standing", "ROAS+"]
    assert nothing["collided"].startswith(percent(1.0))
    assert ours["converged without collision"].startswith(percent(1.0))
    assert ours["largest rise of V [mm²]"] == "0"
    assert float(ours["time [x]"]) > 1.0


def test_roll_outs_that_could_not_begin_are_said_to_be_refused(results: Results, section: Section) -> None:
    table = tables(section)[0]
    refused = [dict(zip(table.columns, row, strict=True)) for row in table.rows if row[0] == "goal"]
    assert len(refused) == len(ORDER)
    for cell in refused:
        assert counted(rows_of(results, condition="goal"), "goal-inside") == 8 * len(ORDER)
        assert (cell["roll-outs"], cell["refused"], cell["collided"], cell["DTW [mm]"]) == ("0", "8", MISSING, MISSING)


def test_pictures_show_the_best_field_the_printed_strategy_and_ours(results: Results, section: Section) -> None:
    fig4 = figures(section)[0]
    arrived = {name: counted(rows_of(results, avoidance=name), "arrived") for name in ("near", "far")}
    best = max(arrived, key=lambda name: arrived[name])
    assert arrived[best] > min(arrived.values())
    methods = [best, "roas", "roas+"]
    shown = [(c, m) for c in ("standing", "moving", "goal") for m in methods]
    assert fig4.columns == 3
    assert "Of the potential fields, the one whose range arrives most often." in fig4.caption
    assert len(fig4.panels) == len(shown)
    scenes = read_scenes(results.own.points[0].files["rollouts"])
    for made, (condition, method) in zip(fig4.panels, shown, strict=True):
        found = rollouts_of(results, condition, method)
        found = [r for r in found if r.scene == found[0].scene]
        there, number_of = sum(r.outcome == "arrived" for r in found), scenes[found[0].scene].shapes.number
        title = f"{NAMES.get(method, method)}: {condition}"
        assert title in texts(made.svg)
        never = sum(r.outcome == "goal-inside" for r in found)
        begun = f", {never} could not begin" if never else ""
        obstacles = f"{number_of} obstacle{'s' if number_of != 1 else ''}"
        assert made.alt == f"{title}. {there} of {len(found)} roll-outs reach the goal{begun}, among {obstacles}."
        assert count(drawn(made.svg), OBSTACLE) == number_of
        if condition != "goal":
            assert count(drawn(made.svg, "use"), CROSSED) == 1 + len(found) - there  # and the goal's star
        colours = {"near": "series-4", "far": "series-4", "roas": "series-3", "roas+": "series-2"}
        assert strokes(made.svg, colours[method]) == len(found)
    moving = [made for made in fig4.panels if "moving" in made.alt]
    assert all(any("stroke-dasharray: 3.2,2.4" in style for style in drawn(made.svg)) for made in moving)


def test_one_field_needs_no_choice(space: Results) -> None:
    made = obstacles_section(space)
    assert made is not None
    assert "the one whose range" not in figures(made)[0].caption


def test_clearance_over_time_says_the_least_of_each_method(results: Results, section: Section) -> None:
    figure = figures(section)[1]
    assert [key.label for key in figure.legend] == [NAMES.get(m, m) for m in ORDER]
    assert len(figure.panels) == 3
    for made, condition in zip(figure.panels, ("standing", "moving", "goal"), strict=True):
        least = [float(rollouts_of(results, condition, method)[0].clearance.min()) for method in ORDER]
        said = "; ".join(f"{NAMES.get(m, m)} {number(1e3 * c)} mm" for m, c in zip(ORDER, least, strict=True))
        assert made.alt == f"{condition}: least clearance over the roll-out: {said}."
        assert condition in texts(made.svg)
    first = figure.panels[0].svg
    assert [strokes(first, name) for name in ("series-4", "series-2", "series-1", "series-3")] == [2, 2, 1, 1]


def test_table_of_ranges_counts_goals_within_reach(results: Results, section: Section) -> None:
    (table,) = [t for t in tables(section) if t.caption.startswith("When the potential field")]
    assert [row[:2] for row in table.rows] == [("near", "3 mm"), ("far", "20 mm")]
    for row, reach in zip(table.rows, (0.003, 0.02), strict=True):
        totals, missed = {True: 0, False: 0}, {True: 0, False: 0}
        for point in results.own.points:
            scenes = read_scenes(point.files["rollouts"])
            for r in read_metrics(point.files["metrics"]):
                if r["avoidance"] != row[0] or r["outcome"] not in ("arrived", "timeout", "trapped", "diverged"):
                    continue
                shapes = scenes[r["scene"]].shapes
                standing = (shapes.velocities == 0.0).all(axis=1)
                gaps = np.linalg.norm(shapes.centres - point.model.goal, axis=1) - shapes.radii
                holds = bool((gaps[standing] < reach).any())
                totals[holds] += 1
                missed[holds] += r["outcome"] != "arrived"
        assert (row[2], row[4]) == (str(totals[True]), str(totals[False]))
        for cell, holds in ((row[3], True), (row[5], False)):
            assert cell == share(missed[holds], totals[holds])
    assert sum(width for _, width in table.groups) == len(table.columns)


def test_table_of_traps_counts_them_by_kind_of_dynamics(results: Results, section: Section) -> None:
    (table,) = [t for t in tables(section) if t.caption.startswith("Traps")]
    assert [row[:2] for row in table.rows] == [(k, m) for k in ("QLF", "P-QLF") for m in ("stay", "ROAS+")]
    for row, (kind, method) in zip(
        table.rows, [(k, m) for k in ("qlf", "pqlf") for m in ("stay", "roas+")], strict=True
    ):
        rows = [r for r in rows_of(results, kind, avoidance=method) if r["outcome"] != "goal-inside"]
        entered = {(r["point"], r["scene"]) for r in rows}
        points = results.of_kind(kind).points
        every = [(p.point.id, s) for p in points for s in read_scenes(p.files["rollouts"]).values()]
        scenes = [s for point, s in every if (point, s.name) in entered]
        assert 0 < len(scenes) < len(every)
        traps = [s.traps.shape[0] for s in scenes if s.traps is not None]
        assert len(traps) == len(scenes)
        assert row[2] == tally(sum(n > 0 for n in traps), len(traps))
        assert row[3:7] == (
            str(sum(traps)),
            str(len(rows)),
            str(counted(rows, "trapped")),
            str(sum(r["detour_steps"] > 0 for r in rows)),
        )
        assert row[7].startswith(percent(counted(rows, "arrived") / len(rows)))
        assert row[8] == str(counted(rows, "collided", "infeasible", "too-fast"))
    assert [row[3] for row in table.rows[:2]] == ["0", "0"]  # circles have none on spheres
    assert int(table.rows[2][5]) > 0  # who may not leave a trap stays in it
    assert (table.rows[3][5], int(table.rows[3][6]) > 0) == ("0", True)


def test_a_trap_and_the_detour_that_leaves_it_are_drawn(results: Results, section: Section) -> None:
    caught = figures(section)[2]
    (made,) = caught.panels
    (point, r) = next(
        (point, r)
        for point in results.points
        for r in read_rollouts(point.files["rollouts"])[0]
        if (r.status == "detouring").any()
    )
    assert point.kind == "pqlf"
    scene_of_it = read_scenes(point.files["rollouts"])[r.scene]
    assert scene_of_it.traps is not None
    assert count(drawn(made.svg, "use"), MARKED) == scene_of_it.traps.shape[0] > 0
    assert strokes(made.svg, "series-1") == 1
    assert count(drawn(made.svg), OBSTACLE) == scene_of_it.shapes.number
    assert made.alt.startswith("ROAS+ on P-QLF dynamics: a path stops at a trap")
    assert caught.caption.startswith(f"{point.name}, {r.condition}, demonstration {r.demo}: ")
    labels = [key.label for key in caught.legend]
    assert {"traps: minima of V on obstacles", "detour, on which V rises"} <= set(labels)


def test_every_picture_is_said_in_words(section: Section) -> None:
    alts = [made.alt for figure in figures(section) for made in figure.panels]
    assert all(alts)
    assert len(alts) == len(set(alts))


def test_the_head_says_how_many_arrived(results: Results) -> None:
    sentence = obstacles_sentence(results)
    begun = [row for row in rows_of(results) if row["scene"] is not None and row["outcome"] != "goal-inside"]
    parts = []
    for name in ("near", "roas", "roas+", "cbf"):
        rows = [row for row in begun if row["avoidance"] == name]
        arrived, hit = counted(rows, "arrived"), counted(rows, "collided", "infeasible", "too-fast")
        parts.append(f"{NAMES.get(name, name)} {arrived} of {len(rows)} ({hit} collided)")
    said = f"{', '.join(parts[:-1])} and {parts[-1]}"
    assert sentence == f"Among obstacles, roll-outs that reached the goal without a collision: {said}."


# --- other experiments ----------------------------------------------------------------------------------------------


def test_systems_are_told_apart_by_dimension_and_linearity(space: Results) -> None:
    among = space.own.part(among=True)
    assert among is not None
    arriving, hitting = systems_tables(among)
    for table in (arriving, hitting):
        assert table.columns == ("dimension", "system", "condition", "nothing", "ROAS+")
        assert [row[:3] for row in table.rows] == [
            (f"{d}-D", system, "standing") for d in (2, 3) for system in ("linear, K = 1", "LPV-DS")
        ]
    for row, other in zip(arriving.rows, hitting.rows, strict=True):
        (point,) = [
            p
            for p in space.points
            if (p.point.overrides["ingest.depth"] == "", p.point.overrides["mixture.components"] == 1)
            == (row[0] == "2-D", row[1] == "linear, K = 1")
        ]
        for converged, collided, method in zip(row[3:], other[3:], ("none", "roas+"), strict=True):
            rows = [r for r in read_metrics(point.files["metrics"]) if r["avoidance"] == method]
            assert len(rows) == 4
            hit, arrived = counted(rows, "collided", "infeasible", "too-fast"), counted(rows, "arrived")
            assert (converged, collided) == (share(arrived, 4), share(hit, 4))
    assert systems_tables(replace(among, points=among.points[:1])) == ()
    assert range_table(among) is None


def test_obstacles_in_space_are_shown_in_two_planes(space: Results) -> None:
    made = obstacles_section(space)
    assert made is not None
    fig4 = figures(made)[0]
    assert space.shown.model.dimension == 3
    assert fig4.columns == 2
    assert len(fig4.panels) == 2 * 1  # ROAS+ alone is one of the three that pictures show
    found, _ = read_rollouts(space.shown.files["rollouts"])
    scenes = read_scenes(space.shown.files["rollouts"])
    for panel_of in fig4.panels:
        assert "ROAS+: standing" in texts(panel_of.svg)
        assert count(drawn(panel_of.svg), OBSTACLE) == scenes[found[0].scene].shapes.number
    axes = [{text for text in texts(p.svg) if re.fullmatch(r"[xyz] \[mm\]", text)} for p in fig4.panels]
    assert [len(names) for names in axes] == [2, 2]
    assert axes[0] != axes[1]
    # No roll-out without obstacles: no time to compare with, and no other section of roll-outs.
    (methods,) = [t for t in tables(made) if t.caption.startswith("How roll-outs")]
    assert {dict(zip(methods.columns, row, strict=True))["time [x]"] for row in methods.rows} == {MISSING}
    assert methods.columns[0] == "method"
    ids = [section.id for section in sections(space)]
    assert ids[0] == "obstacles"
    assert not {"rollouts", "metrics", "facts"} & set(ids)
    assert len(lead(space)) == 3


def test_without_obstacles_there_is_no_section(project: Project) -> None:
    free = run(project, "free")
    assert obstacles_section(free) is None
    assert obstacles_sentence(free) == ""
    assert "obstacles" not in [section.id for section in sections(free)]


def test_a_report_of_roll_outs_none_of_which_could_begin(project: Project) -> None:
    blocked = run(project, "blocked")
    assert obstacles_section(blocked) is not None
    page = assemble("blocked", lead(blocked), sections(blocked))
    check_page(page)
    assert "goal-inside" in page or "refused" in page


def test_sections_of_undisturbed_roll_outs_do_not_count_those_among_obstacles(results: Results) -> None:
    free = results.own.part(among=False)
    assert free is not None
    summary = tables(metrics(free))[0]
    assert [row[:3] for row in summary.rows] == [("plain LPV-DS", "undisturbed", tally(8, 8))]
    counts, arrivals, *missed = tables(facts(free))
    assert arrivals.columns == ("controller", "undisturbed")
    assert arrivals.rows == (("plain LPV-DS", tally(8, 8)),)
    assert missed == []
    assert counts.rows[1][1] == "0 mm²"


def test_the_page_is_whole_and_escaped(results: Results, section: Section) -> None:
    assert (section.id, section.title) == ("obstacles", "Obstacles (Fig. 4) \u00b7 QLF")
    page = assemble("a <b> & c", lead(results), [section])
    assert "<title>a &lt;b&gt; &amp; c</title>" in page
    assert "Spheres &amp; &lt;boxes&gt; on the way" in page
    assert "<boxes>" not in page
    assert obstacles_sentence(results) in page
    body = page[page.index("<main>") :]
    assert not re.findall(r"#[0-9a-f]{6}", body)  # every colour follows the mode
    assert not re.search(r"&(?!(?:amp|lt|gt|quot|#x27);)", body)
    assert "http" not in body
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert body.count('role="img"') == body.count('aria-label="') == 9 + 3 + 1
    ElementTree.fromstring(re.sub(r"<(meta|!DOCTYPE)[^>]*>", "", page))  # every element is closed
