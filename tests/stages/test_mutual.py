"""Two arms that follow each other: the twin against closed forms, who is pushed, eq. (14) by hand, and pushes replayed.

The pushes are replayed on arms without a simulator: each follows what it is commanded behind a lag of its own.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from stages.policy.mutual import (
    ADAPTED,
    CENTRED,
    LEFT,
    NOBODY,
    RELEARNED,
    RIGHT,
    SAG,
    SETTLED,
    SIDES,
    Arms,
    MutualFollowing,
    Twin,
)
from stages.policy.parameters import FollowingParameters
from stages.trajectory import Array
from stages.world.arm_pushes import ArmPush, ArmPushes

DT = 0.004
L = 0.3
PLACE = np.array([0.5, -0.1, 0.4])
GIVEN = FollowingParameters()
THRESHOLD, GATE, LEAD = GIVEN.deviation_threshold, GIVEN.gate, GIVEN.lead
AHEAD, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
OUT = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
"""Away from the box, of each arm."""

seeds = st.integers(0, 2**32 - 1)
rates = st.floats(2.0, 60.0)
sides = st.sampled_from([LEFT, RIGHT])


def beside(midpoint: Array, offsets: Array | float = 0.0) -> Array:
    """Places of the pads by eq. (13), shape (2, 3), metres."""
    return np.asarray(midpoint + OUT * (0.5 * L + np.broadcast_to(offsets, 2))[:, None])


def direction(generator: np.random.Generator) -> Array:
    one = generator.normal(size=3)
    return np.asarray(one / np.linalg.norm(one))


# The twin.


def trailing(error: Array, rate: Array, lag: float, t: float) -> tuple[Array, Array]:
    """e and e' of e'' + 2 w e' + w^2 e = 0, t seconds after they were `error` and `rate`."""
    slope = rate + lag * error
    fade = math.exp(-lag * t)
    return (error + slope * t) * fade, (slope - lag * (error + slope * t)) * fade


@given(seeds, rates, st.integers(1, 60), st.floats(1e-4, 0.02))
def test_the_twin_is_the_closed_form_behind_an_even_motion(seed: int, lag: float, cycles: int, dt: float) -> None:
    generator = np.random.default_rng(seed)
    begin, velocity, away = generator.normal(size=(3, 2, 3))
    twin = Twin(begin + away, lag)
    for k in range(1, cycles + 1):
        twin.step(begin + k * dt * velocity, velocity, dt)
    error, rate = trailing(away, -velocity, lag, cycles * dt)
    assert twin.pads == pytest.approx(begin + cycles * dt * velocity + error, abs=1e-10)
    assert twin.velocity == pytest.approx(velocity + rate, abs=1e-8)


def test_the_twin_by_hand() -> None:
    # At rest at 0, commanded to 1 mm at once: 1 - (1 + w t) exp(-w t) of it, at w t = 1 the share 1 - 2/e.
    twin = Twin(np.zeros((2, 3)), 20.0)
    twin.step(np.full((2, 3), 0.001), np.zeros((2, 3)), 0.05)
    assert twin.pads == pytest.approx(np.full((2, 3), 0.001 * (1.0 - 2.0 / math.e)), rel=1e-13)
    assert twin.velocity == pytest.approx(np.full((2, 3), 0.001 * 400.0 * 0.05 / math.e), rel=1e-13)


@settings(max_examples=20)
@given(seeds, st.floats(5.0, 40.0))
def test_the_twin_is_what_a_solver_finds(seed: int, lag: float) -> None:
    generator = np.random.default_rng(seed)
    begin, velocity, away = generator.normal(size=(3, 2, 3))

    def slope(t: float, state: Array) -> Array:
        p, v = state.reshape(2, 2, 3)
        return np.concatenate([v.ravel(), (lag**2 * (begin + t * velocity - p) + 2.0 * lag * (velocity - v)).ravel()])

    start = np.concatenate([(begin + away).ravel(), np.zeros(6)])
    solved = solve_ivp(slope, (0.0, 0.2), start, rtol=1e-10, atol=1e-12).y[:, -1].reshape(2, 2, 3)
    twin = Twin(begin + away, lag)
    for k in range(1, 51):
        twin.step(begin + k * DT * velocity, velocity, DT)
    assert twin.pads == pytest.approx(solved[0], abs=1e-7)
    assert twin.velocity == pytest.approx(solved[1], abs=1e-6)


@given(seeds, rates)
def test_a_twin_that_goes_with_its_commands_stays_with_them(seed: int, lag: float) -> None:
    generator = np.random.default_rng(seed)
    at, velocity = generator.normal(size=(2, 2, 3))
    twin = Twin(at, lag)
    twin.velocity = velocity.copy()
    for _ in range(100):
        at = at + DT * velocity
        twin.step(at, velocity, DT)
    assert twin.pads == pytest.approx(at, abs=1e-12)
    assert twin.velocity == pytest.approx(velocity, abs=1e-12)
    resting = Twin(at, lag)
    resting.step(at, np.zeros((2, 3)), DT)
    assert (resting.pads == at).all()
    assert not resting.velocity.any()


@given(seeds, rates, st.lists(st.floats(1e-4, 0.05), min_size=1, max_size=8))
def test_it_does_not_matter_how_a_span_is_cut_into_steps(seed: int, lag: float, cuts: list[float]) -> None:
    begin, velocity, away = np.random.default_rng(seed).normal(size=(3, 2, 3))
    once, often, passed = Twin(begin + away, lag), Twin(begin + away, lag), 0.0
    for dt in cuts:
        passed += dt
        often.step(begin + passed * velocity, velocity, dt)
    once.step(begin + passed * velocity, velocity, passed)
    assert often.pads == pytest.approx(once.pads, abs=1e-11)
    assert often.velocity == pytest.approx(once.velocity, abs=1e-9)


def test_a_twin_begins_from_its_own_copy() -> None:
    pads = beside(PLACE)
    twin = Twin(pads, 20.0)
    pads += 1.0
    assert (twin.pads == beside(PLACE)).all()


# Who is pushed. Commanded to rest at `PLACE`, and measured wherever a test says.


def resting(given_: FollowingParameters = GIVEN, *, printed: bool = False, on: bool = True) -> MutualFollowing:
    return MutualFollowing(given_, DT, beside(PLACE), printed=printed, on=on)


def seen(one: MutualFollowing, away: Array, *, settling: bool = False) -> Arms:
    """Show it arms that are `away`, shape (2, 3), metres, from where they are commanded."""
    arms = Arms(beside(PLACE) + away, np.zeros((2, 3)), np.zeros(2))
    one.observe(arms, beside(PLACE), np.zeros((2, 3)), PLACE, settling=settling)
    return arms


def settled(off: Array) -> MutualFollowing:
    """It has learned, to the last bit or so, that arms are `off`, shape (2, 3), metres, anyhow."""
    one = resting()
    for _ in range(700):
        seen(one, off, settling=True)
    return one


@given(seeds, st.floats(0.0, 0.02), st.floats(0.0, 0.02))
def test_the_arm_that_is_farther_off_is_named_beyond_the_threshold(seed: int, left: float, right: float) -> None:
    generator = np.random.default_rng(seed)
    lasts = 1.0 - DT / ADAPTED  # of what it sees in a cycle it takes so much for no sag
    assume(abs(lasts * max(left, right) - THRESHOLD) > 1e-9)
    assume(abs(left - right) > 1e-9)
    one = resting()
    seen(one, np.array([left * direction(generator), right * direction(generator)]))
    assert np.linalg.norm(one.residual, axis=1) == pytest.approx([lasts * left, lasts * right], abs=1e-15)
    assert one.deviation == pytest.approx(lasts * max(left, right), abs=1e-15)
    named = lasts * max(left, right) > THRESHOLD
    assert one.pushed == ((LEFT if left > right else RIGHT) if named else NOBODY)
    assert one.follows == named


def test_who_has_been_named_stays_named_until_it_is_over() -> None:
    one = resting()
    seen(one, np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert one.pushed == LEFT
    seen(one, np.array([[0.001, 0.0, 0.0], [0.0, 0.0, 0.03]]))
    assert (one.pushed, one.follows, one.waits) == (LEFT, True, True)


def test_nobody_comes_back_before_the_push_is_noticed() -> None:
    one = resting()
    assert not one.returning
    seen(one, np.array([[0.004, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    one.return_speed(0.0)
    assert one.waits
    assert not one.returning  # x waits, and nobody is pushed
    seen(one, np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert one.pushed == LEFT
    assert not one.returning
    seen(one, np.array([[0.002, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert one.pull(PLACE) is PLACE
    one.return_speed(0.01)
    assert one.returning  # let go: nothing pulls it off its lead


def test_nobody_is_named_while_they_grip_or_where_they_are_not_to_follow() -> None:
    one = resting()
    seen(one, np.full((2, 3), 0.1), settling=True)
    assert (one.pushed, one.follows, one.waits) == (NOBODY, False, False)
    alone = resting(on=False)
    seen(alone, np.full((2, 3), 0.1))
    assert (alone.pushed, alone.follows, alone.waits) == (NOBODY, False, True)  # x waits, and that is all
    assert not alone.recovered(0.0)


@given(seeds, st.lists(st.floats(0.0, 0.0058), min_size=1, max_size=30), sides)
def test_x_waits_beyond_twice_the_gate_until_within_it(seed: int, away: list[float], arm: int) -> None:
    one, waits = resting(), False
    for far in away:
        off = np.zeros((2, 3))
        off[arm] = far * direction(np.random.default_rng(seed))
        seen(one, off)
        waits = float(np.linalg.norm(one.residual, axis=1).max()) > (GATE if waits else 2.0 * GATE)
        assert one.waits == waits
        assert one.pushed == NOBODY


def test_the_gates_hysteresis_by_hand() -> None:
    one, found = resting(), []
    for far in (2.9e-3, 3.1e-3, 2.9e-3, 1.6e-3, 1.4e-3, 2.9e-3):
        seen(one, np.array([[far, 0.0, 0.0], [0.0, 0.0, 0.0]]))
        found.append(one.waits)
    assert found == [False, True, True, True, False, False]


def test_x_waits_on_for_a_midpoint_that_both_arms_have_carried_off() -> None:
    # p_hat is led back, and the twin with it: the pads' middle is still away, twice the gate and more.
    one = resting()
    seen(one, np.full((2, 3), 0.003))
    assert one.waits
    arms = Arms(beside(PLACE), np.zeros((2, 3)), np.zeros(2))
    one.observe(arms, beside(PLACE), np.zeros((2, 3)), PLACE + 2.1 * GATE * UP)
    assert one.strayed == pytest.approx(2.1 * GATE, rel=0.01)
    assert one.deviation < 0.1 * GATE
    assert one.waits
    one.observe(arms, beside(PLACE), np.zeros((2, 3)), PLACE + 1.9 * GATE * UP)
    assert not one.waits


@settings(max_examples=20)
@given(seeds, st.floats(0.0, 0.03), st.floats(0.0, 3e-4))
def test_what_arms_are_off_by_anyhow_names_nobody_and_is_learned(seed: int, bias: float, noise: float) -> None:
    generator = np.random.default_rng(seed)
    off = bias * np.array([direction(generator), direction(generator)])
    one = resting()
    for _ in range(250):
        seen(one, off + noise * generator.normal(size=(2, 3)), settling=True)
    left = []
    for _ in range(250):
        seen(one, off + noise * generator.normal(size=(2, 3)))
        assert (one.pushed, one.waits) == (NOBODY, False)
        left.append(one.residual)
    assert one.strayed < 3.0 * noise + 1e-5
    # What is left is noise: its mean is that of 250 of them, and of what was taken for sag.
    assert np.abs(np.mean(left, axis=0)).max() <= 1.5 * noise + 1e-5


def test_learning_by_hand() -> None:
    off = np.array([[0.004, 0.0, 0.0], [0.0, -0.002, 0.0]])
    one = resting()
    for k in range(1, 6):
        seen(one, off, settling=True)
        assert one.residual == pytest.approx(off * (1.0 - DT / SETTLED) ** k, abs=1e-16)
    one = resting()
    small = 0.5 * off
    for k in range(1, 6):
        seen(one, small)
        assert one.residual == pytest.approx(small * (1.0 - DT / ADAPTED) ** k, abs=1e-16)
    # While x waits nothing is learned.
    seen(one, off)
    assert one.waits
    before = one.residual
    seen(one, off)
    assert (one.residual == before).all()


def test_what_is_left_of_a_push_is_sag_once_p_hat_is_back_by_hand() -> None:
    def rested(far: float, gap: float) -> Array:
        """Residuals, metres, of a pushed arm that rests `far` from where it is led, p_hat being `gap` from x."""
        one, found = resting(), []
        for away in (0.01, far, far, far, far):
            seen(one, away * UP * np.eye(2)[LEFT][:, None])
            one.return_speed(gap)
            found.append(one.deviation)
        assert one.pushed == LEFT
        return np.array(found[1:])

    known = 0.01 * DT / ADAPTED  # of the push itself, in the cycle in which it was named
    small, large = known + 0.99 * SAG * THRESHOLD, known + 1.01 * SAG * THRESHOLD
    fade = (1.0 - DT / RELEARNED) ** np.arange(4)
    assert rested(small, 0.0) == pytest.approx(0.99 * SAG * THRESHOLD * fade, rel=1e-12)
    assert rested(large, 0.0) == pytest.approx(1.01 * SAG * THRESHOLD, rel=1e-12)
    assert rested(small, 1e-6) == pytest.approx(0.99 * SAG * THRESHOLD, rel=1e-12)


def test_what_the_midpoint_is_off_by_at_rest_is_learned_slowly_by_hand() -> None:
    # Nobody is pushed, p_hat is back, and x waits for the midpoint of the pads alone.
    one = resting()
    seen(one, np.full((2, 3), 0.003))
    arms = Arms(beside(PLACE), np.zeros((2, 3)), np.zeros(2))
    found = []
    for _ in range(6):
        one.return_speed(0.0)
        one.observe(arms, beside(PLACE), np.zeros((2, 3)), PLACE + 3.0 * GATE * UP)
        assert (one.pushed, one.waits) == (NOBODY, True)
        found.append(one.strayed)
    assert found[0] == pytest.approx(3.0 * GATE, rel=0.01)
    assert np.array(found[2:]) == pytest.approx(np.array(found[1:-1]) * (1.0 - DT / CENTRED), rel=1e-12)
    # Of a pushed arm it is the push.
    one = resting()
    seen(one, 0.01 * UP * np.eye(2)[LEFT][:, None])
    found = []
    for _ in range(4):
        one.return_speed(0.0)
        seen(one, 0.002 * UP * np.eye(2)[LEFT][:, None])
        found.append(one.strayed)
    assert one.pushed == LEFT
    assert found == [found[0]] * 4


# What comes of it, by hand.


def test_a_pushed_arm_gives_way_a_little_at_a_time() -> None:
    one = resting()
    assert one.pull(PLACE) is PLACE  # nobody is pushed
    away = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.013 / (1.0 - DT / ADAPTED)]])
    seen(one, away)
    assert one.pushed == RIGHT
    # 10 mm beyond the lead, in 0.15 s: 0.2667 mm in the first cycle.
    moved = one.pull(PLACE)
    assert moved - PLACE == pytest.approx([0.0, 0.0, 0.010 * DT / 0.15], abs=1e-15)
    assert one.residual[RIGHT] == pytest.approx([0.0, 0.0, 0.013 - 0.010 * DT / 0.15], abs=1e-15)
    # Held, what is beyond the lead falls off within the time of yielding.
    far = [0.013]
    for _ in range(100):
        shift = moved - PLACE
        arms = Arms(beside(PLACE) + away, np.zeros((2, 3)), np.zeros(2))
        one.observe(arms, beside(moved), np.zeros((2, 3)), moved)
        moved = one.pull(moved)
        assert np.linalg.norm(moved - PLACE - shift) <= DT / GIVEN.yielding * (far[-1] - LEAD) + 1e-12
        far.append(float(np.linalg.norm(one.residual[RIGHT])))
    assert far[-1] - LEAD == pytest.approx(0.010 * (1.0 - DT / 0.15) ** 101, rel=1e-6)
    assert (moved - PLACE)[2] == pytest.approx(0.010 * (1.0 - (1.0 - DT / 0.15) ** 101), rel=0.01)


def test_a_pushed_arm_within_the_lead_does_not_give_way() -> None:
    one = resting()
    seen(one, np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    seen(one, np.array([[0.0029, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert one.pushed == LEFT
    assert one.pull(PLACE) is PLACE


def test_yielding_faster_than_a_cycle_goes_along() -> None:
    one = resting(FollowingParameters(yielding=0.001))
    seen(one, np.array([[0.02, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    moved = one.pull(PLACE)
    assert np.linalg.norm(one.residual[LEFT]) == pytest.approx(LEAD, rel=1e-12)
    assert (moved - PLACE)[0] == pytest.approx(0.02 * (1.0 - DT / ADAPTED) - LEAD, abs=1e-12)


def test_the_return_begins_and_ends_gently_by_hand() -> None:
    one = resting()
    assert one.return_speed(0.02) is None  # x does not wait
    seen(one, np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert one.return_speed(1.0) == pytest.approx(0.3 * DT, rel=1e-12)
    assert one.return_speed(1.0) == pytest.approx(0.6 * DT, rel=1e-12)
    for _ in range(200):
        speed = one.return_speed(1.0)
    assert speed == 0.1
    assert one.return_speed(0.006) == pytest.approx(math.sqrt(0.6 * 0.006) + 0.3 * DT, rel=1e-12)  # 60 mm/s
    assert one.return_speed(0.0) == pytest.approx(0.3 * DT, rel=1e-12)


@given(st.floats(1e-6, 0.3), st.floats(0.02, 0.3), st.floats(0.05, 2.0), st.sampled_from([0.001, 0.004, 0.02]))
def test_the_way_back_is_no_faster_than_asked_and_ends_exactly(
    gap: float, top: float, acceleration: float, dt: float
) -> None:
    given_ = FollowingParameters(return_speed=top, return_acceleration=acceleration)
    one = MutualFollowing(given_, dt, beside(PLACE), printed=False)
    seen(one, np.array([[0.02, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert one.pushed == LEFT
    speeds, left = [0.0], gap
    while left > 0.0:
        speed = one.return_speed(left)
        assert speed is not None
        assert 0.0 < speed <= top + acceleration * dt
        assert speed <= top or left == 0.0
        assert speed - speeds[-1] <= acceleration * dt * (1.0 + 1e-9)
        speeds.append(speed)
        left = max(left - speed * dt, 0.0)
        assert len(speeds) * dt < gap / top + 3.0 * top / acceleration + 20.0 * dt


def test_a_push_is_over_once_it_has_been_calm_for_a_while() -> None:
    one = resting()
    assert not one.recovered(0.0)  # nobody is pushed
    away = np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.0]])
    seen(one, away)
    assert not one.recovered(0.0)
    calm = round(GIVEN.blend / DT)  # 12.5 cycles
    for k in (3, calm + 1):
        for _ in range(k):
            seen(one, 0.1 * away)
            found = one.recovered(0.0)
        assert found == (k == calm + 1)
        if not found:
            seen(one, 0.1 * away)
            assert not one.recovered(1e-9)  # p_hat is not back: from the beginning
    assert (one.pushed, one.follows) == (NOBODY, False)


@settings(max_examples=30)
@given(seeds, sides)
def test_the_other_arm_stands_beside_where_the_pushed_one_is(seed: int, arm: int) -> None:
    # p_other = p_pushed -+ [0, L + both offsets, 0], less what the pushed one is off by anyhow. Paper eq. (14).
    generator = np.random.default_rng(seed)
    off, offsets = 0.002 * generator.normal(size=(2, 3)), 0.005 * generator.normal(size=2)
    one, other = settled(off), 1 - arm
    calm = np.tile(PLACE, (2, 1))
    one.place(seen(one, off), calm, np.zeros((2, 3)), offsets, L)
    away = off.copy()
    away[arm] += 0.05 * direction(generator)
    pads, velocity = beside(PLACE) + away, generator.normal(size=(2, 3))
    arms = Arms(pads, velocity, np.zeros(2))
    # In the cycle in which it is named a little of the push is taken for sag.
    target = pads[arm] - off[arm] - DT / ADAPTED * (away[arm] - off[arm])
    target[1] += SIDES[other] * (L + offsets.sum())
    for k in range(1, 40):
        one.observe(arms, beside(PLACE), np.zeros((2, 3)), PLACE)
        assert one.pushed == arm
        middles, moving = np.tile(PLACE, (2, 1)), np.tile([0.01, 0.02, 0.03], (2, 1))
        one.place(arms, middles, moving, offsets, L)
        # The pushed arm goes by eq. (13) as before.
        assert (middles[arm] == PLACE).all()
        assert (moving[arm] == [0.01, 0.02, 0.03]).all()
        stands = middles[other] + OUT[other] * (0.5 * L + offsets[other])
        before = PLACE + OUT[other] * (0.5 * L + offsets[other])
        fade = math.exp(-k * DT / GIVEN.blend)
        assert stands == pytest.approx(target + fade * (before - target), abs=1e-12)
        assert moving[other] == pytest.approx(velocity[arm] - fade * (before - target) / GIVEN.blend, abs=1e-9)


@settings(max_examples=30)
@given(seeds, sides)
def test_a_switch_and_the_one_back_are_blended_out(seed: int, arm: int) -> None:
    generator = np.random.default_rng(seed)
    one, other, away = resting(), 1 - arm, np.zeros((2, 3))
    fade = math.exp(-DT / GIVEN.blend)
    middles = np.tile(PLACE, (2, 1))
    one.place(seen(one, away), middles, np.zeros((2, 3)), np.zeros(2), L)
    away[arm] = 0.05 * direction(generator)
    names, last = [], middles
    for k in range(120):
        if k == 60:
            away[arm] = 0.9 * GATE * direction(generator)
        arms = seen(one, away)
        one.recovered(0.0)
        names.append(one.pushed)
        wanted = PLACE if one.pushed == NOBODY else PLACE + one.residual[arm]
        middles = np.tile(PLACE, (2, 1))
        one.place(arms, middles, np.zeros((2, 3)), np.zeros(2), L)
        assert (middles[arm] == PLACE).all()
        if k != 60:  # there the pushed arm itself has jumped
            # Each cycle takes away the same share of what is left, also in the one of the switch.
            assert middles[other] - wanted == pytest.approx(fade * (last[other] - wanted), abs=1e-12)
        last = middles
    assert names[:60] == [arm] * 60
    assert names[-1] == NOBODY
    assert np.abs(middles - PLACE).max() < 0.05 * math.exp(-40 * DT / GIVEN.blend)


# Pushes replayed.


class Replay:
    """Two arms that follow what they are commanded, each behind a lag of its own, and a straight way of the midpoint.

    Attributes:
        x, midpoint: arrays, shape (3,), metres: where the way is, and p_hat.
        pads: array, shape (2, 3), metres, where the arms are.
        middles: array, shape (2, 3), metres, about which they were commanded.
        mutual: what is tested.
    """

    def __init__(
        self,
        push: ArmPush | None = None,
        *,
        rates: tuple[float, float] = (20.0, 20.0),
        order: int = 2,
        fed: float = 1.0,
        off: Array | float = 0.0,
        noise: float = 0.0,
        speed: float = 0.1,
        offsets: tuple[float, float] = (-0.003, -0.002),
        seed: int = 0,
        printed: bool = False,
    ) -> None:
        """Begin at rest. `rates`: of the arms' lags, 1/s; `fed`: share of commanded velocities that the arms hear."""
        self.x, self.midpoint, self._speed = PLACE.copy(), PLACE.copy(), speed
        self._offsets, self._off, self._noise = np.array(offsets), off, noise
        self._generator = np.random.default_rng(seed)
        self._rates, self._order, self._fed = np.array(rates)[:, None], order, fed
        self._commanded, self._velocity = beside(PLACE, self._offsets), np.zeros((2, 3))
        self._twins = [Twin(one[None], rate) for one, rate in zip(self._commanded, rates, strict=True)]
        self.pads, self._moving = self._commanded.copy(), np.zeros((2, 3))
        self.mutual = MutualFollowing(GIVEN, DT, self._commanded, printed=printed)
        self._pushes, self._cycle = ArmPushes([] if push is None else [push], DT), 0
        self.middles = np.tile(PLACE, (2, 1))
        for _ in range(250):
            self.step(gripping=True)

    def step(self, *, gripping: bool = False) -> float | None:
        """Let a cycle pass; return at which speed p_hat may come back, m/s; none: the way went on."""
        noise = self._noise * self._generator.normal(size=(2, 3))
        arms = Arms(self.pads + self._off + noise, self._moving, np.zeros(2))
        self.mutual.observe(arms, self._commanded, self._velocity, self.midpoint, settling=gripping)
        velocity, speed = np.zeros(3), None
        if not gripping:
            midpoint = self.mutual.pull(self.midpoint)
            gap = float(np.linalg.norm(self.x - midpoint))
            speed = self.mutual.return_speed(gap)
            if speed is None:
                assert gap == 0.0
                self.x = self.x + DT * self._speed * AHEAD
                following = self.x
            else:
                following = self.x if gap <= DT * speed else midpoint + DT * speed / gap * (self.x - midpoint)
            velocity, self.midpoint = (following - midpoint) / DT, following
            self.mutual.recovered(float(np.linalg.norm(self.x - following)))
        self.middles, self._velocity = np.tile(self.midpoint, (2, 1)), np.tile(velocity, (2, 1))
        if not gripping:
            self.mutual.place(arms, self.middles, self._velocity, self._offsets, L)
        self._commanded = self.middles + OUT * (0.5 * L + self._offsets)[:, None]
        heard, moving = self._commanded.copy(), self._velocity.copy()
        self._pushes.act(self._cycle, 0, heard, moving, carrying=not gripping)
        self._cycle += not gripping
        self._follow(heard, self._fed * moving)
        return speed

    def _follow(self, pads: Array, velocity: Array) -> None:
        if self._order == 2:
            for arm, twin in enumerate(self._twins):
                twin.step(pads[arm, None], velocity[arm, None], DT)
            self.pads = np.vstack([twin.pads for twin in self._twins])
            self._moving = np.vstack([twin.velocity for twin in self._twins])
        else:
            error = np.exp(-self._rates * DT) * (self.pads - (pads - DT * velocity))
            self.pads, self._moving = pads + error, velocity - self._rates * error


