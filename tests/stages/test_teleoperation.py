"""One master and two followers: eqs. (1)-(3), the low-pass, the workspace, silence of the master, what is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import DataError, ParameterError
from pipeline.validation import validate_as
from stages.teleoperation.mapping import Clutch, LowPass, MasterSample, Pads, SharedTeleoperation, rotation
from stages.teleoperation.parameters import MappingParameters

AT = "teleoperation.mapping"
L = 0.3
LOW, HIGH = (0.3, -0.6, 0.1), (0.8, 0.6, 0.8)
LEFT = np.array([0.5, 0.15, 0.4])
QUARTER_TURN = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""About z: the master's x is the arms' y."""
UNTURNED = (0.0, 0.0, 0.0, 1.0)
DT = 0.004

seeds = st.integers(0, 2**32 - 1)
scales = st.floats(0.05, 5.0)


def parameters(**changed: Any) -> MappingParameters:
    chosen: dict[str, Any] = {"separation": L, "low": LOW, "high": HIGH, "low_pass": math.inf}
    return MappingParameters(**(chosen | changed))


def endless(**changed: Any) -> MappingParameters:
    """Without a workspace that is felt."""
    return parameters(low=(-1e6,) * 3, high=(1e6,) * 3, **changed)


def said(time: float, position: Sequence[float] | np.ndarray, clutch: bool = True) -> MasterSample:
    return MasterSample(time, np.asarray(position), np.array(UNTURNED), clutch)


def turned(generator: np.random.Generator) -> tuple[float, ...]:
    q = generator.normal(size=4)
    return tuple(q / np.linalg.norm(q))


class Drive:
    """A mapping, and the time of its next tick."""

    def __init__(self, chosen: MappingParameters, left: Sequence[float] | np.ndarray = LEFT) -> None:
        self.mapping, self.time = SharedTeleoperation(chosen, left), 0.0

    def __call__(self, position: Sequence[float] | np.ndarray, clutch: bool = True) -> Pads:
        pads = self.mapping.step(self.time, said(self.time, position, clutch))
        self.time += DT
        return pads


def test_equations_1_to_4_by_hand() -> None:
    drive = Drive(parameters(alpha=2.0, R_mf=QUARTER_TURN))
    drive([0.1, 0.2, 0.3])
    pads = drive([0.11, 0.22, 0.33])  # (1): [.01, .02, .03]; (2): 2 [-.02, .01, .03]
    assert pads.left == pytest.approx([0.46, 0.17, 0.46], abs=1e-15)
    assert pads.right == pytest.approx([0.46, -0.13, 0.46], abs=1e-15)
    assert pads.midpoint == pytest.approx([0.46, 0.02, 0.46], abs=1e-15)
    assert drive.mapping.status is Clutch.ENGAGED
    drive([0.11, 0.22, 0.33], False)
    drive([0.0, 0.0, 0.0], False)
    drive([0.0, 0.0, 0.0])  # t_0 anew
    assert drive([0.0, 0.0, -0.02]).left == pytest.approx([0.46, 0.17, 0.42], abs=1e-15)


def test_a_rotation_is_nine_numbers_or_a_quaternion() -> None:
    half = math.sqrt(0.5)
    assert rotation((0.0, 0.0, half, half), AT) == pytest.approx(np.reshape(QUARTER_TURN, (3, 3)), abs=1e-15)
    # 120 degrees about [1, 1, 1]: x to y to z to x.
    assert (rotation((0.5, 0.5, 0.5, 0.5), AT) == [[0, 0, 1], [1, 0, 0], [0, 1, 0]]).all()
    assert (rotation(QUARTER_TURN, AT) == np.reshape(QUARTER_TURN, (3, 3))).all()


def test_the_low_pass_by_hand() -> None:
    rate = 2.0 * math.pi * 3.0 / math.sqrt(math.sqrt(2.0) - 1.0)
    low_pass = LowPass(3.0, np.array([1.0, 0.0]))
    low_pass.advance(np.zeros(2), 1.0 / rate)
    assert low_pass.value == pytest.approx([2.0 / math.e, 0.0], rel=1e-14)  # (1 + w t) exp(-w t)
    assert low_pass.slope == pytest.approx([-rate / math.e, 0.0], rel=1e-14)  # -w^2 t exp(-w t)


