"""What the verb ``show`` shows: an experiment, or one stage of it, in tables and small plots. The console prints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.console import Console, cell
from pipeline.errors import ClpvError, StaleError, UsageError, choices
from pipeline.experiment import Experiment
from pipeline.plan import Examined
from pipeline.project import Project
from pipeline.stage import Stage, load
from pipeline.values import flatten, plain
from pipeline.views import described

if TYPE_CHECKING:
    from pipeline.plots import Bars, Plot


def show(
    project: Project, console: Console, experiment: Experiment, stage: str | None, point: str | None, *, csv: bool
) -> None:
    """Show an experiment, or one stage of it."""
    points = [p.id for p in experiment.points]
    if point is not None and point not in points:
        raise UsageError(f"{experiment.name} has no point {point!r}; {choices(point, points)}")
    if stage is None:
        if csv:
            raise UsageError("--csv needs a stage: add --stage, e.g. --stage evaluate.")
        _show_experiment(project, console, experiment, point)
    else:
        _show_stage(project, console, experiment, project.stage(stage), point, csv=csv)


def _show_experiment(project: Project, console: Console, experiment: Experiment, point: str | None) -> None:
    chosen = next(p for p in experiment.points if point in (None, p.id))
    rows = [row for row in project.plan(experiment, project.last.name) if row.point.id == chosen.id]
    parameters = {name: plain(value) for name, value in chosen.parameters.items()}
    metrics = {row.stage.name: dict(row.record["metrics"]) for row in rows if row.record is not None}
    console.result(f"{experiment.name}: {experiment.description or 'no description'}")
    console.result(
        f"preset {experiment.preset}, seed {chosen.seed}, {len(experiment.points)} point(s); shown: {chosen.id}"
    )
    console.result("")
    console.table([{"parameter": name, "value": cell(value)} for name, value in flatten(parameters).items()])
    console.result("")
    facts = {
        f"{stage.name}: {name}": text
        for stage in project.stages.values()
        for name, text in stage.about(chosen.parameters[stage.name], project.root).items()
    }
    console.table([{"data": name, "": text} for name, text in facts.items()])
    if facts:
        console.result("")
    console.table([{"stage": row.stage.name, "state": str(row.state), "what": row.stage.summary} for row in rows])
    console.result("")
    console.table(
        [
            {"figure": f"{stage}: {name}", "value": value}
            for stage, found in metrics.items()
            for name, value in found.items()
        ]
    )
    for stage in [stage for stage in project.stages.values() if stage.plots][-1:]:
        _draw(project, console, experiment, stage, rows, most=1)
    console.document(
        {
            "experiment": experiment.name,
            "description": experiment.description,
            "preset": experiment.preset,
            "points": [{"id": p.id, "overrides": p.overrides, "seed": p.seed} for p in experiment.points],
            "point": chosen.id,
            "parameters": parameters,
            "data": facts,
            "stages": [described(row) for row in rows],
            "metrics": metrics,
        }
    )


def _show_stage(
    project: Project, console: Console, experiment: Experiment, stage: Stage, point: str | None, *, csv: bool
) -> None:
    rows: list[dict[str, Any]] = []
    artifacts: list[dict[str, Any]] = []
    figures: list[dict[str, Any]] = []
    tables: dict[str, list[dict[str, Any]]] = {}
    warnings: list[str] = []
    chosen = next(p for p in experiment.points if point in (None, p.id))
    plan = project.plan(experiment, stage.name)
    for row in plan:
        if row.stage.name != stage.name or point not in (None, row.point.id):
            continue
        if row.record is None:
            raise StaleError(
                f"Stage {stage.name} of {experiment.name} at {row.point.id} is {row.state}: "
                f"run '{experiment.command('run')}' first."
            )
        outputs = project.store.outputs(row.record)
        files = {name: project.store.path(a.digest) for name, a in outputs.items()}
        for name, artifact in outputs.items():
            path = files[name].relative_to(project.root).as_posix()
            artifacts.append({"point": row.point.id, "artifact": name, "bytes": artifact.size, "file": path})
        figures.append({"point": row.point.id, **row.record["metrics"]})
        warnings.extend(row.record["warnings"])
        if stage.rows is not None:
            rows.extend({"point": row.point.id, **found} for found in stage.rows(files))
        for title, further in (stage.tables(files) if stage.tables is not None else {}).items():
            tables.setdefault(title, []).extend({"point": row.point.id, **found} for found in further)
    if csv:
        if stage.rows is None:
            raise UsageError(f"Stage {stage.name} has no table of rows: without --csv, its files are named.")
        console.csv(rows)
        return
    parameters = plain(chosen.parameters[stage.name])
    console.result(f"{stage.name}: {stage.summary}")
    console.table([{"parameter": name, "value": cell(value)} for name, value in flatten(parameters).items()])
    console.result("")
    console.table(artifacts)
    console.result("")
    _figures_of(console, figures)
    for title, found in {"": rows, **tables}.items():
        if found:
            console.result(title and f"{title}:")
            console.table(found)
    _draw(project, console, experiment, stage, [row for row in plan if row.point.id == chosen.id])
    for sentence in warnings:
        console.warn(sentence)
    console.document(
        {
            "experiment": experiment.name,
            "stage": stage.name,
            "parameters": parameters,
            "artifacts": artifacts,
            "metrics": figures,
            "rows": rows,
            "tables": tables,
            "warnings": warnings,
        }
    )


def _draw(
    project: Project,
    console: Console,
    experiment: Experiment,
    stage: Stage,
    rows: Sequence[Examined],
    most: int | None = None,
) -> None:
    """Draw what a stage declares to be drawn, at most `most` plots.

    Arguments:
        rows: of the point that is shown, this stage's among them; where one is not up to date, nothing is drawn.
    """
    if not stage.plots or not console.draws or any(row.record is None for row in rows):
        return
    files: dict[str, Path] = {}
    for row in rows:
        outputs = project.store.outputs(row.record) if row.record is not None else {}
        files |= {name: project.store.path(artifact.digest) for name, artifact in outputs.items()}
    try:
        plots: Sequence[Plot | Bars] = load(stage.plots)(files)
    except ClpvError as error:
        console.warn(f"not drawn: {error}")
        return
    several = len(experiment.points) > 1
    head = f"{rows[0].point.id}, one of {len(experiment.points)} points (another: --point):" if several else ""
    console.plots(plots[:most], head)


def _figures_of(console: Console, figures: Sequence[dict[str, Any]]) -> None:
    """Headline figures: one a line of a single point, one point a line of several."""
    if len(figures) == 1:
        (only,) = figures
        console.table([{"figure": name, "value": value} for name, value in only.items() if name != "point"])
    else:
        console.table(figures)
