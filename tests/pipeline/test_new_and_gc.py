"""The verbs that tidy: new makes an experiment from a template, gc removes what nothing refers to."""

from __future__ import annotations

import json
import tomllib

import pytest


def file_of(toy, name="mine"):
    return toy.root / "runs" / name / "experiment.toml"


def made(toy, *sets, name="mine", template="toy"):
    """The text of a new experiment."""
    options = [option for text in sets for option in ("--set", text)]
    result = toy.cli("new", name, "--template", template, *options)
    assert result.exit_code == 0, result.stderr
    assert result.stdout == f"runs/{name}/experiment.toml written: edit it, then 'clpv run {name}'.\n"
    return file_of(toy, name).read_text(encoding="utf-8")


def refused(toy, *arguments, template="toy"):
    """The sentence; nothing is left behind."""
    before = sorted((toy.root / "runs").rglob("*"))
    result = toy.cli("new", *arguments, "--template", template)
    assert result.exit_code == 2, result.stdout
    assert sorted((toy.root / "runs").rglob("*")) == before
    return result.stderr.removeprefix("error: ").rstrip("\n")


def test_new(toy):
    text = made(toy)
    assert text.startswith("# A toy experiment.\n")
    assert toy.open().experiment("mine").description == "from the template"
    assert toy.cli("run", "mine", "-q").exit_code == 0
    document = json.loads(toy.cli("new", "other", "--template", "toy", "--json").stdout)
    assert document == {"experiment": "other", "file": "runs/other/experiment.toml"}


def test_new_where_there_is_no_runs_folder(toy, tmp_path, monkeypatch):
    monkeypatch.delenv("CLPV_ROOT")
    folder = tmp_path / "fresh"
    folder.mkdir()
    monkeypatch.chdir(folder)
    assert toy.cli("new", "mine", "--template", "toy").exit_code == 0
    assert (folder / "runs" / "mine" / "experiment.toml").exists()


@pytest.mark.parametrize("name", ["a", "A-1", "x.y_z", "2026", "a" * 100])
def test_new_takes_names(toy, name):
    made(toy, name=name)


@pytest.mark.parametrize("name", ["", "a/b", "../a", ".", "..", ".store", "-a", "a b", "größe", "a\n", "a:b", "~"])
def test_new_refuses_names(toy, name):
    arguments = ("--", name) if name.startswith("-") else (name,)
    result = toy.cli("new", "--template", "toy", *arguments)
    assert result.exit_code == 2
    assert f"{name!r} is no name for an experiment: use letters, digits, dash, dot and underscore." in result.stderr
    assert sorted(path.name for path in (toy.root / "runs").iterdir()) == ["many", "try"]


def test_new_refuses_what_exists(toy):
    message = "runs/try exists already: choose another name, or edit runs/try/experiment.toml."
    assert refused(toy, "try") == message
    (toy.root / "runs" / "folder").mkdir()
    assert refused(toy, "folder").startswith("runs/folder exists already")
    (toy.root / "runs" / "dangling").symlink_to("nothing")
    assert refused(toy, "dangling").startswith("runs/dangling exists already")


def test_new_sets_parameters(toy):
    text = made(
        toy,
        "fit.offset=2.5",  # in place
        'description=mine, and "yours" \\ ä😀',  # in place, at the top
        "fit.noise=0.5",  # into a table
        "read.file=other.txt",  # into a new table
        "score.strict=false",
        "fit.weights=[1, 2.5]",
        "preset=paper",
        "seed=7",
    )
    assert tomllib.loads(text) == {
        "description": 'mine, and "yours" \\ ä😀',
        "preset": "paper",
        "seed": 7,
        "fit": {"kind": "mean", "offset": 2.5, "noise": 0.5, "weights": [1, 2.5]},
        "score": {"cases": [{"kind": "near"}, {"kind": "far", "distance": 2.0}], "strict": False},
        "read": {"file": "other.txt"},
    }
    assert text.startswith("# A toy experiment.\n")
    (point,) = toy.open().experiment("mine").points
    assert (point.seed, point.parameters["score"].mode, point.parameters["fit"].noise) == (7, "paper", 0.5)


def test_new_sets_a_sweep(toy):
    made(toy, "sweep.fit.offset=[1, 2]")
    assert [p.id for p in toy.open().experiment("mine").points] == ["offset=1", "offset=2"]


