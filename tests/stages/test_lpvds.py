"""Eq. (6) on hand-computed values, also in the image of a warp, and the step under which V never rises."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import DataError
from stages.dynamics.kernels import (
    blend,
    cayley_step,
    euler_step_at,
    lyapunov_at,
    lyapunov_gradient_at,
    step_at,
    velocity_at,
    workspace,
)
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.system import DynamicalSystem
from stages.dynamics.warp import STEEPEST, Warp
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


KINDS = [(warped, limited) for warped in (False, True) for limited in (False, True)]
"""Of models: in the image of a warp, and with a limit to their speed."""


def random_warp(rng: np.random.Generator, M: int, d: int) -> Warp:
    """Translations about the goal, of widths from 0.3 to 3 m, at most 0.7 of the way to being flat."""
    rates = 10.0 ** rng.uniform(-0.5, 0.5, size=M)
    directions = rng.normal(size=(M, d))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths = rng.uniform(0.1, 0.7, size=M) / (rates * STEEPEST)
    return Warp(centres=rng.normal(size=(M, d)), translations=lengths[:, None] * directions, rates=rates)


def random_model(
    rng: np.random.Generator, K: int, d: int, *, stiff: float = 1.0, warped: bool = False, limited: bool = False
) -> LpvDs:
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
    model = LpvDs(mixture=mixture, matrices=matrices, goal=rng.normal(size=d), lyapunov_matrix=P)
    return replace(
        model, warp=random_warp(rng, 6, d) if warped else None, speed_limit=2.0 * stiff if limited else math.inf
    )


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
    assert lyapunov_at(x[0], model.arrays, workspace(model.arrays)) == pytest.approx(5.5)


def warped_by_hand(**changes: object) -> LpvDs:
    """x' = J^-1 (-psi), psi with one translation v = (0.5, 0.25) about (1, 0), of rate 1; the goal is (2, 3)."""
    fields: dict[str, object] = {
        "mixture": GaussianMixture(weights=[1.0], means=[[0.0, 0.0]], covariances=[np.eye(2)]),
        "matrices": [-np.eye(2)],
        "goal": [2.0, 3.0],
        "lyapunov_matrix": np.eye(2),
        "warp": Warp(centres=[[1.0, 0.0]], translations=[[0.5, 0.25]], rates=[1.0]),
    }
    return LpvDs(**{**fields, **changes})


