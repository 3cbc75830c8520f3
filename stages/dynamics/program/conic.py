"""The semidefinite program of eqs. (7) and (8) as Clarabel takes it: in Gram form, and unsquared.

Variables are the entries of a matrix B = [B_1 ... B_K], row after row, without units; the constraints are B_k'P + P B_k
<= -bound_k I. A symmetric matrix is handed over as the vector of its upper half, column by column, off-diagonal entries
times sqrt(2). Not here: units (`scaling.py`), the last digits (`sharpen.py`), whether an answer is good enough
(`solve.py`).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stages.trajectory import Array

Indices = NDArray[np.int64]

SOLVED = "Solved"
# Clarabel goes 0.99 of the way to the boundary of the cone. Shorter steps keep away from where rounding is amplified,
# for two more iterations: for programs so difficult that a loose answer could not be sharpened.
_STEP_FRACTION = 0.9
_REFINEMENT = 1e-15
# Of the solver, in turn: where the first is beyond its reach ("almost solved"), Clarabel's own default will do.
_TOLERANCES = (1e-9, 1e-8)
_LOOSE_TOLERANCE = 1e-6
# Clarabel adds 1e-8 to the diagonal of its equations, which hides what the unsquared form is there to resolve.
_UNSQUARED_REGULARISATION = 1e-12
# A symmetric 2 x 2 matrix (a, sqrt(2) b, c) is positive semidefinite if (a + c, a - c, 2 b)/sqrt(2) lies in the
# second-order cone, which takes three quarters of the work and is more accurate. The map is orthogonal.
_SECOND_ORDER = np.array([[1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [0.0, math.sqrt(2.0), 0.0]]) / math.sqrt(2.0)


class Answer(NamedTuple):
    """What the solver returned.

    Attributes:
        x: array, shape (d K d,), the entries of B.
        z: array, shape (K, d (d + 1)/2), the multipliers of the constraints.
        status: the solver's word.
        iterations: of the solver.
        refinements: Newton steps that were taken after the solver; see `sharpen.py`.
    """

    x: Array
    z: Array
    status: str
    iterations: int
    refinements: int = 0


class Limits(NamedTuple):
    """The constraints: what each component's bound leaves is bounds_k - sum_ij derivatives_ij B_k,ij >= 0.

    Attributes:
        derivatives: array, shape (d (d + 1)/2, d, d), of the half of B'P + P B.
        bounds: array, shape (K, d (d + 1)/2).
    """

    derivatives: Array
    bounds: Array


def limits(lyapunov_matrix: Array, bound: Array) -> Limits:
    """Return the constraints B_k'P + P B_k <= -bound_k I. `lyapunov_matrix`: P, shape (d, d). `bound`: shape (K,)."""
    d = len(lyapunov_matrix)
    columns, rows, scale = _upper(d)
    unit = np.eye(d)
    sums = np.einsum("aj,ib->abij", unit, lyapunov_matrix) + np.einsum("bj,ai->abij", unit, lyapunov_matrix)
    return Limits(sums[rows, columns] * scale[:, None, None], -bound[:, None] * unit[rows, columns])


def slack(limits: Limits, B: Array) -> Array:
    """Return what the constraints leave, halves, shape (K, d (d + 1)/2), at B, shape (d, K, d)."""
    total = np.zeros(limits.bounds.shape)
    for i, j in np.ndindex(limits.derivatives.shape[1:]):
        total += limits.derivatives[:, i, j] * B[i, :, j, None]
    return np.asarray(limits.bounds - total)


def pull(limits: Limits, z: Array) -> Array:
    """Return the gradient of sum_k <z_k, B_k'P + P B_k> by B, shape (d, K, d), of z, shape (K, d (d + 1)/2)."""
    total = np.zeros((limits.derivatives.shape[1], len(z), limits.derivatives.shape[2]))
    for entry, derivative in enumerate(limits.derivatives):
        total += derivative[:, None, :] * z[None, :, entry, None]
    return total


def whole(vectors: Array, d: int) -> Array:
    """Return symmetric matrices, shape (..., d, d), of halves, shape (..., d (d + 1)/2)."""
    columns, rows, scale = _upper(d)
    matrices = np.empty((*vectors.shape[:-1], d, d))
    matrices[..., columns, rows] = matrices[..., rows, columns] = vectors / scale
    return matrices


def minimise_gram(gram: Array, cross: Array, limits: Limits, loose: bool) -> Answer:
    """Minimise tr(B G B') - 2 tr(B H') under the constraints, or vec(B)'G vec(B) - 2 tr(B H').

    `gram`: G, shape (K d, K d) or (d K d, d K d). `cross`: H, shape (d, K d). `loose`: stop at 1e-6, not 1e-9.
    """
    d, size = len(cross), cross.size
    K, copies = size // d**2, size // len(gram)
    rows, columns, indices, starts = _triangle_pattern(len(gram), copies)
    entries = 2.0 * gram[rows, columns]
    quadratic = _Columns(entries.tolist() * copies, indices, starts, (size, size))
    linear = -2.0 * cross.ravel()
    cones = [clarabel.PSDTriangleConeT(d)] * K
    if d == 2:
        cones = [clarabel.SecondOrderConeT(3)] * K
        limits = Limits(np.einsum("st,tij->sij", _SECOND_ORDER, limits.derivatives), limits.bounds @ _SECOND_ORDER.T)
    for settings in [_loose_settings()] if loose else map(_settings, _TOLERANCES):
        answer = _run(quadratic, linear, limits, cones, settings)
        if answer.status == SOLVED:
            break
    return answer._replace(z=answer.z @ _SECOND_ORDER) if d == 2 else answer


