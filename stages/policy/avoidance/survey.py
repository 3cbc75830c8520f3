"""What is near: distances, rows that keep clear, and how much the state heads for each obstacle.

A row says ``-normal . v <= rate x distance - normal . v_obstacle``. With rate x dt <= 1 a step that keeps all rows
stays outside of every convex shape that moves at constant velocity, from its start to its end: the distance is convex
along the step, and its tangent stays above zero. Not here: which velocity is taken (`roas_plus.py`, `cbf.py`).
"""

from __future__ import annotations

import math

from stages.compiled import lean
from stages.policy.avoidance.scratch import BOUND, CLEAR, LIMIT, NORMAL, ROW, WEIGHT, Avoidance, F, Scratch
from stages.policy.avoidance.shapes import Shapes, distance_at
from stages.trajectory import Array


@lean
def smooth(t: float) -> float:
    """From 0 at t <= 0 to 1 at t >= 1, without a kink."""
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@lean
def survey(avoidance: Avoidance, shapes: Shapes, x: Array, x_next: Array, dt: float, room: Scratch) -> bool:
    """Write f = (x_next - x)/dt, distances, normals, rows and weights into `room`; return whether f keeps every row.

    `x`, `x_next`: shape (d,), metres. `dt`: seconds.
    """
    d, m = x.shape[0], shapes.kinds.shape[0]
    f, normals, clear = room.vectors[F], room.tables[NORMAL], room.columns[CLEAR]
    for j in range(d):
        f[j] = (x_next[j] - x[j]) / dt
    kept = True
    for i in range(m):
        clear[i] = distance_at(shapes, i, x, normals[i]) - avoidance.margin
        closing, relative, carried = 0.0, 0.0, 0.0
        for j in range(d):
            gap = f[j] - shapes.velocities[i, j]
            closing -= normals[i, j] * gap
            relative += gap * gap
            carried -= normals[i, j] * shapes.velocities[i, j]
        room.columns[BOUND, i] = avoidance.rate * clear[i] + carried
        room.columns[WEIGHT, i] = smooth(closing / math.sqrt(relative)) if relative > 0.0 else 0.0
        kept = kept and closing <= avoidance.rate * clear[i]
    return kept


@lean
def rows_in_x(room: Scratch) -> None:
    """Make the surveyed rows those of the program, in m/s."""
    m, d = room.tables.shape[1:]
    for i in range(m):
        for j in range(d):
            room.tables[ROW, i, j] = -room.tables[NORMAL, i, j]
        room.columns[LIMIT, i] = room.columns[BOUND, i]


@lean
def norm(v: Array) -> float:
    """Euclidean length of a vector, shape (d,)."""
    total = 0.0
    for j in range(v.shape[0]):
        total += v[j] * v[j]
    return math.sqrt(total)
