"""What is found out of a box: L from where the pads stand, its mass from the wrists, and the force that it needs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.policy.estimation import (
    CLEAR,
    FIRM,
    GONE,
    GRAVITY,
    KNOWN,
    LOAD_CUTOFF,
    RAISE,
    WEIGHING,
    Belief,
    BoxEstimate,
)
from stages.trajectory import Array

DT = 0.004
L = 0.3
HIGH = 2.0 * CLEAR
CYCLES = math.ceil(WEIGHING / DT)
"""For which a box is weighed."""

loads = st.tuples(st.floats(-2.0, 20.0), st.floats(-2.0, 20.0))
seeds = st.integers(0, 2**32 - 1)


def estimate(**belief: object) -> BoxEstimate:
    return BoxEstimate(Belief(**belief), L, DT)  # type: ignore[arg-type]


def felt(one: BoxEstimate, load: tuple[float, float]) -> None:
    """Let the low-pass settle on a load, N, on the support."""
    for _ in range(500):
        one.weigh(np.array(load), 0.0, calm=True)


def weighed(mass: float, **belief: object) -> BoxEstimate:
    """A box of so many kg, weighed: what hangs on it is felt by both wrists, not alike."""
    one = estimate(**belief)
    load = (0.7 * mass * GRAVITY, 0.3 * mass * GRAVITY)
    felt(one, load)
    for _ in range(CYCLES + 1):
        one.weigh(np.array(load), HIGH, calm=True)
    return one


# Mass.


def test_the_mass_by_hand() -> None:
    # 3 N and 6.81 N hang on the wrists: 9.81 N are 1 kg.
    one = estimate()
    felt(one, (3.0, 6.81))
    found = []
    for _ in range(CYCLES + 1):
        one.weigh(np.array([3.0, 6.81]), HIGH, calm=True)
        found.append(one.mass)
    assert np.isnan(found[: CYCLES - 1]).all()  # not before 0.3 s have passed
    assert found[-1] == pytest.approx(1.0, rel=1e-12)


def test_the_low_pass_by_hand() -> None:
    # The box is clear at once, and its load comes through the low-pass: the mean of 1 - exp(-k c) over the cycles.
    one, share = estimate(), 2.0 * math.pi * LOAD_CUTOFF * DT
    cycles = 0
    while math.isnan(one.mass):
        one.weigh(np.array([4.0, 6.0]), HIGH, calm=True)
        cycles += 1
    assert cycles in (CYCLES, CYCLES + 1)  # whichever side the sum of 75 times 4 ms rounds to
    mean = float(np.mean([1.0 - math.exp(-k * share) for k in range(1, cycles + 1)]))
    assert one.mass == pytest.approx(10.0 * mean / GRAVITY, rel=1e-12)


@given(loads)
def test_the_mass_is_what_both_wrists_feel_together(load: tuple[float, float]) -> None:
    one = estimate()
    felt(one, load)
    for _ in range(CYCLES + 1):
        one.weigh(np.array(load), HIGH, calm=True)
    assert one.mass * GRAVITY == pytest.approx(sum(load), abs=1e-9)
    kept = one.mass
    for _ in range(100):
        one.weigh(np.array([50.0, 50.0]), HIGH, calm=True)
    assert one.mass == kept  # it is weighed once


@given(st.lists(st.tuples(st.floats(0.0, 0.02), st.booleans()), min_size=1, max_size=200))
def test_it_is_not_weighed_before_it_has_hung_clear_and_calm(moments: list[tuple[float, bool]]) -> None:
    one, hung = estimate(), 0
    for height, calm in moments:
        one.weigh(np.array([5.0, 5.0]), height, calm=calm)
        hung += calm and height >= CLEAR
        assert math.isnan(one.mass) or hung >= CYCLES
        assert not math.isnan(one.mass) or hung <= CYCLES
        assert not one.gone


def test_what_speeds_a_box_up_is_no_weight() -> None:
    # 2 kg that rise ever faster, by 1 m/s^2, weigh 2 (g + 1) N; the change of their velocity tells them apart.
    one, blind, cycles = estimate(), estimate(), 0
    load = np.array([1.0, 1.0]) * (GRAVITY + 1.0)
    for each in (one, blind):
        felt(each, (GRAVITY + 1.0, GRAVITY + 1.0))
    while math.isnan(one.mass):
        one.weigh(load, HIGH, calm=True, rise=0.3 + cycles * DT)
        blind.weigh(load, HIGH, calm=True)
        cycles += 1
    assert one.mass == pytest.approx(2.0, rel=2.0 / (GRAVITY * cycles))  # but for one cycle of the speeding up
    assert blind.mass == pytest.approx(2.0 * (1.0 + 1.0 / GRAVITY), rel=1e-12)
    # At an even speed nothing is changed.
    even = estimate()
    felt(even, (3.0, 4.0))
    for _ in range(cycles):
        even.weigh(np.array([3.0, 4.0]), HIGH, calm=True, rise=-0.7)
    assert even.mass == pytest.approx(7.0 / GRAVITY, rel=1e-12)


def test_a_push_while_it_is_weighed_is_left_out() -> None:
    # What a person hangs on an arm is no part of the box; the quiet parts count together.
    one = estimate()
    felt(one, (4.0, 4.0))
    for _ in range(40):
        one.weigh(np.array([4.0, 4.0]), HIGH, calm=True)
    for _ in range(100):
        one.weigh(np.array([34.0, 4.0]), HIGH, calm=False)
    for _ in range(500):
        one.weigh(np.array([4.0, 4.0]), 0.0, calm=True)
    assert math.isnan(one.mass)
    for _ in range(36):
        one.weigh(np.array([4.0, 4.0]), HIGH, calm=True)
    assert one.mass == pytest.approx(8.0 / GRAVITY, rel=1e-9)


def test_a_box_is_gone_where_less_than_a_fifth_of_it_hangs_on_the_wrists() -> None:
    unknown = estimate()
    felt(unknown, (0.0, 0.0))
    assert not unknown.gone  # nothing is known yet
    for share, gone in ((1.01 * GONE, False), (0.99 * GONE, True), (1.0, False)):
        one = weighed(2.0)
        assert not one.gone
        felt(one, (share * 2.0 * GRAVITY, 0.0))
        assert one.gone == gone
    # It falls: the low-pass takes ln 5 of its time constant to say so, 51 ms.
    one, cycles = weighed(2.0), 0
    while not one.gone:
        one.weigh(np.zeros(2), HIGH, calm=True)
        cycles += 1
    assert cycles * DT == pytest.approx(math.log(5.0) / (2.0 * math.pi * LOAD_CUTOFF), abs=DT)


# Force.


def test_the_force_that_a_box_needs_by_hand() -> None:
    # 1.7 * 1.2 kg * 9.81/(2 * 0.5) = 20.0124 N.
    one = weighed(1.2, friction=0.5)
    cycles = math.floor(15.0124 / (RAISE * DT))
    for k in range(1, cycles + 1):
        assert one.firm(5.0) == pytest.approx(5.0 + k * RAISE * DT, rel=1e-9)
    for _ in range(10):
        assert one.firm(5.0) == pytest.approx(20.0124, rel=1e-9)


@given(st.floats(0.05, 5.0), st.floats(0.1, 1.5), st.floats(1.0, 20.0))
def test_the_force_rises_slowly_to_what_is_needed_and_is_never_lowered(
    mass: float, friction: float, desired: float
) -> None:
    one = weighed(mass, friction=friction)
    needed = max(FIRM * mass * GRAVITY / (2.0 * friction), desired)
    forces = [desired]
    for _ in range(math.ceil((needed - desired) / (RAISE * DT)) + 2):
        forces.append(one.firm(desired))
    steps = np.diff(forces)
    assert (steps >= 0.0).all()
    assert (steps <= RAISE * DT * (1.0 + 1e-9)).all()
    assert forces[-1] == pytest.approx(needed, rel=1e-9)
    assert min(forces) == desired


def test_where_nothing_is_known_the_force_stays() -> None:
    for one in (weighed(3.0), weighed(3.0, friction=0.5, finds_mass=False), estimate(friction=0.5)):
        for _ in range(100):
            assert one.firm(5.0) == 5.0


# What is fed forward.


@given(loads, st.floats(0.0, 5.0))
def test_what_is_fed_forward_is_what_is_felt_or_what_is_believed(load: tuple[float, float], mass: float) -> None:
    felt_ = np.array(load)
    assert estimate().payload(felt_, True).tolist() == list(load)
    assert estimate().payload(felt_, False).tolist() == list(load)
    granted = estimate(finds_mass=False, mass=mass)
    assert granted.payload(felt_, True) == pytest.approx(0.5 * mass * GRAVITY, rel=1e-12)
    assert granted.payload(felt_, False).tolist() == [0.0, 0.0]


# Length.


def test_the_length_by_hand() -> None:
    # Taken for 0.3 m; the pads stand 0.28 m apart: 10 mm of what was the length are offsets of each arm now.
    one = estimate(finds_length=True)
    assert one.measures_length
    assert one.span(np.array([[0.5, 0.14, 0.4], [0.6, -0.14, 0.3]])) == pytest.approx(0.01, abs=1e-15)
    assert one.length == pytest.approx(0.28, abs=1e-15)


@given(seeds, st.floats(-0.05, 0.05))
def test_the_commanded_places_of_the_pads_stay(seed: int, wrong: float) -> None:
    def commanded(offsets: Array, length: float) -> Array:
        return np.asarray(offsets + 0.5 * length)

    generator = np.random.default_rng(seed)
    one, offsets = estimate(finds_length=True), 0.01 * generator.normal(size=2)
    pads = generator.normal(size=(2, 3))
    pads[0, 1] = pads[1, 1] + L + wrong
    before = commanded(offsets, one.length)
    offsets = offsets + one.span(pads)
    assert commanded(offsets, one.length) == pytest.approx(before, abs=1e-15)
    assert one.length == pytest.approx(L + wrong, abs=1e-12)
    # Where it is known by now, nothing moves.
    assert one.span(pads) == 0.0


def test_a_length_that_is_taken_for_granted_stays() -> None:
    one = BoxEstimate(KNOWN, L, DT)
    assert not one.measures_length
    assert one.span(np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])) == 0.0
    assert one.length == L
