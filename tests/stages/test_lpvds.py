"""Eq. (6) on hand-computed values, and the step under which V never rises."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import DataError
from stages.dynamics.kernels import blend, cayley_step, euler_step, lyapunov_at, velocity_at
from stages.dynamics.lpvds import LpvDs, workspace
from stages.dynamics.system import DynamicalSystem
from stages.mixture.gaussian import GaussianMixture, responsibilities


def two_components() -> LpvDs:
    """Equal unit Gaussians at (-1, 0) and (1, 0): gamma_2 = 1/(1 + exp(-2 x))."""
    mixture = GaussianMixture(
        weights=[0.5, 0.5], means=[[-1.0, 0.0], [1.0, 0.0]], covariances=np.stack([np.eye(2)] * 2)
    )
    return LpvDs(
        mixture=mixture,
        matrices=[[[-1.0, 0.0], [0.0, -1.0]], [[-3.0, 2.0], [-2.0, -1.0]]],
        goal=[0.0, 2.0],
        lyapunov_matrix=np.eye(2),
    )


def random_model(rng: np.random.Generator, K: int, d: int, *, stiff: float = 1.0) -> LpvDs:
    """A model that is stable under a random P: A_k = P^-1 (skew - positive definite)."""
    root = rng.normal(size=(d, d))
    P = root @ root.T + 0.2 * np.eye(d)
    P *= d / np.trace(P)
    P = 0.5 * (P + P.T)
    skew = 5.0 * rng.normal(size=(K, d, d))
    roots = rng.normal(size=(K, d, d)) * rng.uniform(0.0, 2.0, size=(K, 1, 1))
    definite = roots @ roots.transpose(0, 2, 1) + 1e-3 * np.eye(d)
    shapes = rng.normal(size=(K, d, d))
    mixture = GaussianMixture(
        weights=rng.dirichlet(np.ones(K)),
        means=rng.normal(size=(K, d)),
        covariances=shapes @ shapes.transpose(0, 2, 1) + 0.05 * np.eye(d),
    )
    matrices = stiff * np.linalg.solve(P, skew - skew.transpose(0, 2, 1) - definite)
    return LpvDs(mixture=mixture, matrices=matrices, goal=rng.normal(size=d), lyapunov_matrix=P)


def test_velocity_by_hand() -> None:
    model = two_components()
    # On x = 0 both weigh one half: A = [[-2, 1], [-1, -1]], z = (0, 1).
    np.testing.assert_allclose(model.velocity(np.array([[0.0, 3.0]])), [[1.0, -1.0]], atol=1e-14)
    # At x = log(3)/2 the second weighs 3/4: A = [[-2.5, 1.5], [-1.5, -1]], z = (log(3)/2, 0).
    x = 0.5 * math.log(3.0)
    np.testing.assert_allclose(model.velocity(np.array([[x, 2.0]])), [[-2.5 * x, -1.5 * x]], atol=1e-14)


def test_offsets_make_the_printed_form_of_the_equation() -> None:
    model = two_components()
    np.testing.assert_allclose(model.offsets, [[0.0, 2.0], [-4.0, 2.0]])
    x = np.random.default_rng(0).normal(size=(7, 2))
    gamma = responsibilities(model.mixture, x)
    printed = sum(gamma[:, k, None] * (x @ model.matrices[k].T + model.offsets[k]) for k in range(2))
    np.testing.assert_allclose(model.velocity(x), printed, atol=1e-13)


def test_lyapunov_function_by_hand() -> None:
    mixture = GaussianMixture(weights=[1.0], means=[[0.0, 0.0]], covariances=[np.eye(2)])
    model = LpvDs(mixture=mixture, matrices=[-np.eye(2)], goal=[1.0, 0.0], lyapunov_matrix=[[1.5, 0.5], [0.5, 0.5]])
    x = np.array([[2.0, 2.0], [1.0, 0.0]])
    np.testing.assert_allclose(model.lyapunov(x), [1.5 + 2.0 + 2.0, 0.0])
    np.testing.assert_allclose(model.lyapunov_gradient(x), [[2 * 2.5, 2 * 1.5], [0.0, 0.0]])
    assert lyapunov_at(x[0], model.goal, model.lyapunov_matrix) == pytest.approx(5.5)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_lyapunov_gradient_agrees_with_differences(d: int) -> None:
    rng = np.random.default_rng(d)
    model = random_model(rng, 3, d)
    x, h = rng.normal(size=(1, d)), 1e-6
    difference = [(model.lyapunov(x + h * e) - model.lyapunov(x - h * e))[0] / (2 * h) for e in np.eye(d)]
    np.testing.assert_allclose(model.lyapunov_gradient(x)[0], difference, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize(("rate", "h", "expected"), [(-2.0, 1.0, 0.0), (-1.0, 1.0, 1.0 / 3.0), (-1.0, 6.0, -0.5)])
def test_cayley_step_by_hand(rate: float, h: float, expected: float) -> None:
    # One coordinate: z+/z = (1 + h a/2)/(1 - h a/2).
    out = np.empty(2)
    cayley_step(np.array([3.0, 5.0]), np.array([1.0, 1.0]), rate * np.eye(2), h, out)
    np.testing.assert_allclose(out, [1.0 + 2.0 * expected, 1.0 + 4.0 * expected], atol=1e-14)


def test_cayley_step_of_a_rotation_keeps_the_length() -> None:
    # A = w [[0, -1], [1, 0]] with h w = 2: I - hA/2 = [[1, 1], [-1, 1]], so z+ is z turned by 90 degrees.
    out = np.empty(2)
    cayley_step(np.array([1.0, 0.0]), np.zeros(2), np.array([[0.0, -4.0], [4.0, 0.0]]), 0.5, out)
    np.testing.assert_allclose(out, [0.0, 1.0], atol=1e-15)


def test_cayley_step_needs_a_pivot() -> None:
    # I - hA/2 = [[0, -1], [1, 1]]: the first pivot is zero, and the matrix is not.
    A = np.array([[1.0, 1.0], [-1.0, 0.0]])
    out = np.empty(2)
    cayley_step(np.array([1.0, 2.0]), np.zeros(2), A.copy(), 2.0, out)
    np.testing.assert_allclose(out, np.linalg.solve(np.eye(2) - A, (np.eye(2) + A) @ [1.0, 2.0]), atol=1e-14)


def test_euler_step_by_hand() -> None:
    out = np.empty(2)
    euler_step(np.array([2.0, 1.0]), np.array([1.0, 1.0]), np.array([[-1.0, 0.0], [3.0, 0.0]]), 0.5, out)
    np.testing.assert_allclose(out, [1.5, 2.5])


@pytest.mark.parametrize("d", [1, 2, 3, 7])
def test_cayley_step_solves_its_equation(d: int) -> None:
    rng = np.random.default_rng(d)
    for h in (1e-3, 0.1, 10.0):
        A = rng.normal(size=(d, d)) - 3.0 * np.eye(d)
        x, goal, out = rng.normal(size=d), rng.normal(size=d), np.empty(d)
        cayley_step(x, goal, A.copy(), h, out)
        expected = np.linalg.solve(np.eye(d) - h * A / 2, (np.eye(d) + h * A / 2) @ (x - goal))
        np.testing.assert_allclose(out - goal, expected, rtol=1e-9, atol=1e-12)


@given(
    seed=st.integers(0, 100_000),
    d=st.integers(2, 7),
    step=st.floats(-4.0, 6.0),
    gate=st.floats(0.0, 1.0),
    stiff=st.floats(-2.0, 2.0),
    distance=st.floats(-6.0, 3.0),
)
def test_lyapunov_function_never_rises_under_the_cayley_step(
    seed: int, d: int, step: float, gate: float, stiff: float, distance: float
) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(rng, 4, d, stiff=10.0**stiff)
    x = model.goal + 10.0**distance * rng.normal(size=(20, d))
    before, after = model.lyapunov(x), model.lyapunov(model.step(x, 10.0**step, gate))
    # Rounding of the states, whose goal is not the origin, and of V.
    rounding = 1e-10 * before + 1e-14 * np.sqrt(before) * (1.0 + np.abs(model.goal).max())
    assert (after <= before + rounding).all()


def test_lyapunov_function_rises_somewhere_under_the_euler_step() -> None:
    rng = np.random.default_rng(0)
    rises = 0
    for _ in range(50):
        model = random_model(rng, 4, 2)
        x, out = model.goal + rng.normal(size=2), np.empty(2)
        work = workspace(model.arrays)
        blend(x, model.arrays, work)
        euler_step(x, model.goal, work.A, 0.05, out)
        rises += int(model.lyapunov(out[None])[0] > model.lyapunov(x[None])[0])
    assert rises > 5


@pytest.mark.parametrize("d", [2, 3])
def test_goal_is_an_equilibrium_and_a_closed_gate_stands_still(d: int) -> None:
    rng = np.random.default_rng(d)
    model = random_model(rng, 5, d)
    goal = model.goal[None]
    assert (model.velocity(goal) == 0.0).all()
    assert (model.step(goal, 0.1) == goal).all()
    x = rng.normal(size=(9, d))
    assert (model.step(x, 0.1, gate=0.0) == x).all()
    np.testing.assert_array_equal(model.step(x, 0.1, gate=0.3), model.step(x, 0.03))


@pytest.mark.parametrize("d", [2, 3])
def test_trajectories_reach_the_goal(d: int) -> None:
    model = random_model(np.random.default_rng(1), 3, d)
    x = model.goal + np.ones((1, d))
    start = model.lyapunov(x)[0]
    for _ in range(4000):
        x = model.step(x, 1.0)
    assert model.lyapunov(x)[0] < 1e-2 * start


def test_one_state_at_a_time_gives_the_same_numbers() -> None:
    rng = np.random.default_rng(4)
    model = random_model(rng, 6, 3)
    work, out = workspace(model.arrays), np.empty(3)
    x = rng.normal(size=(20, 3))
    for state, velocity, after in zip(x, model.velocity(x), model.step(x, 0.02), strict=True):
        velocity_at(state, model.arrays, work, out)
        np.testing.assert_array_equal(out, velocity)
        np.testing.assert_allclose(work.gamma, responsibilities(model.mixture, state[None])[0], atol=1e-14)
        blend(state, model.arrays, work)
        cayley_step(state, model.goal, work.A, 0.02, out)
        np.testing.assert_array_equal(out, after)


def test_the_model_is_a_dynamical_system_with_read_only_arrays() -> None:
    model: DynamicalSystem = two_components()
    assert isinstance(model, DynamicalSystem)
    assert model.dimension == 2
    with pytest.raises(ValueError, match="read-only"):
        model.goal[0] = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"matrices": np.zeros((3, 2, 2))}, r"matrices must have shape \(2, 2, 2\)"),
        ({"goal": np.zeros(3)}, r"goal must have shape \(2,\)"),
        ({"lyapunov_matrix": np.eye(3)}, "lyapunov_matrix must have shape"),
        ({"goal": [0.0, np.nan]}, "goal must be finite"),
    ],
)
def test_refuses_what_does_not_fit(change: dict[str, object], message: str) -> None:
    good = two_components()
    fields = {name: getattr(good, name) for name in ("mixture", "matrices", "goal", "lyapunov_matrix")}
    with pytest.raises(DataError, match=message):
        LpvDs(**{**fields, **change})
    with pytest.raises(DataError, match="states must have shape"):
        good.velocity(np.zeros((4, 3)))
