"""Roll-outs: stability, recovery, speed and order, on random certified models. Paper eqs. (6), (9)-(12)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import DataError, ParameterError
from stages.dynamics.lpvds import LpvDs
from stages.evaluate.compare import largest_rise, recovery_time
from stages.mixture.gaussian import GaussianMixture
from stages.policy.coupled import energy
from stages.policy.coupling import RETURN_ALLOWANCE
from stages.policy.outcome import Outcome
from stages.rollout.parameters import (
    ClpvdsController,
    Condition,
    Controller,
    Displacement,
    LpvdsController,
    RolloutParameters,
)
from stages.rollout.simulate import Rollout, simulate
from stages.trajectory import Trajectory

PLAIN = LpvdsController()
ROBUST = ClpvdsController(mode="robust")
PAPER = ClpvdsController(mode="paper")
seeds = st.integers(0, 2**32 - 1)
dimensions = st.integers(2, 4)


def random_model(generator: np.random.Generator, d: int) -> LpvDs:
    """A certified system about the size of a LASA motion: symmetric parts negative definite, any skew part."""
    K = int(generator.integers(1, 8))
    roots = 0.02 * generator.normal(size=(K, d, d))
    covariances = roots @ roots.transpose(0, 2, 1) + 1e-4 * np.eye(d)
    mixture = GaussianMixture(
        weights=generator.dirichlet(np.full(K, 5.0)),
        means=0.05 * generator.normal(size=(K, d)),
        covariances=covariances,
    )
    halves = generator.normal(size=(K, d, d)) / math.sqrt(d)
    skew = 3.0 * generator.normal(size=(K, d, d))
    matrices = -(halves @ halves.transpose(0, 2, 1)) - 0.5 * np.eye(d) + skew - skew.transpose(0, 2, 1)
    return LpvDs(mixture=mixture, matrices=matrices, goal=0.02 * generator.normal(size=d), lyapunov_matrix=np.eye(d))


def line_model(rate: float = 2.0, d: int = 2) -> LpvDs:
    """xdot = -rate x: straight to the goal at the origin."""
    mixture = GaussianMixture(weights=np.ones(1), means=np.zeros((1, d)), covariances=np.eye(d)[None])
    return LpvDs(mixture=mixture, matrices=-rate * np.eye(d)[None], goal=np.zeros(d), lyapunov_matrix=np.eye(d))


def pushed(offset: tuple[float, ...] | None, name: str = "none", **when: object) -> Condition:
    """A condition with one displacement, or none."""
    disturbances = () if offset is None else (Displacement(offset=offset, **when),)  # type: ignore[arg-type]
    return Condition(name=name, disturbances=disturbances)


def roll_out(
    model: LpvDs, starts: Sequence[Trajectory], parameters: RolloutParameters, top_speed: float, *more: Any
) -> tuple[Rollout, ...]:
    return simulate(model, starts, parameters, top_speed, *more).rollouts


def start_at(position: np.ndarray, demo: str = "4", duration: float = 4.0, samples: int = 401) -> Trajectory:
    """A demonstration of which only the start and the clock matter."""
    path = np.linspace(position, np.zeros(len(position)), samples)
    return Trajectory(
        dataset="made",
        demo=demo,
        split="test",
        time=np.linspace(0, duration, samples),
        position=path,
        velocity=0 * path,
    )


def top_speed(model: LpvDs, start: Trajectory, parameters: RolloutParameters | None = None) -> float:
    """Top speed of the plain roll-out, as the demonstrations' of a good fit."""
    parameters = dataclasses.replace(parameters or RolloutParameters(), controllers=(PLAIN,), conditions=(Condition(),))
    (plain,) = roll_out(model, [start], parameters, 1.0)
    return float(np.linalg.norm(np.diff(plain.x, axis=0), axis=1).max() / plain.time[1])


def run(
    model: LpvDs,
    start: Trajectory,
    controller: Controller,
    displacement: tuple[float, ...] | None = None,
    **more: object,
) -> Rollout:
    parameters = RolloutParameters(
        controllers=(controller,), conditions=(pushed(displacement),), max_duration=10.0, **more
    )
    (rollout,) = roll_out(model, [start], parameters, top_speed(model, start, parameters))
    return rollout


