"""The kinematic world: the executed state goes exactly where the policy commands; obstacles move, and may be hit.

No robot, no mass, no contact. Not a policy: what is commanded is decided in `stages/policy`. Not here: who pushes the
executed state (`disturbance.py`).
"""

from __future__ import annotations

import numpy as np

from stages.compiled import lean
from stages.policy.avoidance.shapes import Shapes, distance_at, nearest_on_way
from stages.trajectory import Array


@lean
def carry_out(executed: Array, commanded: Array) -> None:
    """Make the executed state what was commanded: arrays, shape (d,), metres; `executed` is modified."""
    for i in range(executed.shape[0]):
        executed[i] = commanded[i]


@lean
def place(shapes: Shapes, centres: Array, time: float) -> None:
    """Put obstacles where they are `time` seconds after they were at `centres`, shape (m, d), metres.

    `shapes.centres` will be modified.
    """
    for i in range(centres.shape[0]):
        for j in range(centres.shape[1]):
            shapes.centres[i, j] = centres[i, j] + time * shapes.velocities[i, j]


@lean
def clearance_at(shapes: Shapes, x: Array, normal: Array) -> float:
    """Return the distance of x, shape (d,), metres, from the nearest obstacle, metres; inf: there is none.

    `normal`: shape (d,), scratch.
    """
    least = np.inf
    for i in range(shapes.kinds.shape[0]):
        least = min(least, distance_at(shapes, i, x, normal))
    return least


@lean
def clearance_on_way(
    shapes: Shapes, start: Array, end: Array, dt: float, point: Array, relative: Array, normal: Array
) -> float:
    """Return the least distance from all obstacles on the straight way of one step, metres; inf: there is none.

    `start`, `end`: shape (d,), metres, `dt` seconds apart; obstacles are where they are at the start and move on.
    `point`, `relative`, `normal`: shape (d,), scratch.
    """
    least = np.inf
    for i in range(shapes.kinds.shape[0]):
        for j in range(start.shape[0]):
            relative[j] = end[j] - dt * shapes.velocities[i, j]
        least = min(least, nearest_on_way(shapes, i, start, relative, point, normal))
    return least
