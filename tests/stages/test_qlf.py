"""From demonstrations to a certified model, eqs. (5)-(8)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from motions import gaussians, moved, trajectory

from pipeline.errors import DataError, ParameterError, SolverError
from stages.dynamics import qlf
from stages.dynamics.fit import DynamicsFit
from stages.dynamics.parameters import QlfParameters
from stages.mixture.gaussian import GaussianMixture
from stages.mixture.parameters import PcGmmParameters
from stages.mixture.pcgmm import fit_pcgmm
from stages.trajectory import Trajectory

STEP = 0.02
"""Seconds between samples."""


def demonstrations(d: int = 2, n: int = 150) -> list[Trajectory]:
    """Three demonstrations of a curved motion to the origin, metres and m/s."""
    rng = np.random.default_rng(7)
    s = np.linspace(1.0, 0.0, n)
    shape = np.column_stack([s, 0.4 * np.sin(3.0 * s), *(0.3 * s ** (k + 2) for k in range(d - 2))])
    demos = [0.3 * shape * (1.0 + 0.06 * rng.normal(size=d)) for _ in range(3)]
    return [
        trajectory(demo, velocity=np.gradient(demo, STEP, axis=0), duration=STEP * (n - 1), demo=str(m + 1))
        for m, demo in enumerate(demos)
    ]


def gathered(demos: list[Trajectory]) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of all samples."""
    return np.concatenate([demo.position for demo in demos]), np.concatenate([demo.velocity for demo in demos])


def mixture_of(demos: list[Trajectory], seed: int = 0) -> GaussianMixture:
    lengths = np.array([len(demo.time) for demo in demos])
    parameters = PcGmmParameters(sweeps=10, points=120)
    return fit_pcgmm(*gathered(demos), lengths, parameters, np.random.default_rng(seed)).mixture


def learn(demos: list[Trajectory], goal: np.ndarray, **parameters: object) -> DynamicsFit:
    return qlf.fit(demos, {"pcgmm": mixture_of(demos)}, goal, QlfParameters(**parameters))


@pytest.mark.parametrize("d", [2, 3, 5])
def test_a_fit_is_certified_and_close(d: int) -> None:
    position, velocity = gathered(demonstrations(d))
    fit = learn(demonstrations(d), np.zeros(d))
    assert fit.certificate.margin == pytest.approx(0.999e-3)
    assert (fit.certificate.largest_eigenvalues <= -0.999e-3).all()
    np.testing.assert_array_equal(fit.model.lyapunov_matrix, np.eye(d))
    assert (fit.model.warp, fit.model.speed_limit) == (None, math.inf)
    assert (fit.mixture, fit.tried) == ("pcgmm", ())
    assert fit.solution.status == "Solved"
    error = math.sqrt(((fit.model.velocity(position) - velocity) ** 2).sum(axis=1).mean())
    assert fit.rmse == pytest.approx(error, rel=1e-12)
    assert fit.relative_rmse == pytest.approx(error / math.sqrt((velocity**2).sum(axis=1).mean()), rel=1e-12)
    assert fit.rmse == pytest.approx(math.sqrt(fit.solution.objective), rel=1e-4)
    assert fit.relative_rmse < 0.35
    assert (fit.model.velocity(np.zeros((1, d))) == 0.0).all()


def test_a_fitted_motion_reaches_the_goal_and_never_raises_the_lyapunov_function() -> None:
    model = learn(demonstrations(), np.zeros(2)).model
    x = np.concatenate([gathered(demonstrations())[0][::50], 0.5 * np.random.default_rng(0).normal(size=(40, 2))])
    V = model.lyapunov(x)
    for _ in range(3000):
        x = model.step(x, 0.02)
        after = model.lyapunov(x)
        assert (after <= V * (1.0 + 1e-13)).all()
        V = after
    assert V.max() < 1e-6


