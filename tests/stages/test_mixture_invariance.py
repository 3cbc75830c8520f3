"""What a mixture must not depend on: the unit, the orientation, the number of samples, the dimension."""

from __future__ import annotations

import numpy as np
import pytest

from stages.mixture.em import fit_em
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import responsibilities
from stages.mixture.parameters import EmParameters, PcGmmParameters
from stages.mixture.pcgmm import fit_pcgmm

Data = tuple[np.ndarray, np.ndarray, np.ndarray]

QUICK = PcGmmParameters(sweeps=15, points=150)
PLAIN = EmParameters(components=4, restarts=1)


def motion(d: int, seed: int, rest: int = 0) -> Data:
    """Three demonstrations of one random smooth motion to the origin, each with its own number of samples.

    `rest`: samples that each of them stands still before it starts and after it has arrived.
    """
    rng = np.random.default_rng([d, seed])
    amplitudes, phases = rng.normal(size=(4, d)), rng.uniform(0.0, 2.0 * np.pi, size=(4, d))
    demos = []
    for _ in range(3):
        n = int(rng.integers(60, 700))
        time = np.sort(np.concatenate(([0.0, 1.0], rng.uniform(size=n - 2))))
        s = 1.0 - (10.0 * time**3 - 15.0 * time**4 + 6.0 * time**5)  # minimum jerk, from 1 to 0
        own = amplitudes * (1.0 + 0.05 * rng.normal(size=(4, d)))
        angles = 1.7 * np.arange(1, 5)[:, None] * s[:, None, None] + phases
        path = 0.1 * (own * (np.sin(angles) - np.sin(phases))).sum(axis=1)
        demos.append(np.pad(path, ((rest, rest), (0, 0)), mode="edge"))
    velocity = [np.gradient(demo, 0.01, axis=0) for demo in demos]
    return np.concatenate(demos), np.concatenate(velocity), np.array([len(demo) for demo in demos])


def rotation(d: int, rng: np.random.Generator) -> np.ndarray:
    Q, R = np.linalg.qr(rng.normal(size=(d, d)))
    Q = Q * np.sign(np.diag(R))
    Q[:, 0] *= np.linalg.det(Q)
    return Q


def fit(data: Data, seed: int = 0) -> MixtureFit:
    return fit_pcgmm(*data, QUICK, np.random.default_rng(seed))


@pytest.mark.parametrize(("d", "seed"), [(d, seed) for d in (2, 3, 7) for seed in range(4)])
def test_scaling_and_rotation_change_neither_components_nor_labels(d: int, seed: int) -> None:
    position, velocity, lengths = motion(d, seed, rest=seed % 2 * 20)
    rng = np.random.default_rng(seed)
    scale, R = 10.0 ** rng.uniform(-3.0, 3.0), rotation(d, rng)
    turned = (scale * position @ R.T, scale * velocity @ R.T, lengths)
    for one, other in (
        (fit((position, velocity, lengths), seed), fit(turned, seed)),
        (
            fit_em(position, velocity, lengths, PLAIN, np.random.default_rng(seed)),
            fit_em(*turned, PLAIN, np.random.default_rng(seed)),
        ),
    ):
        np.testing.assert_array_equal(other.sampled, one.sampled)
        np.testing.assert_array_equal(other.labels, one.labels)
        np.testing.assert_array_equal(other.components_by_sweep, one.components_by_sweep)
        np.testing.assert_allclose(other.log_posterior, one.log_posterior, rtol=1e-8)
        np.testing.assert_allclose(other.mixture.weights, one.mixture.weights, rtol=1e-7)
        size = scale * np.abs(position).max()
        np.testing.assert_allclose(other.mixture.means, scale * one.mixture.means @ R.T, atol=1e-8 * size)
        expected = scale**2 * R @ one.mixture.covariances @ R.T
        np.testing.assert_allclose(other.mixture.covariances, expected, atol=1e-8 * size**2)


@pytest.mark.parametrize("d", [2, 3, 5, 7])
@pytest.mark.parametrize("seed", range(3))
def test_a_mixture_in_any_dimension_is_sound(d: int, seed: int) -> None:
    position, velocity, lengths = motion(d, seed, rest=30)
    found = fit((position, velocity, lengths), seed)
    mixture = found.mixture
    assert mixture.dimension == d
    counts = np.bincount(found.labels, minlength=mixture.components)
    assert len(counts) == mixture.components > 1
    assert counts.min() >= d + 2
    assert (np.diff(np.unique(found.labels, return_index=True)[1]) > 0).all()
    sampled = position[found.sampled]
    radius = np.sqrt(((sampled - sampled.mean(axis=0)) ** 2).sum(axis=1).mean())
    floor = QUICK.variance_floor * radius**2
    assert np.linalg.eigvalsh(mixture.covariances).min() >= (1.0 - 1e-9) * floor
    away = np.random.default_rng(seed).normal(size=(50, d))
    away *= 1e6 / np.linalg.norm(away, axis=1, keepdims=True)
    gamma = responsibilities(mixture, np.concatenate((position, away)))
    assert np.isfinite(gamma).all()
    np.testing.assert_allclose(gamma.sum(axis=1), 1.0, rtol=1e-12)


@pytest.mark.parametrize("d", [2, 3, 5, 7])
def test_as_few_points_as_are_accepted(d: int) -> None:
    position, velocity, _ = motion(d, 0)
    few = np.linspace(0, len(position) - 1, d + 2).astype(int)
    found = fit((position[few], velocity[few], np.array([d + 2])))
    assert found.mixture.components == 1
    assert (found.labels == 0).all()


@pytest.mark.parametrize("d", [2, 3])
def test_where_nothing_has_a_direction_position_alone_decides(d: int) -> None:
    position, velocity, lengths = motion(d, 1)
    found = fit((position, np.zeros_like(velocity), lengths))
    assert found.mixture.components > 1
    assert np.isfinite(found.log_posterior).all()
