"""One case from start to end: room for what happens, the loop, what was recorded. Arrays in, arrays out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from stages.policy.avoidance.shapes import Shapes
from stages.policy.outcome import Outcome
from stages.policy.policy import Rules
from stages.rollout.disturbances import merged_spans
from stages.rollout.loop import OUTCOMES, roll
from stages.trajectory import Array, frozen
from stages.world.disturbance import Pushes
from stages.world.kinematic import clearance_at

S = TypeVar("S", bound=np.generic)


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """What happened in one case; n samples, the first at the start.

    Attributes:
        dt: seconds between samples.
        x: array, shape (n, d), metres: the state of the learned system.
        p_hat: array, shape (n, d), metres: the executed state.
        gate: array of bool, shape (n,): x moves in the step that follows the sample.
        clearance: array, shape (n,), metres: least distance of the executed state from any obstacle since the sample
            before; inf: there is none.
        status: array of int, shape (n,): codes of `stages.policy.outcome.Status`, of the step that follows.
        disturbed: first and last samples of spans in which disturbances acted.
        missed: how many disturbances never came.
        outcome: how it ended.
    """

    dt: float
    x: Array
    p_hat: Array
    gate: NDArray[np.bool_]
    clearance: Array
    status: NDArray[np.int8]
    disturbed: tuple[tuple[int, int], ...]
    missed: int
    outcome: Outcome


def run_case(
    rules: Rules,
    seen: Shapes | None,
    real: Shapes | None,
    pushes: Pushes,
    start: Array,
    *,
    dt: float,
    steps: int,
    stop_distance: float,
    recover: bool = False,
) -> Path:
    """Run one case.

    Args:
        rules: the policy.
        seen, real: obstacles as the policy sees them and as they are, at the start; none: there are none. They are not
            modified.
        pushes: disturbances of the executed state.
        start: array, shape (d,), metres.
        dt: seconds.
        steps: the most that are made.
        stop_distance: a case has arrived when x and the executed state are this near the goal, metres.
        recover: whether a state that begins in an obstacle may leave it.
    """
    n, d = steps + 1, start.shape[0]
    x, p_hat = np.empty((n, d)), np.empty((n, d))
    gate, clearance, status = np.empty(n, dtype=np.bool_), np.empty(n), np.empty(n, dtype=np.int8)
    spans = np.empty((pushes.kinds.shape[0], 2), dtype=np.int64)
    seen, real = _to_be_moved(seen), _to_be_moved(real)
    begin = np.array(start)  # one type for the compiler: writeable
    count, code = roll(
        rules, seen, real, pushes, begin, dt, stop_distance, recover, x, p_hat, gate, clearance, status, spans
    )
    return Path(
        dt=dt,
        x=frozen(x[:count]),
        p_hat=frozen(p_hat[:count]),
        gate=_read_only(gate[:count]),
        clearance=frozen(clearance[:count]),
        status=_read_only(status[:count]),
        disturbed=merged_spans([(int(first), int(last)) for first, last in spans if first >= 0]),
        missed=int((spans[:, 0] < 0).sum()),
        outcome=OUTCOMES[code],
    )


def _to_be_moved(shapes: Shapes | None) -> Shapes | None:
    """A copy of which the centres may be modified."""
    return None if shapes is None else shapes._replace(centres=shapes.centres.copy())


def refused(start: Array, dt: float, real: Shapes, outcome: Outcome) -> Path:
    """The path of a case that cannot begin: its start, shape (d,), metres."""
    at = frozen(start[None])
    clear = clearance_at(real, np.array(start), np.empty(start.shape[0]))
    return Path(
        dt=dt,
        x=at,
        p_hat=at,
        gate=_read_only(np.zeros(1, dtype=np.bool_)),
        clearance=frozen([clear]),
        status=_read_only(np.zeros(1, dtype=np.int8)),
        disturbed=(),
        missed=0,
        outcome=outcome,
    )


def _read_only(values: NDArray[S]) -> NDArray[S]:
    """A copy that cannot be modified."""
    copy = values.copy()
    copy.flags.writeable = False
    return copy
