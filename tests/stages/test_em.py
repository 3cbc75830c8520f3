"""The plain mixture: expectation maximisation on positions, and the number of components by BIC."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.errors import DataError, ParameterError
from stages.mixture.em import bic, fit_em
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import GaussianMixture
from stages.mixture.parameters import EmParameters

CENTRES = np.array([[0.0, 0.0], [1.0, 0.2], [0.3, 1.0]])


def blobs(d: int = 2) -> np.ndarray:
    rng = np.random.default_rng(5)
    centres = np.column_stack([CENTRES, np.zeros((3, d - 2))])
    return np.concatenate([centre + 0.05 * rng.normal(size=(60, d)) for centre in centres])


def fit(x: np.ndarray, seed: int = 0, **parameters: object) -> MixtureFit:
    generator = np.random.default_rng(seed)
    return fit_em(x, np.zeros_like(x), np.array([len(x)]), EmParameters(**parameters), generator)


@pytest.mark.parametrize("d", [2, 3])
def test_bic_finds_three_clusters_in_order(d: int) -> None:
    found = fit(blobs(d), max_components=6)
    assert found.mixture.components == 3
    assert set(found.criterion) == {1, 2, 3, 4, 5, 6}
    assert min(found.criterion, key=lambda K: found.criterion[K]) == 3
    np.testing.assert_allclose(found.mixture.means[:, :2], CENTRES, atol=0.03)
    np.testing.assert_array_equal(found.labels, np.repeat([0, 1, 2], 60))
    np.testing.assert_array_equal(found.sampled, np.arange(180))


def test_bic_by_hand() -> None:
    mixture = GaussianMixture(weights=[0.5, 0.5], means=np.zeros((2, 3)), covariances=np.stack([np.eye(3)] * 2))
    # 1 weight, 2 x 3 means, 2 x 6 covariances: 19 free parameters.
    assert bic(-10.0, mixture, 100) == pytest.approx(20.0 + 19 * math.log(100))


def test_a_given_number_of_components_is_kept() -> None:
    found = fit(blobs(), components=5)
    assert found.mixture.components == 5
    assert found.criterion == {}
    assert found.log_posterior.shape == found.components_by_sweep.shape
    assert len(found.log_posterior) == 1
    assert (np.diff(found.log_posterior[0]) >= -1e-9).all()
    assert (found.components_by_sweep == 5).all()


def test_same_seed_same_bytes_other_unit_same_clusters() -> None:
    x = blobs()
    one, two = fit(x), fit(x)
    assert one.mixture.means.tobytes() == two.mixture.means.tobytes()
    millimetres = fit(1000.0 * x)
    np.testing.assert_array_equal(millimetres.labels, one.labels)
    np.testing.assert_allclose(millimetres.mixture.means, 1000.0 * one.mixture.means, rtol=1e-9)
    np.testing.assert_allclose(millimetres.mixture.covariances, 1e6 * one.mixture.covariances, rtol=1e-7)


def test_thinning_takes_points_by_arc_length() -> None:
    assert 10 < len(fit(blobs(), points=30, components=2).sampled) <= 30


def test_collinear_points_are_held_up_by_the_floor() -> None:
    x = np.linspace([0.0, 0.0], [1.0, 2.0], 50)
    found = fit(x, components=2)
    radius = math.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert np.linalg.eigvalsh(found.mixture.covariances).min() == pytest.approx(1e-4 * radius**2, rel=1e-6)


def test_refusals() -> None:
    x = blobs()
    with pytest.raises(DataError, match="all points are the same"):
        fit(np.ones((20, 2)))
    with pytest.raises(DataError, match="at least 4 points"):
        fit(x[:3])
    with pytest.raises(DataError, match="not finite at sample 7"):
        fit(np.where(np.arange(180)[:, None] == 7, np.nan, x))
    with pytest.raises(DataError, match=r"fewer mixture\.components"):
        fit(np.repeat(x[:2], 10, axis=0), components=5)
    with pytest.raises(ParameterError, match=r"mixture\.restarts"):
        fit(x, restarts=0)
    with pytest.raises(ParameterError, match=r"mixture\.variance_floor: must be at least 1e-10"):
        fit(x, variance_floor=1e-12)
    assert len(fit(x, points=1, components=1).sampled) == 4  # the fewest that a covariance in the plane can be of
