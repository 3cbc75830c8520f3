"""Gaussian mixture densities and responsibilities, eq. (5) and gamma_k of eq. (6).

Everything is computed in log space, so that the responsibilities stay finite and sum to one however far a state is from
the data. Two paths give the same numbers: numpy for many states, compiled code for one state inside a roll-out.
Not here: how a mixture is fitted (`pcgmm.py`, `em.py`, `polish.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.errors import DataError
from stages.compiled import lean
from stages.trajectory import Array, frozen

_SOURCE = "mixture"
_WEIGHT_SUM_TOLERANCE = 1e-9
_SYMMETRY_TOLERANCE = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianMixture:
    """p(x) = sum_k pi_k N(x | mu_k, Sigma_k). Paper eq. (5).

    Attributes:
        weights: array, shape (K,), pi_k, positive, sum 1.
        means: array, shape (K, d), mu_k, metres.
        covariances: array, shape (K, d, d), Sigma_k, square metres, symmetric positive definite.

    Raises:
        DataError: shapes do not fit, a number is not finite, a weight or a covariance is not positive.
    """

    weights: Array
    means: Array
    covariances: Array

    def __post_init__(self) -> None:
        for name in ("weights", "means", "covariances"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        self._check_shapes()
        if not all(np.isfinite(values).all() for values in (self.weights, self.means, self.covariances)):
            raise DataError(_SOURCE, "weights, means and covariances must be finite.")
        if (self.weights <= 0).any() or abs(self.weights.sum() - 1.0) > _WEIGHT_SUM_TOLERANCE:
            raise DataError(_SOURCE, f"weights must be positive and sum to 1; their sum is {self.weights.sum():.6g}.")
        self._check_covariances()

    @property
    def components(self) -> int:
        """K, the number of components."""
        return int(self.weights.shape[0])

    @property
    def dimension(self) -> int:
        """d, the number of coordinates."""
        return int(self.means.shape[1])

    def _check_shapes(self) -> None:
        shapes = (self.weights.shape, self.means.shape, self.covariances.shape)
        if [len(shape) for shape in shapes] != [1, 2, 3]:
            raise DataError(
                _SOURCE, f"weights, means, covariances must have shapes (K,), (K, d), (K, d, d), not {shapes}."
            )
        K, d = self.means.shape
        if K < 1 or d < 1 or self.weights.shape != (K,) or self.covariances.shape != (K, d, d):
            raise DataError(
                _SOURCE, f"weights, means, covariances must have shapes (K,), (K, d), (K, d, d), not {shapes}."
            )

    def _check_covariances(self) -> None:
        for k, covariance in enumerate(self.covariances):
            if np.abs(covariance - covariance.T).max() > _SYMMETRY_TOLERANCE * np.abs(covariance).max():
                raise DataError(_SOURCE, f"the covariance of component {k} is not symmetric.")
            try:
                np.linalg.cholesky(covariance)
            except np.linalg.LinAlgError:
                raise DataError(_SOURCE, f"the covariance of component {k} is not positive definite.") from None


class Whitening(NamedTuple):
    """A mixture in the form that densities are computed from: log N_k(x) = offset_k - |W_k (x - mu_k)|^2 / 2.

    A named tuple, because compiled code takes it as it is.

    Attributes:
        offsets: array, shape (K,), log pi_k - (d log 2 pi + log det Sigma_k) / 2.
        means: array, shape (K, d), mu_k, metres.
        whiteners: array, shape (K, d, d), W_k, the inverse of the lower Cholesky factor of Sigma_k, 1/m.
    """

    offsets: Array
    means: Array
    whiteners: Array


def whitening(mixture: GaussianMixture) -> Whitening:
    """Factor a mixture once, for many evaluations of eq. (5). The arrays of the answer are read-only."""
    return whiten(mixture.weights, mixture.means, mixture.covariances)


def whiten(weights: Array, means: Array, covariances: Array) -> Whitening:
    """Factor the mixture with weights (K,), means (K, d) in metres and covariances (K, d, d) in square metres.

    Raises `numpy.linalg.LinAlgError` where a covariance is not positive definite.
    """
    d = means.shape[1]
    factors = np.linalg.cholesky(covariances)
    # A triangular solve by substitution: the upper half of the inverse is exactly zero, which the kernels rely on.
    whiteners = np.zeros_like(factors)
    for j in range(d):
        whiteners[:, j, j] = 1.0 / factors[:, j, j]
        for i in range(j + 1, d):
            whiteners[:, i, j] = -(factors[:, i, j:i] * whiteners[:, j:i, j]).sum(axis=1) / factors[:, i, i]
    log_roots = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    offsets = np.log(weights) - 0.5 * d * math.log(2.0 * math.pi) - log_roots
    return Whitening(frozen(offsets), frozen(means), frozen(whiteners))


def log_densities(mixture: GaussianMixture, x: Array) -> Array:
    """Return log(pi_k N(x | mu_k, Sigma_k)), shape (n, K), at states x, shape (n, d), metres. Paper eq. (5)."""
    return _log_densities(whitening(mixture), x)


def responsibilities(mixture: GaussianMixture, x: Array) -> Array:
    """Return gamma_k(x), shape (n, K), at states x, shape (n, d), metres; every row sums to 1. Paper eq. (6)."""
    gamma = _log_densities(whitening(mixture), x)
    gamma -= gamma.max(axis=1, keepdims=True)
    np.exp(gamma, out=gamma)
    gamma /= gamma.sum(axis=1, keepdims=True)
    return gamma


def _log_densities(factors: Whitening, x: Array) -> Array:
    """As `log_densities`; the sums run in the order of `responsibilities_at`, so that both paths round alike."""
    x = np.asarray(x, dtype=np.float64)
    d = factors.means.shape[1]
    if x.ndim != 2 or x.shape[1] != d:
        raise DataError(_SOURCE, f"states must have shape (n, {d}), not {x.shape}.")
    difference = [x[:, j, None] - factors.means[None, :, j] for j in range(d)]
    squared = np.zeros((x.shape[0], factors.offsets.shape[0]))
    for i in range(d):
        whitened = factors.whiteners[None, :, i, 0] * difference[0]
        for j in range(1, i + 1):
            whitened += factors.whiteners[None, :, i, j] * difference[j]
        squared += whitened * whitened
    return factors.offsets[None, :] - 0.5 * squared


@lean
def responsibilities_at(x: Array, offsets: Array, means: Array, whiteners: Array, out: Array) -> float:
    """Write gamma_k(x), shape (K,), into `out` for one state x, shape (d,), metres; return log p(x). Eqs. (5), (6).

    `offsets`, `means`, `whiteners`: as of `Whitening`. `out`: will be modified. Nothing is allocated.
    """
    K, d = means.shape
    largest = -np.inf
    for k in range(K):
        squared = 0.0
        for i in range(d):
            whitened = whiteners[k, i, 0] * (x[0] - means[k, 0])
            for j in range(1, i + 1):
                whitened += whiteners[k, i, j] * (x[j] - means[k, j])
            squared += whitened * whitened
        out[k] = offsets[k] - 0.5 * squared
        largest = max(largest, out[k])
    total = 0.0
    for k in range(K):
        out[k] = math.exp(out[k] - largest)
        total += out[k]
    for k in range(K):
        out[k] /= total
    return largest + math.log(total)