def dragged(
    arm: int = LEFT, offset: Array | tuple[float, ...] = (0.0, 0.0, 0.05), rise: float = 0.3, hold: float = 0.4
) -> ArmPush:
    """A drag that begins after 0.4 s."""
    return ArmPush(arm=arm, cycle=100, steps=-1, offset=np.array(offset), rise=rise, hold=hold, force=np.zeros(3))


LASTS = 700
"""Cycles, of most replays: the drag is over after 275 of them."""

drags = st.builds(
    lambda arm, seed, far: dragged(arm, far * direction(np.random.default_rng(seed))),
    sides,
    seeds,
    st.floats(0.02, 0.1),
)


@settings(max_examples=12)
@given(drags, seeds, st.tuples(st.floats(15.0, 30.0), st.floats(15.0, 30.0)), st.sampled_from([1, 2]))
def test_after_a_push_both_arms_are_back_to_the_last_digit(
    push: ArmPush, seed: int, rates_: tuple[float, float], order: int
) -> None:
    # With noise, with what the arms are off by anyhow, and with unequal lags.
    off = 0.003 * np.random.default_rng(seed).normal(size=(2, 3))
    noise = 1e-4
    one = Replay(push, rates=rates_, order=order, off=off, noise=noise, seed=seed)
    names, waited, before = set(), 0, one.x
    for _ in range(LASTS + 200):
        p_hat, speed = one.midpoint, one.step()
        names.add(one.mutual.pushed)
        if speed is None:
            assert (one.midpoint == one.x).all()
        else:
            # x waits for p_hat, which gives way no faster than asked, and comes back no faster than asked.
            assert (one.x == before).all()
            waited += 1
            away = np.linalg.norm(p_hat - one.x)
            assert away - np.linalg.norm(one.midpoint - one.x) <= DT * GIVEN.return_speed + 1e-12
        before = one.x
    assert names == {NOBODY, push.arm}
    assert waited > 100
    assert (one.mutual.pushed, one.mutual.waits, one.mutual.follows) == (NOBODY, False, False)
    assert (one.midpoint == one.x).all()
    # Both arms are commanded about x again, and so their midpoint is where that of arms that nobody pushed is.
    assert np.abs(one.middles - one.x).max() < 1e-12
    assert one.pads.mean(axis=0) - one.x == pytest.approx([0.0, -0.0005, 0.0], abs=1e-3 * GIVEN.gate)


