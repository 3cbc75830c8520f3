"""The console script ``clpv``: the generic verbs for the table of stages, those named after stages, those that show."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli import (
    Debug,
    DryRun,
    Force,
    Jobs,
    Json,
    Name,
    Quiet,
    Seed,
    Sets,
    Verbose,
    add_bring_up,
    add_verbs,
    bring_up,
    complete_name,
    friendly,
    open_project,
)
from stages import STAGES

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"max_content_width": 110},
    rich_markup_mode=None,  # plain help: rich would double the time that --help takes
    help="From recorded dual-arm demonstrations to a stable motion policy: fitted, tried, measured, reproducible.",
    epilog="Exit codes: 0 done; 1 data or execution failed; 2 usage; 3 not up to date; 4 verification mismatch.",
)

VERBS = {
    "fit": ("dynamics", "Fit the policy: midpoint, mixture and dynamics."),
    "rollout": ("rollout", "Run the policy in simulation, up to the roll-outs."),
    "eval": ("evaluate", "Bring an experiment up to its metrics, and show them."),
}


def templates() -> dict[str, str]:
    """Experiment files to start from, by name."""
    from importlib.resources import files

    entries = sorted((files("stages") / "templates").iterdir(), key=lambda entry: entry.name)
    return {
        entry.name.removesuffix(".toml"): entry.read_text(encoding="utf-8")
        for entry in entries
        if entry.name.endswith(".toml")
    }


SEEING = ("report", "inspect")
"""Verbs that show what a run has given."""

add_verbs(app, STAGES, templates, SEEING)


@app.command()
@friendly
def ingest(
    name: Name,
    sources: Annotated[
        list[str] | None, typer.Argument(help="Recordings; left.bag+right.bag is one of two files.")
    ] = None,
    left: Annotated[str | None, typer.Option(metavar="TOPIC[:PATH]", help="Where the left arm's pose is.")] = None,
    right: Annotated[str | None, typer.Option(metavar="TOPIC[:PATH]", help="Where the right arm's pose is.")] = None,
    point: Annotated[
        str | None, typer.Option(metavar="TOPIC[:PATH]", help="A single point's pose, for one arm.")
    ] = None,
    left_wrench: Annotated[str | None, typer.Option(metavar="TOPIC[:PATH]", help="The left arm's force.")] = None,
    right_wrench: Annotated[str | None, typer.Option(metavar="TOPIC[:PATH]", help="The right arm's force.")] = None,
    urdf: Annotated[str | None, typer.Option(metavar="FILE", help="Robot description, for TOPIC:fk(LINK).")] = None,
    clock: Annotated[str | None, typer.Option(help="auto, header or log.")] = None,
    scale: Annotated[float | None, typer.Option(help="To metres: 0.001 for millimetres.")] = None,
    divide: Annotated[str | None, typer.Option(help="pauses, times:3.5,8 or topic:/recording.")] = None,
    test: Annotated[
        list[str] | None, typer.Option(metavar="SOURCE", help="A source to test on, not to learn from.")
    ] = None,
    recover: Annotated[bool, typer.Option("--recover", help="Accept what an unfinished recording holds.")] = False,
    replace: Annotated[bool, typer.Option("--replace", help="Make an experiment of this name anew.")] = False,
    sets: Sets = None,
    seed: Seed = None,
    jobs: Jobs = None,
    force: Force = None,
    dry_run: DryRun = False,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Read demonstrations; with sources, make the experiment."""
    from pipeline.console import Console
    from pipeline.errors import UsageError
    from stages.ingest.create import Selections

    console = Console(json=json, quiet=quiet, verbose=verbose)
    selections = Selections(
        left=left,
        right=right,
        point=point,
        left_wrench=left_wrench,
        right_wrench=right_wrench,
        urdf=urdf,
        clock=clock,
        scale=scale,
        recover=recover or None,
    )
    if sources:
        from stages.commands import ingest_recordings

        if seed is not None or force or dry_run:
            raise UsageError("--seed, --force and --dry-run go with an experiment that exists: leave out the sources.")
        ingest_recordings(
            open_project(STAGES),
            console,
            name,
            sources,
            selections,
            test=test or (),
            divide=divide,
            sets=sets or (),
            anew=replace,
        )
        return
    if selections.given() or divide or test or replace:
        raise UsageError("--left, --right and the like go with sources: add the recordings, e.g. demo1.bag demo2.bag.")
    bring_up(STAGES, console, name, "ingest", sets=sets, seed=seed, jobs=jobs, force=force, dry_run=dry_run)


