"""What `clpv ingest NAME SOURCE…` and `clpv info` do: an experiment and a card out of recordings, or nothing."""

from __future__ import annotations

import shlex
import shutil
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline import advance
from pipeline.console import Console
from pipeline.editing import edited
from pipeline.errors import StoreError, UsageError
from pipeline.experiment import FILE, NAME, parse_override, resolve
from pipeline.project import Project
from pipeline.store import write_atomically
from stages.ingest.card import card_path, card_text, read_card
from stages.ingest.create import NewSource, Selections, division, experiment_text, new_sources, relative


def ingest_recordings(
    project: Project,
    console: Console,
    name: str,
    sources: Sequence[str],
    selections: Selections,
    *,
    test: Sequence[str],
    divide: str | None,
    sets: Sequence[str] = (),
    anew: bool,
) -> None:
    """Make the experiment `name` from recordings, read them, and write their card.

    Where reading fails, what was there before is there again. Raises UsageError for a name that is taken (without
    `anew`) or is none, and what reading the recordings raises.
    """
    if not NAME.fullmatch(name):
        raise UsageError(f"{name!r} is no name for an experiment: use letters, digits, dash, dot and underscore.")
    folder = project.root / "runs" / name
    if folder.exists() and not anew:
        raise UsageError(f"runs/{name} exists already: choose another name, or add --replace to make it anew.")
    if not folder.exists() and card_path(project.root, name).exists():
        raise UsageError(f"datasets/{name} is the card of other data: choose another name.")
    if folder.exists() and not _made_here(folder / FILE):
        raise UsageError(f"runs/{name} was not made from recordings: --replace would lose it; choose another name.")
    found = new_sources(project.root, sources, test)
    if not (selections.left or selections.right or selections.point):
        found_by_name = _suggested(found[0], project.root, recover=bool(selections.recover))
        selections = replace(selections, **found_by_name)
        chosen = " ".join(f"--{key.replace('_', '-')} {value}" for key, value in found_by_name.items())
        console.note(f"selected by name and type: {chosen}")
    if selections.urdf is not None:
        selections = replace(selections, urdf=relative(project.root, selections.urdf))
    text = experiment_text(name, found, selections, division(divide))
    for location, value in map(parse_override, sets):
        text = edited(text, location, value)
    resolve(name, folder, tomllib.loads(text), list(project.stages.values()))

    path = folder / FILE
    before = path.read_text(encoding="utf-8") if path.exists() else None
    existed = anew and folder.exists()
    if not existed:
        _claim(folder)
    try:
        write_atomically(path, text)
        experiment = project.experiment(name)
        ingest = project.stage("ingest")
        advance.bring_up(project, console, experiment, ingest, jobs=1, force=(), record=False)
        files = {f: d for source in found for f, d in zip(source.files, source.sha256, strict=True)}
        demonstrations = _write_card(project, name, selections, files)
    except BaseException:
        if before is not None:
            write_atomically(path, before)
        elif existed:
            path.unlink(missing_ok=True)
        else:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    if anew:
        (folder / "manifest.json").unlink(missing_ok=True)
    train = sum(split == "train" for _, split, _ in demonstrations)
    console.note(f"{len(demonstrations)} demonstrations, {train} to learn from, {_counted(project, name)}.")
    written = f"runs/{name}/{FILE} and datasets/{name}/dataset.toml written"
    console.note(f"{written}; next: 'clpv run {name}'." if train >= 2 else f"{written}.")
    if train < 2:
        console.warn(
            f"{name} has {train} demonstration(s) to learn from, and a policy needs two: name more recordings, or make "
            "several of one with --divide; then ingest again with --replace."
        )


def _made_here(path: Path) -> bool:
    """Whether an experiment file is one of recordings; one that cannot be read is not."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8")).get("ingest", {})
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return False
    return isinstance(table, dict) and table.get("kind") == "recording"


def _counted(project: Project, name: str) -> str:
    """What reading and cleaning counted, in words."""
    from stages.artifacts.parquet import header

    ((_, outputs),) = project.artifacts(project.experiment(name), "ingest")
    counts = header(outputs["demonstrations"])["counts"]
    return ", ".join(f"{number} {key.replace('_', ' ')}" for key, number in counts.items() if key != "demonstrations")


def _claim(folder: Path) -> None:
    """Make the experiment's folder, for this call alone. Raises UsageError where another call has just made it."""
    try:
        folder.parent.mkdir(exist_ok=True)
        folder.mkdir()
    except FileExistsError:
        raise UsageError(f"runs/{folder.name} exists already: another call has just made it.") from None
    except OSError as error:
        raise StoreError(f"runs/{folder.name} cannot be made: {error.strerror}.") from None


def _suggested(source: NewSource, root: Path, *, recover: bool) -> dict[str, Any]:
    """The selections of a left and a right arm that the topics' names suggest. Raises UsageError where they do not."""
    from stages.inspect.bag_info import describe

    suggested: dict[str, Any] = {}
    reason = ""
    for file in source.files:
        found = describe(root / file, recover=recover)
        words = shlex.split(found["command"])
        reason = found["reason"]
        if "--urdf" not in words and reason.startswith("By their names"):
            suggested |= {
                word.removeprefix("--").replace("-", "_"): words[index + 1]
                for index, word in enumerate(words)
                if word in ("--left", "--right", "--left-wrench", "--right-wrench")
            }
    if not {"left", "right"} <= set(suggested):
        name = Path(source.files[0]).name
        raise UsageError(
            f"{name}: say where the arms' poses are, with --left and --right (or --point); 'clpv info {name}' lists "
            f"what is in it. {reason}"
        )
    return suggested


def _write_card(
    project: Project, name: str, selections: Selections, files: dict[str, str]
) -> list[tuple[str, str, int]]:
    """Write the dataset's card; what people wrote in an earlier one stays. Returns (name, split, samples) of each."""
    from stages.artifacts.demonstrations import read_demonstrations

    ((_, outputs),) = project.artifacts(project.experiment(name), "ingest")
    demonstrations = [
        (d.demo, d.split, max(arm.time.shape[0] for arm in d.arms.values()))
        for d in read_demonstrations(outputs["demonstrations"])
    ]
    shown = {key: str(value) for key, value in selections.given().items()}
    text = card_text(name, files, demonstrations, shown, read_card(project.root, name))
    write_atomically(card_path(project.root, name), text)
    return demonstrations


def show_information(console: Console, path: Path, *, recover: bool) -> None:
    """Show what is in a recording, and the lines that show and ingest it; of other files of ours, what opens them."""
    from stages.inspect.bag_info import describe, lines

    found = describe(path, recover=recover)
    if found["what"]:
        console.result(found["what"])
    if found["what"] and not found["topics"]:
        console.document(found)
        return
    duration = "" if found["duration"] is None else f", {found['duration']:.2f} s"
    console.result(f"{found['file']}: {found['format']}, {found['bytes'] / 1e6:.2f} MB{duration}")
    for sentence in (found["integrity"], found["lost"], *found["notes"]):
        if sentence:
            console.result(sentence)
    console.result("")
    console.table(lines(found))
    console.result("")
    if found["look"]:
        console.result("To look at it:")
        for command in found["look"]:
            console.result(f"    {command}")
    console.result(found["reason"])
    if found["command"]:
        console.result(f"    {found['command']}")
    console.document(found)