@settings(max_examples=10)
@given(drags, seeds)
def test_while_one_arm_is_pushed_the_other_follows_it(push: ArmPush, seed: int) -> None:
    noise = 1e-4
    one, other = Replay(push, noise=noise, seed=seed), 1 - push.arm
    away, together, jumps, last = 0.0, [], [], one.middles
    for _ in range(LASTS):
        one.step()
        away = max(away, float(np.linalg.norm(one.pads[push.arm] - one.x - OUT[push.arm] * 0.5 * L)))
        together.append(float(np.linalg.norm(one.pads[0] - one.pads[1] - [0.0, L - 0.005, 0.0])))
        jumps.append(float(np.linalg.norm(one.middles[other] - last[other])))
        last = one.middles
    assert away > 0.9 * float(np.linalg.norm(push.offset))
    # The box between them is stretched or bent by some mm: by what it takes to be noticed, and by the lag of the one
    # that follows, which goes up to 0.1 m of 15/8 of 0.33 m/s, and is as large as 1/(20 e) s of its change of speed.
    assert max(together) < THRESHOLD + 0.015
    assert together[270] < 0.5e-3 + 6.0 * noise  # held
    # No jump: what a pushed arm does itself, at up to 0.7 m/s, noise, and a share of what is blended out.
    assert max(jumps) < 0.7 * DT + 10.0 * noise + (1.0 - math.exp(-DT / GIVEN.blend)) * 2.0 * THRESHOLD


