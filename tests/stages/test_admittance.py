"""Variable-stiffness admittance: eqs. (15)-(17) by hand, where it settles, when it is stable, what leaks away."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pipeline.errors import ParameterError
from stages.policy.admittance import (
    ERROR,
    FORCE,
    OFFSET,
    RATE,
    Admittance,
    admittance_of,
    begin,
    check_stability,
    comply,
    leak,
    sense,
    settled_force,
)
from stages.policy.parameters import AdmittanceParameters
from stages.trajectory import Array

DT = 0.004
AT_ONCE = math.inf
"""Hz: the low-pass lets everything through."""

seeds = st.integers(0, 2**32 - 1)
numbers = st.floats(-10.0, 10.0)


def chosen(**changed: Any) -> Admittance:
    return admittance_of(AdmittanceParameters(), printed=False)._replace(**changed)


def states(left: tuple[float, ...], right: tuple[float, ...]) -> Array:
    return np.array([left, right])


def press(admittance: Admittance, stiffness: float, seconds: float, bias: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Each arm on a spring of its own, N/m, that is relaxed at y = 0; the state at the end."""
    state = states((0.0, 0.0, 0.0, -admittance.force), (0.0, 0.0, 0.0, -admittance.force))
    for _ in range(round(seconds / DT)):
        sense(admittance, np.maximum(-stiffness * state[:, OFFSET], 0.0) + bias, DT, state)
        comply(admittance, DT, state)
    return state


def test_two_steps_as_printed_by_hand() -> None:
    printed = chosen(printed=True, leak=0.0, force=5.0, k_p=25.0, k_d=2.0, mass=20.0, damping=2000.0)
    state = states((0.05, 0.01, 6.0, 0.5), (0.02, 0.0, 4.5, -0.5))
    comply(printed, DT, state)
    # Left: 26 * 1 + 2 * (1 - 0.5)/0.004 + 5 - 2000 * 0.01 = 261; right: 26 * -0.5 + 0 + 5 - 0 = -8; over M = 20.
    assert state[0] == pytest.approx([0.05 + DT * 0.0622, 0.01 + DT * 13.05, 6.0, 1.0], abs=1e-15)
    assert state[1] == pytest.approx([0.02 - DT * 0.0016, -DT * 0.4, 4.5, -0.5], abs=1e-15)
    comply(printed, DT, state)
    # The forces have not changed. Left: 26 + 5 - 2000 * 0.0622 = -93.4; right: -13 + 5 + 2000 * 0.0016 = -4.8.
    assert state[0, RATE] == pytest.approx(0.0622 - DT * 4.67, abs=1e-15)
    assert state[1, RATE] == pytest.approx(-0.0016 - DT * 0.24, abs=1e-15)
    assert state[0, OFFSET] == pytest.approx(0.05 + DT * (0.0622 + 0.04352), abs=1e-15)
    assert state[1, OFFSET] == pytest.approx(0.02 - DT * (0.0016 + 0.00256), abs=1e-15)


def test_two_robust_steps_by_hand() -> None:
    robust = chosen(leak=0.0, force=5.0, k_p=25.0, k_d=2.0, mass=20.0, damping=2000.0)
    state = states((0.05, 0.014, 6.0, 0.5), (0.02, 0.0, 4.5, -0.5))
    comply(robust, DT, state)
    # Left: (0.014 + 0.004 * (26 + 250)/20)/(1 + 0.004 * 100); right: 0.004 * -13/20/1.4.
    left, right = (0.014 + 0.0552) / 1.4, -0.0026 / 1.4
    assert state[0] == pytest.approx([0.05 + DT * left, left, 6.0, 1.0], abs=1e-15)
    assert state[1] == pytest.approx([0.02 + DT * right, right, 4.5, -0.5], abs=1e-15)
    comply(robust, DT, state)
    left_then, right_then = (left + 0.0052) / 1.4, (right - 0.0026) / 1.4
    assert state[0, RATE] == pytest.approx(left_then, abs=1e-15)
    assert state[1, RATE] == pytest.approx(right_then, abs=1e-15)
    assert state[0, OFFSET] == pytest.approx(0.05 + DT * (left + left_then), abs=1e-15)
    assert state[1, OFFSET] == pytest.approx(0.02 + DT * (right + right_then), abs=1e-15)