@app.command()
@friendly
def info(
    file: Annotated[str, typer.Argument(help="A recording: a file or a folder.")],
    recover: Annotated[bool, typer.Option("--recover", help="Look at what an unfinished recording holds.")] = False,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Show what is in a recording, and how to ingest it."""
    from pathlib import Path

    from pipeline.console import Console
    from stages.commands import show_information

    show_information(Console(json=json), Path(file), recover=recover)


@app.command()
@friendly
def teleop(
    name: Annotated[str, typer.Argument(help="Of the dataset: datasets/NAME.")],
    count: Annotated[int, typer.Option(min=1, help="How many demonstrations.")] = 7,
    master: Annotated[str, typer.Option(help="simulated, keyboard, gamepad, or replay:FILE.")] = "simulated",
    replace: Annotated[bool, typer.Option("--replace", help="Record over what is there.")] = False,
    sets: Sets = None,
    seed: Seed = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Record demonstrations: one master leads two arms."""
    from pipeline.console import Console
    from stages.demonstrate import record_demonstrations

    kind, _, file = master.partition(":")
    chosen = [f'master.kind="{kind}"', *([f'master.file="{file}"'] if file else [])]
    record_demonstrations(
        open_project(STAGES),
        Console(json=json, quiet=quiet),
        name,
        count=count,
        seed=0 if seed is None else seed,
        sets=[*chosen, *(sets or ())],
        anew=replace,
    )


for _verb, (_last, _text) in VERBS.items():
    add_bring_up(app, STAGES, _verb, _last, _text, SEEING)


@app.command()
@friendly
def inspect(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME...", help="Experiments, side by side.", autocompletion=complete_name)
    ],
    rollout: Annotated[
        list[str] | None, typer.Option(metavar="ID", help="Roll-outs, by name; * is a wildcard. [a telling choice]")
    ] = None,
    point: Annotated[list[str] | None, typer.Option(metavar="ID", help="Points of a sweep; * is a wildcard.")] = None,
    save: Annotated[str | None, typer.Option(metavar="FILE.rrd", help="Write a file instead of opening it.")] = None,
    serve: Annotated[bool, typer.Option("--serve", help="Show it in a browser of this machine.")] = False,
    sets: Sets = None,
    seed: Seed = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Open roll-outs in rerun: robots, paths, forces, gate, V."""
    from pipeline.console import Console
    from stages.inspect.command import inspect as show

    console = Console(json=json, quiet=quiet)
    project = open_project(STAGES)
    show(
        project,
        console,
        names,
        rollouts=rollout or (),
        points=point or (),
        save=save,
        serve=serve,
        sets=sets or (),
        seed=seed,
    )


@app.command()
@friendly
def report(
    name: Annotated[
        str | None, typer.Argument(help="Experiment, a folder below runs/.", autocompletion=complete_name)
    ] = None,
    all_: Annotated[bool, typer.Option("--all", help="All that are up to date, and runs/index.html.")] = False,
    output: Annotated[str | None, typer.Option("--output", "-o", help="File to write. [runs/NAME/report.html]")] = None,
    figures: Annotated[bool, typer.Option("--figures", help="The figures also as SVG, PNG and GIF files.")] = False,
    sets: Sets = None,
    seed: Seed = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Write the HTML report: figures, parameters, provenance."""
    from pipeline.console import Console
    from pipeline.errors import UsageError
    from pipeline.experiment import experiment_names
    from stages.figures.reporting import report_all, report_one

    project, console = open_project(STAGES), Console(json=json, quiet=quiet)
    if not all_:
        if name is None:
            raise UsageError("No experiment was named: add its name, as in 'clpv report quickstart', or --all.")
        report_one(project, console, name, output=output, figures=figures, sets=sets or (), seed=seed)
        return
    if name is not None or output is not None or sets or seed is not None:
        raise UsageError("--all writes every report to its own place: leave out NAME, --output, --set and --seed.")
    report_all(project, console, experiment_names(project.root), figures=figures)
