"""The normal-inverse-Wishart likelihood of a table of points, with its mean and covariance integrated out.

mu ~ N(mu_0, Sigma/kappa_0), Sigma ~ IW(Lambda_0, nu_0), the conjugate prior of ref. [32]. Points are centred, so mu_0
= 0, and nu_0 = d. A table is known by its moments alone: its number of points, their sum and their sum of outer
products. Compiled, for the sampler of `links.py`. Not here: which points share a table.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import multigammaln

from stages.compiled import inlined
from stages.trajectory import Array


def moments(points: Array) -> Array:
    """Return (1, x, lower half of x x' by rows) of points, shape (n, d), as rows, shape (n, 1 + d + d (d + 1)/2).

    The sum of its points' rows is all that a table needs to remember.
    """
    rows, columns = np.tril_indices(points.shape[1])
    return np.concatenate((np.ones((len(points), 1)), points, points[:, rows] * points[:, columns]), axis=1)


def count_constants(points: int, kappa: float, prior_scatter: Array) -> Array:
    """Return the part of a table's log likelihood that depends on its count alone, shape (points + 1,).

    `kappa`: kappa_0, in points. `prior_scatter`: Lambda_0, shape (d, d), in the square of the points' unit.
    """
    d = prior_scatter.shape[0]
    n = np.arange(points + 1)
    log_det_prior = float(np.linalg.slogdet(prior_scatter)[1])
    return np.asarray(
        -0.5 * n * d * math.log(math.pi)
        + multigammaln(0.5 * (d + n), d)
        - multigammaln(0.5 * d, d)
        + 0.5 * d * log_det_prior
        + 0.5 * d * np.log(kappa / (kappa + n))
    )


@inlined
def log_marginal(table: Array, kappa: float, prior_scatter: Array, constants: Array, scratch: Array) -> float:
    """Return log p(points of one table) from their summed `moments`, shape (1 + d + d (d + 1)/2,).

    `prior_scatter`: Lambda_0, shape (d, d). `constants`: of `count_constants`. `scratch`, shape (d, d): will be
    modified.
    """
    d = prior_scatter.shape[0]
    # Lambda_n = Lambda_0 + sum x x' - (kappa_0 + n) mu_n mu_n', with mu_n = sum x / (kappa_0 + n)
    shrink = 1.0 / (kappa + table[0])
    entry = 1 + d
    for i in range(d):
        for j in range(i + 1):
            scratch[i, j] = prior_scatter[i, j] + table[entry] - shrink * table[1 + i] * table[1 + j]
            entry += 1
    return float(constants[int(table[0])] - 0.5 * (d + table[0]) * log_determinant(scratch))


@inlined
def log_determinant(matrix: Array) -> float:
    """Return log det of a symmetric positive definite matrix, shape (d, d), from its lower half.

    In closed form for d = 2 and 3; above by Cholesky, for which `matrix` will be modified.
    """
    d = matrix.shape[0]
    if d == 2:
        return math.log(matrix[0, 0] * matrix[1, 1] - matrix[1, 0] * matrix[1, 0])
    if d == 3:
        # By pivots: the sum of six products would cancel where two variances of three are near the floor.
        second, third = matrix[1, 0] / matrix[0, 0], matrix[2, 0] / matrix[0, 0]
        pivot = matrix[1, 1] - second * matrix[1, 0]
        rest = matrix[2, 1] - third * matrix[1, 0]
        return math.log(matrix[0, 0] * pivot * (matrix[2, 2] - third * matrix[2, 0] - rest * rest / pivot))
    result = 0.0
    for j in range(d):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        result += math.log(matrix[j, j])
        root = math.sqrt(matrix[j, j])
        matrix[j, j] = root
        for i in range(j + 1, d):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= root
    return result
