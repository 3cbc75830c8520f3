"""Manifests: when they are written, what they hold, and what is said of one that cannot be read."""

from __future__ import annotations

import json
import os
import re

import pytest

from pipeline.errors import EXIT_USAGE, StoreError, UsageError
from pipeline.manifest import Manifest, compose, read_manifest, same_keys, write_manifest
from pipeline.project import keep_manifest, manifest_of


def kept(toy, name="try", record=False, **options):
    """Run, keep the manifest; returns the word for what was done."""
    outcomes = toy.run(name, **options)
    experiment = toy.open().experiment(name, options.get("sets", ()), options.get("seed"))
    return keep_manifest(experiment, outcomes, record=record)


def path_of(toy, name="try"):
    return toy.root / "runs" / name / "manifest.json"


def refusal(toy, name="try"):
    with pytest.raises(UsageError) as caught:
        read_manifest(toy.open().experiment(name))
    assert caught.value.exit_code == EXIT_USAGE
    return str(caught.value)


def test_written_once_and_then_unchanged(toy):
    assert kept(toy) == "written"
    before = path_of(toy).read_text()
    assert kept(toy) == "unchanged"
    assert kept(toy, record=True) == "unchanged"
    assert path_of(toy).read_text() == before


def test_written_again_when_a_key_changes(toy):
    kept(toy)
    toy.experiment("try", "[fit]\noffset = 1\n")
    assert kept(toy) == "written"
    assert kept(toy) == "unchanged"


def test_written_again_when_a_point_is_added(toy):
    kept(toy, "many")
    toy.experiment("many", "[sweep]\n'fit.offset' = [0.0, 1.0]\n")
    assert kept(toy, "many") == "written"
    manifest = read_manifest(toy.open().experiment("many"))
    assert list(manifest.points) == ["offset=0.0", "offset=1.0"]


def test_options_leave_it_alone(toy):
    assert kept(toy, sets=["fit.offset=1"]) == "overridden"
    assert not path_of(toy).exists()
    assert kept(toy) == "written"
    before = path_of(toy).read_text()
    assert kept(toy, seed=3) == "overridden"
    assert kept(toy, sets=["fit.offset=1"], record=True) == "overridden"
    assert path_of(toy).read_text() == before


def test_same_keys_and_other_bytes_keep_it_unless_recorded(toy):
    kept(toy)
    document = json.loads(path_of(toy).read_text())
    for entry in document["keys"].values():
        for output in entry["outputs"].values():
            output["digest"] = "0" * 64
    path_of(toy).write_text(json.dumps(document))
    before = path_of(toy).read_text()
    assert kept(toy) == "differs"
    assert path_of(toy).read_text() == before
    assert kept(toy, record=True) == "written"
    assert kept(toy) == "unchanged"


def test_another_layout_of_the_same_content_is_left_alone(toy):
    kept(toy)
    text = json.dumps(json.loads(path_of(toy).read_text()))
    path_of(toy).write_text(text)
    assert kept(toy) == "unchanged"
    assert path_of(toy).read_text() == text


def test_what_it_holds(toy):
    kept(toy, "many")
    document = json.loads(path_of(toy, "many").read_text())
    assert set(document) == {"version", "experiment", "points", "keys", "code"}
    assert (document["version"], document["experiment"]) == (1, "many")
    assert document["points"]["offset=1.0"]["overrides"] == {"fit.offset": 1.0}
    assert set(document["points"]["offset=1.0"]["keys"]) == {"read", "fit", "score"}
    shared = {point["keys"]["read"] for point in document["points"].values()}
    assert len(shared) == 1
    assert len(document["keys"]) == 1 + 3 + 3
    entry = document["keys"][document["points"]["offset=1.0"]["keys"]["fit"]]
    assert set(entry) == {
        "contract",
        "stage",
        "code",
        "parameters",
        "inputs",
        "sources",
        "libraries",
        "python",
        "seed",
        "outputs",
        "metrics",
    }
    assert entry["metrics"] == {"model": 4.0}
    assert set(document["code"][entry["code"]]) == {"toy.arithmetic", "toy.fit", "toy.mean"}