def test_at_the_desired_force_the_robust_form_rests_and_the_printed_one_moves_out() -> None:
    resting = states((0.01, 0.0, 5.0, 0.0), (0.01, 0.0, 5.0, 0.0))
    comply(chosen(), DT, resting)
    assert resting[:, RATE].tolist() == [0.0, 0.0]
    biased = states((0.01, 0.0, 5.0, 0.0), (0.01, 0.0, 5.0, 0.0))
    comply(chosen(printed=True, leak=0.0), DT, biased)
    assert biased[:, RATE] == pytest.approx(DT * 5.0 / 20.0, rel=1e-12)


@pytest.mark.parametrize(("printed", "settles"), [(True, 5.0 * 25.0 / 26.0), (False, 5.0)])
@pytest.mark.parametrize("stiffness", [500.0, 1500.0])
def test_against_a_spring_the_printed_law_settles_at_4_808_newtons(
    printed: bool, settles: float, stiffness: float
) -> None:
    state = press(admittance_of(AdmittanceParameters(), printed=printed), stiffness, 10.0)
    assert state[:, FORCE] == pytest.approx(settles, abs=1e-4)
    assert -stiffness * state[:, OFFSET] == pytest.approx(settles, abs=1e-4)


def test_where_the_printed_law_settles() -> None:
    assert settled_force(5.0, 25.0) == pytest.approx(4.8077, abs=5e-5)
    assert settled_force(8.0, 3.0) == 6.0


def spectral_radius(admittance: Admittance, stiffness: float, dt: float) -> float:
    """Of one cycle against a spring without lag: the affine map that one step of the left arm is, column by column."""

    def cycle(y: float, rate: float, error: float) -> Array:
        # The force is let go below zero: a spring that also pulls, so that the map is affine.
        state = np.zeros((2, 4))
        state[0] = y, rate, -stiffness * y, error
        comply(admittance, dt, state)
        return state[0, [OFFSET, RATE, ERROR]]

    rest = cycle(0.0, 0.0, 0.0)
    columns = [cycle(*unit) - rest for unit in np.eye(3)]
    return float(np.abs(np.linalg.eigvals(np.array(columns).T)).max())


@given(
    k_p=st.floats(1.0, 100.0),
    k_d=st.floats(0.0, 5.0),
    damping=st.floats(100.0, 5000.0),
    mass=st.floats(1.0, 50.0),
    stiffness=st.floats(100.0, 5000.0),
    dt=st.floats(0.001, 0.01),
)
def test_against_a_spring_it_is_stable_exactly_where_the_condition_holds(
    k_p: float, k_d: float, damping: float, mass: float, stiffness: float, dt: float
) -> None:
    printed = chosen(printed=True, leak=0.0, k_p=k_p, k_d=k_d, damping=damping, mass=mass)
    robust = printed._replace(printed=False)
    used = (2.0 * dt * (damping + k_d * stiffness) + dt * dt * (k_p + 1.0) * stiffness) / (4.0 * mass)
    assume(abs(used - 1.0) > 1e-3)
    assert (spectral_radius(printed, stiffness, dt) < 1.0) == (used < 1.0)
    # Damping at the end of the step gives room: 2 D dt goes to the other side.
    room = (2.0 * dt * k_d * stiffness + dt * dt * (k_p + 1.0) * stiffness) / (4.0 * mass + 2.0 * dt * damping)
    assume(abs(room - 1.0) > 1e-3)
    assert (spectral_radius(robust, stiffness, dt) < 1.0) == (room < 1.0)


