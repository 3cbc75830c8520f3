"""What `clpv inspect` does: chooses roll-outs, writes the recording, shows it where there is a screen or a browser."""

from __future__ import annotations

import contextlib
import shlex
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.compiled import use_cache_for
from pipeline.console import Console
from pipeline.errors import UsageError
from pipeline.experiment import experiment_names
from pipeline.project import Project
from stages.inspect.own_files import MCAP, RRD

if TYPE_CHECKING:
    from stages.figures.results import Results
    from stages.inspect.shown import Shown

SUFFIX = ".rrd"

FILES = (SUFFIX, ".mcap", ".bag", ".db3", ".parquet", ".csv")
"""How names end that are files', where no experiment is called so."""


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
    """Show roll-outs of one or more experiments in rerun, on one time line; or one recording that is a file.

    Raises UsageError for options that do not go together, names that name nothing, and where there is no display;
    StaleError where an experiment has not been run or is out of date; StoreError where the file cannot be written.
    """
    files = [name for name in names if _is_file(name, project)]
    if files:
        if len(names) > 1 or rollouts or points or save or sets or seed is not None:
            raise UsageError(f"{files[0]} is a file, and is shown as it is: leave out other names and options.")
        recording = _recording(files[0])
        _check(serve=serve, file=True)
        _show(console, recording, {"file": files[0]}, serve=serve)
        return
    target = None if save is None else _target(save, serve=serve)
    use_cache_for(project.package)  # before the imports below bring in compiled code
    from stages.figures.results import read_results
    from stages.inspect.recording import write_recording
    from stages.inspect.shown import choose

    several = [read_results(project, project.experiment(name, sets, seed)) for name in dict.fromkeys(names)]
    shown = choose(several, rollouts, points)
    for sentence in left_out(several, shown, rollouts, points):
        console.note(sentence)
    document = {"experiments": list(dict.fromkeys(names)), "rollouts": ["/".join(one.root) for one in shown]}
    if target is not None:
        size = write_recording(target, shown)
        look = shlex.join(["clpv", "inspect", str(save)])
        console.result(f"recording: {save} ({size / 1e6:.1f} MB); '{look}' opens it.")
        console.document({**document, "file": save, "bytes": size})
        return
    _check(serve=serve)
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder, f"{'-'.join(dict.fromkeys(names))}{SUFFIX}")
        write_recording(recording, shown)
        _show(console, recording, document, serve=serve)


def left_out(
    several: Sequence[Results], shown: Sequence[Shown], rollouts: Sequence[str], points: Sequence[str]
) -> Iterator[str]:
    """What a person should know of what is not shown: a sentence each."""
    for results in several:
        name = results.experiment.name
        own = [one for one in shown if one.model[0] == name]
        if results.is_sweep and not points:
            yield f"{name}: {own[0].point.point.id}, one of {len(results.points)} points; others with --point."
        there = {id(one.point): one.point for one in own}.values()
        known = [r.rollout for point in there for r in point.rollouts]
        if len(own) < len(known) and not rollouts:
            kept = {one.rollout.rollout for one in own}
            other = next((one for one in known if one not in kept), "*")  # of several points, all names may be there
            example = f"--rollout {shlex.quote(other)}"
            yield f"{name}: {len(own)} of {len(known)} roll-outs; others with --rollout, e.g. {example}."


def _show(console: Console, recording: Path, document: Mapping[str, Any], *, serve: bool) -> None:
    """Show a recording in a window or in a browser, until that is ended."""
    from stages.inspect import viewer

    with contextlib.suppress(KeyboardInterrupt):  # which is how one may leave it
        if not serve:
            viewer.open_window(recording, lambda: console.note("The viewer is open; close its window to go on."))
            console.document(dict(document))
            return
        with viewer.served(recording) as (address, wait):
            console.result(f"Open {address} in a browser of this machine; Ctrl+C ends it.")
            console.document({**document, "address": address})
            wait()


def _check(*, serve: bool, file: bool = False) -> None:
    """Raise DataError where there is no viewer, UsageError where there is no display that it could open on."""
    from stages.inspect import viewer

    viewer.binary()
    if not serve:
        viewer.check_display(viewer.ELSEWHERE if file else viewer.SAVE)


def _is_file(name: str, project: Project) -> bool:
    """Whether a name is that of a file, there or not, and of no experiment."""
    path = Path(name)
    return name not in experiment_names(project.root) and (path.is_file() or path.suffix in FILES)


def _recording(name: str) -> Path:
    """A file that rerun opens. Raises UsageError where there is none of this name, or it holds something else."""
    path = Path(name)
    if not path.is_file():
        raise UsageError(f"There is neither a file nor an experiment {name!r}; 'clpv list' names them.")
    with path.open("rb") as stream:
        head = stream.read(len(MCAP))
    if not head.startswith((RRD, MCAP)):
        raise UsageError(
            f"{name} is no recording that rerun opens; '{shlex.join(['clpv', 'info', name])}' looks at it."
        )
    return path


def _target(save: str, *, serve: bool) -> Path:
    """The file to write. Raises UsageError where it is no name for one."""
    if serve:
        raise UsageError("--save writes a file and --serve shows it in a browser: choose one.")
    path = Path(save)
    if path.is_dir():
        raise UsageError(f"{save} is a folder: name a file in it, e.g. --save {path / ('rollouts' + SUFFIX)}.")
    if path.suffix != SUFFIX:
        raise UsageError(f"{save}: a recording's name ends in {SUFFIX}, e.g. --save {path.with_suffix(SUFFIX).name}.")
    if not path.parent.is_dir():
        raise UsageError(f"--save {save}: there is no folder {path.parent}; make it, or name another one.")
    return path
