"""PC-GMM: the physically consistent mixture of ref. [32], which finds the number of components of eq. (5) by itself.

Points that are near each other and move alike tend to share a component: a distance-dependent Chinese restaurant over
the similarity below, with the tables' Gaussians integrated out. The most probable sweep is kept, small tables are
dissolved, and a few EM iterations on all points finish. Not here: the sampler itself (`links.py`), or the dynamics.
"""

from __future__ import annotations

import numpy as np

from stages.mixture.data import (
    LEAST_FLOOR,
    Indices,
    by_arc_length,
    check_at_least,
    check_at_most,
    check_training_data,
    normalisation,
    numbered,
    variance_clipped,
)
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import GaussianMixture, log_densities
from stages.mixture.links import sweeps
from stages.mixture.parameters import PcGmmParameters
from stages.mixture.polish import polish
from stages.mixture.seating import Prior, prior, scratch, seat
from stages.trajectory import Array

# Of the largest speed: what is slower stands still, and its direction is rounding.
_NO_MOTION = 1e-9
# Of the similarity at a time: what is computed on the way then stays in the processor's cache.
_ROWS = 32
# In rms radii: far below, nothing is similar, far above everything is, and squares are no numbers any more.
_LENGTH_SCALES = (1e-6, 1e6)
# Of the sampler: the similarity of all pairs is held in memory, 200 MB of it.
_MOST_POINTS = 5000


def fit_pcgmm(
    position: Array, velocity: Array, lengths: Indices, parameters: PcGmmParameters, generator: np.random.Generator
) -> MixtureFit:
    """Fit a mixture to positions, clustered by position and direction of motion. Paper eq. (5), ref. [32].

    `position`: shape (n, d), metres. `velocity`: shape (n, d), metres per second; only its direction counts. `lengths`:
    shape (m,), samples of each demonstration, in order. `generator`: will be advanced.

    Raises DataError: see `check_training_data`; or all points are the same. ParameterError: a parameter is out of
    range.
    """
    _check(parameters)
    position, velocity, lengths = check_training_data(position, velocity, lengths)
    n, d = position.shape
    check_at_most("mixture.points", min(parameters.points, n), _MOST_POINTS)
    sampled = by_arc_length(position, lengths, max(parameters.points, d + 2))
    frame = normalisation(position[sampled])  # centred: the prior's mean mu_0 is the mean of the points
    points = frame.apply(position[sampled])
    # The full covariance: a diagonal one would make the tables depend on the direction of the axes.
    scatter = variance_clipped((points.T @ points / len(points))[None], parameters.variance_floor)[0]
    alike = similarity(points, velocity[sampled], parameters.length_scale)
    fixed = prior(points, alike, parameters.alpha, parameters.kappa, scatter)
    tables, log_posteriors, components = _sample(fixed, parameters.chains, parameters.sweeps, generator)
    mixture, labels = components_of(points, tables, parameters.kappa, scatter, parameters.variance_floor)
    mixture = polish(mixture, frame.apply(position), parameters.polish, parameters.variance_floor)
    return MixtureFit(
        mixture=frame.restore(mixture),
        sampled=sampled,
        labels=labels,
        log_posterior=log_posteriors,
        components_by_sweep=components,
    )


def similarity(points: Array, velocity: Array, length_scale: float) -> Array:
    """Return s_ij = (1 + cos(v_i, v_j)) exp(-|x_i - x_j|^2 / (2 sigma^2)), shape (n, n). Ref. [32].

    `points`: shape (n, d), in rms radii. `velocity`: shape (n, d), any unit. `length_scale`: sigma, in rms radii. A
    point that stands still has no direction: its cosine with every other point is taken as 0, so position alone
    decides. The diagonal is zero: a point's link to itself has a weight of its own.
    """
    speed = np.sqrt((velocity**2).sum(axis=1))
    moving = speed > _NO_MOTION * speed.max()
    direction = np.where(moving[:, None], velocity / np.where(moving, speed, 1.0)[:, None], 0.0)
    result = np.empty((len(points), len(points)))
    for first in range(0, len(points), _ROWS):
        rows = slice(first, first + _ROWS)
        cosine, squared = 0.0, 0.0
        for x, v in zip(points.T, direction.T, strict=True):
            cosine = cosine + np.multiply.outer(v[rows], v)
            squared = squared + np.subtract.outer(x[rows], x) ** 2
        result[rows] = (1.0 + np.clip(cosine, -1.0, 1.0)) * np.exp(-squared / (2.0 * length_scale**2))
    np.fill_diagonal(result, 0.0)
    return result


