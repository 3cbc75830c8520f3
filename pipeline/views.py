"""What the reading verbs show: status, list, diff; and the two that tidy: new, gc. The console prints.

Not here: a single experiment and its stages (`show.py`).
"""

from __future__ import annotations

import contextlib
import shutil
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.console import Console, cell
from pipeline.editing import edited
from pipeline.errors import ParameterError, StoreError, UsageError, choices
from pipeline.experiment import FILE, NAME, Experiment, parse_override, resolve
from pipeline.manifest import read_manifest
from pipeline.plan import Examined, State
from pipeline.project import Project
from pipeline.store import size, write_atomically
from pipeline.values import flatten, plain


def status(
    project: Project, console: Console, names: Sequence[str], sets: Iterable[str], seed: int | None, *, why: bool
) -> bool:
    """Show the state of every stage of the named experiments; returns whether all of them are cached."""
    if not names:
        console.note("There is no experiment yet: make one with 'clpv new NAME'.")
    current = True
    documents: list[dict[str, Any]] = []
    shown: list[dict[str, Any]] = []
    for name in names:
        experiment = one_of(project, name, sets, seed)
        rows = project.plan(experiment, project.last.name)
        current &= all(row.state is State.CACHED for row in rows)
        documents.append({"experiment": name, "stages": [described(row) for row in rows]})
        shown.extend({"experiment": name, **line} for line in _condensed(rows, why=why))
    console.table(shown)
    console.document({"current": current, "experiments": documents})
    return current


def one_of(project: Project, name: str, sets: Iterable[str] = (), seed: int | None = None) -> Experiment:
    """One of several experiments: what is wrong with a parameter says in which file."""
    try:
        return project.experiment(name, sets, seed)
    except ParameterError as error:
        raise UsageError(f"runs/{name}/{FILE}: {error}") from None


def described(row: Examined) -> dict[str, Any]:
    """The state of a stage at a point, as a document."""
    return {
        "point": row.point.id,
        "stage": row.stage.name,
        "state": row.state,
        "key": row.key.value if row.key else None,
        "reasons": list(row.reasons),
    }


def _condensed(rows: Sequence[Examined], *, why: bool) -> list[dict[str, Any]]:
    """One line a stage, points of equal state and reasons together."""
    groups: dict[tuple[str, State, str], list[str]] = {}
    for row in rows:
        reasons = "; ".join(row.reasons) if why else ""
        groups.setdefault((row.stage.name, row.state, reasons), []).append(row.point.id)
    order = list(dict.fromkeys(row.stage.name for row in rows))
    lines = []
    for (stage, state, reasons), points in sorted(groups.items(), key=lambda item: order.index(item[0][0])):
        shown = points[0] if len(points) == 1 else f"{len(points)} points"
        line = {"stage": stage, "state": str(state), "at": shown}
        lines.append({**line, "why": reasons} if why else line)
    return lines


def overview(project: Project, console: Console, names: Sequence[str]) -> None:
    """All experiments, with the figures of their manifests averaged over points."""
    rows: list[dict[str, Any]] = []
    for name in names:
        experiment = one_of(project, name)
        figures = recorded_figures(experiment, project.last.name)
        rows.append(
            {"experiment": name, "points": len(experiment.points), "preset": experiment.preset, "figures": figures}
        )
    if not rows:
        console.note("There is no experiment yet: make one with 'clpv new NAME'.")
    for row in rows:
        console.result(f"{row['experiment']}: preset {row['preset']}, {row['points']} point(s)")
        shown = {name: value for name, value in row["figures"].items() if name.startswith("dtw_mm")} or row["figures"]
        for name, value in shown.items():
            console.result(f"    {name:<44} {cell(value)}")
        if not row["figures"]:
            console.result(f"    not run yet: 'clpv run {row['experiment']}'")
    console.document({"experiments": rows})


def recorded_figures(experiment: Experiment, stage: str) -> dict[str, float]:
    """Headline figures of a stage as the manifest has them, averaged over the points that have them."""
    manifest = read_manifest(experiment)
    sums: dict[str, list[float]] = {}
    for point in manifest.points if manifest else ():
        entry = manifest.entry(point, stage) if manifest else None
        for name, value in (entry or {}).get("metrics", {}).items():
            if value is not None:
                sums.setdefault(name, []).append(value)
    return {name: sum(values) / len(values) for name, values in sums.items()}