def case(seed: int, d: int) -> tuple[LpvDs, Trajectory, tuple[float, ...]]:
    generator = np.random.default_rng(seed)
    model = random_model(generator, d)
    start = start_at(model.goal + 0.05 * generator.normal(size=d))
    return model, start, tuple(0.02 * generator.normal(size=d))


@settings(max_examples=40)
@given(seeds, dimensions, st.sampled_from([PLAIN, ROBUST, PAPER]), st.sampled_from([0.001, 0.01, 0.1, 1.0]))
def test_v_never_rises_along_x(seed: int, d: int, controller: Controller, dt: float) -> None:
    model, start, displacement = case(seed, d)
    for push in (None, displacement):
        rollout = run(model, start, controller, push, dt=dt)
        assert largest_rise(rollout.lyapunov, rollout.disturbed if controller is PLAIN else ()) == 0.0
        assert rollout.outcome is not Outcome.DIVERGED


@settings(max_examples=20)
@given(seeds, dimensions)
def test_recovered_robust_roll_out_repeats_the_undisturbed_one_bit_for_bit(seed: int, d: int) -> None:
    model, start, displacement = case(seed, d)
    undisturbed, disturbed = run(model, start, ROBUST), run(model, start, ROBUST, displacement)
    assert (np.diff(undisturbed.x, axis=0) != 0).any(axis=1).all()  # x moved in every step
    waited = ~disturbed.gate
    assert waited.sum() > 0
    assert (disturbed.x[~waited] == undisturbed.x).all()
    assert (disturbed.p_hat[~waited] == undisturbed.p_hat).all()
    at = disturbed.displaced
    assert disturbed.p_hat[at] == pytest.approx(undisturbed.p_hat[at] + displacement, rel=1e-12)
    assert (disturbed.x[at] == undisturbed.x[at]).all()
    # It comes back at v_max.
    v_max = RETURN_ALLOWANCE * top_speed(model, start)
    steps = math.ceil(np.linalg.norm(displacement) / (v_max * disturbed.time[1]) - 1e-9)
    recovery = recovery_time(disturbed.time, disturbed.gate, disturbed.disturbed)
    assert recovery is not None
    assert round(recovery / disturbed.time[1]) in (steps, steps + 1)


@settings(max_examples=20)
@given(seeds, dimensions, st.booleans())
def test_the_exact_gate_is_open_only_where_p_hat_is_x(seed: int, d: int, slow: bool) -> None:
    model, start, displacement = case(seed, d)
    # A follower slower than x makes x wait again and again; the gate stays exact.
    controller = ClpvdsController(mode="robust", v_max=0.01) if slow else ROBUST
    rollout = run(model, start, controller, displacement)
    together = (rollout.x == rollout.p_hat).all(axis=1)
    assert (rollout.gate == together).all()
    moved = (np.diff(rollout.x, axis=0) != 0).any(axis=1)
    assert not (moved & ~rollout.gate[:-1]).any()
    assert (~together).any()


@settings(max_examples=20)
@given(seeds, dimensions)
def test_undisturbed_robust_is_as_fast_as_plain(seed: int, d: int) -> None:
    model, start, _ = case(seed, d)
    plain, robust = run(model, start, PLAIN), run(model, start, ROBUST)
    assert plain.outcome is Outcome.ARRIVED
    assert len(robust.time) - 1 <= 1.05 * (len(plain.time) - 1)
    assert (robust.p_hat == plain.p_hat).all()


@settings(max_examples=20)
@given(seeds, dimensions)
def test_paper_gate_opens_within_the_tolerance_and_closes_beyond_twice_of_it(seed: int, d: int) -> None:
    model, start, displacement = case(seed, d)
    rollout = run(model, start, PAPER, displacement)
    gap = np.linalg.norm(rollout.p_hat - rollout.x, axis=1)
    was_open = np.concatenate([[True], rollout.gate[:-1]])
    eps = PAPER.gate
    assert eps is not None
    assert (rollout.gate == np.where(was_open, gap <= 2 * eps, gap <= eps)).all()
    moved = (np.diff(rollout.x, axis=0) != 0).any(axis=1)
    assert (moved == rollout.gate[:-1]).all()
    # Undisturbed, the follower keeps up: the gate never closes.
    assert run(model, start, PAPER).gate.all()


