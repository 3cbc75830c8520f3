"""Several kinds of dynamics in one report: compared on the same motions, and shown one at a time everywhere else."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawings import strokes, texts
from hypothesis import given
from hypothesis import strategies as st
from pages import check_page

from pipeline.project import Project
from pipeline.report import Figure, Section, Table, assemble
from stages import STAGES
from stages.artifacts.metrics import read_metrics
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.warp import Warp
from stages.figures.candidates import MOST, candidates
from stages.figures.certificates_section import certificates
from stages.figures.flow import Path, Scene
from stages.figures.intervals import of, tally
from stages.figures.kinds import NEAREST, image_path, image_scene, kind_keys, moving_away, strip_panel, ticks
from stages.figures.kinds_compared import MEASURES, compare_kinds
from stages.figures.kinds_section import kinds_section, kinds_sentence
from stages.figures.numbers import number
from stages.figures.results import Results, read_results
from stages.figures.rollout_sections import rollouts_section
from stages.figures.sampler_section import chains_text
from stages.figures.sections import lead, sections
from stages.figures.style import CONTROLLERS
from stages.mixture.gaussian import GaussianMixture
from stages.mixture.spread import r_hat
from stages.trajectory import Array

KINDS = ["qlf", "pqlf", "warped"]
EXPERIMENT = """
preset = "robust"
[midpoint]
samples = 100
[mixture]
kind = "em"
components = 4
[dynamics]
kind = "pqlf"
[rollout]
starts = "all"
conditions = [{ name = "none" }, { name = "nudge", disturbances = [{ kind = "displacement", offset = [0.0, -0.010] }] }]
[sweep]
"dynamics.kind" = ["warped", "qlf", "pqlf"]
"ingest.motion" = ["Line", "Leaf_1", "Multi_Models_1"]
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A small sweep over kinds and motions that has been run."""
    root = tmp_path_factory.mktemp("kinds")
    (root / "runs" / "kinds").mkdir(parents=True)
    (root / "runs" / "kinds" / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    project = Project.open(root, STAGES)
    experiment = project.experiment("kinds")
    project.bring_up(experiment, "evaluate", jobs=1)
    return read_results(project, experiment)


@pytest.fixture(scope="module")
def made(results: Results) -> dict[str, Section]:
    """All sections of its report."""
    return {section.id: section for section in sections(results)}


@pytest.fixture(scope="module")
def section(made: dict[str, Section]) -> Section:
    """The one that compares kinds."""
    return made["kinds"]


def tables(section: Section) -> list[Table]:
    return [block for block in section.blocks if isinstance(block, Table)]


def figures(section: Section) -> list[Figure]:
    return [block for block in section.blocks if isinstance(block, Figure)]


def mean_error(results: Results, kind: str, motion: str, measure: str) -> float:
    """From the artifact alone: the plain controller, undisturbed, test demonstrations."""
    (point,) = [p for p in results.points if p.point.overrides == {"dynamics.kind": kind, "ingest.motion": motion}]
    rows = [r for r in read_metrics(point.files["metrics"]) if (r["controller"], r["condition"]) == ("lpvds", "none")]
    assert len(rows) == 7
    rows = [row for row in rows if row["split"] == "test"]
    assert len(rows) == 4
    return float(np.mean([row[measure] for row in rows]))


# --- what is compared -----------------------------------------------------------------------------------------------


def test_kinds_are_compared_on_the_same_motions(results: Results) -> None:
    comparison = compare_kinds(results)
    assert comparison.kinds == KINDS  # in their own order, not in that of the sweep
    assert comparison.word == "motions"
    assert comparison.paired
    for kind in KINDS:
        assert [unit.name for unit in comparison.units[kind]] == ["Line", "Leaf_1", "Multi_Models_1"]
        assert {unit.rollouts for unit in comparison.units[kind]} == {4}
        for measure, *_ in MEASURES:
            expected = [mean_error(results, kind, m, measure) for m in ("Line", "Leaf_1", "Multi_Models_1")]
            np.testing.assert_allclose(comparison.errors(kind, measure), expected)
    gains = comparison.errors("qlf", "dtw_mm") - comparison.errors("warped", "dtw_mm")
    assert list(gains[comparison.order()]) == sorted(gains, reverse=True)


def test_one_motion_is_compared_by_its_demonstrations(results: Results) -> None:
    leaf = replace(results, points=tuple(p for p in results.points if p.name == "Leaf_1"))
    comparison = compare_kinds(leaf)
    assert comparison.word == "demonstrations"
    assert [unit.name for unit in comparison.units["qlf"]] == [f"demonstration {demo}" for demo in "4567"]
    assert comparison.errors("qlf", "dtw_mm").mean() == pytest.approx(mean_error(results, "qlf", "Leaf_1", "dtw_mm"))


def test_one_kind_is_not_compared(results: Results) -> None:
    assert kinds_section(results.own) is None
    assert kinds_sentence(results.own) == ""


def test_points_that_are_not_the_same_are_not_paired(results: Results) -> None:
    missing = replace(results, points=results.points[:-1])
    assert not compare_kinds(missing).paired
    made = kinds_section(missing)
    assert made is not None
    assert figures(made) == []
    assert len(tables(made)) == 2


# --- the section ----------------------------------------------------------------------------------------------------


def test_table_of_errors_with_and_without_motions_of_several_branches(results: Results, section: Section) -> None:
    table = tables(section)[0]
    assert [row[:2] for row in table.rows] == [
        *((kind, "3") for kind in ("QLF", "P-QLF", "warped")),
        *((kind, "2, no Multi_Models") for kind in ("QLF", "P-QLF", "warped")),
    ]
    for row, kind in zip(table.rows, KINDS * 2, strict=True):
        motions = ["Line", "Leaf_1"] + ["Multi_Models_1"] * (row[1] == "3")
        for index, (measure, _, _, digits) in enumerate(MEASURES):
            values = [mean_error(results, kind, motion, measure) for motion in motions]
            mean, *interval = row[2 + 2 * index].split(" ")
            assert mean == number(float(np.mean(values)), digits)
            assert len(interval) == (len(motions) >= 3)  # of two there is none
            assert row[3 + 2 * index] == number(float(np.median(values)), digits)
        assert row[-1] == tally(4 * len(motions), 4 * len(motions))
    assert sum(span for _, span in table.groups) == len(table.columns)


def test_table_of_changes_and_of_every_motion(results: Results, section: Section) -> None:
    _, changes, _, by_motion = tables(section)
    qlf, warped = (
        [mean_error(results, kind, motion, "dtw_mm") for motion in ("Line", "Leaf_1", "Multi_Models_1")]
        for kind in ("qlf", "warped")
    )
    ratio = 100 * (np.mean(warped) / np.mean(qlf) - 1)
    assert changes.rows[1][:2] == ("warped", "3")
    assert float(changes.rows[1][-1].replace("\u2212", "-").split("\u00a0")[0]) == pytest.approx(ratio, abs=0.51)
    assert by_motion.columns == ("motion", *["QLF", "P-QLF", "warped"] * 3)
    assert by_motion.rows[1][0] == "Leaf_1"
    assert (by_motion.rows[1][-3], by_motion.rows[1][-1]) == (number(qlf[1], 4), number(warped[1], 4))
    assert by_motion.collapsed


def test_table_of_what_is_proved(results: Results, section: Section) -> None:
    table = tables(section)[2]
    assert [row[0] for row in table.rows] == ["QLF", "P-QLF", "warped"]
    assert [row[3] for row in table.rows] == ["3\u00a0of\u00a03"] * 3
    assert table.rows[0][4:6] == ("1", "\u2013")
    slopes = [p.fit["certificate"]["warp_slope"] for p in results.of_kind("warped").points]
    assert table.rows[2][5] == number(max(slopes))
    assert 0.0 < max(slopes) < 1.0


def test_flow_of_the_motion_with_the_largest_gain_under_every_kind_and_its_image(
    results: Results, section: Section
) -> None:
    _, flows = figures(section)
    assert flows.caption.startswith("Leaf_1, where warped dynamics gain most.")
    errors = [number(mean_error(results, kind, "Leaf_1", "dtw_mm"), 4) for kind in KINDS]
    titles = [f"{name}: DTW {error} mm" for name, error in zip(("QLF", "P-QLF", "warped"), errors, strict=True)]
    for panel, title in zip(flows.panels, [*titles, "warped, as psi shows it"], strict=True):
        assert title in texts(panel.svg)
        assert panel.alt.startswith(title)
    for panel in flows.panels:
        assert strokes(panel.svg, "series-1") == 4  # roll-outs of the plain controller
        assert strokes(panel.svg, "series-5") > 3  # level lines
        assert strokes(panel.svg, "ink") == 7
    assert "psi₁ [mm]" in texts(flows.panels[3].svg)
    assert all(panel.alt for figure in figures(section) for panel in figure.panels)


# --- all other sections ---------------------------------------------------------------------------------------------


def test_the_kind_of_the_file_is_the_experiments_own(results: Results) -> None:
    assert results.kind == "pqlf"
    assert results.kinds == KINDS
    assert [point.name for point in results.own.points] == ["Line", "Leaf_1", "Multi_Models_1"]
    assert results.own.points_word == "motions"
    assert {row["dynamics"] for row in results.own.rows} == {"pqlf"}
    assert results.own.kinds == ["pqlf"]


def test_other_sections_show_the_own_kind_and_say_so(results: Results, made: dict[str, Section]) -> None:
    assert next(iter(made)) == "kinds"
    named = [section.title for section in made.values() if section.title.endswith(" \u00b7 P-QLF")]
    assert len(named) == len(made) - 3
    assert {made["kinds"].title, made["parameters"].title, made["provenance"].title}.isdisjoint(named)
    assert len(figures(made["rollouts"])[1].panels) == 3
    assert {row[0] for row in tables(made["certificates"])[1].rows} == {"Line", "Leaf_1", "Multi_Models_1"}
    rows = results.own.rows
    facts = tables(made["facts"])[0].rows
    assert facts[0][1] == of(3, 3)
    arrived = sum(row["outcome"] == "arrived" for row in rows)
    assert lead(results)[1].text.endswith(f"{arrived} of {len(rows)} roll-outs reached the goal.")  # type: ignore[union-attr]
    assert "`dynamics.kind = pqlf` alone" in made["kinds"].blocks[0].text  # type: ignore[union-attr]


def test_the_head_compares_kinds(results: Results) -> None:
    sentence = kinds_sentence(results)
    for kind, name in (("qlf", "QLF"), ("pqlf", "P-QLF"), ("warped", "warped")):
        errors = [mean_error(results, kind, motion, "dtw_mm") for motion in ("Line", "Leaf_1", "Multi_Models_1")]
        assert f"{number(float(np.mean(errors)), 4)} mm under {name}" in sentence
    assert "All that follows is of P-QLF dynamics" in sentence


def test_parameters_and_provenance_are_of_all_kinds(made: dict[str, Section]) -> None:
    values = dict(tables(made["parameters"])[0].rows)
    assert values["`dynamics.kind`"] == "qlf, pqlf, warped"
    assert values["`dynamics.margin`"] == "QLF, P-QLF: 0.001; warped: 0.02"
    stages = [name.strip("`").partition(".")[0] for name in values if "." in name]
    assert sum(a != b for a, b in pairwise(stages)) == len(set(stages)) - 1  # stage by stage
    assert values["`dynamics.loss`"] == "QLF: squared"
    assert values["`mixture.components`"] == "4"
    assert values["`ingest.motion`"] == "Line, Leaf_1, Multi_Models_1"
    keys = tables(made["provenance"])[1].rows
    assert len({row[0] for row in keys}) == 9
    assert ("Leaf_1, warped", "dynamics") in {row[:2] for row in keys}


def test_the_page_is_whole(results: Results, made: dict[str, Section]) -> None:
    page = assemble("kinds", lead(results), list(made.values()))
    check_page(page)
    assert len(page) < 1_500_000
    assert "kind=" not in page.partition('<section id="provenance"')[0]  # no point is named by its kind
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert not re.findall(r"#[0-9a-f]{6}", page[page.index("<main>") :])


# --- fits and samplers ----------------------------------------------------------------------------------------------


def test_facts_of_the_fit_are_those_of_the_artifact(results: Results) -> None:
    warped = results.of_kind("warped")
    ranges, learned, proved = tables(certificates(warped))
    for point, row in zip(warped.points, learned.rows, strict=True):
        found = dict(zip(learned.columns, row, strict=True))
        fit = point.fit
        assert found["mixture"] == fit["mixture"] == "em"
        assert found["condition of P"] == number(float(np.linalg.cond(point.model.lyapunov_matrix)))
        assert found["speed limit [mm/s]"] == number(1e3 * point.model.speed_limit)
        assert found["test error [mm/s]"] == number(1e3 * fit["test_rmse"])
        assert found["training error [mm/s]"] == number(1e3 * fit["rmse"])
    for point, row in zip(warped.points, proved.rows, strict=True):
        found = dict(zip(proved.columns, row, strict=True))
        assert point.model.warp is not None
        assert found["steepest slope of psi"] == number(point.model.warp.bound)
        assert found["form"] == point.fit["solver"]["form"]
    steepest = max(point.fit["certificate"]["warp_slope"] for point in warped.points)
    by_fact = {row[0]: row[1:] for row in ranges.rows}
    assert by_fact["steepest slope of psi"][2] == number(steepest)
    assert by_fact["K"] == ("4", "4.00", "4")


def test_what_a_kind_does_not_have_is_left_out(results: Results) -> None:
    section = certificates(results.of_kind("qlf"))
    columns = [column for table in tables(section) for column in table.columns]
    assert "steepest slope of psi" not in columns
    assert "speed limit [mm/s]" not in columns
    text = section.blocks[0].text  # type: ignore[union-attr]
    assert "psi" not in text
    assert "psi" in certificates(results.of_kind("warped")).blocks[0].text  # type: ignore[union-attr]


def test_chains_are_described_by_burn_in_r_hat_and_spread() -> None:
    rng = np.random.default_rng(0)
    same = np.concatenate([np.full((3, 2), -50.0), rng.normal(size=(3, 38))], axis=1)
    components = np.tile([5, 6, 7], (40, 1)).T
    text = chains_text(same, components)
    agreed = number(r_hat(same[:, 20:]))
    assert text.startswith(f"3 chains. Burn-in: 2 of 40 sweeps at most. R-hat of the log posterior: {agreed}. Best")
    assert "not mixed" not in text
    assert text.endswith("components there: 5 to 7.")
    best = same.max(axis=1)
    assert f"{best.min():.5g} to {best.max():.5g}; components there" in text
    apart = same + np.array([[0.0], [10.0], [20.0]])
    assert "(above 1.1: by custom not mixed)" in chains_text(apart, components)
    assert chains_text(same[:1], components[:1]) == "Burn-in: 2 of 40 sweeps."
    assert "R-hat" not in chains_text(same[:, :4], components[:, :4])  # too few to tell


def tried(count: int) -> Any:
    found = {"condition": 2.0, "velocity_error": 0.3, "held_out_error": 0.4, "deviation": 0.001}
    found |= {"held_out_deviation": 0.002, "score": 0.006, "arrives": True}
    made = {"mixture": "em-6", "components": 6, "guidance": 0.6}
    entries = [{**made, **found, "share": 0.1 * n, "chosen": n == 1} for n in range(count)]
    entries[0] |= dict.fromkeys(found)
    return SimpleNamespace(shown=SimpleNamespace(name="Line", fit={"tried": entries}))


def test_candidates_are_listed_by_what_sets_them_apart() -> None:
    assert candidates(tried(1)) is None
    found = candidates(tried(3))
    assert found is not None
    text, table = found
    assert isinstance(table, Table)
    assert table.columns[:2] == ("straightened", "condition of P")
    assert text.text.endswith("is taken: straightened 0.1.")  # type: ignore[union-attr]
    assert set(table.rows[0][1:-1]) == {"\u2013"}
    assert table.rows[1] == ("0.1", "2.00", "0.300", "0.400", "1.00", "2.00", "6.00", "yes", "yes")
    assert not table.collapsed
    many = candidates(tried(MOST + 1))
    assert many is not None
    assert many[1].collapsed  # type: ignore[union-attr]


# --- drawings -------------------------------------------------------------------------------------------------------


def test_strip_panel_draws_a_line_a_motion_and_a_dot_a_kind() -> None:
    names = ["Angle", "Line", "Worm"]
    document = strip_panel(
        names, {"qlf": np.array([5000.0, 800.0, 900.0]), "warped": np.array([1000.0, 900.0, 850.0])}, "DTW", "mm", 3
    )
    assert [text for text in texts(document) if text in names] == names
    assert {"DTW", "mm", "1000", "2000", "5000"} <= set(texts(document))
    dots = {key.label: len(re.findall(rf"<use[^>]*fill: {_drawn(key.colour)}", document)) for key in kind_keys(KINDS)}
    assert dots == {"QLF": 3, "P-QLF": 0, "warped": 3}


def _drawn(name: str) -> str:
    from stages.figures.style import colour

    return colour(name)


def test_kinds_have_colours_of_their_own() -> None:
    colours = [key.colour for key in kind_keys(KINDS)]
    assert len(set(colours)) == 3
    assert not set(colours) & set(CONTROLLERS.values())


@given(st.floats(-3, 4), st.floats(0.05, 3))
def test_ticks_are_inside_and_apart(power: float, decades: float) -> None:
    low, high = 10**power, 10 ** (power + decades)
    marks = ticks(low, high)
    assert len(marks) >= 2
    assert low <= marks[0]
    assert marks[-1] <= high
    gaps = np.diff(np.log(marks)) / np.log(high / low)
    assert gaps.min() >= NEAREST - 1e-9


def test_ticks_by_hand() -> None:
    assert ticks(705.0, 16645.0) == [1000.0, 2000.0, 5000.0, 10000.0]
    assert ticks(3.4, 33.0) == [5.0, 10.0, 20.0]


def test_share_of_the_way_on_which_the_distance_rises() -> None:
    goal = np.array([-2.0, 1.0])
    away = goal + np.array([[1.0, 0.0], [3.0, 0.0], [0.0, 0.0]])  # 2 away, then 3 towards
    assert moving_away(away, goal) == pytest.approx(0.4)
    assert moving_away(away[::-1], goal) == pytest.approx(0.6)
    assert moving_away(goal + np.linspace(1.0, 0.0, 9)[:, None] * [3.0, 4.0], goal) == 0.0


def warped_model() -> LpvDs:
    mixture = GaussianMixture(
        weights=np.array([0.5, 0.5]),
        means=np.array([[1.0, 1.0], [2.0, 0.0]]),
        covariances=np.tile(np.eye(2), (2, 1, 1)),
    )
    warp = Warp(centres=[[0.5, 0.2], [-0.5, 0.4]], translations=[[0.3, 0.2], [-0.1, 0.4]], rates=[1.0, 1.3])
    return LpvDs(
        mixture=mixture,
        matrices=np.array([[[-1.0, 0.5], [-0.5, -1.0]], [[-2.0, 0.1], [0.0, -1.0]]]),
        goal=np.array([0.4, -0.3]),
        lyapunov_matrix=np.array([[1.2, 0.1], [0.1, 0.8]]),
        warp=warp,
    )


def test_image_of_a_scene_is_the_system_seen_through_psi() -> None:
    model = warped_model()
    x: Array = np.random.default_rng(0).normal(size=(20, 2))
    scene = Scene(train=[x], test=[], means=x, covariances=x, goal=model.goal, velocity=model.velocity)
    image = image_scene(scene, model)
    (y,) = image.train
    assert image.lyapunov is not None
    np.testing.assert_allclose(image.lyapunov(y), model.lyapunov(x), rtol=1e-9)
    step = 1e-6
    assert model.warp is not None
    moved, back = (model.warp.apply(x + sign * step * model.velocity(x) - model.goal)[0] for sign in (1, -1))
    np.testing.assert_allclose(image.velocity(y), (moved - back) / (2 * step), rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(image.goal, model.warp.apply(np.zeros((1, 2)))[0][0], atol=1e-15)
    path = image_path(Path(x=None, executed=x, displaced=-1), model)
    np.testing.assert_array_equal(path.executed, y)


def test_three_coordinates_are_shown_in_two_planes_beside_each_other() -> None:
    way = np.linspace(1.0, 0.0, 40)[:, None] * np.array([0.3, 0.1, 0.2])
    model = SimpleNamespace(
        mixture=SimpleNamespace(means=np.zeros((1, 3)), covariances=1e-4 * np.eye(3)[None]),
        velocity=lambda x: -x,
        lyapunov=lambda x: (x**2).sum(axis=1),
    )
    names = {"controller": "lpvds", "label": "lpvds", "condition": "none", "split": "train", "outcome": "arrived"}
    shown: Any = SimpleNamespace(
        name="carry",
        midpoints=SimpleNamespace(
            goal=np.zeros(3), of_split=lambda split: [SimpleNamespace(position=way)] if split == "train" else []
        ),
        model=model,
        rollouts=[
            SimpleNamespace(
                x=way, p_hat=way, displaced=-1, scene="", status=np.full(40, "free"), time=np.arange(40.0), **names
            )
        ],
        rollout_parameters=SimpleNamespace(conditions=()),
    )
    results: Any = SimpleNamespace(shown=shown, controllers=["lpvds"], is_sweep=False, conditions=())
    (figure,) = figures(rollouts_section(results))
    assert figure.columns == 2
    assert [{"x [mm]", "y [mm]", "z [mm]"} & set(texts(panel.svg)) for panel in figure.panels] == [
        {"x [mm]", "z [mm]"},
        {"x [mm]", "y [mm]"},
    ]
    assert "plane of x and z" in figure.panels[0].alt
    assert "two planes" in figure.caption