def test_p_hat_comes_back_as_fast_as_asked_once_the_arm_is_let_go() -> None:
    one, away = Replay(dragged(offset=(0.0, 0.0, 0.1))), []
    for _ in range(LASTS):
        one.step()
        away.append(float(np.linalg.norm(one.midpoint - one.x)))
    turned = int(np.argmax(away))
    assert away[turned] == pytest.approx(0.1 - LEAD, abs=0.003)
    assert turned * DT == pytest.approx(1.1, abs=0.1)  # soon after it is let go
    back = away.index(0.0, turned)
    speeds = -np.diff(away[turned + 1 : back + 1]) / DT
    assert speeds.max() == pytest.approx(GIVEN.return_speed, rel=1e-9)
    assert np.diff(speeds).max() <= GIVEN.return_acceleration * DT + 1e-9
    assert not any(away[back:])
    # At 0.1 m/s, and half of a third of a second more for each, speeding up and slowing down.
    assert (back - turned) * DT == pytest.approx(10.0 * away[turned] + 0.1 / 0.3, abs=0.05)


@pytest.mark.parametrize("order", [1, 2])
def test_a_way_without_pushes_is_not_held_up(order: int) -> None:
    off = np.array([[0.0, 0.001, -0.008], [0.002, 0.0, -0.004]])
    one = Replay(rates=(16.0, 25.0), order=order, off=off, noise=2e-4, seed=3)
    for _ in range(LASTS):
        assert one.step() is None
        assert one.mutual.pushed == NOBODY
    assert (one.x - PLACE)[0] == pytest.approx(LASTS * DT * 0.1, rel=1e-9)
    assert (one.middles == one.x).all()


