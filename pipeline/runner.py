"""Carries out an experiment: every stage of every point whose key the store does not know, shared work once.

Keys of later stages depend on what earlier ones give, so points advance one stage at a time; a stage that gives the
same bytes as before leaves the later ones cached. Events tell a console what happens.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field
from typing import Any

from pipeline import code
from pipeline.compiled import use_cache_for
from pipeline.errors import ClpvError, ExecutionError
from pipeline.executors import make_executor
from pipeline.experiment import Experiment, Point
from pipeline.plan import Examined, Examiner, State
from pipeline.stage import Stage, load
from pipeline.store import Artifact
from pipeline.worker import Task, execute


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened: ``started``, ``done``, ``cached``, ``warning`` or ``failed`` for a stage at a point."""

    kind: str
    point: str
    stage: str
    message: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One stage of one point, finished.

    Attributes:
        cached: whether nothing had to be computed for this point: the store had it, or another point shared it.
        record: the action record.
        seconds: of computing, 0 where cached.
    """

    point: Point
    stage: str
    cached: bool
    record: Mapping[str, Any]
    seconds: float


@dataclass(kw_only=True)
class _Progress:
    """How far a point has come."""

    point: Point
    next: int = 0
    artifacts: dict[str, Artifact] = field(default_factory=dict)


def run(
    experiment: Experiment,
    stages: Mapping[str, Stage],
    examiner: Examiner,
    *,
    jobs: int = 1,
    force: frozenset[str] = frozenset(),
    listener: Callable[[Event], None] = lambda event: None,
    package: str,
) -> list[Outcome]:
    """Bring every point of an experiment up to the last of `stages` (import string -> stage, in order).

    Returns outcomes in the order of points and stages. After a failure the other points are finished first; then the
    failure is raised: a ClpvError that names the stage and the point.
    """
    scheduler = _Scheduler(experiment, stages, examiner, force, listener, package, min(jobs, len(experiment.points)))
    return scheduler.run()


class _Scheduler:
    """State of one run; see `run`."""

    def __init__(
        self,
        experiment: Experiment,
        stages: Mapping[str, Stage],
        examiner: Examiner,
        force: frozenset[str],
        listener: Callable[[Event], None],
        package: str,
        jobs: int,
    ) -> None:
        self.experiment = experiment
        self.references = list(stages)
        self.stages = list(stages.values())
        self.examiner = examiner
        self.store = examiner.store
        self.force = force
        self.listener = listener
        self.package = package
        self.jobs = jobs
        self.executor: Executor | None = None
        self.running: dict[Future[tuple[dict[str, Any], float]], str] = {}
        self.waiters: dict[str, list[_Progress]] = {}
        self.finished: dict[str, Mapping[str, Any]] = {}
        self.outcomes: dict[tuple[str, str], Outcome] = {}
        self.failures: dict[str, tuple[ClpvError, str]] = {}

    def run(self) -> list[Outcome]:
        self.store.prepare()
        complete = False
        try:
            for point in self.experiment.points:
                self._advance(_Progress(point=point))
            while self.running:
                done, _ = wait(self.running, return_when=FIRST_COMPLETED)
                for future in [future for future in self.running if future in done]:
                    self._collect(future)
            complete = True
        finally:
            if self.executor is not None:
                # A pool that broke may hold a worker that was just being started: nobody would end it, and waiting for
                # it would never end either.
                _shut_down(self.executor, kill=not complete or bool(getattr(self.executor, "_broken", False)))
        if self.failures:
            raise self._failure()
        order = [(point.id, stage.name) for point in self.experiment.points for stage in self.stages]
        return [self.outcomes[place] for place in order]

    def _advance(self, progress: _Progress) -> None:
        """Take a point through all that is known, and submit the first stage that is not."""
        while progress.next < len(self.stages):
            stage = self.stages[progress.next]
            try:
                found = self.examiner.examine(stage, progress.point, progress.artifacts)
            except ClpvError as error:
                self._fail(error, progress.point.id, stage.name)
                return
            assert found.key is not None  # examine always computes it
            key = found.key.value
            if key in self.finished:
                self._settle(progress, self.finished[key])
            elif key in self.waiters:
                self.waiters[key].append(progress)
                return
            elif found.record is not None and stage.name not in self.force:
                self.finished[key] = found.record
            else:
                self._submit(progress, found)
                return

    def _submit(self, progress: _Progress, found: Examined) -> None:
        stage, point = found.stage, progress.point
        assert found.key is not None
        if found.state is State.DAMAGED:
            self._say("warning", point.id, stage.name, f"{found.reasons[0]}: computing it again.")
        if self.executor is None:
            self._start()
        assert self.executor is not None
        task = Task(
            reference=self.references[progress.next],
            parameters=point.parameters[stage.name],
            inputs={name: progress.artifacts[name] for name in stage.inputs},
            sources=found.sources,
            seed=point.seed if stage.random else None,
            key=found.key.value,
            components=found.key.components,
            definitions=found.key.definitions,
            files=code.files(found.key.definitions),
            root=self.examiner.root,
            store=self.store,
            point=point.id,
        )
        self._say("started", point.id, stage.name)
        self.waiters[task.key] = [progress]
        try:
            self.running[self.executor.submit(execute, task)] = task.key
        except (BrokenExecutor, OSError):  # OSError: a worker has just died, and its pool has not noticed
            del self.waiters[task.key]
            self._fail(_dead_worker(stage.name, point.id), point.id, stage.name)

    def _start(self) -> None:
        """Set the cache of compiled code, and compile in this process before workers that would do it each."""
        use_cache_for(self.package)
        for point in self.experiment.points:
            for stage in self.stages:
                # Read now, as long as workers have imported nothing: they notice what is edited afterwards.
                code.reached(stage.modules(point.parameters[stage.name]))
        if self.jobs > 1:
            for stage in self.stages:
                if stage.warm:
                    load(stage.warm)([point.parameters[stage.name] for point in self.experiment.points])
        self.executor = make_executor(self.jobs)

    def _collect(self, future: Future[tuple[dict[str, Any], float]]) -> None:
        key = self.running.pop(future)
        waiting = self.waiters.pop(key)
        first = waiting[0]
        stage = self.stages[first.next].name
        try:
            record, seconds = future.result()
        except (ClpvError, BrokenExecutor) as error:
            for progress in waiting:
                point = progress.point.id
                self._fail(error if isinstance(error, ClpvError) else _dead_worker(stage, point), point, stage)
            return
        for sentence in record["warnings"]:
            self._say("warning", first.point.id, stage, sentence)
        self._check_reproduced(first.point.id, stage, record)
        self.finished[key] = record
        self._settle(first, record, seconds)
        self._advance(first)
        for progress in waiting[1:]:
            self._advance(progress)

    def _settle(self, progress: _Progress, record: Mapping[str, Any], seconds: float | None = None) -> None:
        """Take a point past a stage that was computed for it in `seconds`, or (none) did not have to be."""
        stage = self.stages[progress.next]
        place = (progress.point.id, stage.name)
        self.outcomes[place] = Outcome(
            point=progress.point, stage=stage.name, cached=seconds is None, record=record, seconds=seconds or 0.0
        )
        progress.artifacts.update(self.store.outputs(record))
        progress.next += 1
        self._say("cached" if seconds is None else "done", *place, seconds=seconds or 0.0)

    def _check_reproduced(self, point: str, stage: str, record: Mapping[str, Any]) -> None:
        """Report where this run's bytes differ from those that the store kept for the same key."""
        differing = record.get("differs")
        if differing is None:
            return
        names = ", ".join(differing["artifacts"])
        if differing["same_machine"]:
            message = f"reproducibility fault: {names} came out with other bytes than before on the same machine."
        else:
            message = f"{names} came out with other bytes than before on another machine."
        self._say("warning", point, stage, message)

    def _fail(self, error: ClpvError, point: str, stage: str) -> None:
        text = str(error) if isinstance(error, ExecutionError) else f"stage {stage} at {point}: {error}"
        self.failures[point] = error, text
        self._say("failed", point, stage, text)

    def _failure(self) -> ClpvError:
        first, text = next(self.failures[point.id] for point in self.experiment.points if point.id in self.failures)
        if len(self.experiment.points) > 1:
            count = len(self.failures)
            failure = _SweepError(f"{count} of {len(self.experiment.points)} points failed; the first: {text}")
            failure.exit_code = first.exit_code
            failure.__cause__ = first
            return failure
        return first

    def _say(self, kind: str, point: str, stage: str, message: str = "", seconds: float = 0.0) -> None:
        self.listener(Event(kind=kind, point=point, stage=stage, message=message, seconds=seconds))


def _dead_worker(stage: str, point: str) -> ExecutionError:
    message = f"stage {stage} at {point}: its worker process died; run again, finished work is kept."
    return ExecutionError(message, stage, point)


class _SweepError(ClpvError):
    """Points of a sweep failed; the first failure is its cause, and its exit code is that of the first."""


def _shut_down(executor: Executor, *, kill: bool) -> None:
    """Let an executor go; where the run was interrupted or a worker died, end its workers at once."""
    if kill:
        processes = list((getattr(executor, "_processes", None) or {}).values())
        executor.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
    else:
        executor.shutdown()
