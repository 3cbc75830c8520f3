"""Small symmetric matrices in compiled code: inverse, norm, eigenvectors, and halves seen from the eigenvectors.

Written out, so that nothing is allocated and every machine gives the same digits, which LAPACK does not. A half is the
upper half of a symmetric matrix as `conic.py` has it: column by column, off-diagonal entries times sqrt(2). Not here:
matrices that are large or not symmetric.
"""

from __future__ import annotations

import math

from stages.compiled import compiled
from stages.trajectory import Array

# Of the largest entry: what is smaller beside the diagonal changes no eigenvalue's last bit.
_NEGLIGIBLE = 1e-17
# Jacobi's method converges quadratically, in five or six sweeps.
_SWEEPS = 30


@compiled
def invert(matrix: Array) -> bool:
    """Replace a symmetric positive definite matrix, shape (n, n), by its inverse: Gauss-Jordan elimination, in place.

    Returns False, and leaves the matrix half done, where it is not positive definite.
    """
    n = matrix.shape[0]
    for p in range(n):
        pivot = matrix[p, p]
        if not pivot > 0.0:
            return False
        matrix[p, p] = 1.0
        for column in range(n):
            matrix[p, column] /= pivot
        for row in range(n):
            if row != p:
                factor = matrix[row, p]
                matrix[row, p] = 0.0
                for column in range(n):
                    matrix[row, column] -= factor * matrix[p, column]
    return True


@compiled
def norm(matrix: Array) -> float:
    """Return the largest absolute row sum, which is at least the largest eigenvalue in size."""
    largest = 0.0
    for row in range(matrix.shape[0]):
        total = 0.0
        for column in range(matrix.shape[1]):
            total += abs(matrix[row, column])
        largest = max(largest, total)
    return largest


@compiled
def diagonalise(matrix: Array, vectors: Array) -> None:
    """Find the eigenvalues and eigenvectors of a symmetric matrix, shape (d, d), by Jacobi's method, in place.

    G. Golub, C. Van Loan, Matrix Computations (2013), 8.5. Will be modified: `matrix`, which becomes diagonal, and
    `vectors`, shape (d, d), whose columns become the eigenvectors.
    """
    d = matrix.shape[0]
    largest = 0.0
    for i in range(d):
        for j in range(d):
            largest = max(largest, abs(matrix[i, j]))
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        turned = False
        for p in range(d):
            for q in range(p + 1, d):
                if abs(matrix[p, q]) > _NEGLIGIBLE * largest:
                    _annihilate(matrix, vectors, p, q)
                    turned = True
                matrix[p, q] = matrix[q, p] = 0.0
        if not turned:
            break


@compiled
def _annihilate(matrix: Array, vectors: Array, p: int, q: int) -> None:
    """Turn axes p and q so that the entry between them becomes zero, but for rounding."""
    half = 0.5 * (matrix[q, q] - matrix[p, p]) / matrix[p, q]
    tangent = math.copysign(1.0 / (abs(half) + math.sqrt(half * half + 1.0)), half)
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for i in range(matrix.shape[0]):
        first, second = matrix[i, p], matrix[i, q]
        matrix[i, p], matrix[i, q] = cosine * first - sine * second, sine * first + cosine * second
        first, second = vectors[i, p], vectors[i, q]
        vectors[i, p], vectors[i, q] = cosine * first - sine * second, sine * first + cosine * second
    for i in range(matrix.shape[0]):
        first, second = matrix[p, i], matrix[q, i]
        matrix[p, i], matrix[q, i] = cosine * first - sine * second, sine * first + cosine * second


@compiled
def write_turn(vectors: Array, out: Array) -> None:
    """Write the orthogonal matrix that takes the half of V'S V to the half of S, V orthogonal, shape (d, d).

    Will be modified: `out`, shape (m, m), m = d (d + 1)/2.
    """
    d = vectors.shape[0]
    e = 0
    for column in range(d):
        for row in range(column + 1):
            f = 0
            for b in range(d):
                for a in range(b + 1):
                    both = vectors[row, a] * vectors[column, b] + vectors[column, a] * vectors[row, b]
                    if row == column:
                        both *= math.sqrt(0.5)
                    if a == b:
                        both *= math.sqrt(0.5)
                    out[e, f] = both
                    f += 1
            e += 1


@compiled
def write_whole(half: Array, out: Array) -> None:
    """Write the symmetric matrix of a half, shape (m,), into `out`, shape (d, d)."""
    e = 0
    for column in range(out.shape[0]):
        for row in range(column + 1):
            out[row, column] = out[column, row] = half[e] * (1.0 if row == column else math.sqrt(0.5))
            e += 1