@pytest.mark.parametrize(("frequency", "gain"), [(3.0, math.sqrt(0.5)), (0.1, 0.99954), (10.0, 0.178479)])
def test_the_low_pass_halves_the_power_at_its_frequency(frequency: float, gain: float) -> None:
    dt, low_pass = 2e-4, LowPass(3.0, np.zeros(1))
    time = dt * np.arange(int(12.0 / dt))
    out = np.array([low_pass.advance(np.array([math.sin(2.0 * math.pi * frequency * t)]), dt)[0] for t in time])
    assert np.abs(out[time > 2.0]).max() == pytest.approx(gain, rel=1e-3)


@given(seeds, st.floats(0.1, 30.0), st.floats(1e-4, 1.0), st.integers(2, 6))
def test_the_low_pass_is_exact_whatever_the_tick(seed: int, frequency: float, dt: float, parts: int) -> None:
    start, first, second = np.random.default_rng(seed).normal(size=(3, 3))
    once, often = LowPass(frequency, start), LowPass(frequency, start)
    for to in (first, second):
        once.advance(to, dt)
        for _ in range(parts):
            often.advance(to, dt / parts)
        assert often.value == pytest.approx(once.value, abs=1e-12)
        assert often.slope == pytest.approx(once.slope, abs=1e-10 * frequency)


@given(st.floats(0.1, 30.0), st.lists(st.floats(1e-4, 0.1), min_size=1, max_size=30))
def test_the_low_pass_settles_from_rest_without_overshoot(frequency: float, steps: list[float]) -> None:
    low_pass, before = LowPass(frequency, np.zeros(1)), 0.0
    for dt in steps:
        now = float(low_pass.advance(np.ones(1), dt)[0])
        assert before <= now <= 1.0
        before = now
    assert low_pass.advance(np.ones(1), 100.0 / frequency) == pytest.approx(1.0, abs=1e-12)


@given(seeds, st.sampled_from([math.inf, 3.0, 0.1]), scales)
def test_nothing_jumps_when_the_clutch_is_pressed(seed: int, low_pass: float, alpha: float) -> None:
    generator = np.random.default_rng(seed)
    drive = Drive(parameters(alpha=alpha, low_pass=low_pass, R_mf=turned(generator)))
    for _ in range(5):
        before = drive.mapping.pads
        for _ in range(3):
            pads = drive(generator.normal(size=3), False)
            assert (pads.left == before.left).all()
        hand = generator.normal(size=3)
        for _ in range(3):
            pads = drive(hand)
            assert (pads.left == before.left).all()
            assert (pads.right == before.right).all()
        drive(hand + 0.01 * generator.normal(size=3))


@given(seeds, scales, st.integers(1, 6))
def test_strokes_add_up_to_the_engaged_increments(seed: int, alpha: float, strokes: int) -> None:
    generator = np.random.default_rng(seed)
    drive = Drive(endless(alpha=alpha, R_mf=turned(generator)))
    engaged = np.zeros(3)
    for _ in range(strokes):
        hand = generator.normal(size=(7, 3))
        for position in hand[:5]:
            pads = drive(position)
        engaged += (np.diff(hand[:5], axis=0)).sum(axis=0)
        for position in hand[5:]:
            drive(position, False)
    assert pads.left - LEFT == pytest.approx(alpha * drive.mapping.R_mf @ engaged, abs=1e-12)


@given(seeds, st.floats(0.5, 20.0), st.integers(1, 4))
def test_filtered_strokes_add_up_once_the_hand_rests(seed: int, low_pass: float, strokes: int) -> None:
    generator = np.random.default_rng(seed)
    drive = Drive(endless(alpha=1.7, R_mf=turned(generator), low_pass=low_pass))
    engaged = np.zeros(3)
    for _ in range(strokes):
        hand = generator.normal(size=(4, 3))
        for position in hand:
            pads = drive(position)
        drive.time += 30.0 / low_pass  # the hand rests, the filter settles
        pads = drive(hand[-1])
        drive(hand[-1], False)
        engaged += hand[-1] - hand[0]
    assert pads.left - LEFT == pytest.approx(1.7 * drive.mapping.R_mf @ engaged, abs=1e-10)


@given(seeds, scales)
def test_lengths_are_scaled_by_alpha(seed: int, alpha: float) -> None:
    generator = np.random.default_rng(seed)
    drive = Drive(endless(alpha=alpha, R_mf=turned(generator)))
    hand = generator.normal(size=(10, 3))
    left = np.array([drive(position).left for position in hand])
    assert np.linalg.norm(np.diff(left, axis=0), axis=1) == pytest.approx(
        alpha * np.linalg.norm(np.diff(hand, axis=0), axis=1), rel=1e-9, abs=1e-14
    )


