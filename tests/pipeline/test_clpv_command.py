"""The command ``clpv`` itself: its help, what it imports, the committed experiments and templates. Runs no stage."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from pipeline.experiment import experiment_names
from pipeline.project import Project
from stages import STAGES
from stages.cli import VERBS, app, templates

ROOT = Path(__file__).resolve().parents[2]

GENERIC = ["run", "status", "show", "list", "diff", "verify", "new", "gc", "doctor"]
VERB_NAMES = sorted([*VERBS, *GENERIC, "ingest", "info", "teleop", "inspect", "report"])

HELP = """\
Usage: clpv [OPTIONS] COMMAND [ARGS]...

  From recorded dual-arm demonstrations to a stable motion policy: fitted,
  tried, measured, reproducible.

Options:
  --install-completion  Install completion for the current shell.
  --show-completion     Show completion for the current shell, to copy it or
                        customize the installation.
  --help                Show this message and exit.

Commands:
  run      Run what is not up to date, and show the metrics.
  status   Say which stages are up to date, which are stale, and why.
  show     Show an experiment's parameters, artifacts and metrics.
  list     List the experiments with their headline metrics.
  diff     Compare the parameters and metrics of two experiments.
  verify   Recompute an experiment and compare it with its manifest.
  new      Make a new experiment from a template.
  gc       Remove results that no experiment refers to any more.
  doctor   Check this machine: Python, libraries, store, workers.
  ingest   Read demonstrations; with sources, make the experiment.
  info     Show what is in a recording, and how to ingest it.
  teleop   Record demonstrations: one master leads two arms.
  fit      Fit the policy: midpoint, mixture and dynamics.
  rollout  Run the policy in simulation, up to the roll-outs.
  eval     Bring an experiment up to its metrics, and show them.
  inspect  Open roll-outs in rerun: robots, paths, forces, gate, V.
  report   Write the HTML report: figures, parameters, provenance.

  Exit codes: 0 done; 1 data or execution failed; 2 usage; 3 not up to date; 4
  verification mismatch.
