"""Eqs. (7) and (8): the program on hand-computed answers, against its readable form, and when it fails."""

from __future__ import annotations

import math

import cvxpy as cp
import numpy as np
import pytest

from pipeline.errors import DataError, SolverError
from stages.dynamics import solve as module
from stages.dynamics.lpvds import arrays
from stages.dynamics.solve import LeastSquares, least_squares, solve
from stages.mixture.gaussian import GaussianMixture, responsibilities

MARGIN = 0.1


def single(d: int) -> GaussianMixture:
    return GaussianMixture(weights=[1.0], means=np.zeros((1, d)), covariances=np.eye(d)[None])


def problem(x: np.ndarray, velocity: np.ndarray, mixture: GaussianMixture, goal: np.ndarray) -> LeastSquares:
    model = arrays(mixture, np.zeros_like(mixture.covariances), goal, np.eye(len(goal)))
    return least_squares(x, velocity, model)


def example(K: int, d: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, GaussianMixture, np.ndarray]:
    """A noisy spiral to the goal, seen by overlapping components: some constraints bind, some do not."""
    rng = np.random.default_rng(seed)
    goal = rng.normal(size=d)
    x = goal + rng.normal(size=(300, d))
    skew = rng.normal(size=(d, d))
    field = skew - skew.T - np.diag(np.linspace(-1.0, 1.5, d))
    velocity = (x - goal) @ field.T + np.sin(3.0 * (x - goal)) + 0.1 * rng.normal(size=x.shape)
    mixture = GaussianMixture(
        weights=rng.dirichlet(5.0 * np.ones(K)),
        means=goal + 1.5 * rng.normal(size=(K, d)),
        covariances=np.stack([0.3 * np.eye(d)] * K),
    )
    return x, velocity, mixture, goal


def obvious(
    x: np.ndarray, velocity: np.ndarray, mixture: GaussianMixture, goal: np.ndarray, P: np.ndarray
) -> tuple[float, np.ndarray]:
    """Eqs. (7) and (8) as one would write them down."""
    K, d = mixture.components, mixture.dimension
    gamma = responsibilities(mixture, x)
    A = [cp.Variable((d, d)) for _ in range(K)]
    f = sum(cp.multiply(gamma[:, [k]] @ np.ones((1, d)), (x - goal) @ A[k].T) for k in range(K))
    constraints = [A[k].T @ P + P @ A[k] << -MARGIN * np.eye(d) for k in range(K)]
    program = cp.Problem(cp.Minimize(cp.sum_squares(f - velocity) / len(x)), constraints)
    program.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    return float(program.value), np.stack([a.value for a in A])


def test_gram_form_by_hand() -> None:
    # One sample: gamma = (1/4, 3/4) at x = (log(3)/2, 3) between unit Gaussians at -1 and 1; z = (log(3)/2, 1).
    mixture = GaussianMixture(
        weights=[0.5, 0.5], means=[[-1.0, 0.0], [1.0, 0.0]], covariances=np.stack([np.eye(2)] * 2)
    )
    a = 0.5 * math.log(3.0)
    found = problem(np.array([[a, 3.0]]), np.array([[2.0, -4.0]]), mixture, np.array([0.0, 2.0]))
    phi = np.array([a / 4, 1 / 4, 3 * a / 4, 3 / 4])
    np.testing.assert_allclose(found.gram, np.outer(phi, phi), rtol=1e-13)
    np.testing.assert_allclose(found.cross, np.outer([2.0, -4.0], phi), rtol=1e-13)
    assert found.mean_square_distance == pytest.approx(a * a + 1.0)
    assert found.mean_square_speed == pytest.approx(20.0)


