"""The warp that straightens a demonstration: greedy Gaussian translations that carry it towards a line to the goal.

For many motions no quadratic Lyapunov function exists: they move away from the goal before they approach it. Their
image under a warp that carries them part of the way to a straight line does approach it, and a quadratic function of
the image will do. The translations are found as in the fast diffeomorphic matching of Perrin and Schlehuber-Caissier
(Systems & Control Letters 96, 2016): each removes part of the largest error that is left. Not here: what a warp is
(`warp.py`), or what is learned in its image (`warped.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stages.compiled import compiled
from stages.dynamics.samples import frame_about
from stages.dynamics.warp import STEEPEST, Warp
from stages.paths import resample_arc
from stages.trajectory import Array, Trajectory

POINTS = 60
"""Points of the mean demonstration, evenly spaced in arc length, that are matched."""

STRIDE = 0.5
"""Part of the largest error that one translation removes."""

SLOPE = 0.9
"""Largest |v| rho sqrt(2/e) of a translation; below 1 it is a diffeomorphism."""

NARROWEST = 0.094
"""Smallest standard deviation of a translation's Gaussian, as a fraction of the motion's size."""

# Widths that are tried for a translation, and the ratio of one to the next: from the narrowest to 160 times as wide.
_WIDTHS, _WIDENING = 40, 0.88


def mean_demonstration(demonstrations: Sequence[Trajectory], goal: Array, points: int = POINTS) -> Array:
    """Return the mean of the demonstrations' paths at equal fractions of their length, relative to its end, (n, d), m.

    `goal`: x_g, shape (d,), metres.
    """
    paths = [resample_arc(demonstration.position - goal, points) for demonstration in demonstrations]
    mean = np.mean(paths, axis=0)
    return np.asarray(mean - mean[-1])


def straighten(path: Array, share: float, translations: int) -> Warp:
    """Return a warp that carries `path`, shape (n, d), metres, ending at 0, `share` of the way to its straight chord.

    `share`: 0: not at all (the identity); towards 1 it is pressed onto the line, which no smooth map does well.
    `translations`: at most this many; fewer if the match is exact.
    """
    d = path.shape[1]
    size = frame_about(path).size
    if share == 0.0 or not size > 0.0:
        return Warp.identity(d)
    line = np.linspace(1.0, 0.0, len(path))[:, None] * path[0]
    target = (1.0 - share) * path + share * line
    centres, shifts, rates = np.zeros((translations, d)), np.zeros((translations, d)), np.zeros(translations)
    found = match(path.copy(), target, NARROWEST * size, centres, shifts, rates)
    return Warp(centres=centres[:found], translations=shifts[:found], rates=rates[:found])


@compiled
def match(source: Array, target: Array, narrowest: float, centres: Array, shifts: Array, rates: Array) -> int:
    """Find translations that carry `source` towards `target`, both shape (n, d), metres; return how many.

    Each is centred at the point of largest error, moves it by `STRIDE` of that, and is as wide as makes the sum of
    squared errors smallest, within `SLOPE` and not below the standard deviation `narrowest`, metres. Will be modified:
    `source`, which becomes its image, and `centres` (M, d), `shifts` (M, d), `rates` (M,).
    """
    n, d = source.shape
    for m in range(rates.shape[0]):
        worst, largest = 0, -1.0
        for i in range(n):
            error = 0.0
            for j in range(d):
                error += (target[i, j] - source[i, j]) ** 2
            if error > largest:
                worst, largest = i, error
        length = STRIDE * math.sqrt(largest)
        if length < 1e-6 * narrowest:
            return m
        for j in range(d):
            centres[m, j] = source[worst, j]
            shifts[m, j] = STRIDE * (target[worst, j] - source[worst, j])
        trial = min(SLOPE / (length * STEEPEST), 1.0 / (math.sqrt(2.0) * narrowest))
        rates[m], least = trial, np.inf
        for _ in range(_WIDTHS):
            total = 0.0
            for i in range(n):
                weight = _weight(source[i], centres[m], trial)
                for j in range(d):
                    total += (source[i, j] + weight * shifts[m, j] - target[i, j]) ** 2
            if total < least:
                rates[m], least = trial, total
            trial *= _WIDENING
        for i in range(n):
            weight = _weight(source[i], centres[m], rates[m])
            for j in range(d):
                source[i, j] += weight * shifts[m, j]
    return int(rates.shape[0])


@compiled
def _weight(point: Array, centre: Array, rate: float) -> float:
    squared = 0.0
    for j in range(point.shape[0]):
        squared += (point[j] - centre[j]) ** 2
    return math.exp(-rate * rate * squared)
