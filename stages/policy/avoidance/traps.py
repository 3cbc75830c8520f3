"""Where a policy that must not raise V could be caught on an obstacle: found before anything moves.

A trap is a minimum of V on the surface of an obstacle at which V rises outwards: no admissible velocity brings V down
from there. For a sphere and V = z'Pz all of them are known. On the sphere, u = x - c, |u| = r, stationary points
solve (P - nu I) u = -P m with m = c - x_g: one number nu with sum_i (lambda_i m_i / (nu - lambda_i))^2 = r^2, in the
axes of P. V rises outwards where nu > 0, and u is a minimum where P - nu I is positive on the tangent plane, which
leaves
nu between the two smallest eigenvalues of P (Martinez, "Local minimizers of quadratic functions on Euclidean balls and
spheres", SIAM J. Optimization 4, 1994). With P = I they are equal, and there is no trap: neither on spheres of any
size, nor in any number, as long as they are disjoint. For a warp, and for other shapes, the surface is sampled.

Not here: how a trap is left (`detour.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.shapes import BOX, SIZES, SPHERE, Shapes, distance_at
from stages.trajectory import Array, frozen

IN_PLANE, IN_SPACE = 720, 4000
"""Points of a surface that are sampled: half a degree apart; in space about three degrees."""

NEIGHBOURS = 8
"""A sample in space is a minimum if none of this many nearest samples is lower."""

FLAT = 1e-9
"""Of curvature, relative: less is no minimum but a plain."""

_EDGE = 1e-12


def traps_of(model: LpvDs, shapes: Shapes, margin: float) -> tuple[Array, bool]:
    """Traps on obstacles that stand, and whether all of them are known.

    Args:
        model: the learned system.
        shapes: obstacles, as the policy sees them.
        margin: kept beyond them, metres.

    Returns:
        array, shape (n, d), metres, outside of all other obstacles; and False where a surface was sampled.
    """
    found: list[Array] = []
    quadratic, exact = model.warp is None or model.warp.count == 0, True
    for index in range(shapes.number):
        if (shapes.velocities[index] != 0.0).any():
            continue
        if quadratic and shapes.kinds[index] == SPHERE:
            centre, radius = shapes.centres[index], float(shapes.radii[index]) + margin
            places = [centre + u for u in on_sphere(model.lyapunov_matrix, centre - model.goal, radius)]
        else:
            exact = False
            places = sampled(model.lyapunov, model.lyapunov_gradient, shapes, index, margin)
        found += [place for place in places if not _covered(shapes, index, place, margin)]
    return frozen(np.array(found).reshape(-1, shapes.centres.shape[1])), exact


def on_sphere(P: Array, m: Array, radius: float) -> list[Array]:
    """Traps of V = z'Pz on a sphere about m, shape (d,), metres from the goal, which it does not hold: relative to m.

    `P`: shape (d, d), positive definite. `radius`: metres.
    """
    values, axes = np.linalg.eigh(P)
    low, high = float(values[0]), float(values[1])
    if high - low <= _EDGE * high:
        return []
    pull = values * (axes.T @ m)

    def excess(nu: float) -> float:
        return float(((pull / (nu - values)) ** 2).sum()) - radius * radius

    # Convex between two poles: at most two stationary points.
    edge = _EDGE * (high - low)
    lowest = minimize_scalar(excess, bounds=(low + edge, high - edge), method="bounded", options={"xatol": edge})
    if excess(lowest.x) > 0.0:
        return []
    traps = []
    for end in (low + edge, high - edge):
        if excess(end) <= 0.0:
            continue
        nu = float(brentq(excess, end, lowest.x, xtol=1e-15, rtol=1e-14))
        u = axes @ (pull / (nu - values))
        if _is_minimum(P - nu * np.eye(P.shape[0]), u / np.linalg.norm(u)):
            traps.append(np.asarray(u))
    return traps


def _is_minimum(hessian: Array, normal: Array) -> bool:
    """Whether a form, shape (d, d), is positive across `normal`, a unit vector, shape (d,)."""
    tangent = np.linalg.svd(normal[None])[2][1:]
    curvature = np.linalg.eigvalsh(tangent @ hessian @ tangent.T)
    return bool(curvature[0] > FLAT * np.abs(hessian).max())


def sampled(
    energy: Callable[[Array], Array],
    gradient: Callable[[Array], Array],
    shapes: Shapes,
    index: int,
    margin: float,
) -> list[Array]:
    """Samples of an obstacle's surface where V is lower than at their neighbours, and rises outwards.

    Args:
        energy: V of states, (n, d) -> (n,).
        gradient: grad V of states, (n, d) -> (n, d).
        shapes: obstacles; `index`: which.
        margin: kept beyond it, metres.
    """
    d = shapes.centres.shape[1]
    directions = _directions(d)
    points, normals = _surface(shapes, index, margin, directions)
    V = energy(points)
    outwards = (gradient(points) * normals).sum(axis=1) > 0.0
    lowest = (V[_neighbours(directions)] >= V[:, None]).all(axis=1)
    return list(points[outwards & lowest])


def _directions(d: int) -> Array:
    """Unit vectors spread evenly, shape (n, d): on a circle, or on a spiral over the sphere."""
    if d == 2:
        angle = np.arange(IN_PLANE) * (2.0 * math.pi / IN_PLANE)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    k = np.arange(IN_SPACE) + 0.5
    z, angle = 1.0 - 2.0 * k / IN_SPACE, k * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def _neighbours(directions: Array) -> NDArray[np.int64]:
    """Indices of the nearest samples of each, shape (n, k)."""
    n = directions.shape[0]
    if directions.shape[1] == 2:
        return np.stack([np.arange(n) - 1, (np.arange(n) + 1) % n], axis=1)
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(directions).query(directions, k=NEIGHBOURS + 1)[1][:, 1:])


def _surface(shapes: Shapes, index: int, margin: float, directions: Array) -> tuple[Array, Array]:
    """Points of a surface by their outward normals, and these: shapes (n, d) both."""
    frame, sizes = shapes.frames[index], shapes.measures[index, SIZES:]
    local = directions @ frame
    if shapes.kinds[index] == SPHERE:
        foot = np.zeros_like(local)
    elif shapes.kinds[index] == BOX:
        # By direction, not by normal: a face has one normal only.
        scale = (np.abs(local) / sizes).max(axis=1, keepdims=True)
        points = shapes.centres[index] + (local / scale) @ frame.T
        return _pushed_out(shapes, index, margin, points)
    else:
        foot = local * sizes**2 / np.linalg.norm(local * sizes, axis=1, keepdims=True)
    points = shapes.centres[index] + foot @ frame.T + (shapes.radii[index] + margin) * directions
    return points, directions


def _pushed_out(shapes: Shapes, index: int, margin: float, points: Array) -> tuple[Array, Array]:
    """Points near a surface, moved onto it and the margin beyond, metres."""
    out, normals = np.empty_like(points), np.empty_like(points)
    centre = shapes.centres[index]
    for k, point in enumerate(points):
        start = np.ascontiguousarray(centre + (1.0 + 1e-9) * (point - centre))
        distance = distance_at(shapes, index, start, normals[k])
        out[k] = start + (margin - distance) * normals[k]
    return out, normals


def _covered(shapes: Shapes, index: int, place: Array, margin: float) -> bool:
    """Whether another obstacle holds a place."""
    normal = np.empty(place.shape[0])
    others = (i for i in range(shapes.number) if i != index)
    return any(distance_at(shapes, i, np.ascontiguousarray(place), normal) < margin for i in others)
