"""A policy in a control loop: the same steps as a roll-out's, what it refuses, and how it gives way and comes back."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import bent, linear

import clpv
from pipeline.errors import ClpvError, DataError, ParameterError
from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.method import resolve_avoidance
from stages.policy.avoidance.parameters import (
    Avoidance,
    Box,
    CbfParameters,
    NoAvoidance,
    Obstacle,
    RoasParameters,
    RoasPlusParameters,
    Sphere,
)
from stages.policy.avoidance.scene import covered, merged, shapes_of, to_be_covered
from stages.policy.avoidance.scratch import IGNORE
from stages.policy.avoidance.shapes import Shapes, distance_at
from stages.policy.controller import STATUSES, Controller
from stages.policy.coupled import PLAIN, Coupling
from stages.policy.coupling import PaperCoupling, RobustCoupling
from stages.policy.field import field_of
from stages.policy.outcome import Outcome, Status
from stages.policy.policy import Rules
from stages.rollout.run import Path, run_case
from stages.world.disturbance import DRAG, ONCE, Pushes, no_pushes

DT = 0.01
START = (0.1, 0.0)
TOP_SPEED = 0.2
ROBUST = RobustCoupling(v_max=0.5).compiled
PAPER = PaperCoupling(p_max=3000.0, k_c=100.0, gate=0.002).compiled
BALL = Sphere(centre=(0.05, 0.002), radius=0.02)

State = Sequence[float] | np.ndarray
seeds = st.integers(0, 2**32 - 1)


def line_model(d: int = 2) -> LpvDs:
    """xdot = -2 x: straight to the goal at the origin."""
    return linear(np.zeros(d), rate=2.0)


def controller(
    model: LpvDs | None = None,
    start: State = START,
    *,
    dt: float = DT,
    coupling: Coupling = ROBUST,
    obstacles: Sequence[Obstacle] = (),
    avoidance: Avoidance | None = None,
) -> Controller:
    return Controller(
        line_model() if model is None else model,
        np.array(start),
        dt=dt,
        coupling=coupling,
        top_speed=TOP_SPEED,
        obstacles=obstacles,
        avoidance=avoidance,
    )


def roll_out(
    model: LpvDs,
    start: State,
    coupling: Coupling,
    obstacles: Sequence[Obstacle],
    avoidance: Avoidance,
    pushes: Pushes | None = None,
) -> Path:
    """The roll-out of the same policy in the kinematic world."""
    d = len(start)
    real = seen = None
    method = IGNORE
    if obstacles:
        real = shapes_of(obstacles, d, "obstacles")
        seen = covered(real, to_be_covered(obstacles))
        if isinstance(avoidance, RoasPlusParameters) and avoidance.merge:
            seen = merged(seen, avoidance.margin)
        v_max = coupling.v_max if coupling.v_max > 0.0 else math.inf
        method = resolve_avoidance(avoidance, TOP_SPEED, DT, v_max, "avoidance")
    return run_case(
        Rules(field_of(model, "cayley"), coupling, method),
        seen,
        real,
        no_pushes(d) if pushes is None else pushes,
        np.array(start),
        dt=DT,
        steps=600,
        stop_distance=0.0005,
    )


def same(robot: Controller, path: Path, push: Callable[[int, np.ndarray], None] = lambda i, state: None) -> None:
    """Step a controller as a robot that goes where it is told; all must be as in the roll-out, bit for bit.

    `push`: disturbs the robot's state before sample i is measured.
    """
    executed = np.array(path.p_hat[0])
    start = None if robot.seen is None else robot.seen.centres.copy()
    velocities = None if robot.seen is None else robot.seen.velocities.copy()
    for i in range(len(path.x)):
        push(i, executed)
        assert executed.tobytes() == path.p_hat[i].tobytes()
        assert robot.x.tobytes() == path.x[i].tobytes()
        if i == len(path.x) - 1:
            break  # the roll-out ended with this sample: no step follows it
        if start is not None and velocities is not None and velocities.any():
            robot.see(start + i * DT * velocities, velocities)
        executed = robot.step(executed)
        assert robot.moving == path.gate[i]
        assert robot.status is STATUSES[path.status[i]]


def clear_of(shapes: Shapes, state: np.ndarray) -> float:
    """Distance from the nearest obstacle, metres."""
    normal = np.empty(len(state))
    return min(distance_at(shapes, i, state, normal) for i in range(shapes.number))


def clear_between(ball: Sphere, a: np.ndarray, b: np.ndarray) -> float:
    """Distance of a straight step from a sphere that stands, metres."""
    centre, length = np.array(ball.centre), float((b - a) @ (b - a))
    share = min(max(float((centre - a) @ (b - a)) / length, 0.0), 1.0) if length > 0.0 else 0.0
    return float(np.linalg.norm(a + share * (b - a) - centre)) - ball.radius


# The same steps as a roll-out's.


@settings(max_examples=30)
@given(seeds, st.integers(2, 3), st.sampled_from([ROBUST, PAPER, PLAIN]))
def test_without_obstacles_it_makes_the_steps_of_a_roll_out(seed: int, d: int, coupling: Coupling) -> None:
    generator = np.random.default_rng(seed)
    model = bent(generator, d)
    start = generator.normal(size=d)
    start = model.goal + 0.1 * start / np.linalg.norm(start)
    path = roll_out(model, start, coupling, (), RoasPlusParameters())
    assert len(path.x) > 50
    same(controller(model, start, coupling=coupling), path)


METHODS: tuple[Avoidance, ...] = (RoasPlusParameters(), CbfParameters(margin=0.003), RoasParameters(), NoAvoidance())


@settings(max_examples=40)
@given(seeds, st.integers(2, 3), st.sampled_from(METHODS), st.sampled_from([ROBUST, PAPER, PLAIN]), st.booleans())
def test_among_obstacles_it_makes_the_steps_of_a_roll_out(
    seed: int, d: int, method: Avoidance, coupling: Coupling, moving: bool
) -> None:
    generator = np.random.default_rng(seed)
    model = bent(generator, d)
    goal = np.asarray(model.goal)
    start = generator.normal(size=d)
    start = goal + 0.15 * start / np.linalg.norm(start)
    velocity = tuple(0.02 * generator.normal(size=d)) if moving else None
    obstacles = (
        Sphere(centre=tuple(0.5 * (start + goal)), radius=0.03, velocity=velocity),
        Box(centre=tuple(goal + 0.3), half_extents=(0.02, 0.03, 0.04)[:d], cover=True),
    )
    path = roll_out(model, start, coupling, obstacles, method)
    same(controller(model, start, coupling=coupling, obstacles=obstacles, avoidance=method), path)


def test_overlapping_spheres_are_seen_as_one_as_in_a_roll_out() -> None:
    obstacles = (BALL, Sphere(centre=(0.05, 0.012), radius=0.02))
    robot = controller(obstacles=obstacles)
    assert robot.seen is not None
    assert robot.seen.number == 1
    assert robot.seen.centres[0] == pytest.approx([0.05, 0.007], abs=1e-8)
    assert robot.seen.radii == pytest.approx([0.025], abs=1e-8)
    same(robot, roll_out(line_model(), START, ROBUST, obstacles, RoasPlusParameters()))
    apart = controller(obstacles=obstacles, avoidance=RoasPlusParameters(merge=False))
    assert apart.seen is not None
    assert apart.seen.centres.tolist() == [[0.05, 0.002], [0.05, 0.012]]


@pytest.mark.parametrize("coupling", [ROBUST, PAPER])
@pytest.mark.parametrize("obstacles", [(), (BALL,)])
def test_disturbed_it_makes_the_steps_of_a_roll_out(coupling: Coupling, obstacles: tuple[Obstacle, ...]) -> None:
    # Displaced at sample 10, dragged aside and held from 60 to 79.
    pushes = no_pushes(2, 2)
    pushes.kinds[:], pushes.samples[:], pushes.holds[:] = [ONCE, DRAG], [10, 60], [0, 20]
    pushes.offsets[:] = [[0.0, 0.03], [-0.01, -0.04]]
    path = roll_out(line_model(), START, coupling, obstacles, RoasPlusParameters(), pushes)
    anchor = np.empty(2)

    def push(i: int, state: np.ndarray) -> None:
        if i == 10:
            state += pushes.offsets[0]
        if i == 60:
            anchor[:] = state
        if 60 <= i < 80:
            state[:] = anchor + pushes.offsets[1]

    assert path.outcome is Outcome.ARRIVED
    assert not path.gate[60:80].any()
    same(controller(coupling=coupling, obstacles=obstacles), path, push)


# x is told to wait.


def test_told_to_wait_it_comes_back_as_fast_as_asked_by_hand() -> None:
    robot = controller()
    assert robot.coupled
    x = robot.step(np.array(START))
    # 12 mm aside: 5 mm a step by itself, 4 mm when that is asked.
    state = x + 0.012 * np.eye(2)[1]
    for left in (0.008, 0.004, 0.0, 0.0):
        state = robot.step(state, return_speed=0.4)
        assert state == pytest.approx([x[0], left], abs=1e-15)
        assert (robot.x == x).all()
        assert not robot.moving
    assert (state == x).all()
    # Where it is not asked any more x goes on in the very next step.
    state = robot.step(state)
    assert robot.moving
    assert state == pytest.approx(x * 0.99 / 1.01, rel=1e-14)


@given(seeds, st.integers(2, 4), st.floats(0.0, 2.0), st.floats(0.0, 0.05))
def test_told_to_wait_x_stays_and_what_is_commanded_comes_straight_to_it(
    seed: int, d: int, speed: float, far: float
) -> None:
    generator = np.random.default_rng(seed)
    model = bent(generator, d)
    robot = controller(model, model.goal + 0.1 * generator.normal(size=d))
    x = robot.step(robot.x)
    away = generator.normal(size=d)
    measured = x + far * away / np.linalg.norm(away)
    gap = float(np.linalg.norm(measured - x))
    command = robot.step(measured, return_speed=speed)
    assert (robot.x == x).all()
    assert not robot.moving
    assert robot.status is Status.FREE
    if gap <= speed * DT * (1.0 - 1e-12):
        assert (command == x).all()
    elif gap > speed * DT * (1.0 + 1e-12):
        assert command == pytest.approx(measured + speed * DT / gap * (x - measured), abs=1e-15)
        assert np.linalg.norm(command - measured) <= speed * DT * (1.0 + 1e-9) + 1e-15
    if speed == 0.0:
        assert (command == measured).all()


@given(seeds, st.floats(0.01, 0.5), st.floats(0.001, 0.1))
def test_told_to_wait_for_long_enough_it_is_back_exactly(seed: int, speed: float, far: float) -> None:
    robot = controller()
    away = np.random.default_rng(seed).normal(size=2)
    state = START + far * away / np.linalg.norm(away)
    for _ in range(math.ceil(far / (speed * DT)) + 1):
        state = robot.step(state, return_speed=speed)
    assert (state == START).all()
    assert (robot.x == START).all()


@settings(max_examples=30)
@given(seeds, st.sampled_from([(), (BALL,)]))
def test_to_wait_on_the_way_changes_when_and_not_where(seed: int, obstacles: tuple[Obstacle, ...]) -> None:
    # The same states of x, bit for bit, whenever it was held up, and wherever the arms were pushed meanwhile.
    generator = np.random.default_rng(seed)
    free, held = controller(obstacles=obstacles), controller(obstacles=obstacles)
    state = other = np.array(START)
    for _ in range(150):
        state = free.step(state)
        if generator.random() < 0.05:
            at = other
            outwards = at - BALL.centre if obstacles else generator.normal(size=2)
            other = at + generator.uniform(0.0, 0.02) * outwards / np.linalg.norm(outwards)
            for _ in range(60):  # near the ball it slows down
                other = held.step(other, return_speed=0.2)
                assert (held.x == at).all()
            assert (other == at).all()
        other = held.step(other)
        assert other.tobytes() == state.tobytes()
        assert held.x.tobytes() == free.x.tobytes()
        assert held.moving == free.moving
        assert held.status is free.status


@settings(max_examples=30)
@given(seeds, st.floats(0.0, 1.0))
def test_what_is_not_coupled_cannot_be_told_to_wait(seed: int, speed: float) -> None:
    generator = np.random.default_rng(seed)
    model = bent(generator, 3)
    told, other = (controller(model, model.goal + 0.1 * np.eye(3)[0], coupling=PLAIN) for _ in range(2))
    assert not told.coupled
    state = np.asarray(told.x)
    for _ in range(20):
        state = state + 0.01 * generator.normal(size=3)
        command = told.step(state, return_speed=speed)
        assert command.tobytes() == other.step(state).tobytes()
        assert told.x.tobytes() == other.x.tobytes()
        assert told.moving
        state = command


@settings(max_examples=30)
@given(seeds, st.sampled_from([ROBUST, PAPER, PLAIN]), st.sampled_from([(), (BALL,)]))
def test_not_told_to_wait_nothing_is_changed(seed: int, coupling: Coupling, obstacles: tuple[Obstacle, ...]) -> None:
    generator = np.random.default_rng(seed)
    told, other = (controller(coupling=coupling, obstacles=obstacles) for _ in range(2))
    state = np.array(START)
    for _ in range(60):
        if generator.random() < 0.1:
            state = state + 0.005 * generator.normal(size=2)
        command = told.step(state, return_speed=None)
        assert command.tobytes() == other.step(state).tobytes()
        assert told.x.tobytes() == other.x.tobytes()
        assert told.moving == other.moving
        assert told.status is other.status
        state = command


def test_told_to_wait_it_comes_back_round_an_obstacle() -> None:
    # Dragged to the far side of the ball: the straight way back leads through it.
    robot = controller(obstacles=(BALL,))
    state = np.array([0.025, 0.001])
    for _ in range(600):
        before, state = state, robot.step(state, return_speed=0.1)
        assert clear_between(BALL, before, state) >= -1e-9
        assert (robot.x == START).all()
    assert (state == START).all()


# What it says.


def test_what_it_says_between_steps() -> None:
    robot = controller()
    assert (robot.x == START).all()
    assert (robot.moving, robot.status, robot.seen) == (True, Status.FREE, None)
    command = robot.step(np.array(START))
    # 0.99/1.01 of the way that is left.
    assert command == pytest.approx([0.1 * 0.99 / 1.01, 0.0], rel=1e-14)
    assert (robot.x == command).all()
    # Away from x it comes back by .5 m/s, and x waits.
    pushed = command + 0.012 * np.eye(2)[1]
    back = robot.step(pushed)
    assert back == pytest.approx([command[0], 0.007], rel=1e-12)
    assert not robot.moving
    assert (robot.x == command).all()
    for expected in (0.002, 0.0):
        back = robot.step(back)
        assert not robot.moving
        assert back[1] == pytest.approx(expected, abs=1e-15)
    assert (back == command).all()
    robot.step(back)
    assert robot.moving
    assert robot.x[0] < command[0]


def test_its_status_follows_the_obstacles() -> None:
    robot, state, seen = controller(obstacles=(BALL,)), np.array(START), []
    for _ in range(400):
        state = robot.step(state)
        seen.append(robot.status)
    assert seen[0] is Status.FREE
    assert set(seen) == {Status.FREE, Status.ACTIVE}
    assert seen[-1] is Status.FREE
    assert state == pytest.approx([0.0, 0.0], abs=5e-4)


def test_what_it_gives_cannot_change_it_and_what_it_is_given_is_not_changed() -> None:
    one, other = controller(obstacles=(BALL,)), controller(obstacles=(BALL,))
    start = np.array(START)
    mine = Controller(line_model(), start, dt=DT, coupling=ROBUST, top_speed=TOP_SPEED)
    start[:] = 7.0
    assert (mine.x == START).all()
    assert not one.x.flags.writeable
    measured = np.array(START)
    measured.flags.writeable = False
    first = one.step(measured)
    kept = first.copy()
    one.step(first)
    assert (first == kept).all()
    # Two policies among the same obstacles see their own.
    one.see(np.array([[0.5, 0.5]]))
    assert other.seen is not None
    assert other.seen.centres.tolist() == [[0.05, 0.002]]
    centres = np.array([[0.3, 0.3]])
    other.see(centres)
    centres[:] = 0.0
    assert other.seen.centres.tolist() == [[0.3, 0.3]]


# What it refuses.


@pytest.mark.parametrize(
    "measured", [[math.nan, 0.0], [0.0, math.inf], [0.1], [0.1, 0.0, 0.0], [[0.1, 0.0]], 0.1, None], ids=str
)
def test_a_measured_state_that_is_none_is_refused_and_changes_nothing(measured: Any) -> None:
    robot, other = controller(obstacles=(BALL,)), controller(obstacles=(BALL,))
    state = robot.step(other.step(np.array(START)) * 0.0 + START)
    with pytest.raises(DataError, match="2 finite numbers, metres") as error:
        robot.step(measured)
    assert error.value.source == "controller"
    # The robot holds, is measured anew, and the motion goes on as if nothing had been asked.
    twin = state.copy()
    for _ in range(50):
        state, twin = robot.step(state), other.step(twin)
        assert state.tobytes() == twin.tobytes()


@pytest.mark.parametrize("start", [(math.nan, 0.0), (0.1,), (0.1, 0.0, 0.0), (math.inf, 0.0)], ids=str)
def test_a_start_that_is_no_state_is_refused(start: tuple[float, ...]) -> None:
    with pytest.raises(DataError, match="controller: a state must be 2 finite numbers, metres"):
        controller(start=start)


@pytest.mark.parametrize("dt", [0.0, -0.01, math.nan, math.inf])
def test_a_period_that_is_none_is_refused(dt: float) -> None:
    with pytest.raises(ParameterError, match="positive number of seconds") as error:
        controller(dt=dt)
    assert error.value.location == "dt"


def test_a_period_that_is_too_long_for_the_rate_is_refused() -> None:
    with pytest.raises(ParameterError, match="at most 1/dt = 20 is safe") as error:
        controller(dt=0.05, obstacles=(BALL,), avoidance=RoasPlusParameters(rate=25.0))
    assert error.value.location == "avoidance.rate"


def test_goal_and_start_inside_of_an_obstacle_are_refused() -> None:
    for obstacle, method, outcome in (
        (Sphere(centre=(0.01, 0.0), radius=0.02), None, Outcome.GOAL_INSIDE),
        (Sphere(centre=(0.025, 0.0), radius=0.02), RoasPlusParameters(margin=0.01), Outcome.GOAL_INSIDE),
        (Sphere(centre=(0.11, 0.0), radius=0.02), None, Outcome.START_INSIDE),
        (Box(centre=(0.13, 0.0), half_extents=(0.02, 0.03), cover=True), None, Outcome.SWALLOWED),
    ):
        with pytest.raises(DataError) as error:
            controller(obstacles=(obstacle,), avoidance=method)
        assert error.value.source == "obstacles"
        assert error.value.problem == outcome.remedy
    # With recover = true it leaves.
    robot = controller(obstacles=(Sphere(centre=(0.11, 0.0), radius=0.02),), avoidance=RoasPlusParameters(recover=True))
    state = np.array(START)
    for _ in range(400):
        state = robot.step(state)
    assert state == pytest.approx([0.0, 0.0], abs=5e-4)


def test_an_obstacle_of_another_dimension_is_refused() -> None:
    with pytest.raises(ParameterError, match="3 coordinates, the motion has 2") as error:
        controller(obstacles=(BALL, Sphere(centre=(0.1, 0.2, 0.3), radius=0.01)))
    assert error.value.location == "obstacles.1.centre"


@pytest.mark.parametrize(
    ("centres", "velocities", "says"),
    [
        ([[0.1, 0.2], [0.3, 0.4]], None, r"centres must be finite numbers of shape \(1, 2\), not \(2, 2\)"),
        ([0.1, 0.2], None, r"centres .* not \(2,\)"),
        ([[0.1, 0.2, 0.3]], None, r"centres .* not \(1, 3\)"),
        ([[0.1, math.nan]], None, "centres must be finite"),
        (np.empty((0, 2)), None, r"centres .* not \(0, 2\)"),
        ([[0.1, 0.2]], [0.0, 0.0], r"velocities must be finite numbers of shape \(1, 2\), not \(2,\)"),
        ([[0.1, 0.2]], [[0.0, math.inf]], "velocities must be finite"),
    ],
)
def test_what_cannot_be_seen_is_refused(centres: Any, velocities: Any, says: str) -> None:
    robot = controller(obstacles=(BALL,))
    with pytest.raises(DataError, match=says) as error:
        robot.see(centres, velocities)
    assert error.value.source == "controller"


def test_what_is_refused_is_not_seen_by_half() -> None:
    robot = controller(obstacles=(BALL,))
    with pytest.raises(DataError):
        robot.see(np.array([[0.3, 0.4]]), np.array([[math.nan, 0.0]]))
    assert robot.seen is not None
    assert robot.seen.centres.tolist() == [[0.05, 0.002]]


def test_a_policy_without_obstacles_sees_none() -> None:
    with pytest.raises(DataError, match="made without obstacles: make one that has them"):
        controller().see(np.array([[0.1, 0.2]]))


# Obstacles that are seen to move.


def test_what_it_sees_is_where_the_obstacles_are_from_then_on() -> None:
    robot = controller(obstacles=(BALL, Sphere(centre=(0.3, 0.3), radius=0.05)))
    assert robot.seen is not None
    robot.see(np.array([[0.06, 0.0], [0.2, 0.2]]), np.array([[0.1, 0.2], [0.3, 0.4]]))
    assert robot.seen.centres.tolist() == [[0.06, 0.0], [0.2, 0.2]]
    assert robot.seen.velocities.tolist() == [[0.1, 0.2], [0.3, 0.4]]
    # Without velocities they stand.
    robot.see(np.array([[0.07, 0.0], [0.2, 0.2]]))
    assert robot.seen.velocities.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert robot.seen.radii.tolist() == [0.02, 0.05]


def test_an_obstacle_that_is_taken_away_frees_the_way() -> None:
    # Seen head-on it is gone round, seen elsewhere it is not: the straight way from there on, to the bit.
    robot, straight = controller(obstacles=(BALL,)), controller()
    robot.see(np.array([[1.0, 1.0]]))
    state = other = np.array(START)
    for _ in range(300):
        state, other = robot.step(state), straight.step(other)
        assert state.tobytes() == other.tobytes()
        assert robot.status is Status.FREE


@pytest.mark.parametrize("method", [RoasPlusParameters(), CbfParameters()], ids=["roas+", "cbf"])
def test_it_gives_way_to_an_obstacle_that_comes(method: Avoidance) -> None:
    # Far from the way at first; then it comes across it at .1 m/s, through where the state would be.
    ball = Sphere(centre=(0.02, 0.1), radius=0.02)
    robot, straight = controller(obstacles=(ball,), avoidance=method), controller()
    velocity = np.array([[0.0, -0.1]])
    state = other = np.array(START)
    centre, statuses, hit = np.array(ball.centre), [], False
    for _ in range(600):
        robot.see(centre[None], velocity)
        state, other = robot.step(state), straight.step(other)
        statuses.append(robot.status)
        centre = centre + DT * velocity[0]
        hit = hit or bool(np.linalg.norm(other - centre) < ball.radius)
        assert np.linalg.norm(state - centre) >= ball.radius - 1e-9
    assert hit  # who does not look is run over
    assert statuses[0] is Status.FREE
    assert {Status.ACTIVE, Status.YIELDING} & set(statuses)
    assert not {Status.INFEASIBLE, Status.TOO_FAST} & set(statuses)
    assert state == pytest.approx([0.0, 0.0], abs=5e-4)


def test_a_state_that_stands_at_the_goal_gives_way_and_comes_back() -> None:
    ball = Sphere(centre=(0.2, 0.001), radius=0.02)
    robot, state, farthest = controller(start=(0.0, 1e-9), obstacles=(ball,)), np.array([0.0, 1e-9]), 0.0
    for i in range(1500):
        centre = np.array([0.2 - 0.1 * DT * i, 0.001])
        robot.see(centre[None], np.array([[-0.1, 0.0]]))
        state = robot.step(state)
        farthest = max(farthest, float(np.linalg.norm(state)))
        assert np.linalg.norm(state - (centre - [0.1 * DT, 0.0])) >= ball.radius - 1e-9
    assert farthest > 0.015
    assert state == pytest.approx([0.0, 0.0], abs=5e-4)


# Pushed behind an obstacle, the executed state comes back round it.


def recover_from(
    robot: Controller, ball: Sphere, pushed_to: Callable[[np.ndarray], np.ndarray], margin: float = 0.0
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Push the executed state away after 20 steps; return its way back until x moves again, and its last state."""
    state = np.array(robot.x)
    for _ in range(20):
        state = robot.step(state)
    waits_at, state = robot.x, pushed_to(state)
    way = [state]
    for _ in range(3000):
        following = robot.step(state)
        assert clear_between(ball, state, following) >= margin - 1e-9
        assert np.linalg.norm(following - state) <= ROBUST.v_max * DT * (1.0 + 1e-9)
        state = following
        if robot.moving:
            break
        assert (robot.x == waits_at).all()
        way.append(state)
    assert robot.moving
    assert (way[-1] == waits_at).all()
    for _ in range(3000):
        following = robot.step(state)
        assert clear_between(ball, state, following) >= margin - 1e-9
        assert following == pytest.approx(robot.x, abs=1e-12)
        state = following
        if np.linalg.norm(state - robot.model.goal) <= 5e-4:
            break
    return state, way