def test_gram_form_is_the_mean_squared_error() -> None:
    x, velocity, mixture, goal = example(3, 2)
    found = problem(x, velocity, mixture, goal)
    gamma = responsibilities(mixture, x)
    A = np.random.default_rng(1).normal(size=(3, 2, 2))
    f = np.einsum("nk,kij,nj->ni", gamma, A, x - goal)
    wide = np.concatenate(A, axis=1)
    gram_form = np.trace(wide @ found.gram @ wide.T) - 2 * np.trace(wide @ found.cross.T) + found.mean_square_speed
    assert gram_form == pytest.approx(((f - velocity) ** 2).sum(axis=1).mean(), rel=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_a_stable_linear_motion_is_recovered(d: int) -> None:
    rng = np.random.default_rng(d)
    skew = rng.normal(size=(d, d))
    A = skew - skew.T - np.diag(1.0 + rng.random(d))
    goal = rng.normal(size=d)
    x = rng.normal(size=(100, d))
    found = solve(problem(x, (x - goal) @ A.T, single(d), goal), MARGIN)
    np.testing.assert_allclose(found.matrices[0], A, atol=1e-6)
    assert found.status == "Solved"
    assert found.objective == pytest.approx(0.0, abs=1e-7)


def test_a_motion_away_from_the_goal_is_projected_by_hand() -> None:
    # Samples on the axes make G a multiple of I, so A is the nearest matrix to [[1, -2], [2, -1]] whose symmetric part,
    # diag(1, -1), is at most -MARGIN/2: diag(-MARGIN/2, -1). The rotation stays.
    x = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    away = np.array([[1.0, -2.0], [2.0, -1.0]])
    found = solve(problem(x, x @ away.T, single(2), np.zeros(2)), MARGIN)
    np.testing.assert_allclose(found.matrices[0], [[-MARGIN / 2, -2.0], [2.0, -1.0]], atol=1e-6)
    assert found.objective == pytest.approx((1.0 + MARGIN / 2) ** 2 / 2, rel=1e-6)  # half the samples move along x


@pytest.mark.parametrize(("K", "d"), [(1, 2), (3, 2), (2, 3), (4, 3)])
def test_agrees_with_the_readable_program(K: int, d: int) -> None:
    data = example(K, d, seed=K + d)
    objective, matrices = obvious(*data, np.eye(d))
    found = solve(problem(*data), MARGIN)
    largest = [np.linalg.eigvalsh(A + A.T).max() for A in found.matrices]
    assert max(largest) == pytest.approx(-MARGIN, abs=1e-5)  # a constraint binds
    assert found.objective == pytest.approx(objective, rel=1e-5)
    np.testing.assert_allclose(found.matrices, matrices, atol=1e-5 * max(1.0, np.abs(matrices).max()))


def test_agrees_with_the_readable_program_under_a_general_lyapunov_matrix() -> None:
    data = example(3, 2, seed=9)
    P = np.array([[1.4, 0.5], [0.5, 0.6]])
    objective, matrices = obvious(*data, P)
    found = solve(problem(*data), MARGIN, P)
    assert found.objective == pytest.approx(objective, rel=1e-5)
    np.testing.assert_allclose(found.matrices, matrices, atol=1e-5 * max(1.0, np.abs(matrices).max()))
    for A in found.matrices:
        assert np.linalg.eigvalsh(A.T @ P + P @ A).max() <= -MARGIN + 1e-6


def test_residuals_prove_the_answer() -> None:
    found = solve(problem(*example(4, 2)), MARGIN)
    assert set(found.residuals) == {"feasibility", "stationarity", "dual", "gap"}
    assert all(0.0 <= value <= 1e-7 for value in found.residuals.values())
    assert found.iterations > 1


def test_millimetres_and_metres_give_the_same_matrices() -> None:
    x, velocity, mixture, goal = example(3, 2)
    millimetres = GaussianMixture(
        weights=mixture.weights, means=1e3 * mixture.means, covariances=1e6 * mixture.covariances
    )
    one = solve(problem(x, velocity, mixture, goal), MARGIN)
    other = solve(problem(1e3 * x, 1e3 * velocity, millimetres, 1e3 * goal), MARGIN)
    np.testing.assert_allclose(other.matrices, one.matrices, rtol=1e-6, atol=1e-8)
    assert other.objective == pytest.approx(1e6 * one.objective, rel=1e-8)


@pytest.mark.parametrize("d", [2, 3])
def test_a_rotation_turns_the_matrices(d: int) -> None:
    x, velocity, mixture, goal = example(4, d)
    R = np.linalg.qr(np.random.default_rng(1).normal(size=(d, d)))[0]
    turned = GaussianMixture(
        weights=mixture.weights, means=mixture.means @ R.T, covariances=R @ mixture.covariances @ R.T
    )
    one = solve(problem(x, velocity, mixture, goal), MARGIN)
    other = solve(problem(x @ R.T, velocity @ R.T, turned, R @ goal), MARGIN)
    np.testing.assert_allclose(other.matrices, R @ one.matrices @ R.T, atol=1e-6)


def test_components_that_overlap_fully_share_the_field() -> None:
    x, velocity, _, goal = example(1, 2)
    twins = GaussianMixture(weights=[0.5, 0.5], means=np.zeros((2, 2)), covariances=np.stack([np.eye(2)] * 2))
    one = solve(problem(x, velocity, single(2), goal), MARGIN)
    two = solve(problem(x, velocity, twins, goal), MARGIN)
    assert two.objective == pytest.approx(one.objective, rel=1e-6)
    np.testing.assert_allclose(two.matrices.mean(axis=0), one.matrices[0], atol=1e-5)
    assert np.abs(two.matrices).max() < 10.0 * np.abs(one.matrices).max()


def test_a_component_without_data_pulls_to_the_goal_and_disturbs_nothing() -> None:
    x, velocity, mixture, goal = example(2, 2)
    lonely = GaussianMixture(
        weights=np.append(0.9 * mixture.weights, 0.1),
        means=np.vstack([mixture.means, [1e4, 0.0]]),
        covariances=np.concatenate([mixture.covariances, np.eye(2)[None]]),
    )
    one = solve(problem(x, velocity, mixture, goal), MARGIN)
    other = solve(problem(x, velocity, lonely, goal), MARGIN)
    np.testing.assert_allclose(other.matrices[:2], one.matrices, atol=1e-5)
    rate = math.sqrt((velocity**2).sum() / ((x - goal) ** 2).sum())
    np.testing.assert_allclose(other.matrices[2], -rate * np.eye(2), atol=0.2 * rate)


def test_an_unfinished_program_is_an_error_with_status_and_residuals(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = module._settings.__wrapped__(1e-9)
    settings.max_iter = 2
    monkeypatch.setattr(module, "_settings", lambda _: settings)
    with pytest.raises(SolverError, match="MaxIterations") as caught:
        solve(problem(*example(4, 2)), MARGIN)
    assert caught.value.status == "MaxIterations"
    assert caught.value.residuals["gap"] > 1e-8


def test_an_inaccurate_answer_is_an_error() -> None:
    with pytest.raises(SolverError, match=r"dynamics\.tolerance = 1e-20") as caught:
        solve(problem(*example(4, 2)), MARGIN, tolerance=1e-20)
    assert caught.value.status == "Solved"


def test_refuses_data_that_do_not_move() -> None:
    x = np.random.default_rng(0).normal(size=(10, 2))
    with pytest.raises(DataError, match="every velocity is zero"):
        problem(x, np.zeros((10, 2)), single(2), np.zeros(2))
    with pytest.raises(DataError, match="every point is at the goal"):
        problem(np.zeros((10, 2)), x, single(2), np.zeros(2))
