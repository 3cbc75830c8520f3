"""Pushes and pots on the way of a carried box, by hand: deviation, waiting, who was pushed, errors of estimates, rooms.

Paper eq. (14), Figs. 5d, 6. Not here: how the box was held (`test_force.py`).
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stages.artifacts.rollouts import RecordedCarry
from stages.evaluate.pushed import AWAY, Pushed, deviation, pushed
from stages.trajectory import Array

seeds = st.integers(0, 2**32 - 1)
NAMES = {"A": "approach", "G": "grip", "C": "carry", "S": "set-down", "R": "release", "D": "done", "X": "stopped"}
HALF = np.array([0.0, 0.15, 0.0])
FACTS: dict[str, Any] = {
    "following": True,
    "coupling": True,
    "box": (0.2, 0.3, 0.25),
    "length_found": 0.3,
    "mass": 0.5,
    "mass_found": 0.5,
    "pots": [],
    "box_contacts": 0,
    "arm_contacts": 0,
}
OF_CARRIED = {"deviation_max_mm", "moved_while_away_mm", "box_back_mm"}
OF_POTS = {"box_room_min_mm", "arm_room_min_mm", "box_contacts", "arm_contacts"}


def way(n: int) -> Array:
    """x on its way: 10 mm a sample along x, 20 mm along y, 20 mm along z: 30 mm."""
    return np.array([0.45, -0.15, 0.35]) + np.outer(np.arange(n), [0.01, 0.02, 0.02])


def recorded(
    phases: str,
    aside: Array | None = None,
    x: Array | None = None,
    facts: dict[str, Any] | None = None,
    **changes: Any,
) -> tuple[RecordedCarry, Array]:
    """One sample a letter (`NAMES`), and x; pads and box are `aside`, shape (n, 3), metres, of x. Nobody pushes."""
    n = len(phases)
    x = way(n) if x is None else x
    middle = x + (np.zeros((n, 3)) if aside is None else aside)
    made: dict[str, Any] = {
        "phase": np.array([NAMES[letter] for letter in phases], dtype=object),
        "pads": np.stack([middle + HALF, middle - HALF], axis=1),
        "box": middle,
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
        "facts": FACTS | (facts or {}),
    }
    return RecordedCarry(**(made | changes)), x


def measured(phases: str, *, gate: str | None = None, **changes: Any) -> Pushed:
    """What is measured of `recorded`; `gate`: a letter a sample, o: it is open; none: all along."""
    carry, x = recorded(phases, **changes)
    return pushed(carry, x, opened(gate or "o" * len(phases)))


def opened(gate: str) -> NDArray[np.bool_]:
    return np.array([letter == "o" for letter in gate])


def millimetres(*rows: tuple[float, float, float]) -> Array:
    return np.array(rows) / 1e3


def downwards(*values: float) -> Array:
    """So many millimetres, along z alone."""
    return millimetres(*((0.0, 0.0, value) for value in values))


# --- how far away ---------------------------------------------------------------------------------------------------


def test_deviation_by_hand_from_how_it_was_when_first_carried() -> None:
    # Beside x by 1 -2 3 mm; then 3 4 0 off (5 mm), 2 3 -6 (7 mm), back. Before and after it does not count.
    aside = millimetres((80, 0, 0), (90, 0, 0), (1, -2, 3), (4, 2, 3), (3, 1, -3), (1, -2, 3), (0, 90, 0), (0, 0, 80))
    carry, x = recorded("AGCCCCSD", aside)
    found = deviation(carry.pads.mean(axis=1), x, carry.phase == "carry")
    assert found == pytest.approx([0.0, 0.005, 0.007, 0.0], abs=1e-15)
    assert measured("AGCCCCSD", aside=aside).deviation_max_mm == pytest.approx(7.0, rel=1e-12)


def test_pads_that_stay_where_x_goes_on_are_away() -> None:
    """And those that go along with it are not, wherever it goes: a wrong sign would double what it moves."""
    x = way(4)
    assert measured("CCCC").deviation_max_mm == pytest.approx(0.0, abs=1e-12)
    assert measured("CCCC", x=x, aside=x[0] - x).deviation_max_mm == pytest.approx(90.0, rel=1e-12)
    assert measured("CCCC", x=x, aside=x - x[0]).deviation_max_mm == pytest.approx(90.0, rel=1e-12)


@pytest.mark.parametrize("side", [0, 1])
def test_one_arm_that_is_pushed_takes_the_midpoint_half_as_far(side: int) -> None:
    pads = recorded("CCC")[0].pads.copy()
    pads[1, side] += [0.0, 0.0, -0.03]
    assert measured("CCC", pads=pads).deviation_max_mm == pytest.approx(15.0, rel=1e-12)
    pads[1, 1 - side] += [0.0, 0.0, 0.03]  # against each other: the midpoint stays
    assert measured("CCC", pads=pads).deviation_max_mm == pytest.approx(0.0, abs=1e-12)


def test_deviation_is_of_the_pads_and_not_of_the_box() -> None:
    carry, _ = recorded("CCC")
    box = carry.box + downwards(0.0, 40.0, 0.0)
    assert measured("CCC", box=box).deviation_max_mm == pytest.approx(0.0, abs=1e-12)


# --- x, while it was away -------------------------------------------------------------------------------------------


def test_x_that_moved_while_it_was_away_by_hand() -> None:
    # x moves by 32, 1, 2, 4, 8, 16 and 64 mm; it is away when the steps of 2 and 8 mm begin, and at the last sample
    # carried, from which the step of 64 mm leads to one that is not.
    steps = np.array([32.0, 1.0, 2.0, 4.0, 8.0, 16.0, 64.0]) / 1e3
    x = np.zeros((8, 3))
    x[1:] = np.outer(np.cumsum(steps), [2 / 3, -1 / 3, 2 / 3])
    aside = downwards(9.0, 0.0, 6.0, 4.9, 6.0, 0.0, 6.0, 9.0)
    found = measured("GCCCCCCS", x=x, aside=aside)
    assert found.moved_while_away_mm == pytest.approx(2.0 + 8.0, rel=1e-12)
    # The other way round: counted from where it was when first carried, 6 mm aside.
    found = measured("GCCCCCCS", x=x, aside=downwards(0.0, 6.0, 0.0, 1.1, 0.0, 6.0, 0.0, 0.0))
    assert found.moved_while_away_mm == pytest.approx(2.0 + 8.0, rel=1e-12)


def test_away_is_more_than_five_millimetres() -> None:
    assert AWAY == 0.005
    x = np.outer(np.arange(3), [0.0, 0.0, 0.02])  # along z alone, and aside along x alone: no rounding
    for away, moved in ((AWAY, 0.0), (math.nextafter(AWAY, 1.0), 20.0), (-AWAY, 0.0), (-0.006, 20.0)):
        aside = np.outer([0.0, away, 0.0], [1.0, 0.0, 0.0])
        assert measured("CCC", x=x, aside=aside).moved_while_away_mm == pytest.approx(moved, rel=1e-12)


def test_x_that_waits_while_it_is_away_has_not_moved() -> None:
    x = way(5)
    x[2] = x[3] = x[1]
    found = measured("CCCCC", x=x, aside=downwards(0.0, 20.0, 20.0, 0.0, 0.0), gate="occoo")
    assert found.moved_while_away_mm == 0.0
    assert found.deviation_max_mm == pytest.approx(20.0, rel=1e-12)


# --- x, when it went on ---------------------------------------------------------------------------------------------


def test_where_the_box_was_when_x_went_on_by_hand() -> None:
    # x goes on twice, the box being 3 and then 2 mm off: at the samples before and after it was much farther off.
    offs = (0.0, 0.0, 50.0, 40.0, 3.0, 60.0, 70.0, 2.0, 80.0, 90.0)
    carry, _ = recorded("G" + "C" * 8 + "S")
    found = measured("G" + "C" * 8 + "S", box=carry.box + downwards(*offs), gate="ooccooc" + "oco")
    assert found.box_back_mm == pytest.approx(3.0, rel=1e-12)
    found = measured("G" + "C" * 8 + "S", box=carry.box + downwards(*offs), gate="oooooocooo")
    assert found.box_back_mm == pytest.approx(2.0, rel=1e-12)


def test_where_the_box_was_counts_from_where_it_was_when_first_carried() -> None:
    carry, _ = recorded("GCCC")
    box = carry.box + millimetres((9, 9, 9), (1, -2, 3), (1, -2, 3), (3, 1, -3))
    assert measured("GCCC", box=box, gate="ooco").box_back_mm == pytest.approx(7.0, rel=1e-12)


def test_where_the_box_was_is_of_the_box_and_not_of_the_pads() -> None:
    carry, _ = recorded("CCC")
    pads = carry.pads + downwards(0.0, 0.0, 30.0)[:, None]
    found = measured("CCC", pads=pads, gate="oco")
    assert found.box_back_mm == pytest.approx(0.0, abs=1e-12)
    assert found.deviation_max_mm == pytest.approx(30.0, rel=1e-12)


@pytest.mark.parametrize(
    ("gate", "back"),
    [
        ("oooooo", None),  # it did not wait
        ("ooocco", None),  # it went on when the box was set down
        ("oocccc", None),  # it never went on
        ("cooooo", None),  # it waited before the box was carried
        ("ocoooo", 8.0),  # from the first sample carried on
        ("oocooo", 16.0),
        ("cccooo", 16.0),
        ("occcoo", 32.0),
        ("ococoo", 32.0),  # twice: the most
    ],
)
def test_x_went_on_only_where_it_had_waited(gate: str, back: float | None) -> None:
    carry, _ = recorded("GCCCCS")
    box = carry.box + downwards(0.0, 0.0, 8.0, 16.0, 32.0, 64.0)
    assert measured("GCCCCS", box=box, gate=gate).box_back_mm == (None if back is None else pytest.approx(back))


# --- who was pushed -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("left", "right", "text"),
    [("....", "....", None), ("..#.", "....", "left"), ("....", ".##.", "right"), ("...#", "#...", "left right")],
)
def test_arms_that_were_pushed_and_those_that_were_taken_for_it(left: str, right: str, text: str | None) -> None:
    truly = np.array([[one == "#" for one in arm] for arm in (left, right)]).T
    found = measured("CCCC", pushed=truly)
    assert (found.pushed, found.named) == (text, None)
    taken = np.select([truly[:, 0], truly[:, 1]], ["left", "right"], "").astype(object)
    found = measured("CCCC", named=taken)
    assert (found.pushed, found.named) == (None, text)


def test_the_arm_that_was_pushed_need_not_be_the_one_that_was_named() -> None:
    truly, taken = np.zeros((3, 2), dtype=bool), np.array(["", "right", ""], dtype=object)
    truly[1, 0] = True
    found = measured("CCC", pushed=truly, named=taken)
    assert (found.pushed, found.named) == ("left", "right")
    found = measured("CCC", pushed=truly[:, ::-1], named=np.array(["", "left", ""]))
    assert (found.pushed, found.named) == ("right", "left")


@pytest.mark.parametrize("following", [True, False])
@pytest.mark.parametrize("coupling", [True, False])
def test_what_was_on_is_passed_on(following: bool, coupling: bool) -> None:
    found = measured("CC", facts={"following": following, "coupling": coupling})
    assert (found.following, found.coupling) == (following, coupling)


# --- what the controller took the box for ---------------------------------------------------------------------------


@pytest.mark.parametrize(("length", "error"), [(0.3, 0.0), (0.31, 10.0), (0.298, -2.0)])
def test_length_error_is_positive_where_the_box_is_taken_for_too_long(length: float, error: float) -> None:
    assert measured("CC", facts={"length_found": length}).length_error_mm == pytest.approx(error, abs=1e-9)


@pytest.mark.parametrize(("mass", "error"), [(0.5, 0.0), (0.52, 20.0), (0.45, -50.0), (0.0, -500.0), (None, None)])
def test_mass_error_is_positive_where_the_box_is_taken_for_too_heavy(mass: float | None, error: float | None) -> None:
    found = measured("CC", facts={"mass_found": mass}).mass_error_g
    assert found == (None if error is None else pytest.approx(error, abs=1e-9))


def test_the_desired_force_is_that_of_the_end() -> None:
    assert measured("GCCD", desired=np.array([5.0, 9.0, 8.0, 7.0])).desired_force_n == 7.0


# --- pots -----------------------------------------------------------------------------------------------------------


def test_least_rooms_and_contacts_by_hand() -> None:
    """Over all of it, also where the box is not carried; negative where one is inside of the other."""
    given: dict[str, Any] = {
        "box_room": np.array([0.3, 0.2, 0.1, -0.004]),
        "arm_room": np.array([0.012, 0.03, 0.5, 0.4]),
        "facts": {"pots": [{"radius": 0.1}], "box_contacts": 7, "arm_contacts": 3},
    }
    found = measured("ACCD", **given)
    assert found.box_room_min_mm == pytest.approx(-4.0, rel=1e-12)
    assert found.arm_room_min_mm == pytest.approx(12.0, rel=1e-12)
    assert (found.box_contacts, found.arm_contacts) == (7, 3)


def test_pots_that_nobody_touched_have_no_contacts_and_not_none() -> None:
    found = measured("CC", box_room=np.ones(2), arm_room=np.ones(2), facts={"pots": [{"radius": 0.1}]})
    assert (found.box_contacts, found.arm_contacts) == (0, 0)


def test_without_pots_there_is_nothing_to_be_said_of_them() -> None:
    found = asdict(measured("CC"))
    assert {name for name, value in found.items() if value is None} == OF_POTS | {"pushed", "named", "box_back_mm"}


# --- boxes that were not carried ------------------------------------------------------------------------------------


@pytest.mark.parametrize("phases", ["A", "AAGG", "GX"])
def test_a_box_that_was_never_carried_has_no_figures_of_it(phases: str) -> None:
    n = len(phases)
    found = asdict(
        measured(
            phases,
            gate=("co" * n)[:n],
            aside=downwards(*range(0, 10 * n, 10)),
            pushed=np.ones((n, 2), dtype=bool),
            named=np.full(n, "left", dtype=object),
            box_room=np.ones(n),
            arm_room=np.ones(n),
            facts={"pots": [{"radius": 0.1}]},
        )
    )
    assert {name for name, value in found.items() if value is None} == OF_CARRIED
    assert (found["pushed"], found["named"]) == ("left right", "left")


def test_a_single_sample_carried() -> None:
    found = measured("GCX", aside=downwards(50.0, 20.0, 90.0), gate="coc")
    assert (found.deviation_max_mm, found.moved_while_away_mm, found.box_back_mm) == (0.0, 0.0, None)


# --- what always holds ----------------------------------------------------------------------------------------------


def at_random(seed: int) -> tuple[dict[str, Any], NDArray[np.bool_]]:
    """What `recorded` takes of some way with some pushes, and a gate; deviations on both sides of 5 mm."""
    draw = np.random.default_rng(seed)
    before, during, after = (int(draw.integers(low, 12)) for low in (0, 1, 0))
    n = before + during + after
    x = np.cumsum(draw.normal(scale=0.01, size=(n, 3)), axis=0)
    taken = draw.choice(["", "left", "right"], size=n).astype(object)
    made: dict[str, Any] = {
        "phases": "G" * before + "C" * during + "S" * after,
        "x": x,
        "pads": x[:, None] + np.stack([HALF, -HALF]) + draw.normal(scale=0.005, size=(n, 2, 3)),
        "box": x + draw.normal(scale=0.01, size=(n, 3)),
        "pushed": draw.uniform(size=(n, 2)) < 0.2,
        "named": taken,
    }
    return made, draw.uniform(size=n) < 0.6


@given(seeds, st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_it_does_not_matter_where_all_of_it_happens(seed: int, shift: tuple[float, float, float]) -> None:
    made, gate = at_random(seed)
    here = pushed(*recorded(**made), gate)
    there = pushed(*recorded(**(made | {name: made[name] + shift for name in ("x", "pads", "box")})), gate)
    for name in OF_CARRIED:
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-9)


@given(seeds, seeds)
def test_the_way_of_x_does_not_matter_to_what_goes_along_with_it(seed: int, other: int) -> None:
    made, gate = at_random(seed)
    shift = np.random.default_rng(other).normal(size=made["x"].shape)
    along = {"x": made["x"] + shift, "pads": made["pads"] + shift[:, None], "box": made["box"] + shift}
    here, there = (pushed(*recorded(**one), gate) for one in (made, made | along))
    assert there.deviation_max_mm == pytest.approx(here.deviation_max_mm, abs=1e-9)
    assert there.box_back_mm == pytest.approx(here.box_back_mm, abs=1e-9)


@given(seeds)
def test_figures_are_finite_and_not_negative(seed: int) -> None:
    made, gate = at_random(seed)
    found = pushed(*recorded(**made), gate)
    for value in (found.deviation_max_mm, found.moved_while_away_mm, found.box_back_mm):
        assert value is None or (math.isfinite(value) and value >= 0.0)
    assert found.deviation_max_mm is not None
    assert found.moved_while_away_mm is not None
    carried = np.array(list(made["phases"])) == "C"
    way_of_x = np.linalg.norm(np.diff(made["x"][carried], axis=0), axis=1).sum() * 1e3
    assert found.moved_while_away_mm <= way_of_x + 1e-9
    if found.deviation_max_mm <= 5.0:
        assert found.moved_while_away_mm == 0.0


@given(seeds)
def test_arms_that_change_places_change_names_alone(seed: int) -> None:
    made, gate = at_random(seed)
    words = {"": "", "left": "right", "right": "left"}
    changed = {
        "pads": made["pads"][:, ::-1],
        "pushed": made["pushed"][:, ::-1],
        "named": np.array([words[word] for word in made["named"]], dtype=object),
    }
    here, there = (asdict(pushed(*recorded(**one), gate)) for one in (made, made | changed))
    for name in ("pushed", "named"):
        exchanged = sorted(words[word] for word in (here.pop(name) or "").split())
        assert there.pop(name) == (" ".join(exchanged) or None)
    assert there == here


@given(seeds)
def test_all_of_it_sample_by_sample(seed: int) -> None:
    """As the docstring of `Pushed` says, without arrays."""
    made, gate = at_random(seed)
    carry, x = recorded(**made)
    led = [k for k, letter in enumerate(made["phases"]) if letter == "C"]

    def off(place: Any, k: int) -> float:
        return math.dist(place(k) - x[k], place(led[0]) - x[led[0]])

    def middle(k: int) -> Array:
        return np.asarray(0.5 * (carry.pads[k, 0] + carry.pads[k, 1]))

    moved = sum(math.dist(x[k], x[k + 1]) for k in led[:-1] if off(middle, k) > 0.005)
    resumed = [off(lambda j: carry.box[j], k) for k in led[1:] if gate[k] and not gate[k - 1]]
    found = pushed(carry, x, gate)
    assert found.deviation_max_mm == pytest.approx(1e3 * max(off(middle, k) for k in led), abs=1e-9)
    assert found.moved_while_away_mm == pytest.approx(1e3 * moved, abs=1e-9)
    assert found.box_back_mm == (pytest.approx(1e3 * max(resumed), abs=1e-9) if resumed else None)
