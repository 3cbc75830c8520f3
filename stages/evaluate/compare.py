"""The metrics of one roll-out against one demonstration, in the units of tables (mm, mm^2). Paper eq. (26), Fig. 3.

Every path metric is of the EXECUTED state, the excursion of a disturbance included: the state x of a coupled system
never leaves its path, and measuring it would flatter the method. Not here: how the numbers are computed (`dtwd.py`,
`stages/paths.py`) and which roll-out is compared with which demonstration (`stage.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stages.evaluate.dtwd import swept_error_area
from stages.paths import dynamic_time_warping, resample_arc, resample_time
from stages.trajectory import Array, Trajectory

MM = 1e3
"""Millimetres per metre."""

ROUNDING = 16.0 * float(np.finfo(np.float64).eps)
"""A rise of V by at most this fraction of V is what rounding explains, and counts as none."""


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
        lyapunov_rise_max: largest rise of V along x in one step, m^2, the step of an imposed displacement excepted;
            0 if V never rose by more than rounding explains (`ROUNDING`).
        clearance_min_mm: smallest distance from an obstacle; none: there was none.
        gate_closed_steps: steps in which x waited.
        recovery_s: from the displacement until x moved again, seconds; none: it did not wait, or waited to the end.
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
    clearance_min_mm: float | None
    gate_closed_steps: int
    recovery_s: float | None


def compare(
    *,
    time: Array,
    executed: Array,
    gate: NDArray[np.bool_],
    lyapunov: Array,
    displaced: int,
    outcome: str,
    reference: Trajectory,
    goal: Array,
    samples: int,
) -> Comparison:
    """Measure one roll-out. Paper eq. (26).

    Both paths are brought to `samples` samples before they are compared: for warping, evenly spaced in time over their
    own durations; for the swept error area, which pairs samples by number, evenly spaced in arc length, so that it is
    an area between two curves and how long either of them pauses does not count.

    Args:
        time: array, shape (n,), seconds.
        executed: array, shape (n, d), metres.
        gate: array of bool, shape (n,): x moves in the step that follows the sample.
        lyapunov: array, shape (n,), V of x, m^2.
        displaced: sample at which the displacement had been added; -1: never.
        outcome: how the roll-out ended.
        reference: the demonstration.
        goal: array, shape (d,), metres.
        samples: at least 2.

    Raises:
        ValueError: the shapes of the paths differ.
    """
    warped, pairs = dynamic_time_warping(
        resample_time(time, executed, samples), resample_time(reference.time, reference.position, samples)
    )
    swept = swept_error_area(resample_arc(reference.position, samples), resample_arc(executed, samples))
    return Comparison(
        outcome=str(outcome),
        dtw_mm=warped * MM,
        dtw_per_step_mm=warped / pairs * MM,
        sea_mm2=swept * MM**2,
        sea_per_step_mm2=swept / (samples - 1) * MM**2,
        steps=time.shape[0] - 1,
        duration_s=float(time[-1] - time[0]),
        final_error_mm=float(np.linalg.norm(executed[-1] - goal)) * MM,
        lyapunov_rise_max=largest_rise(lyapunov, displaced),
        clearance_min_mm=None,
        gate_closed_steps=int(np.count_nonzero(~gate[:-1])),
        recovery_s=recovery_time(time, gate, displaced),
    )


def largest_rise(lyapunov: Array, displaced: int) -> float:
    """Largest rise of an array V, shape (n,), m^2, in one step, the one that ends at sample `displaced` excepted; or 0.

    A rise of at most 16 machine epsilons of V is what rounding explains and counts as 0.
    """
    rises = np.diff(lyapunov)
    rises[rises <= ROUNDING * lyapunov[:-1]] = 0.0
    if displaced > 0:
        rises[displaced - 1] = 0.0
    return float(rises.max(initial=0.0))


def recovery_time(time: Array, gate: NDArray[np.bool_], displaced: int) -> float | None:
    """Seconds from the displacement until the gate opens again; none: it did not close on it, or never opened again.

    `time`: array, shape (n,), seconds. `gate`: array of bool, shape (n,). `displaced`: a sample, or -1.
    """
    if displaced < 0 or gate[displaced]:
        return None
    reopened = np.flatnonzero(gate[displaced:])
    return float(time[displaced + reopened[0]] - time[displaced]) if reopened.size else None
