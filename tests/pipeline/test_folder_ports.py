"""Stages that write a folder, and ports and presets of one kind only: in the store as whole and as checked as files."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from pipeline.errors import ExecutionError, ParameterError
from pipeline.project import Project
from pipeline.runner import Outcome
from pipeline.stage import Port, Stage, parameters
from pipeline.store import Artifact, Store, digest, file_digest, size

SHELF = '''
    """Writes the model on pages, or on none."""

    from typing import Literal

    from pipeline.stage import Count, Port, Stage, parameters


    @parameters
    class Bound:
        kind: Literal["bound"] = "bound"
        pages: Count = 2
        word: str = "model"
        act: str = ""


    @parameters
    class Loose:
        kind: Literal["loose"] = "loose"
        word: str = "none"


    def run(context):
        chosen = context.parameters
        context.outputs["index"].write_text(chosen.word)
        if chosen.kind == "loose":
            assert set(context.outputs) == {"index"}
            return
        model, folder = context.inputs["model"].read_text(), context.outputs["pages"]
        if chosen.act == "forget":
            return
        if chosen.act == "file":
            folder.write_text(model)
            return
        if chosen.act == "link":
            folder.symlink_to(context.inputs["model"].parent)
            return
        folder.mkdir()
        for page in range(chosen.pages):
            (folder / f"{page}.txt").write_text(f"{chosen.word} {page}: {model}")


    STAGE = Stage(
        name="shelf",
        summary="writes pages",
        parameters=Bound | Loose,
        inputs=("model",),
        outputs=(
            Port(name="index", filename="index.txt"),
            Port(name="pages", filename="pages", folder=True, kinds=("bound",)),
        ),
        run=run,
        presets={"paper": {"word": "printed"}, "robust": {"word": "bound"}},
        kind_presets={"loose": {"paper": {"word": "loose, printed"}}},
        rows=lambda outputs: [{"page": path.name} for path in sorted(outputs["pages"].iterdir())]
        if "pages" in outputs
        else [],
    )
'''


@pytest.fixture
def shelf(toy: Any) -> Any:
    """The toy project; its module ``shelf`` writes folders."""
    toy.module("shelf", SHELF)
    return toy


def opened(toy: Any) -> Project:
    """Anew, with the stage that writes folders after the fit."""
    references = [reference for reference in toy.open().stages if "score" not in reference]
    return Project.open(toy.root, [*references, "toy.shelf:STAGE"])


def ran(toy: Any, *sets: str, force: Sequence[str] = ()) -> Outcome:
    """Run up to the folders; what became of that stage. Keeps the events."""
    toy.events = []
    project = opened(toy)
    experiment = project.experiment("try", sets)
    return project.bring_up(experiment, "shelf", jobs=1, force=force, listener=toy.events.append)[-1]


def folder_of(toy: Any, outcome: Outcome) -> Path:
    store = opened(toy).store
    return store.path(store.outputs(outcome.record)["pages"].digest)


def cli(toy: Any, *arguments: str) -> Result:
    """The toy's command line, with the stage that writes folders."""
    toy.edit("cli", '"toy.score:STAGE")', '"toy.shelf:STAGE")')
    try:
        return toy.cli(*arguments)  # type: ignore[no-any-return]
    finally:
        toy.edit("cli", '"toy.shelf:STAGE")', '"toy.score:STAGE")')


# --- the store ------------------------------------------------------------------------------------------------------


def make(path: Path, files: dict[str, bytes]) -> Path:
    path.mkdir(parents=True)
    for name, content in files.items():
        (path / name).write_bytes(content)
    return path


FILES = {"b.txt": b"two", "a.txt": b"one", "empty": b""}


def test_the_digest_of_a_folder_by_hand(tmp_path: Path) -> None:
    """As ``sha256sum * | sha256sum`` gives it."""
    folder = make(tmp_path / "folder", FILES)
    listing = "".join(f"{hashlib.sha256(FILES[name]).hexdigest()}  {name}\n" for name in ("a.txt", "b.txt", "empty"))
    assert digest(folder) == hashlib.sha256(listing.encode()).hexdigest()
    assert size(folder) == 6
    assert digest(folder / "a.txt") == file_digest(folder / "a.txt")


