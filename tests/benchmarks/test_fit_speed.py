"""How the time of a fit and of its program grows with the number of samples. Run by `make bench`."""

from __future__ import annotations

import itertools
import statistics

import numpy as np
from lasa import KINDS, best_of, motions, one_mixture, samples

from stages.dynamics.lpvds import arrays
from stages.dynamics.program.regression import least_squares
from stages.dynamics.program.solve import solve
from stages.trajectory import Trajectory

PROGRAM_LIMIT = 0.002
"""Seconds, median over the motions with about 8 components; required."""
FACTORS = (1, 10, 100)
"""3,000 to 300,000 points."""
FEW = 4
"""Motions on which the growth is measured."""


def denser(demonstration: Trajectory, factor: int) -> Trajectory:
    """The same demonstration, sampled `factor` times as often."""
    time_ = np.linspace(demonstration.time[0], demonstration.time[-1], factor * len(demonstration.time))
    columns = {
        name: np.stack([np.interp(time_, demonstration.time, c) for c in getattr(demonstration, name).T], axis=1)
        for name in ("position", "velocity")
    }
    return Trajectory(dataset="denser", demo=demonstration.demo, split="train", time=time_, **columns)


def test_the_program_is_fast_and_does_not_depend_on_the_number_of_samples() -> None:
    times, longer = [], []
    for motion in motions():
        mixture = one_mixture(motion.train, 0)["pcgmm"]
        if mixture.components != 8:
            continue
        untrained = arrays(mixture, np.zeros_like(mixture.covariances), motion.goal, np.eye(2))
        position, velocity, _ = samples(motion.train)
        problem = least_squares(position, velocity, untrained)
        hundredfold = least_squares(np.tile(position, (100, 1)), np.tile(velocity, (100, 1)), untrained)
        times.append(best_of(lambda problem=problem: solve(problem, 1e-3)))
        longer.append(best_of(lambda problem=hundredfold: solve(problem, 1e-3)))
    print(
        f"\nprogram at K = 8: median {1e3 * statistics.median(times):.2f} ms, largest {1e3 * max(times):.2f} ms; "
        f"of 300,000 samples {1e3 * statistics.median(longer):.2f} ms"
    )
    assert times
    assert statistics.median(times) <= PROGRAM_LIMIT
    assert statistics.median(longer) <= 1.5 * statistics.median(times)


def test_a_fit_grows_at_most_linearly() -> None:
    print()
    for name, kind in KINDS.items():
        means = []
        for factor in FACTORS:
            seconds = []
            for motion in motions()[:FEW]:
                train = tuple(denser(t, factor) for t in motion.train)
                seconds.append(best_of(lambda kind=kind, train=train, motion=motion: kind.fit(train, motion.goal), 2))
            means.append(statistics.mean(seconds))
        print(f"{name}: " + ", ".join(f"{3000 * f} points {s:.3f} s" for f, s in zip(FACTORS, means, strict=True)))
        for smaller, larger in itertools.pairwise(means):
            assert larger <= 10 * 1.2 * smaller