def test_it_names_no_path_time_processor_or_revision(toy):
    kept(toy, "many")
    text = path_of(toy, "many").read_text()
    assert str(toy.root) not in text
    assert os.sep not in json.dumps(json.loads(text)).replace("\\", "")
    assert not re.search(r"\b20\d\d-\d\d", text)
    for word in ("processor", "environment", "seconds", "revision", "platform"):
        assert word not in text


def test_its_text_is_the_same_for_the_same_run_anew(toy, tmp_path):
    kept(toy, "many")
    before = path_of(toy, "many").read_text()
    path_of(toy, "many").unlink()
    (toy.root / "runs" / ".store").rename(tmp_path / "away")
    assert kept(toy, "many") == "written"
    assert path_of(toy, "many").read_text() == before
    assert before.endswith("}\n")


def test_round_trip(toy):
    outcomes = toy.run("many")
    experiment = toy.open().experiment("many")
    manifest = manifest_of(outcomes)
    write_manifest(experiment, manifest)
    found = read_manifest(experiment)
    assert found.text("many") == manifest.text("many")
    assert found.key("offset=1.0", "fit") == manifest.key("offset=1.0", "fit") is not None
    assert found.entry("offset=1.0", "fit")["metrics"] == {"model": 4.0}
    assert found.entry("offset=9.0", "fit") is None
    assert found.entry("offset=1.0", "nothing") is None
    assert found.key("offset=9.0", "fit") is None


def test_figures_that_are_not_finite_are_null(toy):
    assert kept(toy, sets=()) == "written"
    toy.experiment("try", "[score]\nact = 'random'\n")
    assert kept(toy) == "written"
    manifest = read_manifest(toy.open().experiment("try"))
    assert manifest.entry("main", "score")["metrics"] == {"score": None}


def test_same_keys():
    rows = [("main", {}, "fit", {"key": "1", "components": {"code": "c"}, "outputs": {}, "metrics": {}})]
    rows[0][3]["definitions"] = {}
    one = compose(rows)
    assert same_keys(one, compose(rows))
    assert not same_keys(one, Manifest())


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "<<<<<<< HEAD\n{}",
        "[]",
        "null",
        "3",
        "{}",
        '{"version": 1}',
        '{"version": 1, "points": [], "keys": {}, "code": {}}',
        '{"version": 1, "points": {"main": {}}, "keys": {}, "code": {}}',
        '{"version": 1, "points": {"main": {"keys": {"fit": "1"}}}, "keys": {}, "code": {}}',
        '{"version": 1, "points": {"main": {"keys": {"fit": "1"}}}, "keys": {"1": {}}, "code": {}}',
        '{"version": 1, "points": {}, "keys": {}, "code": []}',
        '{"version": 1, "points": {}, "keys": {}, "code": {}, "x": "\udcff"}',
    ],
)
def test_one_that_cannot_be_read(toy, text):
    path_of(toy).write_text(text, errors="surrogateescape")
    assert refusal(toy) == (
        "runs/try/manifest.json cannot be read as a manifest: restore it, or delete it and run 'clpv run try'."
    )


def test_one_in_whose_place_is_a_folder(toy):
    path_of(toy).mkdir()
    assert refusal(toy).startswith("runs/try/manifest.json cannot be read as a manifest: ")


def test_one_of_another_version(toy):
    path_of(toy).write_text('{"version": 2}')
    assert refusal(toy) == (
        "runs/try/manifest.json is of version 2, this clpv reads version 1: delete it and run 'clpv run try'."
    )


def test_none(toy):
    assert read_manifest(toy.open().experiment("try")) is None


def test_one_that_cannot_be_written(toy, monkeypatch):
    outcomes = toy.run()
    monkeypatch.chdir(toy.root)
    experiment = toy.open().experiment("try")
    (toy.root / "runs" / "try" / "experiment.toml").unlink()
    (toy.root / "runs" / "try").rmdir()
    (toy.root / "runs" / "try").write_text("a file")
    with pytest.raises(StoreError, match=r"^runs/try/manifest\.json cannot be written: "):
        write_manifest(experiment, manifest_of(outcomes))
