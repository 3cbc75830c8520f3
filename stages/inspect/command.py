"""What `clpv inspect` does: chooses roll-outs, writes the recording, shows it where there is a screen or a browser."""

from __future__ import annotations

import contextlib
import shlex
import tempfile
from collections.abc import Sequence
from pathlib import Path

from pipeline.compiled import use_cache_for
from pipeline.console import Console
from pipeline.errors import UsageError
from pipeline.project import Project
from stages.inspect.own_files import recognise

SUFFIX = ".rrd"

FILES = (SUFFIX, ".mcap", ".bag", ".db3", ".parquet", ".csv")
"""How names end that are files' and no experiments'."""


def inspect(
    project: Project,
    console: Console,
    names: Sequence[str],
    *,
    rollouts: Sequence[str] = (),
    points: Sequence[str] = (),
    save: str | None = None,
    serve: bool = False,
    sets: Sequence[str] = (),
    seed: int | None = None,
) -> None:
    """Show roll-outs of one or more experiments in rerun, on one time line.

    Raises UsageError for options that do not go together, names that name nothing, and where there is no display;
    StaleError where an experiment has not been run or is out of date; StoreError where the file cannot be written.
    """
    for name in names:
        _no_file(name)
    target = None if save is None else _target(save, serve=serve)
    from stages.inspect import viewer

    if target is None:
        viewer.binary()
        if not serve:
            viewer.check_display()
    use_cache_for(project.package)  # before the imports below bring in compiled code
    from stages.figures.results import read_results
    from stages.inspect.recording import write_recording
    from stages.inspect.shown import choose

    several = [read_results(project, project.experiment(name, sets, seed)) for name in dict.fromkeys(names)]
    shown = choose(several, rollouts, points)
    known = sum(len(point.rollouts) for point in {id(one.point): one.point for one in shown}.values())
    if len(shown) < known and not rollouts:
        first = shown[0].rollout.rollout
        console.note(f"{len(shown)} of {known} roll-outs, e.g. {first}; others with --rollout, e.g. --rollout '*'.")
    document = {"experiments": list(dict.fromkeys(names)), "rollouts": ["/".join(one.root) for one in shown]}
    if target is not None:
        size = write_recording(target, shown)
        console.result(f"recording: {save} ({size / 1e6:.1f} MB); open it with 'rerun {save}'.")
        console.document({**document, "file": save, "bytes": size})
        return
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder, f"{'-'.join(dict.fromkeys(names))}{SUFFIX}")
        write_recording(recording, shown)
        if not serve:
            console.note("The viewer is open; close its window to go on.")
            viewer.open_window(recording)
            console.document({**document, "file": None})
            return
        with viewer.served(recording) as (address, server):
            console.result(f"Open {address} in a browser of this machine; Ctrl+C ends it.")
            console.document({**document, "address": address})
            with contextlib.suppress(KeyboardInterrupt):  # which is how one leaves it
                server.wait()


def _no_file(name: str) -> None:
    """Raise UsageError where a file was named instead of an experiment, with the command that shows it."""
    path = Path(name)
    if not (path.is_file() or path.suffix in FILES):
        return
    if not path.exists():
        raise UsageError(f"{name}: there is no such file, and inspect takes experiments; 'clpv list' names them.")
    known = recognise(path)
    look = known.look[0] if known is not None else shlex.join(["clpv", "info", name])
    raise UsageError(f"{name} is a file, and inspect takes experiments: '{look}' shows it.")


def _target(save: str, *, serve: bool) -> Path:
    """The file to write. Raises UsageError where it is no name for one."""
    if serve:
        raise UsageError("--save writes a file and --serve shows it in a browser: choose one.")
    path = Path(save)
    if path.is_dir():
        raise UsageError(f"{save} is a folder: name a file in it, e.g. --save {path / ('rollouts' + SUFFIX)}.")
    if path.suffix != SUFFIX:
        raise UsageError(f"{save}: a recording's name ends in {SUFFIX}, e.g. --save {path.with_suffix(SUFFIX).name}.")
    return path