def compare(console: Console, a: Experiment, b: Experiment) -> None:
    """Show in which parameters and recorded figures two experiments differ."""
    first, second = (_parameters(experiment) for experiment in (a, b))
    parameters = [
        {"parameter": name, a.name: first.get(name), b.name: second.get(name)}
        for name in {**first, **second}
        if first.get(name) != second.get(name)
    ]
    stages = list(a.points[0].parameters)
    figures: list[dict[str, Any]] = []
    for stage in stages:
        old, new = recorded_figures(a, stage), recorded_figures(b, stage)
        for name in {**old, **new}:
            if old.get(name) != new.get(name):
                pair = (old.get(name), new.get(name))
                ratio = pair[1] / pair[0] if pair[0] and pair[1] is not None else None
                figures.append({"figure": f"{stage}: {name}", a.name: pair[0], b.name: pair[1], "ratio": ratio})
    if not parameters and not figures:
        console.result(f"{a.name} and {b.name} have the same parameters and figures.")
    shown = [{key: value if key == "parameter" else cell(value) for key, value in row.items()} for row in parameters]
    console.table(shown)
    console.table(figures)
    console.document({"experiments": [a.name, b.name], "parameters": parameters, "metrics": figures})


def _parameters(experiment: Experiment) -> dict[str, Any]:
    """Flat parameters; what a sweep varies is shown as the list of its values."""
    points = [flatten({"preset": experiment.preset, "seed": p.seed, **plain(p.parameters)}) for p in experiment.points]
    flat: dict[str, Any] = {}
    for name in points[0]:
        values = list(dict.fromkeys(str(point.get(name)) for point in points))
        flat[name] = points[0][name] if len(values) == 1 else values
    return flat


def create(
    project: Project, console: Console, name: str, template: str, templates: Mapping[str, str], sets: Iterable[str]
) -> None:
    """Write a new experiment file from a template, with its overrides tried before anything is written."""
    if not NAME.fullmatch(name):
        raise UsageError(f"{name!r} is no name for an experiment: use letters, digits, dash, dot and underscore.")
    if template not in templates:
        raise UsageError(f"There is no template {template!r}; {choices(template, templates)}")
    folder = project.root / "runs" / name
    if folder.exists() or folder.is_symlink():
        raise UsageError(f"runs/{name} exists already: choose another name, or edit runs/{name}/{FILE}.")
    text = templates[template]
    for location, value in map(parse_override, sets):
        text = edited(text, location, value)
    resolve(name, folder, tomllib.loads(text), list(project.stages.values()))
    try:
        write_atomically(folder / FILE, text)
    except StoreError:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        raise
    console.result(f"runs/{name}/{FILE} written: edit it, then 'clpv run {name}'.")
    console.document({"experiment": name, "file": f"runs/{name}/{FILE}"})


def collect_garbage(project: Project, console: Console, names: Sequence[str], *, dry_run: bool) -> None:
    """Remove action records that no experiment leads to as it stands, objects that no kept record names, failures."""
    store = project.store
    if store.busy():
        raise StoreError("A run is going on in this project: wait until it has finished, then collect.")
    kept_keys: set[str] = set()
    for name in names:
        experiment = one_of(project, name)
        manifest = read_manifest(experiment)
        kept_keys.update(manifest.keys if manifest else ())
        kept_keys.update(row.key.value for row in project.plan(experiment, project.last.name) if row.key is not None)
    kept_objects: set[str] = set()
    for key in kept_keys:
        record = store.action(key)
        if record is not None:
            kept_objects.update(artifact.digest for artifact in store.outputs(record).values())
    # Records go first: an object that a record still names is never removed before it.
    actions = [path for path in sorted(store.folder.glob("actions/*.json")) if path.stem not in kept_keys]
    objects = [path for path in sorted(store.folder.glob("objects/*/*")) if path.name not in kept_objects]
    failures = [path for path in sorted(store.folder.glob("failed/*/*")) if path.is_file()]
    bytes_ = sum(size(path) for path in (*actions, *objects, *failures))
    if not dry_run:
        _remove((*actions, *objects, *failures))
        for folder in {path.parent for path in failures}:
            with contextlib.suppress(OSError):  # something new was kept there
                folder.rmdir()
    word = "would be removed" if dry_run else "removed"
    failed = f" and {len(failures)} failed programs" if failures else ""
    console.result(f"{len(actions)} results and {len(objects)} objects{failed}, {bytes_ / 1e6:.1f} MB, {word}.")
    console.document({"actions": len(actions), "objects": len(objects), "bytes": bytes_, "removed": not dry_run})


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        try:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise StoreError(f"{path.name} in the store cannot be removed: {error.strerror}.") from None
