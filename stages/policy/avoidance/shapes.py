"""Obstacles as compiled code sees them: convex shapes that move at constant velocity, and how far a state is from one.

A sphere, a box with rounded edges, an ellipsoid. The signed distance from a convex set is a convex function, so a row
``normal . v dt >= -share x distance`` keeps a whole straight step clear, not only its ends: this is all that avoidance
needs of a shape. Not here: which obstacles a person may give (`parameters.py`, `scene.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stages.compiled import lean
from stages.trajectory import Array

SPHERE, BOX, ELLIPSOID = 0, 1, 2

RADIUS, REACH, SIZES = 0, 1, 2
"""Of `Shapes.measures`. RADIUS: of a sphere; of a box's rounding; 0 of an ellipsoid. REACH: radius of the smallest
sphere about the centre that holds the shape. From SIZES: half extents of a box, semi-axes of an ellipsoid."""

_MOST_ITERATIONS = 60
# Newton's method for the foot point stops where a step changes the parameter by less than this, relative to it.
_ROUNDING = 1e-15


class Shapes(NamedTuple):
    """m obstacles of d coordinates.

    Attributes:
        kinds: array of int, shape (m,): SPHERE, BOX or ELLIPSOID.
        centres: array, shape (m, d), metres, where they are now. The world moves them.
        velocities: array, shape (m, d), m/s.
        measures: array, shape (m, 2 + d), metres, by RADIUS, REACH and from SIZES.
        frames: array, shape (m, d, d): columns are the axes of a box or ellipsoid.
    """

    kinds: NDArray[np.int64]
    centres: Array
    velocities: Array
    measures: Array
    frames: Array

    @property
    def number(self) -> int:
        """m."""
        return int(self.kinds.shape[0])

    @property
    def radii(self) -> Array:
        """Radii, shape (m,), metres."""
        return self.measures[:, RADIUS]


def no_shapes(d: int, m: int = 0) -> Shapes:
    """Room for m obstacles of d coordinates, spheres of no size at the origin until they are filled in."""
    return Shapes(
        np.full(m, SPHERE),
        np.zeros((m, d)),
        np.zeros((m, d)),
        np.zeros((m, 2 + d)),
        np.tile(np.eye(d), (m, 1, 1)),
    )


def spheres(centres: Array, radii: Array, velocities: Array | None = None) -> Shapes:
    """Spheres: centres, shape (m, d), metres; radii, shape (m,), metres; velocities, shape (m, d), m/s."""
    centres = np.asarray(centres, dtype=np.float64)
    result = no_shapes(centres.shape[1], centres.shape[0])
    result.centres[:] = centres
    result.measures[:, RADIUS] = result.measures[:, REACH] = radii
    if velocities is not None:
        result.velocities[:] = velocities
    return result


@lean
def distance_at(shapes: Shapes, index: int, x: Array, normal: Array) -> float:
    """Return the signed distance of x from an obstacle, metres, negative inside, and write its gradient into `normal`.

    `x`: shape (d,), metres. `normal`: shape (d,), a unit vector that points away from the obstacle. Will be modified.
    Inside an ellipsoid the distance is a bound: the true one is at least as deep.
    """
    if shapes.kinds[index] == SPHERE:
        return _from_sphere(shapes, index, x, normal)
    if shapes.kinds[index] == BOX:
        return _from_box(shapes, index, x, normal)
    return _from_ellipsoid(shapes, index, x, normal)


@lean
def _from_sphere(shapes: Shapes, index: int, x: Array, normal: Array) -> float:
    squared = 0.0
    for i in range(x.shape[0]):
        normal[i] = x[i] - shapes.centres[index, i]
        squared += normal[i] * normal[i]
    away = math.sqrt(squared)
    for i in range(x.shape[0]):
        normal[i] = normal[i] / away if away > 0.0 else (1.0 if i == 0 else 0.0)
    return float(away - shapes.measures[index, RADIUS])


@lean
def _from_box(shapes: Shapes, index: int, x: Array, normal: Array) -> float:
    d = x.shape[0]
    outside, deepest, axis, sign = 0.0, -np.inf, 0, 1.0
    for j in range(d):
        along = _along(shapes, index, x, j)
        beyond = abs(along) - shapes.measures[index, SIZES + j]
        if beyond > deepest:
            deepest, axis, sign = beyond, j, math.copysign(1.0, along)
        if beyond > 0.0:
            outside += beyond * beyond
    if deepest <= 0.0:
        for i in range(d):
            normal[i] = sign * shapes.frames[index, i, axis]
        return float(deepest - shapes.measures[index, RADIUS])
    outside = math.sqrt(outside)
    for i in range(d):
        normal[i] = 0.0
    for j in range(d):
        along = _along(shapes, index, x, j)
        beyond = abs(along) - shapes.measures[index, SIZES + j]
        if beyond > 0.0:
            for i in range(d):
                normal[i] += shapes.frames[index, i, j] * math.copysign(beyond, along) / outside
    return float(outside - shapes.measures[index, RADIUS])


@lean
def _from_ellipsoid(shapes: Shapes, index: int, x: Array, normal: Array) -> float:
    """The foot point is a_i^2 q_i / (a_i^2 + t) with sum_i (a_i q_i / (a_i^2 + t))^2 = 1, t >= 0: Newton from below."""
    d = x.shape[0]
    level, t = 0.0, 0.0
    for j in range(d):
        along, half = abs(_along(shapes, index, x, j)), shapes.measures[index, SIZES + j]
        level += (along / half) ** 2
        t = max(t, half * along - half * half)
    inside = level <= 1.0
    if inside:
        t = 0.0
    for _ in range(0 if inside else _MOST_ITERATIONS):
        value, slope = -1.0, 0.0
        for j in range(d):
            along, half = _along(shapes, index, x, j), shapes.measures[index, SIZES + j]
            share = half * along / (half * half + t)
            value += share * share
            slope -= 2.0 * share * share / (half * half + t)
        step = -value / slope
        t += step
        if abs(step) <= _ROUNDING * t:
            break
    gap, length = 0.0, 0.0
    for i in range(d):
        normal[i] = 0.0
    for j in range(d):
        along, half = _along(shapes, index, x, j), shapes.measures[index, SIZES + j]
        foot = half * half * along / (half * half + t)
        gap += (along - foot) ** 2
        slope = along / (half * half + t)
        length += slope * slope
        for i in range(d):
            normal[i] += shapes.frames[index, i, j] * slope
    length = math.sqrt(length)
    for i in range(d):
        normal[i] = normal[i] / length if length > 0.0 else shapes.frames[index, i, 0]
    if not inside:
        return math.sqrt(gap)
    least = np.inf
    for j in range(d):
        least = min(least, shapes.measures[index, SIZES + j])
    return (math.sqrt(level) - 1.0) * least


@lean
def _along(shapes: Shapes, index: int, x: Array, j: int) -> float:
    """Coordinate of x along an axis of a shape, from its centre."""
    total = 0.0
    for i in range(x.shape[0]):
        total += shapes.frames[index, i, j] * (x[i] - shapes.centres[index, i])
    return total


@lean
def nearest_on_way(shapes: Shapes, index: int, start: Array, end: Array, point: Array, normal: Array) -> float:
    """Return the least signed distance of a straight way from an obstacle that stands where it is now, metres.

    `start`, `end`: shape (d,), metres. `point`, `normal`: shape (d,), scratch. Will be modified. The distance is convex
    along the way: of a sphere its least value is known, of other shapes it is searched for by thirds.
    """
    d = start.shape[0]
    if shapes.kinds[index] == SPHERE:
        along, length = 0.0, 0.0
        for j in range(d):
            along += (shapes.centres[index, j] - start[j]) * (end[j] - start[j])
            length += (end[j] - start[j]) ** 2
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        return _at_share(shapes, index, start, end, share, point, normal)
    low, high = 0.0, 1.0
    least = min(
        _at_share(shapes, index, start, end, low, point, normal),
        _at_share(shapes, index, start, end, high, point, normal),
    )
    for _ in range(_MOST_ITERATIONS):
        third = (high - low) / 3.0
        first = _at_share(shapes, index, start, end, low + third, point, normal)
        second = _at_share(shapes, index, start, end, high - third, point, normal)
        least = min(least, first, second)
        if first <= second:
            high -= third
        else:
            low += third
    return least


@lean
def _at_share(shapes: Shapes, index: int, start: Array, end: Array, share: float, point: Array, normal: Array) -> float:
    """Distance at a share of a way."""
    for j in range(start.shape[0]):
        point[j] = start[j] + share * (end[j] - start[j])
    return distance_at(shapes, index, point, normal)
