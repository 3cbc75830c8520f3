"""Expectation maximisation of a Gaussian mixture, eq. (5), under a variance floor, from a given start.

One pass over the points an iteration, in compiled code. Shared by PC-GMM (at most a few iterations after sampling)
and by the plain mixture of `em.py`. Not here: where the start comes from, or how many components there should be.
"""

from __future__ import annotations

import math

import numpy as np

from stages.compiled import compiled
from stages.mixture.data import variance_clipped
from stages.mixture.gaussian import GaussianMixture, whiten
from stages.trajectory import Array

# exp(-37) is half a unit in the last place of 1: a responsibility below it cannot change the others.
_NEGLIGIBLE = -37.0
# Mean log likelihood a point, natural logarithm: less gain than this is no progress.
_NO_GAIN = 1e-5
# A component with less weight than this keeps its place and shape: its sums say nothing.
_EMPTY = 1e-12


def polish(mixture: GaussianMixture, x: Array, iterations: int, floor_variance: float) -> GaussianMixture:
    """Return `mixture` after at most `iterations` of expectation maximisation on all points. Paper eq. (5).

    `x`: shape (n, d), metres. `floor_variance`: smallest variance in any direction, square metres. The likelihood never
    falls, provided the start is above the floor; a start below it is lifted first.
    """
    return maximise(mixture, x, iterations, floor_variance)[0]


def maximise(
    mixture: GaussianMixture, x: Array, iterations: int, floor_variance: float
) -> tuple[GaussianMixture, Array]:
    """As `polish`; also return the log likelihood of all points before each iteration and after the last."""
    x = np.ascontiguousarray(x, dtype=np.float64)
    n, d = x.shape
    K = mixture.components
    weights, means = mixture.weights, mixture.means
    covariances = variance_clipped(mixture.covariances, floor_variance)
    counts, sums, outers, gamma = np.empty(K), np.empty((K, d)), np.empty((K, d, d)), np.empty(K)
    history: list[float] = []
    for iteration in range(iterations + 1):
        factors = whiten(weights, means, covariances)
        history.append(expect(x, *factors, gamma, counts, sums, outers))
        no_gain = iteration > 0 and history[-1] - history[-2] < _NO_GAIN * n
        if iteration == iterations or no_gain:
            break
        filled = counts > _EMPTY * n
        divisor = np.where(filled, counts, 1.0)
        shift = np.where(filled[:, None], sums / divisor[:, None], 0.0)
        scatter = outers / divisor[:, None, None] - shift[:, :, None] * shift[:, None, :]
        weights = np.maximum(counts / n, _EMPTY)
        weights = weights / weights.sum()
        means = means + shift
        covariances = np.where(filled[:, None, None], variance_clipped(scatter, floor_variance), covariances)
    return GaussianMixture(weights=weights, means=means, covariances=covariances), np.array(history)


@compiled
def expect(
    x: Array, offsets: Array, means: Array, whiteners: Array, gamma: Array, counts: Array, sums: Array, outers: Array
) -> float:
    """Sum the responsibilities' moments over all points x, shape (n, d), metres; return the log likelihood.

    `offsets`, `means`, `whiteners`: as of `gaussian.Whitening`. `gamma`, shape (K,): scratch. Will be modified:
    `counts` (K,), `sums` (K, d) in metres and `outers` (K, d, d) in square metres, of gamma_k, gamma_k (x - mu_k) and
    gamma_k (x - mu_k)(x - mu_k)'; taken about the old means, because about zero they would cancel.
    """
    n, d = x.shape
    K = offsets.shape[0]
    counts[:] = 0.0
    sums[:] = 0.0
    outers[:] = 0.0
    likelihood = 0.0
    for t in range(n):
        largest = -np.inf
        for k in range(K):
            squared = 0.0
            for i in range(d):
                whitened = whiteners[k, i, 0] * (x[t, 0] - means[k, 0])
                for j in range(1, i + 1):
                    whitened += whiteners[k, i, j] * (x[t, j] - means[k, j])
                squared += whitened * whitened
            gamma[k] = offsets[k] - 0.5 * squared
            largest = max(largest, gamma[k])
        total = 0.0
        for k in range(K):
            above = gamma[k] - largest
            gamma[k] = math.exp(above) if above > _NEGLIGIBLE else 0.0
            total += gamma[k]
        likelihood += largest + math.log(total)
        for k in range(K):
            if gamma[k] > 0.0:
                share = gamma[k] / total
                counts[k] += share
                for i in range(d):
                    moment = share * (x[t, i] - means[k, i])
                    sums[k, i] += moment
                    for j in range(i + 1):
                        outers[k, i, j] += moment * (x[t, j] - means[k, j])
    for k in range(K):
        for i in range(d):
            for j in range(i):
                outers[k, j, i] = outers[k, i, j]
    return likelihood
