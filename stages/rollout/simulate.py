"""Roll-outs in the kinematic world: controllers x conditions x starts. Paper Figs 2 and 3, eqs. (6) and (9)-(12).

A displacement is added once, where the arc length of the controller's OWN undisturbed executed path reaches a fraction
of its total. The loop alternates the policy (`stages/policy`) and the world (`stages/world`) and writes what happens
into arrays that were made before it starts. Not here: metrics (`stages/evaluate`) and files (`stage.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stages.compiled import compiled
from stages.dynamics.lpvds import LpvDs
from stages.policy.coupled import Coupling, act, distance, observe
from stages.policy.field import Field, field_of, workspace
from stages.policy.outcome import Outcome
from stages.rollout.cases import Runner, check, check_starts, displacement_sample, resolve, step_limit
from stages.rollout.parameters import Condition, Mode, RolloutParameters
from stages.trajectory import Array, Trajectory, frozen
from stages.world.kinematic import carry_out, displace

FAR = 1e3
"""A state this many times farther from the goal than its start has diverged."""

NEVER = -1

_OUTCOMES = (Outcome.ARRIVED, Outcome.TIMEOUT, Outcome.DIVERGED)
_ARRIVED, _TIMEOUT, _DIVERGED = range(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rollout:
    """One case, run; n samples, the first at the start.

    Attributes:
        rollout: unique name, e.g. ``clpvds-robust/cond1/4``.
        controller: ``lpvds`` or ``clpvds``.
        mode: ``paper`` or ``robust``; of ``lpvds``, the run's own.
        avoidance: kind of obstacle avoidance; ``none``.
        condition: its name.
        dataset, demo, split: of the demonstration that it starts from.
        time: array, shape (n,), seconds.
        x: array, shape (n, d), metres: the state of the learned system.
        p_hat: array, shape (n, d), metres: the executed state; of ``lpvds``, x itself.
        gate: array of bool, shape (n,): x moves in the step that follows the sample.
        lyapunov: array, shape (n,), V of x, square metres.
        displaced: first sample that holds the displacement; -1: there was none, or the roll-out ended before it.
        outcome: how it ended.
    """

    rollout: str
    controller: str
    mode: Mode
    avoidance: str = "none"
    condition: str
    dataset: str
    demo: str
    split: str
    time: Array
    x: Array
    p_hat: Array
    gate: NDArray[np.bool_]
    lyapunov: Array
    displaced: int
    outcome: Outcome


@dataclass(frozen=True, kw_only=True, eq=False)
class _Path:
    """What the loop recorded; attributes as of `Rollout`."""

    dt: float
    x: Array
    p_hat: Array
    gate: NDArray[np.bool_]
    displaced: int
    outcome: Outcome


def simulate(
    model: LpvDs,
    starts: Sequence[Trajectory],
    parameters: RolloutParameters,
    top_speed: float,
    progress: Callable[[int, int], None] | None = None,
) -> list[Rollout]:
    """Run every case: controllers x conditions x starts, in this order. Paper eqs. (6), (9)-(12).

    Args:
        model: the learned system.
        starts: demonstrations; each case starts at the first sample of one, and by default keeps its clock.
        parameters: the cases.
        top_speed: of the demonstrations that were learned from, m/s.
        progress: called after each case with the number of finished cases and of all.

    Raises:
        ParameterError: a parameter has no meaning, or not for this model.
        DataError: a start has another dimension than the model, two starts have one name, or nothing ever moved.
    """
    check(parameters, model.dimension)
    check_starts(starts, model.dimension, top_speed)
    runners = resolve(parameters, top_speed)
    field = field_of(model, parameters.integrator)
    several = len({start.dataset for start in starts}) > 1
    total = len(runners) * len(parameters.conditions) * len(starts)
    rollouts: list[Rollout] = []
    for runner in runners:
        undisturbed = [_run(field, runner.coupling, start, parameters) for start in starts]
        for condition in parameters.conditions:
            for start, path in zip(starts, undisturbed, strict=True):
                if condition.displacement is not None:
                    sample = displacement_sample(condition, path.p_hat, path.dt)
                    path = _run(field, runner.coupling, start, parameters, sample, condition.displacement)
                demo = f"{start.dataset}/{start.demo}" if several else start.demo
                rollouts.append(
                    _rollout(f"{runner.label}/{condition.name}/{demo}", runner, condition, start, path, model)
                )
                if progress is not None:
                    progress(len(rollouts), total)
    return rollouts


def _rollout(name: str, runner: Runner, condition: Condition, start: Trajectory, path: _Path, model: LpvDs) -> Rollout:
    return Rollout(
        rollout=name,
        controller=runner.kind,
        mode=runner.mode,
        condition=condition.name,
        dataset=start.dataset,
        demo=start.demo,
        split=start.split,
        time=frozen(np.arange(path.x.shape[0]) * path.dt),
        x=path.x,
        p_hat=path.p_hat,
        gate=path.gate,
        lyapunov=frozen(model.lyapunov(path.x)),
        displaced=path.displaced,
        outcome=path.outcome,
    )


def _run(
    field: Field,
    coupling: Coupling,
    start: Trajectory,
    parameters: RolloutParameters,
    displaced: int = NEVER,
    displacement: tuple[float, ...] | None = None,
) -> _Path:
    dt = start.step if parameters.dt is None else parameters.dt
    steps = step_limit(parameters.max_duration, start.duration, dt)
    x, p_hat = np.empty((steps + 1, start.dimension)), np.empty((steps + 1, start.dimension))
    gate = np.empty(steps + 1, dtype=np.bool_)
    push = frozen(np.zeros(start.dimension) if displacement is None else displacement)
    displaced = min(displaced, steps + 1)
    count, code = roll(
        coupling, field, start.position[0], dt, displaced, push, parameters.stop_distance, x, p_hat, gate
    )
    gate = gate[:count].copy()
    gate.flags.writeable = False
    return _Path(
        dt=dt,
        x=frozen(x[:count]),
        p_hat=frozen(p_hat[:count]),
        gate=gate,
        displaced=displaced if displaced < count else NEVER,
        outcome=_OUTCOMES[code],
    )


@compiled
def roll(
    coupling: Coupling,
    field: Field,
    start: Array,
    dt: float,
    displaced: int,
    displacement: Array,
    stop_distance: float,
    x_log: Array,
    p_hat_log: Array,
    gate_log: NDArray[np.bool_],
) -> tuple[int, int]:
    """Step policy and kinematic world until x and p_hat are at the goal or the logs are full.

    Args:
        coupling: how p_hat follows x, or that nothing is coupled.
        field: the learned system.
        start: array, shape (d,), metres.
        dt: seconds.
        displaced: sample at which `displacement`, array, shape (d,), metres, is added to the executed state; -1: never.
        stop_distance: metres.
        x_log, p_hat_log: arrays, shape (n, d), metres. Will be modified.
        gate_log: array of bool, shape (n,). Will be modified.

    Returns:
        Number of samples recorded, and the outcome as an index.
    """
    d, goal = start.shape[0], field.model.goal
    x, executed, commanded = start.copy(), start.copy(), np.empty(d)
    work = workspace(field)
    reach = distance(start, goal) + distance(displacement, np.zeros(d))
    far = FAR * max(reach, stop_distance)
    is_open = True
    for i in range(x_log.shape[0]):
        if i == displaced:
            displace(executed, displacement)
        is_open = observe(coupling, x, executed, is_open)
        x_away, executed_away = distance(x, goal), distance(executed, goal)
        if i > 0 and not (x_away < np.inf and executed_away < np.inf):  # nan or inf is not recorded
            return i, _DIVERGED
        for j in range(d):
            x_log[i, j], p_hat_log[i, j] = x[j], executed[j]
        gate_log[i] = is_open
        if x_away <= stop_distance and executed_away <= stop_distance:
            return i + 1, _ARRIVED
        if x_away > far or executed_away > far:
            return i + 1, _DIVERGED
        for j in range(d):
            commanded[j] = executed[j]
        act(coupling, field, x, commanded, is_open, dt, work)
        carry_out(executed, commanded)
    return x_log.shape[0], _TIMEOUT
