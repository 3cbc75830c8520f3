"""The search for P: its gradient against differences, what it keeps to, and that no axis is preferred."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import rotation

from pipeline.errors import SolverError
from stages.dynamics import search as module
from stages.dynamics.program.regression import LeastSquares, gather
from stages.dynamics.program.solve import Solution, solve
from stages.dynamics.search import DESCENT, ELONGATION, search, starts

MARGIN = 0.05
CASES = [(2, False), (3, False), (2, True), (3, True)]
Samples = tuple[np.ndarray, np.ndarray, np.ndarray | None]


def samples(d: int, *, coupled: bool, K: int = 3, n: int = 90) -> Samples:
    """Features, velocities and inverse Jacobians of a motion that no circle approaches: the constraints bind."""
    rng = np.random.default_rng([d, coupled])
    gamma, z = rng.dirichlet(0.3 * np.ones(K), n), rng.normal(size=(n, d))
    bent = -np.eye(d) + 2.5 * np.triu(np.ones((d, d)), 1)
    velocity = z @ bent.T + 0.3 * rng.normal(size=(n, d))
    features = (gamma[:, :, None] * z[:, None, :]).reshape(n, K * d)
    return features, velocity, np.eye(d) + 0.2 * rng.normal(size=(n, d, d)) if coupled else None


def problem(d: int, *, coupled: bool) -> LeastSquares:
    features, velocity, inverse = samples(d, coupled=coupled)
    return gather(features, velocity, inverse_jacobian=inverse)


def turned(d: int, R: np.ndarray, *, coupled: bool) -> LeastSquares:
    features, velocity, inverse = samples(d, coupled=coupled)
    n = len(velocity)
    rotated = None if inverse is None else R @ inverse @ R.T
    return gather((features.reshape(n, -1, d) @ R.T).reshape(n, -1), velocity @ R.T, inverse_jacobian=rotated)


def random_P(d: int, seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(d, d))
    P = root @ root.T + 0.5 * np.eye(d)
    return 0.5 * (P + P.T) * d / np.trace(P)


@pytest.mark.parametrize(("d", "coupled"), CASES)
def test_the_gradient_by_the_multipliers_agrees_with_differences(d: int, coupled: bool) -> None:
    given, P, h = problem(d, coupled=coupled), random_P(d, 1), 1e-4
    solution = solve(given, MARGIN, P)
    assert np.linalg.eigvalsh(solution.multipliers).max() > 1e-3  # some constraint binds
    pull = np.einsum("kij,kjl->il", solution.matrices, solution.multipliers)
    slope = pull + pull.T
    for i, j in zip(*np.triu_indices(d), strict=True):
        step = np.zeros((d, d))
        step[i, j] = step[j, i] = h
        difference = (solve(given, MARGIN, P + step).value - solve(given, MARGIN, P - step).value) / (2.0 * h)
        assert (slope * step).sum() / h == pytest.approx(difference, rel=1e-3, abs=1e-4 * np.abs(slope).max())


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("condition", [1e6, 4.0])
def test_the_gradient_by_the_logarithm_agrees_with_differences(d: int, condition: float) -> None:
    # Of any function of P = exp(S)/tr, here a linear one; also where the bound on the condition takes effect.
    rng = np.random.default_rng(d)
    S, slope = rng.normal(size=(2, d, d))
    S, slope, h = S + S.T, slope + slope.T, 1e-6
    P, pull = module._positive(S, condition)
    assert np.trace(P) == pytest.approx(d, rel=1e-14)
    assert np.linalg.cond(P) <= condition * (1.0 + 1e-12)
    point = module._vector(S)
    np.testing.assert_allclose(module._matrix(point, d), S, atol=1e-15)
    assert point @ point == pytest.approx((S**2).sum(), rel=1e-14)
    gradient = module._vector(pull(slope))
    for axis, expected in zip(np.eye(len(point)), gradient, strict=True):
        above, below = (module._positive(module._matrix(point + side * h * axis, d), condition)[0] for side in (1, -1))
        difference = (slope * (above - below)).sum() / (2.0 * h)
        assert difference == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_the_logarithm_of_a_multiple_of_the_unit_matrix() -> None:
    # Equal eigenvalues: the divided differences are derivatives there.
    slope = np.array([[1.0, 0.5], [0.5, 3.0]])
    P, pull = module._positive(2.0 * np.eye(2), 50.0)
    np.testing.assert_allclose(P, np.eye(2), rtol=1e-15)
    np.testing.assert_allclose(pull(slope), [[-1.0, 0.5], [0.5, 1.0]], rtol=1e-14)


def test_the_starts_by_hand() -> None:
    found = starts(np.eye(2), 3.0)
    np.testing.assert_array_equal(found[0], np.eye(2))
    np.testing.assert_allclose(found[1], np.diag([1.5, 0.5]))
    np.testing.assert_allclose(found[2], np.diag([0.5, 1.5]))
    np.testing.assert_allclose(found[3], [[1.0, 0.5], [0.5, 1.0]])
    np.testing.assert_allclose(found[4], [[1.0, -0.5], [-0.5, 1.0]])
    assert len(starts(rotation(3), ELONGATION)) == 1 + 3 + 6
    for P in starts(rotation(3), ELONGATION):
        assert np.trace(P) == pytest.approx(3.0)
        values = np.linalg.eigvalsh(P)
        assert values[-1] / values[0] == pytest.approx(ELONGATION) or np.ptp(values) == 0.0
    assert len(starts(np.eye(3), 1.0)) == 1


@pytest.mark.parametrize(("d", "coupled"), CASES)
def test_what_is_found_is_no_worse_than_any_start(d: int, coupled: bool) -> None:
    given, axes = problem(d, coupled=coupled), rotation(d)
    found = search(given, MARGIN, axes, 50.0)
    tried = [solve(given, MARGIN, P).value for P in starts(axes, ELONGATION)]
    assert found.value < min(tried)
    # And the descent descends by itself, from the circle.
    assert search(given, MARGIN, axes, 50.0, np.eye(d)).value < 0.95 * tried[0]
    assert found.evaluations > len(tried)
    assert found.evaluations <= len(tried) + 2 * DESCENT
    assert np.trace(found.lyapunov_matrix) == pytest.approx(d, rel=1e-12)
    np.testing.assert_array_equal(found.lyapunov_matrix, found.lyapunov_matrix.T)
    again = solve(given, MARGIN, found.lyapunov_matrix)
    assert found.value == pytest.approx(again.value, rel=1e-4)
    np.testing.assert_allclose(found.solution.matrices, again.matrices, atol=1e-2 * np.abs(again.matrices).max())


@pytest.mark.parametrize("condition", [1.5, 3.0, 8.0])
@pytest.mark.parametrize("d", [2, 3])
def test_the_condition_keeps_to_its_bound(d: int, condition: float) -> None:
    given = problem(d, coupled=False)
    free = search(given, MARGIN, rotation(d), 1e3)
    bound = search(given, MARGIN, rotation(d), condition)
    assert np.linalg.cond(free.lyapunov_matrix) > condition
    assert np.linalg.cond(bound.lyapunov_matrix) <= condition * (1.0 + 1e-9)
    assert np.trace(bound.lyapunov_matrix) == pytest.approx(d, rel=1e-12)
    assert free.value < bound.value < search(given, MARGIN, rotation(d), 1.0).value


def test_condition_one_is_the_paper() -> None:
    given = problem(2, coupled=False)
    found = search(given, MARGIN, rotation(2), 1.0)
    np.testing.assert_array_equal(found.lyapunov_matrix, np.eye(2))
    assert found.evaluations == 1
    assert found.value == pytest.approx(solve(given, MARGIN).value, rel=1e-4)


def test_one_dimension_has_nothing_to_search_for() -> None:
    z = np.linspace(0.1, 1.0, 9)[:, None]
    found = search(gather(z, -2.0 * z), MARGIN, np.eye(1), 50.0)
    np.testing.assert_array_equal(found.lyapunov_matrix, [[1.0]])
    np.testing.assert_allclose(found.solution.matrices, [[[-2.0]]], rtol=1e-5)


@pytest.mark.parametrize(("d", "coupled"), CASES)
def test_the_answer_turns_with_the_problem(d: int, coupled: bool) -> None:
    R, axes = rotation(d, 7), rotation(d)
    one = search(problem(d, coupled=coupled), MARGIN, axes, 50.0)
    other = search(turned(d, R, coupled=coupled), MARGIN, axes @ R.T, 50.0)
    assert other.evaluations == one.evaluations
    assert other.value == pytest.approx(one.value, rel=1e-6)
    expected = R @ one.lyapunov_matrix @ R.T
    np.testing.assert_allclose(other.lyapunov_matrix, expected, atol=1e-5 * np.abs(expected).max())


def test_a_start_that_is_given_is_the_only_one() -> None:
    given = problem(2, coupled=False)
    start = random_P(2, 3)
    found = search(given, MARGIN, rotation(2), 50.0, start)
    assert found.value <= solve(given, MARGIN, start).value * (1.0 + 1e-5)
    assert found.evaluations <= 1 + 2 * DESCENT
    whole = search(given, MARGIN, rotation(2), 50.0)
    # From where it has arrived it does not get worse.
    assert search(given, MARGIN, rotation(2), 50.0, whole.lyapunov_matrix).value <= whole.value


def test_a_start_that_cannot_be_solved_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    given, calls = problem(2, coupled=False), []

    def now_and_then(*arguments: object, **options: object) -> Solution:
        calls.append(arguments)
        if len(calls) % 2 == 1:
            raise SolverError("No answer.", "MaxIterations", {})
        return solve(*arguments, **options)

    monkeypatch.setattr(module, "solve", now_and_then)
    found = search(given, MARGIN, np.eye(2), 50.0)
    assert math.isfinite(found.value)
    assert found.evaluations < len(calls)


def test_no_start_that_can_be_solved_is_an_error() -> None:
    given = problem(2, coupled=False)
    broken = replace(given, gram=np.full_like(given.gram, np.nan), rows=None)
    with pytest.raises(SolverError):
        search(broken, MARGIN, np.eye(2), 50.0)
