"""What is up to date, what is stale, and why."""

from __future__ import annotations

import pytest

from pipeline.errors import DataError, StaleError
from pipeline.plan import State
from pipeline.project import keep_manifest


def states(toy, name="try", sets=(), force=(), last="score", **options):
    """State and reasons of every stage at every point."""
    project = toy.open()
    rows = project.plan(project.experiment(name, sets, **options), last, force)
    return [(row.point.id, row.stage.name, row.state, "; ".join(row.reasons)) for row in rows]


def record(toy, name="try"):
    keep_manifest(toy.open().experiment(name), toy.run(name), record=False)


CACHED = [("main", "read", State.CACHED, ""), ("main", "fit", State.CACHED, ""), ("main", "score", State.CACHED, "")]


def waiting(stage, what):
    return ("main", stage, State.WAITING, f"waits for {what}")


def test_nothing_computed(toy):
    assert states(toy) == [
        ("main", "read", State.NEW, ""),
        waiting("fit", "numbers"),
        waiting("score", "numbers, model"),
    ]


def test_everything_computed(toy):
    record(toy)
    assert states(toy) == CACHED
    assert states(toy, last="fit") == CACHED[:2]


def test_planning_writes_nothing(toy):
    states(toy)
    assert not (toy.root / "runs" / ".store").exists()


def test_a_changed_parameter(toy):
    record(toy)
    assert states(toy, sets=["fit.offset=1"]) == [
        CACHED[0],
        ("main", "fit", State.STALE, "parameter fit.offset: 0.0 -> 1.0"),
        waiting("score", "model"),
    ]


def test_a_changed_seed(toy):
    record(toy)
    assert states(toy, seed=1)[1] == ("main", "fit", State.STALE, "seed: 0 -> 1")


def test_a_changed_function(toy):
    record(toy)
    toy.edit("arithmetic", "result += value", "result -= value")
    assert states(toy)[1] == ("main", "fit", State.STALE, "code: toy.arithmetic.total changed")


def test_a_changed_library(toy, monkeypatch):
    from pipeline import key

    record(toy)
    version = key.version("numpy")
    monkeypatch.setattr(key, "version", lambda name: "99.0")
    assert states(toy)[1] == ("main", "fit", State.STALE, f"library numpy: {version} -> 99.0")


def test_a_changed_source(toy):
    record(toy)
    (toy.root / "numbers.txt").write_text("1\n2\n7\n")
    assert states(toy)[0] == ("main", "read", State.STALE, "source numbers.txt changed")


def test_changed_and_computed_already_is_cached_and_says_what_differs_from_the_manifest(toy):
    record(toy)
    toy.run(sets=["fit.offset=1"])
    assert states(toy, sets=["fit.offset=1"]) == [
        CACHED[0],
        ("main", "fit", State.CACHED, "parameter fit.offset: 0.0 -> 1.0"),
        ("main", "score", State.CACHED, "input model changed"),
    ]


def test_a_comment_changes_nothing(toy):
    record(toy)
    toy.edit("arithmetic", "# one by one", "# each")
    assert states(toy) == CACHED


def test_another_kind_of_change_changes_nothing_here(toy):
    record(toy)
    toy.edit("ordering", "// 2", "// 3")
    assert states(toy) == CACHED


def test_an_empty_store_and_a_manifest(toy, tmp_path):
    record(toy)
    (toy.root / "runs" / ".store").rename(tmp_path / "away")
    assert states(toy)[0] == ("main", "read", State.NEW, "")


@pytest.mark.parametrize("damage", ["flip", "remove"])
def test_a_damaged_object(toy, damage):
    outcomes = toy.run()
    path = toy.open().store.path(outcomes[1].record["outputs"]["model"]["digest"])
    path.chmod(0o644)
    if damage == "flip":
        path.write_text("4.0")
    else:
        path.unlink()
    assert states(toy)[1:] == [
        ("main", "fit", State.DAMAGED, "an object in the store is missing or damaged"),
        waiting("score", "model"),
    ]


def test_forced(toy):
    record(toy)
    assert states(toy, force=["fit"]) == [CACHED[0], ("main", "fit", State.STALE, "forced"), waiting("score", "model")]


def test_points_of_a_sweep(toy):
    toy.run("many", sets=["fit.offset=1.0"])
    assert [row[:3] for row in states(toy, "many")] == [
        ("offset=0.0", "read", State.CACHED),
        ("offset=0.0", "fit", State.NEW),
        ("offset=0.0", "score", State.WAITING),
        ("offset=1.0", "read", State.CACHED),
        ("offset=1.0", "fit", State.CACHED),
        ("offset=1.0", "score", State.CACHED),
        ("offset=2.0", "read", State.CACHED),
        ("offset=2.0", "fit", State.NEW),
        ("offset=2.0", "score", State.WAITING),
    ]


def test_a_point_that_the_manifest_does_not_know_is_new(toy):
    record(toy, "many")
    toy.experiment("many", "[sweep]\n'fit.offset' = [5.0]\n")
    assert states(toy, "many")[1] == ("offset=5.0", "fit", State.NEW, "")


def test_a_source_that_is_not_there(toy):
    """Reading verbs go on, and say so; a run is refused."""
    first, *later = states(toy, sets=["read.file=absent.txt"])
    assert first == ("main", "read", State.STALE, "absent.txt: cannot be read: No such file or directory.")
    assert {row[2] for row in later} == {State.WAITING}
    with pytest.raises(DataError, match=r"^absent\.txt: cannot be read: No such file or directory\.$"):
        toy.run(sets=["read.file=absent.txt"])


def test_a_source_is_digested_once(toy, monkeypatch):
    from pipeline import plan

    seen = []
    digest = plan.file_digest
    monkeypatch.setattr(plan, "file_digest", lambda path: seen.append(path) or digest(path))
    states(toy, "many")
    assert seen == [toy.root / "numbers.txt"]


def test_artifacts_of_what_has_been_run(toy):
    project = toy.open()
    experiment = project.experiment("many")
    message = (
        r"^many is not up to date \(stage read at offset=0\.0 is new\): run 'clpv run many' first\.$"  # first in order
    )
    with pytest.raises(StaleError, match=message):
        project.artifacts(experiment, "fit")
    toy.run("many", last="fit")
    found = project.artifacts(experiment, "fit")
    assert [(point.id, files["model"].read_text()) for point, files in found] == [
        ("offset=0.0", "3.0"),
        ("offset=1.0", "4.0"),
        ("offset=2.0", "5.0"),
    ]
