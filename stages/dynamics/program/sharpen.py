"""The last digits of the program of eqs. (7) and (8): Newton's method on its optimality conditions, in compiled code.

An interior-point method stops at a small gap. Where a constraint is nearly inactive, or nearly active, that tells the
matrices to about the root of the gap only, and a turn of the data shows. With S_k what the constraints leave and Z_k
their multipliers, optimal is where the Lagrangian's gradient by B is zero and S_k = proj(S_k - Z_k), proj being the
projection onto the positive semidefinite matrices. Newton's method converges quadratically on these equations where
the solution is strongly regular; this program's always is, as its Gram matrix is positive definite and B'P + P B
reaches every symmetric matrix. A constraint may be active with a multiplier of zero. The first step smooths proj by as
much as the gap that it is given, so that nobody guesses what is active.

D. Sun, "The strong second-order sufficient condition and constraint nondegeneracy in nonlinear semidefinite programming
and their implications", Math. Oper. Res. 31 (2006); J. Sun, D. Sun, L. Qi, "A squared smoothing Newton method for
nonsmooth matrix equations and its applications in semidefinite optimization problems", SIAM J. Optim. 14 (2004). Not in
the paper. Not here: a search that converges from anywhere; where Newton's method does not arrive, the answer stays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stages.compiled import compiled
from stages.dynamics.program.conic import SOLVED, Answer, Limits
from stages.dynamics.program.symmetric import diagonalise, invert, norm, write_turn, write_whole
from stages.trajectory import Array

ACCURACY = 1e-12
"""Norm of what is left of the optimality conditions, relative to that of B, beyond which an answer is not taken."""

STEPS = 12
"""Most Newton steps. Three or four are usual after a loose answer; only a nearly degenerate program needs more."""

# Of the Gram matrix: beyond it, its rounding, 1e-16, moves B by more than 1e-6 of its size.
_LARGEST_CONDITION = 1e10
# Relative to B: with less left there is nothing but rounding.
_ROUNDING = 1e-15


class _Program(NamedTuple):
    """What stays the same in all steps.

    Attributes:
        gram: array, G, shape (K d, K d), or (d K d, d K d) where the rows of B couple.
        cross: array, H, shape (d, K, d).
        derivatives, bounds: of the constraints; see `Limits`.
        inverse: array, shape of G, (2 G)^-1.
        compliance: array, shape (K, m, K, m), m = d (d + 1)/2: how S grows with Z where the gradient stays zero.
    """

    gram: Array
    cross: Array
    derivatives: Array
    bounds: Array
    inverse: Array
    compliance: Array


class _Point(NamedTuple):
    """A point, and what is left of the optimality conditions there. All will be modified.

    Attributes:
        x: array, shape (d, K, d), B.
        z: array, shape (K, m), halves of Z_k.
        gradient: array, shape (d, K, d), of the Lagrangian by B.
        values: array, shape (K, d), eigenvalues of S_k - Z_k.
        turns: array, shape (K, m, m), what takes halves in the frame of the eigenvectors to halves.
        framed: array, shape (K, m), halves of Z_k in that frame.
    """

    x: Array
    z: Array
    gradient: Array
    values: Array
    turns: Array
    framed: Array


def sharpen(gram: Array, cross: Array, limits: Limits, answer: Answer) -> Answer:
    """Return an answer of the program of `conic.minimise_gram` with its last digits, or as it is where that fails.

    `refinements` are then the Newton steps that were taken. They fail where the solver did, where the condition of G is
    1e10 or worse, and where they do not end below `ACCURACY`. What is left of the optimality conditions, a bound on the
    violation of the constraints, on the negative part of the multipliers and on their product, never becomes more.
    """
    if answer.status != SOLVED:
        return answer
    d = len(cross)
    K, m = limits.bounds.shape
    program = _Program(
        gram=np.ascontiguousarray(gram),
        cross=np.ascontiguousarray(cross).reshape(d, K, d),
        derivatives=np.ascontiguousarray(limits.derivatives),
        bounds=np.ascontiguousarray(limits.bounds),
        inverse=2.0 * gram,
        compliance=np.empty((K, m, K, m)),
    )
    point = _Point(
        x=answer.x.reshape(d, K, d).copy(),
        z=answer.z.copy(),
        gradient=np.empty((d, K, d)),
        values=np.empty((K, d)),
        turns=np.empty((K, m, m)),
        framed=np.empty((K, m)),
    )
    x, z, size = np.empty((d, K, d)), np.empty((K, m)), math.sqrt(float((answer.x**2).sum()))
    steps = _refine(program, point, max(1.0, size), x, z)
    return answer._replace(x=x.ravel(), z=z, refinements=steps) if steps else answer


@compiled
def _refine(program: _Program, point: _Point, size: float, x: Array, z: Array) -> int:
    """Take Newton steps from a point; return after how many it was best, 0: after none was it good enough.

    `size`: of B. Will be modified: `program.inverse`, `program.compliance`, `point`; `x`, shape (d, K, d), and `z`,
    shape (K, m), will be the best B and Z.
    """
    if not invert(program.inverse) or not norm(program.gram) * norm(program.inverse) < 0.5 * _LARGEST_CONDITION:
        return 0
    _write_compliance(program)
    before = least = math.inf
    best = 0
    for step in range(STEPS + 1):
        left = _evaluate(program, point)
        if step == 0:
            least = min(left, ACCURACY * size)
        else:
            if left < least:
                least, best = left, step
                _copy(point, x, z)
            if left <= _ROUNDING * size or not math.isfinite(left) or (best > 0 and left > 0.5 * before):
                break
        before = left
        if not _step(program, point, _smoothing(point) if step == 0 else 0.0):
            break
    return best


@compiled
def _write_compliance(program: _Program) -> None:
    """Fill in `compliance`, D (2 G)^-1 D', D being the matrix of the constraints."""
    K, m = program.bounds.shape
    d = program.cross.shape[0]
    push, pushed, half = np.empty((d, K, d)), np.empty((d, K, d)), np.empty(m)
    for other in range(K):
        for f in range(m):
            for i in range(d):
                for k in range(K):
                    for j in range(d):
                        push[i, k, j] = program.derivatives[f, i, j] if k == other else 0.0
            _times(program.inverse, push, pushed)
            for k in range(K):
                _constrain(program.derivatives, pushed, k, half)
                for e in range(m):
                    program.compliance[k, e, other, f] = half[e]


