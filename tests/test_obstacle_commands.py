"""Obstacles on the command line: what is wrong is said in one sentence; what is right runs, is shown and repeats."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from support import Invoke
from typer.testing import CliRunner

CHAIN = """
preset = "robust"
[ingest]
motion = "Line"
[midpoint]
samples = 100
[mixture]
kind = "em"
components = 2
[dynamics]
kind = "qlf"
"""
# The demonstrations come from about (25, 45) mm and end at the origin; the sphere is on all of their ways.
ROLLOUT = """
[rollout]
max_duration = 8.0
controllers = [{ kind = "lpvds" }, { kind = "clpvds" }]
avoidances = [{ kind = "apf", range = 0.005 }, { kind = "roas" }, { kind = "roas+" }]
conditions = [
    { name = "none" },
    { name = "one", obstacles = [{ kind = "sphere", centre = [0.013, 0.024], radius = 0.006 }] },
]
"""
METHODS = ("apf", "roas", "roas+")
SPHERE = "kind = 'sphere', centre = [0.013, 0.024], radius = 0.006"


def project(root: Path, text: str = CHAIN + ROLLOUT) -> Path:
    (root / "runs" / "block").mkdir(parents=True)
    (root / "runs" / "block" / "experiment.toml").write_text(text, encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A project in which the experiment has been run once, and what ``run --json`` printed."""
    from stages.cli import app

    root = project(tmp_path_factory.mktemp("block"))
    result = CliRunner(env={"CLPV_ROOT": str(root)}).invoke(app, ["run", "block", "--json"])
    assert result.exit_code == 0, result.output
    return root, json.loads(result.stdout)


def table(root: Path, clpv: Invoke, stage: str = "rollout", artifact: str = "rollouts") -> Path:
    record = json.loads(clpv(root, "show", "block", "--stage", stage, "--json").stdout)
    return root / next(str(a["file"]) for a in record["artifacts"] if a["artifact"] == artifact)


# --- what is wrong --------------------------------------------------------------------------------------------------


def conditions(entry: str) -> str:
    return f"rollout.conditions=[{entry}]"


def obstacle(entry: str) -> str:
    return conditions(f"{{name = 'a', obstacles = [{{{entry}}}]}}")