@pytest.mark.parametrize(
    "files",
    [
        {"b.txt": b"two", "a.txt": b"One", "empty": b""},  # another content
        {"b.txt": b"two", "c.txt": b"one", "empty": b""},  # another name
        {"b.txt": b"one", "a.txt": b"two", "empty": b""},  # exchanged
        {"b.txt": b"two", "a.txt": b"one"},  # one less
        {},
    ],
)
def test_names_and_contents_make_the_digest(tmp_path: Path, files: dict[str, bytes]) -> None:
    assert digest(make(tmp_path / "one", FILES)) != digest(make(tmp_path / "other", files))


def test_neither_the_order_of_writing_nor_the_folders_name_nor_its_times_make_the_digest(tmp_path: Path) -> None:
    one = make(tmp_path / "one", FILES)
    other = make(tmp_path / "other", dict(reversed(FILES.items())))
    os.utime(other / "a.txt", (0, 0))
    assert digest(one) == digest(other)


def add(store: Store, files: dict[str, bytes]) -> Artifact:
    with store.scratch() as scratch:
        return store.add(make(scratch / "folder", files))


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(folder=tmp_path / "runs" / ".store")
    made.prepare()
    return made


def test_a_folder_is_one_object_that_cannot_be_written(store: Store) -> None:
    artifact = add(store, FILES)
    path = store.path(artifact.digest)
    assert (artifact.digest, artifact.size) == (digest(path), 6)
    assert {file.name: file.read_bytes() for file in path.iterdir()} == FILES
    assert all(file.stat().st_mode & 0o222 == 0 for file in path.iterdir())
    assert store.holds(artifact)
    assert add(store, FILES) == artifact  # a folder cannot be renamed onto one that is there
    assert len(list(store.folder.glob("objects/*/*"))) == 1
    assert list((store.folder / "tmp").iterdir()) == []


def lose(path: Path) -> None:
    (path / "a.txt").unlink()


def flip(path: Path) -> None:
    (path / "a.txt").chmod(0o644)
    (path / "a.txt").write_bytes(b"onE")


def cut(path: Path) -> None:
    (path / "a.txt").chmod(0o644)
    (path / "a.txt").write_bytes(b"on")


def more(path: Path) -> None:
    (path / "more").write_bytes(b"")


def nest(path: Path) -> None:
    (path / "deep").mkdir()


@pytest.mark.parametrize("damage", [lose, flip, cut, more, nest])
def test_a_damaged_folder_is_not_held_and_is_mended_by_adding_it_again(
    store: Store, damage: Callable[[Path], None]
) -> None:
    artifact = add(store, FILES)
    damage(store.path(artifact.digest))
    assert not store.holds(artifact)
    assert add(store, FILES) == artifact
    assert store.holds(artifact)


def test_a_file_is_not_the_folder_of_its_digest(store: Store) -> None:
    artifact = add(store, FILES)
    path = store.path(artifact.digest)
    for file in path.iterdir():
        file.unlink()
    path.rmdir()
    path.write_bytes(b"123456")
    assert not store.holds(artifact)


# --- stages ---------------------------------------------------------------------------------------------------------


def test_what_a_stage_writes_into_a_folder_is_kept(shelf: Any) -> None:
    outcome = ran(shelf)
    assert not outcome.cached
    folder = folder_of(shelf, outcome)
    assert {file.name: file.read_text() for file in folder.iterdir()} == {
        "0.txt": "bound 0: 3.0",
        "1.txt": "bound 1: 3.0",
    }
    entry = outcome.record["outputs"]["pages"]
    assert entry == {"digest": digest(folder), "size": 24}
    again = ran(shelf)
    assert again.cached
    assert again.record["outputs"] == outcome.record["outputs"]


def test_the_same_folder_twice_is_one_object(shelf: Any) -> None:
    first = ran(shelf)
    objects = len(shelf.objects)
    second = ran(shelf, force=["shelf"])
    assert not second.cached
    assert second.record["outputs"] == first.record["outputs"]
    assert len(shelf.objects) == objects
    third = ran(shelf, "shelf.pages=3")
    assert third.record["outputs"]["pages"] != first.record["outputs"]["pages"]
    assert len(shelf.objects) == objects + 1  # the index is the same file


@pytest.mark.parametrize("damage", ["flip", "lose", "more"])
def test_a_damaged_folder_is_noticed_and_computed_again(shelf: Any, damage: str) -> None:
    first = ran(shelf)
    folder = folder_of(shelf, first)
    page = folder / "0.txt"
    if damage == "flip":
        page.chmod(0o644)
        page.write_text("Bound 0: 3.0")
    elif damage == "lose":
        page.unlink()
    else:
        (folder / "2.txt").write_text("")
    second = ran(shelf)
    assert not second.cached
    assert second.record["outputs"] == first.record["outputs"]
    assert any("computing it again" in event.message for event in shelf.events if event.kind == "warning")
    assert digest(folder) == folder.name
    assert ran(shelf).cached