@given(seeds, st.sampled_from([math.inf, 3.0]), st.floats(0.01, 1.1))
def test_both_pads_stay_in_the_workspace_and_keep_their_distance(seed: int, low_pass: float, separation: float) -> None:
    generator = np.random.default_rng(seed)
    chosen = parameters(separation=separation, low_pass=low_pass, R_mf=turned(generator))
    drive = Drive(chosen, [0.5, -0.59 + separation, 0.4])
    hand, limited = np.zeros(3), False
    for _ in range(60):
        hand = hand + generator.normal(size=3)
        left, right = pads = drive(hand, bool(generator.uniform() < 0.8))
        limited |= drive.mapping.limited
        assert (right == left - [0.0, separation, 0.0]).all()
        assert left - right == pytest.approx([0.0, separation, 0.0], abs=3e-16)
        assert pads.midpoint == pytest.approx(left - [0.0, 0.5 * separation, 0.0], abs=3e-16)
        for pad in pads:
            assert (np.array(LOW) <= pad).all()
            assert (pad <= np.array(HIGH)).all()
    assert limited


def test_the_right_pad_reaches_the_edge_of_the_workspace_and_not_beyond_by_rounding() -> None:
    low, high = (0.3, -0.3, 0.1), (0.8, 0.9, 0.8)
    separations = np.random.default_rng(0).uniform(0.1, 0.9, 200)
    assert ((low[1] + separations) - separations < low[1]).any()
    for separation in map(float, separations):
        drive = Drive(parameters(separation=separation, low=low, high=high), [0.5, 0.9, 0.4])
        drive(np.zeros(3))
        assert low[1] <= drive([0.0, -5.0, 0.0]).right[1] <= low[1] + 2e-16


def test_reversing_at_a_limit_moves_at_once() -> None:
    drive = Drive(parameters(alpha=2.0))
    drive(np.zeros(3))
    pads = drive([1.0, 0.01, 0.0])  # 2 m, where there are 0.3
    assert drive.mapping.limited
    assert pads.left == pytest.approx([0.8, 0.17, 0.4], abs=1e-15)
    pads = drive([5.0, 0.02, 0.0])  # held back along x, not along y
    assert pads.left == pytest.approx([0.8, 0.19, 0.4], abs=1e-15)
    pads = drive([4.999, 0.02, 0.0])
    assert not drive.mapping.limited
    assert pads.left == pytest.approx([0.798, 0.19, 0.4], abs=1e-14)


@given(seeds, scales)
def test_there_is_no_wind_up(seed: int, alpha: float) -> None:
    generator = np.random.default_rng(seed)
    drive = Drive(parameters(alpha=alpha, R_mf=turned(generator)))
    out = generator.normal(size=3)
    out /= np.linalg.norm(out)
    for reach in np.cumsum(generator.uniform(0.0, 100.0, 10)):
        held = drive(reach * out).left
    back = drive((reach - 1e-3 / alpha) * out).left
    wanted = held - 1e-3 * (drive.mapping.R_mf @ out)
    assert back == pytest.approx(np.clip(wanted, drive.mapping.low, drive.mapping.high), abs=1e-11)


def test_a_filtered_hand_that_reverses_at_a_limit_is_followed_when_the_filter_is() -> None:
    drive = Drive(parameters(low_pass=3.0))
    for tick in range(250):  # 1 m/s for 1 s
        pads = drive([tick * DT, 0.0, 0.0])
    assert pads.left[0] == 0.8
    for tick in range(40):
        pads = drive([1.0 - tick * DT, 0.0, 0.0])
    assert pads.left[0] < 0.8 - 0.05


def test_the_arms_stand_still_while_the_clutch_is_released_or_nothing_was_said() -> None:
    drive = Drive(parameters())
    assert drive.mapping.status is Clutch.RELEASED
    assert (drive.mapping.step(0.0, None).left == LEFT).all()
    for x in (0.1, 0.2):
        assert (drive([x, 0.0, 0.0], False).left == LEFT).all()


def test_without_a_new_sample_the_last_one_holds_until_it_is_stale() -> None:
    mapping = SharedTeleoperation(parameters(low_pass=3.0, stale=0.1), LEFT)
    mapping.step(0.0, said(0.0, np.zeros(3)))
    first = mapping.step(0.05, said(0.05, [0.05, 0.0, 0.0])).left[0]
    second = mapping.step(0.15, None).left[0]  # the filter goes on towards it
    assert LEFT[0] < first < second < LEFT[0] + 0.05
    assert mapping.status is Clutch.ENGAGED
    assert mapping.step(0.151, None).left[0] == second
    assert mapping.status is Clutch.LOST


