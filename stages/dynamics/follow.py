"""Roll-outs inside a fit: how well a system follows the demonstrations that it was learned from.

What a program minimises is the error of the velocity; what people see is the path. Choosing between candidates is
therefore done by rolling them out, on training demonstrations only. Undisturbed and without a world: the roll-outs of
an experiment are the affair of `stages/rollout`. Not here: what is chosen between (`choose.py`).
"""

from __future__ import annotations

import math

import numpy as np

from stages.compiled import compiled
from stages.dynamics.kernels import ModelArrays, Workspace, step_at, workspace
from stages.paths import dynamic_time_warping, resample_time
from stages.trajectory import Array, Trajectory

STEPS = 100
"""Steps of a roll-out in the time of its demonstration."""

LONGEST = 3.0
"""Longest roll-out, as a multiple of its demonstration's duration."""

SAMPLES = 100
"""Samples of either path that are warped onto each other."""

ARRIVED = 0.01
"""A roll-out ends where it is this near the goal, as a fraction of the motion's size."""


def deviation(model: ModelArrays, demonstration: Trajectory, start: Array, size: float) -> tuple[float, bool]:
    """Roll out from `start`, shape (d,), metres; return the mean distance, metres, from the demonstration, and arrival.

    The distance is that of dynamic time warping at `SAMPLES` samples of each. `size`: of the motion, metres.
    """
    dt = demonstration.duration / STEPS
    path = np.empty((math.ceil(LONGEST * STEPS) + 1, start.shape[0]))
    count, arrived = follow(np.ascontiguousarray(start), model, dt, ARRIVED * size, workspace(model), path)
    if not np.isfinite(path[:count]).all():
        return math.inf, False
    executed = resample_time(np.asarray(np.arange(count) * dt), path[:count], SAMPLES)
    cost, _ = dynamic_time_warping(executed, resample_time(demonstration.time, demonstration.position, SAMPLES))
    return cost / SAMPLES, arrived


@compiled
def follow(start: Array, model: ModelArrays, dt: float, near: float, work: Workspace, path: Array) -> tuple[int, bool]:
    """Roll out from `start`, shape (d,), by steps of `dt` seconds until `near` the goal, metres, or `path` is full.

    Returns how many rows of `path`, shape (n, d), metres, were written, and whether the goal was reached.
    """
    d = start.shape[0]
    for i in range(d):
        path[0, i] = start[i]
    for t in range(path.shape[0]):
        away = 0.0
        for i in range(d):
            away += (path[t, i] - model.goal[i]) ** 2
        if away <= near * near:
            return t + 1, True
        if t + 1 < path.shape[0]:
            step_at(path[t], model, dt, work, path[t + 1])
    return path.shape[0], False