def test_new_from_an_empty_template(toy):
    assert made(toy, "fit.offset=2", "preset=paper", template="empty") == 'preset = "paper"\n\n[fit]\noffset = 2\n'


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("fit.ofset=1", "fit.ofset: unknown parameter; did you mean 'offset'? "),
        ("fti.offset=1", "fti: unknown table or key; did you mean 'fit'? "),
        ("fit.offset=x", 'fit.offset: should be a valid number, not "x".'),
        ("seed=-1", "seed: must be a whole number from 0, not -1."),
        ("fit=3", "--set fit: a new file takes plain values in plain tables only; edit the file for the rest."),
        (
            "fit.offset=nan",
            "--set fit.offset: a new file takes plain values in plain tables only; edit the file for the rest.",
        ),
        (
            "fit.offset=inf",
            "--set fit.offset: a new file takes plain values in plain tables only; edit the file for the rest.",
        ),
        (
            "score.cases=[]",
            "--set score.cases: a new file takes plain values in plain tables only; edit the file for the rest.",
        ),
        ("score.cases.0.radius=2", "--set score.cases.0.radius: a new file takes plain values in plain tables only; "),
        ("score.cases=[{kind = 'near'}]", "--set score.cases: a new file takes plain values in plain tables only; "),
        ("fit={kind = 'median'}", "--set fit: a new file takes plain values in plain tables only; "),
        ("fit.a b=3", "--set fit.a b: a new file takes plain values in plain tables only; "),
        ("score.label=2020-01-01", ""),
        ("nonsense", "--set nonsense: write it as name=value, "),
    ],
)
def test_new_refuses_parameters(toy, given, message):
    if not message:
        assert 'label = "2020-01-01"\n' in made(toy, given)
        return
    assert refused(toy, "mine", "--set", given).startswith(message)


def test_new_refuses_templates(toy):
    message = "There is no template 'emtpy'; did you mean 'empty'? Valid: empty, toy."
    assert refused(toy, "mine", template="emtpy") == message


def test_new_in_a_folder_that_cannot_be_written(toy, tmp_path, monkeypatch):
    monkeypatch.setenv("CLPV_ROOT", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").write_text("")
    result = toy.cli("new", "mine", "--template", "toy")
    assert result.exit_code == 1
    assert result.stderr.startswith("error: runs/mine/experiment.toml cannot be written: ")


def stored(toy):
    store = toy.root / "runs" / ".store"
    return len(list(store.glob("actions/*"))), len(list(store.glob("objects/*/*")))


def collected(toy, *options):
    result = toy.cli("gc", *options, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def test_gc_keeps_what_experiments_refer_to(toy):
    toy.cli("run", "try")
    toy.cli("run", "many", "--jobs", "1")
    before = stored(toy)
    assert collected(toy) == {"actions": 0, "objects": 0, "bytes": 0, "removed": True}
    assert stored(toy) == before


def test_gc_removes_the_rest(toy):
    toy.cli("run", "try")
    before = stored(toy)
    toy.cli("run", "try", "--set", "fit.offset=5", "--set", "read.scale=2")
    assert stored(toy) == (before[0] + 3, before[1] + 3)
    found = collected(toy, "--dry-run")
    assert (found["actions"], found["objects"], found["removed"]) == (3, 3, False)
    assert stored(toy) == (before[0] + 3, before[1] + 3)
    assert toy.cli("gc", "--dry-run").stdout == "3 results and 3 objects, 0.0 MB, would be removed.\n"
    assert toy.cli("gc").stdout == "3 results and 3 objects, 0.0 MB, removed.\n"
    assert stored(toy) == before
    assert toy.computed(toy.run()) == []


def test_gc_keeps_objects_that_a_kept_record_shares(toy):
    toy.cli("run", "try")
    toy.cli("run", "try", "--seed", "3")  # other keys, the same bytes
    objects = stored(toy)[1]
    found = collected(toy)
    assert (found["actions"], found["objects"]) == (1, 0)
    assert stored(toy)[1] == objects
    assert toy.computed(toy.run()) == []


def test_gc_keeps_what_a_manifest_refers_to_though_the_code_has_changed(toy):
    toy.cli("run", "try")
    toy.edit("arithmetic", "FACTOR = 1.0", "FACTOR = 2.0")
    assert collected(toy)["actions"] == 0
    toy.cli("run", "try")
    assert collected(toy)["actions"] == 2  # the manifest and the code have moved on


def test_gc_after_an_experiment_is_gone(toy):
    toy.cli("run", "try")
    for name in ("try", "many"):
        file_of(toy, name).unlink()
    collected(toy)
    assert stored(toy) == (0, 0)


def test_gc_without_a_store(toy):
    assert collected(toy) == {"actions": 0, "objects": 0, "bytes": 0, "removed": True}
    assert not (toy.root / "runs" / ".store").exists()


def test_gc_removes_nothing_where_an_experiment_cannot_be_read(toy):
    toy.cli("run", "try", "--set", "fit.offset=5")
    before = stored(toy)
    toy.experiment("many", "[fit")
    assert toy.cli("gc").exit_code == 2
    assert stored(toy) == before


def test_gc_and_a_record_that_cannot_be_read(toy):
    toy.cli("run", "try")
    for path in (toy.root / "runs" / ".store" / "actions").iterdir():
        path.write_text("{")
    assert toy.cli("gc").exit_code == 0
    assert toy.computed(toy.run()) == ["main/read", "main/fit", "main/score"]