# Eq. (14) as printed.


def test_equation_14_as_printed_by_hand() -> None:
    one = resting(printed=True)
    # The midpoint is 20 mm up: p_l = p_r + [0, L, 0], p_r = p_l - [0, L, 0] of where the arms are.
    away = np.array([[0.01, 0.0, 0.03], [0.0, 0.02, 0.01]])
    arms = Arms(beside(PLACE) + away, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.zeros(2))
    one.observe(arms, beside(PLACE), np.zeros((2, 3)), PLACE)
    assert one.strayed == pytest.approx((1.0 - DT / ADAPTED) * math.sqrt(0.005**2 + 0.01**2 + 0.02**2), rel=1e-12)
    assert (one.pushed, one.follows, one.waits) == (NOBODY, True, True)
    middles, velocity = np.tile(PLACE, (2, 1)), np.zeros((2, 3))
    one.place(arms, middles, velocity, np.zeros(2), L)
    # PLACE is (0.5, -0.1, 0.4), L/2 is 0.15.
    assert middles + OUT * 0.5 * L == pytest.approx(np.array([[0.5, 0.07, 0.41], [0.51, -0.25, 0.43]]), abs=1e-15)
    assert not velocity.any()  # (14) prints places only
    assert one.pull(PLACE) is PLACE  # nobody leads them back
    assert not one.recovered(0.0)


