"""What both ways of fitting a mixture share: refusals, normalisation, thinning by arc length.

Normalisation is one shift and one scale for all coordinates, so nothing that follows depends on the unit, and nothing
is tied to the axes. Not here: the fits themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import DataError, ParameterError
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Array, frozen

Indices = NDArray[np.int64]

_SOURCE = "training data"
# The square of what is larger is no number any more, with some room for sums.
_LARGEST = 1e100
# Below this fraction of the largest coordinate the spread of the data is rounding, not motion.
_NO_SPREAD = 1e-9
# Of the whole path: a difference below it is rounding, which a rotation of the data would change.
_ROUNDING = 1e-12

LEAST_FLOOR = 1e-10
"""Smallest variance floor, of the squared rms radius: below it determinants of collinear points are rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Normalisation:
    """x -> (x - centre) / radius.

    Attributes:
        centre: array, shape (d,), metres.
        radius: root mean square distance from the centre, metres: the same for every coordinate.
    """

    centre: Array
    radius: float

    def apply(self, position: Array) -> Array:
        """Return positions, shape (n, d), metres, as numbers of order one."""
        return (position - self.centre) / self.radius

    def restore(self, mixture: GaussianMixture) -> GaussianMixture:
        """Return a mixture of normalised points as one of metres."""
        return GaussianMixture(
            weights=mixture.weights,
            means=self.centre + self.radius * mixture.means,
            covariances=self.radius**2 * mixture.covariances,
        )


def normalisation(position: Array) -> Normalisation:
    """Return the shift and the scale of positions, shape (n, d), metres; raises DataError if they are all one point."""
    centre = position.mean(axis=0)
    radius = float(np.sqrt(((position - centre) ** 2).sum(axis=1).mean()))
    if not radius > _NO_SPREAD * float(np.abs(position).max()):
        raise DataError(_SOURCE, "all points are the same: a demonstration must move.")
    return Normalisation(centre=frozen(centre), radius=radius)


def check_training_data(position: Array, velocity: Array, lengths: Indices) -> tuple[Array, Array, Indices]:
    """Return the training data as arrays of the right type, or refuse them.

    `position`: shape (n, d), metres. `velocity`: shape (n, d), metres per second. `lengths`: shape (m,), the number of
    samples of each demonstration, in order.

    Raises DataError: shapes do not fit, a number is not finite or beyond 1e100, fewer than d + 2 points.
    """
    position = np.ascontiguousarray(position, dtype=np.float64)
    velocity = np.ascontiguousarray(velocity, dtype=np.float64)
    lengths = np.ascontiguousarray(lengths, dtype=np.int64)
    if position.ndim != 2 or position.shape[1] < 1 or velocity.shape != position.shape:
        raise DataError(
            _SOURCE,
            f"position and velocity must both have shape (n, d); they have {position.shape} and {velocity.shape}.",
        )
    n, d = position.shape
    if lengths.ndim != 1 or (lengths < 1).any():
        raise DataError(_SOURCE, f"the demonstrations' lengths must be a row of positive numbers, not {lengths}.")
    if int(lengths.sum()) != n:
        raise DataError(
            _SOURCE, f"the demonstrations' lengths must sum to the {n} samples there are, not {lengths.sum()}."
        )
    for name, values in (("position", position), ("velocity", velocity)):
        size = np.abs(values).max(axis=1, initial=0.0)
        bad = np.flatnonzero(~(size <= _LARGEST))
        if bad.size and np.isfinite(size[bad[0]]):
            raise DataError(_SOURCE, f"{name} is {size[bad[0]]:.3g} at sample {bad[0]}: check its unit.")
        if bad.size:
            raise DataError(_SOURCE, f"{name} is not finite at sample {bad[0]}.")
    if n < d + 2:
        raise DataError(_SOURCE, f"a mixture in {d} dimensions needs at least {d + 2} points, not {n}.")
    return position, velocity, lengths


def by_arc_length(position: Array, lengths: Indices, count: int | None) -> Indices:
    """Return the indices, ascending, of at most `count` samples spread evenly by arc length over all demonstrations.

    `position`: shape (n, d), metres. `lengths`: shape (m,), samples of each demonstration, in order. A sample is taken
    once, so a sparse recording gives fewer than `count`; none, or a count of at least n, takes every sample. Of two
    that are equally near the later one is taken, so that rounding does not decide.

    Raises DataError: no demonstration moves.
    """
    n = position.shape[0]
    if count is None or count >= n:
        return np.arange(n, dtype=np.int64)
    pieces = np.sqrt((np.diff(position, axis=0) ** 2).sum(axis=1))
    pieces[np.cumsum(lengths)[:-1] - 1] = 0.0  # the jump from one demonstration to the next is no path
    arc = np.concatenate(([0.0], np.cumsum(pieces)))
    if not arc[-1] > 0.0:
        raise DataError(_SOURCE, "all points are the same: a demonstration must move.")
    targets = (np.arange(count) + 0.5) * (arc[-1] / count)
    rounding = _ROUNDING * arc[-1]
    after = np.searchsorted(arc, targets - rounding)
    before_is_nearer = (arc[after] - targets) - (targets - arc[after - 1]) > rounding
    return np.unique(np.where(before_is_nearer, after - 1, after)).astype(np.int64)


def numbered(labels: Indices) -> Indices:
    """Return labels, shape (n,), renumbered 0, 1, ... in the order in which they first occur."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty_like(first)
    rank[np.argsort(first)] = np.arange(first.size)
    return np.asarray(rank[inverse], dtype=np.int64)


def check_at_least(location: str, value: float, least: float, *, above: bool = False) -> None:
    """Raise ParameterError unless the parameter at `location` is finite and at least, or only `above`, `least`."""
    if not np.isfinite(value):
        raise ParameterError(location, f"must be a finite number, not {value}.")
    if value < least or (above and value == least):
        raise ParameterError(location, f"must be {'more than' if above else 'at least'} {least:g}, not {value}.")


def check_at_most(location: str, value: float, most: float) -> None:
    """Raise ParameterError if the parameter at `location` is more than `most`."""
    if value > most:
        raise ParameterError(location, f"must be at most {most:g}, not {value}.")


def variance_clipped(covariances: Array, floor: float) -> Array:
    """Return covariances, shape (K, d, d), with no variance in any direction below `floor`, the same unit.

    Eigenvalues are clipped in the covariance's own axes: of all covariances above the floor this one is the
    likeliest, so expectation maximisation stays monotone, and a rotation of the data rotates it.
    """
    values, vectors = np.linalg.eigh(covariances)
    if (values >= floor).all():
        return np.asarray(0.5 * (covariances + covariances.transpose(0, 2, 1)))
    clipped = (vectors * np.maximum(values, floor)[:, None, :]) @ vectors.transpose(0, 2, 1)
    return np.asarray(0.5 * (clipped + clipped.transpose(0, 2, 1)))
