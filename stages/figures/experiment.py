"""The report of an experiment: its results are read, its sections made, the page and its figures written as files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.compiled import use_cache_for
from pipeline.experiment import Experiment
from pipeline.project import Project
from pipeline.report import Block, Section, assemble
from pipeline.store import write_atomically


@dataclass(frozen=True, kw_only=True)
class Report:
    """A report that was written.

    Attributes:
        experiment: that it is of.
        path: of the HTML file; size: its bytes.
        pictures: files of the figures; empty where none were asked for.
        lead: the head of the page.
        sections: of the page.
    """

    experiment: Experiment
    path: Path
    size: int
    pictures: tuple[Path, ...]
    lead: tuple[Block, ...]
    sections: tuple[Section, ...]


def write_report(project: Project, experiment: Experiment, path: Path, *, pictures: Path | None = None) -> Report:
    """Write an experiment's report, and its figures. Every file appears whole or not at all.

    Arguments:
        project: that it belongs to.
        experiment: as it was resolved.
        path: of the HTML file.
        pictures: folder for the figures as files; none: they are not written.

    Raises StaleError where the experiment has not been run or is out of date, StoreError where a file cannot be
    written.
    """
    use_cache_for(project.package)  # before the imports below bring in compiled code
    from stages.figures.results import read_results
    from stages.figures.sections import lead, sections

    results = read_results(project, experiment)
    head, made = lead(results), sections(results)
    text = assemble(experiment.name, head, made)
    write_atomically(path, text)
    drawn: list[Path] = []
    if pictures is not None:
        from pipeline.pictures import write_pictures

        drawn = write_pictures(made, pictures)
    return Report(
        experiment=experiment,
        path=path,
        size=len(text.encode()),
        pictures=tuple(drawn),
        lead=tuple(head),
        sections=tuple(made),
    )
