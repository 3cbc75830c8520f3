"""The metrics of one roll-out against one demonstration, in the units of tables (mm, mm^2). Paper eq. (26), Fig. 3.

Every path metric is of the EXECUTED state, the excursion of a disturbance included: the state x of a coupled system
never leaves its path, and measuring it would flatter the method. Not here: how the numbers are computed (`dtwd.py`,
`stages/paths.py`) and which roll-out is compared with which demonstration (`stage.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.evaluate.dtwd import swept_error_area
from stages.paths import dynamic_time_warping, resample_arc, resample_time
from stages.policy.outcome import Status
from stages.trajectory import Array, Trajectory

MM = 1e3
"""Millimetres per metre."""

ROUNDING = 16.0 * float(np.finfo(np.float64).eps)
"""A rise of V by at most this fraction of V is what rounding explains, and counts as none."""


DETOUR, YIELD, MISSED = (Status.DETOURING,), (Status.YIELDING,), (Status.INFEASIBLE, Status.TOO_FAST)
"""Steps on which V may rise, and steps on which clearance is not kept."""

Spans = Sequence[tuple[int, int]]
"""First and last samples of disturbances."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Columns of `metrics.parquet` that one roll-out fills.

    Attributes:
        outcome: how the roll-out ended.
        dtw_mm: dynamic time warping, distances summed, mm; proportional to the number of samples.
        dtw_per_step_mm: the same divided by the number of pairs of the warping path, mm.
        sea_mm2: swept error area, eq. (26) without its 1/T, mm^2.
        sea_per_step_mm2: eq. (26), the paper's "DTWD": mean area of a quadrilateral, mm^2.
        steps: of the roll-out.
        duration_s: of the roll-out, seconds.
        final_error_mm: distance of the executed state's last sample from the goal, mm.
        lyapunov_rise_max: largest rise of V along x in one step, m^2, the steps of a disturbance excepted; 0 if V never
            rose by more than rounding explains (`ROUNDING`).
        energy_rise_max: the same of eq. (24), V + |p_hat - x|^2.
        clearance_min_mm: smallest distance of the executed state from an obstacle, between samples too, mm; none: there
            was none.
        avoiding_steps: steps that obstacles changed.
        detour_steps: steps on a way out of a trap, on which V may rise.
        yielding_steps: steps that gave way to a moving obstacle, on which V may rise.
        flagged_steps: steps on which no velocity kept clear of all obstacles.
        gate_closed_steps: steps in which x waited.
        recovery_s: longest time from the end of a disturbance until x moved again, seconds; none: it did not wait, or
            waited to the end.
    """

    outcome: str
    dtw_mm: float
    dtw_per_step_mm: float
    sea_mm2: float
    sea_per_step_mm2: float
    steps: int
    duration_s: float
    final_error_mm: float
    lyapunov_rise_max: float
    energy_rise_max: float
    clearance_min_mm: float | None
    avoiding_steps: int
    detour_steps: int
    yielding_steps: int
    flagged_steps: int
    gate_closed_steps: int
    recovery_s: float | None


def compare(
    *,
    time: Array,
    x: Array,
    executed: Array,
    gate: NDArray[np.bool_],
    lyapunov: Array,
    clearance: Array,
    status: NDArray[Any],
    disturbed: Spans,
    outcome: str,
    reference: Trajectory,
    goal: Array,
    samples: int,
    p_hat: Array | None = None,
) -> Comparison:
    """Measure one roll-out. Paper eq. (26).

    Both paths are brought to `samples` samples before they are compared: for warping, evenly spaced in time over their
    own durations; for the swept error area, which pairs samples by number, evenly spaced in arc length, so that it is
    an area between two curves and how long either of them pauses does not count.

    Args:
        time: array, shape (n,), seconds.
        x: array, shape (n, d), metres: the state of the learned system.
        executed: array, shape (n, d), metres.
        gate: array of bool, shape (n,): x moves in the step that follows the sample.
        lyapunov: array, shape (n,), V of x, m^2.
        clearance: array, shape (n,), metres: least distance from an obstacle since the sample before; nan: none.
        status: array of text, shape (n,): what became of the step that follows the sample.
        disturbed: first and last samples of disturbances.
        outcome: how the roll-out ended.
        reference: the demonstration.
        goal: array, shape (d,), metres.
        samples: at least 2.
        p_hat: array, shape (n, d), metres, of the coupled system; none: what is executed.

    Raises:
        ValueError: the shapes of the paths differ.
    """
    warped, pairs = dynamic_time_warping(
        resample_time(time, executed, samples), resample_time(reference.time, reference.position, samples)
    )
    swept = swept_error_area(resample_arc(reference.position, samples), resample_arc(executed, samples))
    energy = lyapunov + (((executed if p_hat is None else p_hat) - x) ** 2).sum(axis=1)
    clear, steps = clearance[~np.isnan(clearance)], status[:-1]
    return Comparison(
        outcome=str(outcome),
        dtw_mm=warped * MM,
        dtw_per_step_mm=warped / pairs * MM,
        sea_mm2=swept * MM**2,
        sea_per_step_mm2=swept / (samples - 1) * MM**2,
        steps=time.shape[0] - 1,
        duration_s=float(time[-1] - time[0]),
        final_error_mm=float(np.linalg.norm(executed[-1] - goal)) * MM,
        lyapunov_rise_max=largest_rise(lyapunov, disturbed),
        energy_rise_max=largest_rise(energy, disturbed),
        clearance_min_mm=float(clear.min()) * MM if clear.size else None,
        avoiding_steps=int(np.count_nonzero(steps != Status.FREE)),
        detour_steps=_count(steps, DETOUR),
        yielding_steps=_count(steps, YIELD),
        flagged_steps=_count(steps, MISSED),
        gate_closed_steps=int(np.count_nonzero(~gate[:-1])),
        recovery_s=recovery_time(time, gate, disturbed),
    )


def _count(steps: NDArray[Any], names: Sequence[Status]) -> int:
    return int(np.isin(steps, [str(name) for name in names]).sum())


def largest_rise(energy: Array, disturbed: Spans) -> float:
    """Largest rise of an array, shape (n,), m^2, in one step, those that end in a span of a disturbance excepted; or 0.

    A rise of at most 16 machine epsilons of it is what rounding explains and counts as 0.
    """
    rises = np.diff(energy)
    rises[rises <= ROUNDING * energy[:-1]] = 0.0
    for first, last in disturbed:
        rises[max(first - 1, 0) : last] = 0.0
    return float(rises.max(initial=0.0))


def recovery_time(time: Array, gate: NDArray[np.bool_], disturbed: Spans) -> float | None:
    """Longest time from the end of a disturbance until the gate opens again, seconds.

    None: it did not close on any, or never opened again. `time`: array, shape (n,), seconds. `gate`: array of bool,
    shape (n,). `disturbed`: first and last samples of disturbances.
    """
    longest = None
    for _, last in disturbed:
        if gate[last]:
            continue
        reopened = np.flatnonzero(gate[last:])
        if not reopened.size:
            return None
        waited = float(time[last + reopened[0]] - time[last])
        longest = waited if longest is None else max(longest, waited)
    return longest
