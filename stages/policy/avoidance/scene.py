"""From obstacles as a person gives them to what can be hit and what a policy sees; what cannot work is refused.

A policy sees boxes and ellipsoids that are to be covered as spheres, and spheres that overlap as the one that holds
them: spheres that are disjoint have no pocket in which a state could be caught. Not here: traps of a learned V
(`traps.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from pipeline.errors import ParameterError
from stages.policy.avoidance.parameters import Box, Ellipsoid, Obstacle, Sphere
from stages.policy.avoidance.shapes import BOX, ELLIPSOID, RADIUS, REACH, SIZES, SPHERE, Shapes, distance_at, no_shapes
from stages.policy.outcome import Outcome
from stages.trajectory import Array

UNIT = 1e-6
"""A quaternion whose length differs from 1 by more is refused."""


def shapes_of(obstacles: Sequence[Obstacle], dimension: int, location: str) -> Shapes:
    """Obstacles as compiled code takes them, where they are at the start.

    Args:
        obstacles: as given.
        dimension: number of coordinates, 2 or 3.
        location: dotted place of the obstacles, for messages.

    Raises:
        ParameterError: a number is not finite, a size is not positive, or something has another dimension.
    """
    m, d = len(obstacles), dimension
    result = no_shapes(d, m)
    for index, obstacle in enumerate(obstacles):
        place = f"{location}.{index}"
        result.centres[index] = _vector(obstacle.centre, d, f"{place}.centre")
        if obstacle.velocity is not None:
            result.velocities[index] = _vector(obstacle.velocity, d, f"{place}.velocity")
        if isinstance(obstacle, Sphere):
            result.measures[index, [RADIUS, REACH]] = _positive(obstacle.radius, f"{place}.radius")
            continue
        if isinstance(obstacle, Box):
            sizes = _vector(obstacle.half_extents, d, f"{place}.half_extents")
            if not (math.isfinite(obstacle.rounding) and obstacle.rounding >= 0.0):
                raise ParameterError(f"{place}.rounding", f"must be 0 or more metres, not {obstacle.rounding:g}.")
            result.kinds[index], result.measures[index, RADIUS] = BOX, obstacle.rounding
            result.measures[index, REACH] = float(np.linalg.norm(sizes)) + obstacle.rounding
        else:
            sizes = _vector(obstacle.semi_axes, d, f"{place}.semi_axes")
            result.kinds[index], result.measures[index, REACH] = ELLIPSOID, float(sizes.max())
        for size in sizes:
            _positive(float(size), f"{place}.{'half_extents' if isinstance(obstacle, Box) else 'semi_axes'}")
        result.measures[index, SIZES:] = sizes
        if obstacle.rotation is not None:
            result.frames[index] = rotation(obstacle.rotation, d, f"{place}.rotation")
    return result


def rotation(given: Sequence[float], dimension: int, location: str) -> Array:
    """The matrix, shape (d, d), of an angle, rad, in the plane, or of a unit quaternion x y z w in space.

    Raises ParameterError where it is neither; `location` is its dotted place.
    """
    values = np.asarray(given, dtype=np.float64)
    if dimension not in (2, 3):
        raise ParameterError(location, f"must be left out in {dimension} dimensions.")
    wanted = {2: "one angle, rad", 3: "a unit quaternion x y z w"}[dimension]
    if values.shape != ({2: 1, 3: 4}[dimension],) or not np.isfinite(values).all():
        raise ParameterError(location, f"must be {wanted}, not {list(given)}.")
    if dimension == 2:
        cosine, sine = math.cos(values[0]), math.sin(values[0])
        return np.array([[cosine, -sine], [sine, cosine]])
    length = float(np.linalg.norm(values))
    if abs(length - 1.0) > UNIT:
        raise ParameterError(location, f"must be {wanted}; its length is {length:.6g}.")
    x, y, z, w = values / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def covered(shapes: Shapes, cover: Sequence[bool]) -> Shapes:
    """The same obstacles, those that are to be covered as spheres about their centres."""
    chosen = np.array(cover, dtype=np.bool_)
    return shapes._replace(
        kinds=np.where(chosen, SPHERE, shapes.kinds),
        measures=_as_spheres(shapes.measures, chosen),
    )


def _as_spheres(measures: Array, chosen: NDArray[np.bool_]) -> Array:
    """Measures, shape (m, 2 + d), those of the chosen as of spheres."""
    result = measures.copy()
    result[chosen, RADIUS] = measures[chosen, REACH]
    result[chosen, SIZES:] = 0.0
    return result


def to_be_covered(obstacles: Sequence[Obstacle]) -> list[bool]:
    """Which obstacles a policy is to see as spheres."""
    return [isinstance(obstacle, Box | Ellipsoid) and obstacle.cover for obstacle in obstacles]


def merged(shapes: Shapes, margin: float) -> Shapes:
    """Spheres that overlap, or have no room between their margins, metres, as the smallest that hold them.

    Only spheres of one velocity are merged: others part again. A sphere that has grown may overlap others: they are
    merged, too.
    """
    while True:
        groups = _groups(shapes, margin)
        if all(len(group) == 1 for group in groups):
            return shapes
        m, d = len(groups), shapes.centres.shape[1]
        result = no_shapes(d, m)
        for index, group in enumerate(groups):
            first = group[0]
            for name in ("kinds", "centres", "velocities", "measures", "frames"):
                getattr(result, name)[index] = getattr(shapes, name)[first]
            if len(group) > 1:
                centre, radius = enclosing(shapes.centres[group], shapes.radii[group])
                result.centres[index], result.measures[index, [RADIUS, REACH]] = centre, radius
        shapes = result


def _groups(shapes: Shapes, margin: float) -> list[list[int]]:
    """Indices of obstacles that belong together, in order."""
    m, radii = shapes.number, shapes.radii
    label = list(range(m))
    for i in range(m):
        for j in range(i):
            both = shapes.kinds[i] == SPHERE and shapes.kinds[j] == SPHERE
            apart = float(np.linalg.norm(shapes.centres[i] - shapes.centres[j]))
            touch = apart <= radii[i] + radii[j] + 2.0 * margin
            if both and touch and (shapes.velocities[i] == shapes.velocities[j]).all():
                old, new = label[i], label[j]
                label = [new if name == old else name for name in label]
    return [[i for i in range(m) if label[i] == name] for name in dict.fromkeys(label)]


def enclosing(centres: Array, radii: Array) -> tuple[Array, float]:
    """The smallest sphere that holds spheres, centres, shape (n, d), and radii, shape (n,), metres: centre and radius.

    A convex program; whatever its solver's accuracy, the radius returned is large enough.
    """
    start = centres.mean(axis=0)
    scale = float(np.max(np.linalg.norm(centres - start, axis=1) + radii))

    def room(v: Array) -> Array:
        return np.asarray(v[-1] - radii / scale - np.linalg.norm(v[:-1] - (centres - start) / scale, axis=1))

    found = minimize(
        lambda v: v[-1],
        np.append(np.full(start.shape[0], 1e-3), 1.1),
        jac=lambda v: np.append(np.zeros(start.shape[0]), 1.0),
        constraints={"type": "ineq", "fun": room},
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 200},
    )
    candidates = [start + scale * found.x[:-1], start]
    reach = [float(np.max(np.linalg.norm(centres - centre, axis=1) + radii)) for centre in candidates]
    best = int(np.argmin(reach))
    return np.asarray(candidates[best]), reach[best] * (1.0 + 1e-12)


def refusal(real: Shapes, seen: Shapes, margin: float, start: Array, goal: Array, *, recover: bool) -> Outcome | None:
    """Why a roll-out cannot begin, or none.

    Args:
        real: obstacles as they are.
        seen: as the policy sees them: covered and merged.
        margin: kept beyond them, metres.
        start, goal: arrays, shape (d,), metres.
        recover: whether it may begin inside.
    """
    if inside(real, margin, goal):
        return Outcome.GOAL_INSIDE
    if inside(real, margin, start) and not recover:
        return Outcome.START_INSIDE
    if inside(seen, margin, goal) or (inside(seen, margin, start) and not recover):
        return Outcome.SWALLOWED
    return None


def inside(shapes: Shapes, margin: float, x: Array) -> bool:
    """Whether x, shape (d,), metres, lies in an obstacle or within the margin, metres. A goal that moves off is not
    asked again."""
    normal = np.empty(x.shape[0])
    return any(distance_at(shapes, index, x, normal) < margin for index in range(shapes.number))


def _vector(values: Sequence[float], dimension: int, location: str) -> Array:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (dimension,):
        raise ParameterError(location, f"has {vector.size} coordinates, the motion has {dimension}; SI units.")
    if not np.isfinite(vector).all():
        raise ParameterError(location, f"must be finite, not {vector.tolist()}.")
    return vector


def _positive(value: float, location: str) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise ParameterError(location, f"must be a positive number of metres, not {value:g}.")
    return value
