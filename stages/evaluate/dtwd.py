"""The swept error area between two paths: paper eq. (26).

What the paper prints as "DTWD", eq. (26), is the swept error area of SEDS divided by the number of steps; it warps
nothing. It is here as a sum, which does not depend on the sample rate. Paths come in at equal sampling:
`stages/paths.py` provides that, and true dynamic time warping. This module knows nothing of roll-outs: `compare.py`
applies it to them.
"""

from __future__ import annotations

import numpy as np

from stages.compiled import compiled
from stages.trajectory import Array

# Gauss-Legendre points a side for the area of a bilinear patch: exact where it is planar and does not fold, so for any
# planar parallelogram; 1e-8 relative on a patch twisted by 90 degrees. Where a planar one folds, or is a dart, it is
# the area swept, counted twice where it is passed twice: more than the area that the plane's formula finds enclosed.
PATCH_POINTS = 8
_nodes, _weights = np.polynomial.legendre.leggauss(PATCH_POINTS)
_NODES = 0.5 * (_nodes + 1.0)
_WEIGHTS = 0.5 * _weights


@compiled
def _cross(ux: float, uy: float, vx: float, vy: float) -> float:
    return ux * vy - uy * vx


@compiled
def _crossed(p: Array, q: Array, r: Array, s: Array) -> float:
    """Area of the two triangles that edges pq and rs of the planar quadrilateral pqrs form; -1 if they do not cross."""
    side_r = _cross(q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1])
    side_s = _cross(q[0] - p[0], q[1] - p[1], s[0] - p[0], s[1] - p[1])
    side_p = _cross(s[0] - r[0], s[1] - r[1], p[0] - r[0], p[1] - r[1])
    side_q = _cross(s[0] - r[0], s[1] - r[1], q[0] - r[0], q[1] - r[1])
    apart = (side_r > 0.0 and side_s < 0.0) or (side_r < 0.0 and side_s > 0.0)
    if not (apart and ((side_p > 0.0 and side_q < 0.0) or (side_p < 0.0 and side_q > 0.0))):
        return -1.0
    crossing = side_p / (side_p - side_q)  # where on pq
    return 0.5 * ((1.0 - crossing) * abs(side_r) + crossing * abs(side_s))


@compiled
def _planar_area(p: Array, q: Array, r: Array, s: Array) -> float:
    """Area that the planar quadrilateral pqrs encloses; at most one pair of its opposite edges can cross."""
    area = _crossed(p, q, r, s)
    if area < 0.0:
        area = _crossed(q, r, s, p)
    if area < 0.0:
        area = 0.5 * abs(_cross(r[0] - p[0], r[1] - p[1], s[0] - q[0], s[1] - q[1]))  # shoelace, by the diagonals
    return area


@compiled
def _patch_area(p: Array, q: Array, r: Array, s: Array) -> float:
    """Area of the bilinear patch over the corners pqrs, in any dimension, by Gauss-Legendre quadrature."""
    total = 0.0
    for row in range(PATCH_POINTS):
        v = _NODES[row]
        for column in range(PATCH_POINTS):
            u = _NODES[column]
            squared = 0.0
            for i in range(p.shape[0]):
                along_i = (1.0 - v) * (q[i] - p[i]) + v * (r[i] - s[i])
                across_i = (1.0 - u) * (s[i] - p[i]) + u * (r[i] - q[i])
                for j in range(i):
                    along_j = (1.0 - v) * (q[j] - p[j]) + v * (r[j] - s[j])
                    across_j = (1.0 - u) * (s[j] - p[j]) + u * (r[j] - q[j])
                    squared += (along_i * across_j - along_j * across_i) ** 2
            total += _WEIGHTS[row] * _WEIGHTS[column] * np.sqrt(squared)
    return total


@compiled
def _swept(reference: Array, path: Array) -> float:
    total = 0.0
    for t in range(reference.shape[0] - 1):
        if reference.shape[1] == 2:
            total += _planar_area(reference[t], reference[t + 1], path[t + 1], path[t])
        else:
            total += _patch_area(reference[t], reference[t + 1], path[t + 1], path[t])
    return total


def quadrilateral_area(vertices: Array) -> float:
    """The area S that four vertices enclose. Paper eq. (26).

    In the plane: the shoelace formula if the quadrilateral is simple; where two opposite edges cross, the two triangles
    at the crossing (the shoelace of a bow-tie is 0). In 3-D and above: the area of the bilinear patch over the
    vertices, by 8 x 8 Gauss-Legendre points, exact for a planar patch that does not fold.

    Args:
        vertices: array, shape (4, d), metres, in order around the quadrilateral, d >= 2.

    Returns:
        Square metres.
    """
    p, q, r, s = np.ascontiguousarray(vertices, dtype=np.float64)
    return float(_planar_area(p, q, r, s) if vertices.shape[1] == 2 else _patch_area(p, q, r, s))


def swept_error_area(reference: Array, path: Array) -> float:
    """The area swept between two paths of equal sampling: the sum of eq. (26) without its 1/T.

    n samples make n - 1 quadrilaterals, so "per step" is this divided by n - 1: the mean area of a quadrilateral. (The
    print divides by T and sums to T, which takes T + 1 samples: the same thing.)

    Args:
        reference: array, shape (n, d), metres, n >= 2, d >= 2.
        path: array, shape (n, d), metres.

    Returns:
        Square metres.

    Raises:
        ValueError: the shapes differ, or there are fewer than two samples or coordinates.
    """
    if reference.shape != path.shape or reference.ndim != 2 or min(reference.shape) < 2:
        raise ValueError(f"two paths of one shape (n, d) are needed, not {reference.shape} and {path.shape}.")
    return float(_swept(np.ascontiguousarray(reference), np.ascontiguousarray(path)))
