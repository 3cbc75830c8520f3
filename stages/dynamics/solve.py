"""The semidefinite program of the LPV-DS, eqs. (7) and (8), in Gram form, by Clarabel called directly.

f is linear in A = [A_1 ... A_K], so eq. (7), squared as its text says, is tr(A G A') - 2 tr(A H') + const with G =
Phi Phi'/n and H = Xdot Phi'/n: one pass over the data, after which the program is as small for 300,000 samples as for
3,000. It is solved without units: lengths by the rms distance to the goal, speeds by the rms speed, each A_k by its
component's share of the data. The optimality of the answer is recomputed here. Not here: the proof that the answer is
stable (`certificate.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from pipeline.errors import DataError, SolverError
from stages.dynamics.kernels import ModelArrays, normal_equations
from stages.trajectory import Array, frozen

Indices = NDArray[np.int64]

_SOURCE = "training data"
_SOLVED = "Solved"
# Of the solver, in turn: where the first is beyond its reach ("almost solved"), Clarabel's own default will do.
_SOLVER_TOLERANCES = (1e-9, 1e-8)
# Clarabel goes 0.99 of the way to the boundary of the cone. Shorter steps keep away from where rounding is amplified:
# a rotation of the LASA data then moves A_k by 2e-7 of its size (99 of 100 fits), not 2e-5, for two more iterations.
_STEP_FRACTION = 0.9
_REFINEMENT = 1e-15
# Of the largest component's share of the data: a component with less has no data to speak of.
_SMALLEST_ENERGY = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False)
class LeastSquares:
    """The data of eq. (7): mean |A Phi - xdot|^2 = tr(A G A') - 2 tr(A H') + mean_square_speed.

    Attributes:
        gram: array, shape (K d, K d), G, square metres.
        cross: array, shape (d, K d), H, m^2/s.
        mean_square_distance: of the samples from the goal, square metres.
        mean_square_speed: (m/s)^2.
    """

    gram: Array
    cross: Array
    mean_square_distance: float
    mean_square_speed: float

    def __post_init__(self) -> None:
        for name in ("gram", "cross"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """What the program returned.

    Attributes:
        matrices: array, shape (K, d, d), A_k, 1/s.
        status: what the solver said; always ``Solved``.
        iterations: of the solver.
        objective: mean |f - xdot|^2, (m/s)^2. Paper eq. (7), squared.
        residuals: recomputed here, without units: ``feasibility`` (largest violation of eq. (8)), ``stationarity``,
            ``dual`` (of the multipliers' sign) and ``gap`` (complementarity).
    """

    matrices: Array
    status: str
    iterations: int
    objective: float
    residuals: dict[str, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrices", frozen(self.matrices))


def least_squares(position: Array, velocity: Array, model: ModelArrays) -> LeastSquares:
    """Gather the data of eq. (7) in one pass. Paper eqs. (6), (7).

    `position`, `velocity`: shape (n, d), metres and m/s. Of `model` only the mixture and the goal are read.

    Raises DataError: every point is at the goal, or nothing ever moves.
    """
    K, d = model.means.shape
    gram, cross = np.empty((K * d, K * d)), np.empty((d, K * d))
    distance, speed = normal_equations(position, velocity, model, np.empty(K), gram, cross)
    n = len(position)
    if not speed > 0.0:
        raise DataError(_SOURCE, "every velocity is zero: a demonstration must move.")
    if not distance > 0.0:
        raise DataError(_SOURCE, "every point is at the goal: a demonstration must move.")
    return LeastSquares(gram=gram / n, cross=cross / n, mean_square_distance=distance / n, mean_square_speed=speed / n)


def solve(
    problem: LeastSquares, margin: float, lyapunov_matrix: Array | None = None, tolerance: float = 1e-6
) -> Solution:
    """Minimise eq. (7), squared, subject to A_k'P + P A_k <= -margin I for every k. Paper eqs. (7), (8).

    `margin`: 1/s times the unit of P. `lyapunov_matrix`: P, shape (d, d); none: I, as in eq. (8). `tolerance`:
    largest of the recomputed residuals that is accepted.

    Raises SolverError: the solver's status is not ``Solved``, or a residual is above the tolerance.
    """
    d = problem.cross.shape[0]
    K = problem.cross.shape[1] // d
    P = np.eye(d) if lyapunov_matrix is None else np.asarray(lyapunov_matrix, dtype=np.float64)
    rate = math.sqrt(problem.mean_square_speed / problem.mean_square_distance)
    gram, cross, share = _scaled(problem, K, d)

    # The variables are the rows of B = [share_1 A_1 ... share_K A_K]/rate: the quadratic term is d copies of 2 G.
    rows, columns, layout = _gram_pattern(K, d)
    quadratic = sparse.csc_matrix((np.tile(2.0 * gram[rows, columns], d), *layout), shape=(K * d * d, K * d * d))
    linear = -2.0 * cross.ravel()
    constraint = _constraint(K, d, P.tobytes())
    bound = -(margin / rate) * np.kron(share, _svec(np.eye(d)))
    cones = [clarabel.PSDTriangleConeT(d)] * K
    for solver_tolerance in _SOLVER_TOLERANCES:
        settings = _settings(solver_tolerance)
        answer = clarabel.DefaultSolver(quadratic, linear, constraint, bound, cones, settings).solve()
        if str(answer.status) == _SOLVED:
            break

    x, z = np.asarray(answer.x), np.asarray(answer.z)
    B = x.reshape(d, K * d)
    A = (B / np.repeat(share, d)).reshape(d, K, d).transpose(1, 0, 2)
    slack, multiplier = (bound - constraint @ x).reshape(K, -1), z.reshape(K, -1)
    stationarity = (2.0 * B @ gram).ravel() + linear + constraint.T @ z
    residuals = {
        "feasibility": max(0.0, -_smallest_eigenvalue(slack / share[:, None], d)) / max(1.0, float(np.abs(A).max())),
        "stationarity": float(np.abs(stationarity).max()) / max(1.0, float(np.abs(linear).max())),
        "dual": max(0.0, -_smallest_eigenvalue(multiplier, d)),
        "gap": abs(float((slack * multiplier).sum())),
    }
    _accept(str(answer.status), int(answer.iterations), residuals, tolerance)
    relative = 1.0 + float(x @ linear) + float(((B @ gram) * B).sum())
    return Solution(
        matrices=rate * A,
        status=str(answer.status),
        iterations=int(answer.iterations),
        objective=max(0.0, relative) * problem.mean_square_speed,
        residuals=residuals,
    )


def _scaled(problem: LeastSquares, K: int, d: int) -> tuple[Array, Array, Array]:
    """Return G and H without units, every component scaled to one size, and the roots of the shares, shape (K,)."""
    gram = problem.gram / problem.mean_square_distance
    cross = problem.cross / math.sqrt(problem.mean_square_distance * problem.mean_square_speed)
    energy = gram.diagonal().reshape(K, d).sum(axis=1)
    # A component without data is given a little of x' = -rate z: otherwise nothing would bound its A_k.
    lacking = np.maximum(0.0, _SMALLEST_ENERGY * energy.max() - energy)
    gram = gram + np.diag(np.repeat(lacking / d, d))
    cross = cross - np.kron(lacking / d, np.eye(d))
    share = np.sqrt(energy + lacking)
    weight = np.repeat(share, d)
    return gram / weight[:, None] / weight[None, :], cross / weight, share


def _accept(status: str, iterations: int, residuals: dict[str, float], tolerance: float) -> None:
    """Raise SolverError unless the solver says ``Solved`` and every residual is within the tolerance."""
    if status != _SOLVED:
        raise SolverError(
            f"The program of the LPV-DS was not solved: the solver says {status} after {iterations} iterations; "
            "fewer mixture components or smoother velocities may help.",
            status,
            residuals,
        )
    for name, value in residuals.items():
        if not value <= tolerance:
            raise SolverError(
                f"The answer of the LPV-DS program is not accurate enough: its residual '{name}' is {value:.2g}, "
                f"more than dynamics.tolerance = {tolerance:g}.",
                status,
                residuals,
            )


@lru_cache(maxsize=2)
def _settings(tolerance: float) -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.direct_solve_method = "qdldl"
    settings.presolve_enable = False
    # The scaling here is better: the solver's own treats coordinates apart, so that a rotation would change the digits.
    settings.equilibrate_enable = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.max_step_fraction = _STEP_FRACTION
    settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = _REFINEMENT
    settings.iterative_refinement_max_iter = 30
    return settings


@lru_cache(maxsize=64)
def _gram_pattern(K: int, d: int) -> tuple[Indices, Indices, tuple[Indices, Indices]]:
    """Return which entries of G fill the upper half of one block, and the compressed columns of d such blocks."""
    side = K * d
    columns, rows = np.tril_indices(side)  # of the transpose: the upper half, column by column
    indices = np.concatenate([rows + block * side for block in range(d)])
    starts = np.concatenate(([0], np.cumsum(np.tile(np.arange(1, side + 1), d))))
    return rows, columns, (indices, starts)


@lru_cache(maxsize=64)
def _constraint(K: int, d: int, lyapunov_matrix: bytes) -> sparse.csc_matrix:
    """Return the matrix that takes the variables to svec(A_k'P + P A_k), component after component."""
    P = np.frombuffer(lyapunov_matrix).reshape(d, d)
    size = d * (d + 1) // 2
    result = sparse.lil_matrix((K * size, K * d * d))
    for k in range(K):
        for i in range(d):
            for j in range(d):
                unit = np.zeros((d, d))
                unit[i, j] = 1.0
                result[k * size : (k + 1) * size, i * K * d + k * d + j] = _svec(unit.T @ P + P @ unit)[:, None]
    return sparse.csc_matrix(result)


def _svec(matrix: Array) -> Array:
    """Return the upper half of a symmetric matrix, column by column, off-diagonal entries times sqrt(2)."""
    columns, rows = np.tril_indices(len(matrix))
    return np.asarray(matrix[rows, columns] * np.where(rows == columns, 1.0, math.sqrt(2.0)))


def _smallest_eigenvalue(vectors: Array, d: int) -> float:
    """Return the smallest eigenvalue of symmetric matrices given as `_svec`, shape (K, d (d + 1)/2)."""
    if not np.isfinite(vectors).all():
        return -math.inf
    columns, rows = np.tril_indices(d)
    matrices = np.zeros((len(vectors), d, d))
    matrices[:, columns, rows] = vectors / np.where(rows == columns, 1.0, math.sqrt(2.0))
    return float(np.linalg.eigvalsh(matrices).min())