@settings(max_examples=20)
@given(seeds, dimensions, st.sampled_from([ROBUST, PAPER]))
def test_the_energy_falls_while_x_waits(seed: int, d: int, controller: Controller) -> None:
    model, start, displacement = case(seed, d)
    rollout = run(model, start, controller, displacement)
    V = energy(rollout.x, rollout.p_hat, np.asarray(model.goal))
    falls = np.diff(V) < 0
    after = np.arange(len(V) - 1) >= rollout.displaced
    assert falls[~rollout.gate[:-1] & after].all()


def test_straight_line_by_hand() -> None:
    # Cayley: z+ = (1 - h r/2) / (1 + h r/2) z. Euler: z+ = (1 - h r) z.
    start = start_at(np.array([0.1, 0.0]))
    for integrator, factor in (("cayley", 0.99 / 1.01), ("euler", 0.98)):
        rollout = run(line_model(), start, PLAIN, integrator=integrator)
        steps = math.ceil(math.log(0.0005 / 0.1) / math.log(factor))
        assert rollout.x[:, 0] == pytest.approx(0.1 * factor ** np.arange(steps + 1), rel=1e-12)
        assert (rollout.x[:, 1] == 0).all()
        assert rollout.time == pytest.approx(0.01 * np.arange(steps + 1), rel=1e-12)
        assert rollout.lyapunov == pytest.approx(rollout.x[:, 0] ** 2, rel=1e-12)
        assert (rollout.p_hat == rollout.x).all()
        assert rollout.gate.all()
        assert rollout.outcome is Outcome.ARRIVED
        assert rollout.displaced == -1


def test_displacement_comes_at_half_of_the_arc_length_once() -> None:
    start = start_at(np.array([0.1, 0.0]))
    for controller in (PLAIN, ROBUST):
        undisturbed = run(line_model(), start, controller)
        rollout = run(line_model(), start, controller, (0.0, -0.02))
        half = 0.5 * (undisturbed.p_hat[0, 0] + undisturbed.p_hat[-1, 0])
        assert rollout.displaced == int(np.argmax(undisturbed.p_hat[:, 0] <= half))
        at = rollout.displaced
        assert (rollout.p_hat[:at] == undisturbed.p_hat[:at]).all()
        assert rollout.p_hat[at, 1] == -0.02
        assert rollout.p_hat[at, 0] == undisturbed.p_hat[at, 0]
        assert rollout.x[at, 1] == (-0.02 if controller is PLAIN else 0.0)
        assert rollout.outcome is Outcome.ARRIVED
    assert len(rollout.time) > len(undisturbed.time)


@pytest.mark.parametrize(
    ("when", "sample"),
    [({"at_time": 0.3}, 30), ({"at_time": 0.295}, 30), ({"at_time": 0.0}, 0), ({"at_fraction": 0.0}, 0)],
)
def test_displacement_at_a_given_time_or_fraction(when: dict[str, float], sample: int) -> None:
    start = start_at(np.array([0.1, 0.0]))
    condition = pushed((0.0, 0.01), **when)
    for rollout in roll_out(line_model(), [start], RolloutParameters(conditions=(condition,)), 0.2):
        assert rollout.displaced == sample
        assert rollout.p_hat[sample, 1] == 0.01


def test_displacement_at_the_end_and_after_it() -> None:
    start = start_at(np.array([0.1, 0.0]))
    conditions = (
        Condition(),
        pushed((0.0, 0.01), "end", at_fraction=1.0),
        pushed((0.0, 0.01), "after", at_time=1e300),
    )
    none, end, after = roll_out(
        line_model(), [start], RolloutParameters(controllers=(ROBUST,), conditions=conditions), 0.2
    )
    assert end.displaced == len(none.time) - 1
    assert end.outcome is Outcome.ARRIVED
    assert after.displaced == -1
    assert (after.x == none.x).all()


