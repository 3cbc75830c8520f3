"""The report's figures draw the arrays they are given; its numbers, rows and sentences follow from the data."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as File
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from drawings import SVG, drawn, strokes, texts
from pages import check_page
from support import Invoke, make_project

from pipeline.errors import StaleError, StoreError
from pipeline.project import Project
from stages import STAGES
from stages.dynamics.parameters import PqlfParameters, QlfParameters, WarpedParameters
from stages.evaluate.parameters import EvaluateParameters
from stages.figures import numbers
from stages.figures.accuracy import Bar, bar_panel, changes, highest
from stages.figures.conditions import farthest, said
from stages.figures.deviation import Deviation, Resolved
from stages.figures.deviations import deviations
from stages.figures.experiment import write_report
from stages.figures.flow import LEVELS, Path, Scene, flow_panel, frame, legend, planes
from stages.figures.intervals import bootstrap_interval
from stages.figures.overview import MOST_SAMPLES, Motion, motion_panel
from stages.figures.recovery import Case, closed_spans, recovery_panel
from stages.figures.sampler import sampler_panels
from stages.figures.sections import result_sentence
from stages.figures.style import colour, controller_colours
from stages.ingest.parameters import LasaParameters
from stages.mixture.parameters import AutoParameters, EmParameters, PcGmmParameters
from stages.rollout.parameters import (
    ClpvdsController,
    Condition,
    Displacement,
    Held,
    LpvdsController,
    Noise,
    Ramp,
    RolloutParameters,
)
from stages.trajectory import Array


def line(count: int = 50, d: int = 2, offset: float = 0.0) -> Array:
    """A straight path from (-0.05, 0, …) to the origin, metres, moved by `offset` along y."""
    path = np.zeros((count, d))
    path[:, 0] = np.linspace(-0.05, 0.0, count)
    path[:, 1] = offset * np.linspace(1.0, 0.0, count)
    return path


def scene(d: int = 2, train: int = 3, test: int = 4, K: int = 5) -> Scene:
    return Scene(
        train=[line(d=d, offset=0.01 + 0.001 * i) for i in range(train)],
        test=[line(d=d, offset=-0.01 - 0.001 * i) for i in range(test)],
        means=np.column_stack([np.linspace(-0.05, 0, K)] + [np.zeros(K)] * (d - 1)),
        covariances=np.tile(np.diag([1e-4, 1e-5, 1e-6][:d]), (K, 1, 1)),
        goal=np.zeros(d),
        velocity=lambda x: -x,
    )


def pushed(d: int = 2) -> tuple[Path, Path]:
    """A plain and a coupled roll-out, displaced at sample 25."""
    executed = line(d=d)
    executed[25:, 1] -= 0.02
    return Path(x=None, executed=executed, displaced=25), Path(x=line(d=d), executed=executed, displaced=25)


def panel(paths: Sequence[Path], d: int = 2) -> str:
    shown = scene(d)
    return flow_panel(shown, paths, "Title", "series-2", frame(shown, [paths], (0, 1)), (0, 1), 2)


# --- Fig. 2 ---------------------------------------------------------------------------------------------------------


def test_flow_panel_draws_demonstrations_components_and_both_states() -> None:
    plain, coupled = pushed()
    base = panel([replace(plain, displaced=-1)])
    assert strokes(base, "series-2") == 1
    assert strokes(base, "ink") == 7
    assert sum("stroke-dasharray" in style and colour("ink") in style for style in drawn(base)) == 4
    assert sum(f"fill: {colour('series-4')}" in style for style in drawn(base)) == 2 * 5
    assert strokes(base, "faint") > 20  # stream lines
    assert strokes(panel([plain]), "series-2") == 2  # before and after the displacement
    assert strokes(panel([coupled]), "series-2") == 3  # and the band of x
    assert strokes(panel([coupled, coupled]), "series-2") == 6
    assert len(drawn(panel([plain]))) > len(drawn(base))  # the arrow


def test_flow_panel_labels_millimetres() -> None:
    found = texts(panel([pushed()[0]]))
    assert {"Title", "x [mm]", "y [mm]"} <= set(found)
    assert f"{numbers.MINUS}40" in found


def test_legend_names_what_is_drawn() -> None:
    plain, coupled = pushed()
    labels = [key.label for key in legend(scene(), [plain, coupled])]
    assert len(labels) == 6
    fewer = [key.label for key in legend(scene(d=3, test=0), [replace(plain, displaced=-1)])]
    assert [label.partition(",")[0] for label in fewer] == ["demonstrations", "mixture components"]
    assert set(fewer) < set(labels)


def test_level_lines_of_v_are_drawn_where_v_is_given() -> None:
    shown, (plain, _) = scene(), pushed()
    with_v = replace(shown, lyapunov=lambda x: (x**2).sum(axis=1))
    extent = frame(shown, [[plain]], (0, 1))
    document = flow_panel(with_v, [plain], "Title", "series-2", extent, (0, 1), 2)
    assert strokes(document, "series-5") == LEVELS - 1
    assert strokes(panel([plain]), "series-5") == 0
    labels = [key.label for key in legend(with_v, [])]
    assert [label for label in labels if label not in {key.label for key in legend(shown, [])}] == ["level lines of V"]


def test_three_coordinates_are_shown_in_the_planes_of_farthest_reach_without_flow() -> None:
    paths = [line(d=3, offset=0.01), line(d=3)]
    paths[1][:, 2] = np.linspace(0.3, 0.0, 50)
    assert planes(paths) == [(0, 2), (1, 2)]
    assert planes([path[:, :2] for path in paths]) == [(0, 1)]
    shown = replace(scene(3), lyapunov=lambda x: (x**2).sum(axis=1))
    path = pushed(3)[1]
    document = flow_panel(shown, [path], "Title", "series-2", frame(shown, [[path]], (0, 2)), (0, 2), 2)
    assert {"x [mm]", "z [mm]"} <= set(texts(document))
    assert strokes(document, "series-5") == 0
    document = panel([path], d=3)
    assert strokes(document, "series-2") == 3
    assert strokes(document, "faint") < 10  # spines only


def test_frame_holds_paths_but_not_one_that_ran_away() -> None:
    plain, _ = pushed()
    shown = scene()
    (x0, x1), (y0, y1) = frame(shown, [[plain]], (0, 1))
    assert x0 < -0.05
    assert x1 > 0.0
    assert y0 < -0.02
    assert y1 > 0.012
    far = Path(x=None, executed=1e6 * line(), displaced=-1)
    (x0, _), _ = frame(shown, [[far]], (0, 1))
    assert -0.12 < x0 < -0.1


def test_pushes_shown_are_the_farthest_in_each_direction() -> None:
    names = {"none": None, "a": (0.0, -0.02), "b": (0.0, -0.01), "c": (0.02, 0.0), "d": (0.0, 0.03), "e": (0.0, -0.04)}
    conditions = tuple(
        Condition(name=name, disturbances=() if push is None else (Displacement(offset=push),))
        for name, push in names.items()
    )
    assert [c.name for c in farthest(conditions)] == ["e", "c", "d"]
    assert [c.name for c in farthest(conditions[:4])] == ["a", "c"]
    assert [c.name for c in farthest(conditions, limit=2)] == ["e", "c"]
    assert farthest(conditions[:1]) == []
    several = Condition(name="f", disturbances=(Displacement(offset=(0.0, 1.0)), Displacement(offset=(1.0, 0.0))))
    shaken = Condition(name="g", disturbances=(Noise(std=0.1, duration=1.0),))
    assert farthest([several, shaken]) == []


def test_disturbances_are_said_in_words() -> None:
    held = Held(offset=(0.0, -0.02), duration=0.5)
    ramp = Ramp(offset=(0.01, 0.0), rise=0.2, hold=1.0)
    noise = Noise(std=0.001, duration=2.0)
    words = said(Condition(name="all", disturbances=(held, ramp, noise)))
    assert words == (
        "[0, \u221220]\u00a0mm, held for 0.5 s, [10, 0]\u00a0mm within 0.2 s, held for 1 s and noise of 1 mm for 2 s"
    )


# --- all motions ----------------------------------------------------------------------------------------------------


def test_motion_panel_draws_every_path_thinned() -> None:
    rollouts = {"lpvds": [line(5000), line(5000)], "clpvds robust": [line(3)]}
    wavy = line(5000)
    wavy[:, 1] = 0.01 * np.sin(np.arange(5000.0))
    motion = Motion(name="Wave_1", demonstrations=[wavy] * 7, rollouts=rollouts, goal=np.zeros(2))
    document = motion_panel(motion)
    assert texts(document) == ["Wave_1"]
    assert [strokes(document, name) for name in ("faint", "series-1", "series-2")] == [7, 2, 1]
    longest = max(len(re.findall("[ML]", e.get("d", ""))) for e in ElementTree.fromstring(document).iter(f"{SVG}path"))
    assert longest <= MOST_SAMPLES


# --- Fig. 3 ---------------------------------------------------------------------------------------------------------


def bars(values: dict[tuple[str, str], list[float]]) -> list[Bar]:
    return [Bar(controller=a, condition=b, values=np.array(v)) for (a, b), v in values.items()]


FEW = {("lpvds", "none"): [1.0, 3.0], ("lpvds", "cond1"): [3.0, 5.0], ("clpvds robust", "cond1"): [7.0, 9.0]}


def test_bars_are_named_and_show_every_value_where_they_are_few() -> None:
    document = bar_panel(bars(FEW), "Title", "error [mm]", 10.0, 2)
    assert {"Title", "error [mm]", "undisturbed", "Cond. 1", "2.00", "4.00", "8.00"} <= set(texts(document))
    fills = Counter(style for style in drawn(document) if style.startswith("fill: #"))
    assert [sum(n for s, n in fills.items() if colour(c) in s) for c in ("series-1", "series-2")] == [2, 1]
    circles = [style for style in drawn(document, "use") if f"fill: {colour('surface')}" in style]
    assert len(circles) == 6


def test_bars_of_many_values_have_an_interval_of_the_mean() -> None:
    values = np.random.default_rng(0).exponential(5.0, 30)
    low, high = bootstrap_interval(values, "name")
    assert low < values.mean() < high
    assert (low, high) == bootstrap_interval(values, "name")
    spread = values.std(ddof=1) / np.sqrt(30)
    assert high - low == pytest.approx(2 * 1.96 * spread, rel=0.15)
    many = [Bar(controller="lpvds", condition="none", values=values)]
    document = bar_panel(many, "Title", "error", highest(many), 2)
    assert f"fill: {colour('surface')}" not in "".join(drawn(document, "use"))
    assert strokes(document, "ink") == 1
    assert highest(many) > high


def test_changes_are_ratios_of_means() -> None:
    (change,) = changes(bars(FEW), "none")
    assert (change.controller, change.condition, change.low, change.high) == ("lpvds", "cond1", None, None)
    assert change.ratio == 1.0


def test_changes_of_pairs_have_a_narrower_interval_than_the_means() -> None:
    base = np.random.default_rng(1).exponential(5.0, 30)
    (change,) = changes(
        [Bar(controller="lpvds", condition=c, values=v) for c, v in (("none", base), ("cond1", 1.5 * base))], "none"
    )
    assert change.ratio == pytest.approx(0.5)
    assert change.low == pytest.approx(0.5)
    assert change.high == pytest.approx(0.5)


# --- recovery and sampler -------------------------------------------------------------------------------------------


def case(label: str = "clpvds robust", tolerance: float = 0.0) -> Case:
    gate = np.ones(100, dtype=bool)
    gate[40:60] = False
    gap = np.where(gate, 0.0, 0.02)
    time, fall = np.arange(100) * 0.01, np.linspace(1.0, 0.0, 100)
    return Case(label=label, time=time, gap=gap, gate=gate, lyapunov=fall**2, tolerance=tolerance)


def test_spans_in_which_the_gate_is_closed() -> None:
    time = np.arange(6) * 0.5
    assert closed_spans(time, np.array([True, False, False, True, True, False])) == [(0.5, 1.5), (2.5, 2.5)]
    assert closed_spans(time, np.ones(6, dtype=bool)) == []
    assert closed_spans(time, np.zeros(6, dtype=bool)) == [(0.0, 2.5)]


def test_recovery_panel_shows_distance_gate_and_v() -> None:
    document = recovery_panel(case(), case("lpvds"), "Title", 25.0, 2)
    assert [strokes(document, name) for name in ("series-2", "series-1")] == [2, 1]
    assert sum("opacity: 0.35" in style for style in drawn(document)) == 2  # closed, above and below
    assert {"Title", "time [s]", "V(x) [mm²]"} <= set(texts(document))
    assert strokes(recovery_panel(case(tolerance=0.002), None, "Title", 25.0, 2), "muted") == 2  # gate and its double


def test_sampler_panels_mark_what_was_kept() -> None:
    posterior, components = np.array([[-3.0, -1.0, -2.0]]), np.array([[4, 6, 5]])
    first, second = sampler_panels(posterior, components, {}, "pcgmm")
    assert {"log posterior", "sweep", "kept"} <= set(texts(first))
    assert {"components K", "sweep", "kept"} <= set(texts(second))
    (only,) = sampler_panels(posterior, components, {}, "em")
    assert {"log likelihood", "iteration"} <= set(texts(only))
    _, criterion = sampler_panels(posterior, components, {2: 5.0, 3: 4.0}, "em")
    assert {"Bayesian information criterion", "components K"} <= set(texts(criterion))
    assert sampler_panels(posterior, components, {3: 4.0, 2: 5.0}, "em")[1] == criterion


def test_sampler_panels_show_every_chain_and_the_one_that_was_kept() -> None:
    posterior, components = np.array([[-3.0, -2.0], [-9.0, -1.0], [-5.0, -4.0]]), np.array([[4, 6], [1, 5], [3, 3]])
    for panel in sampler_panels(posterior, components, {}, "pcgmm"):
        assert strokes(panel, "muted") == 3
        assert sum("stroke-opacity: 0.35" in style for style in drawn(panel)) == 2
    alone = sampler_panels(posterior[1:2], components[1:2], {}, "pcgmm")
    assert all("stroke-opacity: 0.35" not in style for panel in alone for style in drawn(panel))


def test_same_arrays_same_bytes_whatever_the_users_own_style() -> None:
    import matplotlib as mpl

    first = panel(pushed())
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.grid": True}):
        assert panel(pushed()) == first


def test_controllers_keep_their_colours() -> None:
    assert controller_colours(["clpvds paper", "lpvds"]) == {"clpvds paper": "series-3", "lpvds": "series-1"}
    others = controller_colours(["lpvds", "a", "b", "c"])
    assert [others[name] for name in "abc"] == ["series-4", "series-5", "series-4"]


# --- numbers --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (5273.6, 4, "5274"),
        (5273.6, 2, "5274"),
        (9.996, 3, "10.0"),
        (0.36552, 3, "0.366"),
        (-0.0010000003, 3, "\u22120.00100"),
        (7.08e-10, 2, "7.1·10⁻¹⁰"),
        (1.23456e9, 3, "1.23·10⁹"),
        (8, 3, "8"),
        (0.0, 3, "0"),
        (None, 3, "\u2013"),
        (float("nan"), 3, "\u2013"),
        (float("inf"), 3, "infinite"),
    ],
)
def test_number(value: float | None, digits: int, text: str) -> None:
    assert numbers.number(value, digits) == text


def test_other_texts_of_numbers() -> None:
    assert numbers.given(0.0001) == "0.0001"
    assert numbers.given(1e-6) == "1·10⁻⁶"
    assert numbers.given(2.0) == "2"
    assert numbers.span([61.52, 226.9]) == "61.5 to 227"
    assert numbers.span([2.0, 2.0001]) == "2"
    assert numbers.percent(0.5, sign=True) == "+50\u00a0%"
    assert numbers.percent(-0.0141) == "\u22121.4\u00a0%"
    assert numbers.percent(-0.0001, sign=True) == "0.0\u00a0%"
    assert numbers.vector_mm((0.0, -0.02)) == "[0, \u221220]\u00a0mm"
    assert numbers.vector_mm((0.0125, 0.1 + 0.2)) == "[12.5, 300]\u00a0mm"
    assert numbers.joined(["a", "b", "c"]) == "a, b and c"
    assert numbers.cell([1, 0.5, None, True]) == "[1, 0.5, \u2013, true]"
    assert numbers.condition_name("cond3") == "Cond. 3"
    assert numbers.condition_name("condor") == "condor"


def row(controller: str, condition: str, dtw: float, *, arrived: bool = True, mode: str = "robust") -> dict[str, Any]:
    names = ("dtw_per_step_mm", "sea_mm2", "steps", "duration_s", "final_error_mm", "recovery_s", "displaced_step")
    found = dict.fromkeys((*names, "velocity_rmse_mm_s"), 1.0)
    found |= {"dtw_mm": dtw, "sea_per_step_mm2": 2 * dtw, "lyapunov_rise_max": 0.0, "gate_closed_steps": 0}
    found |= {"energy_rise_max": 0.0, "clearance_min_mm": None}
    case = {"dynamics": "qlf", "controller": controller, "mode": mode, "avoidance": "none", "condition": condition}
    return {**case, "outcome": "arrived" if arrived else "timeout", **found}


def test_result_sentence_says_what_the_rows_say() -> None:
    rows = [row("lpvds", "none", 100.0), row("lpvds", "cond1", 150.0), row("lpvds", "cond2", 120.0, arrived=False)]
    rows += [row("clpvds", "none", 100.0), row("clpvds", "cond1", 101.0)]
    sentence = result_sentence(rows)
    assert "by +20\u00a0% to +50\u00a0% for plain LPV-DS and by +1.0\u00a0% for robust CLPV-DS;" in sentence
    assert sentence.endswith("4 of 5 roll-outs reached the goal.")
    assert "plain LPV-DS 100.0 mm. 1 of 1" in result_sentence(rows[:1])
    assert "plain LPV-DS, Cond. 1 150.0 mm and plain LPV-DS, Cond. 2 120.0 mm" in result_sentence(rows[1:3])


# --- deviations -----------------------------------------------------------------------------------------------------

RESOLVED = Resolved(
    top_speed=0.07,
    couplings={
        "clpvds robust": {"v_max": 0.25, "gate": 0.0, "p_max": 0.0, "k_c": 0.0},
        "clpvds paper": {"v_max": 0.0, "gate": 0.002, "p_max": 100.0, "k_c": 100.0},
    },
)
PUSH = Condition(name="cond1", disturbances=(Displacement(offset=(0.0, -0.02)),))


def rows_for(**changed: Any) -> list[Deviation]:
    parameters = {
        "ingest": LasaParameters(motion="Angle"),
        "mixture": PcGmmParameters(),
        "dynamics": QlfParameters(),
        "rollout": RolloutParameters(conditions=(Condition(), PUSH)),
        "evaluate": EvaluateParameters(),
    }
    return deviations({**parameters, **changed}, [RESOLVED])


def where(rows: Sequence[Deviation]) -> list[str]:
    return [found.where for found in rows]


def text(rows: Sequence[Deviation], place: str) -> str:
    return " ".join(f"{r.printed} {r.here} {r.why}" for r in rows if r.where == place)


def test_deviations_in_the_papers_order() -> None:
    places = ["(5), ref. [32]", "(6), (11)", "(7)", "(8)", "(9), (10), robust", "(24), (25)", "Figs 2, 3", "III-A"]
    assert where(rows_for()) == [*places, "(26), DTWD"]


def test_deviations_of_the_coupling_follow_the_controllers() -> None:
    printed = ClpvdsController(mode="paper")
    rows = rows_for(rollout=RolloutParameters(controllers=(LpvdsController(), printed)))
    assert [place for place in where(rows) if "printed" in place] == ["(9), printed", "(10), printed", "(12), printed"]
    assert "(9), (10), robust" not in where(rows)
    assert "at most 2 mm, and moves until it exceeds 4 mm" in text(rows, "(12), printed")
    assert "p_{max} = 100 1/s" in text(rows, "(10), printed")
    robot = ClpvdsController(mode="paper", p_max=10.0, gate=None)
    rows = rows_for(rollout=RolloutParameters(controllers=(robot,)))
    assert "(10), printed" not in where(rows)
    assert "(12), printed" in where(rows)
    rows = rows_for(rollout=RolloutParameters(mode="paper"))
    assert "(12), printed" in where(rows)
    plain = rows_for(rollout=RolloutParameters(controllers=(LpvdsController(),)))
    assert not [place for place in where(plain) if place.startswith(("(9)", "(10)", "(12)", "(24)"))]


def test_deviations_of_the_fit_follow_its_parameters() -> None:
    assert "40 sweeps over at most 300 points" in text(rows_for(), "(5), ref. [32]")
    assert "criterion" in text(rows_for(mixture=EmParameters()), "(5), ref. [32]")
    assert "K = 7" in text(rows_for(mixture=EmParameters(components=7)), "(5), ref. [32]")
    assert "in each of 4 chains" in text(rows_for(mixture=PcGmmParameters(chains=4)), "(5), ref. [32]")
    assert "K = 6, 9" in text(rows_for(mixture=AutoParameters(components=(6, 9))), "(5), ref. [32]")
    assert "0.5 1/s" in text(rows_for(dynamics=QlfParameters(margin=0.5)), "(8)")
    assert "(7)" not in where(rows_for(dynamics=QlfParameters(loss="norm")))
    assert "(7)" in where(rows_for())


def test_deviations_of_a_learned_v_follow_its_parameters() -> None:
    added = ["(5), (6), gates", "(7), added", "(6), speed"]
    learned = rows_for(dynamics=PqlfParameters(condition=20.0, margin=0.5))
    assert where(learned)[2:7] == ["(7)", "(8)", *added]
    assert "condition at most 20" in text(learned, "(8)")
    assert "0.5 1/s" in text(learned, "(8)")
    assert "dynamics.kind = pqlf" in text(learned, "(8)")
    assert "with 0 or 0.6 or 2 of the samples' weight" in text(learned, "(7), added")
    warped = rows_for(dynamics=WarpedParameters(speed_limit=1.5))
    assert where(warped)[2:7] == ["(7)", "(6), (8)", *added]
    assert "dynamics.kind = warped" in text(warped, "(6), (8)")
    assert "1.5 times" in text(warped, "(6), speed")
    assert "psi^{-1}" in text(warped, "(6), (11)")
    assert "psi" not in text(learned, "(6), (11)")
    bare = rows_for(dynamics=PqlfParameters(speed_limit=0.0, ridge=0.0, guidance=(0.0,)))
    assert [place for place in added if place in where(bare)] == added[:1]
    assert not set(added) & set(where(rows_for()))


def test_deviations_of_roll_outs_and_data() -> None:
    assert "Cayley" in text(rows_for(), "(6), (11)")
    euler = rows_for(rollout=RolloutParameters(integrator="euler"))
    assert "Explicit Euler" in text(euler, "(6), (11)")
    assert "Figs 2, 3" not in where(euler)  # nothing is displaced
    late = Condition(name="late", disturbances=(Displacement(offset=(0.01, 0.0), at_time=1.5),))
    both = rows_for(rollout=RolloutParameters(conditions=(PUSH, late)))
    assert "0.5 of the arc length" in text(both, "Figs 2, 3")
    assert "1.5 s after the start" in text(both, "Figs 2, 3")
    assert "ingest.train" in text(rows_for(ingest=LasaParameters(motion="Angle", train=(1, 2))), "III-A")
    assert "III-A" not in where(rows_for(ingest=SimpleNamespace(kind="bags")))
    assert "500 samples" in text(rows_for(evaluate=EvaluateParameters(samples=500)), "(26), DTWD")


# --- the whole report -----------------------------------------------------------------------------------------------

SWEEP = """
preset = "robust"
description = "Three motions & <three> controllers"
[midpoint]
samples = 150
[mixture]
sweeps = 5
components = []
[rollout]
controllers = [
    { kind = "lpvds" },
    { kind = "clpvds", mode = "robust" },
    { kind = "clpvds", mode = "paper", p_max = 10.0, gate = 0.02 },
]
conditions = [{ name = "none" }, { name = "nudge", disturbances = [{ kind = "displacement", offset = [0.0, -0.010] }] }]
[sweep]
"ingest.motion" = ["Line", "Multi_Models_1", "Angle"]
"""


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> tuple[Project, str]:
    """A project with a small sweep that has been run, and its report."""
    root = tmp_path_factory.mktemp("sweep")
    (root / "runs" / "small").mkdir(parents=True)
    (root / "runs" / "small" / "experiment.toml").write_text(SWEEP, encoding="utf-8")
    project = Project.open(root, STAGES)
    experiment = project.experiment("small")
    project.bring_up(experiment, "evaluate", jobs=1)
    write_report(project, experiment, root / "report.html")
    return project, (root / "report.html").read_text(encoding="utf-8")


def test_report_of_quickstart(quickstart: tuple[File, dict[str, Any]], tmp_path: File) -> None:
    project = Project.open(quickstart[0], STAGES)
    experiment = project.experiment("quickstart")
    report = write_report(project, experiment, tmp_path / "a" / "report.html")
    page = (tmp_path / "a" / "report.html").read_bytes()
    assert report.size == len(page) < 1_000_000
    assert report.pictures == ()
    write_report(project, experiment, tmp_path / "b.html")
    assert (tmp_path / "b.html").read_bytes() == page
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b.html"]
    found = page.decode()
    check_page(found)
    assert "clpv run quickstart\nclpv verify quickstart\nclpv report quickstart" in found
    assert "32 of 32 roll-outs reached the goal." in found
    assert found.count('role="img"') == 4 + 2 + 1 + 2  # Figs 2 and 3, recovery, sampler
    assert "<td>1\u00a0of\u00a01</td>" in found
    for row in quickstart[1]["summary"]["groups"]:
        # Four demonstrations: each mean has its interval behind it.
        assert f'>{numbers.number(row["dtw_mm"], 4)} <span class="i">(' in found
        assert f'>{numbers.number(row["sea_per_step_mm2"])} <span class="i">(' in found


def test_report_needs_nothing_and_names_no_place(sweep: tuple[Project, str]) -> None:
    project, page = sweep
    check_page(page)
    assert "http" not in page
    assert "<script" not in page
    assert str(project.root) not in page
    assert str(File.home()) not in page
    assert not re.findall(r"#[0-9a-f]{6}", page[page.index("<main>") :])  # every colour follows the mode
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_report_of_a_sweep_shows_every_motion_and_counts(sweep: tuple[Project, str]) -> None:
    _, page = sweep
    assert "Three motions &amp; &lt;three&gt; controllers" in page
    assert page.count('role="img"') == 3 + 3 + 4 + 2 + 2  # Fig. 2, motions, Fig. 3, recovery, sampler
    assert "without 1 Multi_Models" in page
    for motion in ("Line", "Multi_Models_1", "Angle"):
        assert f'<th scope="row" class="k">{motion}</th>' in page
    assert "Line, Multi_Models_1, Angle" in page  # the swept parameter
    assert "<td>3\u00a0of\u00a03</td>" in page  # certificates


def test_report_explains_a_gate_that_never_closed(sweep: tuple[Project, str]) -> None:
    _, page = sweep
    assert "Pushed roll-outs of printed CLPV-DS whose gate never closed" in page
    assert (
        '<td>12\u00a0of\u00a012 <span class="i">(76\u00a0to\u00a0100\u00a0%)</span></td>'
        "<td>nudge [0, \u221210]\u00a0mm: 12. The push stayed within" in page
    )
    assert "mm from x, and the gate closes beyond 40 mm." in page


def test_report_of_what_has_not_been_run_is_refused(tmp_path: File, clpv: Invoke) -> None:
    root = make_project(tmp_path, "quickstart")
    project = Project.open(root, STAGES)
    target = tmp_path / "report.html"
    with pytest.raises(StaleError, match="run 'clpv run quickstart' first"):
        write_report(project, project.experiment("quickstart"), target)
    assert not target.exists()
    result = clpv(root, "report", "quickstart")
    assert result.exit_code == 3
    assert "Traceback" not in result.output


def test_report_that_cannot_be_written_leaves_nothing(sweep: tuple[Project, str], tmp_path: File) -> None:
    project, _ = sweep
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(StoreError, match="cannot be written"):
        write_report(project, project.experiment("small"), tmp_path / "file" / "report.html")
