"""One box carried between two springs: phases, the pads' places by eq. (13), what counts as missed and as lost."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.policy.admittance import admittance_of
from stages.policy.carrying import ENDED, LOST_TIME, REST, SET_DOWN_DEPTH, TOO_DEEP, Carrier, Clamp, Phase
from stages.policy.estimation import Belief
from stages.policy.parameters import AdmittanceParameters
from stages.trajectory import Array

DT = 0.004
L = 0.3
START = np.array([0.45, -0.15, 0.35])
STEP = np.array([0.0004, 0.0002, 0.0001])
"""Metres a cycle, of the way."""
STIFFNESS = 1500.0
SIDES = np.array([1.0, -1.0])
COMPLIANT = admittance_of(AdmittanceParameters(), printed=False)

PHASES = [Phase.APPROACH, Phase.GRIP, Phase.CARRY, Phase.SET_DOWN, Phase.RELEASE, Phase.DONE]

seeds = st.integers(0, 2**32 - 1)
Forces = Callable[[Carrier], Array]


class Straight:
    """A way along `STEP`, of so many cycles."""

    def __init__(self, cycles: int) -> None:
        self.left = cycles

    def step(self, midpoint: Array, *, return_speed: float | None) -> Array:
        assert return_speed is None  # nobody is pushed
        self.left -= 1
        return midpoint + STEP

    @property
    def ended(self) -> bool:
        return self.left <= 0

    def gap(self, midpoint: Array) -> float:
        return 0.0


def spring(carrier: Carrier, length: float = L, stiffness: float = STIFFNESS) -> Array:
    """What a box that is where the midpoint is presses back with, N, each face a spring."""
    outside = SIDES * (carrier.pads[:, 1] - carrier.midpoint[1])
    return np.asarray(stiffness * np.maximum(0.5 * length - outside, 0.0))


def nothing(carrier: Carrier) -> Array:
    return np.zeros(2)


def clamp(**changed: Any) -> Clamp:
    given_: dict[str, Any] = {
        "length": L,
        "admittance": COMPLIANT,
        "squeeze": 0.002,
        "stand_off": 0.05,
        "approach_speed": 0.05,
        "release_speed": 0.05,
    }
    return Clamp(**(given_ | changed))


def carrier(cycles: int = 100, **changed: Any) -> Carrier:
    return Carrier(Straight(cycles), START, clamp(**changed), DT, 5.0)


def run(one: Carrier, forces: Forces = spring, longest: float = 20.0) -> Iterator[Phase]:
    """Phases, one a cycle; the forces of a cycle are those at the places of the one before."""
    for _ in range(round(longest / DT)):
        one.step(forces(one))
        yield one.phase
        if one.phase in ENDED:
            return


def until(phase: Phase, one: Carrier, forces: Forces = spring) -> None:
    assert phase in run(one, forces), one.phase


def test_pads_begin_at_the_stand_off_by_hand() -> None:
    one = carrier()
    assert one.pads == pytest.approx(np.array([[0.45, 0.05, 0.35], [0.45, -0.35, 0.35]]), abs=1e-15)  # -.15 +- .2
    assert one.velocities.tolist() == [[0.0] * 3] * 2
    assert one.phase is Phase.APPROACH


def test_a_box_is_approached_gripped_carried_set_down_and_let_go() -> None:
    one = carrier()
    passed = [(phase, one.forces, one.midpoint.copy()) for phase in run(one)]
    assert list(dict.fromkeys(phase for phase, *_ in passed)) == PHASES
    lasted = {phase: sum(phase is p for p, *_ in passed) * DT for phase in PHASES}
    # From 50 mm before the face at 50 mm/s, then into a spring of which 1 N is 0.7 mm.
    assert 1.0 <= lasted[Phase.APPROACH] <= 1.1
    assert 0.5 <= lasted[Phase.GRIP] <= 2.0
    assert lasted[Phase.CARRY] == pytest.approx(100 * DT, abs=DT / 2)
    assert lasted[Phase.SET_DOWN] == pytest.approx(SET_DOWN_DEPTH / 0.02 + REST, abs=2.5 * DT)
    # From 3.3 mm inside to the stand-off.
    assert lasted[Phase.RELEASE] == pytest.approx((0.05 + 5.0 / STIFFNESS) / 0.05, abs=0.02)
    carried = np.array([force for phase, force, _ in passed if phase is Phase.CARRY])
    assert np.abs(carried - 5.0).max() < 0.1
    end = START + 100 * STEP
    assert one.midpoint[:2] == pytest.approx(end[:2], abs=1e-12)
    assert end[2] - one.midpoint[2] == pytest.approx(SET_DOWN_DEPTH, abs=1.01 * DT * 0.02)


def test_places_of_the_pads_by_equation_13_at_every_cycle() -> None:
    one = carrier()
    seen = set()
    for phase in run(one):
        seen.add(phase)
        left, right = one.offsets
        assert one.pads[0] - one.pads[1] == pytest.approx([0.0, L + left + right, 0.0], abs=1e-14)
        assert one.pads.mean(axis=0) - one.midpoint == pytest.approx([0.0, 0.5 * (left - right), 0.0], abs=1e-14)
    assert seen == set(PHASES)


def test_the_ways_velocity_is_fed_forward() -> None:
    one = carrier()
    until(Phase.CARRY, one)
    for _ in range(5):
        before = one.pads.copy()
        one.step(spring(one))
        assert one.velocities[:, [0, 2]] == pytest.approx(np.tile(STEP[[0, 2]] / DT, (2, 1)), rel=1e-10)
        assert one.velocities.mean(axis=0) == pytest.approx(STEP / DT, rel=1e-6)  # 0.1, 0.05, 0.025 m/s
        # What the admittance does comes on top; as both pads are pressed alike, nothing leaks.
        assert one.pads - before == pytest.approx(DT * one.velocities, abs=1e-12)


def test_velocities_are_those_of_the_pads_on_the_way_in_and_out() -> None:
    one = carrier()
    for wanted, inwards in ((Phase.APPROACH, 0.05), (Phase.RELEASE, -0.05)):
        if one.phase is not wanted:
            until(wanted, one)
        before = one.pads.copy()
        one.step(spring(one))
        assert one.velocities == pytest.approx(np.outer(SIDES, [0.0, -inwards, 0.0]), abs=1e-15)
        assert one.pads - before == pytest.approx(DT * one.velocities, abs=1e-15)


def test_each_pad_waits_at_its_face_for_the_other() -> None:
    faces = np.array([0.02, -0.01])
    one = carrier(admittance=COMPLIANT._replace(cutoff=math.inf))
    until(Phase.GRIP, one, lambda c: np.where(c.offsets < faces, 10.0, 0.0))
    assert (one.offsets < faces).all()
    assert (one.offsets > faces - 1.01 * DT * 0.05).all()


def test_the_grip_begins_without_a_kick() -> None:
    one = carrier()
    until(Phase.GRIP, one)
    one.step(spring(one))
    # (k_p + 1) 4 N, for one cycle, on M = 20 kg and D = 2000 N s/m; k_d 4 N/dt would make 0.3 m/s of it.
    assert np.abs(one.velocities[:, 1]).max() <= DT * 26.0 * 4.0 / 20.0 / 1.4 * 1.2


def test_pads_that_meet_nothing_have_missed() -> None:
    one = carrier()
    assert list(dict.fromkeys(run(one, nothing))) == [Phase.APPROACH, Phase.MISSED]
    assert one.offsets == pytest.approx(-TOO_DEEP, abs=1.01 * DT * 0.05)


def test_a_pad_that_alone_meets_something_has_missed() -> None:
    one = carrier()
    assert list(run(one, lambda c: spring(c) * [1.0, 0.0]))[-1] is Phase.MISSED
    assert one.offsets[0] > -0.002


def test_a_force_that_never_settles_is_no_grip() -> None:
    one = carrier()
    cycle = itertools.count()

    def trembling(c: Carrier) -> Array:
        return np.full(2, 5.0 + (4.0 if next(cycle) // 25 % 2 else -3.0)) * (spring(c) > 0.0)

    passed = list(run(one, trembling))
    assert passed[-1] is Phase.MISSED
    assert sum(p is Phase.GRIP for p in passed) * DT == pytest.approx(5.0, abs=2 * DT)


@pytest.mark.parametrize("gone", [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
def test_a_box_without_contact_for_a_fifth_of_a_second_is_lost(gone: list[float]) -> None:
    one = carrier(cycles=10_000, admittance=COMPLIANT._replace(cutoff=math.inf))
    until(Phase.CARRY, one)
    passed = list(run(one, lambda c: spring(c) * gone))
    assert passed[-1] is Phase.LOST
    assert abs(len(passed) - round(LOST_TIME / DT)) <= 1


def test_a_box_that_is_felt_again_in_time_is_not_lost() -> None:
    one = carrier(cycles=10_000, admittance=COMPLIANT._replace(cutoff=math.inf))
    until(Phase.CARRY, one)
    cycle = itertools.count()
    # Gone for 0.18 s, there for 0.02 s, again and again.
    passed = list(run(one, lambda c: np.full(2, 0.0 if next(cycle) % 50 < 45 else 5.0), longest=2.0))
    assert set(passed) == {Phase.CARRY}


@given(length=st.floats(-0.006, 0.002), noise=seeds)
@settings(max_examples=20, deadline=None)
def test_without_compliance_pads_stay_where_they_are_put(length: float, noise: int) -> None:
    generator = np.random.default_rng(noise)
    one = carrier(cycles=20, admittance=None, squeeze=0.006)
    places = []
    for phase in run(one, lambda c: spring(c, L + length) + generator.normal(0.0, 0.3, 2)):
        if phase in (Phase.GRIP, Phase.CARRY, Phase.SET_DOWN):
            places.append(one.offsets)
            assert one.velocities[:, 1] == pytest.approx(STEP[1] / DT * (one.velocities[0, 0] != 0.0), rel=1e-9)
    assert one.phase is Phase.DONE
    assert np.ptp(places, axis=0).tolist() == [0.0, 0.0]
    assert -0.006 - 1.01 * DT * 0.05 <= places[0].min() <= places[0].max() <= -0.006


def test_without_compliance_and_without_a_box_it_is_lost() -> None:
    one = carrier(admittance=None)
    assert list(dict.fromkeys(run(one, nothing))) == [Phase.APPROACH, Phase.GRIP, Phase.CARRY, Phase.LOST]
    assert one.offsets == pytest.approx(-0.002, abs=1.01 * DT * 0.05)


FOLLOWED_BY = {
    Phase.APPROACH: {Phase.GRIP, Phase.MISSED},
    Phase.GRIP: {Phase.CARRY, Phase.MISSED},
    Phase.CARRY: {Phase.SET_DOWN, Phase.LOST},
    Phase.SET_DOWN: {Phase.RELEASE},
    Phase.RELEASE: {Phase.DONE},
}


@given(
    noise=seeds,
    spread=st.floats(0.0, 5.0),
    stiffness=st.floats(200.0, 3000.0),
    length=st.floats(0.2, 0.34),
    speed=st.floats(0.01, 0.2),
    cycles=st.integers(1, 30),
    compliant=st.booleans(),
)
@settings(max_examples=30, deadline=None)
def test_phases_come_in_order_and_no_pad_is_faster_than_the_approach(
    noise: int, spread: float, stiffness: float, length: float, speed: float, cycles: int, compliant: bool
) -> None:
    generator = np.random.default_rng(noise)
    changed: dict[str, Any] = {} if compliant else {"admittance": None}
    one = carrier(cycles, approach_speed=speed, **changed)
    before, places = one.phase, one.pads.copy()
    for phase in run(one, lambda c: spring(c, length, stiffness) + spread * generator.normal(size=2), longest=30.0):
        assert phase is before or phase in FOLLOWED_BY[before]
        if before is Phase.APPROACH:
            moved = one.pads - places
            assert np.abs(moved).max() <= DT * speed * (1.0 + 1e-9)
            assert (SIDES * moved[:, 1] <= 0.0).all()
        before, places = phase, one.pads.copy()
    assert one.phase in ENDED


@given(measured=st.lists(st.tuples(st.floats(-20.0, 50.0), st.floats(-20.0, 50.0)), min_size=1, max_size=400))
@settings(max_examples=30, deadline=None)
def test_whatever_is_measured_the_midpoint_moves_along_the_way_only(measured: list[tuple[float, float]]) -> None:
    one = carrier(cycles=50)
    for pair in measured:
        phase, before = one.phase, one.midpoint.copy()
        if phase in ENDED:
            break
        one.step(np.array(pair))
        moved = one.midpoint - before
        if phase is Phase.CARRY:
            assert moved == pytest.approx(STEP, abs=1e-12)
        elif phase is Phase.SET_DOWN:
            assert moved[:2].tolist() == [0.0, 0.0]
            assert -1.01 * DT * 0.02 <= moved[2] <= 0.0
        else:
            assert not moved.any()


@pytest.mark.parametrize("phase", [Phase.APPROACH, Phase.GRIP, Phase.CARRY, Phase.SET_DOWN, Phase.RELEASE])
def test_stopped_pads_hold_still_whatever_is_measured(phase: Phase) -> None:
    one = carrier()
    if one.phase is not phase:
        until(phase, one)
    one.step(spring(one))
    one.stop()
    pads, midpoint = one.pads.copy(), one.midpoint.copy()
    for measured in (0.0, 5.0, 50.0):
        one.step(np.full(2, measured))
        assert one.phase is Phase.STOPPED
        assert one.pads.tolist() == pads.tolist()
        assert one.midpoint.tolist() == midpoint.tolist()
        assert not one.velocities.any()
    assert one.phase in ENDED


def test_what_is_felt_is_fed_forward_where_the_mass_is_found_out_and_else_what_is_believed() -> None:
    felt = np.array([2.0, -1.0])
    knows, believes = carrier(), carrier(belief=Belief(finds_mass=False, mass=0.4))
    assert knows.payload(felt).tolist() == [2.0, -1.0]
    assert believes.payload(felt).tolist() == [0.0, 0.0]  # it stands yet
    until(Phase.CARRY, believes)
    assert believes.payload(felt) == pytest.approx([1.962, 1.962], rel=1e-12)  # 0.4 * 9.81/2
    until(Phase.RELEASE, believes)
    assert believes.payload(felt).tolist() == [0.0, 0.0]
    assert knows.desired == believes.desired == 5.0


def test_forces_and_offsets_are_copies() -> None:
    one = carrier()
    one.forces[:] = one.offsets[:] = 7.0
    assert one.forces.tolist() == [0.0, 0.0]
    assert one.offsets.tolist() == [0.05, 0.05]
