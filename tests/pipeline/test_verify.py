"""Verification: a recomputation against the manifest, by bytes first and by figures second."""

from __future__ import annotations

import json

import pytest

from pipeline.errors import UsageError
from pipeline.project import keep_manifest
from pipeline.verify import disagreements, verify


def recorded(toy, name="try"):
    keep_manifest(toy.open().experiment(name), toy.run(name), record=False)


def verified(toy, name="try", **options):
    project = toy.open()
    events = []
    return verify(project, project.experiment(name), jobs=1, listener=events.append, **options)


def edit(toy, change, name="try"):
    """Change the manifest's document."""
    path = toy.root / "runs" / name / "manifest.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def of_stage(document, stage):
    (entry,) = [entry for entry in document["keys"].values() if entry["stage"] == stage]
    return entry


def other_bytes(document, *stages):
    for entry in document["keys"].values():
        if not stages or entry["stage"] in stages:
            for output in entry["outputs"].values():
                output["digest"] = "0" * 64


def test_bitwise(toy):
    recorded(toy, "many")
    found = verified(toy, "many")
    assert found.passed
    assert (found.stages, found.bitwise, found.within, found.mismatches, found.stale) == (9, 9, 0, (), ())


def test_it_trusts_nothing_of_the_store_and_leaves_it_as_it_is(toy):
    recorded(toy)
    for path in toy.objects:
        path.chmod(0o644)
        path.write_text("damaged")
    before = [path.read_bytes() for path in sorted((toy.root / "runs").rglob("*")) if path.is_file()]
    assert verified(toy).bitwise == 3
    assert [path.read_bytes() for path in sorted((toy.root / "runs").rglob("*")) if path.is_file()] == before
    assert list((toy.root / "runs" / ".store" / "tmp").iterdir()) == []


def test_other_bytes_within_the_tolerance(toy):
    recorded(toy)

    def change(document):
        other_bytes(document)
        of_stage(document, "fit")["metrics"]["model"] *= 1 + 5e-7
        of_stage(document, "score")["metrics"]["score"] *= 1 - 5e-7

    edit(toy, change)
    found = verified(toy)
    assert found.passed
    assert (found.bitwise, found.within) == (0, 3)


def test_a_changed_figure(toy):
    recorded(toy)

    def change(document):
        other_bytes(document, "score")
        of_stage(document, "score")["metrics"]["score"] *= 1 + 2e-6

    edit(toy, change)
    found = verified(toy)
    assert not found.passed
    assert (found.bitwise, found.within) == (2, 0)
    assert found.mismatches == ("main, score: score is 30.0, the manifest says 30.00006",)


def test_other_bytes_and_no_figures(toy):
    recorded(toy)

    def change(document):
        other_bytes(document, "read")
        of_stage(document, "read")["metrics"] = {}

    edit(toy, change)
    assert verified(toy).mismatches == ("main, read: its bytes differ, and the manifest holds no figures to compare",)


def test_what_has_changed_since_is_said_and_is_no_mismatch_where_the_bytes_agree(toy):
    recorded(toy)
    toy.edit("arithmetic", "return None", "return 1")
    found = verified(toy)
    assert found.passed
    assert found.stale == ("code: toy.arithmetic.unused changed",)


def test_a_changed_function(toy):
    recorded(toy)
    toy.edit("arithmetic", "FACTOR = 1.0", "FACTOR = 2.0")
    found = verified(toy)
    assert not found.passed
    assert found.stale == ("code: toy.arithmetic.FACTOR changed",)
    assert found.mismatches == (
        "main, fit: model is 6.0, the manifest says 3.0",
        "main, score: score is 60.0, the manifest says 30.0",
    )


def test_a_changed_experiment(toy):
    recorded(toy, "many")
    toy.experiment("many", "[sweep]\n'fit.offset' = [0.0, 1.0, 3.0]\n")
    found = verified(toy, "many")
    assert found.mismatches == (
        "offset=2.0: it is in the manifest and no longer in the experiment",
        "offset=3.0, read: it is not in the manifest",
        "offset=3.0, fit: it is not in the manifest",
        "offset=3.0, score: it is not in the manifest",
    )


def test_no_manifest(toy):
    with pytest.raises(
        UsageError, match=r"^runs/try has no manifest to verify against: make it with 'clpv run try'\.$"
    ):
        verified(toy)


def test_a_stage_that_is_not_reproducible(toy, monkeypatch):
    monkeypatch.setenv("TOY_ACT", "random")
    recorded(toy)
    found = verified(toy)
    assert (found.bitwise, found.within, found.mismatches) == (2, 1, ())  # its figure is null both times


@pytest.mark.parametrize(
    ("recorded", "found", "sentences"),
    [
        ({"a": 1.0}, {"a": 1.0}, []),
        ({"a": 1}, {"a": 1.0}, []),
        ({"a": 1.0}, {"a": 1.0 + 9e-7}, []),
        ({"a": 1.0}, {"a": 1.0 + 2e-6}, ["a is 1.000002, the manifest says 1.0"]),
        ({"a": -1.0}, {"a": 1.0}, ["a is 1.0, the manifest says -1.0"]),
        ({"a": None}, {"a": None}, []),
        ({"a": None}, {"a": 1.0}, ["a is 1.0, the manifest says None"]),
        ({"a": 0.0}, {"a": 1e-15}, []),
        ({"a": 1e-18}, {"a": -3e-17}, []),
        ({"a": 0.0}, {"a": 1e-9}, ["a is 1e-09, the manifest says 0.0"]),
        ({"a": 1.0}, {}, ["a is None, the manifest says 1.0"]),
        ({"a": 1.0}, {"a": 1.0, "b": 2.0}, ["b is 2.0, the manifest says None"]),
        ({"a": 32}, {"a": 31}, ["a is 31, the manifest says 32"]),
        ({}, {}, ["its bytes differ, and the manifest holds no figures to compare"]),
    ],
)
def test_disagreements(recorded, found, sentences):
    assert disagreements(recorded, found) == sentences