def test_the_executed_state_returns_round_an_obstacle_that_is_between() -> None:
    robot = controller(obstacles=(BALL,))
    end, way = recover_from(robot, BALL, lambda state: np.array([0.015, -0.005]))
    assert end == pytest.approx([0.0, 0.0], abs=5e-4)
    # The straight way back is blocked.
    assert clear_between(BALL, way[0], way[-1]) < -0.005
    straight = math.ceil(np.linalg.norm(way[0] - way[-1]) / (ROBUST.v_max * DT))
    assert straight < len(way) < 3 * straight


@pytest.mark.parametrize("d", [2, 3])
def test_it_returns_from_exactly_opposite(d: int) -> None:
    ball = Sphere(centre=(0.05, 0.0, 0.0)[:d], radius=0.02)
    robot = controller(line_model(d), (0.1, 0.03, 0.0)[:d], obstacles=(ball,))
    end, way = recover_from(robot, ball, lambda state: 2.0 * np.array(ball.centre) - state)
    assert end == pytest.approx(np.zeros(d), abs=5e-4)
    assert clear_between(ball, way[0], way[-1]) == pytest.approx(-0.02, abs=1e-9)


def test_a_margin_is_kept_on_the_way_back() -> None:
    robot = controller(obstacles=(BALL,), avoidance=RoasPlusParameters(margin=0.004))
    end, _ = recover_from(robot, BALL, lambda state: np.array([0.015, -0.005]), margin=0.004)
    assert end == pytest.approx([0.0, 0.0], abs=5e-4)