def test_cases_run_in_order_with_unique_names_and_progress() -> None:
    starts = [start_at(np.array([0.1, 0.0]), "4"), start_at(np.array([0.0, 0.1]), "5")]
    conditions = (Condition(), pushed((0.0, -0.02), "cond1"))
    parameters = RolloutParameters(controllers=(PLAIN, ROBUST, PAPER), conditions=conditions)
    seen: list[tuple[int, int]] = []
    rollouts = roll_out(line_model(), starts, parameters, 0.2, lambda done, total: seen.append((done, total)))
    assert [rollout.rollout for rollout in rollouts] == [
        f"{controller}/{condition}/{demo}"
        for controller in ("lpvds", "clpvds-robust", "clpvds-paper")
        for condition in ("none", "cond1")
        for demo in ("4", "5")
    ]
    assert seen == [(done, 12) for done in range(1, 13)]
    first, last = rollouts[0], rollouts[-1]
    assert (first.controller, first.mode, first.avoidance, first.split) == ("lpvds", "robust", "none", "test")
    assert (last.controller, last.mode, last.condition, last.dataset, last.demo) == (
        "clpvds",
        "paper",
        "cond1",
        "made",
        "5",
    )
    assert not last.x.flags.writeable
    assert not last.gate.flags.writeable


def test_two_datasets_keep_names_apart() -> None:
    here = start_at(np.array([0.1, 0.0]))
    there = dataclasses.replace(here, dataset="other")
    names = [rollout.rollout for rollout in roll_out(line_model(), [here, there], RolloutParameters(), 0.2)]
    assert names[:2] == ["lpvds/none/made/4", "lpvds/none/other/4"]
    assert len(set(names)) == 4


def test_the_same_cases_give_the_same_bytes() -> None:
    model, start, displacement = case(7, 3)
    parameters = RolloutParameters(
        controllers=(PLAIN, ROBUST, PAPER), conditions=(Condition(), pushed(displacement, "push"))
    )
    for one, two in zip(
        roll_out(model, [start], parameters, 0.5), roll_out(model, [start], parameters, 0.5), strict=True
    ):
        for name in ("time", "x", "p_hat", "gate", "lyapunov"):
            assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def test_a_roll_out_that_is_too_short_times_out() -> None:
    parameters = RolloutParameters(max_duration=0.1)
    for rollout in roll_out(line_model(), [start_at(np.array([0.1, 0.0]))], parameters, 0.2):
        assert rollout.outcome is Outcome.TIMEOUT
        assert len(rollout.time) == 41
        assert rollout.time[-1] == pytest.approx(0.4)


def test_a_clock_that_does_not_divide_the_duration_is_rounded_up() -> None:
    parameters = RolloutParameters(max_duration=0.1, dt=0.03)
    rollout = roll_out(line_model(), [start_at(np.array([0.1, 0.0]))], parameters, 0.2)[0]
    assert rollout.time[-1] == pytest.approx(0.42)


def test_explicit_euler_that_cannot_be_stable_diverges_and_stays_finite() -> None:
    parameters = RolloutParameters(integrator="euler", dt=2.0, max_duration=1000.0)
    plain, coupled = roll_out(line_model(), [start_at(np.array([0.1, 0.0]))], parameters, 1e9)
    for rollout in (plain, coupled):
        assert rollout.outcome is Outcome.DIVERGED
        assert np.isfinite(rollout.x).all()
        assert np.isfinite(rollout.p_hat).all()
        assert np.linalg.norm(rollout.x[-1]) < 1e4 * np.linalg.norm(rollout.x[0])


def test_a_start_at_the_goal_has_arrived() -> None:
    for rollout in roll_out(line_model(), [start_at(np.zeros(2))], RolloutParameters(), 0.2):
        assert rollout.outcome is Outcome.ARRIVED
        assert len(rollout.time) == 1


def test_coupled_has_not_arrived_before_x_has() -> None:
    # Pushed onto the goal, p_hat must come back to where x waits.
    start = start_at(np.array([0.1, 0.0]))
    condition = pushed((-0.1, 0.0), at_time=0.0)
    plain, robust = roll_out(line_model(), [start], RolloutParameters(conditions=(condition,)), 0.2)
    assert len(plain.time) == 1
    assert len(robust.time) > 100