"""


@pytest.fixture
def invoke(tmp_path, monkeypatch):
    """Call clpv in this process, in an empty project."""
    monkeypatch.setenv("CLPV_ROOT", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "100")
    return lambda *arguments: CliRunner().invoke(app, list(arguments), prog_name="clpv")


def test_help(invoke):
    result = invoke("--help")
    assert (result.exit_code, result.stdout, result.stderr) == (0, HELP, "")
    assert invoke().exit_code == 2


def test_verbs():
    assert sorted(typer.main.get_command(app).commands) == VERB_NAMES


@pytest.mark.parametrize("verb", VERB_NAMES)
def test_help_of_a_verb(invoke, verb):
    result = invoke(verb, "--help")
    assert result.exit_code == 0
    assert result.stdout.startswith(f"Usage: clpv {verb} ")
    assert "--json" in result.stdout
    assert "--debug" in result.stdout
    if verb in ("run", *VERBS):
        for option in ("--set", "--seed", "--jobs", "--force", "--dry-run", "--record", "--quiet", "--verbose"):
            assert f"{option} " in result.stdout


def test_exit_codes_are_the_documented_ones():
    from pipeline import errors

    documented = dict(re.findall(r"(\d) ([a-z ]+)", app.info.epilog))
    assert {int(code) for code in documented} == {
        errors.EXIT_DONE,
        errors.EXIT_FAILED,
        errors.EXIT_USAGE,
        errors.EXIT_STALE,
        errors.EXIT_MISMATCH,
    }


HEAVY = (
    *("cvxpy", "numba", "pybullet", "rerun", "pandas", "pydantic", "numpy", "scipy", "rich", "pyarrow"),
    *("matplotlib", "plotille"),
)


def test_help_imports_nothing_heavy(tmp_path):
    text = (
        "import sys\nfrom stages.cli import app\n"
        "try: app(['--help'], prog_name='clpv')\nexcept SystemExit as end: assert not end.code\n"
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("Usage: clpv ")
    assert done.stderr == "[]\n"


def test_the_installed_command_works_from_a_folder_below(tmp_path):
    command = Path(sys.executable).with_name("clpv")
    assert command.exists()
    environment = {name: text for name, text in os.environ.items() if name != "CLPV_ROOT"}
    done = subprocess.run(
        [command, "status", "no-such-experiment"],
        cwd=ROOT / "runs" / "quickstart",
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: There is no experiment 'no-such-experiment'; ")
    assert "quickstart" in done.stderr


@pytest.mark.parametrize("name", experiment_names(ROOT))
def test_committed_experiments_resolve_and_say_what_they_are(name):
    experiment = Project.open(ROOT, STAGES).experiment(name)
    assert experiment.description
    assert 'preset = "' in (experiment.folder / "experiment.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sorted(templates()))
def test_templates_make_experiments(invoke, tmp_path, name):
    result = invoke("new", "mine", "--template", name, "--set", "ingest.motion=Sine", "--set", "preset=paper")
    assert result.exit_code == 0, result.stderr
    assert result.stdout == "runs/mine/experiment.toml written: edit it, then 'clpv run mine'.\n"
    experiment = Project.open(tmp_path, STAGES).experiment("mine")
    assert (experiment.preset, experiment.points[0].parameters["ingest"].motion) == ("paper", "Sine")
    assert invoke("status", "mine").exit_code == 0
    assert [path.name for path in tmp_path.rglob("*")] == ["runs", "mine", "experiment.toml"]


ERRORS = {
    ("run", "quickstrat"): (2, "There is no experiment 'quickstrat'; did you mean 'quickstart'? Valid: quickstart."),
    ("run", "quickstart", "--set", "mixture.alhpa=3"): (2, "mixture.alhpa: unknown parameter; did you mean 'alpha'? "),
    ("run", "quickstart", "--set", "mixture.alpha=nan"): (2, "mixture.alpha: should be a finite number, not NaN."),
    ("run", "quickstart", "--set", "mixutre.alpha=3"): (
        2,
        "mixutre.alpha: unknown stage or key; did you mean 'mixture'",
    ),
    ("run", "quickstart", "--set", "rollout.controllers.0.kind=clpdvs"): (
        2,
        "rollout.controllers.0.kind: there is no kind 'clpdvs'; did you mean 'clpvds'? Valid: clpvds, lpvds.",
    ),
    ("run", "quickstart", "--set", "rollout.conditions.1.disturbances.0.at_fraction=2"): (
        2,
        "rollout.conditions.1.disturbances.0.at_fraction: should be less than or equal to 1, not 2.",
    ),
    ("run", "quickstart", "--set", "rollout.starts=tset"): (
        2,
        "rollout.starts: must be 'test', 'train' or 'all', not ",
    ),
    ("run", "quickstart", "--set", "ingest.motion=Agnle"): (
        2,
        "ingest.motion: there is no motion 'Agnle'; did you mean",
    ),
    ("fit", "quickstart", "--force", "fit"): (2, "There is no stage 'fit'; "),
    ("show", "quickstart", "--stage", "evaluate"): (
        3,
        "Stage evaluate of quickstart at main is waiting: run 'clpv run ",
    ),
    ("new", "a/b"): (2, "'a/b' is no name for an experiment: "),
    ("new", "quickstart"): (2, "runs/quickstart exists already: "),
    ("verify", "quickstart"): (2, "runs/quickstart has no manifest to verify against: "),
}


@pytest.mark.parametrize("arguments", ERRORS, ids=" ".join)
def test_an_error_is_one_sentence(invoke, tmp_path, arguments):
    folder = tmp_path / "runs" / "quickstart"
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "runs" / "quickstart" / "experiment.toml", folder)
    code, sentence = ERRORS[arguments]
    result = invoke(*arguments)
    assert (result.exit_code, result.stdout) == (code, "")
    assert result.stderr.startswith(f"error: {sentence}")
    assert result.stderr.count("\n") == 1
    left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {"experiment.toml"}
