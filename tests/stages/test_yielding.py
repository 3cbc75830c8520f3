"""Moving obstacles: giving way by hand, the way out that is kept, and that no collision comes without a flag."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import CODES, FLAGGED, RISING, linear, linear_task, rise, run, scene, task

from stages.policy.avoidance.method import resolve_avoidance
from stages.policy.avoidance.parameters import CbfParameters, RoasPlusParameters
from stages.policy.avoidance.roas_plus import steer_about
from stages.policy.avoidance.scratch import ACTIVE, FREE, INFEASIBLE, TOO_FAST, YIELDING, scratch
from stages.policy.avoidance.shapes import Shapes, spheres
from stages.policy.avoidance.yielding import moves
from stages.policy.outcome import Outcome, Status
from stages.rollout.parameters import RandomScenes

TOUCH = 1e-9
DT = 0.1

seeds = st.integers(0, 2**32 - 1)


def stepped(shapes: Shapes, x: np.ndarray, x_next: np.ndarray, **parameters: float) -> tuple[int, np.ndarray]:
    """One step to the goal at the origin; its status and its velocity, m/s."""
    avoidance = resolve_avoidance(RoasPlusParameters(**parameters), 1.0, DT, math.inf, "")
    room, out = scratch(shapes.number, x.shape[0]), x_next.copy()
    status = steer_about(avoidance, shapes, np.zeros(x.shape[0]), x.copy(), out, DT, room)
    return status, (out - x) / DT


def test_what_moves() -> None:
    centres, radii = np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([0.1, 0.1])
    assert not moves(spheres(centres, radii))
    assert moves(spheres(centres, radii, np.array([[0.0, 0.0], [0.0, 1e-9]])))


def test_giving_way_to_one_sphere_by_hand() -> None:
    # The sphere is 0.05 away between x and the goal, and comes on at 1 m/s: with 1/s the row is v_x >= 1 - 0.05. V
    # rises, as it must: away from the goal at 0.95 m/s, which the learned system's own 0.2 m/s across do not change.
    shapes = spheres(np.array([[0.65, 0.0]]), np.array([0.3]), np.array([[1.0, 0.0]]))
    status, velocity = stepped(shapes, np.array([1.0, 0.0]), np.array([1.0, 0.02]), rate=1.0)
    assert status == YIELDING
    assert velocity[0] == pytest.approx(0.95, rel=1e-9)


def test_a_sphere_that_recedes_leaves_the_step_as_it_is() -> None:
    shapes = spheres(np.array([[0.65, 0.0]]), np.array([0.3]), np.array([[-1.0, 0.0]]))
    free = np.array([0.95, 0.0])
    status, velocity = stepped(shapes, np.array([1.0, 0.0]), free, rate=1.0)
    assert status == FREE
    assert velocity == pytest.approx((free - [1.0, 0.0]) / DT, rel=1e-14)


def test_what_no_velocity_within_the_speed_limit_escapes_is_too_fast() -> None:
    # 0.05 away and coming at 2 m/s, the row asks for 1.95 m/s; at most 1.5 m/s are to be had, and are taken.
    shapes = spheres(np.array([[0.65, 0.0]]), np.array([0.3]), np.array([[2.0, 0.0]]))
    status, velocity = stepped(shapes, np.array([1.0, 0.0]), np.array([0.99, 0.0]), rate=1.0, speed_limit=1.5)
    assert status == TOO_FAST
    assert velocity == pytest.approx([1.5, 0.0], abs=1e-6)


def test_a_pinch_that_no_velocity_escapes_is_infeasible_and_missed_least() -> None:
    # Three spheres around x, 0.1 away at 120 degrees from each other, all coming at 1 m/s: by symmetry standing still
    # misses all rows by the same, which is the least.
    angles = np.array([0.0, 2.0, 4.0]) * math.pi / 3.0 + 0.3
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    x = np.array([1.0, 0.0])
    shapes = spheres(x + 1.1 * directions, np.full(3, 1.0), -directions)
    status, velocity = stepped(shapes, x, np.array([0.99, 0.0]), rate=1.0, speed_limit=5.0)
    assert status == INFEASIBLE
    assert velocity == pytest.approx([0.0, 0.0], abs=1e-6)


def jaws(d: int) -> Shapes:
    """Two spheres that close on the way from (1, 0) to the origin as the state is between them."""
    centres, velocities = np.zeros((2, d)), np.zeros((2, d))
    centres[:, 0] = 0.5
    centres[:, 1] = 0.75, -0.75
    velocities[:, 1] = -0.5, 0.5
    return spheres(centres, np.array([0.3, 0.3]), velocities)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("dt", [0.002, 0.01, 0.05])
def test_jaws_that_close_are_not_entered(d: int, dt: float) -> None:
    start = np.zeros(d)
    start[0] = 1.0
    path = run(task(linear(np.zeros(d)), start), jaws(d), dt=dt)
    assert path.outcome == Outcome.ARRIVED
    assert path.clearance.min() >= -TOUCH
    assert not np.isin(path.status, FLAGGED).any()


@settings(max_examples=60)
@given(seeds, st.integers(2, 3), st.sampled_from([0.005, 0.02, 0.1]), st.floats(0.1, 1.0))
def test_no_moving_sphere_is_hit_without_a_flag(seed: int, d: int, dt: float, speed: float) -> None:
    generator = np.random.default_rng(seed)
    one = linear_task(generator, d)
    path = run(one, scene(one, RandomScenes(speed=speed), generator), dt=dt)
    assert path.outcome != Outcome.COLLIDED
    if path.clearance.min() < -TOUCH:
        assert np.isin(path.status, FLAGGED).any()
        assert path.outcome in (Outcome.INFEASIBLE, Outcome.TOO_FAST)
    assert rise(one.model, path) <= 1e-12  # V rises only where the step says that it may


def test_the_look_ahead_saves_what_a_barrier_function_alone_does_not() -> None:
    collided = {"roas+": 0, "cbf": 0}
    for case in range(150):
        generator = np.random.default_rng([5, case])
        one = linear_task(generator, 2)
        shapes = scene(one, RandomScenes(fewest=4, most=5, smallest=0.1, speed=1.0), generator)
        if shapes.number < 4:
            continue
        for name, method in (("roas+", RoasPlusParameters()), ("cbf", CbfParameters())):
            collided[name] += run(one, shapes, method).clearance.min() < -TOUCH
    assert collided["roas+"] == 0
    assert collided["cbf"] > 0


def test_a_sphere_that_no_robot_escapes_ends_too_fast_and_was_flagged() -> None:
    one = task(linear(np.zeros(2)), np.array([1.0, 0.0]))
    shapes = spheres(np.array([[6.0, 0.0]]), np.array([2.0]), np.array([[-8.0, 0.0]]))
    path = run(one, shapes, RoasPlusParameters(speed_limit=0.5))
    assert path.outcome == Outcome.TOO_FAST
    assert CODES[path.status[-2]] is Status.TOO_FAST
    assert "speed_limit" in path.outcome.remedy


def test_statuses_where_v_may_rise_come_after_those_where_it_may_not() -> None:
    assert max(FREE, ACTIVE) < min(RISING)