FAULTS = {
    "stale": lambda t: said(t - 0.11, [0.2, 0.0, 0.0]),
    "ahead": lambda t: said(t + 0.11, [0.2, 0.0, 0.0]),
    "nan": lambda t: said(t, [math.nan, 0.0, 0.0]),
    "infinite": lambda t: said(t, [0.0, math.inf, 0.0]),
    "no time": lambda t: said(math.nan, [0.0, 0.0, 0.0]),
    "no orientation": lambda t: MasterSample(t, np.zeros(3), np.full(4, math.nan), True),
    "too large": lambda t: said(t, [1e308, -1e308, 1e308]),
}


@pytest.mark.parametrize("low_pass", [math.inf, 3.0])
@pytest.mark.parametrize("name", FAULTS)
def test_a_sample_that_cannot_be_used_holds_the_arms_until_the_operator_engages_again(
    name: str, low_pass: float
) -> None:
    drive = Drive(parameters(alpha=3.0, low_pass=low_pass))
    drive(np.zeros(3))
    before = drive([0.01, 0.0, 0.0]).left
    assert (drive.mapping.step(drive.time, FAULTS[name](drive.time)).left == before).all()
    assert drive.mapping.status is Clutch.LOST
    for x in (0.0, 0.02):  # good samples do not help while the clutch stays pressed
        assert (drive([x, 0.0, 0.0]).left == before).all()
        assert drive.mapping.status is Clutch.LOST
    assert (drive([0.02, 0.0, 0.0], False).left == before).all()
    assert drive.mapping.status is Clutch.RELEASED
    assert (drive([0.02, 0.0, 0.0]).left == before).all()
    assert drive.mapping.status is Clutch.ENGAGED
    assert drive([0.03, 0.0, 0.0]).left[0] > before[0]


def test_a_fault_while_released_does_not_engage_by_itself() -> None:
    drive = Drive(parameters())
    drive([math.nan, 0.0, 0.0], False)
    assert drive.mapping.status is Clutch.LOST
    drive(np.zeros(3))
    assert drive.mapping.status is Clutch.LOST


@pytest.mark.parametrize("time", [0.99, math.nan, math.inf])
def test_time_does_not_run_backwards(time: float) -> None:
    mapping = SharedTeleoperation(parameters(), LEFT)
    mapping.step(1.0, None)
    mapping.step(1.0, None)
    with pytest.raises(DataError, match="cannot follow one at 1 s"):
        mapping.step(time, None)


def test_samples_and_answers_are_not_shared() -> None:
    hand = np.zeros(3)
    sample = said(0.0, hand)
    hand[0] = 5.0
    assert sample.position[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        sample.position[0] = 1.0
    mapping = SharedTeleoperation(parameters(), LEFT)
    mapping.pads.left[0] = 7.0
    assert mapping.pads.left[0] == LEFT[0]
    for wrong in ({"position": np.zeros(2)}, {"quaternion": np.zeros(3)}):
        shapes: dict[str, Any] = {"position": np.zeros(3), "quaternion": np.zeros(4)} | wrong
        with pytest.raises(DataError, match=f"the {next(iter(wrong))} of a master has shape"):
            MasterSample(time=0.0, clutch=True, **shapes)


@pytest.mark.parametrize(
    ("changed", "name", "says"),
    [
        ({"alpha": 0.0}, "alpha", "positive"),
        ({"alpha": -1.0}, "alpha", "positive"),
        ({"alpha": math.nan}, "alpha", "positive"),
        ({"alpha": math.inf}, "alpha", "positive"),
        ({"separation": 0.0}, "separation", "positive"),
        ({"separation": 1.21}, "separation", "do not fit into a workspace of 1.2 m along y"),
        ({"low_pass": 0.0}, "low_pass", "positive"),
        ({"low_pass": math.nan}, "low_pass", "positive"),
        ({"stale": 0.0}, "stale", "positive"),
        ({"stale": math.inf}, "stale", "positive"),
        ({"low": (0.3, 0.7, 0.1)}, "high", "must be above teleoperation.mapping.low along y"),
        ({"low": (0.3, math.nan, 0.1)}, "low", "three finite numbers"),
        ({"high": (0.3, 0.1)}, "high", "three finite numbers"),
        ({"R_mf": (1.0, 0.0, 0.0)}, "R_mf", "nine finite numbers"),
        ({"R_mf": (math.nan, 0.0, 0.0, 1.0)}, "R_mf", "nine finite numbers"),
        ({"R_mf": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0)}, "R_mf", "det = -1"),
        ({"R_mf": (2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0)}, "R_mf", "differs from I by 3"),
        ({"R_mf": (1.0, 0.0, 0.0, 0.0, 1.0, 1e-8, 0.0, 0.0, 1.0)}, "R_mf", "is no rotation"),
        ({"R_mf": (0.0,) * 9}, "R_mf", "is no rotation"),
        ({"R_mf": (0.0, 0.0, 1.0, 1.0)}, "R_mf", "length 1.41421356"),
        ({"R_mf": (0.0, 0.0, 0.0, 0.0)}, "R_mf", "length 0"),
    ],
)
def test_parameters_without_a_meaning_are_refused_by_their_dotted_name(
    changed: dict[str, Any], name: str, says: str
) -> None:
    with pytest.raises(ParameterError, match=re.escape(says)) as error:
        SharedTeleoperation(parameters(**changed), LEFT)
    assert error.value.location == f"{AT}.{name}"
    with pytest.raises(ParameterError) as elsewhere:
        SharedTeleoperation(parameters(**changed), LEFT, location="here")
    assert elsewhere.value.location == f"here.{name}"