@compiled
def _evaluate(program: _Program, point: _Point) -> float:
    """Fill in all of a point but B and Z; return the norm of what is left of the optimality conditions."""
    d, K, _ = point.x.shape
    m = point.z.shape[1]
    half, symmetric, vectors = np.empty(m), np.empty((d, d)), np.empty((d, d))
    total = 0.0
    _times(program.gram, point.x, point.gradient)
    for k in range(K):
        for i in range(d):
            for j in range(d):
                slope = 2.0 * (point.gradient[i, k, j] - program.cross[i, k, j])
                for e in range(m):
                    slope += program.derivatives[e, i, j] * point.z[k, e]
                point.gradient[i, k, j] = slope
                total += slope * slope
        _constrain(program.derivatives, point.x, k, half)
        for e in range(m):
            half[e] = program.bounds[k, e] - half[e] - point.z[k, e]
        write_whole(half, symmetric)
        diagonalise(symmetric, vectors)
        for i in range(d):
            point.values[k, i] = symmetric[i, i]
        write_turn(vectors, point.turns[k])
        e = 0
        for column in range(d):
            for row in range(column + 1):
                framed = 0.0
                for f in range(m):
                    framed += point.turns[k, f, e] * point.z[k, f]
                point.framed[k, e] = framed
                # S - proj(S - Z) = Z - proj(Z - S), and S - Z is diagonal in this frame.
                apart = framed - (max(0.0, -point.values[k, row]) if row == column else 0.0)
                total += apart * apart
                e += 1
    return math.sqrt(total)


@compiled
def _smoothing(point: _Point) -> float:
    """Return how far proj is smoothed on the central path through a point, where S_k Z_k = smoothing^2 I for all k."""
    K, d = point.values.shape
    gap = 0.0
    for k in range(K):
        e = 0
        for column in range(d):
            for row in range(column + 1):
                gap += point.framed[k, e] ** 2
                if row == column:
                    gap += point.values[k, row] * point.framed[k, e]
                e += 1
    return math.sqrt(max(0.0, gap) / (K * d))


