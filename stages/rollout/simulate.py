"""Roll-outs in the kinematic world: controllers x conditions x methods of avoidance x starts. Paper Figs. 2 to 4.

A case that is disturbed is first run undisturbed, as its disturbances begin where its own undisturbed path says. Not
here: one case (`run.py`), metrics (`stages/evaluate`) and files (`stage.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.method import margin_of, resolve_avoidance
from stages.policy.avoidance.parameters import Avoidance
from stages.policy.avoidance.scene import refusal
from stages.policy.avoidance.scratch import IGNORE
from stages.policy.field import field_of
from stages.policy.policy import Rules
from stages.rollout.cases import check, check_starts, method_name, methods_of, resolve, step_limit
from stages.rollout.disturbances import pushes_of
from stages.rollout.notices import notices
from stages.rollout.parameters import Condition, RolloutParameters
from stages.rollout.results import Rollout, Runner, Simulated
from stages.rollout.run import Path, refused, run_case
from stages.rollout.scenes import Scene, Scenes
from stages.trajectory import Trajectory, frozen
from stages.world.disturbance import Pushes, no_pushes

Draw = Callable[..., np.random.Generator]
"""Names -> the random numbers that belong to them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Case:
    runner: Runner
    condition: Condition
    method: Avoidance
    location: str
    start: Trajectory
    number: int


def simulate(
    model: LpvDs,
    starts: Sequence[Trajectory],
    parameters: RolloutParameters,
    top_speed: float,
    progress: Callable[[int, int], None] | None = None,
    draw: Draw | None = None,
) -> Simulated:
    """Run every case: controllers x conditions x methods of avoidance x starts x scenes, in this order.

    Paper eqs. (6), (9)-(12), (22).

    Args:
        model: the learned system.
        starts: demonstrations; each case starts at the first sample of one, and by default keeps its clock.
        parameters: the cases.
        top_speed: of the demonstrations that were learned from, m/s.
        progress: called after each case with the number of finished cases and of all.
        draw: random numbers by name, of scenes and noise; none: those of the seed 0.

    Raises:
        ParameterError: a parameter has no meaning, or not for this model.
        DataError: a start has another dimension than the model, two starts have one name, or nothing ever moved.
    """
    draw = draw_from(0) if draw is None else draw
    check(parameters, model.dimension)
    check_starts(starts, model.dimension, top_speed)
    clocks = {start.name: start.step if parameters.dt is None else parameters.dt for start in starts}
    longest = max(clocks.values(), default=1.0)
    runners = resolve(parameters, top_speed, longest)
    for number, method in enumerate(parameters.avoidances):
        resolve_avoidance(method, top_speed, longest, math.inf, f"rollout.avoidances.{number}")
    field = field_of(model, parameters.integrator)
    scenes = Scenes(model, starts, parameters, draw)
    names = _Names(several=len({start.dataset for start in starts}) > 1)
    undisturbed: dict[tuple[str, str], Path] = {}

    def run(case: _Case, scene: Scene | None, pushes: Pushes) -> Path:
        dt, start = clocks[case.start.name], case.start.position[0]
        real = seen = None
        avoidance, recover = IGNORE, bool(getattr(case.method, "recover", False))
        if scene is not None:
            real, seen = scene.shapes, scene.seen_by(case.method)
            outcome = refusal(real, seen, margin_of(case.method), start, model.goal, recover=recover)
            if outcome is not None:
                return refused(start, dt, real, outcome)
            avoidance = resolve_avoidance(case.method, top_speed, dt, case.runner.v_max, case.location)
        return run_case(
            Rules(field, case.runner.coupling, avoidance),
            seen,
            real,
            pushes,
            start,
            dt=dt,
            steps=step_limit(parameters.max_duration, case.start.duration, dt),
            stop_distance=parameters.stop_distance,
            recover=recover,
        )

    def path_of(case: _Case, scene: Scene | None) -> Path:
        known = (case.runner.label, case.start.name)
        path = undisturbed.get(known) if scene is None else None
        if path is None:
            path = run(case, scene, no_pushes(model.dimension))
            if scene is None:
                undisturbed[known] = path
        if not case.condition.disturbances or path.p_hat.shape[0] == 1:
            return path
        place = (case.condition.name, case.start.name, scene.name if scene is not None else "")
        pushes = pushes_of(
            case.condition.disturbances,
            path.p_hat,
            path.dt,
            step_limit(parameters.max_duration, case.start.duration, path.dt),
            lambda number: draw("noise", *place, number),
        )
        return run(case, scene, pushes)

    cases = list(_cases(runners, parameters, starts))
    rollouts = []
    for case in cases:
        scene = scenes.of(case.condition, case.start, case.number)
        path = path_of(case, scene)
        rollouts.append(_rollout(names.of(case), case, scene, path, model))
        if progress is not None:
            progress(len(rollouts), len(cases))
    found = Simulated(rollouts=tuple(rollouts), scenes=tuple(scenes.used), runners=tuple(runners))
    return replace(found, notices=tuple(notices(found, parameters)))


def draw_from(seed: int) -> Draw:
    """Random numbers by name, where no experiment gives them."""

    def draw(*names: str) -> np.random.Generator:
        return np.random.default_rng([seed, *"/".join(names).encode()])

    return draw


def _cases(runners: Sequence[Runner], parameters: RolloutParameters, starts: Sequence[Trajectory]) -> Iterator[_Case]:
    """All cases, in order."""
    for runner in runners:
        for condition in parameters.conditions:
            count = condition.scenes.count if condition.scenes is not None else 1
            for location, method in methods_of(condition, parameters):
                for start in starts:
                    for number in range(count):
                        yield _Case(
                            runner=runner,
                            condition=condition,
                            method=method,
                            location=location,
                            start=start,
                            number=number,
                        )


@dataclass(frozen=True, kw_only=True)
class _Names:
    """How roll-outs are named: with their data set where there are several."""

    several: bool

    def of(self, case: _Case) -> str:
        """Unique among the cases of a stage."""
        among = bool(case.condition.obstacles) or case.condition.scenes is not None
        demo = f"{case.start.dataset}/{case.start.demo}" if self.several else case.start.demo
        parts = [case.runner.label, *([method_name(case.method)] if among else []), case.condition.name, demo]
        if case.condition.scenes is not None and case.condition.scenes.count > 1:
            parts.append(str(case.number))
        return "/".join(parts)


def _rollout(name: str, case: _Case, scene: Scene | None, path: Path, model: LpvDs) -> Rollout:
    return Rollout(
        rollout=name,
        controller=case.runner.kind,
        mode=case.runner.mode,
        avoidance="none" if scene is None else method_name(case.method),
        condition=case.condition.name,
        dataset=case.start.dataset,
        demo=case.start.demo,
        split=case.start.split,
        scene="" if scene is None else scene.name,
        time=frozen(np.arange(path.x.shape[0]) * path.dt),
        x=path.x,
        p_hat=path.p_hat,
        gate=path.gate,
        lyapunov=frozen(model.lyapunov(path.x)),
        clearance=path.clearance,
        status=path.status,
        disturbed=path.disturbed,
        missed=path.missed,
        outcome=path.outcome,
    )
