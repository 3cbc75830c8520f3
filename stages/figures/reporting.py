"""The verb report: one experiment's, or those of all that are up to date with a page that leads to them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.console import Console
from pipeline.errors import UsageError
from pipeline.experiment import Experiment
from pipeline.plan import State
from pipeline.project import Project
from pipeline.runner import Event
from pipeline.store import write_atomically
from pipeline.views import one_of
from stages.figures.experiment import Report, write_report
from stages.figures.index import STATES, Entry, Skipped, index_page

INDEX = Path("runs") / "index.html"
REPORT = "report.html"
FIGURES = "figures"


def report_one(
    project: Project,
    console: Console,
    name: str,
    *,
    output: str | None,
    figures: bool,
    sets: Sequence[str],
    seed: int | None,
) -> None:
    """Write the report of one experiment, and say where it is.

    Figures go beside it: to ``runs/NAME/figures``, or, of a file that was named, to the folder ``FILE-figures``.
    """
    experiment = project.experiment(name, sets, seed)
    path, folder = experiment.folder / REPORT, experiment.folder / FIGURES
    if output is not None:
        path = _named(output)
        folder = path.with_name(f"{path.stem}-{FIGURES}")
    report = write_report(project, experiment, path, pictures=folder if figures else None)
    base = Path() if output is not None else project.root
    _say(console, report, base)
    console.document(_document(report, base))


def report_all(project: Project, console: Console, names: Sequence[str], *, figures: bool) -> None:
    """Write the reports of all experiments that are up to date, and the page that leads to them."""
    experiments = [one_of(project, name) for name in names]
    states = [_state(project, experiment) for experiment in experiments]
    current = [one for one, state in zip(experiments, states, strict=True) if state is State.CACHED]
    entries, documents = [], []
    with console.progress(len(current), 1) as listener:
        for experiment in current:
            begin = time.perf_counter()
            listener(Event(kind="started", point=experiment.name, stage="report"))
            folder = experiment.folder / FIGURES if figures else None
            report = write_report(project, experiment, experiment.folder / REPORT, pictures=folder)
            entries.append(_entry(report))
            documents.append((report, _document(report, project.root)))
            took = time.perf_counter() - begin
            listener(Event(kind="done", point=experiment.name, stage="report", seconds=took))
    skipped = [
        Skipped(name=one.name, description=one.description, state=STATES[state])
        for one, state in zip(experiments, states, strict=True)
        if state is not State.CACHED
    ]
    page = index_page(entries, skipped)
    write_atomically(project.root / INDEX, page)
    for report, _ in documents:
        _say(console, report, project.root)
    for one in skipped:
        console.result(f"skipped: {one.name} is {one.state}; next: '{one.command}'")
    console.result(f"index: {INDEX}, {len(entries)} written, {len(skipped)} skipped")
    console.document(
        {
            "index": str(INDEX),
            "bytes": len(page.encode()),
            "written": [document for _, document in documents],
            "skipped": [{"experiment": one.name, "state": one.state, "command": one.command} for one in skipped],
        }
    )


def _named(output: str) -> Path:
    """The file that an option names. Raises UsageError where it can be none."""
    path = Path(output)
    if not path.name or path.is_dir():
        raise UsageError(f"--output names no file but a folder, {output!r}: name a file in it, e.g. {path / REPORT}.")
    if not path.parent.is_dir():
        raise UsageError(f"--output {output}: there is no folder {path.parent}; make it, or name another one.")
    return path


def _state(project: Project, experiment: Experiment) -> State:
    """State of the first stage that is not up to date."""
    rows = project.plan(experiment, project.last.name)
    return next((row.state for row in rows if row.state is not State.CACHED), State.CACHED)


def _entry(report: Report) -> Entry:
    experiment = report.experiment
    return Entry(
        name=experiment.name,
        points=len(experiment.points),
        target=f"{experiment.name}/{REPORT}",
        lead=report.lead,
        sections=report.sections,
    )


def _say(console: Console, report: Report, base: Path) -> None:
    console.result(f"report: {_shown(report.path, base)}")
    if report.pictures:
        console.result(f"figures: {_shown(report.pictures[0].parent, base)}, {len(report.pictures)} files")


def _document(report: Report, base: Path) -> dict[str, Any]:
    return {
        "experiment": report.experiment.name,
        "file": _shown(report.path, base),
        "bytes": report.size,
        "figures": [_shown(path, base) for path in report.pictures],
    }


def _shown(path: Path, base: Path) -> str:
    return str(path.relative_to(base)) if base != Path() else str(path)
