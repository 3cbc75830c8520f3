"""Eq. (7) as sums over samples: by hand, against the samples themselves, and unsquared."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import DataError
from stages.dynamics.lpvds import arrays
from stages.dynamics.program import regression
from stages.dynamics.program.regression import (
    LeastSquares,
    combined,
    gather,
    least_squares,
    local_rates,
    mean_diagonals,
    reweighted,
    with_ridge,
)
from stages.mixture.gaussian import GaussianMixture, responsibilities


def mixture_of(K: int, d: int) -> GaussianMixture:
    rng = np.random.default_rng(K + d)
    return GaussianMixture(
        weights=rng.dirichlet(5.0 * np.ones(K)), means=rng.normal(size=(K, d)), covariances=np.stack([np.eye(d)] * K)
    )


def plain(x: np.ndarray, velocity: np.ndarray, mixture: GaussianMixture, goal: np.ndarray) -> LeastSquares:
    model = arrays(mixture, np.zeros_like(mixture.covariances), goal, np.eye(len(goal)))
    return least_squares(x, velocity, model)


def samples(n: int, K: int, d: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Features of responsibilities that sum to one, velocities, inverse Jacobians and weights."""
    rng = np.random.default_rng(n + K + d)
    gamma, z = rng.dirichlet(0.3 * np.ones(K), n), rng.normal(size=(n, d))
    features = (gamma[:, :, None] * z[:, None, :]).reshape(n, K * d)
    return features, rng.normal(size=(n, d)), rng.normal(size=(n, d, d)), rng.random(n)


def residuals(features: np.ndarray, velocity: np.ndarray, W: np.ndarray | None, A: np.ndarray) -> np.ndarray:
    f = features @ np.concatenate(list(A), axis=1).T
    return (f if W is None else np.einsum("tij,tj->ti", W, f)) - velocity


def test_gram_form_by_hand() -> None:
    # One sample: gamma = (1/4, 3/4) at x = (log(3)/2, 3) between unit Gaussians at -1 and 1; z = (log(3)/2, 1).
    mixture = GaussianMixture(
        weights=[0.5, 0.5], means=[[-1.0, 0.0], [1.0, 0.0]], covariances=np.stack([np.eye(2)] * 2)
    )
    a = 0.5 * math.log(3.0)
    found = plain(np.array([[a, 3.0]]), np.array([[2.0, -4.0]]), mixture, np.array([0.0, 2.0]))
    phi = np.array([a / 4, 1 / 4, 3 * a / 4, 3 / 4])
    np.testing.assert_allclose(found.gram, np.outer(phi, phi), rtol=1e-13)
    np.testing.assert_allclose(found.cross, np.outer([2.0, -4.0], phi), rtol=1e-13)
    assert found.mean_square_distance == pytest.approx(a * a + 1.0)
    assert found.mean_square_speed == pytest.approx(20.0)


def test_coupled_gram_form_by_hand() -> None:
    # One sample, one component: z = (1, 2), W = [[1, 1], [0, 2]], W'W = [[1, 1], [1, 5]], W'(3, 4) = (3, 11).
    found = gather(
        np.array([[1.0, 2.0]]), np.array([[3.0, 4.0]]), inverse_jacobian=np.array([[[1.0, 1.0], [0.0, 2.0]]])
    )
    outer = np.array([[1.0, 2.0], [2.0, 4.0]])
    np.testing.assert_array_equal(found.gram, np.block([[outer, outer], [outer, 5.0 * outer]]))
    np.testing.assert_array_equal(found.cross, [[3.0, 6.0], [11.0, 22.0]])
    assert (found.mean_square_distance, found.mean_square_speed) == (5.0, 25.0)
    assert found.coupled
    assert (found.dimension, found.components) == (2, 1)


