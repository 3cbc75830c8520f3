"""Proof, in floating point, that a learned system is stable: A_k'P + P A_k <= -margin I and P > 0. Paper eq. (8).

A Cholesky factorisation that runs to its end proves a matrix positive definite up to its rounding errors, which S. M.
Rump ("Verification of positive definiteness", BIT 46, 2006) bounds by a multiple of the trace; the rounding of
forming A'P + PA is bounded besides. So what is certified holds for the exact numbers that are stored, not only
nearly. Not here: how the matrices are found (`program/solve.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.errors import SolverError
from stages.trajectory import Array, frozen

# Unit roundoff of IEEE double precision, and the smallest normal number, below which products lose relative accuracy.
_U = 2.0**-53
_TINY = 2.0**-1022


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """What has been proved of a set of matrices.

    Attributes:
        margin: proved: A_k'P + P A_k < -margin I for every k, 1/s times the unit of P.
        largest_eigenvalues: array, shape (K,), of A_k'P + P A_k, an estimate for people.
        shift: array, shape (K,), 1/s, what was subtracted from the diagonal of A_k to make the proof succeed; 0:
            nothing.
    """

    margin: float
    largest_eigenvalues: Array
    shift: Array

    def __post_init__(self) -> None:
        for name in ("largest_eigenvalues", "shift"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def certify(matrices: Array, lyapunov_matrix: Array, margin: float) -> Certificate:
    """Prove P > 0 and A_k'P + P A_k < -margin I for every k. Paper eqs. (8), (24).

    `matrices`: A_k, shape (K, d, d), 1/s. `lyapunov_matrix`: P, shape (d, d), symmetric. `margin`: at least 0.

    Raises SolverError: it could not be proved; the message names the first component.
    """
    proved = proofs(matrices, lyapunov_matrix, margin)
    largest = largest_eigenvalues(matrices, lyapunov_matrix)
    if not proved.all():
        k = int(np.flatnonzero(~proved)[0])
        raise SolverError(
            f"Component {k} could not be proved stable: the largest eigenvalue of A'P + PA is about {largest[k]:.3g}, "
            f"it must be below {-margin:.3g}.",
            "not certified",
            {"largest_eigenvalue": float(largest.max())},
        )
    return Certificate(margin=margin, largest_eigenvalues=largest, shift=np.zeros(len(matrices)))


def restore(matrices: Array, lyapunov_matrix: Array, margin: float) -> tuple[Array, Certificate]:
    """As `certify`; where the proof fails, subtract the smallest sufficient delta I from A_k, once, and prove it again.

    Returns the matrices, shape (K, d, d), 1/s, read-only, and their certificate.

    Raises SolverError: it could not be proved even so.
    """
    matrices = np.array(matrices, dtype=np.float64)
    P = np.asarray(lyapunov_matrix, dtype=np.float64)
    proved = proofs(matrices, P, margin)
    shift = np.zeros(len(matrices))
    for k in np.flatnonzero(~proved):
        shift[k] = _sufficient_shift(matrices[k], P, margin)
        matrices[k] -= shift[k] * np.eye(len(P))
    certificate = certify(matrices, P, margin)
    return frozen(matrices), Certificate(
        margin=margin, largest_eigenvalues=certificate.largest_eigenvalues, shift=shift
    )


def proofs(matrices: Array, lyapunov_matrix: Array, margin: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return, shape (K,), whether P > 0 and A_k'P + P A_k < -margin I could be proved.

    False means "not proved", which includes matrices that hold but lie within rounding of the bound. True is a proof.
    Raises SolverError: P is not symmetric or not positive definite, or the margin is negative: no k could be proved.
    """
    P = np.asarray(lyapunov_matrix, dtype=np.float64)
    if not (margin >= 0.0 and math.isfinite(margin)):
        raise SolverError(f"A margin of {margin} cannot be certified: it must be 0 or more.", "not certified", {})
    if not (np.isfinite(P).all() and (P == P.T).all() and _proved_positive(P.tolist(), 0.0)):
        raise SolverError("P could not be proved symmetric positive definite.", "not certified", {})
    return np.array([_proved_stable(np.asarray(A), P, margin) for A in matrices], dtype=np.bool_)


