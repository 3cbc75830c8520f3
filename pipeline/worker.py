"""What a worker process does: runs one stage on files of the store, stores what it gave, records how."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline import code, environment
from pipeline.errors import ClpvError, ExecutionError
from pipeline.stage import Stage, StageContext, load
from pipeline.store import Artifact, Store


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a worker needs to run one stage; plain values and paths only.

    Attributes:
        seed: of the point; none where the stage does not declare that it is random.
        files: module -> sha256 of its file, of which the key's code digest was made.
    """

    reference: str
    parameters: Any
    inputs: Mapping[str, Artifact]
    sources: Mapping[str, Path]
    seed: int | None
    key: str
    components: Mapping[str, Any]
    definitions: Mapping[str, Mapping[str, str]]
    files: Mapping[str, str]
    root: Path
    store: Store
    point: str


def execute(task: Task) -> tuple[dict[str, Any], float]:
    """Run one stage and store what it gave; returns the action record and the seconds it took.

    Raises ClpvError; any other exception of the stage becomes an ExecutionError with its traceback as the cause.
    """
    from threadpoolctl import threadpool_limits

    stage: Stage = load(task.reference)
    place = f"stage {stage.name} at {task.point}"
    begin = time.perf_counter()
    with task.store.scratch() as folder:
        context = StageContext(
            stage=stage.name,
            parameters=task.parameters,
            inputs={name: task.store.path(artifact.digest) for name, artifact in task.inputs.items()},
            sources=task.sources,
            outputs={port.name: folder / port.filename for port in stage.ports(task.parameters)},
            seed=task.seed,
            failures=task.store.folder / "failed" / task.key[:12],
        )
        try:
            # One BLAS thread: sums that depend on the number of threads would change the bytes. Standard output is
            # for the command's result.
            with threadpool_limits(1), contextlib.redirect_stdout(sys.stderr):
                stage.run(context)
                for port in stage.ports(task.parameters):
                    path = context.outputs[port.name]
                    if not (path.is_dir() if port.folder else path.is_file()) or path.is_symlink():
                        raise ExecutionError(f"{place} did not write its output {port.name}.", stage.name, task.point)
                metrics = _figures(stage.headline(context.outputs))
        except ClpvError:
            raise
        except OSError as error:
            message = f"{place}: a file cannot be read or written: {_line(error)}."
            raise ExecutionError(message, stage.name, task.point) from error
        except Exception as error:
            message = f"{place} failed with {type(error).__name__}: {_line(error)}."
            raise ExecutionError(
                f"{message} Run again with --debug for the traceback.", stage.name, task.point
            ) from error
        if code.edited(task.files):
            # Which code this process imported is not known: nothing may be recorded under the key.
            message = f"{place}: its code was edited while it ran; run again."
            raise ExecutionError(message, stage.name, task.point)
        outputs = {name: task.store.add(path) for name, path in context.outputs.items()}
    seconds = time.perf_counter() - begin
    return _record(task, stage, outputs, metrics, context.warnings, seconds), seconds


def _record(
    task: Task,
    stage: Stage,
    outputs: Mapping[str, Artifact],
    metrics: Mapping[str, float | None],
    warnings: Sequence[str],
    seconds: float,
) -> dict[str, Any]:
    """Write the action record; where one stands with other outputs, say so in what is returned."""
    record: dict[str, Any] = {
        "key": task.key,
        "stage": stage.name,
        "components": dict(task.components),
        "definitions": {module: dict(names) for module, names in task.definitions.items()},
        "outputs": {name: {"digest": a.digest, "size": a.size} for name, a in outputs.items()},
        "metrics": dict(metrics),
        "warnings": list(warnings),
        "environment": environment.capture(stage.versioned(task.parameters), task.root),
        "seconds": round(seconds, 4),
    }
    standing = task.store.record(task.key, record)
    if standing["outputs"] == record["outputs"]:
        return record
    differing = [name for name, entry in record["outputs"].items() if standing["outputs"].get(name) != entry]
    same_machine = environment.tags(standing["environment"]) == environment.tags(record["environment"])
    if not all(task.store.holds(artifact) for artifact in task.store.outputs(standing).values()):
        standing = task.store.record(task.key, record, replace=True)
    return {**standing, "differs": {"artifacts": differing, "same_machine": same_machine}}


def _figures(found: Mapping[str, Any]) -> dict[str, float | None]:
    """Figures as JSON has them: numpy's numbers become Python's, and what is not finite becomes null."""
    plain = {name: value.item() if hasattr(value, "item") else value for name, value in found.items()}
    return {name: None if value is None or not math.isfinite(value) else value for name, value in plain.items()}


def _line(error: Exception) -> str:
    """The first line of an error's message, without the stop at its end."""
    return (str(error).strip().splitlines() or ["no message"])[0].rstrip(".")
