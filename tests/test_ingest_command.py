"""From recordings to metrics by the command line alone: `clpv info`, `clpv ingest NAME SOURCE…`, `clpv run NAME`."""

from __future__ import annotations

import dataclasses
import json
import os
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import recording_writers as writers
from support import Invoke


@pytest.fixture
def bags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with four ROS 1 bags of two arms, in its folder ``bags``; it is the current folder."""
    (tmp_path / "runs").mkdir()
    for seed in range(4):
        writers.write(tmp_path / "bags", "ros1", "pose", writers.two_arms(200, seed=seed), name=f"demo{seed}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def sources(root: Path) -> list[str]:
    return [f"bags/{path.name}" for path in sorted((root / "bags").iterdir())]


def tree(root: Path) -> set[str]:
    return {p.relative_to(root).as_posix() for p in root.rglob("*") if "runs/.store" not in p.as_posix()}


def test_from_bags_to_metrics_and_report(bags: Path, clpv: Invoke) -> None:
    result = clpv(bags, "ingest", "carry", *sources(bags), "--left", "/left/pose", "--right", "/right/pose")
    assert result.exit_code == 0, result.output
    result = clpv(bags, "run", "carry", "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert len(document["rows"]) == 8  # two controllers from four starts
    assert {row["split"] for row in document["rows"]} == {"train"}
    assert {row["outcome"] for row in document["rows"]} == {"arrived"}
    assert document["stages"][0]["cached"]
    figures = json.loads(clpv(bags, "show", "carry", "--json").stdout)
    assert figures["metrics"]["midpoint"]["separation_m"] == pytest.approx(0.4)
    assert figures["data"]["ingest: counts"].startswith("demonstrations 4, train 4")
    assert clpv(bags, "report", "carry").exit_code == 0
    page = (bags / "runs/carry/report.html").read_text()
    assert "Recordings" in page
    assert "clamp along y" in page
    assert clpv(bags, "verify", "carry").exit_code == 0


def test_the_line_that_info_prints_works(bags: Path, clpv: Invoke) -> None:
    found = json.loads(clpv(bags, "info", "bags/demo0.bag", "--json").stdout)
    words = shlex.split(found["command"])
    assert words[:2] == ["clpv", "ingest"]
    assert clpv(bags, *words[1:]).exit_code == 0
    shown = clpv(bags, "info", "bags/demo0.bag").stdout
    assert found["command"] in shown
    assert "/left/pose" in shown


def test_arms_are_found_by_their_names(bags: Path, clpv: Invoke) -> None:
    result = clpv(bags, "ingest", "carry", *sources(bags))
    assert result.exit_code == 0, result.output
    table = tomllib.loads((bags / "runs/carry/experiment.toml").read_text())["ingest"]
    assert (table["left"], table["right"]) == ("/left/pose", "/right/pose")


def test_arms_that_have_no_names_must_be_selected(bags: Path, clpv: Invoke) -> None:
    path = writers.write(bags / "other", "ros1", "array", writers.two_arms(50))
    before = tree(bags)
    result = clpv(bags, "ingest", "carry", os.path.relpath(path, bags), "--point", "/nothing")
    assert result.exit_code == 1
    assert "/nothing" in result.stderr
    assert tree(bags) == before


def test_split_card_and_digests(bags: Path, clpv: Invoke) -> None:
    given = sources(bags)
    assert clpv(bags, "ingest", "carry", *given, "--test", given[3]).exit_code == 0
    card = tomllib.loads((bags / "datasets/carry/dataset.toml").read_text())
    assert card["counts"]["train"] == 3
    assert card["counts"]["test"] == 1
    assert set(card["files"]) == set(given)
    rows = json.loads(clpv(bags, "eval", "carry", "--json").stdout)["rows"]
    assert {(row["demo"], row["split"]) for row in rows} == {("4", "test")}
    # The experiment is of these very files.
    (bags / "bags" / "demo0.bag").unlink()
    writers.write(bags / "bags", "ros1", "pose", writers.two_arms(200, seed=9), name="demo0")
    result = clpv(bags, "run", "carry")
    assert result.exit_code == 1
    assert "demo0.bag" in result.stderr
    assert "sha256" in result.stderr


def test_what_people_write_in_a_card_stays(bags: Path, clpv: Invoke) -> None:
    assert clpv(bags, "ingest", "carry", *sources(bags)).exit_code == 0
    path = bags / "datasets/carry/dataset.toml"
    path.write_text(path.read_text().replace("not stated: say under which licence others may use it", "CC-BY-4.0"))
    assert clpv(bags, "ingest", "carry", *sources(bags)[:3], "--replace").exit_code == 0
    card = tomllib.loads(path.read_text())
    assert card["licence"] == "CC-BY-4.0"
    assert card["counts"]["demonstrations"] == 3


def test_two_files_are_one_demonstration(bags: Path, clpv: Invoke) -> None:
    given = sources(bags)
    pairs = [f"{given[0]}+{given[1]}", f"{given[2]}+{given[3]}"]
    result = clpv(bags, "ingest", "carry", *pairs, "--left", "/left/pose", "--right", "/right/pose")
    assert result.exit_code == 0, result.output
    card = tomllib.loads((bags / "datasets/carry/dataset.toml").read_text())
    assert card["counts"]["demonstrations"] == 2
    assert len(card["files"]) == 4


def test_an_existing_experiment_is_not_overwritten(bags: Path, clpv: Invoke) -> None:
    assert clpv(bags, "ingest", "carry", *sources(bags)).exit_code == 0
    before = (bags / "runs/carry/experiment.toml").read_text()
    result = clpv(bags, "ingest", "carry", *sources(bags)[:2])
    assert result.exit_code == 2
    assert "--replace" in result.stderr
    assert (bags / "runs/carry/experiment.toml").read_text() == before
    assert clpv(bags, "ingest", "carry").exit_code == 0  # without sources: up to date


def test_a_failed_replacement_leaves_the_old_one(bags: Path, clpv: Invoke) -> None:
    assert clpv(bags, "run", "carry").exit_code == 2
    assert clpv(bags, "ingest", "carry", *sources(bags)).exit_code == 0
    before = tree(bags), (bags / "runs/carry/experiment.toml").read_text()
    (bags / "bags" / "cut.bag").write_bytes((bags / "bags" / "demo0.bag").read_bytes()[:5000])
    arguments = ("--left", "/left/pose", "--right", "/right/pose", "--replace")
    result = clpv(bags, "ingest", "carry", "bags/cut.bag", *arguments)
    assert result.exit_code == 1
    assert "cut.bag" in result.stderr
    (bags / "bags" / "cut.bag").unlink()
    assert (tree(bags), (bags / "runs/carry/experiment.toml").read_text()) == before


@pytest.mark.parametrize(
    ("arguments", "code", "expected"),
    [
        (("bags/none.bag",), 2, "bags/none.bag"),
        (("bags/demo0.bag", "--left", "/left/pos", "--right", "/right/pose"), 1, "/left/pose"),
        (("bags/demo0.bag", "--left", "/left/pose:pose.posture", "--right", "/right/pose"), 1, "pose.posture"),
        (("bags/demo0.bag", "--left", "/left/pose"), 2, "ingest.right"),
        (("bags/demo0.bag", "--divide", "sometimes"), 2, "--divide"),
        (("bags/demo0.bag", "--test", "bags/demo1.bag"), 2, "--test"),
        (("bags/demo0.bag", "--urdf", "robot.urdf"), 2, "robot.urdf"),
        (("bags/demo0.bag", "--clock", "wall"), 2, "ingest.clock"),
        (("bags/demo0.bag", "--set", "mixture.alfa=1"), 2, "mixture.alfa"),
        (("bags/demo0.bag", "--seed", "1"), 2, "--seed"),
        (("bags/demo0.bag", "--divide", "times:nan"), 2, "--divide"),
        (("--left", "/left/pose"), 2, "sources"),
    ],
)
def test_bad_calls_leave_nothing(
    bags: Path, clpv: Invoke, arguments: tuple[str, ...], code: int, expected: str
) -> None:
    before = tree(bags)
    result = clpv(bags, "ingest", "carry", *arguments)
    assert result.exit_code == code, result.output
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1, result.stderr
    assert expected in lines[0]
    assert tree(bags) == before


def test_one_demonstration_is_too_few_to_learn_from(bags: Path, clpv: Invoke) -> None:
    assert clpv(bags, "ingest", "carry", "bags/demo0.bag").exit_code == 0
    result = clpv(bags, "fit", "carry")
    assert result.exit_code == 1
    assert "two" in result.stderr


def test_formats_give_the_same_policy(bags: Path, clpv: Invoke) -> None:
    """The same demonstrations out of a ROS 1 bag, an MCAP file and a CSV: equal metrics to rounding."""
    found: dict[str, Any] = {}
    for container, layout in (("ros1-lz4", "endpoint"), ("mcap", "nested"), ("csv", "")):
        paths = [
            writers.write(bags / container, container, layout, writers.two_arms(200, seed=seed), name=f"demo{seed}")
            for seed in range(3)
        ]
        given = [os.path.relpath(path, bags) for path in paths]
        result = clpv(bags, "ingest", container, *given)
        assert result.exit_code == 0, result.output
        rows = json.loads(clpv(bags, "eval", container, "--json").stdout)["rows"]
        found[container] = [row["dtw_mm"] for row in rows]
    assert found["mcap"] == pytest.approx(found["ros1-lz4"], rel=1e-6)
    assert found["csv"] == pytest.approx(found["ros1-lz4"], rel=1e-6)


def test_a_missing_field_with_its_kinds_name_is_named(bags: Path, clpv: Invoke) -> None:
    assert clpv(bags, "ingest", "carry", *sources(bags)).exit_code == 0
    result = clpv(bags, "status", "carry", "--set", "ingest.division={kind='times'}")
    assert result.exit_code == 2
    assert "ingest.division.times: must be given" in result.stderr


def test_parameters_are_set_in_the_file(bags: Path, clpv: Invoke) -> None:
    changes = ("--set", "ingest.longest_gap=2.0", "--set", "mixture.sweeps=30")
    assert clpv(bags, "ingest", "carry", *sources(bags), *changes).exit_code == 0
    table = tomllib.loads((bags / "runs/carry/experiment.toml").read_text())
    assert table["ingest"]["longest_gap"] == 2.0
    assert table["mixture"]["sweeps"] == 30
    assert clpv(bags, "status", "carry", "--json").exit_code == 0


def test_an_experiment_of_other_data_is_not_replaced(bags: Path, clpv: Invoke) -> None:
    assert clpv(bags, "new", "letters").exit_code == 0
    before = tree(bags)
    result = clpv(bags, "ingest", "letters", *sources(bags), "--replace")
    assert result.exit_code == 2
    assert "not made from recordings" in result.stderr
    assert tree(bags) == before


def test_a_source_that_has_gone_is_said_and_nothing_else_stops(bags: Path, clpv: Invoke) -> None:
    assert clpv(bags, "ingest", "carry", *sources(bags)).exit_code == 0
    (bags / "bags" / "demo1.bag").rename(bags / "gone.bag")
    rows = json.loads(clpv(bags, "status", "--json").stdout)["experiments"][0]["stages"]
    assert rows[0]["state"] == "stale"
    assert "demo1.bag" in rows[0]["reasons"][0]
    assert clpv(bags, "gc", "--dry-run").exit_code == 0
    assert clpv(bags, "show", "carry").exit_code == 0
    result = clpv(bags, "run", "carry")
    assert result.exit_code == 1
    assert "demo1.bag" in result.stderr


def test_clocks_of_two_arms_that_disagree_are_not_believed(bags: Path, clpv: Invoke) -> None:
    """The left arm's stamps are 0.8 s late; by the log both arms move at once, so L stays."""
    paths = []
    for seed in range(2):
        arms = writers.two_arms(200, seed=seed)
        late = dataclasses.replace(arms, stamp=arms.stamp + 800_000_000)
        right = writers.write(bags / "skew", "ros1", "pose", arms, name=f"right{seed}")
        left = writers.write(bags / "skew", "ros1", "pose", late, name=f"left{seed}")
        paths.append(f"{os.path.relpath(left, bags)}+{os.path.relpath(right, bags)}")
    result = clpv(bags, "ingest", "skew", *paths, "--left", "/left/pose", "--right", "/right/pose")
    assert result.exit_code == 0, result.output
    assert "clocks of the arms disagree by 0.800 s" in result.stderr
    assert clpv(bags, "fit", "skew").exit_code == 0
    figures = json.loads(clpv(bags, "show", "skew", "--json").stdout)["metrics"]["midpoint"]
    assert figures["separation_m"] == pytest.approx(0.4, abs=1e-3)
