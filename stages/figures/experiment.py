"""The report of an experiment: reads its results, makes the sections, writes one HTML file."""

from __future__ import annotations

from pathlib import Path

from pipeline.compiled import use_cache_for
from pipeline.experiment import Experiment
from pipeline.project import Project
from pipeline.report import assemble
from pipeline.store import write_atomically


def write_report(project: Project, experiment: Experiment, path: Path) -> int:
    """Write an experiment's report and return its size in bytes. The file appears whole or not at all.

    Raises StaleError where the experiment has not been run or is out of date, StoreError where the file cannot be
    written.
    """
    use_cache_for(project.package)  # before the imports below bring in compiled code
    from stages.figures.results import read_results
    from stages.figures.sections import lead, sections

    results = read_results(project, experiment)
    text = assemble(experiment.name, lead(results), sections(results))
    write_atomically(path, text)
    return len(text.encode())
