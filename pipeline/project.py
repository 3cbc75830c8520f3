"""A project: a folder with runs, the stages, the store. What the command line and the Python face both drive."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import StaleError, UsageError, choices
from pipeline.executors import default_jobs
from pipeline.experiment import Experiment, Point, load_experiment
from pipeline.manifest import Manifest, compose, read_manifest, same_keys, write_manifest
from pipeline.plan import Examined, Examiner, State, plan
from pipeline.runner import Event, Outcome, run
from pipeline.stage import Stage, load
from pipeline.store import FOLDER, Store


@dataclass(frozen=True, kw_only=True)
class Project:
    """A folder with ``runs/<name>/experiment.toml`` and the stages that its experiments go through.

    Attributes:
        root: the folder.
        stages: import string -> stage, in order.
        package: the top-level package of the stages.
    """

    root: Path
    stages: Mapping[str, Stage]
    package: str

    @classmethod
    def open(cls, root: Path, references: Sequence[str]) -> Project:
        """A project whose stages are named by import strings."""
        stages = {reference: load(reference) for reference in references}
        return cls(root=root, stages=stages, package=references[0].partition(".")[0])

    @property
    def store(self) -> Store:
        """The project's store."""
        return Store(folder=self.root / FOLDER)

    @property
    def last(self) -> Stage:
        """The last stage."""
        return list(self.stages.values())[-1]

    def experiment(self, name: str, sets: Iterable[str] = (), seed: int | None = None) -> Experiment:
        """An experiment of the project. Raises UsageError, ParameterError."""
        return load_experiment(self.root, name, list(self.stages.values()), sets, seed)

    def upto(self, last: str) -> dict[str, Stage]:
        """The stages up to one, which is included."""
        names = [stage.name for stage in self.stages.values()]
        return dict(list(self.stages.items())[: names.index(last) + 1])

    def stage(self, name: str) -> Stage:
        """A stage by its name. Raises UsageError."""
        names = {stage.name: stage for stage in self.stages.values()}
        if name not in names:
            raise UsageError(f"There is no stage {name!r}; {choices(name, names)}")
        return names[name]

    def examiner(self, experiment: Experiment, store: Store | None = None) -> Examiner:
        """Holds the experiment's stages against a store (the project's own, unless one is given) and its manifest."""
        return Examiner(self.root, store or self.store, read_manifest(experiment))

    def plan(self, experiment: Experiment, last: str, force: Iterable[str] = ()) -> list[Examined]:
        """State of every stage up to `last` at every point."""
        stages = list(self.upto(last).values())
        return plan(experiment, stages, self.examiner(experiment), frozenset(force))

    def bring_up(
        self,
        experiment: Experiment,
        last: str,
        *,
        jobs: int | None = None,
        force: Iterable[str] = (),
        listener: Callable[[Event], None] = lambda event: None,
        store: Store | None = None,
    ) -> list[Outcome]:
        """Run what is not up to date, up to the stage `last`."""
        return run(
            experiment,
            self.upto(last),
            self.examiner(experiment, store),
            jobs=default_jobs() if jobs is None else jobs,
            force=frozenset(force),
            listener=listener,
            package=self.package,
        )

    def artifacts(self, experiment: Experiment, stage: str) -> list[tuple[Point, dict[str, Path]]]:
        """Files that a stage wrote, by artifact name, for every point. Raises StaleError where it has not run."""
        found = []
        for examined in self.plan(experiment, stage):
            if examined.state is not State.CACHED:
                raise StaleError(
                    f"{experiment.name} is not up to date (stage {examined.stage.name} at {examined.point.id} is "
                    f"{examined.state}): run '{experiment.command('run')}' first."
                )
            if examined.stage.name == stage and examined.record is not None:
                outputs = self.store.outputs(examined.record)
                found.append((examined.point, {name: self.store.path(a.digest) for name, a in outputs.items()}))
        return found

    def rows(self, outcomes: Iterable[Outcome], stage: Stage) -> list[dict[str, Any]]:
        """Rows of a stage's table at all points together, each with its point."""
        if stage.rows is None:
            return []
        rows: list[dict[str, Any]] = []
        for outcome in outcomes:
            if outcome.stage == stage.name:
                files = {name: self.store.path(a.digest) for name, a in self.store.outputs(outcome.record).items()}
                rows.extend({"point": outcome.point.id, **row} for row in stage.rows(files))
        return rows


def manifest_of(outcomes: Iterable[Outcome]) -> Manifest:
    """The manifest that a finished run amounts to."""
    return compose((o.point.id, o.point.overrides, o.stage, o.record) for o in outcomes)


def keep_manifest(experiment: Experiment, outcomes: Sequence[Outcome], *, record: bool) -> str:
    """Write the experiment's manifest where that is due; returns a word for what was done.

    ``written``; ``unchanged``; ``overridden`` (options changed the experiment: the file is left as it is); ``differs``
    (same keys, other bytes, as on another processor: the file is kept unless `record`).
    """
    if experiment.overridden:
        return "overridden"
    new, old = manifest_of(outcomes), read_manifest(experiment)
    if old is not None:
        if new.text(experiment.name) == old.text(experiment.name):
            return "unchanged"
        if same_keys(new, old) and not record:
            return "differs"
    write_manifest(experiment, new)
    return "written"