@given(printed=st.booleans(), left=st.tuples(*[numbers] * 4), right=st.tuples(*[numbers] * 4), measured=seeds)
def test_the_arms_are_mirror_images(
    printed: bool, left: tuple[float, ...], right: tuple[float, ...], measured: int
) -> None:
    admittance = admittance_of(AdmittanceParameters(), printed=printed)
    here, there = states(left, right), states(right, left)
    for force in np.random.default_rng(measured).normal(5.0, 2.0, (5, 2)):
        for state, felt in ((here, force), (there, force[::-1].copy())):
            sense(admittance, felt, DT, state)
            comply(admittance, DT, state)
    # In the leak the arms' roles differ by a rounding.
    assert here[::-1] == pytest.approx(there, rel=1e-12, abs=1e-12)


def test_what_both_arms_share_leaks_away_by_hand() -> None:
    leaky = chosen(leak=2.0)
    state = states((0.03, 0.0, 5.0, 0.0), (0.01, 0.0, 5.0, 0.0))
    comply(leaky, 0.1, state)
    gone = 0.01 * (1.0 - math.exp(-0.2))  # both 10 mm to the left
    assert state[:, OFFSET] == pytest.approx([0.03 - gone, 0.01 + gone], abs=1e-15)


def test_the_leak_alone_by_hand() -> None:
    state = states((0.03, 0.1, 6.0, 0.5), (0.01, -0.2, 4.0, -0.5))
    leak(chosen(leak=2.0), 0.1, state)
    gone = 0.01 * (1.0 - math.exp(-0.2))  # both 10 mm to the left
    assert state[:, OFFSET] == pytest.approx([0.03 - gone, 0.01 + gone], abs=1e-16)
    # No force and no rate takes part.
    assert state[:, [RATE, FORCE, ERROR]].tolist() == [[0.1, 6.0, 0.5], [-0.2, 4.0, -0.5]]
    still = states((0.03, 0.1, 6.0, 0.5), (0.01, -0.2, 4.0, -0.5))
    leak(chosen(leak=0.0), 0.1, still)
    assert still.tolist() == [[0.03, 0.1, 6.0, 0.5], [0.01, -0.2, 4.0, -0.5]]


@given(left=st.floats(-0.05, 0.05), right=st.floats(-0.05, 0.05), rate=st.floats(0.0, 20.0), dt=st.floats(1e-4, 0.5))
def test_of_a_leak_the_shared_part_fades_and_the_difference_stays(
    left: float, right: float, rate: float, dt: float
) -> None:
    state = states((left, 0.0, 0.0, 0.0), (right, 0.0, 0.0, 0.0))
    for _ in range(5):
        leak(chosen(leak=rate), dt, state)
    # The pads stand at y of the left and at -y of the right one: how far they are apart is the sum.
    assert state[:, OFFSET].sum() == pytest.approx(left + right, abs=1e-15)
    shared = 0.5 * (left - right) * math.exp(-5.0 * rate * dt)
    assert 0.5 * (state[0, OFFSET] - state[1, OFFSET]) == pytest.approx(shared, abs=1e-15)


@given(printed=st.booleans(), left=st.tuples(*[numbers] * 4), right=st.tuples(*[numbers] * 4))
def test_to_comply_is_to_press_and_then_to_leak(
    printed: bool, left: tuple[float, ...], right: tuple[float, ...]
) -> None:
    admittance = admittance_of(AdmittanceParameters(), printed=printed)
    once, twice = states(left, right), states(left, right)
    comply(admittance, DT, once)
    comply(admittance._replace(leak=0.0), DT, twice)
    leak(admittance, DT, twice)
    assert once.tobytes() == twice.tobytes()


@given(pressed=st.floats(-0.02, 0.02), shared=st.floats(-0.02, 0.02))
def test_how_far_the_arms_are_apart_does_not_leak(pressed: float, shared: float) -> None:
    state = states((pressed + shared, 0.0, 5.0, 0.0), (pressed - shared, 0.0, 5.0, 0.0))
    for _ in range(10):
        comply(chosen(leak=2.0), DT, state)
    assert state[:, OFFSET].sum() == pytest.approx(2.0 * pressed, abs=1e-15)
    assert 0.5 * (state[0, OFFSET] - state[1, OFFSET]) == pytest.approx(shared * math.exp(-20.0 * DT), abs=1e-15)