@pytest.mark.parametrize(
    ("change", "location", "says"),
    [
        (
            obstacle("kind = 'sphere', centre = [0.0, 0.0], radius = -0.1"),
            "conditions.0.obstacles.0.radius",
            ("greater than 0", "-0.1"),
        ),
        (obstacle("kind = 'sphere', centre = [0.0, 0.0], radius = 0"), "conditions.0.obstacles.0.radius", ("greater",)),
        (obstacle("kind = 'sphere', radius = 0.1"), "conditions.0.obstacles.0.centre", ("must be given",)),
        (obstacle("kind = 'box', centre = [0.1, 0.1]"), "conditions.0.obstacles.0.half_extents", ("must be given",)),
        (obstacle(f"{SPHERE}, velocity = [nan, 0.0]"), "conditions.0.obstacles.0.velocity.0", ("finite", "NaN")),
        (obstacle(f"{SPHERE}, velocity = [0.0, inf]"), "conditions.0.obstacles.0.velocity.1", ("finite",)),
        (obstacle(f"{SPHERE}, velocity = [0.0, 0.0, 1.0]"), "conditions.0.obstacles.0.velocity", ("3 coordinates",)),
        (
            obstacle("kind = 'sphere', centre = [0.0, 0.0, 0.1], radius = 0.1"),
            "conditions.0.obstacles.0.centre",
            ("3 coordinates", "motion has 2"),
        ),
        (
            obstacle("kind = 'box', centre = [0.0, 0.1], half_extents = [0.1, 0.1], rotation = [0.0, 0.0, 0.0, 1.0]"),
            "conditions.0.obstacles.0.rotation",
            ("one angle, rad",),
        ),
        (
            obstacle("kind = 'shpere', centre = [0.0, 0.0], radius = 0.1"),
            "conditions.0.obstacles.0.kind",
            ("'shpere'", "did you mean 'sphere'?", "box, ellipsoid, sphere"),
        ),
        (obstacle("centre = [0.0, 0.0], radius = 0.1"), "conditions.0.obstacles.0.kind", ("must be given",)),
        (
            obstacle("kind = 'sphere', centre = [0.0, 0.0], raduis = 0.1, radius = 0.1"),
            "conditions.0.obstacles.0.raduis",
            ("did you mean 'radius'?",),
        ),
        (
            "rollout.avoidances=[{kind = 'roas'}, {kind = 'raos+'}]",
            "avoidances.1.kind",
            ("'raos+'", "did you mean 'roas+'?"),
        ),
        ("rollout.avoidances=[{kind = 'roas+', rate = 1e6}]", "avoidances.0.rate", ("1/dt", "safe")),
        ("rollout.avoidances=[{kind = 'cbf', rate = 1e6}]", "avoidances.0.rate", ("1/dt", "safe")),
        ("rollout.avoidances=[{kind = 'roas+', margin = -0.1}]", "avoidances.0.margin", ("greater than or equal",)),
        ("rollout.avoidances=[{kind = 'roas+', swiftness = 0.5}]", "avoidances.0.swiftness", ("equal to 1",)),
        ("rollout.avoidances=[{kind = 'apf', range = 0.0}]", "avoidances.0.range", ("greater than 0",)),
        ("rollout.avoidances=[{kind = 'cbf'}, {kind = 'cbf'}]", "avoidances.1.name", ("earlier method",)),
        ("rollout.avoidances=[]", "avoidances", ("at least one",)),
        (
            "rollout.controllers=[{kind = 'clpvds', mode = 'paper', gate = 0.0}]",
            "controllers.0.gate",
            ("never reaches x", "mode = robust"),
        ),
        (
            "rollout={mode = 'paper', integrator = 'euler', dt = 0.1, controllers = [{kind = 'clpvds'}]}",
            "controllers.0.p_max",
            ("C dt", "overshoots", "cayley", "dt <= "),
        ),
        (
            conditions("{name = 'a', displacement = [0.0, -0.02]}"),
            "conditions.0.displacement",
            ("unknown parameter", "disturbances"),
        ),
        (
            conditions("{name = 'a', disturbances = [{kind = 'push', offset = [0.0, 0.1]}]}"),
            "conditions.0.disturbances.0.kind",
            ("'push'", "displacement, held, noise, ramp"),
        ),
        (
            conditions("{name = 'a', disturbances = [{kind = 'noise', std = nan, duration = 1.0}]}"),
            "conditions.0.disturbances.0.std",
            ("finite", "NaN"),
        ),
        (
            conditions("{name = 'a', scenes = {fewest = 3, most = 2}}"),
            "conditions.0.scenes.fewest",
            ("more than most",),
        ),
        (conditions("{name = 'a', scenes = {count = 0}}"), "conditions.0.scenes.count", ("equal to 1",)),
        (
            conditions(f"{{name = 'a', scenes = {{}}, obstacles = [{{{SPHERE}}}]}}"),
            "conditions.0.scenes",
            ("not both",),
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(
    ran: tuple[Path, dict[str, Any]], clpv: Invoke, change: str, location: str, says: tuple[str, ...]
) -> None:
    # The fit is there already, and its result stays as it is.
    root = ran[0]
    before = {path: path.stat().st_mtime_ns for path in (root / "runs" / "block").iterdir()}
    result = clpv(root, "run", "block", "--set", change)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert "Traceback" not in result.output
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert line.startswith(f"error: rollout.{location}: ")
    assert line.endswith(".")
    for text in says:
        assert text in line
    assert {path: path.stat().st_mtime_ns for path in (root / "runs" / "block").iterdir()} == before


def test_no_room_for_a_sphere_is_a_fault_of_the_data(ran: tuple[Path, dict[str, Any]], clpv: Invoke) -> None:
    change = conditions("{name = 'a', scenes = {smallest = 3.0, largest = 3.0}}")
    result = clpv(ran[0], "run", "block", "--set", change)
    assert result.exit_code == 1
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert "condition a, Line, demonstration 4: there is no room for a sphere: lower scenes.smallest" in line


def test_a_goal_inside_of_an_obstacle_is_an_outcome_with_a_remedy(
    ran: tuple[Path, dict[str, Any]], clpv: Invoke
) -> None:
    change = conditions(
        "{name = 'none'}, {name = 'in', obstacles = [{kind = 'sphere', centre = [0.0, 0.001], radius = 0.01}]}"
    )
    result = clpv(ran[0], "run", "block", "--json", "--set", change)
    assert result.exit_code == 0, result.output
    rows = json.loads(result.stdout)["rows"]
    among = [row for row in rows if row["condition"] == "in"]
    assert len(among) == 2 * 3 * 4
    assert {row["outcome"] for row in among} == {"goal-inside"}
    assert {row["steps"] for row in among} == {0}
    assert {row["outcome"] for row in rows if row["condition"] == "none"} == {"arrived"}
    (warning,) = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert "24 roll-outs could not begin (goal-inside), the first lpvds/apf/in/4." in warning
    assert "move the obstacle, or lower radius or margin" in warning


# --- what is right --------------------------------------------------------------------------------------------------


def test_one_obstacle_and_three_methods(ran: tuple[Path, dict[str, Any]]) -> None:
    document = ran[1]
    rows = document["rows"]
    assert not any(stage["cached"] for stage in document["stages"])
    assert len(rows) == 2 * (4 + 3 * 4)
    cases = {(row["controller"], row["avoidance"], row["condition"], row["demo"]) for row in rows}
    assert cases == {
        (controller, *case, demo)
        for controller in ("lpvds", "clpvds")
        for case in (("none", "none"), *((method, "one") for method in METHODS))
        for demo in "4567"
    }
    for row in rows:
        if row["condition"] == "none":
            assert (row["scene"], row["traps"], row["clearance_min_mm"], row["avoiding_steps"]) == (None, None, None, 0)
            assert row["outcome"] == "arrived"
            continue
        assert (row["scene"], row["traps"]) == ("one", 0)
        assert (row["outcome"] == "collided") == (row["clearance_min_mm"] < 0.0)
    assert "collided" in {row["outcome"] for row in rows if row["avoidance"] == "roas"}
    ours = [row for row in rows if row["avoidance"] == "roas+"]
    assert {row["outcome"] for row in ours} == {"arrived"}
    for row in ours:
        assert row["avoiding_steps"] > 0
        assert row["clearance_min_mm"] > 0.0
        assert (row["lyapunov_rise_max"], row["flagged_steps"], row["yielding_steps"]) == (0, 0, 0)


def test_groups_of_the_summary_are_by_method(ran: tuple[Path, dict[str, Any]]) -> None:
    document = ran[1]
    groups = {(g["controller"], g["avoidance"], g["condition"]): g for g in document["summary"]["groups"]}
    assert len(groups) == 2 * (1 + 3)
    for (controller, method, condition), group in groups.items():
        wanted = {"controller": controller, "avoidance": method, "condition": condition}
        rows = [row for row in document["rows"] if wanted.items() <= row.items()]
        assert group["rollouts"] == len(rows) == 4
        assert group["collided"] == sum(row["outcome"] in ("collided", "infeasible", "too-fast") for row in rows)
        assert group["trapped"] == sum(row["outcome"] == "trapped" for row in rows)
        assert group["steps"] == pytest.approx(math.fsum(row["steps"] for row in rows) / 4)
        least = [row["clearance_min_mm"] for row in rows if row["clearance_min_mm"] is not None]
        assert group["clearance_min_mm"] == (min(least) if least else None)


def test_headline_of_the_experiment_names_methods(ran: tuple[Path, dict[str, Any]], clpv: Invoke) -> None:
    record = json.loads(clpv(ran[0], "show", "block", "--json", "--stage", "evaluate").stdout)
    said = json.dumps(record)
    for method in METHODS:
        assert f"arrived lpvds/robust/{method}/one" in said
    assert "collided lpvds/robust/none" not in said


def test_a_second_run_does_no_work(ran: tuple[Path, dict[str, Any]], clpv: Invoke) -> None:
    again = json.loads(clpv(ran[0], "run", "block", "--json").stdout)
    assert all(stage["cached"] for stage in again["stages"])
    assert again["manifest"] == "unchanged"
    assert again["rows"] == ran[1]["rows"]


@pytest.mark.parametrize(
    "change",
    ["rollout.avoidances.2.margin=0.001", "rollout.conditions.1.obstacles.0.radius=0.007", "rollout.replicate=1"],
)
def test_what_obstacles_and_methods_make_stale(ran: tuple[Path, dict[str, Any]], clpv: Invoke, change: str) -> None:
    found = json.loads(clpv(ran[0], "status", "block", "--json", "--set", change).stdout)
    states = {row["stage"]: row["state"] for row in found["experiments"][0]["stages"]}
    assert states.pop("rollout") == "stale"
    assert states.pop("evaluate") in ("stale", "waiting")
    assert set(states.values()) == {"cached"}


def test_two_fresh_runs_write_the_same_bytes(ran: tuple[Path, dict[str, Any]], tmp_path: Path, clpv: Invoke) -> None:
    root = project(tmp_path)
    assert clpv(root, "run", "block", "--quiet").exit_code == 0
    for stage, artifact in (("rollout", "rollouts"), ("evaluate", "metrics")):
        fresh = table(root, clpv, stage, artifact)
        assert fresh.read_bytes() == table(ran[0], clpv, stage, artifact).read_bytes()
    manifests = [(r / "runs" / "block" / "manifest.json").read_text(encoding="utf-8") for r in (root, ran[0])]
    digests = [{key: entry["outputs"] for key, entry in json.loads(manifest)["keys"].items()} for manifest in manifests]
    assert digests[0] == digests[1]


def test_report_of_obstacles(ran: tuple[Path, dict[str, Any]], clpv: Invoke, tmp_path: Path) -> None:
    result = clpv(ran[0], "report", "block", "--output", str(tmp_path / "report.html"))
    assert result.exit_code == 0, result.output
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<section id="obstacles"' in page
    for method in ("APF", "ROAS as printed", "ROAS+"):
        assert method in page
    ours = [row for row in ran[1]["rows"] if row["avoidance"] == "roas+"]
    assert f"ROAS+ {len(ours)} of {len(ours)} (0 collided)" in page
    assert str(ran[0]) not in page
