"""The plain alternative to PC-GMM: expectation maximisation of eq. (5) on positions, K given or chosen by BIC.

k-means++ starts, the likeliest of several kept, and the Bayesian information criterion over the number of components.
Direction plays no part. Not here: the iterations themselves (`polish.py`).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.cluster.vq import ClusterError, kmeans2

from pipeline.errors import DataError
from stages.mixture.data import (
    LEAST_FLOOR,
    Indices,
    by_arc_length,
    check_at_least,
    check_training_data,
    normalisation,
    numbered,
    variance_clipped,
)
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import GaussianMixture, log_densities
from stages.mixture.parameters import EmParameters
from stages.mixture.polish import maximise
from stages.trajectory import Array

_SOURCE = "training data"


def fit_em(
    position: Array, velocity: Array, lengths: Indices, parameters: EmParameters, generator: np.random.Generator
) -> MixtureFit:
    """Fit a mixture to positions alone. Paper eq. (5).

    `position`: shape (n, d), metres. `velocity`: shape (n, d), metres per second, not used. `lengths`: shape (m,),
    samples of each demonstration, in order. `generator`: will be advanced.

    Raises DataError: see `check_training_data`; or all points are the same; or there are fewer different points than
    components. ParameterError: a parameter is out of range.
    """
    _check(parameters)
    position, velocity, lengths = check_training_data(position, velocity, lengths)
    most = None if parameters.points is None else max(parameters.points, position.shape[1] + 2)
    sampled = by_arc_length(position, lengths, most)
    frame = normalisation(position[sampled])
    points = frame.apply(position[sampled])
    if parameters.components is not None:
        criterion: dict[int, float] = {}
        best = _likeliest(points, parameters.components, parameters, generator)
    else:
        fits = {K: _likeliest(points, K, parameters, generator) for K in range(1, parameters.max_components + 1)}
        criterion = {K: bic(found[1][-1], found[0], len(points)) for K, found in fits.items() if found is not None}
        best = fits[min(criterion, key=lambda K: criterion[K])]
    if best is None:
        raise DataError(
            _SOURCE,
            f"{len(points)} points do not form {parameters.components} clusters: take fewer mixture.components.",
        )
    mixture, likelihoods = best
    labels = log_densities(mixture, points).argmax(axis=1)
    mixture, labels = _in_order(mixture, labels)
    return MixtureFit(
        mixture=frame.restore(mixture),
        sampled=sampled,
        labels=labels,
        log_posterior=likelihoods[None],
        components_by_sweep=np.full((1, len(likelihoods)), mixture.components),
        criterion=criterion,
    )


def bic(log_likelihood: float, mixture: GaussianMixture, points: int) -> float:
    """Return the Bayesian information criterion, -2 log L + (free parameters) log n; the lowest is best."""
    K, d = mixture.means.shape
    free = (K - 1) + K * d + K * d * (d + 1) // 2
    return float(-2.0 * log_likelihood + free * math.log(points))


def _likeliest(
    points: Array, K: int, parameters: EmParameters, generator: np.random.Generator
) -> tuple[GaussianMixture, Array] | None:
    """Return the likeliest of several fits and its likelihoods; None if k-means finds no K clusters."""
    best: tuple[GaussianMixture, Array] | None = None
    if len(np.unique(points, axis=0)) < K:
        return None
    for _ in range(parameters.restarts):
        try:
            labels = kmeans2(points, K, minit="++", missing="raise", rng=generator)[1]
        except ClusterError:
            continue
        found = maximise(
            _moments(points, labels, parameters.variance_floor),
            points,
            parameters.iterations,
            parameters.variance_floor,
        )
        if best is None or found[1][-1] > best[1][-1]:
            best = found
    return best


def _moments(points: Array, labels: Indices, floor: float) -> GaussianMixture:
    """Return the Gaussians of points labelled 0 .. K - 1, none of them empty."""
    counts = np.bincount(labels)
    means = np.array([points[labels == k].mean(axis=0) for k in range(len(counts))])
    spread = points - means[labels]
    covariances = np.array([spread[labels == k].T @ spread[labels == k] / count for k, count in enumerate(counts)])
    return GaussianMixture(weights=counts / len(points), means=means, covariances=variance_clipped(covariances, floor))


def _in_order(mixture: GaussianMixture, labels: Indices) -> tuple[GaussianMixture, Indices]:
    """Number the components by their first point; those that are nowhere the likeliest come last."""
    met = labels[np.sort(np.unique(labels, return_index=True)[1])]
    order = np.concatenate((met, np.setdiff1d(np.arange(mixture.components), met)))
    ordered = GaussianMixture(
        weights=mixture.weights[order], means=mixture.means[order], covariances=mixture.covariances[order]
    )
    return ordered, numbered(labels)


def _check(parameters: EmParameters) -> None:
    for name in ("max_components", "restarts", "iterations"):
        check_at_least(f"mixture.{name}", getattr(parameters, name), 1)
    for name in ("components", "points"):
        if getattr(parameters, name) is not None:
            check_at_least(f"mixture.{name}", getattr(parameters, name), 1)
    check_at_least("mixture.variance_floor", parameters.variance_floor, LEAST_FLOOR)
