"""Intervals of shares and of means: by hand, as properties, and as tables write them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.figures.intervals import (
    FEW,
    SHARES,
    bootstrap_interval,
    brackets,
    change_interval,
    mean_cell,
    mean_interval,
    of,
    share,
    spread_cell,
    tally,
    wilson,
    with_interval,
)
from stages.figures.numbers import MISSING, NO_BREAK

# --- shares ---------------------------------------------------------------------------------------------------------


def test_wilson_intervals_by_hand() -> None:
    z2 = 1.959964**2
    assert wilson(0, 8) == pytest.approx((0.0, z2 / (8 + z2)), abs=1e-12)
    assert wilson(8, 8) == pytest.approx((8 / (8 + z2), 1.0), abs=1e-12)
    assert wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=5e-5)
    assert wilson(1, 10) == pytest.approx((0.0179, 0.4042), abs=5e-5)
    # 12 of 14: middle (12 + z²/2)/(14 + z²) = 0.7803, half z sqrt(12 * 2/14 + z²/4)/(14 + z²) = 0.1792.
    assert wilson(12, 14) == pytest.approx((0.6006, 0.9599), abs=1e-4)


@given(st.integers(1, 500), st.data())
def test_wilson_intervals_hold_the_share_and_mirror(total: int, data: st.DataObject) -> None:
    hits = data.draw(st.integers(0, total))
    low, high = wilson(hits, total)
    assert 0.0 <= low <= hits / total + 1e-12
    assert hits / total - 1e-12 <= high <= 1.0
    assert wilson(total - hits, total) == pytest.approx((1.0 - high, 1.0 - low), abs=1e-12)


def test_shares_as_tables_write_them() -> None:
    assert of(6, 7) == "6 of 7".replace(" ", NO_BREAK)
    assert tally(12, 14) == f"12{NO_BREAK}of{NO_BREAK}14 (60{NO_BREAK}to{NO_BREAK}96{NO_BREAK}%)"
    assert share(12, 14) == f"86{NO_BREAK}% (60{NO_BREAK}to{NO_BREAK}96{NO_BREAK}%)"
    assert tally(0, 0) == share(0, 0) == MISSING


# --- means ----------------------------------------------------------------------------------------------------------


def test_interval_of_equal_values_is_that_value() -> None:
    assert bootstrap_interval(np.full(12, 3.0), "any") == (3.0, 3.0)
    assert mean_interval([3.0] * 12, range(12), "any") == pytest.approx((3.0, 3.0))


def test_interval_of_a_mean_of_two_values_by_hand() -> None:
    """Of n zeros and n ones a resample's mean is binomial: n = 50 gives 0.5 -+ 1.96 * 0.05, the steps are of 0.01."""
    values = np.repeat([0.0, 1.0], 50)
    assert bootstrap_interval(values, "halves") == pytest.approx((0.40, 0.60), abs=0.0151)
    assert mean_interval(list(values), range(100), "halves") == pytest.approx(bootstrap_interval(values, "halves"))