def bent_scene(seed: int, d: int) -> tuple[LpvDs, np.ndarray, Sphere, np.random.Generator]:
    """A system, a start at 15 cm from its goal, a sphere half way."""
    generator = np.random.default_rng(seed)
    model = bent(generator, d)
    goal, towards = np.asarray(model.goal), generator.normal(size=d)
    start = goal + 0.15 * towards / np.linalg.norm(towards)
    ball = Sphere(centre=tuple(0.5 * (start + goal)), radius=float(generator.uniform(0.01, 0.05)))
    return model, start, ball, generator


@settings(max_examples=40)
@given(seeds, st.integers(2, 3))
def test_wherever_it_is_pushed_it_returns_clear_of_the_sphere_and_arrives(seed: int, d: int) -> None:
    model, start, ball, generator = bent_scene(seed, d)
    aside = generator.normal(size=d)
    place = np.array(ball.centre) + generator.uniform(1.01, 3.0) * ball.radius * aside / np.linalg.norm(aside)
    robot = controller(model, start, obstacles=(ball,))
    end, _ = recover_from(robot, ball, lambda state: place)
    assert end == pytest.approx(np.asarray(model.goal), abs=5e-4)


@pytest.mark.parametrize("seed", [710, 742, 1172])
def test_undisturbed_among_obstacles_x_never_waits(seed: int) -> None:
    model, start, ball, _ = bent_scene(seed, 2)
    robot, state = controller(model, start, obstacles=(ball,)), start
    for _ in range(300):
        state = robot.step(state)
        assert robot.moving


