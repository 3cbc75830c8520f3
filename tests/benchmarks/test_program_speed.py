"""How long the regression and its program take, in the plain and in the coupled form. Run by `make bench`."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from lasa import best_of

from stages.dynamics.program.regression import LeastSquares, gather, with_ridge
from stages.dynamics.program.solve import solve, solve_norm

SAMPLES, COMPONENTS = 600, 10
GATHER_LIMIT = 0.0005
"""Seconds in the plane, coupled; required. Three times as much in space."""
PROGRAM_LIMIT = 0.002
"""Seconds in the plane, median, at K = 8; required, and held at K = 10."""
SHARPENING_LIMIT = {2: 0.0004, 3: 0.002}
"""Seconds in the plane and in space: what the last digits cost beside a loose answer."""


def samples(d: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Features, velocities and inverse Jacobians like those of a warped motion: about half of the constraints bind."""
    rng = np.random.default_rng(seed)
    s = np.linspace(1.0, 0.0, SAMPLES)[:, None]
    z = 0.2 * s * np.hstack([np.cos(3.0 * s), np.sin(4.0 * s), s][:d]) + 0.005 * rng.normal(size=(SAMPLES, d))
    centres = z[np.linspace(0, SAMPLES - 1, COMPONENTS).astype(int)]
    gamma = np.exp(-((z[:, None, :] - centres) ** 2).sum(axis=2) / (2.0 * 0.03**2))
    gamma /= gamma.sum(axis=1, keepdims=True)
    W = np.eye(d) + 0.2 * np.sin(5.0 * rng.normal(size=(SAMPLES, d, d)))
    features = (gamma[:, :, None] * z[:, None, :]).reshape(SAMPLES, COMPONENTS * d)
    return features, np.gradient(z, 0.01, axis=0) + 0.1 * rng.normal(size=(SAMPLES, d)), W


@pytest.mark.parametrize("d", [2, 3])
def test_the_samples_are_gathered_in_time(d: int) -> None:
    features, velocity, W = samples(d, 0)
    plain = best_of(lambda: gather(features, velocity))
    coupled = best_of(lambda: gather(features, velocity, inverse_jacobian=W))
    print(
        f"\ngathering {SAMPLES} samples, K = {COMPONENTS}, d = {d}: {1e3 * plain:.2f} ms, coupled {1e3 * coupled:.2f}"
    )
    assert coupled <= GATHER_LIMIT * (1 if d == 2 else 3)


@pytest.mark.parametrize("d", [2, 3])
def test_the_program_is_solved_in_time(d: int) -> None:
    P = np.diag(np.linspace(1.5, 0.5, d))

    def problem(seed: int, coupled: bool) -> LeastSquares:
        features, velocity, W = samples(d, seed)
        return with_ridge(gather(features, velocity, inverse_jacobian=W if coupled else None), 1e-3)

    for coupled in (False, True):
        problems = [problem(seed, coupled) for seed in range(10)]
        full = statistics.median(best_of(lambda p=p: solve(p, 0.03, P), 5) for p in problems)
        loose = statistics.median(best_of(lambda p=p: solve(p, 0.03, P, 1e-5, loose=True), 5) for p in problems)
        assert all(solve(p, 0.03, P).refinements > 0 for p in problems)
        norm = best_of(lambda p=problems[0]: solve_norm(p, 0.03, P), 1)
        print(
            f"\n{'coupled' if coupled else 'plain'} program, K = {COMPONENTS}, d = {d}: {1e3 * full:.2f} ms, "
            f"loose {1e3 * loose:.2f}, un-squared {1e3 * norm:.0f}"
        )
        assert loose < full <= loose + SHARPENING_LIMIT[d]
        assert full <= PROGRAM_LIMIT or d == 3