@pytest.mark.parametrize("size", [9, 4])
@given(seeds, st.floats(1e-8, 0.3))
def test_the_refusal_of_a_rotation_names_one_that_is_accepted(size: int, seed: int, error: float) -> None:
    generator = np.random.default_rng(seed)
    exact = np.array(turned(generator))
    exact = exact if size == 4 else rotation(tuple(exact), AT).ravel()
    with pytest.raises(ParameterError) as refused:
        rotation(tuple(exact * (1.0 + error)), AT)
    listed = re.search(r"\[(.*)\]", refused.value.problem)
    assert listed is not None
    remedy = tuple(map(float, listed[1].split(", ")))
    rotation(remedy, AT)
    assert remedy == pytest.approx(exact, abs=1e-11)


@given(seeds)
def test_rotations_from_quaternions_are_rotations(seed: int) -> None:
    q = turned(np.random.default_rng(seed))
    R = rotation(q, AT)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(R @ q[:3], q[:3], atol=1e-14)  # the axis stays
    assert np.trace(R) == pytest.approx(4.0 * q[3] ** 2 - 1.0, abs=1e-14)


@pytest.mark.parametrize(
    ("left", "says"),
    [
        ((0.2, 0.15, 0.4), "starts at x = 0.2 m, where both pads are within"),
        ((0.5, -0.31, 0.4), "only from -0.3 to 0.6 m: start there, or widen the workspace"),
        ((0.5, 0.15, 0.9), "z = 0.9"),
        ((0.5, math.nan, 0.4), "three finite numbers"),
        ((0.5, 0.4), "three finite numbers"),
        ("here", "three finite numbers"),
    ],
)
def test_a_start_outside_the_workspace_is_refused(left: Any, says: str) -> None:
    with pytest.raises(DataError, match=re.escape(says)):
        SharedTeleoperation(parameters(), left)


GIVEN = {"separation": L, "low": list(LOW), "high": list(HIGH)}


def test_parameters_from_a_file() -> None:
    chosen = validate_as(MappingParameters, AT, GIVEN)
    assert (chosen.alpha, chosen.low_pass, len(chosen.R_mf)) == (1.0, 3.0, 9)
    assert SharedTeleoperation(chosen, LEFT).R_mf == pytest.approx(np.eye(3))
    assert validate_as(MappingParameters, AT, GIVEN | {"low_pass": math.inf}).low_pass == math.inf


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"alpha": 0.0}, "alpha"),
        ({"alpha": math.inf}, "alpha"),
        ({"alhpa": 1.0}, "alhpa"),
        ({"low_pass": 0.0}, "low_pass"),
        ({"low_pass": math.nan}, "low_pass"),
        ({"low": [0.0, 0.0]}, "low"),
        ({"low": [0.0, 0.0, 0.0, 0.0]}, "low"),
    ],
)
def test_parameters_from_a_file_that_are_refused(changed: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError) as error:
        validate_as(MappingParameters, AT, GIVEN | changed)
    assert error.value.location == f"{AT}.{name}"
