"""How a box was held, by hand: forces, band, tilt, slip on each pad, delivery and drop. Paper Figs. 5b, 5c."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.artifacts.rollouts import RecordedCarry
from stages.evaluate.force import BAND, FALLEN, grip, slips
from stages.policy.carrying import tilt as tilted
from stages.policy.outcome import Outcome
from stages.trajectory import Array

START, GOAL, BOX = (0.45, -0.15, 0.35), (0.65, 0.15, 0.47), (0.2, 0.3, 0.2)
ASIDE = np.array([0.0, 0.15, 0.0])
FACTS: dict[str, Any] = {
    "compliance": True,
    "force": 5.0,
    "start": START,
    "goal": GOAL,
    "box": BOX,
    "grip_ratio": 2.5,
    "bias": [0.1, -0.04],
}
OF_CARRIED = [name for name in ("tilt_max_deg", "slip_left_mm", "slip_right_mm", "slip_max_mm", "band_fraction")]
OF_CARRIED += [f"force_{name}_n" for name in ("mean", "std", "p5", "p95")]


def about(axis: str, degrees: float) -> list[float]:
    """A turn about an axis, quaternion x y z w."""
    half = math.radians(degrees) / 2.0
    return [math.sin(half) * (axis == name) for name in "xyz"] + [math.cos(half)]


def held(phases: str, **changes: Any) -> RecordedCarry:
    """One sample a letter, Approach, Grip, Carry, Set-down, Release, Done, Lost: the box stands still between its pads.

    Nobody pushes, and there are no pots.
    """
    names = {"A": "approach", "G": "grip", "C": "carry", "S": "set-down", "R": "release", "D": "done", "L": "lost"}
    n = len(phases)
    made: dict[str, Any] = {
        "phase": np.array([names[letter] for letter in phases]),
        "box": np.tile(GOAL, (n, 1)),
        "turn": np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        "joints": np.zeros((n, 2, 7)),
        "force": np.full((n, 2), 5.0),
        "contact": np.full((n, 2), 5.0),
        "desired": np.full(n, 5.0),
        "residual": np.zeros((n, 2)),
        "named": np.full(n, "", dtype=object),
        "pushed": np.zeros((n, 2), dtype=bool),
        "box_room": np.full(n, np.nan),
        "arm_room": np.full(n, np.nan),
        "facts": FACTS | changes.pop("facts", {}),
    }
    made |= changes
    made.setdefault("pads", np.stack([made["box"] + ASIDE, made["box"] - ASIDE], axis=1))
    return RecordedCarry(**made)


def test_forces_of_both_arms_are_pooled_while_the_box_is_carried() -> None:
    contact = np.array([[0.0, 0.0], [9.0, 9.0], [4.0, 6.0], [5.0, 5.0], [5.0, 7.0], [3.0, 5.0], [0.0, 0.0]])
    found = grip(held("AGCCCCD", contact=contact), "arrived")
    # 4 6 5 5 5 7 3 5: mean 5, squares of deviations 1 1 0 0 0 4 4 0, of which the mean is 10/8.
    assert found.force_mean_n == 5.0
    assert found.force_std_n == pytest.approx(math.sqrt(1.25), rel=1e-15)
    # Sorted 3 4 5 5 5 5 6 7: 5 % is 0.35 of the way from the first to the second, 95 % 0.65 from the last but one.
    assert found.force_p5_n == pytest.approx(3.35, rel=1e-15)
    assert found.force_p95_n == pytest.approx(6.65, rel=1e-15)


def test_the_measured_force_is_not_the_true_one() -> None:
    found = grip(held("CC", force=np.full((2, 2), 50.0)), "arrived")
    assert (found.force_mean_n, found.force_std_n, found.band_fraction) == (5.0, 0.0, 1.0)


def test_the_band_is_2_to_10_newtons_and_holds_for_both_arms_at_once() -> None:
    assert tuple(share * 5.0 for share in BAND) == (2.0, 10.0)
    contact = np.array([[5.0, 5.0], [2.0, 10.0], [1.99, 5.0], [5.0, 10.01], [5.0, 5.0]])
    assert grip(held("CCCCS", contact=contact), "arrived").band_fraction == 0.5
    # Relative to the desired force: 4 to 20 N where it is 10.
    assert grip(held("CCCCS", contact=2.0 * contact, facts={"force": 10.0}), "arrived").band_fraction == 0.5
    assert grip(held("CCCCS", contact=contact, facts={"force": 10.0}), "arrived").band_fraction == 0.5


@pytest.mark.parametrize(
    ("turn", "degrees"),
    [
        ([0.0, 0.0, 0.0, 1.0], 0.0),
        (about("x", 30.0), 30.0),
        (about("y", -10.0), 10.0),
        (about("z", 80.0), 0.0),  # turned, not tilted
        (about("x", 180.0), 180.0),
        ([0.5, 0.5, 0.5, 0.5], 90.0),  # x to y, y to z, z to x
        ([-0.5, -0.5, -0.5, -0.5], 90.0),
    ],
)
def test_tilt_by_hand(turn: list[float], degrees: float) -> None:
    assert tilted(np.array([turn]))[0] == pytest.approx(degrees, abs=1e-6)


@given(st.floats(0.0, 180.0), st.floats(-180.0, 180.0))
def test_turning_about_the_vertical_is_no_tilt(tilt: float, turn: float) -> None:
    x, y, z, w = about("x", tilt)
    half = math.radians(turn) / 2.0
    s, c = math.sin(half), math.cos(half)
    turned = [c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z]  # first tilted, then turned
    assert tilted(np.array([turned]))[0] == pytest.approx(tilt, abs=1e-5)


def test_only_the_tilt_while_carried_counts() -> None:
    turn = np.array([about("x", 40.0), about("x", 2.0), about("y", 3.0), about("x", 1.0), about("x", 20.0)])
    assert grip(held("GCCCR", turn=turn), "arrived").tilt_max_deg == pytest.approx(3.0, abs=1e-6)


def test_a_box_that_moves_with_its_pads_does_not_slip() -> None:
    box = np.array([START, [0.5, 0.0, 0.5], GOAL])
    found = grip(held("CCC", box=box), "arrived")
    assert found.slip_max_mm == pytest.approx(0.0, abs=1e-12)


def test_slip_across_each_pad_by_hand() -> None:
    box = np.tile(GOAL, (4, 1))
    pads = np.stack([box + ASIDE, box - ASIDE], axis=1)
    pads[:, 1, 0] += 0.2  # where a pad takes hold does not matter
    pads[1, 0] += [0.003, 0.02, 0.004]  # pressing deeper is no slip: 5 mm, and nothing for the 20 mm
    pads[2, 1] += [0.0, 0.0, -0.007]
    pads[3, 0] += [0.5, 0.0, 0.0]  # let go
    one = held("CCCR", box=box, pads=pads)
    carried = one.phase == "carry"
    assert slips(one, carried) == pytest.approx(np.array([[0.0, 0.0], [0.005, 0.0], [0.0, 0.007]]), abs=1e-15)
    found = grip(one, "arrived")
    assert found.slip_left_mm == pytest.approx(5.0)
    assert found.slip_right_mm == pytest.approx(7.0)
    assert found.slip_max_mm == pytest.approx(7.0)


@pytest.mark.parametrize("degrees", [1.0, -10.0, 30.0])
def test_slip_of_a_box_that_turns_between_pads_that_do_not(degrees: float) -> None:
    """About the vertical and about x the faces' middles leave the pads, half the box's length from its centre."""
    angle = math.radians(degrees)
    for axis in "xz":
        turn = np.array([about(axis, 0.0), about(axis, degrees)])
        moved = slips(held("CC", turn=turn), np.array([True, True]))
        # Turning takes (0, 0.15, 0) to (-0.15 sin, 0.15 cos, 0) and to (0, 0.15 cos, 0.15 sin).
        assert moved[1] == pytest.approx([0.15 * abs(math.sin(angle))] * 2, rel=1e-12)
    # About the clamped axis they turn on the spot: no slip of the middles.
    turn = np.array([about("y", 0.0), about("y", degrees)])
    assert slips(held("CC", turn=turn), np.array([True, True]))[1] == pytest.approx([0.0, 0.0], abs=1e-15)


def test_slip_counts_from_how_the_box_was_taken() -> None:
    """A box that is turned all along has not slipped."""
    turn = np.tile(about("z", 5.0), (3, 1))
    assert slips(held("CCC", turn=turn), np.ones(3, dtype=bool)).max() == 0.0


def heights(*z: float) -> Array:
    return np.column_stack([np.full(len(z), 0.5), np.zeros(len(z)), z])


def test_a_box_below_start_and_goal_has_been_dropped() -> None:
    floor = START[2] - FALLEN  # the start is the lower one
    assert not grip(held("CCC", box=heights(0.4, floor + 1e-9, 0.4)), "lost-box").dropped
    assert grip(held("CCC", box=heights(0.4, floor - 1e-9, 0.4)), "lost-box").dropped
    assert grip(held("CRD", box=heights(0.4, 0.4, 0.1)), "misplaced").dropped  # also after it was let go
    lower = {"goal": (0.65, 0.15, 0.2)}
    assert not grip(held("CCC", box=heights(0.4, 0.25, 0.2), facts=lower), "arrived").dropped


@pytest.mark.parametrize(("phases", "dropped"), [("CCC", True), ("CCL", True), ("CCR", False), ("CCD", False)])
def test_a_box_that_has_sunk_between_its_pads_has_been_dropped(phases: str, dropped: bool) -> None:
    """Well above start and goal; not where the pads have let go of it."""
    box = heights(0.8, 0.8, 0.8)
    for sunk, falls in ((FALLEN - 1e-9, False), (FALLEN + 1e-9, dropped)):
        pads = np.stack([box + ASIDE, box - ASIDE], axis=1)
        pads[2, :, 2] += [sunk + 0.1, sunk - 0.1]  # of the pads' middle: one alone is not enough
        assert grip(held(phases, box=box, pads=pads), "lost-box").dropped == falls


def test_pushes_and_pots_do_not_touch_how_a_box_was_held() -> None:
    """What is said of them is said elsewhere: `pushed.py`."""
    contact, generator = np.array([[4.0, 6.0], [5.0, 11.0], [3.0, 5.0]]), np.random.default_rng(0)
    plain = grip(held("CCC", contact=contact), "arrived")
    others: dict[str, Any] = {
        "residual": generator.uniform(0.0, 0.1, size=(3, 2)),
        "named": np.array(["", "left", "right"], dtype=object),
        "pushed": np.array([[False, True], [True, False], [True, True]]),
        "box_room": generator.uniform(size=3),
        "arm_room": generator.uniform(size=3),
    }
    assert grip(held("CCC", contact=contact, **others), "arrived") == plain


def test_delivery_is_the_outcome_and_its_error_that_of_the_last_sample() -> None:
    box = np.array([START, START, [0.653, 0.15, 0.474]])
    found = grip(held("CRD", box=box), "arrived")
    assert found.delivered
    assert found.delivery_error_mm == pytest.approx(5.0)
    others = [str(outcome) for outcome in Outcome if outcome is not Outcome.ARRIVED]
    assert {"misplaced", "lost-box", "dropped", "held", "out-of-reach", "joint-limit", "singular"} <= set(others)
    for outcome in others:
        assert not grip(held("CRD"), outcome).delivered


def test_facts_of_the_box_are_passed_on() -> None:
    found = grip(held("CD", facts={"compliance": False}), "arrived")
    assert (found.compliance, found.grip_ratio) == (False, 2.5)
    assert found.bias_n == pytest.approx(0.03)


@pytest.mark.parametrize("phases", ["A", "AAGG"])
def test_a_box_that_was_never_carried_has_no_figures_of_it(phases: str) -> None:
    found = asdict(grip(held(phases), "not-gripped"))
    assert {name for name, value in found.items() if value is None} == set(OF_CARRIED)
    assert found["delivered"] is False
    assert found["dropped"] is False
    assert found["delivery_error_mm"] == 0.0


@given(st.lists(st.tuples(st.floats(0.0, 50.0), st.floats(0.0, 50.0)), min_size=1, max_size=30))
def test_percentiles_and_mean_lie_within_the_forces(pairs: list[tuple[float, float]]) -> None:
    contact = np.array(pairs)
    found = grip(held("C" * len(pairs), contact=contact), "arrived")
    assert found.force_p5_n is not None
    assert found.force_p95_n is not None
    assert found.force_mean_n is not None
    slack = 1e-9
    assert contact.min() - slack <= found.force_p5_n <= found.force_p95_n <= contact.max() + slack
    assert contact.min() - slack <= found.force_mean_n <= contact.max() + slack
    exchanged = grip(held("C" * len(pairs), contact=contact[:, ::-1]), "arrived")
    assert exchanged.band_fraction == found.band_fraction