def test_a_barrier_keeps_the_executed_state_clear_and_may_stand() -> None:
    # What a control barrier function cannot do: round the sphere from exactly opposite.
    ball = Sphere(centre=(0.05, 0.0), radius=0.02)
    robot = controller(obstacles=(ball,), avoidance=CbfParameters())
    state = np.array(robot.x)
    for _ in range(10):
        state = robot.step(state)
    waits_at, state = robot.x, np.array([0.01, 0.0])
    for _ in range(1000):
        following = robot.step(state)
        assert clear_between(ball, state, following) >= -1e-9
        state = following
    assert not robot.moving
    assert (robot.x == waits_at).all()
    assert state == pytest.approx([0.03, 0.0], abs=1e-6)


def test_the_print_does_not_look_after_the_executed_state() -> None:
    # It leads x only: the follower comes straight back, through the obstacle.
    robot = controller(obstacles=(BALL,), avoidance=RoasParameters())
    state = np.array(START)
    for _ in range(20):
        state = robot.step(state)
    state, deepest = 2.0 * np.array(BALL.centre) - robot.x, math.inf
    while not (robot.x == state).all():
        following = robot.step(state)
        deepest = min(deepest, clear_between(BALL, state, following))
        state = following
    assert deepest == pytest.approx(-BALL.radius, abs=1e-9)


