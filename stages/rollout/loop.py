"""The loop of one roll-out: policy against kinematic world, compiled; what happens goes into arrays made before.

Not here: which cases run (`simulate.py`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stages.compiled import compiled
from stages.policy.avoidance.avoid import TOUCH
from stages.policy.avoidance.scratch import FREE, INFEASIBLE, TOO_FAST, TRAPPED
from stages.policy.avoidance.shapes import Shapes
from stages.policy.coupled import UNCOUPLED, distance, observe
from stages.policy.outcome import Outcome
from stages.policy.policy import Rules, act, desk
from stages.trajectory import Array
from stages.world.disturbance import CALM, DRAGGED, Pushes, disturb, last_sample, unpushed
from stages.world.kinematic import carry_out, clearance_at, clearance_on_way, place

FAR = 1e3
"""A state this many times farther from the goal than its start has diverged."""

OUTCOMES = (
    Outcome.ARRIVED,
    Outcome.TIMEOUT,
    Outcome.DIVERGED,
    Outcome.COLLIDED,
    Outcome.INFEASIBLE,
    Outcome.TOO_FAST,
    Outcome.TRAPPED,
)
"""By the code that the loop returns."""

_ARRIVED, _TIMEOUT, _DIVERGED, _COLLIDED, _INFEASIBLE, _TOO_FAST, _TRAPPED = range(7)


@compiled
def roll(
    rules: Rules,
    seen: Shapes | None,
    real: Shapes | None,
    pushes: Pushes,
    start: Array,
    dt: float,
    stop_distance: float,
    recover: bool,
    x_log: Array,
    p_hat_log: Array,
    gate_log: NDArray[np.bool_],
    clearance_log: Array,
    status_log: NDArray[np.int8],
    spans: NDArray[np.int64],
) -> tuple[int, int]:
    """Step policy and kinematic world until x and p_hat are at the goal, something stops them, or the logs are full.

    Args:
        rules: the policy.
        seen: obstacles as the policy sees them, at the start; none: there are none. Will be modified.
        real: obstacles as they are, at the start; none: there are none. Will be modified.
        pushes: disturbances of the executed state.
        start: array, shape (d,), metres.
        dt: seconds.
        stop_distance: metres.
        recover: whether a state that begins in an obstacle, or is pushed into one, may leave it.
        x_log, p_hat_log: arrays, shape (n, d), metres. Will be modified.
        gate_log: array of bool, shape (n,): x moves in the step that follows. Will be modified.
        clearance_log: array, shape (n,), metres: least distance from an obstacle since the sample before, on the way
            between them, too. Will be modified.
        status_log: array of int, shape (n,): what became of the step that follows. Will be modified.
        spans: array of int, shape (pushes, 2): first and last sample at which each disturbance acted, or -1. Will be
            modified.

    Returns:
        Number of samples recorded, and the outcome as an index into `OUTCOMES`.
    """
    d, goal, n = start.shape[0], rules.field.model.goal, x_log.shape[0]
    x, executed, commanded, before = start.copy(), start.copy(), np.empty(d), start.copy()
    point, relative, normal = np.empty(d), np.empty(d), np.empty(d)
    on, pushed = desk(rules, seen, start), unpushed(pushes)
    if seen is not None and real is not None:
        seen_at, real_at = seen.centres.copy(), real.centres.copy()
    far = FAR * max(_reach(start, goal, pushes), stop_distance)
    is_open, resting, leaving, steps, deep, status = True, False, False, 0, 0.0, FREE
    code, count = _TIMEOUT, n
    for i in range(n):
        acted = disturb(pushes, pushed, i, steps, executed)
        is_open = observe(rules.coupling, x, executed, is_open)
        x_away, executed_away = distance(x, goal), distance(executed, goal)
        if i > 0 and not (x_away < np.inf and executed_away < np.inf):  # nan or inf is not recorded
            count, code = i, _DIVERGED
            break
        clear = here = np.inf
        if real is not None:
            if i > 0 and acted == CALM:
                clear = clearance_on_way(real, before, executed, dt, point, relative, normal)
            place(real, real_at, i * dt)
            here = clearance_at(real, executed, normal)
            clear = min(clear, here)
        for j in range(d):
            x_log[i, j], p_hat_log[i, j] = x[j], executed[j]
        gate_log[i], clearance_log[i], status_log[i] = is_open, clear, FREE
        if x_away <= stop_distance and executed_away <= stop_distance:
            count, code = i + 1, _ARRIVED
            break
        if x_away > far or executed_away > far:
            count, code = i + 1, _DIVERGED
            break
        if clear < -TOUCH:
            leaving = recover and (i == 0 or acted != CALM or (leaving and here >= deep - TOUCH))
            deep = here
            if not leaving:
                count = i + 1
                code = _TOO_FAST if status == TOO_FAST else _INFEASIBLE if status == INFEASIBLE else _COLLIDED
                break
        else:
            leaving = False
        if status == TRAPPED:
            count, code = i + 1, _TRAPPED
            break
        if seen is not None:
            place(seen, seen_at, i * dt)
        for j in range(d):
            commanded[j] = before[j] = executed[j]
        status = act(rules, seen, x, commanded, is_open, dt, on)
        status_log[i] = status
        # No step forward: while x waits for a disturbed state to come back, and while one that is uncoupled is dragged.
        waiting = not is_open and (acted != CALM or resting)
        resting = acted == DRAGGED if rules.coupling.kind == UNCOUPLED else waiting
        if not resting:
            steps += 1
        carry_out(executed, commanded)
    for k in range(spans.shape[0]):
        spans[k, 0] = spans[k, 1] = -1
        if 0 <= pushed.begun[k] < count:
            spans[k, 0] = pushed.begun[k]
            spans[k, 1] = min(last_sample(pushes, k, pushed.begun[k]), count - 1)
    return count, code


@compiled
def _reach(start: Array, goal: Array, pushes: Pushes) -> float:
    """How far from the goal a roll-out may be expected to get, metres."""
    reach = distance(start, goal)
    for k in range(pushes.kinds.shape[0]):
        squared = 0.0
        for j in range(start.shape[0]):
            squared += pushes.offsets[k, j] ** 2
        reach += np.sqrt(squared)
    return reach
