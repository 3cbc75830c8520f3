"""Eqs. (7) and (8): the program on hand-computed answers, against its readable form, its forms, and when it fails."""

from __future__ import annotations

import math
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from pipeline.errors import SolverError
from stages.dynamics.lpvds import arrays
from stages.dynamics.program import conic
from stages.dynamics.program import solve as module
from stages.dynamics.program.regression import LeastSquares, gather, least_squares, with_ridge
from stages.dynamics.program.solve import Solution, solve, solve_norm
from stages.mixture.gaussian import GaussianMixture, responsibilities

MARGIN = 0.1
P_GENERAL = np.array([[1.4, 0.5], [0.5, 0.6]])


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


@pytest.mark.parametrize("d", [2, 3])
def test_a_stable_linear_motion_is_recovered(d: int) -> None:
    rng = np.random.default_rng(d)
    skew = rng.normal(size=(d, d))
    A = skew - skew.T - np.diag(1.0 + rng.random(d))
    goal = rng.normal(size=d)
    x = rng.normal(size=(100, d))
    found = solve(problem(x, (x - goal) @ A.T, single(d), goal), MARGIN)
    np.testing.assert_allclose(found.matrices[0], A, atol=1e-12)
    assert found.status == "Solved"
    assert found.objective == pytest.approx(0.0, abs=1e-13)


def test_a_motion_away_from_the_goal_is_projected_by_hand() -> None:
    # Samples on the axes make G a multiple of I, so A is the nearest matrix to [[1, -2], [2, -1]] whose symmetric part,
    # diag(1, -1), is at most -MARGIN/2: diag(-MARGIN/2, -1). The rotation stays.
    x = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    away = np.array([[1.0, -2.0], [2.0, -1.0]])
    found = solve(problem(x, x @ away.T, single(2), np.zeros(2)), MARGIN)
    np.testing.assert_allclose(found.matrices[0], [[-MARGIN / 2, -2.0], [2.0, -1.0]], atol=1e-13)
    assert found.objective == pytest.approx((1.0 + MARGIN / 2) ** 2 / 2, rel=1e-12)  # half the samples move along x


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
    P = P_GENERAL
    objective, matrices = obvious(*data, P)
    found = solve(problem(*data), MARGIN, P)
    assert found.objective == pytest.approx(objective, rel=1e-5)
    np.testing.assert_allclose(found.matrices, matrices, atol=1e-5 * max(1.0, np.abs(matrices).max()))
    for A in found.matrices:
        assert np.linalg.eigvalsh(A.T @ P + P @ A).max() <= -MARGIN + 1e-6


def test_residuals_prove_the_answer() -> None:
    found = solve(problem(*example(4, 2)), MARGIN)
    assert set(found.residuals) == {"feasibility", "stationarity", "dual", "gap"}
    assert all(0.0 <= value <= 1e-12 for value in found.residuals.values())
    assert found.iterations > 1
    assert found.refinements > 1


def test_millimetres_and_metres_give_the_same_matrices() -> None:
    x, velocity, mixture, goal = example(3, 2)
    millimetres = GaussianMixture(
        weights=mixture.weights, means=1e3 * mixture.means, covariances=1e6 * mixture.covariances
    )
    one = solve(problem(x, velocity, mixture, goal), MARGIN)
    other = solve(problem(1e3 * x, 1e3 * velocity, millimetres, 1e3 * goal), MARGIN)
    np.testing.assert_allclose(other.matrices, one.matrices, atol=1e-11)
    assert other.objective == pytest.approx(1e6 * one.objective, rel=1e-12)


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