def minimise_unsquared(factor: Array, target: Array, limits: Limits) -> Answer:
    """Minimise |R B' - T|^2 under the constraints, or |R vec(B) - T|^2, without forming R'R.

    The residual is a variable of its own, so that the condition of R is not squared. `factor`: R, shape (K d, K d) or
    (d K d, d K d). `target`: T, shape (K d, d) or (d K d, 1).
    """
    K, d, _ = len(limits.bounds), *limits.derivatives.shape[1:]
    size = target.size
    identity = sparse.identity(size)
    quadratic = sparse.block_diag([sparse.csc_matrix((size, size)), 2.0 * identity], format="csc")
    left = _constraint(limits)
    inequalities = sparse.csc_matrix((left.data, left.indices, left.indptr), shape=left.shape)
    copies = sparse.kron(sparse.identity(target.shape[1]), factor)
    matrix = sparse.bmat([[copies, -identity], [inequalities, None]], format="csc")
    bounds = np.concatenate([target.T.ravel(), limits.bounds.ravel()])
    cones = [clarabel.ZeroConeT(size)] + [clarabel.PSDTriangleConeT(d)] * K
    for tolerance in _TOLERANCES:
        settings = _new_settings(tolerance)
        settings.static_regularization_constant = _UNSQUARED_REGULARISATION
        found = clarabel.DefaultSolver(quadratic, np.zeros(2 * size), matrix, bounds, cones, settings).solve()
        if str(found.status) == SOLVED:
            break
    z = np.asarray(found.z)[size:].reshape(K, -1)
    return Answer(np.asarray(found.x)[:size], z, str(found.status), int(found.iterations))


class _Columns(NamedTuple):
    """A sparse matrix in compressed columns, as Clarabel reads it: it takes lists several times faster than arrays."""

    data: list[float]
    indices: list[int]
    indptr: list[int]
    shape: tuple[int, int]
    has_canonical_format: bool = True
    has_sorted_indices: bool = True


def _run(
    quadratic: _Columns, linear: Array, limits: Limits, cones: list[object], settings: clarabel.DefaultSettings
) -> Answer:
    solver = clarabel.DefaultSolver(quadratic, linear, _constraint(limits), limits.bounds.ravel(), cones, settings)
    found = solver.solve()
    z = np.array(found.z).reshape(limits.bounds.shape)
    return Answer(np.array(found.x), z, str(found.status), int(found.iterations))


def _constraint(limits: Limits) -> _Columns:
    """Return the matrix that takes the entries of B to the halves of B_k'P + P B_k; zeros are left out."""
    K, size = limits.bounds.shape
    d = limits.derivatives.shape[1]
    taken, indices, starts = _constraint_pattern(K, d, (limits.derivatives != 0.0).tobytes())
    return _Columns(limits.derivatives.ravel()[taken].tolist(), indices, starts, (K * size, K * d * d))


def _new_settings(tolerance: float) -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.direct_solve_method = "qdldl"
    settings.presolve_enable = False
    # The scaling of `solve.py` is better: the solver's own treats coordinates apart, so that a rotation would change
    # the digits.
    settings.equilibrate_enable = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.max_step_fraction = _STEP_FRACTION
    settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = _REFINEMENT
    settings.iterative_refinement_max_iter = 30
    return settings


@lru_cache(maxsize=2)
def _settings(tolerance: float) -> clarabel.DefaultSettings:
    return _new_settings(tolerance)


@lru_cache(maxsize=1)
def _loose_settings() -> clarabel.DefaultSettings:
    """Return Clarabel's own steps and refinement, with which it is done sooner."""
    settings, usual = _new_settings(_LOOSE_TOLERANCE), clarabel.DefaultSettings()
    settings.max_step_fraction = usual.max_step_fraction
    settings.iterative_refinement_reltol = usual.iterative_refinement_reltol
    settings.iterative_refinement_abstol = usual.iterative_refinement_abstol
    settings.iterative_refinement_max_iter = usual.iterative_refinement_max_iter
    return settings


@lru_cache(maxsize=16)
def _upper(d: int) -> tuple[Indices, Indices, Array]:
    """Return the columns and rows of the upper half of a matrix, column by column, and what scales its entries."""
    columns, rows = np.tril_indices(d)
    return columns, rows, np.where(rows == columns, 1.0, math.sqrt(2.0))


@lru_cache(maxsize=64)
def _triangle_pattern(side: int, copies: int) -> tuple[Indices, Indices, list[int], list[int]]:
    """Return which entries of G fill the upper half of one block, and the compressed columns of the blocks."""
    columns, rows = np.tril_indices(side)  # of the transpose: the upper half, column by column
    indices = np.concatenate([rows + block * side for block in range(copies)])
    starts = np.concatenate(([0], np.cumsum(np.tile(np.arange(1, side + 1), copies))))
    return rows, columns, indices.tolist(), starts.tolist()


@lru_cache(maxsize=64)
def _constraint_pattern(K: int, d: int, present: bytes) -> tuple[Indices, list[int], list[int]]:
    """Return which derivative fills each entry, its row, and where each column starts, columns in the order of B."""
    mask = np.frombuffer(present, dtype=np.bool_).reshape(-1, d, d)
    taken, indices, starts = [], [], [0]
    for i in range(d):
        for k in range(K):
            for j in range(d):
                entries = np.flatnonzero(mask[:, i, j])
                taken += [(int(entry) * d + i) * d + j for entry in entries]
                indices += [k * len(mask) + int(entry) for entry in entries]
                starts.append(len(taken))
    return np.array(taken), indices, starts
