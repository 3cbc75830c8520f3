"""What run and the verbs named after stages do: bring an experiment up to a stage, and show what that stage gives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.console import Console
from pipeline.experiment import Experiment
from pipeline.plan import Examined
from pipeline.project import Project, keep_manifest
from pipeline.stage import Stage

MOST_ROWS = 40
"""A table of more rows is shown by its summary alone."""

MANIFEST_NOTES = {
    "written": "runs/{name}/manifest.json written: commit it with the experiment.",
    "unchanged": "runs/{name}/manifest.json agrees.",
    "overridden": "Options changed the experiment for this call: runs/{name}/manifest.json is left as it is.",
    "differs": "Same keys, other bytes than in runs/{name}/manifest.json (another processor?): it is kept; "
    "compare with 'clpv verify {name}', replace it with --record.",
}


def bring_up(
    project: Project,
    console: Console,
    experiment: Experiment,
    last: Stage,
    *,
    jobs: int | None,
    force: Sequence[str],
    record: bool,
    then: Sequence[str] = (),
) -> None:
    """Run what is not up to date, up to the stage `last`; show its rows, and keep the manifest where all stages ran.

    `then`: verbs that show what has come out, where all stages ran.
    """
    with console.progress(len(experiment.points), len(project.upto(last.name))) as listener:
        outcomes = project.bring_up(experiment, last.name, jobs=jobs, force=force, listener=listener)
    rows = project.rows(outcomes, last)
    document: dict[str, Any] = {
        "experiment": experiment.name,
        "stages": [
            {"name": o.stage, "point": o.point.id, "cached": o.cached, "key": o.record["key"], "seconds": o.seconds}
            for o in outcomes
        ],
    }
    if last.rows is not None:
        summary = last.summarise(rows) if last.summarise is not None else []
        document |= {"rows": rows, "summary": {"groups": summary}}
        if len(rows) <= MOST_ROWS:
            _table(console, rows)
            console.result("")
        _table(console, summary)
    if last is project.last:
        document["manifest"] = keep_manifest(experiment, outcomes, record=record)
        console.note(MANIFEST_NOTES[document["manifest"]].format(name=experiment.name))
    computed = sum(not o.cached for o in outcomes)
    console.note(f"{len(outcomes)} stages, {computed} computed, {len(outcomes) - computed} cached.")
    if then and last is project.last:
        console.note("See it: " + ", ".join(f"'{experiment.command(verb)}'" for verb in then) + ".")
    console.document(document)


def _table(console: Console, rows: Sequence[dict[str, Any]]) -> None:
    """Rows, and below them which columns hold nothing but zeros."""
    shown, zero = brief(rows)
    console.table(shown)
    if zero:
        console.result(f"0 in all of them: {', '.join(zero)}.")


def brief(rows: Sequence[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[str]]:
    """Rows without the columns that say nothing, and names of those that say 0 throughout.

    Nothing: empty ones, words that are the same in all of several rows, numbers that are 0 in all of them.
    """
    if len(rows) < 2:
        return list(rows), []
    heads = [head for head in rows[0] if any(row[head] is not None for row in rows)]
    zero = [head for head in heads if all(_is_zero(row[head]) for row in rows)]
    kept = [
        head
        for head in heads
        if head not in zero
        and (not isinstance(rows[0][head], str) or len({row[head] for row in rows}) > 1 or head == "outcome")
    ]
    return [{head: row[head] for head in kept} for row in rows], zero


def _is_zero(value: Any) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool) and value == 0)


def show_plan(console: Console, rows: Sequence[Examined], name: str) -> None:
    """One line a stage and point: its state, and why it is not cached."""
    document, shown = [], []
    for examined in rows:
        reasons = list(examined.reasons)
        entry = {"experiment": name, "point": examined.point.id, "stage": examined.stage.name, "state": examined.state}
        document.append({**entry, "key": examined.key.value if examined.key else None, "reasons": reasons})
        shown.append({**entry, "why": "; ".join(reasons)})
    console.table(shown)
    console.document({"experiment": name, "stages": document})