def largest_eigenvalues(matrices: Array, lyapunov_matrix: Array) -> Array:
    """Return the largest eigenvalue of A_k'P + P A_k, shape (K,), estimated; inf where it is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        product = np.asarray(lyapunov_matrix) @ matrices
        formed = product + product.transpose(0, 2, 1)
    result = np.full(len(formed), np.inf)
    finite = np.isfinite(formed).all(axis=(1, 2))
    result[finite] = np.linalg.eigvalsh(formed[finite]).max(axis=1)
    return result


def _proved_stable(A: Array, P: Array, margin: float) -> bool:
    """Whether -(A'P + PA) - margin I > 0 is proved for the exact A, P and margin."""
    d = len(P)
    a, p = A.tolist(), P.tolist()
    formed = [[0.0] * d for _ in range(d)]
    largest_error = 0.0
    for i in range(d):
        error = 0.0
        for j in range(d):
            total = magnitude = 0.0
            for m in range(d):
                # Both products of a term first, so that entry (i, j) equals entry (j, i) to the last bit.
                total -= a[m][i] * p[m][j] + p[i][m] * a[m][j]
                magnitude += abs(a[m][i] * p[m][j]) + abs(p[i][m] * a[m][j])
            formed[i][j] = total
            # Two roundings of each product and d sums: gamma_(d + 2) of the magnitudes, which themselves are rounded.
            error += 2.0 * (d + 2) * _U * magnitude + 4.0 * d * _TINY
        # The spectral norm of a symmetric matrix is at most its largest absolute row sum.
        largest_error = max(largest_error, error)
    # Twice the error and a little more cover the rounding of this sum.
    return _proved_positive(formed, margin + 2.0 * largest_error + 4.0 * _U * margin)


def _proved_positive(matrix: list[list[float]], bound: float) -> bool:
    """Whether matrix - bound I > 0 is proved: Cholesky of matrix - (bound + c) I runs to its end. Rump (2006).

    With R the computed factor of B = fl(matrix - (bound + c) I), R'R = B + E, |E| <= gamma_(d+1) |R'||R|, so the
    spectral norm of E is at most gamma_(d+1)/(1 - gamma_(d+1)) tr B; the subtraction rounds each diagonal entry by u
    |b_ii|.
    """
    d = len(matrix)
    if not all(math.isfinite(entry) for row in matrix for entry in row):
        return False
    trace = sum(abs(matrix[i][i]) for i in range(d)) + d * abs(bound)
    # Twice (d + 3) u tr covers gamma_(d+1)/(1 - gamma_(d+1)), the subtraction and the roundings of c itself.
    c = 2.0 * (d + 3) * _U * trace + 8.0 * d * d * _TINY
    lowered = bound + c
    factor = [[0.0] * d for _ in range(d)]
    for j in range(d):
        pivot = matrix[j][j] - lowered
        for m in range(j):
            pivot -= factor[j][m] * factor[j][m]
        if not pivot > 0.0 or math.isinf(pivot):
            return False
        factor[j][j] = math.sqrt(pivot)
        for i in range(j + 1, d):
            entry = matrix[i][j]
            for m in range(j):
                entry -= factor[i][m] * factor[j][m]
            factor[i][j] = entry / factor[j][j]
    return True


def _sufficient_shift(A: Array, P: Array, margin: float) -> float:
    """Return about the smallest delta, 1/s, for which A - delta I can be proved: A'P + PA falls by 2 delta P."""
    with np.errstate(over="ignore", invalid="ignore"):
        product = P @ A
        formed = product + product.T + margin * np.eye(len(P))
    if not np.isfinite(formed).all():
        return 0.0
    root = np.linalg.inv(np.linalg.cholesky(P))
    excess = float(np.linalg.eigvalsh(root @ formed @ root.T).max())
    # What the proof itself gives away, with room for the roundings of this estimate.
    room = 64.0 * len(P) ** 3 * _U * float(np.abs(P).max() * np.abs(A).max() + margin) * float((root**2).sum())
    return 0.5 * max(0.0, excess) + room
