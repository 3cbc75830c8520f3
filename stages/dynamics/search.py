"""The matrix P of V = psi'P psi, learned: an outer search over the program of eqs. (7) and (8).

For a given P the best A_k are a convex program (`program/`); over P they are not. Its optimal value v(P) is smooth
where the multipliers Z_k of A_k'P + P A_k <= -margin I are unique, and dv = sum_k <Z_k, A_k'dP + dP A_k>, so that every
solve gives the gradient as well. P = exp(S), S symmetric, scaled to trace d, keeps it positive definite; a bound on its
condition bounds the spread of S's eigenvalues. Started from a few matrices that are long along the data's principal
axes and their bisectors, the best of them descends by a quasi-Newton method. A local minimum is what it is. Not here:
the program itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from pipeline.errors import SolverError
from stages.dynamics.program.regression import LeastSquares
from stages.dynamics.program.solve import Solution, solve
from stages.trajectory import Array

ELONGATION = 5.0
"""Condition of the matrices that the search is started from: one axis of V's ellipses is sqrt(5) times the others."""

DESCENT = 6
"""Most evaluations of the descent; in 2-D and 3-D more gained less than 0.1 % of the error."""

# As the value is flat at its minimum, a loose solve finds the same P.
_TOLERANCE = 1e-5
_SAME = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """The best P that was met.

    Attributes:
        lyapunov_matrix: array, shape (d, d), P, trace d.
        solution: of the program with this P, of loose tolerance.
        value: of the program, in units of the mean squared speed.
        evaluations: programs solved.
    """

    lyapunov_matrix: Array
    solution: Solution
    value: float
    evaluations: int


def search(problem: LeastSquares, margin: float, axes: Array, condition: float, start: Array | None = None) -> Found:
    """Find P of trace d and condition at most `condition` for which the program's value is small. Paper eqs. (7), (8).

    `margin`: 1/s. `axes`: shape (d, d), principal axes as rows, from which starts are made. `start`: P, shape (d, d),
    to descend from instead.

    Raises SolverError: the program could be solved for no start.
    """
    d = len(axes)
    tried: list[tuple[float, Array, Solution]] = []

    def value(P: Array) -> tuple[float, Array]:
        solution = solve(problem, margin, P, tolerance=_TOLERANCE, loose=True)
        slope = np.einsum("kij,kjl->il", solution.matrices, solution.multipliers)
        tried.append((solution.value, P, solution))
        return solution.value, slope + slope.T

    def shaped(point: Array) -> tuple[float, Array]:
        S = _matrix(point, d)
        P, pull = _positive(S, condition)
        try:
            v, slope = value(P)
        except SolverError:
            return math.inf, np.zeros_like(point)
        return v, _vector(pull(slope))

    for P in [start] if start is not None else starts(axes, min(ELONGATION, condition)):
        try:
            value(P)
        except SolverError as error:
            failure = error
    if not tried:
        raise failure
    best = min(tried, key=lambda entry: entry[0])[1]
    if condition > 1.0 and d > 1:
        values, vectors = np.linalg.eigh(best)
        first = _vector((vectors * np.log(values)) @ vectors.T)
        options = {"maxfun": DESCENT, "maxls": 4, "gtol": 1e-4, "ftol": 1e-4}
        minimize(shaped, first, jac=True, method="L-BFGS-B", options=options)
    v, P, solution = min(tried, key=lambda entry: entry[0])
    return Found(lyapunov_matrix=P, solution=solution, value=v, evaluations=len(tried))


def starts(axes: Array, condition: float) -> list[Array]:
    """Return I and matrices of trace d, one eigenvalue `condition` times the others, along axes and their bisectors."""
    d = len(axes)
    directions = list(axes)
    for i in range(d):
        for j in range(i):
            directions += [(axes[i] + axes[j]) / math.sqrt(2.0), (axes[i] - axes[j]) / math.sqrt(2.0)]
    matrices = [np.eye(d)]
    if condition > 1.0:
        matrices += [np.eye(d) + (condition - 1.0) * np.outer(u, u) for u in directions]
    return [matrix * (d / np.trace(matrix)) for matrix in matrices]


def _positive(S: Array, condition: float):  # type: ignore[no-untyped-def]
    """Return P = d exp(S)/tr exp(S) with its condition bounded, and the map from dv/dP to dv/dS, both (d, d)."""
    d = len(S)
    values, vectors = np.linalg.eigh(S - (np.trace(S) / d) * np.eye(d))
    spread = float(values[-1] - values[0])
    shrink = min(1.0, math.log(condition) / spread) if spread > 0.0 else 1.0
    values = shrink * values
    exponential = np.exp(values)
    raised = (vectors * exponential) @ vectors.T
    trace = float(exponential.sum())
    gaps = values[:, None] - values[None, :]
    same = np.abs(gaps) < _SAME
    divided = np.where(
        same, exponential[:, None], (exponential[:, None] - exponential[None, :]) / np.where(same, 1.0, gaps)
    )

    def pull(slope: Array) -> Array:
        within = (d / trace) * slope - (d * float((slope * raised).sum()) / trace**2) * np.eye(d)
        inner = divided * (vectors.T @ within @ vectors)
        result = shrink * inner
        if shrink < 1.0:
            # The nearer the outermost eigenvalues are to each other, the less S is shrunk.
            along = float(inner.diagonal() @ values) / spread
            result[0, 0] += along
            result[-1, -1] -= along
        result = vectors @ result @ vectors.T
        return np.asarray(result - (np.trace(result) / d) * np.eye(d))

    P = raised * (d / trace)
    return 0.5 * (P + P.T), pull


def _vector(S: Array) -> Array:
    rows, columns = np.triu_indices(len(S))
    return np.asarray(S[rows, columns] * np.where(rows == columns, 1.0, math.sqrt(2.0)))


def _matrix(point: Array, d: int) -> Array:
    rows, columns = np.triu_indices(d)
    S = np.zeros((d, d))
    S[rows, columns] = point / np.where(rows == columns, 1.0, math.sqrt(2.0))
    return S + np.triu(S, 1).T