def _sample(fixed: Prior, chains: int, length: int, generator: np.random.Generator) -> tuple[Indices, Array, Indices]:
    """Run chains of `length` sweeps; return the tables of the most probable sweep of all, shape (N,).

    Also the log posterior and the number of tables after every sweep, both of shape (chains, length).
    """
    n = len(fixed.moments)
    tables = np.zeros((chains, n), np.int64)
    log_posteriors, components = np.zeros((chains, length)), np.zeros((chains, length), np.int64)
    for chain in range(chains):
        # Drawn outside the compiled code, so that the bytes depend on numpy's generator alone; chain after chain, so
        # that those of a chain do not depend on how many follow.
        orders = generator.permuted(np.tile(np.arange(n), (length, 1)), axis=1)
        uniforms = generator.random((length, n, 2))
        # Starts on either side of the answer: that chains from both agree shows that they have forgotten them.
        start = seat(fixed, None if chain % 2 == 0 else np.maximum(np.arange(n) - 1, 0))
        sweeps(start, fixed, scratch(fixed), orders, uniforms, log_posteriors[chain], components[chain], tables[chain])
    return tables[log_posteriors.max(axis=1).argmax()], log_posteriors, components


def components_of(
    points: Array, tables: Indices, kappa: float, scatter: Array, floor: float
) -> tuple[GaussianMixture, Indices]:
    """Return the tables' Gaussians, by posterior mean, and the component of each point, shape (n,).

    Tables of fewer than d + 2 points are dissolved: each of their points goes to the component under which it is
    likeliest; if no table is larger, all points are one component. Components are numbered by their first point.

    `points`: shape (n, d), normalised. `tables`: shape (n,). `kappa`, `scatter` (d, d): kappa_0 and Lambda_0. `floor`:
    smallest variance in any direction.
    """
    n, d = points.shape
    inverse, counts = np.unique(tables, return_inverse=True, return_counts=True)[1:]
    large = counts[inverse] >= d + 2
    if not large.any():
        labels = np.zeros(n, dtype=np.int64)
    else:
        labels = np.full(n, -1)
        labels[large] = numbered(inverse[large])
        kept = _posterior_means(points[large], labels[large], kappa, scatter, floor)
        labels[~large] = log_densities(kept, points[~large]).argmax(axis=1)
        labels = numbered(labels)
    return _posterior_means(points, labels, kappa, scatter, floor), labels


def _posterior_means(points: Array, labels: Indices, kappa: float, scatter: Array, floor: float) -> GaussianMixture:
    """Return E[mu_k] and E[Sigma_k] = Lambda_n/(nu_n - d - 1) of points labelled 0 .. K - 1; mu_0 = 0, nu_0 = d."""
    counts = np.bincount(labels)
    means, covariances = [], []
    for k, count in enumerate(counts):
        own = points[labels == k]
        mean = own.sum(axis=0) / (kappa + count)
        means.append(mean)
        covariances.append((scatter + own.T @ own - (kappa + count) * np.outer(mean, mean)) / max(count - 1, 1))
    return GaussianMixture(
        weights=counts / len(points),
        means=np.array(means),
        covariances=variance_clipped(np.array(covariances), floor),
    )


def _check(parameters: PcGmmParameters) -> None:
    for name in ("alpha", "kappa"):
        check_at_least(f"mixture.{name}", getattr(parameters, name), 0.0, above=True)
    for name in ("sweeps", "chains", "points"):
        check_at_least(f"mixture.{name}", getattr(parameters, name), 1)
    check_at_least("mixture.polish", parameters.polish, 0)
    check_at_least("mixture.length_scale", parameters.length_scale, _LENGTH_SCALES[0])
    check_at_most("mixture.length_scale", parameters.length_scale, _LENGTH_SCALES[1])
    check_at_least("mixture.variance_floor", parameters.variance_floor, LEAST_FLOOR)