# The public face.

TABLE = {"kind": "sphere", "centre": [0.05, 0.002], "radius": 0.02}


def test_the_public_face_makes_the_same_policy() -> None:
    robot = clpv.controller(line_model(), START, dt=DT, top_speed=TOP_SPEED, coupling={"v_max": 0.5}, obstacles=[TABLE])
    same(robot, roll_out(line_model(), START, ROBUST, (BALL,), RoasPlusParameters()))
    chosen = clpv.controller(
        line_model(),
        START,
        dt=DT,
        top_speed=TOP_SPEED,
        coupling={"mode": "paper", "p_max": 3000.0},
        avoidance={"kind": "cbf", "margin": 0.003},
        obstacles=[TABLE],
    )
    same(chosen, roll_out(line_model(), START, PAPER, (BALL,), CbfParameters(margin=0.003)))
    plain = clpv.controller(line_model(), START, dt=DT, coupling={"kind": "lpvds"})
    same(plain, roll_out(line_model(), START, PLAIN, (), RoasPlusParameters()))


def test_the_public_face_learns_the_top_speed_from_the_policys_own_way() -> None:
    # The first step is the longest: .1 (1 - .99/1.01) m; the follower is five times as fast.
    step = 0.1 * (1.0 - 0.99 / 1.01)
    robot = clpv.controller(line_model(), START, dt=DT)
    back = robot.step(np.array([0.1, 0.05]))
    assert back == pytest.approx([0.1, 0.05 - 5.0 * step], rel=1e-12)
    # Given, it is not looked for.
    robot = clpv.controller(line_model(), START, dt=DT, top_speed=0.1)
    assert robot.step(np.array([0.1, 0.05])) == pytest.approx([0.1, 0.045], rel=1e-12)


