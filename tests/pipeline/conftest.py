"""A toy project: a package of three small stages, written into a folder of its own, for the engine to work on.

::

    read (an external file) ─> fit (two kinds, random) ─> score (fails on demand)

Every test may edit the package's modules; `Toy.open` imports them anew.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from pipeline import code, runner, validation
from pipeline.executors import ONE_THREAD
from pipeline.project import Project
from pipeline.runner import Event, Outcome

HERE = Path(__file__).resolve().parents[2]

REFERENCES = ("toy.read:STAGE", "toy.fit:STAGE", "toy.score:STAGE")

MODULES = {
    "__init__": '"""A toy package of stages."""',
    "parameters": '''
        """Declarations."""

        from typing import Annotated, Literal

        from pydantic import Discriminator

        from pipeline.stage import Count, NonNegative, Positive, UnitInterval, Whole, parameters


        @parameters
        class ReadParameters:
            file: str = "numbers.txt"
            scale: Positive = 1.0


        @parameters
        class MeanParameters:
            kind: Literal["mean"] = "mean"
            offset: float = 0.0
            noise: NonNegative = 0.0
            weights: tuple[float, ...] | None = None
            replicate: Whole = 0


        @parameters
        class MedianParameters:
            kind: Literal["median"] = "median"
            rounds: Count = 1


        @parameters
        class Near:
            kind: Literal["near"] = "near"
            radius: Positive = 1.0


        @parameters
        class Far:
            kind: Literal["far"] = "far"
            distance: Positive = 5.0
            share: UnitInterval = 0.5


        @parameters
        class ScoreParameters:
            digits: Whole = 6
            label: str = "plain"
            mode: Literal["paper", "robust"] = "robust"
            act: str = ""
            cases: tuple[Annotated[Near | Far, Discriminator("kind")], ...] = (Near(),)
            strict: bool = True
    ''',
    "arithmetic": '''
        """Helpers that the kinds share, and one that nobody uses."""

        FACTOR = 1.0


        def total(values):
            """Sum up."""
            result = 0.0
            for value in values:
                result += value  # one by one
            return result * FACTOR


        def unused():
            return None
    ''',
    "mean": '''
        """The mean."""


        def estimate(values, parameters, generator):
            from toy.arithmetic import total

            found = total(values) / len(values) + parameters.offset
            return found + parameters.noise * generator.standard_normal()
    ''',
    "median": '''
        """The median."""

        from . import ordering


        def estimate(values, parameters, generator):
            return ordering.middle(values)
    ''',
    "ordering": '''
        """Order."""


        def middle(values):
            return sorted(values)[len(values) // 2]
    ''',
    "read": '''
        """Reads numbers."""

        from pipeline.errors import DataError
        from pipeline.stage import Port, Stage
        from toy.parameters import ReadParameters


        def sources(parameters, root):
            return {parameters.file: root / parameters.file}


        def run(context):
            (path,) = context.sources.values()
            try:
                values = [float(line) * context.parameters.scale for line in path.read_text().split()]
            except ValueError as error:
                raise DataError(path.name, f"{error}.") from None
            context.outputs["numbers"].write_text("\\n".join(map(repr, values)))


        STAGE = Stage(
            name="read",
            summary="reads numbers",
            parameters=ReadParameters,
            inputs=(),
            outputs=(Port(name="numbers", filename="numbers.txt"),),
            run=run,
            sources=sources,
            headline=lambda outputs: {"count": len(outputs["numbers"].read_text().split())},
        )
    ''',
    "fit": '''
        """Fits."""

        from pipeline.stage import Port, Stage
        from toy.parameters import MeanParameters, MedianParameters

        IMPLEMENTATIONS = {"mean": "toy.mean:estimate", "median": "toy.median:estimate"}


        def run(context):
            values = [float(line) for line in context.inputs["numbers"].read_text().split()]
            chosen = context.parameters
            estimate = STAGE.implementation(chosen.kind)
            if getattr(chosen, "offset", 0.0) == 13.0:
                context.warn("thirteen is an unlucky offset.")
            context.outputs["model"].write_text(repr(float(estimate(values, chosen, context.generator()))))


        STAGE = Stage(
            name="fit",
            summary="fits a number",
            parameters=MeanParameters | MedianParameters,
            inputs=("numbers",),
            outputs=(Port(name="model", filename="model.txt"),),
            run=run,
            presets={"paper": {"kind": "mean", "offset": 0.5}, "robust": {"kind": "mean"}},
            implementations=IMPLEMENTATIONS,
            libraries=("numpy",),
            random=True,
            headline=lambda outputs: {"model": float(outputs["model"].read_text())},
        )
    ''',
    "score": '''
        """Scores, and misbehaves where it is told to."""

        import os
        import signal
        import time

        from pipeline.stage import Port, Stage
        from toy.parameters import ScoreParameters


        def run(context):
            model = float(context.inputs["model"].read_text())
            text = repr(round(10 * model, context.parameters.digits))
            act = context.parameters.act or os.environ.get("TOY_ACT")  # which is not in the key
            if act == "raise":
                raise ValueError("no score today")
            if act == "die":
                os.kill(os.getpid(), signal.SIGKILL)
            if act == "hang":
                context.outputs["score"].write_text(text[:1])
                os.write(1, b"hanging\\n")
                time.sleep(60)
            if act == "random":
                text += " " + os.urandom(4).hex()
            if act == "forget":
                return
            if act == "link":
                context.outputs["score"].symlink_to(context.inputs["model"])
                return
            if act == "input":
                context.inputs["model"].chmod(0o644)
                context.inputs["model"].write_text("7")
            context.outputs["score"].write_text(text)


        def rows(outputs):
            text = outputs["score"].read_text()
            try:
                value = float(text)
            except ValueError:
                value = None
            return [{"case": name, "score": value, "nothing": None} for name in ("one", "two")]


        def headline(outputs):
            text = outputs["score"].read_text()
            try:
                return {"score": float(text)}
            except ValueError:
                return {"score": float("nan")}


        STAGE = Stage(
            name="score",
            summary="scores the fit",
            parameters=ScoreParameters,
            inputs=("numbers", "model"),
            outputs=(Port(name="score", filename="score.txt"),),
            run=run,
            presets={"paper": {"mode": "paper"}, "robust": {"mode": "robust"}},
            headline=headline,
            rows=rows,
            summarise=lambda rows: [{"rows": len(rows), "score": rows[0]["score"]}],
        )
    ''',
    "cli": '''
        """The command line of the toy."""

        import typer

        from pipeline.cli import add_verbs

        TEMPLATE = """# A toy experiment.
        description = "from the template"
        preset = "robust"
        seed = 0

        [fit]
        kind = "mean"  # or median
        offset = 1.0

        [score]
        cases = [
            { kind = "near" },
            { kind = "far", distance = 2.0 },
        ]
        """

        app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)
        references = ("toy.read:STAGE", "toy.fit:STAGE", "toy.score:STAGE")
        add_verbs(app, references, lambda: {"toy": TEMPLATE, "empty": ""})

        if __name__ == "__main__":
            app(prog_name="toy")
    ''',
}

EXPERIMENT = """\
description = "a try"
preset = "robust"
seed = 0
"""

SWEEP = """\
description = "a sweep"
preset = "robust"