@given(seeds, st.floats(0.0, 0.02))
def test_as_printed_it_asks_how_far_the_midpoint_is(seed: int, far: float) -> None:
    lasts = 1.0 - DT / ADAPTED
    assume(min(abs(lasts * far - limit) for limit in (THRESHOLD, 2.0 * GATE)) > 1e-9)
    one = resting(printed=True)
    arms = seen(one, np.tile(far * direction(np.random.default_rng(seed)), (2, 1)))
    assert one.strayed == pytest.approx(lasts * far, abs=1e-15)
    assert one.follows == (lasts * far > THRESHOLD)
    assert one.waits == (lasts * far > 2.0 * GATE)
    if not one.follows:
        middles = np.tile(PLACE, (2, 1))
        one.place(arms, middles, np.zeros((2, 3)), np.zeros(2), L)
        assert (middles == PLACE).all()
    # Arms that are off to opposite sides have their midpoint where it is.
    apart = resting(printed=True)
    seen(apart, far * OUT)
    assert not apart.follows


def test_as_printed_the_midpoint_stays_where_a_push_has_left_it() -> None:
    one = Replay(dragged(offset=(0.0, 0.0, 0.05)), printed=True, offsets=(0.0, 0.0), speed=0.0)
    followed = []
    for _ in range(2000):
        one.step()
        followed.append(one.mutual.follows)
    began = followed.index(True)
    assert all(followed[began:])  # (14) never switches back
    assert one.mutual.waits
    assert one.pads.mean(axis=0) - one.x == pytest.approx([0.0, 0.0, 0.05], abs=1e-4)
    assert one.mutual.strayed == pytest.approx(0.05, abs=1e-4)
    led = Replay(dragged(offset=(0.0, 0.0, 0.05)), offsets=(0.0, 0.0), speed=0.0)
    for _ in range(2000):
        led.step()
    assert led.pads.mean(axis=0) - led.x == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("chosen", "speed"),
    [
        # Arms of 10 1/s that go to where they are told: (1 - exp(-w dt)) b/2 a cycle.
        ({"rates": (10.0, 10.0), "order": 1, "fed": 0.0}, 0.5e-3 * (1.0 - math.exp(-10.0 * DT)) / DT),
        # Critically damped ones of 20 1/s trail what moves evenly by 2/w, and hear it half a cycle late.
        ({}, 0.5e-3 / (2.0 / 20.0 + 0.5 * DT)),
    ],
)
def test_as_printed_a_bias_of_a_millimetre_drifts_once_it_has_been_pushed(chosen: dict[str, Any], speed: float) -> None:
    bias = np.array([[0.001, 0.0, 0.0], [0.0, 0.0, 0.0]])

    def drift(printed: bool) -> Array:
        one = Replay(
            dragged(offset=(0.0, 0.0, 0.05)), printed=printed, offsets=(0.0, 0.0), speed=0.0, off=bias, **chosen
        )
        places = []
        for _ in range(3000):
            one.step()
            places.append(one.pads.mean(axis=0))
            assert one._cycle > 100 or not one.mutual.follows  # a bias alone is learned
        return np.asarray((places[-1] - places[-501]) / (500 * DT))

    assert drift(True) == pytest.approx([speed, 0.0, 0.0], abs=1e-4 * speed)
    assert drift(False) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert speed > 0.0049  # the notes' 5 mm/s, and more
