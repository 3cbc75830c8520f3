"""What meets a box that is carried: drags of one arm and forces on it, when they come, and pots, as asked and as taken.

Arrays only: neither the simulator nor a policy runs.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from stages.policy.avoidance.parameters import Box, Sphere
from stages.policy.avoidance.scene import shapes_of
from stages.policy.avoidance.shapes import distance_at
from stages.rollout.arm_disturbances import SIDES, drawn, pushes_of
from stages.rollout.carry_scenes import THIN, draw_pots, obstacles_of
from stages.rollout.parameters import Drag, Flowerpot, Force, RandomDrag
from stages.trajectory import Array
from stages.world.arm_pushes import ArmPush, ArmPushes, smooth
from stages.world.pots import Pot, lathe

DT = 0.004
LEFT, RIGHT = 0, 1
NEVER = -1
AWAY = np.array([0.03, -0.04, 0.05])
DOWN = np.array([0.0, 0.0, -10.0])

seeds = st.integers(0, 2**32 - 1)
arms = st.sampled_from([LEFT, RIGHT])


def drag(
    arm: int = LEFT, cycle: int = 3, *, steps: int = 0, offset: Array = AWAY, rise: float = 0.04, hold: float = 0.02
) -> ArmPush:
    return ArmPush(arm=arm, cycle=cycle, steps=steps, offset=offset, rise=rise, hold=hold, force=np.zeros(3))


def force(arm: int = LEFT, cycle: int = 3, *, steps: int = 0, newtons: Array = DOWN, hold: float = 0.02) -> ArmPush:
    return ArmPush(arm=arm, cycle=cycle, steps=steps, offset=np.zeros(3), rise=0.0, hold=hold, force=newtons)


def commanded(cycle: int) -> Array:
    """Where both pads are commanded, metres: they go on by 1 and 2 mm a cycle."""
    return np.array([[0.001 * cycle, 0.15, 0.4], [0.002 * cycle, -0.15, 0.4]])


def played(pushes: ArmPushes, cycles: int) -> tuple[Array, Array, Array]:
    """Places and velocities that the arms hear, shape (n, 2, 3), and which arms were pushed, shape (n, 2)."""
    places, velocities, acting = [], [], []
    for cycle in range(cycles):
        pads, velocity = commanded(cycle), np.array([[0.25, 0.0, 0.0], [0.5, 0.0, 0.0]])
        assert pushes.act(cycle, cycle, pads, velocity, carrying=True) is None
        places.append(pads)
        velocities.append(velocity)
        acting.append(pushes.acting.copy())
    return np.array(places), np.array(velocities), np.array(acting)


# Minimum jerk.


def test_a_minimum_jerk_step_by_hand() -> None:
    assert smooth(0.0) == (0.0, 0.0)
    assert smooth(0.5) == (0.5, 1.875)
    assert smooth(1.0) == (1.0, 0.0)
    assert smooth(0.25) == (pytest.approx(0.103515625), pytest.approx(1.0546875))
    assert smooth(-1.0) == (0.0, 0.0)
    assert smooth(7.0) == (1.0, 0.0)


@given(st.floats(0.001, 0.999))
def test_its_slope_is_the_derivative_and_its_halves_mirror_each_other(share: float) -> None:
    h = 1e-5
    ahead, behind = smooth(share + h)[0], smooth(share - h)[0]
    place, slope = smooth(share)
    assert slope == pytest.approx((ahead - behind) / (2.0 * h), abs=1e-8)
    assert 0.0 <= place <= 1.0
    assert 0.0 < slope <= 1.875
    assert smooth(1.0 - share) == (pytest.approx(1.0 - place, abs=1e-13), pytest.approx(slope, abs=1e-12))


# Drags.


def test_a_drag_by_hand() -> None:
    # Ten cycles out, five held, from where the arm was commanded in the third one.
    places, velocities, acting = played(ArmPushes([drag(rise=0.04, hold=0.02)], DT), 30)
    anchor = commanded(3)[LEFT]
    assert (places[3, LEFT] == anchor).all()
    assert not velocities[3, LEFT].any()
    assert places[8, LEFT] == pytest.approx(anchor + 0.5 * AWAY, abs=1e-15)
    assert velocities[8, LEFT] == pytest.approx(1.875 * AWAY / 0.04, rel=1e-12)
    assert places[13:18, LEFT] == pytest.approx(np.tile(anchor + AWAY, (5, 1)), abs=1e-15)
    assert velocities[14:18, LEFT] == pytest.approx(0.0, abs=1e-15)
    # Let go, and before, it hears its own commands; the other arm always does.
    heard = np.array([commanded(cycle) for cycle in range(30)])
    assert (places[:3] == heard[:3]).all()
    assert (places[19:] == heard[19:]).all()
    assert (velocities[19:, LEFT] == [0.25, 0.0, 0.0]).all()
    assert (places[:, RIGHT] == heard[:, RIGHT]).all()
    assert (velocities[:, RIGHT] == [0.5, 0.0, 0.0]).all()
    assert acting[:, RIGHT].tolist() == [False] * 30
    assert acting[3:18, LEFT].all()
    assert not acting[:3].any()
    assert not acting[19:].any()


@given(arms, seeds, st.integers(3, 50), st.integers(0, 50), st.integers(0, 20))
def test_a_drag_begins_where_the_arm_is_and_moves_as_it_says(
    arm: int, seed: int, rise: int, hold: int, cycle: int
) -> None:
    offset = 0.1 * np.random.default_rng(seed).normal(size=3)
    push = drag(arm, cycle, offset=offset, rise=rise * DT, hold=hold * DT)
    places, velocities, acting = played(ArmPushes([push], DT), cycle + rise + hold + 5)
    dragged = np.flatnonzero(acting[:, arm])
    # Rounding may end the last cycle, in which it is where it is held.
    assert dragged[0] == cycle
    assert len(dragged) in (rise + hold, rise + hold + 1)
    assert (places[cycle, arm] == commanded(cycle)[arm]).all()
    way, moving = places[dragged, arm], velocities[dragged, arm]
    assert np.abs(way[rise:] - (commanded(cycle)[arm] + offset)).max(initial=0.0) < 1e-15
    # Differences over two cycles are off by (dt^2/6) of the third derivative, at most 60/rise^3 of the offset.
    slopes = (way[2:] - way[:-2]) / (2.0 * DT)
    assert np.abs(slopes - moving[1:-1]).max() <= 10.0 * np.abs(offset).max() / (rise**3 * DT) + 1e-12


def test_a_drag_without_rise_is_there_at_once() -> None:
    places, velocities, _ = played(ArmPushes([drag(rise=0.0, hold=0.02)], DT), 8)
    assert places[3:, LEFT] == pytest.approx(np.tile(commanded(3)[LEFT] + AWAY, (5, 1)), abs=1e-15)
    assert not velocities[3:, LEFT].any()


def test_a_second_drag_begins_where_the_first_one_has_the_arm() -> None:
    pushes = ArmPushes([drag(cycle=0, rise=0.04, hold=1.0), drag(cycle=20, offset=-AWAY, rise=0.04, hold=1.0)], DT)
    places, _, _ = played(pushes, 40)
    assert places[20, LEFT] == pytest.approx(commanded(0)[LEFT] + AWAY, abs=1e-15)
    assert places[39, LEFT] == pytest.approx(commanded(0)[LEFT], abs=1e-15)


def test_both_arms_can_be_dragged_at_once() -> None:
    places, _, acting = played(ArmPushes([drag(LEFT, 0), drag(RIGHT, 0, offset=2.0 * AWAY)], DT), 12)
    assert places[11] - commanded(0) == pytest.approx(np.array([AWAY, 2.0 * AWAY]), abs=1e-15)
    assert acting[11].all()


# Forces.


def test_forces_add_and_leave_the_commands_alone() -> None:
    pushes = ArmPushes(
        [force(LEFT, 0), force(LEFT, 2, newtons=np.array([3.0, 0.0, 4.0])), force(RIGHT, 2, hold=0.009)], DT
    )
    found = []
    for cycle in range(10):
        pads, velocity = commanded(cycle), np.full((2, 3), 0.1)
        found.append(pushes.act(cycle, 0, pads, velocity, carrying=True))
        assert (pads == commanded(cycle)).all()
        assert (velocity == 0.1).all()
        # The first one lasts to the fifth cycle, the second to the seventh, that on the right to the fourth.
        assert pushes.acting.tolist() == [cycle <= 7, 2 <= cycle <= 4]
    assert all(one is not None for one in found[:8])
    assert found[0] == pytest.approx(np.array([DOWN, np.zeros(3)]))
    assert found[3] == pytest.approx(np.array([[3.0, 0.0, -6.0], DOWN]))
    assert found[5] == pytest.approx(np.array([[3.0, 0.0, -6.0], np.zeros(3)]))
    assert found[7] == pytest.approx(np.array([[3.0, 0.0, 4.0], np.zeros(3)]))
    assert found[8:] == [None, None]


def test_a_force_beside_a_drag() -> None:
    pushes, pads = ArmPushes([drag(LEFT, 0, rise=0.0), force(LEFT, 0)], DT), commanded(0)
    assert not force().drags
    assert drag().drags
    forces = pushes.act(0, 0, pads, np.zeros((2, 3)), carrying=True)
    assert forces == pytest.approx(np.array([DOWN, np.zeros(3)]))
    assert pads[LEFT] == pytest.approx(commanded(0)[LEFT] + AWAY)


# When they come.


def test_none_begins_before_the_box_is_carried_and_what_has_begun_goes_on() -> None:
    pushes = ArmPushes([drag(cycle=0)], DT)
    for cycle in range(5):
        pads = commanded(cycle)
        assert pushes.act(cycle, cycle, pads, np.zeros((2, 3)), carrying=False) is None
        assert (pads == commanded(cycle)).all()
        assert (pushes.begun, pushes.all_begun, pushes.acting.any()) == (0, False, False)
    pushes.act(5, 5, commanded(5), np.zeros((2, 3)), carrying=True)
    assert (pushes.begun, pushes.all_begun) == (1, True)
    pads = commanded(10)
    pushes.act(10, 10, pads, np.zeros((2, 3)), carrying=False)
    assert pads[LEFT] == pytest.approx(commanded(5)[LEFT] + 0.5 * AWAY, abs=1e-15)
    assert pushes.acting.tolist() == [True, False]


@given(st.integers(0, 30), st.lists(st.booleans(), min_size=60, max_size=60))
def test_steps_count_those_in_which_x_has_moved(steps: int, moves: list[bool]) -> None:
    pushes, made = ArmPushes([drag(cycle=NEVER, steps=steps), force(cycle=40)], DT), 0
    for cycle, moved in enumerate(moves):
        made += moved
        pushes.act(cycle, made, commanded(cycle), np.zeros((2, 3)), carrying=True)
        assert pushes.begun == (made >= steps) + (cycle >= 40)
        assert pushes.all_begun == (pushes.begun == 2)


def test_without_pushes_nothing_happens() -> None:
    pushes = ArmPushes([], DT)
    places, _, acting = played(pushes, 5)
    assert (places == np.array([commanded(cycle) for cycle in range(5)])).all()
    assert not acting.any()
    assert pushes.all_begun


# As a person asks for them.

WAY = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.0, 4.0, 0.0]])
"""Lengths 0, 1, 3, 6, 10."""


def test_disturbances_of_arms_become_pushes_by_hand() -> None:
    asked = (
        Drag(arm="right", offset=(0.01, 0.02, 0.03), rise=0.5, hold=0.7),
        Drag(offset=(0.0, 0.0, 0.1), at_time=1.2),
        Force(arm="right", force=(0.0, 0.0, -8.0), duration=0.4, at_fraction=0.25),
        Force(force=(1.0, 0.0, 0.0), duration=0.2, at_state=(3.2, -5.0, 0.0)),
    )
    found = pushes_of(asked, WAY, 0.5, np.random.default_rng(0))
    assert [one.arm for one in found] == [RIGHT, LEFT, RIGHT, LEFT]
    # Half of ten metres are gone with the third step, a quarter with the second; 1.2 s are three cycles of 0.5 s.
    assert [(one.cycle, one.steps) for one in found] == [(NEVER, 3), (3, 0), (NEVER, 2), (NEVER, 2)]
    assert [one.offset.tolist() for one in found] == [[0.01, 0.02, 0.03], [0.0, 0.0, 0.1], [0.0] * 3, [0.0] * 3]
    assert [one.force.tolist() for one in found] == [[0.0] * 3, [0.0] * 3, [0.0, 0.0, -8.0], [1.0, 0.0, 0.0]]
    assert [(one.rise, one.hold) for one in found] == [(0.5, 0.7), (0.6, 0.8), (0.0, 0.4), (0.0, 0.2)]
    assert [one.drags for one in found] == [True, True, False, False]


def test_random_drags_take_the_generator_in_order() -> None:
    asked = (RandomDrag(), Drag(offset=(0.0, 0.0, 0.1)), RandomDrag())
    found = pushes_of(asked, WAY, 0.5, np.random.default_rng(7))
    generator = np.random.default_rng(7)
    for one, wanted in ((found[0], drawn(RandomDrag(), generator)), (found[2], drawn(RandomDrag(), generator))):
        assert SIDES[one.arm] == wanted.arm
        assert one.offset.tolist() == list(wanted.offset)
        assert (one.rise, one.hold) == (wanted.rise, wanted.hold)
    assert found[0].offset.tolist() != found[2].offset.tolist()


ranges = st.tuples(st.floats(0.01, 1.0), st.floats(0.01, 1.0)).map(sorted)


@given(seeds, ranges, ranges, ranges, ranges)
def test_a_random_drag_is_within_its_ranges_and_the_same_for_a_seed(
    seed: int, far: list[float], lasting: list[float], quick: list[float], moment: list[float]
) -> None:
    asked = RandomDrag(
        nearest=far[0],
        farthest=far[1],
        shortest=lasting[0],
        longest=lasting[1],
        quickest=quick[0],
        slowest=quick[1],
        earliest=moment[0],
        latest=moment[1],
    )
    one = drawn(asked, np.random.default_rng(seed))
    rounding = 1e-12
    assert far[0] - rounding <= math.hypot(*one.offset) <= far[1] + rounding
    assert lasting[0] - rounding <= one.rise + one.hold <= lasting[1] + rounding
    assert one.rise <= quick[1]
    assert one.rise >= quick[0] or one.hold == 0.0  # it lasts no longer than it is dragged
    assert one.hold >= 0.0
    assert one.at_fraction is not None
    assert moment[0] <= one.at_fraction <= moment[1]
    assert (one.at_time, one.at_state) == (None, None)
    assert drawn(asked, np.random.default_rng(seed)) == one


def test_random_drags_are_of_both_arms_and_in_all_directions_alike() -> None:
    generator, n = np.random.default_rng(0), 4000
    found = [drawn(RandomDrag(), generator) for _ in range(n)]
    assert sum(one.arm == "left" for one in found) / n == pytest.approx(0.5, abs=0.03)
    offsets = np.array([one.offset for one in found])
    far = np.linalg.norm(offsets, axis=1)
    directions = offsets / far[:, None]
    # The mean of n unit vectors has 1/sqrt(3 n) in each coordinate, their second moments are I/3.
    assert np.abs(directions.mean(axis=0)).max() < 4.0 / math.sqrt(3.0 * n)
    assert directions.T @ directions / n == pytest.approx(np.eye(3) / 3.0, abs=0.02)
    # Archimedes: each coordinate of a point on the unit sphere is uniform.
    assert min(kstest(coordinate, "uniform", (-1.0, 2.0)).pvalue for coordinate in directions.T) > 1e-3
    assert np.abs(np.corrcoef(directions.T, far)[-1, :-1]).max() < 0.06
    # Ranges are used from end to end.
    assert (far.min(), far.max()) == (pytest.approx(0.03, abs=1e-3), pytest.approx(0.10, abs=1e-3))
    moments = [one.at_fraction for one in found]
    assert (min(moments), max(moments)) == (pytest.approx(0.1, abs=5e-3), pytest.approx(0.9, abs=5e-3))  # type: ignore[type-var]


# Pots.


@given(seeds, st.floats(0.0, 0.05), st.floats(0.0, 0.05))
def test_pots_are_drawn_within_their_spreads(seed: int, spread: float, radius_spread: float) -> None:
    asked = (
        Flowerpot(spread=spread, radius_spread=radius_spread),
        Flowerpot(centre=(0.4, 0.2, 0.3), radius=0.1, along=0.0, velocity=(0.0, 0.01, 0.0), height=0.3, spread=spread),
    )
    found = draw_pots(asked, np.random.default_rng(seed))
    assert draw_pots(asked, np.random.default_rng(seed)) == found
    for one, pot in zip(found, asked, strict=True):
        assert np.abs(np.subtract(one.centre, pot.centre)).max() <= spread + 1e-15
        assert abs(one.radius - pot.radius) <= pot.radius_spread + 1e-15
        assert (one.along, one.velocity, one.height, one.width) == (pot.along, pot.velocity, pot.height, pot.width)
    if spread == radius_spread == 0.0:
        assert [(one.centre, one.radius) for one in found] == [(pot.centre, pot.radius) for pot in asked]


def test_draws_of_pots_fill_their_spreads() -> None:
    generator = np.random.default_rng(0)
    found = [draw_pots([Flowerpot(spread=0.05, radius_spread=0.02)], generator)[0] for _ in range(500)]
    away = np.array([one.centre for one in found]) - Flowerpot().centre
    assert away.min(axis=0) == pytest.approx(-0.05, abs=2e-3)
    assert away.max(axis=0) == pytest.approx(0.05, abs=2e-3)
    assert np.corrcoef(away.T) == pytest.approx(np.eye(3), abs=0.2)  # each coordinate for itself
    radii = [one.radius for one in found]
    assert (min(radii), max(radii)) == (pytest.approx(0.16, abs=1e-3), pytest.approx(0.20, abs=1e-3))


def test_safety_spheres_as_the_policy_takes_them_by_hand() -> None:
    pots = (
        Flowerpot(centre=(0.5, 0.1, 0.4), radius=0.2, along=0.0, velocity=(0.0, 0.02, 0.0)),
        Flowerpot(centre=(0.5, 0.1, 0.4), radius=0.15, along=0.25),
    )
    sphere, rod = obstacles_of(pots)
    assert sphere == Sphere(centre=(0.5, 0.1, 0.4), radius=0.2, velocity=(0.0, 0.02, 0.0))
    assert rod == Box(centre=(0.5, 0.1, 0.4), half_extents=(THIN, 0.25, THIN), rounding=0.15)


@settings(max_examples=50)
@given(seeds, st.floats(0.05, 0.3), st.floats(0.01, 0.4))
def test_a_sphere_that_is_drawn_out_is_a_rod_with_round_ends(seed: int, radius: float, along: float) -> None:
    generator, centre = np.random.default_rng(seed), np.array([0.5, 0.1, 0.4])
    pot = Flowerpot(centre=(0.5, 0.1, 0.4), radius=radius, along=along)
    shapes, normal = shapes_of(obstacles_of([pot]), 3, "obstacles"), np.empty(3)
    for _ in range(10):
        point = centre + generator.normal(size=3)
        axis = centre + np.array([0.0, np.clip((point - centre)[1], -along, along), 0.0])
        wanted = float(np.linalg.norm(point - axis)) - radius
        assert distance_at(shapes, 0, point, normal) == pytest.approx(wanted, abs=2.0 * THIN)


@given(st.floats(0.02, 0.5), st.floats(0.02, 0.5))
def test_a_pot_is_as_high_and_as_wide_as_it_says_and_within_its_ball(height: float, width: float) -> None:
    pot = Pot(centre=(0.5, 0.0, 0.4), height=height, width=width)
    corners = lathe(pot)
    assert corners.min(axis=0) == pytest.approx([-0.5 * width, -0.5 * width, -0.5 * height], rel=1e-12)
    assert corners.max(axis=0) == pytest.approx([0.5 * width, 0.5 * width, 0.5 * height], rel=1e-12)
    assert np.linalg.norm(corners, axis=1).max() <= pot.reach
    assert pot.reach == pytest.approx(0.5 * math.sqrt(height**2 + width**2), rel=1e-12)


def test_a_pot_by_hand() -> None:
    corners = lathe(Pot(centre=(9.0, 9.0, 9.0), height=0.2, width=0.1)).reshape(5, -1, 3)
    # Rings about its middle: foot, waist, rim, leaves and top, at 0, 35, 40, 75 and 100 % of its height.
    assert corners[:, 0, 2] == pytest.approx([-0.1, -0.03, -0.02, 0.05, 0.1], abs=1e-15)
    assert corners[:, 0, 0] == pytest.approx([0.03, 0.04, 0.05, 0.0425, 0.015], abs=1e-15)
    for ring in corners:
        assert (ring[:, 2] == ring[0, 2]).all()
        assert np.linalg.norm(ring[:, :2], axis=1) == pytest.approx(ring[0, 0], rel=1e-12)
        # Evenly about the axis.
        assert np.linalg.norm(np.diff(ring[:, :2], axis=0), axis=1) == pytest.approx(
            2.0 * ring[0, 0] * math.sin(math.pi / len(ring)), rel=1e-12
        )
    assert Pot(centre=(0.0, 0.0, 0.0), height=0.08, width=0.06).reach == pytest.approx(0.05, abs=1e-15)
