"""Stretches of a recording: overlap, rest, pauses, times, topics, gaps."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import DataError, ParameterError
from stages.ingest.parameters import NoDivision, PauseDivision, RecordingParameters, Source, TimeDivision, TopicDivision
from stages.ingest.recording import Report
from stages.ingest.segments import (
    Path,
    Signal,
    at_times,
    between_pauses,
    by_signal,
    gaps,
    moving,
    overlap,
    speed,
    split,
    without_gaps,
)

DEFAULT = RecordingParameters(sources=(Source(files=("x",)),), left="l", right="r")


def path(*corners, rate=100, begin=0.0):
    """Straight ways between (time, x) corners, sampled at `rate`."""
    times, places = zip(*corners, strict=True)
    time = np.arange(round(times[0] * rate), round(times[-1] * rate) + 1) / rate
    x = np.interp(time, times, places)
    return Path(time=time + begin, position=np.column_stack([x, np.zeros_like(x), np.ones_like(x)]))


STAYS = path((0, 0.0), (10, 0.0))
TWICE = path((0, 0.0), (1, 0.0), (3, 0.4), (6, 0.4), (8, 0.0), (10, 0.0))


def divided(arms, division=None, signal=None, **changes):
    report = Report()
    chosen = dataclasses.replace(DEFAULT, **({} if division is None else {"division": division}), **changes)
    return split(arms, chosen, signal, "demo.bag", report), report


def near(found, expected, tolerance=0.11):
    assert len(found) == len(expected)
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def test_overlap_by_hand():
    report = Report()
    first, second = path((0, 0), (5, 1)), path((4, 0), (9, 1))
    assert overlap({"left": first, "right": second}, "x", report) == (4.0, 5.0)
    assert report.counts == {"outside_overlap": 800}
    assert report.notes == ["x: the arms have only 1.00 s of 5.00 s in common."]
    with pytest.raises(
        DataError, match=r"^x: the arms have no time in common \(left 0\.000 to 5\.000 s, right 6\.000 to 9\.000 s\)"
    ):
        overlap({"left": first, "right": path((6, 0), (9, 1))}, "x", report)


def test_speed_by_hand():
    np.testing.assert_allclose(speed(TWICE, np.array([2.0, 5.0, 1.0, 0.0, 10.0])), [0.2, 0, 0.1, 0, 0], atol=1e-12)
    steady = path((0, 0), (2, 1))
    np.testing.assert_allclose(speed(steady, np.array([0.0, 0.05, 1.0, 2.0])), 0.5)


def test_speed_of_an_arm_that_shakes():
    noisy = np.random.default_rng(0).normal(0.0, 1e-4, STAYS.position.shape)
    assert speed(Path(time=STAYS.time, position=STAYS.position + noisy), STAYS.time).max() < 0.005


def test_rest_is_cut_from_when_no_arm_moves():
    assert moving({"point": TWICE}, (0.0, 10.0), 0.01) == pytest.approx((1.0, 8.0), abs=0.11)
    earlier = path((0, 0.0), (0.5, 0.0), (2, 0.1), (10, 0.1))
    assert moving({"left": TWICE, "right": earlier}, (0.0, 10.0), 0.01) == pytest.approx((0.5, 8.0), abs=0.11)
    assert moving({"point": STAYS}, (0.0, 10.0), 0.01) == (0.0, 10.0)


def test_a_slow_motion_keeps_its_ends_and_a_long_rest_goes():
    s = np.linspace(0.0, 1.0, 10_001)
    reach = 0.6 * (10 * s**3 - 15 * s**4 + 6 * s**5)
    slow = Path(time=100 * s, position=np.column_stack([reach, np.zeros_like(s), np.zeros_like(s)]))
    start, end = moving({"point": slow}, (0.0, 100.0), 0.005)
    kept = np.interp([start, end], slow.time, reach)
    assert kept[1] - kept[0] > 0.99 * 0.6
    late = path((0, 0.0), (200, 0.0), (204, 0.4), (400, 0.4))
    assert moving({"point": late}, (0.0, 400.0), 0.005) == pytest.approx((200.0, 204.0), abs=0.11)


def test_pauses_by_hand():
    near(between_pauses({"point": TWICE}, (0.0, 10.0), 0.01, 0.5), [(0.9, 3.1), (5.9, 8.1)])
    near(between_pauses({"point": TWICE}, (0.0, 10.0), 0.01, 2.5), [(0.0, 3.1), (5.9, 10.0)])
    one_moves = {"left": TWICE, "right": path((0, 0), (10, 1))}
    assert between_pauses(one_moves, (0.0, 10.0), 0.01, 0.5) == [(0.0, 10.0)]


def test_times_by_hand():
    assert at_times((0.5, 9.0), (2.0, 3.0), "x") == [(0.5, 2.0), (2.0, 3.0), (3.0, 9.0)]
    with pytest.raises(ParameterError, match=r"^ingest\.division\.times: must increase\.$"):
        at_times((0.5, 9.0), (3.0, 3.0), "x")
    with pytest.raises(
        DataError, match=r"^x: ingest\.division\.times has 0\.2 s; both arms are recorded from 0\.500 to"
    ):
        at_times((0.5, 9.0), (0.2,), "x")


def signal(*pairs, boolean=False):
    time, value = np.array(pairs, dtype=float).T
    return Signal(time=time, value=value, boolean=boolean)


def test_signals_by_hand():
    bits = signal((0, 0), (2, 1), (3, 1), (4, 0), (6, 1), boolean=True)
    assert by_signal((0.5, 9.0), bits, "x") == [(2.0, 4.0), (6.0, 9.0)]
    assert by_signal((2.5, 9.0), bits, "x") == [(2.5, 4.0), (6.0, 9.0)]
    numbers = signal((0, 0), (2, 7), (3, 7), (4, 0), (6, np.nan))
    assert by_signal((0.5, 9.0), numbers, "x") == [(0.5, 2.0), (2.0, 4.0), (4.0, 9.0)]
    with pytest.raises(DataError, match=r"^x: the topic of ingest\.division marks no time in which both"):
        by_signal((0.5, 9.0), signal((0, 0), (2, 0), boolean=True), "x")
    with pytest.raises(DataError, match=r"^x: the topic of ingest\.division has no values"):
        by_signal((0.5, 9.0), signal((0, np.nan)), "x")


def with_gap(begin, end, whole=TWICE):
    kept = (whole.time <= begin) | (whole.time >= end)
    return Path(time=whole.time[kept], position=whole.position[kept])


def test_gaps_by_hand():
    holed = with_gap(4.0, 5.0)
    assert gaps(holed.time, (0.0, 10.0), 0.5) == [(4.0, 5.0)]
    assert gaps(holed.time, (0.0, 10.0), 1.5) == []
    assert gaps(holed.time, (5.0, 10.0), 0.5) == []
    other = with_gap(4.5, 7.0)
    found = without_gaps({"left": holed, "right": other}, (1.0, 9.0), 0.5)
    assert found == [(1.0, 4.0), (7.0, 9.0)]
    assert without_gaps({"left": TWICE}, (1.0, 9.0), 0.5) == [(1.0, 9.0)]


def test_no_division_is_one_demonstration_without_its_rest():
    found, report = divided({"point": TWICE})
    near(found, [(0.95, 8.05)])
    assert report.counts == {"trimmed": 1001 - 719}
    assert divided({"point": TWICE}, trim=False)[0] == [(0.0, 10.0)]


def test_gaps_count_only_where_there_is_a_demonstration():
    assert len(divided({"point": with_gap(8.5, 9.5)})[0]) == 1
    with pytest.raises(
        DataError,
        match=r"^demo\.bag: no samples for 1\.000 s, from 4\.000 to 5\.000 s: divide .*longest_gap \(0\.5 s\)",
    ):
        divided({"point": with_gap(4.0, 5.0)})
    with pytest.raises(DataError, match=r"^demo\.bag: the right arm has no samples for 1\.000 s"):
        divided({"left": TWICE, "right": with_gap(4.0, 5.0)})
    assert len(divided({"point": with_gap(4.0, 5.0)}, longest_gap=2.0)[0]) == 1


def test_division_by_each_means():
    arms = {"left": TWICE, "right": STAYS}
    near(divided(arms, PauseDivision())[0], [(0.95, 3.05), (5.95, 8.05)])
    near(divided(arms, TimeDivision(times=(4.5,)))[0], [(0.95, 3.05), (5.95, 8.05)])
    bits = signal((0, 0), (0.5, 1), (5, 0), (5.5, 1), (9, 0), boolean=True)
    near(divided(arms, TopicDivision(topic="/t"), bits)[0], [(0.95, 3.05), (5.95, 8.05)])
    found, report = divided(arms, TimeDivision(times=(4.0, 5.0, 9.5)))
    near(found, [(0.95, 3.05), (5.95, 8.05)])
    assert report.counts["pieces_dropped"] == 2


def test_a_gap_divides_what_is_divided_anyway():
    found, _ = divided({"point": with_gap(6.5, 7.5)}, TimeDivision(times=(4.5,)))
    near(found, [(0.95, 3.05), (5.95, 6.5), (7.5, 8.05)])


def test_nothing_left_is_refused():
    with pytest.raises(
        DataError, match=r"^demo\.bag: division by pauses leaves no demonstration in which an arm moves"
    ):
        divided({"point": STAYS}, PauseDivision())
    few = path((0, 0), (1, 1), rate=5)
    with pytest.raises(DataError, match=r"^demo\.bag: has 6 sample\(s\) of an arm where both .*; 10 at least"):
        divided({"point": few})


@given(
    seed=st.integers(0, 100_000),
    kind=st.sampled_from(["none", "pauses", "times", "topic"]),
    trim=st.booleans(),
    rate=st.sampled_from([10, 50, 200]),
)
def test_stretches_are_apart_inside_and_without_gaps(seed, kind, trim, rate):
    generator = np.random.default_rng(seed)

    def arm():
        times = np.cumsum(generator.uniform(0.3, 2.0, 8))
        whole = path(
            *zip(np.round(times, 2), generator.uniform(-0.3, 0.3, 8) * generator.integers(0, 2, 8), strict=True)
        )
        return Path(time=whole.time[:: 200 // rate], position=whole.position[:: 200 // rate]) if rate > 50 else whole

    arms = {"left": arm(), "right": arm()}
    if seed % 3 == 0:
        hole = generator.uniform(0.0, 8.0)
        arms["left"] = with_gap(hole, hole + 0.8, arms["left"])
    signal_ = signal(*((t, generator.integers(0, 2)) for t in np.arange(0.0, 12.0, 0.5)), boolean=bool(seed % 2))
    division = {
        "none": NoDivision(),
        "pauses": PauseDivision(duration=0.2),
        "times": TimeDivision(times=(3.0, 5.0)),
        "topic": TopicDivision(topic="/t"),
    }[kind]
    try:
        found, report = divided(arms, division, signal_, trim=trim)
    except DataError:
        return
    first, last = max(a.time[0] for a in arms.values()), min(a.time[-1] for a in arms.values())
    assert found == sorted(found)
    assert all(first <= begin < end <= last for begin, end in found)
    assert all(before[1] <= behind[0] for before, behind in pairwise(found))
    for span in found:
        for a in arms.values():
            inner = a.time[(a.time >= span[0]) & (a.time <= span[1])]
            assert inner.size >= 10
            assert np.diff(inner).max() <= 0.5
            assert inner[0] - span[0] <= 0.5
            assert span[1] - inner[-1] <= 0.5
    assert len(found) == 1 or kind != "none" or report.counts
