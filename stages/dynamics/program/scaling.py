"""The units of the program of eqs. (7) and (8): it is solved without any, every component at one size.

Lengths by the rms distance to the goal, speeds by the rms speed, each A_k by its component's share of the data, P by
its trace: so metres and millimetres give the same digits, and components with little data disturb nothing. Not here:
the solver (`conic.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stages.dynamics.program.conic import Limits, limits
from stages.dynamics.program.regression import LeastSquares
from stages.trajectory import Array

# Of the largest component's share of the data: a component with less has no data to speak of.
_SMALLEST_ENERGY = 1e-8


class Scaled(NamedTuple):
    """The program without units, of B = [share_1 A_1 ... share_K A_K]/rate.

    Attributes:
        gram, cross: G and H, the ridge included; shapes as of `LeastSquares`.
        constant: of what is minimised.
        limits: the constraints, of P with trace d.
        share: array, shape (K,), the root of each component's part of the data.
        lacking: array, shape (K,), what a component with too little data was given of x' = -rate z.
        ridge: arrays, shapes (K,) and (K, d, d): weights and centres without units; zero where there is no ridge.
        length, rate, stiffness: metres, 1/s, unit of P.
    """

    gram: Array
    cross: Array
    constant: float
    limits: Limits
    share: Array
    lacking: Array
    ridge: tuple[Array, Array]
    length: float
    rate: float
    stiffness: float

    def matrices(self, x: Array) -> Array:
        """Return A_k/rate, shape (K, d, d), of the entries of B, shape (d K d,)."""
        K, d, _ = self.ridge[1].shape
        return (x.reshape(d, K * d) / np.repeat(self.share, d)).reshape(d, K, d).transpose(1, 0, 2)

    def excess(self, x: Array) -> float:
        """Return what was added to the error, without unit, at the entries of B, shape (d K d,)."""
        A, (weights, centres) = self.matrices(x), self.ridge
        result = 0.0
        if self.lacking.any():
            result += float((self.lacking / len(A[0]) * ((A + np.eye(len(A[0]))) ** 2).sum(axis=(1, 2))).sum())
        if weights.any():
            result += float((weights * ((A - centres) ** 2).sum(axis=(1, 2))).sum())
        return result


def scale(problem: LeastSquares, margin: float, P: Array) -> Scaled:
    """Take the units from a program. `margin`: 1/s times the unit of P. `P`: shape (d, d)."""
    d, K = problem.dimension, problem.components
    copies = d if problem.coupled else 1
    rate = math.sqrt(problem.mean_square_speed / problem.mean_square_distance)
    gram = problem.gram / problem.mean_square_distance
    cross = problem.cross / math.sqrt(problem.mean_square_distance * problem.mean_square_speed)
    energy = gram.diagonal().reshape(copies, K, d).sum(axis=(0, 2)) / copies
    # A component without data is given a little of x' = -rate z: otherwise nothing would bound its A_k.
    lacking = np.maximum(0.0, _SMALLEST_ENERGY * energy.max() - energy)
    diagonal = gram.reshape(-1)[:: len(gram) + 1].reshape(copies, K, d)
    diagonal += (lacking / d)[:, None]
    axes = np.arange(d)
    cross.reshape(d, K, d)[axes, :, axes] -= lacking / d
    energy += lacking
    weights, centres, constant = np.zeros(K), np.zeros((K, d, d)), 1.0 + float(lacking.sum())
    if problem.ridge is not None:
        weights, centres = problem.ridge.weights / problem.mean_square_distance, problem.ridge.centres / rate
        diagonal += weights[:, None]
        cross += (weights[:, None, None] * centres).transpose(1, 0, 2).reshape(d, K * d)
        energy += d * weights
        constant += float((weights[:, None, None] * centres**2).sum())
    share = np.sqrt(energy)
    weight = np.repeat(share, d)
    every = np.concatenate([weight] * copies)
    stiffness = float(np.trace(P)) / d
    return Scaled(
        gram=gram / every[:, None] / every[None, :],
        cross=cross / weight,
        constant=constant,
        limits=limits(P / stiffness, (margin / stiffness / rate) * share),
        share=share,
        lacking=lacking,
        ridge=(weights, centres),
        length=math.sqrt(problem.mean_square_distance),
        rate=rate,
        stiffness=stiffness,
    )


def unsquared(problem: LeastSquares, scaled: Scaled) -> tuple[Array, Array, float]:
    """Return the regression as R, T and rest, as of `Triangle`, without units, all that was added to G included."""
    assert problem.triangle is not None
    d, K = problem.dimension, problem.components
    copies = d if problem.coupled else 1
    speed = scaled.length * scaled.rate
    blocks = [np.concatenate([problem.triangle.factor / scaled.length, problem.triangle.target / speed], axis=1)]
    for weights, centres in ((scaled.lacking / d, np.broadcast_to(-np.eye(d), (K, d, d))), scaled.ridge):
        roots = np.sqrt(np.tile(np.repeat(weights, d), copies))
        aims = centres.transpose(1, 0, 2).reshape(d, K * d)
        wanted = aims.reshape(-1, 1) if problem.coupled else aims.T
        blocks.append(np.concatenate([np.diag(roots), roots[:, None] * wanted], axis=1)[roots > 0.0])
    R = np.asarray(np.linalg.qr(np.concatenate(blocks), mode="r"))
    width = len(scaled.gram)
    every = np.tile(np.repeat(scaled.share, d), copies)
    rest = problem.triangle.rest / speed**2 + float((R[width:, width:] ** 2).sum())
    return R[:width, :width] / every, R[:width, width:], rest