def test_unit_and_rotation_change_the_answer_as_they_must() -> None:
    demos = demonstrations()
    R = np.array([[math.cos(0.4), -math.sin(0.4)], [math.sin(0.4), math.cos(0.4)]])
    goal = np.array([0.01, -0.02])
    one = learn(demos, goal)
    millimetres = learn(moved(demos, np.eye(2), 1e3), 1e3 * goal)
    turned = learn(moved(demos, R), R @ goal)
    scale = np.abs(one.model.matrices).max()
    np.testing.assert_allclose(millimetres.model.matrices, one.model.matrices, atol=1e-6 * scale)
    np.testing.assert_allclose(turned.model.matrices, R @ one.model.matrices @ R.T, atol=1e-6 * scale)


def test_same_data_same_bytes() -> None:
    one, two = learn(demonstrations(), np.zeros(2)), learn(demonstrations(), np.zeros(2))
    assert one.model.matrices.tobytes() == two.model.matrices.tobytes()


def test_the_loss_as_printed_gives_a_smaller_mean_error_and_is_certified_too() -> None:
    position, velocity = gathered(demonstrations())
    squared, norm = learn(demonstrations(), np.zeros(2)), learn(demonstrations(), np.zeros(2), loss="norm")
    means = [np.linalg.norm(fit.model.velocity(position) - velocity, axis=1).mean() for fit in (squared, norm)]
    assert means[1] < 0.999 * means[0]
    assert norm.solution.objective == pytest.approx(means[1], rel=1e-3)
    assert squared.rmse < norm.rmse
    assert (norm.certificate.largest_eigenvalues <= -0.999e-3).all()


def test_of_several_mixtures_training_roll_outs_choose_one() -> None:
    demos = demonstrations()
    mixtures = {f"of-{K}": gaussians(demos, K) for K in (1, 4, 8)}
    fit = qlf.fit(demos, mixtures, np.zeros(2), QlfParameters())
    assert [entry.mixture for entry in fit.tried] == list(mixtures)
    assert [entry.components for entry in fit.tried] == [1, 4, 8]
    for entry in fit.tried:
        assert (entry.condition, entry.share, entry.guidance) == (1.0, 0.0, 0.0)
        assert entry.chosen == (entry.mixture == fit.mixture)
    best = min((entry for entry in fit.tried if entry.arrives), key=lambda entry: entry.score)
    assert best.chosen
    assert best.mixture != "of-1"  # one linear system cannot bend
    # What was tried leaves no trace in the answer.
    alone = qlf.fit(demos, {fit.mixture: mixtures[fit.mixture]}, np.zeros(2), QlfParameters())
    assert alone.model.matrices.tobytes() == fit.model.matrices.tobytes()


def test_a_margin_that_leaves_no_room_still_has_an_answer() -> None:
    # Every A_k + A_k' <= -margin I has solutions; the error is what grows.
    loose, tight = learn(demonstrations(), np.zeros(2)), learn(demonstrations(), np.zeros(2), margin=20.0)
    assert tight.certificate.margin == pytest.approx(0.999 * 20.0)
    assert (tight.certificate.largest_eigenvalues <= -0.999 * 20.0).all()
    assert tight.rmse > 2.0 * loose.rmse


def test_an_accuracy_that_cannot_be_had_is_an_error_that_keeps_the_program() -> None:
    with pytest.raises(SolverError, match=r"dynamics\.tolerance") as caught:
        learn(demonstrations(), np.zeros(2), tolerance=1e-300)
    assert caught.value.program is not None


def test_refusals() -> None:
    # What data cannot be learned from: see `test_learned_kinds.py`, which tries all kinds.
    demos = demonstrations()
    for name in ("margin", "tolerance"):
        for value in (0.0, -1.0, math.nan, math.inf):
            with pytest.raises(ParameterError, match=rf"dynamics\.{name}: must be a positive number"):
                learn(demos, np.zeros(2), **{name: value})
    with pytest.raises(DataError, match="the goal must be 2 finite numbers"):
        qlf.fit(demos, {"one": gaussians(demos, 1)}, np.zeros(3), QlfParameters())