def test_a_sensors_bias_drives_the_box_away_unless_it_leaks() -> None:
    # Between two pads a free box takes the same force from both: only what the arms share sees a difference of biases.
    def carried(leak: float) -> float:
        admittance = chosen(leak=leak)
        state = states((-0.005, 0.0, 5.0, 0.0), (-0.005, 0.0, 5.0, 0.0))
        for _ in range(round(10.0 / DT)):
            force = max(-1000.0 * 0.5 * state[:, OFFSET].sum(), 0.0)
            sense(admittance, np.array([force + 0.3, force]), DT, state)
            comply(admittance, DT, state)
        return float(0.5 * (state[0, OFFSET] - state[1, OFFSET]))

    speed = 26.0 * 0.15 / 2000.0  # (k_p + 1) of half of the bias over D, m/s
    assert carried(0.0) == pytest.approx(10.0 * speed, rel=0.01)
    assert carried(2.0) == pytest.approx(speed / 2.0, rel=0.01)


def test_the_low_pass_by_hand() -> None:
    admittance, state = chosen(cutoff=10.0), np.zeros((2, 4))
    for _ in range(3):
        sense(admittance, np.array([5.0, -1.0]), DT, state)
    risen = 1.0 - math.exp(-3.0 * 2.0 * math.pi * 10.0 * DT)
    assert state[:, FORCE] == pytest.approx([5.0 * risen, -risen], rel=1e-14)
    assert not state[:, [OFFSET, RATE, ERROR]].any()
    sense(chosen(cutoff=AT_ONCE), np.array([2.0, 3.0]), DT, state)
    assert state[:, FORCE] == pytest.approx([2.0, 3.0], rel=1e-15)


def test_it_begins_without_a_kick() -> None:
    admittance = chosen(leak=0.0)
    kicked = states((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 1.0, 0.0))
    calm = kicked.copy()
    begin(admittance, calm)
    assert calm[:, ERROR].tolist() == [-4.0, -4.0]
    comply(admittance, DT, calm)
    comply(admittance, DT, kicked)
    assert calm[:, RATE] == pytest.approx(DT * 26.0 * -4.0 / 20.0 / 1.4, rel=1e-14)
    assert (np.abs(kicked[:, RATE]) > 10.0 * np.abs(calm[:, RATE])).all()


def test_only_the_robust_form_leaks() -> None:
    given_ = AdmittanceParameters(force=4.0, k_p=20.0, k_d=1.0, mass=10.0, damping=500.0, cutoff=5.0, leak=3.0)
    assert admittance_of(given_, printed=False) == Admittance(10.0, 500.0, 20.0, 1.0, 4.0, False, 3.0, 5.0)
    assert admittance_of(given_, printed=True) == Admittance(10.0, 500.0, 20.0, 1.0, 4.0, True, 0.0, 5.0)


@pytest.mark.parametrize(
    ("given_", "dt", "printed"),
    [
        (AdmittanceParameters(), 0.01, True),
        (AdmittanceParameters(damping=20000.0), 0.004, True),
        (AdmittanceParameters(k_d=200.0), 0.004, False),
        (AdmittanceParameters(), 0.5, False),
    ],
)
def test_gains_that_oscillate_are_refused_before_anything_moves(
    given_: AdmittanceParameters, dt: float, printed: bool
) -> None:
    with pytest.raises(ParameterError, match="oscillate") as error:
        check_stability(given_, dt, 1500.0, printed=printed, location="rollout.admittance")
    assert error.value.location == "rollout.admittance.mass"


def test_the_defaults_are_stable_and_the_condition_is_that_of_the_notes() -> None:
    for printed in (True, False):
        check_stability(AdmittanceParameters(), 0.004, 1500.0, printed=printed, location="x")
    # 2 dt (D + k_d k) + dt^2 (k_p + 1) k = 0.008 (2000 + 3000) + 16e-6 x 26 x 1500 = 40.624 < 4 M.
    check_stability(AdmittanceParameters(mass=10.157), 0.004, 1500.0, printed=True, location="x")
    with pytest.raises(ParameterError):
        check_stability(AdmittanceParameters(mass=10.155), 0.004, 1500.0, printed=True, location="x")
