"""Eq. (5), the responsibilities of eq. (6), and expectation maximisation from a given start."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from pipeline.errors import DataError
from stages.mixture.gaussian import (
    GaussianMixture,
    log_densities,
    responsibilities,
    responsibilities_at,
    whitening,
)
from stages.mixture.polish import maximise, polish


def random_mixture(rng: np.random.Generator, K: int, d: int) -> GaussianMixture:
    roots = rng.normal(size=(K, d, d))
    return GaussianMixture(
        weights=rng.dirichlet(np.ones(K)),
        means=rng.normal(size=(K, d)),
        covariances=0.1 * roots @ roots.transpose(0, 2, 1) + 0.01 * np.eye(d),
    )


def test_log_density_by_hand() -> None:
    # Sigma = [[2, 1], [1, 2]]: det 3, inverse [[2, -1], [-1, 2]]/3, so (1, -1) has the squared distance 2.
    mixture = GaussianMixture(
        weights=[0.25, 0.75], means=[[0.0, 0.0], [5.0, 5.0]], covariances=[[[2, 1], [1, 2]], np.eye(2)]
    )
    found = log_densities(mixture, np.array([[1.0, -1.0]]))
    assert found[0, 0] == pytest.approx(math.log(0.25) - math.log(2 * math.pi) - 0.5 * math.log(3.0) - 1.0, abs=1e-13)
    assert found[0, 1] == pytest.approx(math.log(0.75) - math.log(2 * math.pi) - 0.5 * (16 + 36), abs=1e-13)


def test_responsibilities_by_hand() -> None:
    # Unit covariances at -1 and +1, equal weights: the log ratio at (a, b) is 2 a.
    mixture = GaussianMixture(
        weights=[0.5, 0.5], means=[[-1.0, 0.0], [1.0, 0.0]], covariances=np.stack([np.eye(2)] * 2)
    )
    a = np.array([-3.0, 0.0, 0.1, 2.0])
    gamma = responsibilities(mixture, np.column_stack([a, [7.0, 0.0, -2.0, 1.0]]))
    np.testing.assert_allclose(gamma[:, 1], 1.0 / (1.0 + np.exp(-2.0 * a)), rtol=1e-13)


@pytest.mark.parametrize("d", [1, 2, 3, 5, 7])
def test_density_agrees_with_scipy(d: int) -> None:
    rng = np.random.default_rng(d)
    mixture = random_mixture(rng, 4, d)
    x = rng.normal(size=(20, d))
    for k in range(4):
        expected = np.log(mixture.weights[k]) + multivariate_normal(mixture.means[k], mixture.covariances[k]).logpdf(x)
        np.testing.assert_allclose(log_densities(mixture, x)[:, k], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("distance", [1e3, 1e6, 1e12])
def test_far_from_the_data_responsibilities_are_finite_and_sum_to_one(distance: float) -> None:
    rng = np.random.default_rng(3)
    for d in (2, 3):
        mixture = random_mixture(rng, 6, d)
        direction = rng.normal(size=(50, d))
        x = distance * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        assert (np.exp(log_densities(mixture, x)) == 0.0).all()  # every density underflows
        gamma = responsibilities(mixture, x)
        assert np.isfinite(gamma).all()
        assert (gamma >= 0.0).all()
        np.testing.assert_allclose(gamma.sum(axis=1), 1.0, rtol=1e-14)


@given(st.integers(0, 10_000), st.integers(1, 12), st.integers(1, 7), st.floats(-3.0, 6.0))
def test_both_paths_agree(seed: int, K: int, d: int, exponent: float) -> None:
    rng = np.random.default_rng(seed)
    mixture = random_mixture(rng, K, d)
    x = 10.0**exponent * rng.normal(size=(5, d))
    expected = responsibilities(mixture, x)
    log_total = np.logaddexp.reduce(log_densities(mixture, x), axis=1)
    out = np.empty(K)
    for state, gamma, total in zip(x, expected, log_total, strict=True):
        log_p = responsibilities_at(state, *whitening(mixture), out)
        np.testing.assert_allclose(out, gamma, rtol=0.0, atol=1e-14)
        assert log_p == pytest.approx(total, rel=1e-13)


def test_arrays_are_read_only_and_copies() -> None:
    means = np.zeros((1, 2))
    mixture = GaussianMixture(weights=[1.0], means=means, covariances=np.eye(2)[None])
    means[:] = 9.0
    assert (mixture.means == 0.0).all()
    with pytest.raises(ValueError, match="read-only"):
        mixture.means[0, 0] = 1.0
    assert (mixture.components, mixture.dimension) == (1, 2)


GOOD = {"weights": [0.5, 0.5], "means": np.zeros((2, 2)), "covariances": np.stack([np.eye(2)] * 2)}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": [1.0]}, "shapes"),
        ({"means": np.zeros(2)}, "shapes"),
        ({"weights": [0.5, 0.6]}, "sum to 1"),
        ({"weights": [0.0, 1.0]}, "positive"),
        ({"means": [[np.nan, 0.0], [0.0, 0.0]]}, "finite"),
        ({"covariances": np.stack([np.eye(2), [[1.0, 0.5], [0.0, 1.0]]])}, "component 1 is not symmetric"),
        ({"covariances": np.stack([np.eye(2), np.diag([1.0, -1.0])])}, "component 1 is not positive definite"),
    ],
)
def test_refuses_what_is_no_mixture(change: dict[str, object], message: str) -> None:
    with pytest.raises(DataError, match=message):
        GaussianMixture(**{**GOOD, **change})


def test_refuses_states_of_another_dimension() -> None:
    with pytest.raises(DataError, match=r"\(n, 2\)"):
        responsibilities(GaussianMixture(**GOOD), np.zeros((4, 3)))


def test_one_component_polishes_to_the_moments_of_the_data() -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=(200, 3)) @ rng.normal(size=(3, 3)) + 5.0
    start = GaussianMixture(weights=[1.0], means=np.zeros((1, 3)), covariances=np.eye(3)[None])
    found = polish(start, x, 1, 1e-9)
    np.testing.assert_allclose(found.means[0], x.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.covariances[0], np.cov(x.T, bias=True), rtol=1e-10)


def test_one_iteration_agrees_with_its_textbook_form() -> None:
    rng = np.random.default_rng(1)
    mixture = random_mixture(rng, 3, 2)
    x = rng.normal(size=(100, 2))
    gamma = responsibilities(mixture, x)
    found = polish(mixture, x, 1, 1e-12)
    for k in range(3):
        mean = gamma[:, k] @ x / gamma[:, k].sum()
        spread = x - mean
        covariance = (gamma[:, k, None] * spread).T @ spread / gamma[:, k].sum()
        assert found.weights[k] == pytest.approx(gamma[:, k].mean(), rel=1e-12)
        np.testing.assert_allclose(found.means[k], mean, rtol=1e-11)
        np.testing.assert_allclose(found.covariances[k], covariance, rtol=1e-9)


@given(st.integers(0, 1000), st.integers(2, 3), st.sampled_from([1e-6, 1e-2, 0.3]))
def test_polishing_never_loses_likelihood_and_keeps_the_floor(seed: int, d: int, floor: float) -> None:
    rng = np.random.default_rng(seed)
    x = np.concatenate([rng.normal(size=(40, d)) * rng.uniform(0.01, 1.0, d) + rng.normal(size=d) for _ in range(3)])
    found, history = maximise(random_mixture(rng, 5, d), x, 15, floor)
    assert (np.diff(history) >= -1e-9 * np.abs(history[1:])).all()
    assert np.linalg.eigvalsh(found.covariances).min() >= floor * (1.0 - 1e-9)
    assert history[-1] == pytest.approx(np.logaddexp.reduce(log_densities(found, x), axis=1).sum(), rel=1e-11)


def test_polishing_survives_a_component_without_data() -> None:
    x = np.random.default_rng(0).normal(size=(50, 2))
    mixture = GaussianMixture(weights=[0.5, 0.5], means=[[0.0, 0.0], [1e5, 0.0]], covariances=np.stack([np.eye(2)] * 2))
    found = polish(mixture, x, 10, 1e-6)
    assert found.weights[1] <= 1e-11
    np.testing.assert_allclose(found.means[1], [1e5, 0.0])
