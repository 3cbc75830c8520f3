"""The regression of eq. (7): what the samples say about A = [A_1 ... A_K], gathered into sums whose size is K's alone.

f is linear in A, so that eq. (7), squared as its text says, is tr(A G A') - 2 tr(A H') + const with G = Phi Phi'/n and
H = Xdot Phi'/n. Where a Jacobian multiplies f, as in x' = J^-1 A Phi, the rows of A couple and G is of all its entries.
Forming G squares the condition of the samples; `LeastSquares.triangle` has the same regression unsquared, for the rare
case that needs it. Not here: the constraints and the solver (`solve.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pipeline.errors import DataError
from stages.dynamics.kernels import ModelArrays
from stages.dynamics.program.gram import coupled_sums, normal_equations, sums, write_features
from stages.trajectory import Array, frozen

_SOURCE = "training data"
# Samples whose rows are factored at a time: what a factorisation needs beside the samples stays small.
_BLOCK = 4096


class Block(NamedTuple):
    """Some samples of a regression: sum_t w_t |D_t A' - T_t|^2, or sum_t w_t |D_t vec(A) - T_t|^2 if A's rows couple.

    Attributes:
        design: array, D, shape (n, K d), metres, or (n d, d K d).
        target: array, T, shape (n, d), m/s, or (n d, 1).
        weights: array, w, shape (n,); those of all blocks sum to 1 where every sample counts alike.
    """

    design: Array
    target: Array
    weights: Array

    def rooted(self) -> Array:
        """Return [D T], every row times the root of its weight."""
        roots = np.repeat(np.sqrt(self.weights), len(self.target) // len(self.weights))
        return np.asarray(roots[:, None] * np.concatenate([self.design, self.target], axis=1))


Rows = Callable[[], Iterator[Block]]


class Triangle(NamedTuple):
    """The regression unsquared: |R A' - T|^2 + rest, or |R vec(A) - T|^2 + rest where the rows of A couple.

    Attributes:
        factor: array, R, shape (K d, K d), metres, or (d K d, d K d).
        target: array, T, shape (K d, d), m/s, or (d K d, 1).
        rest: (m/s)^2.
    """

    factor: Array
    target: Array
    rest: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Ridge:
    """sum_k weights_k |A_k - centres_k|^2, added to the regression.

    Attributes:
        weights: array, shape (K,), square metres.
        centres: array, shape (K, d, d), 1/s.
    """

    weights: Array
    centres: Array

    def __post_init__(self) -> None:
        for name in ("weights", "centres"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, kw_only=True, eq=False)
class LeastSquares:
    """The data of eq. (7): mean |f - xdot|^2 = tr(A G A') - 2 tr(A H') + mean_square_speed.

    Attributes:
        gram: array, G, shape (K d, K d), square metres; or, where the rows of A couple, (d K d, d K d), in the order
            of A's rows: the first term is then vec(A)'G vec(A).
        cross: array, shape (d, K d), H, m^2/s.
        mean_square_distance: of the samples from the goal, square metres.
        mean_square_speed: (m/s)^2.
        ridge: what is minimised beside the error, or None.
        rows: of the regression, in blocks, or None: then it cannot be had unsquared.
    """

    gram: Array
    cross: Array
    mean_square_distance: float
    mean_square_speed: float
    ridge: Ridge | None = None
    rows: Rows | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in ("gram", "cross"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def dimension(self) -> int:
        """d, the number of coordinates."""
        return int(self.cross.shape[0])

    @property
    def components(self) -> int:
        """K, the number of components."""
        return int(self.cross.shape[1]) // self.dimension

    @property
    def coupled(self) -> bool:
        """Whether the rows of A couple."""
        return bool(len(self.gram) != self.cross.shape[1])

    @cached_property
    def triangle(self) -> Triangle | None:
        """The regression unsquared, without the ridge; None where its rows are not known. One pass over them."""
        return None if self.rows is None else _triangle(self.rows(), self.gram.shape[0])

    def error(self, matrices: Array) -> float:
        """Return mean |f - xdot|^2, (m/s)^2, of A_k, shape (K, d, d), 1/s, from the sums. Paper eq. (7), squared."""
        A = np.concatenate(list(matrices), axis=1)
        quadratic = A.ravel() @ self.gram @ A.ravel() if self.coupled else ((A @ self.gram) * A).sum()
        return max(0.0, float(quadratic - 2.0 * (A * self.cross).sum()) + self.mean_square_speed)


def least_squares(position: Array, velocity: Array, model: ModelArrays) -> LeastSquares:
    """Gather the data of eq. (7) in one pass. Paper eqs. (6), (7).

    `position`, `velocity`: shape (n, d), metres and m/s. Of `model` only the mixture and the goal are read.

    Raises DataError: every point is at the goal, or nothing ever moves.
    """
    K, d = model.means.shape
    gram, cross = np.empty((K * d, K * d)), np.empty((d, K * d))
    distance, speed = normal_equations(position, velocity, model, np.empty(K), gram, cross)
    n = len(position)

    def rows() -> Iterator[Block]:
        for start in range(0, n, _BLOCK):
            x = position[start : start + _BLOCK]
            features = np.empty((len(x), K * d))
            write_features(x, model, np.empty(K), features)
            yield Block(features, velocity[start : start + _BLOCK], np.full(len(x), 1.0 / n))

    return _gathered(n, gram, cross, distance, speed, rows)


def gather(
    features: Array, velocity: Array, *, inverse_jacobian: Array | None = None, weights: Array | None = None
) -> LeastSquares:
    """Gather the data of mean w |J^-1 A Phi - xdot|^2 in one pass. Paper eq. (7); with J, not in the paper.

    `features`: Phi, shape (n, K d), metres: gamma_k psi_i, component after component. `velocity`: shape (n, d), m/s.
    `inverse_jacobian`: J^-1, shape (n, d, d); none: I. `weights`: w >= 0, shape (n,); none: 1.

    Raises DataError: shapes do not fit, a number is not finite, a weight is negative, every point is at the goal, or
    nothing ever moves. The arrays are referred to, not copied: do not modify them.
    """
    features, velocity = _contiguous(features), _contiguous(velocity)
    n, d = velocity.shape
    width = features.shape[1] if features.ndim == 2 else 0
    w = np.ones(n) if weights is None else _contiguous(weights)
    W = None if inverse_jacobian is None else _contiguous(inverse_jacobian)
    if features.shape != (n, width) or not width or width % d or w.shape != (n,) or not n:
        raise DataError(_SOURCE, f"features of shape {features.shape} do not go with velocities of shape ({n}, {d}).")
    if W is not None and W.shape != (n, d, d):
        raise DataError(_SOURCE, f"inverse Jacobians must have shape ({n}, {d}, {d}), not {W.shape}.")
    side = width if W is None else d * width
    gram, cross = np.empty((side, side)), np.empty((d, width))
    if W is None:
        distance, speed = sums(features, velocity, w, gram, cross)
    else:
        distance, speed = coupled_sums(features, velocity, W, w, np.empty(n), np.empty((n, d)), gram, cross)
    if not (np.isfinite(gram).all() and np.isfinite(cross).all() and math.isfinite(speed) and (w >= 0.0).all()):
        raise DataError(_SOURCE, "features, velocities, Jacobians and weights must be finite, weights not negative.")
    return _gathered(n, gram, cross, distance, speed, lambda: _rows(features, velocity, W, w / n))


def combined(parts: Sequence[tuple[float, LeastSquares]]) -> LeastSquares:
    """Return the sum of regressions, each times a weight, without their ridges."""
    blocks = [(weight, part.rows) for weight, part in parts if part.rows is not None]

    def rows() -> Iterator[Block]:
        for weight, each in blocks:
            for block in each():
                yield block._replace(weights=weight * block.weights)

    return LeastSquares(
        gram=np.sum([weight * part.gram for weight, part in parts], axis=0),
        cross=np.sum([weight * part.cross for weight, part in parts], axis=0),
        mean_square_distance=sum(weight * part.mean_square_distance for weight, part in parts),
        mean_square_speed=sum(weight * part.mean_square_speed for weight, part in parts),
        rows=rows if len(blocks) == len(parts) else None,
    )


def reweighted(problem: LeastSquares, matrices: Array, floor: float) -> tuple[LeastSquares, float, float]:
    """Return the problem with every weight times s/max(|r|, floor), s the rms speed, r the residual of `matrices`.

    And the weighted means of |r| and of max(|r|, (|r|^2/floor + floor)/2), its smooth upper bound, m/s. `matrices`:
    A_k, shape (K, d, d), 1/s. `floor`: m/s. One pass over the samples, of which `problem.rows` must be known.
    """
    if problem.rows is None:
        raise ValueError("a regression without its rows cannot be weighted anew.")
    A = np.concatenate(list(matrices), axis=1)
    unknowns = A.reshape(-1, 1) if problem.coupled else A.T
    scale = math.sqrt(problem.mean_square_speed)
    gram, cross = np.zeros(problem.gram.shape), np.zeros((unknowns.shape[1], len(unknowns)))
    speed = mean = bound = 0.0
    for design, target, weights in problem.rows():
        size = np.sqrt(((design @ unknowns - target) ** 2).reshape(len(weights), -1).sum(axis=1))
        kept = np.maximum(size, floor)
        mean += float((weights * size).sum())
        bound += float((weights * 0.5 * (size**2 / kept + kept)).sum())
        anew = np.repeat(weights * scale / kept, len(target) // len(weights))
        part, right = np.empty_like(gram), np.empty_like(cross)
        speed += sums(_contiguous(design), _contiguous(target), anew, part, right)[1]
        gram += part
        cross += right
    return replace(problem, gram=gram, cross=cross.reshape(problem.cross.shape), mean_square_speed=speed), mean, bound


def with_ridge(problem: LeastSquares, weight: float, centres: Array | None = None) -> LeastSquares:
    """Return the problem with weight t_k |A_k - C_k|^2 added, t_k the mean diagonal of component k's own Gram block.

    So every component is held by the same share of its own data, whatever the unit. `weight`: at least 0. `centres`:
    C_k, shape (K, d, d), 1/s; none: -c_k I with c_k of `local_rates`. Not in the paper.
    """
    d = problem.dimension
    if centres is None:
        centres = -local_rates(problem)[:, None, None] * np.eye(d)
    return replace(problem, ridge=Ridge(weights=weight * mean_diagonals(problem), centres=centres))


def local_rates(problem: LeastSquares) -> Array:
    """Return c_k >= 0, shape (K,), 1/s: of all x' = -c gamma_k z, c_k is nearest to the velocities. Not in the paper.

    Of component k alone, whatever the others do; 0 where it has no data, or moves away from the goal.
    """
    d, K = problem.dimension, problem.components
    if problem.coupled:
        energy = np.einsum("ikijkj->k", problem.gram.reshape(d, K, d, d, K, d))
    else:
        energy = np.einsum("kiki->k", problem.gram.reshape(K, d, K, d))
    pull = np.einsum("iki->k", problem.cross.reshape(d, K, d))
    return np.asarray(np.divide(np.maximum(0.0, -pull), energy, out=np.zeros(K), where=energy > 0.0))


def mean_diagonals(problem: LeastSquares) -> Array:
    """Return t_k, shape (K,), square metres: the mean diagonal of component k's own block of the Gram matrix."""
    d, K = problem.dimension, problem.components
    if problem.coupled:
        return np.asarray(problem.gram.diagonal().reshape(d, K, d).mean(axis=(0, 2)))
    return np.asarray(problem.gram.diagonal().reshape(K, d).mean(axis=1))