@pytest.mark.parametrize(
    ("changes", "location", "says"),
    [
        ({"conditions": (pushed((0.0, 0.0, 0.1)),)}, "conditions.0.disturbances.0.offset", "3 coordinates"),
        ({"conditions": (pushed((0.0, math.nan)),)}, "conditions.0.disturbances.0.offset", "finite"),
        ({"conditions": (Condition(), Condition())}, "conditions.1.name", "earlier"),
        ({"conditions": (Condition(name="a/b"),)}, "conditions.0.name", "letters"),
        (
            {"conditions": (pushed((0.0, 0.1), at_fraction=0.5, at_time=1.0),)},
            "conditions.0.disturbances.0.at_time",
            "not both",
        ),
        (
            {"conditions": (pushed((0.0, 0.1), at_fraction=0.5, at_state=(0.0, 0.0)),)},
            "conditions.0.disturbances.0.at_state",
            "not both",
        ),
        (
            {"conditions": (pushed((0.0, 0.1), at_state=(0.0,)),)},
            "conditions.0.disturbances.0.at_state",
            "1 coordinate",
        ),
        (
            {"conditions": (pushed((0.0, 0.1), at_fraction=1.5),)},
            "conditions.0.disturbances.0.at_fraction",
            "at most 1",
        ),
        (
            {"conditions": (pushed((0.0, 0.1), at_fraction=math.nan),)},
            "conditions.0.disturbances.0.at_fraction",
            "finite",
        ),
        ({"conditions": (pushed((0.0, 0.1), at_time=-1.0),)}, "conditions.0.disturbances.0.at_time", "0 or more"),
        ({"avoidances": ()}, "avoidances", "at least one"),
        ({"integrator": "euler", "controllers": (PAPER,), "dt": 0.1}, "controllers.0.p_max", "overshoots"),
        ({"conditions": ()}, "conditions", "at least one"),
        ({"controllers": ()}, "controllers", "at least one"),
        ({"controllers": (ROBUST, ClpvdsController())}, "controllers.1", "mode robust"),
        ({"controllers": (PLAIN, PLAIN)}, "controllers.1", "second lpvds"),
        ({"controllers": (PLAIN, ClpvdsController(mode="paper", gate=0.0))}, "controllers.1.gate", "never reaches"),
        ({"controllers": (PLAIN, ClpvdsController(mode="paper", p_max=1.0))}, "controllers.1.gate", "outrun"),
        ({"dt": 0.0}, "dt", "positive"),
        ({"dt": 1e-9}, "dt", "steps"),
        ({"max_duration": math.inf}, "max_duration", "positive"),
        ({"max_duration": 1e300}, "dt", "steps"),
        ({"stop_distance": -1.0}, "stop_distance", "positive"),
    ],
)
def test_what_has_no_meaning_is_refused(changes: dict[str, object], location: str, says: str) -> None:
    parameters = dataclasses.replace(RolloutParameters(), **changes)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match=says) as error:
        roll_out(line_model(), [start_at(np.array([0.1, 0.0]))], parameters, 0.2)
    assert error.value.location == f"rollout.{location}"


def test_parameters_of_the_other_mode_are_not_looked_at() -> None:
    controller = ClpvdsController(mode="robust", gate=0.0, p_max=1e-3, k_c=1e9)
    (rollout,) = roll_out(
        line_model(), [start_at(np.array([0.1, 0.0]))], RolloutParameters(controllers=(controller,)), 0.2
    )
    assert rollout.outcome is Outcome.ARRIVED


def test_unusable_demonstrations_are_refused() -> None:
    start = start_at(np.array([0.1, 0.0]))
    with pytest.raises(DataError, match="2 coordinates"):
        roll_out(line_model(d=3), [start], RolloutParameters(), 0.2)
    with pytest.raises(DataError, match="two starts"):
        roll_out(line_model(), [start, start], RolloutParameters(), 0.2)
    with pytest.raises(DataError, match="nothing moves"):
        roll_out(line_model(), [start], RolloutParameters(), 0.0)