def test_a_warped_system_by_hand() -> None:
    e, model = math.e, warped_by_hand()
    # At (1, 0) from the goal J = I and psi = (1, 0) + v (1 - 1/e); at (1, 1) psi is (1, 1), J = [[1, -1/e], [0, j]].
    there = np.array([1.0 + 0.5 * (1.0 - 1.0 / e), 0.25 * (1.0 - 1.0 / e)])
    j = 1.0 - 0.5 / e
    x = model.goal + np.array([[1.0, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(model.velocity(x), [-there, [-1.0 - 1.0 / (e * j), -1.0 / j]], rtol=1e-14)
    np.testing.assert_allclose(model.lyapunov(x), [there @ there, 2.0], rtol=1e-14)
    np.testing.assert_allclose(model.lyapunov_gradient(x), [2.0 * there, [2.0, 2.0 * (j - 1.0 / e)]], rtol=1e-14)
    # A step of 2/3 s halves the image: (1 - h/2)/(1 + h/2) = 1/2.
    after = model.step(x, 2.0 / 3.0) - model.goal
    assert model.warp is not None
    np.testing.assert_allclose(model.warp.apply(after)[0], [0.5 * there, [0.5, 0.5]], atol=1e-15)
    # At half the speed, one of 4/3 s does.
    np.testing.assert_allclose(model.step(x, 4.0 / 3.0, gate=0.5) - model.goal, after, atol=1e-15)


def test_a_speed_limit_by_hand() -> None:
    mixture = GaussianMixture(weights=[1.0], means=[[0.0, 0.0]], covariances=[np.eye(2)])
    model = LpvDs(
        mixture=mixture, matrices=[-2.0 * np.eye(2)], goal=[0.0, 0.0], lyapunov_matrix=np.eye(2), speed_limit=5.0
    )
    x = np.array([[1.0, 0.0], [3.0, 4.0]])
    np.testing.assert_allclose(model.velocity(x), [[-2.0, 0.0], [-3.0, -4.0]], rtol=1e-15)
    # Twice too fast, so that 2/3 s are 1/3 s; below the limit they are themselves: (1 - h)/(1 + h).
    np.testing.assert_allclose(model.step(x, 2.0 / 3.0), [[0.2, 0.0], [1.5, 2.0]], rtol=1e-14)
    np.testing.assert_allclose(model.lyapunov(x), [1.0, 25.0])


@pytest.mark.parametrize(("warped", "limited"), KINDS)
@pytest.mark.parametrize("d", [2, 3, 5])
def test_lyapunov_gradient_agrees_with_differences(d: int, warped: bool, limited: bool) -> None:
    rng = np.random.default_rng(d)
    model = random_model(rng, 3, d, warped=warped, limited=limited)
    x, h = rng.normal(size=(1, d)), 1e-6
    difference = [(model.lyapunov(x + h * e) - model.lyapunov(x - h * e))[0] / (2 * h) for e in np.eye(d)]
    np.testing.assert_allclose(model.lyapunov_gradient(x)[0], difference, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_the_image_of_a_warped_system_is_the_plain_one(d: int) -> None:
    # d psi/dt = sum_k gamma_k A_k psi, by differences along the velocity.
    rng = np.random.default_rng(d)
    model = random_model(rng, 3, d, warped=True)
    assert model.warp is not None
    x, h = model.goal + rng.normal(size=(8, d)), 1e-7
    f = model.velocity(x)
    images = [model.warp.apply(x + side * h * f - model.goal)[0] for side in (1, -1)]
    A = np.einsum("tk,kij->tij", responsibilities(model.mixture, x), model.matrices)
    expected = np.einsum("tij,tj->ti", A, model.warp.apply(x - model.goal)[0])
    np.testing.assert_allclose((images[0] - images[1]) / (2.0 * h), expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(("warped", "limited"), KINDS)
def test_a_short_step_goes_along_the_velocity(warped: bool, limited: bool) -> None:
    rng = np.random.default_rng(0)
    model = random_model(rng, 3, 3, warped=warped, limited=limited)
    x, dt = model.goal + rng.normal(size=(20, 3)), 1e-7
    f = model.velocity(x)
    np.testing.assert_allclose((model.step(x, dt) - x) / dt, f, atol=1e-5 * np.abs(f).max())


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
    mixture = GaussianMixture(weights=[1.0], means=[[0.0, 0.0]], covariances=[np.eye(2)])
    A = [[[-1.0, 0.0], [3.0, 0.0]]]
    model = LpvDs(mixture=mixture, matrices=A, goal=[1.0, 1.0], lyapunov_matrix=np.eye(2)).arrays
    out = np.empty(2)
    euler_step_at(np.array([2.0, 1.0]), model, 0.5, workspace(model), out)
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
    warped=st.booleans(),
    limited=st.booleans(),
)
def test_lyapunov_function_never_rises_under_the_cayley_step(
    seed: int, d: int, step: float, gate: float, stiff: float, distance: float, warped: bool, limited: bool
) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(rng, 4, d, stiff=10.0**stiff, warped=warped, limited=limited)
    x = model.goal + 10.0**distance * rng.normal(size=(20, d))
    before, after = model.lyapunov(x), model.lyapunov(model.step(x, 10.0**step, gate))
    # Rounding of the states, whose goal is not the origin, and of V; there and back again rounds more often.
    often = 100.0 if warped else 1.0
    rounding = 1e-10 * before + 1e-14 * often * np.sqrt(before) * (1.0 + np.abs(model.goal).max())
    assert (after <= before + rounding).all()


@pytest.mark.parametrize(("warped", "limited"), KINDS)
@pytest.mark.parametrize("dt", [1e-4, 0.01, 0.3, 10.0])
def test_lyapunov_function_never_rises_along_a_roll_out(dt: float, warped: bool, limited: bool) -> None:
    model = random_model(np.random.default_rng(2), 5, 3, stiff=5.0, warped=warped, limited=limited)
    x = model.goal + 3.0 * np.random.default_rng(3).normal(size=(30, 3))
    V = start = model.lyapunov(x)
    for _ in range(100):
        x = model.step(x, dt)
        after = model.lyapunov(x)
        assert (after <= V * (1.0 + 1e-12) + 1e-26).all()
        V = after
    assert (start > V).all()


@pytest.mark.parametrize("warped", [False, True])
@pytest.mark.parametrize("d", [2, 3, 7])
def test_the_limit_changes_the_speed_and_not_the_direction(d: int, warped: bool) -> None:
    rng = np.random.default_rng(d)
    free = random_model(rng, 4, d, warped=warped)
    x = free.goal + rng.normal(size=(400, d)) * 10.0 ** rng.uniform(-2.0, 2.0, size=(400, 1))
    f = free.velocity(x)
    speed = np.linalg.norm(f, axis=1)
    limit = float(np.median(speed))
    model = replace(free, speed_limit=limit)
    g = model.velocity(x)
    slow = speed <= limit * (1.0 - 1e-12)
    assert 100 < slow.sum() < 300
    np.testing.assert_array_equal(g[slow], f[slow])
    assert np.linalg.norm(g, axis=1).max() <= limit * (1.0 + 1e-15 * d)
    np.testing.assert_allclose(g[~slow] / limit, f[~slow] / speed[~slow, None], atol=1e-14)
    # V is the same function; a step is the free one in less time.
    np.testing.assert_array_equal(model.lyapunov(x), free.lyapunov(x))
    np.testing.assert_array_equal(model.lyapunov_gradient(x), free.lyapunov_gradient(x))
    share = np.minimum(1.0, limit / speed)
    expected = np.concatenate([free.step(state[None], 0.1 * part) for state, part in zip(x, share, strict=True)])
    np.testing.assert_allclose(model.step(x, 0.1), expected, rtol=1e-12, atol=1e-13)


def test_lyapunov_function_rises_somewhere_under_the_euler_step() -> None:
    rng = np.random.default_rng(0)
    rises = 0
    for _ in range(50):
        model = random_model(rng, 4, 2)
        x, out = model.goal + rng.normal(size=2), np.empty(2)
        euler_step_at(x, model.arrays, 0.05, workspace(model.arrays), out)
        rises += int(model.lyapunov(out[None])[0] > model.lyapunov(x[None])[0])
    assert rises > 5


@pytest.mark.parametrize(("warped", "limited"), KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_goal_is_an_equilibrium_and_a_closed_gate_stands_still(d: int, warped: bool, limited: bool) -> None:
    rng = np.random.default_rng(d)
    model = random_model(rng, 5, d, warped=warped, limited=limited)
    goal = model.goal[None]
    assert (model.velocity(goal) == 0.0).all()
    assert model.lyapunov(goal)[0] == 0.0
    assert (model.lyapunov_gradient(goal) == 0.0).all()
    np.testing.assert_allclose(model.step(goal, 0.1), goal, rtol=0.0, atol=1e-14 if warped else 0.0)
    x = rng.normal(size=(9, d))
    assert (model.step(x, 0.1, gate=0.0) == x).all()
    assert (model.step(x, 0.0) == x).all()
    np.testing.assert_array_equal(model.step(x, 0.1, gate=0.3), model.step(x, 0.03))


@pytest.mark.parametrize(("warped", "limited"), KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_trajectories_reach_the_goal(d: int, warped: bool, limited: bool) -> None:
    model = random_model(np.random.default_rng(1), 3, d, warped=warped, limited=limited)
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


@pytest.mark.parametrize(("warped", "limited"), KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_any_order_of_calls_gives_the_same_numbers(d: int, warped: bool, limited: bool) -> None:
    # One workspace for all: nothing that one state or one function leaves behind reaches another.
    rng = np.random.default_rng(4)
    model = random_model(rng, 6, d, warped=warped, limited=limited)
    work, out = workspace(model.arrays), np.empty(d)
    x = model.goal + rng.normal(size=(20, d))
    whole = (model.velocity(x), model.lyapunov_gradient(x), model.step(x, 0.02), model.lyapunov(x))
    for t in rng.permutation(20):
        for function in rng.permutation(4):
            if function == 0:
                velocity_at(x[t], model.arrays, work, out)
            elif function == 1:
                lyapunov_gradient_at(x[t], model.arrays, work, out)
            elif function == 2:
                step_at(x[t], model.arrays, 0.02, work, out)
            else:
                out[:] = lyapunov_at(x[t], model.arrays, work)
            np.testing.assert_array_equal(out, whole[function][t])


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
        ({"warp": Warp.identity(3)}, "the warp must be of 2 coordinates, not 3"),
        ({"speed_limit": 0.0}, "the speed limit must be positive, not 0.0"),
        ({"speed_limit": math.nan}, "the speed limit must be positive, not nan"),
    ],
)
def test_refuses_what_does_not_fit(change: dict[str, object], message: str) -> None:
    good = two_components()
    fields = {name: getattr(good, name) for name in ("mixture", "matrices", "goal", "lyapunov_matrix")}
    with pytest.raises(DataError, match=message):
        LpvDs(**{**fields, **change})
    with pytest.raises(DataError, match="states must have shape"):
        good.velocity(np.zeros((4, 3)))