@pytest.mark.parametrize("d", [1, 2, 3, 5])
@pytest.mark.parametrize("n", [1, 7, 8, 203])
def test_every_shape_is_the_mean_squared_error(n: int, d: int) -> None:
    features, velocity, W, weights = samples(n, 3, d)
    A = np.random.default_rng(1).normal(size=(3, d, d))
    for used in (None, W):
        for w in (None, weights):
            found = gather(features, velocity, inverse_jacobian=used, weights=w)
            squares = (residuals(features, velocity, used, A) ** 2).sum(axis=1)
            assert found.error(A) == pytest.approx((squares if w is None else w * squares).mean(), rel=1e-11)
            np.testing.assert_array_equal(found.gram, found.gram.T)
            assert found.mean_square_distance == pytest.approx(
                ((1.0 if w is None else w) * (features.reshape(n, 3, d).sum(axis=1) ** 2).sum(axis=1)).mean()
            )


def test_features_and_mixture_give_the_same_sums() -> None:
    rng = np.random.default_rng(0)
    mixture, goal = mixture_of(3, 2), np.array([0.3, -0.2])
    x, velocity = rng.normal(size=(200, 2)), rng.normal(size=(200, 2))
    features = (responsibilities(mixture, x)[:, :, None] * (x - goal)[:, None, :]).reshape(200, 6)
    one, other = plain(x, velocity, mixture, goal), gather(features, velocity)
    np.testing.assert_allclose(other.gram, one.gram, rtol=1e-12)
    np.testing.assert_allclose(other.cross, one.cross, rtol=1e-11)
    assert other.mean_square_distance == pytest.approx(one.mean_square_distance, rel=1e-12)
    assert other.mean_square_speed == pytest.approx(one.mean_square_speed, rel=1e-12)
    A = rng.normal(size=(3, 2, 2))
    for problem in (one, other):
        triangle = problem.triangle
        assert triangle is not None
        left = triangle.factor @ np.concatenate(list(A), axis=1).T - triangle.target
        assert (left**2).sum() + triangle.rest == pytest.approx(one.error(A), rel=1e-12)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("n", [3, 203])