@compiled
def _step(program: _Program, point: _Point, smoothing: float) -> bool:
    """Take one Newton step, which leaves no smoothing; return whether its equations could be solved.

    proj takes an eigenvalue v to (v + sqrt(v^2 + 4 smoothing^2))/2. In the frame of the eigenvectors, its derivative
    multiplies each entry of d(S - Z) by a number between 0 and 1, 1 - c: so what is linearised is c dS + (1 - c) dZ =
    -apart, with dS = D (2 G)^-1 (gradient + D'dZ). Divided by sqrt(c), and for dZ/sqrt(c), that is a positive definite
    system; where c = 0, dZ is known at once. Will be modified: B, Z and the gradient of the point.
    """
    K, d = point.values.shape
    m = point.z.shape[1]
    side = K * m
    matrix, right, root, change = np.empty((side, side)), np.empty(side), np.empty(side), np.empty(side)
    pushed, block, half = np.empty((d, K, d)), np.empty((m, m)), np.empty(m)
    _times(program.inverse, point.gradient, pushed)
    for k in range(K):
        _constrain(program.derivatives, pushed, k, half)
        e = 0
        for column in range(d):
            for row in range(column + 1):
                index = k * m + e
                above, below, aim = _smoothed(point.values[k, row], smoothing)
                other_above, other_below, _ = _smoothed(point.values[k, column], smoothing)
                total = above + below + other_above + other_below
                # A pair of zeros counts as inactive.
                closed = (below + other_below) / total if total > 0.0 else 0.0
                apart = point.framed[k, e] - (aim if row == column else 0.0)
                root[index] = math.sqrt(closed)
                change[index] = 0.0 if closed > 0.0 else -apart
                right[index] = 0.0
                if closed > 0.0:
                    for f in range(m):
                        right[index] -= root[index] * point.turns[k, f, e] * half[f]
                    right[index] -= apart / root[index]
                e += 1
    for k in range(K):
        for other in range(K):
            _turn(program.compliance, point.turns, k, other, block)
            for e in range(m):
                for f in range(m):
                    index, across = k * m + e, other * m + f
                    right[index] -= root[index] * block[e, f] * change[across]
                    matrix[index, across] = root[index] * block[e, f] * root[across]
    for index in range(side):
        matrix[index, index] += 1.0 - root[index] ** 2
    if not invert(matrix):
        return False
    for index in range(side):
        for across in range(side):
            change[index] += root[index] * matrix[index, across] * right[across]
    for k in range(K):
        for e in range(m):
            more = 0.0
            for f in range(m):
                more += point.turns[k, e, f] * change[k * m + f]
            point.z[k, e] += more
            for i in range(d):
                for j in range(d):
                    point.gradient[i, k, j] += program.derivatives[e, i, j] * more
    _times(program.inverse, point.gradient, pushed)
    for i in range(d):
        for k in range(K):
            for j in range(d):
                point.x[i, k, j] -= pushed[i, k, j]
    return True


@compiled
def _smoothed(value: float, smoothing: float) -> tuple[float, float, float]:
    """Return proj(v) and proj(-v), smoothed, and what the latter will be, to first order, without smoothing."""
    size = math.sqrt(value * value + 4.0 * smoothing * smoothing)
    if size == 0.0:
        return 0.0, 0.0, 0.0
    larger = 0.5 * (abs(value) + size)
    smaller = smoothing * smoothing / larger
    above, below = (larger, smaller) if value > 0.0 else (smaller, larger)
    return above, below, below - 2.0 * smoothing * smoothing / size


@compiled
def _times(matrix: Array, x: Array, out: Array) -> None:
    """Write M vec(x), M symmetric, or, if it is as small, M times each row of x into `out`, both of shape (d, K, d)."""
    n = matrix.shape[0]
    flat, result = x.ravel(), out.ravel()
    for start in range(0, flat.shape[0], n):
        for row in range(n):
            result[start + row] = 0.0
        for column in range(n):
            factor = flat[start + column]
            if factor != 0.0:
                for row in range(n):
                    result[start + row] += matrix[column, row] * factor


@compiled
def _copy(point: _Point, x: Array, z: Array) -> None:
    """Copy B and Z of a point to `x` and `z`."""
    K, d = point.values.shape
    for k in range(K):
        for i in range(d):
            for j in range(d):
                x[i, k, j] = point.x[i, k, j]
        for e in range(z.shape[1]):
            z[k, e] = point.z[k, e]


@compiled
def _constrain(derivatives: Array, x: Array, k: int, out: Array) -> None:
    """Write the half of B_k'P + P B_k into `out`, shape (m,), of B, shape (d, K, d)."""
    d = x.shape[0]
    for e in range(out.shape[0]):
        total = 0.0
        for i in range(d):
            for j in range(d):
                total += derivatives[e, i, j] * x[i, k, j]
        out[e] = total


@compiled
def _turn(compliance: Array, turns: Array, k: int, other: int, out: Array) -> None:
    """Write the compliance between two components, in the frames of their eigenvectors, into `out`, shape (m, m)."""
    m = out.shape[0]
    for e in range(m):
        for f in range(m):
            out[e, f] = 0.0
    for p in range(m):
        for f in range(m):
            inside = 0.0
            for q in range(m):
                inside += compliance[k, p, other, q] * turns[other, q, f]
            for e in range(m):
                out[e, f] += turns[k, p, e] * inside