def test_the_example_of_the_public_face_runs() -> None:
    ball = {"kind": "sphere", "centre": [0.05, 0.1], "radius": 0.02}
    robot = clpv.controller(line_model(), [0.1, 0.2], dt=0.004, obstacles=[ball])
    state = np.array([0.1, 0.2])
    for _ in range(2000):
        state = robot.step(state)
        assert np.linalg.norm(state - ball["centre"]) >= 0.02  # type: ignore[operator]
    assert state == pytest.approx([0.0, 0.0], abs=5e-4)


@pytest.mark.parametrize(
    ("given_", "location", "says"),
    [
        ({"dt": 0.0}, "dt", "positive number of seconds"),
        ({"dt": math.nan}, "dt", "positive number of seconds"),
        ({"start": ["a", 0.0]}, "start", "numbers in the shape"),
        ({"obstacles": [{**TABLE, "radius": -0.02}]}, "obstacles.0.radius", "greater than 0"),
        ({"obstacles": [TABLE, {**TABLE, "kind": "spehre"}]}, "obstacles.1.kind", "did you mean 'sphere'"),
        ({"obstacles": [{**TABLE, "raduis": 0.02}]}, "obstacles.0.raduis", "did you mean 'radius'"),
        ({"obstacles": [{**TABLE, "centre": [0.1, 0.2, 0.3]}]}, "obstacles.0.centre", "3 coordinates"),
        ({"avoidance": {"kind": "raos+"}}, "avoidance.kind", "did you mean 'roas+'"),
        ({"avoidance": {"kind": "cbf", "rate": 200.0}}, "avoidance.rate", "at most 1/dt = 100"),
        ({"coupling": {"kind": "clpdvs"}}, "coupling.kind", "did you mean 'clpvds'"),
        ({"coupling": {"v_max": -1.0}}, "coupling.v_max", "greater than 0"),
        ({"coupling": {"gaet": 0.1}}, "coupling.gaet", "did you mean 'gate'"),
        ({"obstacles": TABLE}, "obstacles", "a list of tables"),
    ],
)
def test_the_public_face_refuses_by_name(given_: dict[str, Any], location: str, says: str) -> None:
    arguments: dict[str, Any] = {"start": START, "dt": DT, **given_}
    with pytest.raises(ParameterError) as error:
        clpv.controller(line_model(), arguments.pop("start"), **arguments)
    assert error.value.location == location
    assert says in error.value.problem