def test_the_triangle_is_the_regression_in_however_many_blocks(
    coupled: bool, n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(regression, "_BLOCK", 16)
    features, velocity, W, weights = samples(n, 3, 2)
    problem = gather(features, velocity, inverse_jacobian=W if coupled else None, weights=weights)
    triangle = problem.triangle
    assert triangle is not None
    A = np.random.default_rng(1).normal(size=(3, 2, 2))
    wide = np.concatenate(list(A), axis=1)
    left = triangle.factor @ (wide.reshape(-1, 1) if coupled else wide.T) - triangle.target
    assert (left**2).sum() + triangle.rest == pytest.approx(problem.error(A), rel=1e-11)
    np.testing.assert_allclose(triangle.factor.T @ triangle.factor, problem.gram, atol=1e-12)


def test_a_turn_of_the_samples_turns_the_sums() -> None:
    features, velocity, W, _ = samples(100, 3, 2)
    R = np.linalg.qr(np.random.default_rng(0).normal(size=(2, 2)))[0]
    A = np.random.default_rng(1).normal(size=(3, 2, 2))
    turned = (features.reshape(100, 3, 2) @ R.T).reshape(100, 6)
    one = gather(features, velocity, inverse_jacobian=W)
    other = gather(turned, velocity @ R.T, inverse_jacobian=R @ W @ R.T)
    assert other.error(R @ A @ R.T) == pytest.approx(one.error(A), rel=1e-12)
    np.testing.assert_allclose(local_rates(other), local_rates(one), rtol=1e-10)
    np.testing.assert_allclose(mean_diagonals(other), mean_diagonals(one), rtol=1e-12)


def test_local_rates_by_hand() -> None:
    # Component 0: z = (1, 0) moves by (-2, 5) and z = (0, 1) by (0, -4): of -c z the nearest has c = 3. Component 1
    # moves away, component 2 has no data.
    features = np.zeros((3, 6))
    features[0, :2], features[1, :2], features[2, 2:4] = [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]
    velocity = np.array([[-2.0, 5.0], [0.0, -4.0], [3.0, 3.0]])
    problem = gather(features, velocity)
    np.testing.assert_allclose(local_rates(problem), [3.0, 0.0, 0.0])
    np.testing.assert_allclose(mean_diagonals(problem), [1.0 / 3.0, 1.0 / 3.0, 0.0])
    ridge = with_ridge(problem, 0.3).ridge
    assert ridge is not None
    np.testing.assert_allclose(ridge.weights, [0.1, 0.1, 0.0])
    np.testing.assert_allclose(ridge.centres, [-3.0 * np.eye(2), np.zeros((2, 2)), np.zeros((2, 2))])


@pytest.mark.parametrize("coupled", [False, True])
def test_a_local_rate_is_the_best_of_its_component_alone(coupled: bool) -> None:
    features, velocity, W, _ = samples(50, 3, 3)
    velocity = velocity - features.reshape(50, 3, 3).sum(axis=1)
    used = W if coupled else None
    rates = local_rates(gather(features, velocity, inverse_jacobian=used))
    assert (rates > 0.0).any()
    for k, rate in enumerate(rates):
        alone = gather(features[:, 3 * k : 3 * k + 3], velocity, inverse_jacobian=used)
        errors = [alone.error(-c * np.eye(3)[None]) for c in (rate, rate + 0.01, max(0.0, rate - 0.01))]
        assert errors[0] <= min(errors[1:])


def test_regressions_add_up() -> None:
    (f, v, W, _), (g, u, U, _) = samples(60, 3, 2), samples(41, 3, 2)
    A = np.random.default_rng(1).normal(size=(3, 2, 2))
    one, other = gather(f, v, inverse_jacobian=W), gather(g, u, inverse_jacobian=U)
    both = combined([(1.0, one), (0.2, other)])
    assert both.error(A) == pytest.approx(one.error(A) + 0.2 * other.error(A), rel=1e-12)
    triangle = both.triangle
    assert triangle is not None
    np.testing.assert_allclose(triangle.factor.T @ triangle.factor, both.gram, atol=1e-12)
    assert combined([(1.0, one), (1.0, replace(other, rows=None))]).rows is None


@pytest.mark.parametrize("coupled", [False, True])
def test_weighting_anew(coupled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regression, "_BLOCK", 16)
    features, velocity, W, weights = samples(50, 3, 2)
    used = W if coupled else None
    problem = gather(features, velocity, inverse_jacobian=used, weights=weights)
    A, B = np.random.default_rng(1).normal(size=(2, 3, 2, 2))
    floor = 0.8
    again, mean, bound = reweighted(problem, A, floor)
    size = np.linalg.norm(residuals(features, velocity, used, A), axis=1)
    assert 5 < (size < floor).sum() < 45
    assert mean == pytest.approx((weights * size).mean())
    assert bound == pytest.approx((weights * np.where(size < floor, size**2 / floor / 2 + floor / 2, size)).mean())
    anew = weights * math.sqrt(problem.mean_square_speed) / np.maximum(size, floor)
    squares = (residuals(features, velocity, used, B) ** 2).sum(axis=1)
    assert again.error(B) == pytest.approx((anew * squares).mean(), rel=1e-11)
    with pytest.raises(ValueError, match="without its rows"):
        reweighted(replace(problem, rows=None), A, floor)


def test_refuses_data_that_do_not_move() -> None:
    x = np.random.default_rng(0).normal(size=(10, 2))
    mixture = mixture_of(1, 2)
    for refused in (
        lambda velocity, position: plain(position, velocity, mixture, np.zeros(2)),
        lambda velocity, position: gather(position, velocity),
    ):
        with pytest.raises(DataError, match="every velocity is zero"):
            refused(np.zeros((10, 2)), x)
        with pytest.raises(DataError, match="every point is at the goal"):
            refused(x, np.zeros((10, 2)))


def test_refuses_shapes_that_do_not_fit_and_numbers_that_are_none() -> None:
    features, velocity, W, weights = samples(20, 3, 2)
    for bad in (features[:, :5], features[:19], features[0]):
        with pytest.raises(DataError, match="do not go with"):
            gather(bad, velocity)
    with pytest.raises(DataError, match="do not go with"):
        gather(features, velocity, weights=weights[1:])
    with pytest.raises(DataError, match="inverse Jacobians must have shape"):
        gather(features, velocity, inverse_jacobian=W[:, :1])
    for value in (math.nan, math.inf):
        spoilt = features.copy()
        spoilt[3, 1] = value
        with pytest.raises(DataError, match="must be finite"):
            gather(spoilt, velocity, inverse_jacobian=W)
    with pytest.raises(DataError, match="not negative"):
        gather(features, velocity, weights=weights - 0.5)