def warped_example(K: int, d: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Features, velocities and inverse Jacobians that differ from sample to sample: constraints bind."""
    rng = np.random.default_rng(seed)
    x, velocity, mixture, goal = example(K, d, seed)
    features = (responsibilities(mixture, x)[:, :, None] * (x - goal)[:, None, :]).reshape(len(x), K * d)
    W = np.eye(d) + 0.3 * np.sin(rng.normal(size=(len(x), d, d)))
    return features, velocity, W


def obvious_warped(
    features: np.ndarray, velocity: np.ndarray, W: np.ndarray, P: np.ndarray, penalty: float, rate: float, norm: bool
) -> tuple[float, np.ndarray]:
    """min mean |W A Phi - xdot|^2, or un-squared, + penalty sum |A_k + rate I|^2, as one would write it down."""
    n, d = velocity.shape
    A = [cp.Variable((d, d)) for _ in range(features.shape[1] // d)]
    inner = features @ cp.hstack(A).T
    f = cp.vstack([cp.sum(cp.multiply(W[:, i, :], inner), axis=1) for i in range(d)]).T
    error = cp.sum(cp.norm(f - velocity, axis=1)) / n if norm else cp.sum_squares(f - velocity) / n
    ridge = penalty * sum(cp.sum_squares(a + rate * np.eye(d)) for a in A)
    constraints = [a.T @ P + P @ a << -MARGIN * np.eye(d) for a in A]
    program = cp.Problem(cp.Minimize(error + ridge), constraints)
    program.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    return float(program.value), np.stack([a.value for a in A])


@pytest.mark.parametrize(("K", "d"), [(3, 2), (2, 3)])
def test_the_coupled_program_agrees_with_the_readable_one(K: int, d: int) -> None:
    features, velocity, W = warped_example(K, d)
    root = np.random.default_rng(5).normal(size=(d, d))
    P = root @ root.T + np.eye(d)
    penalty, rate = 0.02, 0.7
    problem = gather(features, velocity, inverse_jacobian=W)
    ridged = with_ridge(problem, 1.0, np.broadcast_to(-rate * np.eye(d), (K, d, d)))
    assert ridged.ridge is not None
    ridged = replace(ridged, ridge=replace(ridged.ridge, weights=np.full(K, penalty)))
    objective, matrices = obvious_warped(features, velocity, W, P, penalty, rate, norm=False)
    found = solve(ridged, MARGIN, P)
    np.testing.assert_allclose(found.matrices, matrices, atol=1e-5 * np.abs(matrices).max())
    assert max(np.linalg.eigvalsh(A.T @ P + P @ A).max() for A in found.matrices) == pytest.approx(-MARGIN, abs=1e-5)
    # `value` is all that was minimised, `objective` the error alone.
    assert found.value * problem.mean_square_speed == pytest.approx(objective, rel=1e-6)
    assert found.objective == pytest.approx(problem.error(found.matrices), rel=1e-9)
    assert found.objective < objective - 1e-3


def test_without_a_warp_the_coupled_program_is_the_plain_one() -> None:
    features, velocity, _ = warped_example(4, 2)
    plain = solve(gather(features, velocity), MARGIN, P_GENERAL)
    coupled = solve(gather(features, velocity, inverse_jacobian=np.tile(np.eye(2), (300, 1, 1))), MARGIN, P_GENERAL)
    np.testing.assert_allclose(coupled.matrices, plain.matrices, atol=1e-11)
    assert coupled.value == pytest.approx(plain.value, rel=1e-12)


def test_a_stable_warped_motion_is_recovered() -> None:
    features, _, W = warped_example(3, 3)
    rng = np.random.default_rng(0)
    skew = rng.normal(size=(3, 3, 3))
    A = skew - skew.transpose(0, 2, 1) - np.eye(3)
    velocity = np.einsum("tij,tj->ti", W, features @ np.concatenate(list(A), axis=1).T)
    found = solve(gather(features, velocity, inverse_jacobian=W), MARGIN)
    np.testing.assert_allclose(found.matrices, A, atol=1e-10)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("ridge", [0.0, 1e-3])
def test_the_program_turns_with_the_data_and_knows_no_unit(d: int, coupled: bool, ridge: float) -> None:
    P = np.diag(np.linspace(0.5, 1.5, d))

    def solved(features: np.ndarray, velocity: np.ndarray, W: np.ndarray, P: np.ndarray) -> Solution:
        problem = gather(features, velocity, inverse_jacobian=W if coupled else None)
        return solve(with_ridge(problem, ridge) if ridge else problem, MARGIN, P)

    for seed in range(60):
        features, velocity, W = warped_example(4, d, seed)
        R = np.linalg.qr(np.random.default_rng(seed + 1).normal(size=(d, d)))[0]
        turned = (features.reshape(300, 4, d) @ R.T).reshape(300, 4 * d)
        one = solved(features, velocity, W, P)
        others = [
            (solved(turned, velocity @ R.T, R @ W @ R.T, R @ P @ R.T), R),
            (solved(1e3 * features, 1e3 * velocity, W, P), np.eye(d)),
        ]
        # Truly degenerate is only a program whose Gram matrix is singular but for rounding, beyond a condition of
        # 1e10: it is not sharpened. Here there is none, though some constraints are active with next to no multiplier.
        assert one.refinements > 0
        for other, turn in others:
            assert other.refinements > 0
            assert other.value == pytest.approx(one.value, rel=1e-12)
            error = np.abs(other.matrices - turn @ one.matrices @ turn.T).max() / np.abs(one.matrices).max()
            assert error < 1e-9, seed
            np.testing.assert_allclose(other.multipliers, turn @ one.multipliers @ turn.T, atol=1e-10)


def test_a_program_that_is_truly_degenerate_is_solved_but_not_sharpened() -> None:
    # Two components that are one: only the sum of their matrices is determined, and the Gram matrix is singular.
    features, velocity, _ = warped_example(1, 2)
    problem = gather(np.hstack([0.5 * features, 0.5 * features]), velocity)
    for degenerate in (problem, replace(problem, rows=None)):
        found = solve(degenerate, MARGIN)
        assert found.refinements == 0
        assert found.value == pytest.approx(solve(gather(features, velocity), MARGIN).value, rel=1e-6)
    # A ridge decides how they share it.
    assert solve(with_ridge(problem, 1e-3), MARGIN).refinements > 0


def test_the_unit_of_the_lyapunov_matrix_does_not_matter() -> None:
    features, velocity, W = warped_example(3, 2)
    problem = gather(features, velocity, inverse_jacobian=W)
    one, other = solve(problem, MARGIN, P_GENERAL), solve(problem, 1e4 * MARGIN, 1e4 * P_GENERAL)
    np.testing.assert_allclose(other.matrices, one.matrices, atol=1e-12)
    np.testing.assert_allclose(1e4 * other.multipliers, one.multipliers, atol=1e-12)


def test_a_ridge_by_hand() -> None:
    # Samples on the axes: G = I/2, H = G M'. So A = (M/2 + w C)/(1/2 + w), and both it and C are stable.
    x = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    motion = np.array([[-1.0, -2.0], [2.0, -3.0]])
    ridged = with_ridge(gather(x, x @ motion.T), 3.0)  # t = 1/2, so w = 3/2; the local rate is 2
    found = solve(ridged, MARGIN)
    expected = (0.5 * motion - 1.5 * 2.0 * np.eye(2)) / 2.0
    np.testing.assert_allclose(found.matrices[0], expected, atol=1e-12)
    assert found.objective == pytest.approx(0.5 * ((expected - motion) ** 2).sum(), rel=1e-12)
    speed = 0.5 * (motion**2).sum()
    assert found.value * speed == pytest.approx(found.objective + 1.5 * ((expected + 2 * np.eye(2)) ** 2).sum())


@pytest.mark.parametrize("coupled", [False, True])
def test_multipliers_tell_how_the_value_changes_with_the_lyapunov_matrix(coupled: bool) -> None:
    features, velocity, W = warped_example(3, 2)
    problem = with_ridge(gather(features, velocity, inverse_jacobian=W if coupled else None), 1e-3)
    found = solve(problem, MARGIN, P_GENERAL)
    slope = sum(A @ Z + Z @ A.T for A, Z in zip(found.matrices, found.multipliers, strict=True))
    assert np.linalg.eigvalsh(found.multipliers).min() >= -1e-14
    for change in (np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])):
        up, down = (solve(problem, MARGIN, P_GENERAL + sign * 1e-4 * change).value for sign in (1.0, -1.0))
        assert (slope * change).sum() == pytest.approx((up - down) / 2e-4, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_a_loose_answer_is_near_and_one_that_is_not_near_enough_is_solved_to_the_end(d: int) -> None:
    features, velocity, W = warped_example(4, d)
    P = np.diag(np.linspace(0.5, 1.5, d))
    for problem in (gather(features, velocity), gather(features, velocity, inverse_jacobian=W)):
        exact = solve(problem, MARGIN, P)
        near = solve(problem, MARGIN, P, tolerance=1e-5, loose=True)
        assert (near.refinements, exact.refinements > 0) == (0, True)
        assert max(near.residuals.values()) > 1e-8 > 1e-12 > max(exact.residuals.values())
        assert near.value == pytest.approx(exact.value, rel=1e-4)
        np.testing.assert_allclose(near.multipliers, exact.multipliers, atol=1e-3 * np.abs(exact.multipliers).max())
        again = solve(problem, MARGIN, P, tolerance=1e-8, loose=True)
        assert again.matrices.tobytes() == exact.matrices.tobytes()


def overlapping(difference: float) -> tuple[np.ndarray, np.ndarray]:
    """Features of two components whose responsibilities differ by 2 `difference`, and a motion that needs them both.

    gamma_1,2 = 1/2 +- difference u(z). With A_1,2 = S +- J/(2 difference), J skew, f = S z + u(z) J z: a stable system
    of the two, however little they differ.
    """
    z = np.random.default_rng(0).normal(size=(400, 2))
    u = np.tanh(z[:, :1])
    S, J = np.array([[-1.0, -0.3], [-0.3, -1.5]]), np.array([[0.0, -1.0], [1.0, 0.0]])
    return np.hstack([(0.5 + difference * u) * z, (0.5 - difference * u) * z]), z @ S.T + u * (z @ J.T)


def relative_error(features: np.ndarray, velocity: np.ndarray, matrices: np.ndarray) -> float:
    f = features @ np.concatenate(list(matrices), axis=1).T
    return math.sqrt(((f - velocity) ** 2).sum() / (velocity**2).sum())


@pytest.mark.parametrize("coupled", [False, True])
def test_where_components_overlap_too_much_for_the_gram_form_the_unsquared_one_is_exact(coupled: bool) -> None:
    features, velocity = overlapping(1e-9)
    assert 1e8 < np.linalg.cond(features) < 1e10
    W = np.tile(np.eye(2), (400, 1, 1)) if coupled else None
    problem = gather(features, velocity, inverse_jacobian=W)
    found = solve(problem, MARGIN)
    assert found.form == "qr"
    assert relative_error(features, velocity, found.matrices) < 1e-6
    assert math.sqrt(found.objective / problem.mean_square_speed) < 1e-6
    assert max(np.linalg.eigvalsh(A + A.T).max() for A in found.matrices) < -MARGIN
    # What it saves us from: without the samples only the Gram form is left, which has lost the difference.
    squared = solve(replace(problem, rows=None), MARGIN)
    assert squared.form == "gram"
    assert relative_error(features, velocity, squared.matrices) > 0.1


def test_where_the_gram_form_fails_the_unsquared_one_takes_over(monkeypatch: pytest.MonkeyPatch) -> None:
    features, velocity = overlapping(1e-8)
    problem = gather(features, velocity)
    with pytest.raises(SolverError, match="was not solved"):
        solve(replace(problem, rows=None), MARGIN)
    monkeypatch.setattr(module, "_SMALLEST_CONDITION", 0.0)  # so that the Gram form is tried first
    found = solve(problem, MARGIN)
    assert found.form == "qr"
    assert relative_error(features, velocity, found.matrices) < 1e-6


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("weight", [0.0, 1e-2])
def test_both_forms_agree_where_constraints_bind(coupled: bool, weight: float, monkeypatch: pytest.MonkeyPatch) -> None:
    features, velocity, W = warped_example(3, 2)
    features = np.hstack([features, 1e-7 * features[:, :2]])  # a component without data to speak of
    problem = with_ridge(gather(features, velocity, inverse_jacobian=W if coupled else None), weight)
    squared = solve(problem, MARGIN, P_GENERAL)
    monkeypatch.setattr(module, "_SMALLEST_CONDITION", 1.0)
    unsquared = solve(problem, MARGIN, P_GENERAL)
    assert (squared.form, unsquared.form) == ("gram", "qr")
    assert min(squared.refinements, unsquared.refinements) > 0
    np.testing.assert_allclose(unsquared.matrices, squared.matrices, atol=1e-6)
    np.testing.assert_allclose(unsquared.multipliers, squared.multipliers, atol=1e-10)
    assert unsquared.value == pytest.approx(squared.value, rel=1e-12)
    assert unsquared.objective == pytest.approx(squared.objective, rel=1e-10)
    # And before its last digits: a solver that is content with a value to 1e-9 knows the matrices to the root of that,
    # but the last one, of 1e-4 of the size of the others, to 1e4 times that.
    monkeypatch.setattr(module, "sharpen", lambda gram, cross, limits, answer: answer)
    rough = solve(problem, MARGIN, P_GENERAL)
    assert (rough.form, rough.refinements) == ("qr", 0)
    np.testing.assert_allclose(rough.matrices[:3], squared.matrices[:3], atol=1e-6)
    np.testing.assert_allclose(rough.multipliers, squared.multipliers, atol=1e-6)
    assert rough.value == pytest.approx(squared.value, rel=1e-8)


def test_an_unsquared_loss_by_hand() -> None:
    # On a line, x' = a x through three samples at x = 1: squares give the mean of -1, -1 and -10, norms the median.
    problem = gather(np.ones((3, 1)), np.array([[-1.0], [-1.0], [-10.0]]))
    assert solve(problem, MARGIN).matrices[0, 0, 0] == pytest.approx(-4.0)
    found = solve_norm(problem, MARGIN)
    # Below 1 % of the rms speed the loss is quadratic: there -1 - a/floor + 2 (a + 1)/floor = 0 for a = -1 - floor/2.
    rms = math.sqrt(102.0 / 3.0)
    assert found.matrices[0, 0, 0] == pytest.approx(-1.0 - 0.01 * rms / 2.0, abs=1e-3)
    assert found.objective == pytest.approx((2.0 * 0.005 * rms + 9.0 - 0.005 * rms) / 3.0, rel=1e-3)


@pytest.mark.parametrize("coupled", [False, True])
def test_the_unsquared_loss_agrees_with_the_readable_program_and_never_rises(coupled: bool) -> None:
    features, velocity, W = warped_example(3, 2)
    velocity = velocity.copy()
    velocity[::10] *= -3.0  # outliers, which squares would follow
    used = W if coupled else np.tile(np.eye(2), (300, 1, 1))
    problem = with_ridge(gather(features, velocity, inverse_jacobian=W if coupled else None), 1e-3)
    assert problem.ridge is not None
    rms = math.sqrt(problem.mean_square_speed)
    penalty, centres = 0.01, np.broadcast_to(-0.5 * np.eye(2), (3, 2, 2))
    ridge = replace(problem.ridge, weights=np.full(3, 2.0 * rms * penalty), centres=centres)
    problem = replace(problem, ridge=ridge)
    found = solve_norm(problem, MARGIN, P_GENERAL)
    objective, matrices = obvious_warped(features, velocity, used, P_GENERAL, penalty, 0.5, norm=True)
    np.testing.assert_allclose(found.matrices, matrices, atol=0.02 * np.abs(matrices).max())
    left = found.objective + penalty * ((found.matrices - centres) ** 2).sum()
    assert objective * (1.0 - 1e-6) <= left <= objective * (1.0 + 1e-3)
    assert found.value * rms == pytest.approx(left, rel=1e-2)
    assert 4 < len(found.descent) < 60
    assert found.refinements > len(found.descent)
    assert (np.diff(found.descent) <= 1e-8).all()
    squared = solve(problem, MARGIN, P_GENERAL)
    residual = np.einsum("tij,tj->ti", used, features @ np.concatenate(list(squared.matrices), axis=1).T) - velocity
    assert np.linalg.norm(residual, axis=1).mean() > 1.02 * found.objective


def test_the_unsquared_loss_knows_no_unit_and_its_multipliers_are_its_slope() -> None:
    features, velocity, W = warped_example(3, 2)
    problem = with_ridge(gather(features, velocity, inverse_jacobian=W), 1e-3)
    found = solve_norm(problem, MARGIN, P_GENERAL)
    millimetres = with_ridge(gather(1e3 * features, 1e3 * velocity, inverse_jacobian=W), 1e-3)
    other = solve_norm(millimetres, MARGIN, P_GENERAL)
    np.testing.assert_allclose(other.matrices, found.matrices, atol=1e-5)
    assert other.objective == pytest.approx(1e3 * found.objective, rel=1e-6)
    slope = sum(A @ Z + Z @ A.T for A, Z in zip(found.matrices, found.multipliers, strict=True))
    change = np.diag([1.0, -1.0])
    up, down = (solve_norm(problem, MARGIN, P_GENERAL + sign * 0.05 * change).value for sign in (1.0, -1.0))
    assert (slope * change).sum() == pytest.approx((up - down) / 0.1, rel=0.1)


def unfinished(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two iterations only."""
    usual = conic._new_settings

    def settings(tolerance: float) -> object:
        result = usual(tolerance)
        result.max_iter = 2
        return result

    monkeypatch.setattr(conic, "_new_settings", settings)
    monkeypatch.setattr(conic, "_settings", settings)
    monkeypatch.setattr(conic, "_loose_settings", lambda: settings(1e-6))


def test_an_unfinished_program_is_an_error_with_status_residuals_and_program(monkeypatch: pytest.MonkeyPatch) -> None:
    unfinished(monkeypatch)
    with pytest.raises(SolverError, match="MaxIterations") as caught:
        solve(problem(*example(4, 2)), MARGIN)
    assert caught.value.status == "MaxIterations"
    assert caught.value.residuals["gap"] > 1e-8
    assert caught.value.program is not None
    assert caught.value.program["margin"] == MARGIN
    np.testing.assert_array_equal(caught.value.program["gram"], problem(*example(4, 2)).gram)


def test_an_inaccurate_answer_is_an_error() -> None:
    with pytest.raises(SolverError, match=r"dynamics\.tolerance = 1e-20") as caught:
        solve(problem(*example(4, 2)), MARGIN, tolerance=1e-20)
    assert caught.value.status == "Solved"
