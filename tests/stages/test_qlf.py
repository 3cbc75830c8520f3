"""From demonstrations to a certified model, eqs. (5)-(8)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.errors import DataError, ParameterError
from stages.dynamics.parameters import QlfParameters
from stages.dynamics.qlf import DynamicsFit, fit_dynamics
from stages.mixture.gaussian import GaussianMixture
from stages.mixture.parameters import PcGmmParameters
from stages.mixture.pcgmm import fit_pcgmm


def demonstrations(d: int = 2, n: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """Three demonstrations of a curved motion to the origin, metres and m/s."""
    rng = np.random.default_rng(7)
    s = np.linspace(1.0, 0.0, n)
    shape = np.column_stack([s, 0.4 * np.sin(3.0 * s), *(0.3 * s ** (k + 2) for k in range(d - 2))])
    demos = [0.3 * shape * (1.0 + 0.06 * rng.normal(size=d)) for _ in range(3)]
    return np.concatenate(demos), np.concatenate([np.gradient(demo, 0.02, axis=0) for demo in demos])


def learn(position: np.ndarray, velocity: np.ndarray, goal: np.ndarray, seed: int = 0) -> DynamicsFit:
    lengths = np.full(3, len(position) // 3)
    parameters = PcGmmParameters(sweeps=10, points=120)
    mixture = fit_pcgmm(position, velocity, lengths, parameters, np.random.default_rng(seed)).mixture
    return fit_dynamics(position, velocity, mixture, goal, QlfParameters())


@pytest.mark.parametrize("d", [2, 3, 5])
def test_a_fit_is_certified_and_close(d: int) -> None:
    position, velocity = demonstrations(d)
    fit = learn(position, velocity, np.zeros(d))
    assert fit.certificate.margin == pytest.approx(0.999e-3)
    assert (fit.certificate.largest_eigenvalues <= -0.999e-3).all()
    assert fit.solution.status == "Solved"
    error = math.sqrt(((fit.model.velocity(position) - velocity) ** 2).sum(axis=1).mean())
    assert fit.rmse == pytest.approx(error, rel=1e-12)
    assert fit.relative_rmse == pytest.approx(error / math.sqrt((velocity**2).sum(axis=1).mean()), rel=1e-12)
    assert fit.rmse == pytest.approx(math.sqrt(fit.solution.objective), rel=1e-4)
    assert fit.relative_rmse < 0.35
    assert (fit.model.velocity(np.zeros((1, d))) == 0.0).all()


def test_a_fitted_motion_reaches_the_goal_and_never_raises_the_lyapunov_function() -> None:
    position, velocity = demonstrations()
    model = learn(position, velocity, np.zeros(2)).model
    x = np.concatenate([position[::50], 0.5 * np.random.default_rng(0).normal(size=(40, 2))])
    V = model.lyapunov(x)
    for _ in range(3000):
        x = model.step(x, 0.02)
        after = model.lyapunov(x)
        assert (after <= V * (1.0 + 1e-13)).all()
        V = after
    assert V.max() < 1e-6


def test_unit_and_rotation_change_the_answer_as_they_must() -> None:
    position, velocity = demonstrations()
    R = np.array([[math.cos(0.4), -math.sin(0.4)], [math.sin(0.4), math.cos(0.4)]])
    goal = np.array([0.01, -0.02])
    one = learn(position, velocity, goal)
    millimetres = learn(1e3 * position, 1e3 * velocity, 1e3 * goal)
    turned = learn(position @ R.T, velocity @ R.T, R @ goal)
    scale = np.abs(one.model.matrices).max()
    np.testing.assert_allclose(millimetres.model.matrices, one.model.matrices, atol=1e-6 * scale)
    np.testing.assert_allclose(turned.model.matrices, R @ one.model.matrices @ R.T, atol=1e-6 * scale)


def test_same_data_same_bytes() -> None:
    position, velocity = demonstrations()
    one, two = learn(position, velocity, np.zeros(2)), learn(position, velocity, np.zeros(2))
    assert one.model.matrices.tobytes() == two.model.matrices.tobytes()


def test_refusals() -> None:
    position, velocity = demonstrations()
    mixture = GaussianMixture(weights=[1.0], means=np.zeros((1, 2)), covariances=np.eye(2)[None])
    bad = position.copy()
    bad[3, 0] = np.inf
    cases = [
        ((bad, velocity, np.zeros(2)), "position is not finite"),
        ((position, bad, np.zeros(2)), "velocity is not finite"),
        ((position, velocity, np.array([np.nan, 0.0])), "goal is not finite"),
        ((position, velocity, np.zeros(3)), r"goal must have shape \(2,\)"),
        ((position, velocity[1:], np.zeros(2)), r"must have shape \(n, 2\)"),
        ((position, 0.0 * velocity, np.zeros(2)), "every velocity is zero"),
    ]
    for (x, v, goal), message in cases:
        with pytest.raises(DataError, match=message):
            fit_dynamics(x, v, mixture, goal, QlfParameters())
    for name in ("margin", "tolerance"):
        for value in (0.0, -1.0, math.nan):
            with pytest.raises(ParameterError, match=rf"dynamics\.{name}"):
                fit_dynamics(position, velocity, mixture, np.zeros(2), QlfParameters(**{name: value}))