def test_values_of_a_unit_are_drawn_together() -> None:
    """Each of 50 units has three equal values: the interval is that of 50 values, and not of 150."""
    values = np.repeat([0.0, 1.0], 75)
    units = [index // 3 for index in range(150)]
    assert mean_interval(list(values), units, "x") == pytest.approx(bootstrap_interval(values[::3], "x"))
    alone = bootstrap_interval(values, "x")
    assert alone[1] - alone[0] < 0.7 * 0.28  # 0.5 -+ 1.96 * 0.041 against 0.5 -+ 1.96 * 0.071


def test_units_of_unequal_size_count_by_their_values() -> None:
    values = [1.0] * 30 + [0.0] * FEW
    units = [0] * 30 + list(range(1, FEW + 1))
    interval = mean_interval(values, units, "unequal")
    assert interval is not None
    low, high = interval
    assert low == 0.0  # a third of the resamples hold the large unit not once
    assert high > 0.75  # 30/40, and more where it is drawn twice: 60/69


def test_of_few_units_the_interval_is_students_and_of_two_there_is_none() -> None:
    # t of 2 degrees of freedom is 4.30265; of 1, 2, 3 the standard deviation is 1.
    half = 4.30265 / math.sqrt(3.0)
    assert mean_interval([1.0, 2.0, 3.0], range(3), "few") == pytest.approx((2.0 - half, 2.0 + half), abs=1e-5)
    # Units count once, whatever they hold; the middle is the mean of all values, which is what tables show.
    found = mean_interval([0.0, 2.0, 2.0, 3.0, 3.0, 3.0], [0, 0, 1, 2, 2, 2], "units")
    assert found == pytest.approx((13.0 / 6.0 - half, 13.0 / 6.0 + half), abs=1e-5)
    assert mean_interval([1.0, 2.0], range(2), "two") is None
    assert mean_interval([1.0] * 50, [0] * 50, "one") is None
    assert mean_interval([1.0] * FEW, range(FEW), "enough") is not None


def test_intervals_are_the_same_each_time_and_seeded_by_name() -> None:
    values = np.random.default_rng(0).normal(size=30)
    assert bootstrap_interval(values, "a") == bootstrap_interval(values, "a")
    assert bootstrap_interval(values, "a") != bootstrap_interval(values, "b")


@given(st.lists(st.floats(-1e3, 1e3), min_size=FEW, max_size=30))
def test_interval_lies_within_the_values(values: list[float]) -> None:
    interval = mean_interval(values, range(len(values)), "within")
    assert interval is not None
    assert min(values) - 1e-9 <= interval[0] <= interval[1] <= max(values) + 1e-9


def test_change_of_what_doubles_is_certain() -> None:
    before = np.linspace(1.0, 2.0, 20)
    assert change_interval(before, 2.0 * before, "twice") == pytest.approx((1.0, 1.0))


def test_means_as_tables_write_them() -> None:
    rows: list[dict[str, Any]] = [{"point": str(index % 12), "force": 5.0} for index in range(24)]
    said = f"5.00 (5.00{NO_BREAK}to{NO_BREAK}5.00)"
    assert mean_cell(rows, "force") == mean_cell(rows, "force", unit="point") == said
    assert mean_cell(rows[: FEW - 1], "force") == said
    assert mean_cell(rows[:2], "force") == "5.00"
    assert mean_cell([*rows[:2], {"point": "0", "force": None}, {"point": "0", "force": math.nan}], "force") == "5.00"
    assert mean_cell([], "force") == mean_cell([{"point": "0", "force": None}], "force") == MISSING
    wide = spread_cell([0.0, 0.1, 1.0], range(3), "share", ratio=True)
    assert wide == f"37{NO_BREAK}% (0.0{NO_BREAK}to{NO_BREAK}100{NO_BREAK}%)"
    assert spread_cell([0.25] * 2, range(2), "share", ratio=True) == f"25{NO_BREAK}%"
    assert (
        spread_cell([0.25] * 30, range(30), "share", ratio=True)
        == f"25{NO_BREAK}% (25{NO_BREAK}to{NO_BREAK}25{NO_BREAK}%)"
    )


def test_a_line_breaks_only_before_the_interval() -> None:
    assert with_interval("1 x", ("0 x", "2 x")).split(" ") == [
        f"1{NO_BREAK}x",
        f"(0{NO_BREAK}x{NO_BREAK}to{NO_BREAK}2{NO_BREAK}x)",
    ]
    assert with_interval("1 x", None) == f"1{NO_BREAK}x"


def test_captions_say_what_brackets_are() -> None:
    many, few = brackets("motions", FEW), brackets("roll-outs", FEW - 1)
    means = "of means over motions (bootstrap; Student's t of fewer than 10)"
    assert many == f"In brackets: 95 % intervals, of shares (Wilson) and {means}"
    assert few == "In brackets: 95 % intervals, of shares (Wilson) and of means over roll-outs (Student's t)"
    assert brackets("motions", FEW, shares=False) == f"In brackets: 95 % intervals {means}"
    assert brackets("boxes", 3, shares=False) == "In brackets: 95 % intervals of means over boxes (Student's t)"
    assert brackets("boxes", 2, shares=False) == "Means over fewer than 3 boxes have no interval"
    assert brackets("boxes", 2) == SHARES