def _gathered(n: int, gram: Array, cross: Array, distance: float, speed: float, rows: Rows) -> LeastSquares:
    """Return the sums of n samples as means. Raises DataError where nothing moves."""
    if not speed > 0.0:
        raise DataError(_SOURCE, "every velocity is zero: a demonstration must move.")
    if not distance > 0.0:
        raise DataError(_SOURCE, "every point is at the goal: a demonstration must move.")
    return LeastSquares(
        gram=gram / n,
        cross=cross / n,
        mean_square_distance=distance / n,
        mean_square_speed=speed / n,
        rows=rows,
    )


def _rows(features: Array, velocity: Array, W: Array | None, weights: Array) -> Iterator[Block]:
    """Yield the samples in blocks; `weights`, shape (n,), are w/n."""
    d, width = velocity.shape[1], features.shape[1]
    for start in range(0, len(features), _BLOCK):
        part = slice(start, start + _BLOCK)
        if W is None:
            yield Block(features[part], velocity[part], weights[part])
        else:
            design = (W[part, :, :, None] * features[part, None, None, :]).reshape(-1, d * width)
            yield Block(design, velocity[part].reshape(-1, 1), weights[part])


def _triangle(rows: Iterator[Block], width: int) -> Triangle:
    """Factor the samples block by block, each beneath the triangle of those before it."""
    above: Array | None = None
    for block in rows:
        below = block.rooted()
        above = np.asarray(np.linalg.qr(below if above is None else np.concatenate([above, below]), mode="r"))
    assert above is not None
    # Fewer rows than columns leave a triangle that is not square.
    square = np.zeros((above.shape[1], above.shape[1]))
    square[: len(above)] = above
    rest = float((square[width:, width:] ** 2).sum())
    return Triangle(frozen(square[:width, :width]), frozen(square[:width, width:]), rest)


def _contiguous(values: Array) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)