def test_what_another_kind_writes_is_not_asked_for(shelf: Any) -> None:
    outcome = ran(shelf, "shelf.kind=loose")
    assert set(outcome.record["outputs"]) == {"index"}
    assert ran(shelf, "shelf.kind=loose").cached
    bound = ran(shelf)
    assert set(bound.record["outputs"]) == {"index", "pages"}


@pytest.mark.parametrize("act", ["forget", "file", "link"])
def test_a_folder_that_is_not_there_is_refused(shelf: Any, act: str) -> None:
    with pytest.raises(ExecutionError, match=r"stage shelf at main did not write its output pages\.") as caught:
        ran(shelf, f"shelf.act={act}")
    assert (caught.value.stage, caught.value.point) == ("shelf", "main")
    assert len(shelf.objects) == 2  # of the stages before: nothing half-written


def test_garbage_collection_removes_folders(shelf: Any) -> None:
    assert cli(shelf, "run", "try").exit_code == 0
    records = shelf.root / "runs" / ".store" / "actions"
    kept, known = {path.name for path in shelf.objects}, set(records.iterdir())
    assert cli(shelf, "run", "try", "--set", "shelf.pages=5").exit_code == 0
    extra = [path for path in shelf.objects if path.name not in kept]
    assert [path.is_dir() for path in extra] == [True]
    (record,) = set(records.iterdir()) - known
    freed = record.stat().st_size + 5 * len("bound 0: 3.0")
    found = json.loads(cli(shelf, "gc", "--json").stdout)
    assert (found["actions"], found["objects"], found["bytes"]) == (1, 1, freed)
    assert {path.name for path in shelf.objects} == kept
    assert ran(shelf).cached


def test_a_folder_is_verified_and_shown(shelf: Any) -> None:
    assert cli(shelf, "run", "try").exit_code == 0
    result = cli(shelf, "verify", "try", "--json")
    assert result.exit_code == 0, result.output
    shown = json.loads(cli(shelf, "show", "try", "--stage", "shelf", "--json").stdout)
    assert [row["page"] for row in shown["rows"]] == ["0.txt", "1.txt"]
    edited = shelf.source / "toy" / "shelf.py"
    edited.write_text(edited.read_text().replace('f"{page}.txt"', 'f"page{page}.txt"'))
    assert cli(shelf, "verify", "try").exit_code == 4  # other names, the same contents


# --- presets of kinds -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sets", "word"),
    [
        (["preset=paper"], "printed"),
        (["preset=robust"], "bound"),
        (["preset=paper", "shelf.kind=bound"], "printed"),
        (["preset=paper", "shelf.kind=loose"], "loose, printed"),
        (["preset=robust", "shelf.kind=loose"], "none"),  # of which nothing is said: the declared default
        (["preset=paper", "shelf.kind=loose", "shelf.word=mine"], "mine"),
    ],
)
def test_a_kind_has_presets_of_its_own(shelf: Any, sets: Sequence[str], word: str) -> None:
    (point,) = opened(shelf).experiment("try", sets).points
    assert point.parameters["shelf"].word == word


def test_a_kind_that_is_misspelt_is_refused_at_its_place(shelf: Any) -> None:
    with pytest.raises(ParameterError, match="there is no kind 'losse'; did you mean 'loose'") as caught:
        opened(shelf).experiment("try", ["shelf.kind=losse"])
    assert caught.value.location == "shelf.kind"


@parameters
class Plain:
    """No kinds."""

    replicate: int = 0


def test_ports_by_kind() -> None:
    always, one = Port(name="a", filename="a"), Port(name="b", filename="b", folder=True, kinds=("bound", "sewn"))
    stage = Stage(name="s", summary="", parameters=Plain, inputs=(), outputs=(always, one), run=lambda context: None)

    class Bound:
        kind = "bound"

    class Loose:
        kind = "loose"

    assert stage.ports(Bound()) == (always, one)
    assert stage.ports(Loose()) == (always,)
    assert stage.ports(Plain()) == (always,)
    assert stage.preset("paper", {}) == {}
