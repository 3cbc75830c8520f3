"""The generic verbs of the command line: run, status, show, list, diff, verify, new, gc, doctor, for any stages.

Thin: a verb reads its options, calls the engine and has the console print. Everything that takes time to import is
imported inside the verbs, so that ``--help`` stays fast.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec

import typer

from pipeline.errors import EXIT_FAILED, EXIT_STALE, ClpvError, MismatchError, UsageError

if TYPE_CHECKING:
    from pipeline.console import Console
    from pipeline.project import Project

P = ParamSpec("P")


def complete_name(incomplete: str) -> list[str]:
    """Names of experiments, for the shell's completion."""
    from pipeline.experiment import experiment_names, find_root

    return [name for name in experiment_names(find_root(Path.cwd())) if name.startswith(incomplete)]


Name = Annotated[str, typer.Argument(help="Experiment, a folder below runs/.", autocompletion=complete_name)]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Override a parameter for this call, e.g. mixture.alpha=3."),
]
Seed = Annotated[int | None, typer.Option(help="Override the seed for this call.")]
Jobs = Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Worker processes for sweeps. [all processors]")]
Force = Annotated[list[str] | None, typer.Option(metavar="STAGE", help="Run this stage even if it is cached.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what would run, and run nothing.")]
Record = Annotated[bool, typer.Option("--record", help="Write the manifest even where only the bytes differ.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no notes.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="A line for every stage of every point.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]


def root_folder() -> Path:
    """The project's folder: CLPV_ROOT, or the nearest one upward that holds runs/, or this one."""
    from pipeline.experiment import find_root

    given = os.environ.get("CLPV_ROOT")
    if not given:
        return find_root(Path.cwd())
    if not Path(given).is_dir():
        raise UsageError(f"CLPV_ROOT names {given!r}, which is no folder.")
    return Path(given).resolve()


def friendly(verb: Callable[P, None]) -> Callable[P, None]:
    """Turn the errors a user can cause into one sentence and an exit code; with --debug, let the traceback through."""

    @functools.wraps(verb)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            verb(*args, **kwargs)
            sys.stdout.flush()
        except ClpvError as error:
            if kwargs.get("debug"):
                raise
            console = _console(kwargs)
            console.error(str(error))
            if not isinstance(error, MismatchError):  # verify has printed its document
                console.document({"error": str(error), "exit_code": error.exit_code})
            raise typer.Exit(error.exit_code) from None
        except KeyboardInterrupt:
            _console(kwargs).error("interrupted; finished stages are kept.")
            raise typer.Exit(130) from None
        except BrokenPipeError:
            # The reader of our output has gone, as in `clpv list | head`: not an error of ours.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(EXIT_FAILED) from None
        except OSError as error:
            if kwargs.get("debug"):
                raise
            _console(kwargs).error(
                f"{error.filename or 'a file'} cannot be read or written: {error.strerror or error}."
            )
            raise typer.Exit(EXIT_FAILED) from None

    return wrapped


def _console(options: Any) -> Console:
    from pipeline.console import Console

    return Console(
        json=bool(options.get("json")), quiet=bool(options.get("quiet")), verbose=bool(options.get("verbose"))
    )


def open_project(references: Sequence[str]) -> Project:
    """The project of the current folder."""
    from pipeline.project import Project

    return Project.open(root_folder(), references)


def bring_up(
    references: Sequence[str],
    console: Console,
    name: str,
    last: str | None,
    *,
    sets: Sequence[str] | None = None,
    seed: int | None = None,
    jobs: int | None = None,
    force: Sequence[str] | None = None,
    dry_run: bool = False,
    record: bool = False,
    then: Sequence[str] = (),
) -> None:
    """Bring an experiment up to the stage `last` (none: the last one), or say what would run.

    `then`: verbs that show what has come out, where all stages have run.
    """
    from pipeline import advance

    project = open_project(references)
    experiment = project.experiment(name, sets or (), seed)
    forced = [project.stage(stage).name for stage in force or ()]
    stage = project.last if last is None else project.stage(last)
    if dry_run:
        advance.show_plan(console, project.plan(experiment, stage.name, forced), name)
    else:
        advance.bring_up(project, console, experiment, stage, jobs=jobs, force=forced, record=record, then=then)


def add_bring_up(
    app: typer.Typer, references: Sequence[str], verb: str, last: str | None, text: str, then: Sequence[str] = ()
) -> None:
    """Add a verb that brings an experiment up to the stage `last` (none: the last one); `text` is its help.

    `then`: verbs that show what has come out.
    """

    @app.command(verb, help=text)
    @friendly
    def command(
        name: Name,
        sets: Sets = None,
        seed: Seed = None,
        jobs: Jobs = None,
        force: Force = None,
        dry_run: DryRun = False,
        record: Record = False,
        json: Json = False,
        quiet: Quiet = False,
        verbose: Verbose = False,
        debug: Debug = False,
    ) -> None:
        from pipeline.console import Console

        console = Console(json=json, quiet=quiet, verbose=verbose)
        bring_up(
            references,
            console,
            name,
            last,
            sets=sets,
            seed=seed,
            jobs=jobs,
            force=force,
            dry_run=dry_run,
            record=record,
            then=then,
        )


def add_verbs(
    app: typer.Typer,
    references: Sequence[str],
    templates: Callable[[], dict[str, str]],
    then: Sequence[str] = (),
) -> None:
    """Add the generic verbs to an application.

    Arguments:
        references: import strings of the stages, in order.
        templates: name -> text of an experiment file, for ``new``.
        then: verbs that show what a run has given.
    """

    def verb(function: Callable[P, None]) -> Callable[P, None]:
        app.command(function.__name__.rstrip("_"))(friendly(function))
        return function

    def names(name: str | None) -> list[str]:
        from pipeline.experiment import experiment_names

        return [name] if name is not None else experiment_names(root_folder())

    text = "Run what is not up to date, and show the metrics."
    add_bring_up(app, references, "run", None, text, then)

    @verb
    def status(
        name: Annotated[str | None, typer.Argument(help="Experiment; all of them if left out.")] = None,
        why: Annotated[bool, typer.Option("--why", help="Say what changed.")] = False,
        check: Annotated[bool, typer.Option("--check", help="Exit with 3 if anything is not up to date.")] = False,
        sets: Sets = None,
        seed: Seed = None,
        json: Json = False,
        debug: Debug = False,
    ) -> None:
        """Say which stages are up to date, which are stale, and why."""
        from pipeline import views
        from pipeline.console import Console

        project, console = open_project(references), Console(json=json)
        current = views.status(project, console, names(name), sets or (), seed, why=why)
        if check and not current:
            raise typer.Exit(EXIT_STALE)

    @verb
    def show(
        name: Name,
        stage: Annotated[
            str | None, typer.Option(metavar="STAGE", help="One stage: parameters, artifacts, table.")
        ] = None,
        point: Annotated[str | None, typer.Option(help="One point of a sweep.")] = None,
        csv: Annotated[bool, typer.Option("--csv", help="The stage's table as comma-separated values.")] = False,
        sets: Sets = None,
        seed: Seed = None,
        json: Json = False,
        quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Tables only, no plots.")] = False,
        debug: Debug = False,
    ) -> None:
        """Show an experiment's parameters, artifacts and metrics."""
        from pipeline.console import Console
        from pipeline.show import show as show_it

        project, console = open_project(references), Console(json=json, quiet=quiet)
        show_it(project, console, project.experiment(name, sets or (), seed), stage, point, csv=csv)

    @verb
    def list_(json: Json = False, debug: Debug = False) -> None:
        """List the experiments with their headline metrics."""
        from pipeline import views
        from pipeline.console import Console

        views.overview(open_project(references), Console(json=json), names(None))

    @verb
    def diff(a: Name, b: Name, json: Json = False, debug: Debug = False) -> None:
        """Compare the parameters and metrics of two experiments."""
        from pipeline import views
        from pipeline.console import Console

        project = open_project(references)
        views.compare(Console(json=json), project.experiment(a), project.experiment(b))

    @verb
    def verify(
        name: Name,
        jobs: Jobs = None,
        json: Json = False,
        quiet: Quiet = False,
        verbose: Verbose = False,
        debug: Debug = False,
    ) -> None:
        """Recompute an experiment and compare it with its manifest."""
        from pipeline.console import Console
        from pipeline.verify import verify as recompute

        console = Console(json=json, quiet=quiet, verbose=verbose)
        project = open_project(references)
        experiment = project.experiment(name)
        with console.progress(len(experiment.points), len(project.stages)) as listener:
            found = recompute(project, experiment, jobs=jobs, listener=listener)
        console.document({"experiment": name, "passed": found.passed, **vars(found)})
        for sentence in found.stale:
            console.note(f"changed since the manifest was written: {sentence}")
        if not found.passed:
            shown = "; ".join(found.mismatches[:3]) + (" …" if len(found.mismatches) > 3 else "")
            raise MismatchError(
                f"{name} does not agree with its manifest in {len(found.mismatches)} places: {shown}. "
                f"If the change is meant, record it with 'clpv run {name} --record'."
            )
        close = f", {found.within} within 1e-6" if found.within else ""
        console.result(f"{name} verified: {found.bitwise} of {found.stages} stages bit for bit{close}.")

    @verb
    def new(
        name: Annotated[str, typer.Argument(help="Name of the experiment: letters, digits, dash, dot, underscore.")],
        template: Annotated[str, typer.Option(help="What to start from.")] = "lasa",
        sets: Sets = None,
        json: Json = False,
        debug: Debug = False,
    ) -> None:
        """Make a new experiment from a template."""
        from pipeline import views
        from pipeline.console import Console

        views.create(open_project(references), Console(json=json), name, template, templates(), sets or ())

    @verb
    def gc(
        dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would go, and remove nothing.")] = False,
        json: Json = False,
        debug: Debug = False,
    ) -> None:
        """Remove results that no experiment refers to any more."""
        from pipeline import views
        from pipeline.console import Console

        views.collect_garbage(open_project(references), Console(json=json), names(None), dry_run=dry_run)

    @verb
    def doctor(json: Json = False, debug: Debug = False) -> None:
        """Check this machine: Python, libraries, store, workers."""
        from pipeline.console import Console
        from pipeline.doctor import examine

        console = Console(json=json)
        checks = examine(open_project(references))
        console.table([{"check": c.name, "": "ok" if c.passed else "FAILED", "found": c.found} for c in checks])
        console.document({"passed": all(c.passed for c in checks), "checks": [vars(c) for c in checks]})
        failed = [c for c in checks if not c.passed]
        for check in failed:
            console.error(f"{check.name}: {check.remedy}")
        if failed:
            raise typer.Exit(EXIT_FAILED)
