"""Cleaning: what is repaired is counted, what cannot be repaired is refused by name, place and remedy."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pipeline.errors import DataError
from stages.ingest.cleaning import clean, clean_quaternions, in_order, outliers
from stages.ingest.clocks import SECOND, choose_clock, header_problem, lateness
from stages.ingest.parameters import RecordingParameters, Source
from stages.ingest.recording import Report
from stages.ingest.selections.resolved import Track

DEFAULT = RecordingParameters(sources=(Source(files=("x",)),), left="l", right="r")
START = 1_700_000_000 * SECOND


def reach(count=200, rate=100):
    s = np.linspace(0.0, 1.0, count)
    smooth = 10 * s**3 - 15 * s**4 + 6 * s**5
    position = np.column_stack([0.3 + 0.5 * smooth, 0.1 * np.sin(np.pi * s), 0.8 + 0.05 * np.cos(4 * s)])
    time = START + np.arange(count, dtype=np.int64) * (SECOND // rate)
    return time, position


def track(position=None, time=None, stamp=None, quaternion=None):
    clock, path = reach()
    time = clock if time is None else time
    return Track(log_time=time, stamp=stamp, values=path if position is None else position, quaternion=quaternion)


def cleaned(found, clock="log", **changes):
    report = Report()
    return clean(found, clock, "demo.bag, left arm", dataclasses.replace(DEFAULT, **changes), report), report


def refusal(found, clock="log", **changes):
    with pytest.raises(DataError) as caught:
        cleaned(found, clock, **changes)
    sentence = str(caught.value)
    assert sentence.startswith("demo.bag, left arm: ")
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence


# --- what is clean stays as it is ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "rate"), [(50, 10), (200, 100), (3000, 1000)])
def test_clean_recordings_pass_bit_for_bit(count, rate):
    time, position = reach(count, rate)
    arm, report = cleaned(track(position, time))
    assert np.array_equal(arm.time, time)
    assert np.array_equal(arm.position, position)
    assert arm.quaternion is None
    assert report.counts == {"messages": count}
    assert report.notes == []


@given(seed=st.integers(0, 10_000), rate=st.sampled_from([10, 30, 100, 500]))
def test_no_smooth_motion_has_outliers_or_jumps(seed, rate):
    generator = np.random.default_rng(seed)
    duration = generator.uniform(2.0, 6.0)
    t = np.arange(0.0, duration, 1.0 / rate)
    frequency, phase = generator.uniform(0.1, 1.0, (4, 3)), generator.uniform(0, 6, (4, 3))
    amplitude = generator.uniform(0.02, 0.1, (4, 3))
    position = (amplitude * np.sin(2 * np.pi * frequency * t[:, None, None] + phase)).sum(axis=1)
    position += generator.normal(0.0, 2e-4, position.shape)
    time = START + np.round(t * SECOND).astype(np.int64)
    arm, report = cleaned(track(position, time))
    assert arm.time.size == t.size
    assert set(report.counts) == {"messages"}


# --- order, duplicates, numbers --------------------------------------------------------------------------------------


def test_late_messages_are_sorted_and_duplicates_dropped():
    time, position = reach()
    order = np.arange(200)
    order[[50, 51]] = order[[51, 50]]
    order = np.insert(order, 120, [119, 119])
    arm, report = cleaned(track(position[order], time[order]))
    assert np.array_equal(arm.time, time)
    assert np.array_equal(arm.position, position)
    assert report.counts == {"messages": 202, "reordered": 1, "duplicates": 2}


def test_lateness_by_hand():
    assert np.array_equal(lateness(np.array([1, 3, 2, 2, 5, 4])), [0, 0, 1, 1, 0, 1])


def test_of_equal_stamps_the_first_stays():
    assert np.array_equal(in_order(np.array([5, 7, 7, 6, 5]), "x", "record it again", Report()), [0, 3, 1])
    many = np.repeat(np.arange(100), 7)
    assert np.array_equal(in_order(many, "x", "record it again", Report()), np.arange(0, 700, 7))


def test_a_clock_that_was_set_back_is_refused():
    time, _ = reach()
    back = time - np.where(np.arange(200) >= 120, SECOND, 0)
    sentence = refusal(track(time=back))
    assert (
        "its clock jumps back by 0.990 s at message 121, 1.190 s after the first: cut the recording there" in sentence
    )
    assert "set ingest.clock to 'header'." in refusal(track(time=back, stamp=time))
    assert "set ingest.clock to 'log'." in refusal(track(stamp=back), "header")


def test_what_is_not_a_number_is_dropped_and_counted():
    _, position = reach()
    position = position.copy()
    position[10:13] = np.nan
    position[20, 1] = np.inf
    arm, report = cleaned(track(position))
    assert arm.time.size == 196
    assert report.counts == {"messages": 200, "not_finite": 4}
    position[:50] = np.nan
    assert "50 of 200 samples have a position that is not a finite number" in refusal(track(position))


def test_zero_stamps_are_dropped_on_the_header_clock():
    time, _ = reach()
    stamp = time.copy()
    stamp[:2] = 0
    arm, report = cleaned(track(stamp=stamp), "header")
    assert arm.time.size == 198
    assert report.counts["zero_stamps"] == 2
    assert "all header stamps are zero: set ingest.clock to 'log'" in refusal(
        track(stamp=np.zeros_like(time)), "header"
    )


def test_a_clock_that_begins_at_zero_is_a_clock():
    time, _ = reach()
    time = time - time[0]
    arm, report = cleaned(track(time=time, stamp=time), "header")
    assert arm.time.size == 200
    assert arm.time[0] == 0
    assert not report.counts.get("zero_stamps")
    assert header_problem(track(time=time, stamp=time)) == ""


def test_placeholders_before_the_first_pose_are_dropped():
    _, position = reach()
    position = position.copy()
    position[:7] = 0.0
    arm, report = cleaned(track(position))
    assert arm.time.size == 193
    assert report.counts == {"messages": 200, "placeholders": 7}


def test_a_motion_through_the_origin_is_kept():
    _, position = reach()
    arm, report = cleaned(track(position - position[100]))
    assert arm.time.size == 200
    assert report.counts == {"messages": 200}


# --- outliers and jumps ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [1, 2, 3])
@pytest.mark.parametrize("at", [0, 60, 198])
def test_spikes_are_removed(length, at):
    _, position = reach()
    position = position.copy()
    length = min(length, 2) if at != 60 else length  # a longer one at an end is no spike but a part of the way
    position[at : at + length] += [0.0, 0.3, 0.0]
    arm, report = cleaned(track(position))
    assert report.counts == {"messages": 200, "outliers": length}
    assert arm.position[:, 1].max() < 0.11


def test_spikes_stay_where_that_is_asked():
    _, position = reach()
    position = position.copy()
    position[60, 1] += 0.05
    arm, report = cleaned(track(position), outlier_threshold=0.0)
    assert arm.time.size == 200
    assert report.counts == {"messages": 200}


def test_hampel_by_hand():
    fast = np.arange(15, dtype=np.int64) * 5_000_000  # at 200 Hz an arm moves 5 mm a sample
    position = np.zeros((15, 3))
    position[7] = [0.0, 0.006, 0.0]
    position[3] = [0.0, 0.004, 0.0]
    found = outliers(fast, position, 6.0)
    assert np.flatnonzero(found).tolist() == [7]  # .004 is nearer than 5 mm
    # Distances in the window of sample 7 become 1, 2, 3, 30 mm ...: median 2 mm, limit 6 x 1.4826 x 2 = 17.8 mm
    position = np.array([0, 0, 0, 0, 1, -2, 3, 17, -3, 2, -1, 0, 0, 0, 0])[:, None] * np.array([[1e-3, 0, 0]])
    assert not outliers(fast, position, 6.0)[7]
    position[7, 0] = 0.019
    assert outliers(fast, position, 6.0)[7]
    # At 10 Hz 19 mm are less than an arm at 1 m/s moves between two samples: a short press is motion.
    assert not outliers(20 * fast, position, 6.0).any()


def test_many_outliers_are_refused():
    _, position = reach()
    position = position.copy()
    position[::4, 1] += 0.2
    assert "are outliers: raise ingest.outlier_threshold" in refusal(track(position))


def test_jumps_are_refused_with_their_time():
    _, position = reach()
    jumped = position.copy()
    jumped[150:] += [0.0, 0.0, 0.3]
    sentence = refusal(track(jumped))
    assert "jumps by 0.300 m within 10 ms, 1.500 s after its first sample" in sentence
    assert "raise ingest.largest_jump (0.1 m)" in sentence
    arm, report = cleaned(track(jumped), largest_jump=0.4)
    assert arm.time.size == 200
    assert report.counts["teleports"] == 1


def test_a_short_teleport_is_told():
    _, position = reach()
    jumped = position.copy()
    jumped[120:] += [0.0, 0.0, 0.09]
    _, report = cleaned(track(jumped))
    assert report.counts["teleports"] == 1
    assert "mm within 10 ms, 1.200 s after its first sample" in report.notes[0]


def test_a_motion_faster_than_any_arm_is_a_jump_however_long_it_takes():
    _, position = reach()
    fast = position.copy()
    fast[100:, 0] += np.minimum(np.arange(100) * 0.15, 1.2)  # eight steps of 15 m/s
    assert "jumps by 0.15" in refusal(track(fast))


def test_slow_recordings_jump_where_a_step_is_out_of_proportion():
    time, position = reach(60, 5)
    position = position.copy()
    position[:, 1:] = 0.0
    position[30:, 1] += 0.5  # 2.5 m/s: no impossible speed, but 20 times that of the neighbours
    assert "jumps by 0.50" in refusal(track(position, time))


def test_a_step_over_a_gap_is_not_called_a_jump():
    time, position = reach()
    kept = np.r_[0:60, 140:200]
    arm, _ = cleaned(track(position[kept], time[kept]))
    assert arm.time.size == 120
    elsewhere = np.tile([0.0, 0.0, 0.5], (120, 1)) + np.linspace(0, 0.01, 120)[:, None]
    elsewhere[60:, 0] += 0.3  # 0.37 m/s on average over the gap, 0.01 m/s around it
    assert cleaned(track(elsewhere, time[kept]))[0].time.size == 120
    assert "jumps by 0.30" in refusal(track(elsewhere, time[kept]), longest_gap=1.0)


# --- arms that are of no use -----------------------------------------------------------------------------------------


def test_dead_arms_are_refused():
    _, position = reach()
    assert "all positions are zero: the arm was not tracked" in refusal(track(np.zeros_like(position)))
    noise = np.random.default_rng(0).normal(0.0, 5e-5, position.shape)
    assert "never moves: its path extends over 0." in refusal(track(position[:1] + noise))
    spiked = position[:1] + noise
    spiked[70] += 1.0
    assert "never moves" in refusal(track(spiked))


def test_few_samples_are_refused():
    time, position = reach()
    for count in (1, 9):
        assert f"has {count} usable sample(s) in {count} message(s), at different times; at least 10" in refusal(
            track(position[:count], time[:count])
        )


def test_units_are_suspected():
    _, position = reach()
    assert "if lengths are in millimetres, set ingest.scale to 0.001 (--scale 0.001)" in refusal(track(1000 * position))
    arm, report = cleaned(track(position + np.array([500.0, 0.0, 0.0])))
    assert arm.time.size == 200
    assert report.notes[0].startswith("demo.bag, left arm: coordinates reach 500.8 m; if lengths are in millimetres")


# --- quaternions -----------------------------------------------------------------------------------------------------


def turning(count=200):
    return Rotation.from_euler("z", np.linspace(0.0, 4.0, count)[:, None]).as_quat()


def test_quaternions_become_unit_and_continuous():
    right = turning()
    flipped = right * np.where(np.arange(200) % 7 == 0, -1.0, 1.0)[:, None]
    flipped[40:60] *= 2.5
    report = Report()
    found = clean_quaternions(flipped, "x", report)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(found, -right, rtol=0, atol=1e-15)  # the first one was flipped and sets the sign
    assert report.counts["unnormalised_quaternions"] == 20
    assert report.counts["quaternion_flips"] == int((np.diff(np.arange(200) % 7 == 0) != 0).sum())
    again = Report()
    np.testing.assert_allclose(clean_quaternions(found, "x", again), found, rtol=0, atol=1e-15)
    assert again.counts == {}


def test_zero_quaternions_are_interpolated_or_refused():
    quaternion = turning()
    expected = quaternion.copy()
    quaternion[10:13] = 0.0
    quaternion[20] = np.nan
    quaternion[-1] = 0.0
    report = Report()
    found = clean_quaternions(quaternion, "x", report)
    assert report.counts == {"zero_quaternions": 5}
    np.testing.assert_allclose(found[:-1], expected[:-1], rtol=0, atol=1e-4)
    np.testing.assert_allclose(found[-1], expected[-2], rtol=0, atol=1e-15)
    with pytest.raises(DataError, match=r"^x: 200 of 200 quaternions are zero .* select the position alone"):
        clean_quaternions(np.zeros((200, 4)), "x", Report())


# --- which clock -----------------------------------------------------------------------------------------------------


def test_headers_are_believed_where_they_are_sane():
    time, _ = reach()
    stamp = time - 3_000_000
    assert header_problem(track(stamp=stamp)) == ""
    assert header_problem(track(stamp=stamp - START)) == ""  # simulated time from 0 on
    assert header_problem(track(stamp=START + (stamp - START) // 3)) == ""  # a slow simulation
    one_zero = stamp.copy()
    one_zero[0] = 0
    assert header_problem(track(stamp=one_zero)) == ""


def test_headers_that_are_not_sane_say_why():
    time, _ = reach()
    assert header_problem(track()) == "messages have no header stamps"
    assert header_problem(track(stamp=np.zeros_like(time))) == "200 of 200 header stamps are zero"
    coarse = time // SECOND * SECOND
    assert header_problem(track(stamp=coarse)) == "header stamps increase in only 1 of 199 steps"
    back = time - np.where(np.arange(200) >= 120, SECOND, 0)
    assert header_problem(track(stamp=back)) == "header stamps jump back by 0.99 s"
    assert header_problem(track(stamp=time // 1000)) == "header stamps span 0.00199 s where 1.99 s were recorded"


def test_both_arms_are_on_one_clock():
    time, _ = reach()
    sane, none, zero = track(stamp=time), track(), track(stamp=np.zeros_like(time))
    report = Report()
    assert choose_clock({"left": sane, "right": sane}, "auto", "x", report) == "header"
    assert choose_clock({"left": sane, "right": none}, "auto", "x", report) == "log"
    assert choose_clock({"left": sane, "right": sane}, "log", "x", report) == "log"
    assert report.notes == []
    assert choose_clock({"left": sane, "right": zero}, "auto", "x", report) == "log"
    assert report.notes == [
        "x, right arm: 200 of 200 header stamps are zero; the times at which messages were recorded are used."
    ]
    with pytest.raises(
        DataError, match=r"^x, right arm: its messages have no header stamps: set ingest\.clock to 'log'"
    ):
        choose_clock({"left": sane, "right": none}, "header", "x", report)


# --- properties ------------------------------------------------------------------------------------------------------

HARMS = ("late", "double", "nan", "absurd", "spike", "zero quaternion", "flip", "scaled quaternion", "placeholder")


def harmed(generator, harms):
    """A clean track, the same with some samples harmed, and the samples that are still to be trusted."""
    time, position = reach()
    position, quaternion, time = position.copy(), turning(), time.copy()
    order = np.arange(200)
    for harm in harms:
        at = int(generator.integers(20, 180))
        if harm == "nan":
            position[at] = np.nan
        elif harm == "absurd":
            position[at] = generator.choice([1e300, -np.inf, 1e12])
        elif harm == "spike":
            position[at] += generator.choice([-1, 1], 3) * generator.uniform(0.05, 3.0, 3)
        elif harm == "zero quaternion":
            quaternion[at] = generator.choice([0.0, np.nan, 1e300])
        elif harm == "flip":
            quaternion[at:] *= -1.0
        elif harm == "scaled quaternion":
            quaternion[at] *= generator.uniform(0.1, 9.0)
        elif harm == "placeholder":
            position[: at // 10] = 0.0
        elif harm == "late":
            order[[at, at + 1]] = order[[at + 1, at]]
        elif harm == "double":
            order = np.insert(order, at, order[at])
    return Track(log_time=time[order], stamp=None, values=position[order], quaternion=quaternion[order])


@given(seed=st.integers(0, 100_000), harms=st.lists(st.sampled_from(HARMS), max_size=6))
def test_what_passes_is_what_was_true(seed, harms):
    with np.errstate(all="raise"):
        try:
            arm, report = cleaned(harmed(np.random.default_rng(seed), harms))
        except DataError:
            return
    time, position = reach()
    rows = np.searchsorted(time, arm.time)
    assert np.array_equal(time[rows], arm.time)
    assert (np.diff(arm.time) > 0).all()
    assert np.array_equal(arm.position, position[rows])
    np.testing.assert_allclose(np.linalg.norm(arm.quaternion, axis=1), 1.0, rtol=0, atol=1e-12)
    assert (np.abs((arm.quaternion * turning()[rows]).sum(axis=1)) > 0.999).all()
    assert ((arm.quaternion[1:] * arm.quaternion[:-1]).sum(axis=1) > 0.9).all()
    assert arm.time.size >= 200 - 20 - len(harms)
    assert report.counts["messages"] >= 200


@given(
    seed=st.integers(0, 100_000),
    count=st.integers(1, 60),
    scale=st.sampled_from([0.0, 1e-9, 1e-3, 1.0, 50.0, 1e300]),
    holes=st.floats(0.0, 1.0),
)
def test_garbage_is_refused_or_becomes_usable(seed, count, scale, holes):
    generator = np.random.default_rng(seed)
    values = scale * generator.uniform(-1.0, 1.0, (count, 7))
    values[generator.random(count) < holes] = generator.choice([0.0, np.nan, np.inf])
    time = generator.integers(0, 10 ** int(generator.integers(1, 18)), count)
    stamp = generator.choice([time, np.zeros_like(time), np.sort(time)])
    found = Track(log_time=time, stamp=stamp, values=values[:, :3], quaternion=values[:, 3:])
    with np.errstate(all="raise"):
        try:
            clock = choose_clock({"left": found}, "auto", "demo.bag", Report())
            arm, _ = cleaned(found, clock)
        except DataError:
            return
    assert np.isfinite(arm.position).all()
    assert (np.diff(arm.time) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(arm.quaternion, axis=1), 1.0, rtol=0, atol=1e-12)