[sweep]
"fit.offset" = [0.0, 1.0, 2.0]
"""


@dataclass
class Toy:
    """The project in `root`; the package lies in ``root/source/toy``."""

    root: Path
    events: list[Event] = field(default_factory=list)

    @property
    def source(self) -> Path:
        return self.root / "source"

    @property
    def objects(self) -> list[Path]:
        return sorted((self.root / "runs" / ".store" / "objects").glob("*/*"))

    def module(self, name: str, text: str) -> None:
        """Write a module of the package."""
        (self.source / "toy" / f"{name}.py").write_text(textwrap.dedent(text).lstrip("\n"))

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace text that stands once in a module."""
        path = self.source / "toy" / f"{name}.py"
        text = path.read_text()
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {name}"
        path.write_text(text.replace(old, new))

    def experiment(self, name: str, text: str) -> Path:
        """Write an experiment file."""
        path = self.root / "runs" / name / "experiment.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    def open(self) -> Project:
        """The project, with its modules imported anew."""
        forget()
        return Project.open(self.root, REFERENCES)

    def run(self, name: str = "try", last: str = "score", **options: Any) -> list[Outcome]:
        """Bring an experiment up to a stage, in this process unless `jobs` says otherwise; keeps the events."""
        self.events = []
        project = self.open()
        experiment = project.experiment(name, options.pop("sets", ()), options.pop("seed", None))
        options.setdefault("jobs", 1)
        return project.bring_up(experiment, last, listener=self.events.append, **options)

    def said(self, kind: str) -> list[str]:
        """Messages of the last run's events of a kind."""
        return [event.message for event in self.events if event.kind == kind]

    @staticmethod
    def computed(outcomes: list[Outcome]) -> list[str]:
        """Stages that were computed, as ``point/stage``."""
        return [f"{o.point.id}/{o.stage}" for o in outcomes if not o.cached]

    def cli(self, *arguments: str) -> Result:
        """A command of the toy's command line, in this process."""
        forget()
        app = importlib.import_module("toy.cli").app
        return CliRunner().invoke(app, list(arguments))

    def command(self, *arguments: str) -> list[str]:
        """The command line of the toy as another process."""
        return [sys.executable, "-m", "toy.cli", *arguments]

    def environment(self) -> dict[str, str]:
        """For another process."""
        paths = os.pathsep.join((str(self.source), str(HERE)))
        return {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", "CLPV_ROOT": str(self.root)}

    def process(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a command as another process."""
        return subprocess.run(
            self.command(*arguments), env=self.environment(), capture_output=True, text=True, timeout=60, check=False
        )


def forget() -> None:
    """Have the toy package imported and read anew."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "toy"]:
        del sys.modules[name]
    importlib.invalidate_caches()
    code._path.cache_clear()
    code._read.cache_clear()
    validation._adapter.cache_clear()


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Toy]:
    """A toy project with the experiments ``try`` and ``many`` (a sweep), and nothing computed."""
    made = Toy(root=tmp_path / "project")
    (made.source / "toy").mkdir(parents=True)
    for name, text in MODULES.items():
        made.module(name, text)
    (made.root / "numbers.txt").write_text("1\n2\n6\n")
    made.experiment("try", EXPERIMENT)
    made.experiment("many", SWEEP)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(str(made.source))
    monkeypatch.setenv("CLPV_ROOT", str(made.root))
    monkeypatch.setenv("CLPV_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    # The engine sets these; they are put back to what they were.
    monkeypatch.setattr(runner, "use_cache_for", lambda package: tmp_path)
    for name in ONE_THREAD:
        monkeypatch.setenv(name, os.environ.get(name, ""))
    yield made
    forget()
