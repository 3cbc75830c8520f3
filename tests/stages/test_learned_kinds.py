"""Systems whose Lyapunov function is learned, `pqlf` and `warped`: certified, stable, and the same in any frame."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motions import gaussians, goal, hook, moved, moved_mixture, rotation, trajectory

from pipeline.errors import DataError, ParameterError
from stages.artifacts.dynamics import read_components, read_details, read_dynamics, write_dynamics
from stages.dynamics import pqlf, qlf, warped
from stages.dynamics.fit import CERTIFIED, DynamicsFit, check_positive
from stages.dynamics.follow import deviation
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.parameters import PqlfParameters, QlfParameters, WarpedParameters
from stages.dynamics.samples import frame_of, in_motion
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Trajectory

PARAMETERS: dict[str, Any] = {
    "qlf": QlfParameters(),
    "pqlf": PqlfParameters(guidance=(0.0, 0.6)),
    "warped": WarpedParameters(straightening=(0.6, 0.75), translations=15),
}
FIT: dict[str, Callable[..., DynamicsFit]] = {"qlf": qlf.fit, "pqlf": pqlf.fit, "warped": warped.fit}
LEARNED = [(kind, d) for kind in ("pqlf", "warped") for d in (2, 3)]
MOST_SPEED = 1.2


def mixtures(demonstrations: list[Trajectory]) -> dict[str, GaussianMixture]:
    few = (3, 5) if demonstrations[0].dimension < 5 else (3,)
    return {f"of-{K}": gaussians(demonstrations, K) for K in few}


@cache
def learned(kind: str, d: int) -> DynamicsFit:
    return FIT[kind](hook(d), mixtures(hook(d)), goal(d), PARAMETERS[kind])


def states(d: int, count: int = 500, reach: float = 3.0, seed: int = 0) -> np.ndarray:
    """Random states within so many sizes of the goal, at all distances alike."""
    rng = np.random.default_rng([d, seed])
    directions = rng.normal(size=(count, d))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    size = frame_of(hook(d), goal(d)).size
    return goal(d) + reach * size * rng.uniform(size=(count, 1)) * directions


def unlimited(model: LpvDs) -> LpvDs:
    return replace(model, speed_limit=math.inf)


def rate(demonstrations: list[Trajectory]) -> float:
    """Rms speed over rms distance from the goal, 1/s."""
    moving = [in_motion(one) for one in demonstrations]
    z = np.concatenate([one.position - goal(one.dimension) for one in moving])
    v = np.concatenate([one.velocity for one in moving])
    return float(np.sqrt((v**2).sum() / (z**2).sum()))


@pytest.mark.parametrize("kind", ["pqlf", "warped"])
def test_a_slower_clock_makes_a_slower_system_and_no_other(kind: str) -> None:
    def played(slower: float) -> LpvDs:
        demonstrations = [trajectory(one.position, duration=2.0 * slower, demo=one.demo) for one in hook(2)]
        return FIT[kind](demonstrations, mixtures(hook(2)), goal(2), PARAMETERS[kind]).model

    x, plain, slow = states(2), played(1.0), played(1000.0)
    np.testing.assert_allclose(1000.0 * slow.velocity(x), plain.velocity(x), rtol=0, atol=1e-7)


@pytest.mark.parametrize("kind", ["pqlf", "warped"])
def test_a_pause_changes_little(kind: str) -> None:
    def held(one: Trajectory, samples: int) -> Trajectory:
        middle = len(one.position) // 2
        still = np.repeat(one.position[middle : middle + 1], samples, axis=0)
        position = np.concatenate([one.position[:middle], still, one.position[middle:]])
        velocity = np.concatenate([one.velocity[:middle], np.zeros_like(still), one.velocity[middle:]])
        step = one.time[1] - one.time[0]
        return trajectory(position, velocity=velocity, duration=step * (len(position) - 1), demo=one.demo)

    x = np.concatenate([one.position for one in hook(2)])
    given = mixtures(hook(2))
    plain = FIT[kind](hook(2), given, goal(2), PARAMETERS[kind]).model.velocity(x)
    paused = FIT[kind]([held(one, 2000) for one in hook(2)], given, goal(2), PARAMETERS[kind]).model.velocity(x)
    assert np.sqrt(((paused - plain) ** 2).mean() / (plain**2).mean()) < 0.1


@pytest.mark.parametrize(("kind", "d"), [*LEARNED, ("pqlf", 5), ("warped", 5)])
def test_the_certificate_holds(kind: str, d: int) -> None:
    fit = learned(kind, d)
    P, margin = fit.model.lyapunov_matrix, CERTIFIED * PARAMETERS[kind].margin * rate(hook(d))
    assert fit.certificate.margin == pytest.approx(margin, rel=1e-12)
    A = fit.model.matrices
    assert np.linalg.eigvalsh(A.transpose(0, 2, 1) @ P + P @ A).max() < -margin
    assert np.trace(P) == pytest.approx(d, rel=1e-12)
    np.testing.assert_array_equal(P, P.T)
    values = np.linalg.eigvalsh(P)
    assert values[0] > 0.0
    assert values[-1] / values[0] <= 50.0 * (1.0 + 1e-9)
    assert fit.solution.status == "Solved"
    if kind == "warped":
        assert fit.model.warp is not None
        assert fit.model.warp.bound < 1.0
    else:
        assert fit.model.warp is None


@pytest.mark.parametrize(("kind", "d"), [*LEARNED, ("pqlf", 5), ("warped", 5)])
def test_a_fit_says_what_it_is_and_how_close(kind: str, d: int) -> None:
    fit, parameters = learned(kind, d), PARAMETERS[kind]
    x, v = (np.concatenate([getattr(one, name) for one in hook(d)]) for name in ("position", "velocity"))
    error = math.sqrt(((fit.model.velocity(x) - v) ** 2).sum(axis=1).mean())
    assert fit.rmse == pytest.approx(error, rel=1e-12)
    assert fit.relative_rmse == pytest.approx(error / math.sqrt((v**2).sum(axis=1).mean()), rel=1e-12)
    # A system without a clock cannot start from rest as a demonstration does.
    assert fit.relative_rmse < 0.6
    ways = itertools.product(
        mixtures(hook(d)), parameters.straightening if kind == "warped" else (0.0,), parameters.guidance
    )
    assert [(entry.mixture, entry.share, entry.guidance) for entry in fit.tried] == list(ways)
    assert [entry.mixture for entry in fit.tried if entry.chosen] == [fit.mixture]
    K = {name: mixture.components for name, mixture in mixtures(hook(d)).items()}
    assert fit.model.mixture.components == K[fit.mixture]
    assert (fit.model.velocity(goal(d)[None]) == 0.0).all()


@pytest.mark.parametrize("kind", ["pqlf", "warped"])
def test_what_is_taken_is_learned_from_every_sample(kind: str) -> None:
    demonstrations = hook(2, n=700)  # many more than candidates are compared by
    fit = FIT[kind](demonstrations, mixtures(demonstrations), goal(2), replace(PARAMETERS[kind], guidance=(0.0,)))
    assert (fit.certificate.shift == 0.0).all()
    samples = [in_motion(one) for one in demonstrations]
    assert sum(len(s.time) for s in samples) > 0.9 * sum(len(one.time) for one in demonstrations)
    x, v = (np.concatenate([getattr(s, name) for s in samples]) for name in ("position", "velocity"))
    error = ((unlimited(fit.model).velocity(x) - v) ** 2).sum(axis=1).mean()
    assert fit.solution.objective == pytest.approx(error, rel=1e-7)


@pytest.mark.parametrize(("kind", "d"), LEARNED)
def test_the_lyapunov_function_falls_everywhere(kind: str, d: int) -> None:
    fit, x = learned(kind, d), states(d)
    model = fit.model
    descent = (model.lyapunov_gradient(x) * model.velocity(x)).sum(axis=1)
    assert (descent < 0.0).all()
    assert (model.lyapunov(x) > 0.0).all()
    assert model.lyapunov(goal(d)[None])[0] == 0.0
    # By more than the margin demands, wherever there is no limit to the speed.
    free = (model.lyapunov_gradient(x) * unlimited(model).velocity(x)).sum(axis=1)
    z = x - goal(d)
    psi = z if model.warp is None else model.warp.apply(z)[0]
    assert (free < -fit.certificate.margin * (psi**2).sum(axis=1)).all()


@pytest.mark.parametrize("dt", [1e-3, 0.02, 0.3, 1.0])
@pytest.mark.parametrize(("kind", "d"), LEARNED)
def test_the_lyapunov_function_never_rises_along_a_roll_out(kind: str, d: int, dt: float) -> None:
    model = learned(kind, d).model
    size = frame_of(hook(d), goal(d)).size
    for each in (model, unlimited(model)):
        x = states(d, 60)
        V = start = each.lyapunov(x)
        for _ in range(60):
            x = each.step(x, dt)
            after = each.lyapunov(x)
            assert (after <= V * (1.0 + 1e-12) + 1e-14 * size**2).all()
            V = after
        assert (start > V).all()


@pytest.mark.parametrize(("kind", "d"), LEARNED)
def test_a_grid_of_starts_all_converge(kind: str, d: int) -> None:
    model, size = learned(kind, d).model, frame_of(hook(d), goal(d)).size
    line = np.linspace(-1.0, 1.0, 9 if d == 2 else 5)
    x = goal(d) + size * np.stack(np.meshgrid(*[line] * d), axis=-1).reshape(-1, d)
    for _ in range(600):
        x = model.step(x, 0.05)
    assert np.linalg.norm(x - goal(d), axis=1).max() < 1e-3 * size


@pytest.mark.parametrize("d", [2, 3])
def test_a_motion_that_first_moves_away_is_followed_by_what_has_learned_how(d: int) -> None:
    demonstrations = hook(d)
    size = frame_of(demonstrations, goal(d)).size
    for one in demonstrations:
        away = np.linalg.norm(one.position - goal(d), axis=1)
        assert away.max() > 1.2 * away[0]
    ways = {
        kind: np.mean(
            [deviation(learned(kind, d).model.arrays, one, one.position[0], size)[0] for one in demonstrations]
        )
        for kind in FIT
    }
    assert ways["warped"] < 0.5 * ways["qlf"]
    assert ways["pqlf"] < ways["qlf"]
    assert ways["warped"] < 0.05 * size


@pytest.mark.parametrize("kind", ["qlf", "pqlf", "warped"])
@pytest.mark.parametrize(("d", "scale"), [(2, 1e3), (2, 1e-3), (3, 1.0)])
def test_rotated_and_scaled_data_give_a_rotated_and_scaled_field(kind: str, d: int, scale: float) -> None:
    R, demonstrations = rotation(d, 1), hook(d)
    there = {name: moved_mixture(mixture, R, scale) for name, mixture in mixtures(demonstrations).items()}
    other = FIT[kind](moved(demonstrations, R, scale), there, scale * R @ goal(d), PARAMETERS[kind])
    one = learned(kind, d)
    assert [entry.chosen for entry in other.tried] == [entry.chosen for entry in one.tried]
    x = np.concatenate([states(d, 200), *(demonstration.position for demonstration in demonstrations)])
    expected = scale * one.model.velocity(x) @ R.T
    found = other.model.velocity(scale * x @ R.T)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
    assert other.relative_rmse == pytest.approx(one.relative_rmse, rel=1e-6)


@pytest.mark.parametrize("kind", ["pqlf", "warped"])
def test_the_same_data_give_the_same_bytes(kind: str) -> None:
    one, two = learned(kind, 2), FIT[kind](hook(2), mixtures(hook(2)), goal(2), PARAMETERS[kind])
    for a, b in zip(one.model.arrays, two.model.arrays, strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()
    assert one.tried == two.tried
    assert (one.rmse, one.relative_rmse) == (two.rmse, two.relative_rmse)


def test_not_straightened_at_all_the_warped_system_is_the_quadratic_one() -> None:
    demonstrations, shared = hook(2), {"margin": 0.01, "blur": 0.025, "guidance": (0.6,)}
    one = pqlf.fit(demonstrations, mixtures(demonstrations), goal(2), PqlfParameters(**shared))
    other = warped.fit(
        demonstrations, mixtures(demonstrations), goal(2), WarpedParameters(straightening=(0.0,), **shared)
    )
    assert other.model.warp is None
    for a, b in zip(one.model.arrays, other.model.arrays, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("kind", "d"), LEARNED)
def test_the_speed_keeps_to_its_limit(kind: str, d: int) -> None:
    model = learned(kind, d).model
    top = max(np.linalg.norm(one.velocity, axis=1).max() for one in hook(d))
    assert model.speed_limit == pytest.approx(MOST_SPEED * top, rel=1e-12)
    x = states(d, reach=30.0)
    assert np.linalg.norm(model.velocity(x), axis=1).max() <= model.speed_limit * (1.0 + 1e-12)
    assert np.linalg.norm(unlimited(model).velocity(x), axis=1).max() > 3.0 * model.speed_limit


@pytest.mark.parametrize("kind", ["pqlf", "warped"])
def test_without_a_limit_there_is_none(kind: str) -> None:
    parameters = replace(PARAMETERS[kind], speed_limit=0.0)
    assert FIT[kind](hook(2), mixtures(hook(2)), goal(2), parameters).model.speed_limit == math.inf


@pytest.mark.parametrize("kind", ["pqlf", "warped"])
def test_one_demonstration_and_a_straight_one_are_enough(kind: str) -> None:
    way = np.linspace(1.0, 0.0, 60)[:, None] ** 2
    straight = [trajectory(goal(3) + way * [0.3, 0.1, -0.2])]
    for demonstrations in (hook(3, 1), straight):
        fit = FIT[kind](demonstrations, {"one": gaussians(demonstrations, 3)}, goal(3), PARAMETERS[kind])
        assert fit.certificate.margin > 0.0
        assert fit.relative_rmse < 0.6
        assert all(entry.held_out_deviation == 0.0 for entry in fit.tried)
    assert fit.model.warp is None  # there is nothing to straighten
    assert fit.relative_rmse < 0.1


@pytest.mark.parametrize(("kind", "d"), [("qlf", 2), *LEARNED])
def test_a_system_comes_back_from_its_file_to_the_last_bit(tmp_path: Path, kind: str, d: int) -> None:
    fit = learned(kind, d)
    proof = fit.certificate
    for model in (fit.model, unlimited(fit.model)):
        for file in ("a.parquet", "b.parquet"):
            write_dynamics(
                tmp_path / file, model, proof.largest_eigenvalues, proof.shift, {"kind": kind, "rmse": fit.rmse}
            )
        assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
        back = read_dynamics(tmp_path / "a.parquet")
        assert (back.warp is None) == (kind != "warped")
        for name, one, other in zip(model.arrays._fields, model.arrays, back.arrays, strict=True):
            assert np.asarray(one).tobytes() == np.asarray(other).tobytes(), name
        x = states(d, 50)
        assert back.velocity(x).tobytes() == model.velocity(x).tobytes()
    details = read_details(tmp_path / "a.parquet")
    assert (details["kind"], details["rmse"], details["speed_limit"]) == (kind, fit.rmse, None)
    for k, row in enumerate(read_components(tmp_path / "a.parquet")):
        assert row["A"] == fit.model.matrices[k].ravel().tolist()
        assert row["largest_eigenvalue"] == proof.largest_eigenvalues[k]
        # b is of eq. (6), of which the image of a warp has none.
        assert row["b"] == (None if kind == "warped" else fit.model.offsets[k].tolist())


def broken(name: str, value: float) -> Trajectory:
    one = hook(2)[1]
    values = np.array(getattr(one, name))
    values[7, 1] = value
    return replace(one, **{name: values})


@pytest.mark.parametrize("kind", ["qlf", "pqlf", "warped"])
def test_what_nothing_can_be_learned_from_is_refused(kind: str) -> None:
    demonstrations = hook(2)
    found, at = mixtures(demonstrations), goal(2)
    still = trajectory(demonstrations[0].position, velocity=np.zeros((120, 2)), demo="4")
    there = trajectory(np.tile(at, (9, 1)), velocity=np.ones((9, 2)), demo="5")
    elsewhere = trajectory(np.tile(at + 0.1, (9, 1)), velocity=np.ones((9, 2)), demo="6")
    cases = [
        (([], found, at), "training data: there is no demonstration to learn from"),
        ((demonstrations, {}, at), "training data: there is no mixture to learn with"),
        (([*demonstrations, *hook(3)], found, at), "made, demonstration 1: has 3 coordinates, the first one has 2"),
        ((hook(3), found, goal(3)), "training data: mixture of-3 has 2 coordinates, demonstrations have 3"),
        (([demonstrations[0], broken("position", np.nan)], found, at), "demonstration 2: position is not finite"),
        (([demonstrations[0], broken("velocity", np.inf)], found, at), "demonstration 2: velocity is not finite"),
        ((demonstrations, found, goal(3)), r"the goal must be 2 finite numbers, not \[0.3, -0.2, 0.1\]"),
        ((demonstrations, found, [0.0, np.nan]), r"the goal must be 2 finite numbers, not \[0.0, nan\]"),
        (([*demonstrations, still], found, at), "demonstration 4: every velocity is zero: a demonstration must move"),
        (([*demonstrations, there], found, at), "demonstration 5: all points are the same: a demonstration must move"),
        (([elsewhere], found, at), "made, demonstration 6: all points are the same: a demonstration must move"),
    ]
    for given, message in cases:
        with pytest.raises(DataError, match=message):
            FIT[kind](*given, PARAMETERS[kind])


@pytest.mark.parametrize("kind", ["pqlf", "warped"])
@pytest.mark.parametrize("name", ["margin", "condition", "widening", "guide_width", "guide_decay", "tolerance"])
def test_a_parameter_that_must_be_positive_is(kind: str, name: str) -> None:
    for value in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ParameterError, match=rf"dynamics\.{name}: must be a positive number, not {value}"):
            FIT[kind](hook(2), mixtures(hook(2)), goal(2), replace(PARAMETERS[kind], **{name: value}))
    check_positive(PARAMETERS[kind], name)