def test_the_public_face_refuses_motions_that_cannot_begin() -> None:
    with pytest.raises(DataError, match="controller: a state must be 2 finite numbers"):
        clpv.controller(line_model(), [0.1, 0.0, 0.0], dt=DT)
    with pytest.raises(DataError, match="obstacles: The goal lies inside"):
        clpv.controller(line_model(), START, dt=DT, obstacles=[{**TABLE, "centre": [0.0, 0.01]}])


@pytest.mark.parametrize(
    ("start", "dt", "says"),
    [([0.1, math.nan], DT, "finite numbers, metres"), (list(START), math.inf, "positive number of seconds")],
)
def test_the_public_face_names_a_start_or_a_period_that_is_not_finite(start: list[float], dt: float, says: str) -> None:
    with pytest.raises(ClpvError, match=says):
        clpv.controller(line_model(), start, dt=dt)


def test_a_motion_that_begins_at_its_goal_needs_a_top_speed() -> None:
    with pytest.raises(ParameterError, match="does not move from this start") as error:
        clpv.controller(line_model(), [0.0, 0.0], dt=DT)
    assert error.value.location == "top_speed"
    assert (clpv.controller(line_model(), [0.0, 0.0], dt=DT, top_speed=0.1).step(np.zeros(2)) == 0.0).all()


@pytest.mark.parametrize(
    ("given_", "location"),
    [({"coupling": {"mode": "paper", "gate": 0.0}}, "coupling.gate"), ({"top_speed": math.nan}, "top_speed")],
)
def test_the_public_face_names_its_own_arguments(given_: dict[str, Any], location: str) -> None:
    with pytest.raises(ParameterError) as error:
        clpv.controller(line_model(), START, dt=DT, **given_)
    assert error.value.location == location


@pytest.mark.parametrize("given_", [["a", 0.0], [[0.0], [0.0, 1.0]]], ids=str)
def test_what_are_no_numbers_is_refused_as_data(given_: Any) -> None:
    with pytest.raises(DataError):
        controller(obstacles=(BALL,)).step(given_)
    with pytest.raises(DataError):
        controller(obstacles=(BALL,)).see(given_)
