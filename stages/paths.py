"""Paths as curves: length, resampling by time or by arc length, and dynamic time warping, ref. [35].

Used to learn (which candidate follows its demonstrations best) and to evaluate. The sum of distances along a warping
path grows with the number of samples: bring both paths to a number that is stated. Not here: the paper's swept error
area, eq. (26) (`stages/evaluate/dtwd.py`).
"""

from __future__ import annotations

import numpy as np

from stages.compiled import compiled
from stages.trajectory import Array


@compiled
def _warp(a: Array, b: Array) -> tuple[float, float]:
    """Cost and number of pairs of the best warping path; a is (d, n), b is (d, m) and reversed in time.

    Cells are filled by anti-diagonals i + j = k, which do not depend on each other and so are computed side by side.
    `cost1`, `pairs1` hold diagonal k - 1 and `cost2`, `pairs2` diagonal k - 2, cell i at index i + 1; what lies outside
    the table is infinite: index 0, and every index that no diagonal has reached yet.
    """
    n, m = a.shape[1], b.shape[1]
    cost0, cost1, cost2 = np.full(n + 1, np.inf), np.full(n + 1, np.inf), np.full(n + 1, np.inf)
    pairs0, pairs1, pairs2 = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    gap = np.empty(n)
    cost2[0] = 0.0  # before the first cell
    for k in range(n + m - 1):
        low, high = max(0, k - m + 1), min(n - 1, k)
        count = high - low + 1
        shift = low + m - 1 - k
        gap[:count] = 0.0
        for c in range(a.shape[0]):
            row, other = a[c, low : high + 1], b[c, shift : shift + count]
            for i in range(count):
                gap[i] += (row[i] - other[i]) ** 2
        for i in range(count):
            at = low + i
            cost, pairs = cost2[at], pairs2[at]
            other_cost, other_pairs = cost1[at], pairs1[at]
            better = (other_cost < cost) | ((other_cost == cost) & (other_pairs < pairs))
            cost, pairs = (other_cost if better else cost), (other_pairs if better else pairs)
            other_cost, other_pairs = cost1[at + 1], pairs1[at + 1]
            better = (other_cost < cost) | ((other_cost == cost) & (other_pairs < pairs))
            cost, pairs = (other_cost if better else cost), (other_pairs if better else pairs)
            cost0[at + 1] = cost + np.sqrt(gap[i])
            pairs0[at + 1] = pairs + 1.0
        if k == 0:
            cost2[0] = np.inf
        cost0, cost1, cost2 = cost2, cost0, cost1
        pairs0, pairs1, pairs2 = pairs2, pairs0, pairs1
    return float(cost1[n]), float(pairs1[n])


def dynamic_time_warping(a: Array, b: Array) -> tuple[float, int]:
    """Classic dynamic time warping: Euclidean distances, steps (1, 0), (0, 1) and (1, 1), no window. Ref. [35].

    Of warping paths of equal cost the one with the fewest pairs counts, so the answer is the same with `a` and `b`
    exchanged.

    Args:
        a: array, shape (n, d), metres.
        b: array, shape (m, d), metres.

    Returns:
        The distances summed along the warping path, metres, and the number of its pairs.

    Raises:
        ValueError: the dimensions differ, or a path is empty.
    """
    if a.ndim != 2 or b.ndim != 2 or a.shape[1] != b.shape[1] or a.size == 0 or b.size == 0:
        raise ValueError(f"two paths of one dimension are needed, not {a.shape} and {b.shape}.")
    cost, pairs = _warp(np.ascontiguousarray(a.T), np.ascontiguousarray(b[::-1].T))
    return float(cost), int(pairs)


def _resample(clock: Array, path: Array, samples: int) -> Array:
    if samples < 2 or path.ndim != 2 or path.shape[0] != clock.shape[0] or path.shape[0] == 0:
        raise ValueError(f"at least 2 samples of a path of shape (n, d) are needed, not {samples} of {path.shape}.")
    at = np.linspace(clock[0], clock[-1], samples)
    return np.stack([np.interp(at, clock, column) for column in path.T], axis=1)


def resample_time(time: Array, path: Array, samples: int) -> Array:
    """The path at `samples` instants, evenly spaced from its first to its last, by linear interpolation.

    Args:
        time: array, shape (n,), seconds, strictly increasing.
        path: array, shape (n, d), metres.
        samples: at least 2.

    Returns:
        array, shape (samples, d), metres.

    Raises:
        ValueError: the shapes differ, or fewer than 2 samples are asked for.
    """
    return _resample(time, path, samples)


def arc_length(path: Array) -> Array:
    """Length of a path, array, shape (n, d), metres, up to each of its samples: array, shape (n,), metres, from 0."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def resample_arc(path: Array, samples: int) -> Array:
    """The path at `samples` points, evenly spaced in arc length, by linear interpolation; pauses leave no trace.

    Args:
        path: array, shape (n, d), metres. A path that never moves is repeated.
        samples: at least 2.

    Returns:
        array, shape (samples, d), metres.

    Raises:
        ValueError: the path is empty, or fewer than 2 samples are asked for.
    """
    if path.shape[0] == 0:
        raise ValueError("an empty path has no points.")
    length = arc_length(path)
    moved = np.concatenate([[True], np.diff(length) > 0.0])
    return _resample(length[moved], path[moved], samples)
