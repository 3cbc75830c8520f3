"""The console script ``clpv``: the generic verbs for the table of stages, the verbs named after stages, and report."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.cli import Debug, Json, Name, Seed, Sets, add_bring_up, add_verbs, friendly, open_project
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
    "ingest": ("ingest", "Read an experiment's demonstrations."),
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


add_verbs(app, STAGES, templates)
for _verb, (_last, _text) in VERBS.items():
    add_bring_up(app, STAGES, _verb, _last, _text)


@app.command()
@friendly
def report(
    name: Name,
    output: Annotated[str | None, typer.Option("--output", "-o", help="File to write. [runs/NAME/report.html]")] = None,
    sets: Sets = None,
    seed: Seed = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Write the HTML report: figures, parameters, provenance."""
    from pathlib import Path

    from pipeline.console import Console
    from stages.figures.experiment import write_report

    project, console = open_project(STAGES), Console(json=json)
    experiment = project.experiment(name, sets or (), seed)
    path = Path(output) if output is not None else experiment.folder / "report.html"
    written = write_report(project, experiment, path)
    shown = path if output is not None else path.relative_to(project.root)
    console.result(f"report: {shown}")
    console.document({"experiment": name, "file": str(shown), "bytes": written})
