"""Positive definiteness in exact rational arithmetic, and random matrices that hardly have it, or hardly lack it."""

from __future__ import annotations

from fractions import Fraction
from math import lcm

import numpy as np

Matrix = list[list[Fraction]]


def exact(matrix: np.ndarray) -> Matrix:
    return [[Fraction(float(entry)) for entry in row] for row in matrix]


def is_positive_definite(matrix: Matrix) -> bool:
    """All leading minors are positive, by Bareiss's elimination in whole numbers."""
    scale = lcm(*(entry.denominator for row in matrix for entry in row))
    work = [[int(entry * scale) for entry in row] for row in matrix]
    n, before = len(work), 1
    for j in range(n):
        pivot = work[j][j]
        if pivot <= 0:
            return False
        for i in range(j + 1, n):
            for k in range(j + 1, n):
                work[i][k] = (work[i][k] * pivot - work[i][j] * work[j][k]) // before
        before = pivot
    return True


def truly_stable(A: np.ndarray, P: np.ndarray, margin: float) -> bool:
    """-(A'P + PA) - margin I > 0, exactly."""
    a, p, n = exact(A), exact(P), len(P)
    product = [[sum(p[i][m] * a[m][j] for m in range(n)) for j in range(n)] for i in range(n)]
    return is_positive_definite(
        [[-(product[i][j] + product[j][i]) - (Fraction(margin) if i == j else 0) for j in range(n)] for i in range(n)]
    )


def random_case(
    rng: np.random.Generator, *, identity: bool, dimensions: tuple[int, int] = (2, 7)
) -> tuple[np.ndarray, np.ndarray, float]:
    """A matrix whose largest eigenvalue of A'P + PA lies within a few roundings of -margin, on either side."""
    d = int(rng.integers(dimensions[0], dimensions[1] + 1))
    margin = float(rng.choice([0.0, 1e-3, 0.1]))
    P = np.eye(d)
    if not identity:
        root = rng.normal(size=(d, d))
        P = root @ root.T + 0.1 * np.eye(d)
        P = 0.5 * (P + P.T)
    scale = 10.0 ** rng.uniform(-2, 4)
    Q = np.linalg.qr(rng.normal(size=(d, d)))[0]
    values = -margin - scale * rng.random(d)
    # From 3e-18 to 1e-10 of the scale: far inside the rounding of the proof up to well outside of it.
    values[0] = -margin + scale * rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-17.5, -10)
    symmetric = 0.5 * (Q * values) @ Q.T
    skew = scale * rng.normal(size=(d, d))
    return np.linalg.solve(P, symmetric + skew - skew.T), P, margin
