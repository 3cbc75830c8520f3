"""Trajectories from demonstrations: eq. (4), clocks, resampling, smoothing, velocities, goal, refusals."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import DataError, ParameterError
from pipeline.stage import StageContext
from stages.artifacts.demonstrations import write_demonstrations
from stages.artifacts.parquet import header
from stages.ingest.lasa import motion_file, read_lasa
from stages.ingest.parameters import LasaParameters
from stages.midpoint.clamp import clamp, clamp_axis, varies
from stages.midpoint.midpoint import (
    arm_separation,
    common_goal,
    is_uniform,
    midpoint,
    midpoint_path,
    resampled,
    shifted_onto,
    smoothed,
    to_trajectories,
    uniform_clock,
    velocity_of,
    window_length,
)
from stages.midpoint.parameters import MidpointParameters
from stages.midpoint.stage import STAGE
from stages.trajectory import ArmRecording, Demonstration

DEFAULT = MidpointParameters()


def point(position, time=None, demo="1", split="train", dataset="Made"):
    position = np.asarray(position, dtype=float)
    time = np.linspace(0.0, 1.0, position.shape[0]) if time is None else time
    return Demonstration(
        dataset=dataset, demo=demo, split=split, arms={"point": ArmRecording(time=time, position=position)}
    )


def arms(left_time, left, right_time, right, demo="1"):
    return Demonstration(
        dataset="Made",
        demo=demo,
        split="train",
        arms={
            "left": ArmRecording(time=left_time, position=left),
            "right": ArmRecording(time=right_time, position=right),
        },
    )


def line(start, end, samples=21):
    return np.linspace(np.asarray(start, dtype=float), np.asarray(end, dtype=float), samples)


def pair(**second):
    return [point(line([0, 0], [1, 2])), point(line([0, 1], [1, 3]), demo="2", **second)]


# --- eq. (4) ----------------------------------------------------------------------------------------------------------


def test_midpoint_by_hand():
    left, right = np.array([[0.4, 0.3, 1.0], [0.5, 0.2, 1.2]]), np.array([[0.2, -0.3, 1.0], [0.5, -0.4, 1.0]])
    np.testing.assert_allclose(midpoint(left, right), [[0.3, 0.0, 1.0], [0.5, -0.1, 1.1]], rtol=0, atol=1e-15)


def test_separation_by_hand():
    left, right = np.array([[3.0, 4.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    assert np.array_equal(arm_separation(left - right), [5.0, 2.0])


def test_midpoint_inverts_the_arms_of_eq_13():
    centre, half = line([0.1, 0.2, 0.3], [0.5, 0.1, 0.9]), np.array([0.0, 0.15, 0.0])
    left, right = centre + half, centre - half
    np.testing.assert_allclose(midpoint(left, right), centre, rtol=0, atol=1e-15)
    np.testing.assert_allclose(arm_separation(left - right), 0.3, rtol=0, atol=1e-15)


def test_arms_of_different_clocks_meet_inside_their_overlap():
    left_time, right_time = np.linspace(1.0, 3.0, 41), np.linspace(2.0, 5.0, 31)

    def path(time, offset):
        return np.column_stack([2.0 * time, -time + offset, 0.5 * time])

    time, position, difference = midpoint_path(
        arms(left_time, path(left_time, 0.2), right_time, path(right_time, -0.2)), None
    )
    # 21 of the left arm's samples and 11 of the right arm's lie in 2 ... 3 s
    assert time.shape == (21,)
    np.testing.assert_allclose(time, np.linspace(0.0, 1.0, 21), rtol=0, atol=1e-12)
    np.testing.assert_allclose(position, path(2.0 + time, 0.0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(difference, np.tile([0.0, 0.4, 0.0], (21, 1)), rtol=0, atol=1e-12)


def test_arms_of_one_clock_pass_through_bit_for_bit():
    generator = np.random.default_rng(3)
    left, right = generator.normal(size=(11, 3)), generator.normal(size=(11, 3))
    clock = np.linspace(0.0, 1.0, 11)
    time, position, _ = midpoint_path(arms(clock, left, clock, right), None)
    assert np.array_equal(time, clock)
    assert np.array_equal(position, (left + right) / 2)


def test_two_arms_end_to_end():
    clock = np.linspace(10.0, 12.0, 101)
    centre = line([0, 0, 1], [0.4, 0.2, 1.5], 101)
    half = np.array([0.0, 0.1, 0.0])
    result = to_trajectories(
        [arms(clock, centre + half, clock, centre - half, demo) for demo in ("1", "2")], MidpointParameters()
    )
    np.testing.assert_allclose(result.goal, [0.4, 0.2, 1.5], rtol=0, atol=1e-14)
    for trajectory, separation in zip(result.trajectories, result.separations, strict=True):
        assert trajectory.dimension == 3
        np.testing.assert_allclose(trajectory.velocity, np.tile([0.2, 0.1, 0.25], (101, 1)), rtol=0, atol=1e-11)
        np.testing.assert_allclose(separation, 0.2, rtol=0, atol=1e-14)


# --- the clamp axis and L of eq. (13) ---------------------------------------------------------------------------------


def test_clamp_by_hand():
    difference = np.array([[0.03, 0.30, 0.0], [0.03, 0.32, 0.0], [0.03, 0.28, 0.0], [0.03, 0.34, 0.0]])
    found = clamp(difference, "y")
    assert found.mean == pytest.approx(0.31)
    assert found.spread == pytest.approx(np.sqrt((1 + 1 + 9 + 9) / 4) * 0.01)
    assert found.deviation == pytest.approx(0.03)
    assert found.tilt == pytest.approx(np.arctan(0.03 / 0.31))
    assert clamp(-difference, "y").mean == pytest.approx(-0.31)
    assert clamp(difference, "x").mean == pytest.approx(0.03)


def test_clamp_axis_is_found_or_given():
    along_x, along_z = np.tile([0.4, 0.1, -0.2], (5, 1)), np.tile([0.0, 0.0, -0.5], (9, 1))
    assert clamp_axis([along_x], "auto") == "x"
    assert clamp_axis([along_z], "auto") == "z"
    assert clamp_axis([along_x, along_z], "auto") == "z"  # each counts alike: (.2, .05, .35)
    assert clamp_axis([along_x, -along_x], "auto") == "x"  # arms that changed sides do not cancel
    assert clamp_axis([along_x], "y") == "y"
    with pytest.raises(ParameterError, match=r"^midpoint\.clamp_axis: is 'z'; the data have 2 coordinates\.$"):
        clamp_axis([along_x[:, :2]], "z")
    with pytest.raises(DataError, match=r"^demonstrations: both arms are at one place"):
        clamp_axis([np.zeros((5, 3))], "auto")


def held(separation, demo):
    clock = np.linspace(0.0, 2.0, 101)
    centre = line([0, 0, 1], [0.4, 0.2, 1.5], 101)
    half = np.column_stack([np.zeros(101), np.broadcast_to(separation, 101) / 2, np.zeros(101)])
    return arms(clock, centre + half, clock, centre - half, demo)


def test_two_arms_report_their_separation():
    slipping = 0.3 + 0.05 * np.linspace(0.0, 1.0, 101)
    result = to_trajectories([held(0.3, "1"), held(slipping, "2")], DEFAULT)
    assert result.clamp_axis == "y"
    assert result.clamps[0].mean == pytest.approx(0.3)
    assert result.clamps[0].deviation == pytest.approx(0.0, abs=1e-15)
    assert result.clamps[1].mean == pytest.approx(0.325)
    assert result.clamps[1].deviation == pytest.approx(0.025)
    assert varies(result.clamps[0], 0.02, "y", "Made, demonstration 1") == ""
    assert varies(result.clamps[1], 0.03, "y", "Made, demonstration 2") == ""
    sentence = varies(result.clamps[1], 0.02, "y", "Made, demonstration 2")
    assert sentence.startswith(
        "Made, demonstration 2: the separation of the arms along y, 0.3250 m on average, varies by"
    )
    single = to_trajectories(pair(), MidpointParameters(end_spread=1.0))
    assert single.clamp_axis is None
    assert single.clamps == (None, None)


def test_the_stage_warns_and_keeps_the_separation(tmp_path):
    inputs = {"demonstrations": tmp_path / "demonstrations.parquet"}
    outputs = {"midpoints": tmp_path / "midpoints.parquet"}
    write_demonstrations(inputs["demonstrations"], [held(0.3, "1"), held(np.linspace(0.3, 0.4, 101), "2")], {})
    context = StageContext(stage="midpoint", parameters=DEFAULT, inputs=inputs, sources={}, outputs=outputs)
    STAGE.run(context)
    assert [warning.partition(":")[0] for warning in context.warnings] == ["Made, demonstration 2"]
    found = header(outputs["midpoints"])
    assert found["clamp_axis"] == "y"
    assert [entry["mean"] for entry in found["separation"]] == pytest.approx([0.3, 0.35])
    figures = STAGE.headline(outputs)
    assert figures["separation_m"] == pytest.approx(0.325)
    assert figures["separation_deviation_m"] == pytest.approx(0.05)


# --- clock and resampling ---------------------------------------------------------------------------------------------


def test_uniform_clock():
    clock = np.linspace(0.3, 2.0, 50)
    assert uniform_clock([clock], None, "x") is clock
    assert uniform_clock([clock], 50, "x") is clock
    jittered = clock.copy()
    jittered[7] += 1e-4
    assert not is_uniform(jittered)
    assert np.array_equal(uniform_clock([jittered], None, "x"), np.linspace(0.3, 2.0, 50))
    assert np.array_equal(uniform_clock([clock], 20, "x"), np.linspace(0.3, 2.0, 20))


def test_uniformity_is_relative_to_the_period():
    for scale in (1e-6, 1.0, 1e6):
        clock = np.linspace(0.0, scale, 11)
        for share, expected in ((1e-10, True), (1e-8, False)):
            moved = clock.copy()
            moved[5] += share * scale / 10
            assert is_uniform(moved) is expected


def test_resampling_is_exact_for_lines_on_any_clock():
    generator = np.random.default_rng(5)
    time = np.sort(generator.uniform(0.0, 2.0, 40))
    clock = np.linspace(time[0], time[-1], 173)
    values = np.column_stack([3.0 * time - 1.0, -0.5 * time])
    expected = np.column_stack([3.0 * clock - 1.0, -0.5 * clock])
    np.testing.assert_allclose(resampled(time, values, clock), expected, rtol=0, atol=1e-13)


def test_resampling_is_exact_for_parabolas_on_a_uniform_clock():
    time, clock = np.linspace(0.0, 2.0, 21), np.linspace(0.0, 2.0, 117)
    values = np.column_stack([time**2 - 1.0, 3.0 - 2.0 * time - 0.5 * time**2])
    expected = np.column_stack([clock**2 - 1.0, 3.0 - 2.0 * clock - 0.5 * clock**2])
    np.testing.assert_allclose(resampled(time, values, clock), expected, rtol=0, atol=1e-14)


def test_resampling_converges_on_a_smooth_path():
    clock = np.linspace(0.0, 2.0, 501)
    errors = []
    for samples in (40, 80):
        time = np.linspace(0.0, 2.0, samples)
        error = resampled(time, np.sin(3.0 * time)[:, None], clock)[:, 0] - np.sin(3.0 * clock)
        errors.append(np.abs(error).max())
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 4


def test_two_messages_almost_at_once_do_not_overshoot():
    generator = np.random.default_rng(0)
    time = np.sort(np.linspace(0.0, 1.0, 101) + generator.uniform(-2e-3, 2e-3, 101))
    time[50] = time[49] + 1e-6
    values = np.sin(3.0 * time) + generator.normal(0.0, 1e-4, 101)
    clock = np.linspace(time[0], time[-1], 1001)
    error = resampled(time, values[:, None], clock)[:, 0] - np.sin(3.0 * clock)
    assert np.abs(error).max() < 6e-4


def test_jittered_recording_comes_out_uniform():
    generator = np.random.default_rng(2)
    time = 1.7e9 + np.sort(generator.uniform(0.0, 3.0, 200))  # seconds since 1970, as bags have them
    path = np.column_stack([time - time[0], 2.0 * (time - time[0])])
    result = to_trajectories([point(path, time, demo) for demo in ("1", "2")], DEFAULT)
    trajectory = result.trajectories[0]
    assert trajectory.time[0] == 0.0
    assert np.ptp(np.diff(trajectory.time)) < 1e-6
    np.testing.assert_allclose(trajectory.duration, time[-1] - time[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diff(trajectory.position[:, 1]), 2 * np.diff(trajectory.time), rtol=0, atol=1e-5)


@pytest.mark.parametrize("samples", [10, 57, 2000])
def test_samples_are_what_is_asked(samples):
    result = to_trajectories(pair(), MidpointParameters(samples=samples, end_spread=1.0))
    assert result.samples == (samples, samples)
    assert [t.time.shape for t in result.trajectories] == [(samples,), (samples,)]
    np.testing.assert_allclose(result.trajectories[0].velocity, np.tile([1.0, 2.0], (samples, 1)), rtol=0, atol=1e-10)


# --- windows, smoothing, velocities -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fraction", "samples", "least", "window"),
    [
        (0.005, 1000, 3, 5),
        (0.006, 1000, 3, 7),
        (0.0, 1000, 2, 3),
        (0.0, 1000, 6, 7),
        (0.5, 1000, 3, 501),
        (0.5, 4, 3, 3),
        (0.5, 3, 3, 3),
    ],
)
def test_window_length(fraction, samples, least, window):
    assert window_length(fraction, samples, least) == window


@given(
    polynomial=st.integers(1, 5),
    fraction=st.floats(0.0, 0.5),
    samples=st.integers(7, 300),
    coefficients=st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6),
    duration=st.floats(0.1, 20.0),
)
def test_velocities_are_exact_for_polynomials_of_their_degree(polynomial, fraction, samples, coefficients, duration):
    time = np.linspace(0.0, duration, samples)
    curve = np.polynomial.Polynomial(coefficients[: polynomial + 1])
    position = curve(time / duration)[:, None]
    expected = curve.deriv()(time / duration)[:, None] / duration
    velocity = velocity_of(time, position, fraction, polynomial)
    np.testing.assert_allclose(velocity, expected, rtol=0, atol=1e-9 * samples / duration)


def test_velocity_of_a_parabola_by_hand():
    time = np.linspace(0.0, 2.0, 9)
    position = np.column_stack([time**2, 1.0 - time])
    velocity = velocity_of(time, position, 0.005, 2)
    np.testing.assert_allclose(velocity, np.column_stack([2.0 * time, -np.ones(9)]), rtol=0, atol=1e-13)


def test_a_wider_window_quietens_velocities():
    generator = np.random.default_rng(8)
    time = np.linspace(0.0, 1.0, 400)
    position = np.column_stack([np.sin(2 * time), np.cos(2 * time)])
    truth = np.column_stack([2 * np.cos(2 * time), -2 * np.sin(2 * time)])
    noisy = position + generator.normal(0.0, 1e-4, position.shape)
    narrow, wide = (np.abs(velocity_of(time, noisy, width, 2) - truth).mean() for width in (0.005, 0.1))
    assert wide < narrow / 10


@pytest.mark.parametrize("polynomial", [1, 2, 3, 4, 5])
def test_smoothing_keeps_polynomials_and_removes_noise(polynomial):
    time = np.linspace(-1.0, 1.0, 200)
    position = np.column_stack([time**polynomial, 1.0 - time**polynomial])
    np.testing.assert_allclose(smoothed(position, 0.2, polynomial), position, rtol=0, atol=1e-9)
    noisy = position + np.random.default_rng(4).normal(0.0, 0.01, position.shape)
    assert np.abs(smoothed(noisy, 0.2, polynomial) - position).mean() < np.abs(noisy - position).mean() / 2


@pytest.mark.parametrize("polynomial", [1, 2, 3, 4, 5])
def test_the_narrowest_smoothing_does_something(polynomial):
    noisy = np.random.default_rng(4).normal(0.0, 0.01, (100, 2))
    assert np.abs(smoothed(noisy, 1e-6, polynomial) - noisy).max() > 1e-4


def test_no_smoothing_changes_no_bit():
    noisy = np.random.default_rng(4).normal(0.0, 0.01, (100, 2))
    assert smoothed(noisy, 0.0, 2) is noisy


# --- goal and shift ---------------------------------------------------------------------------------------------------


def test_goal_is_the_mean_end_of_the_training_demonstrations_only():
    demonstrations = [
        point(line([0, 0], [1, 2]), demo="1"),
        point(line([0, 0], [2, 4]), demo="2"),
        point(line([0, 0], [9, 9]), demo="3", split="test"),
    ]
    result = to_trajectories(demonstrations, MidpointParameters(end_spread=4.0))
    assert np.array_equal(result.goal, [1.5, 3.0])
    assert np.array_equal(result.shifts, [[0.5, 1.0], [-0.5, -1.0], [-7.5, -6.0]])
    for trajectory, shift in zip(result.trajectories, result.shifts, strict=True):
        assert np.array_equal(trajectory.position[-1], result.goal)
        assert np.array_equal(trajectory.position[0], shift)
    assert [t.split for t in result.trajectories] == ["train", "train", "test"]
    assert [t.demo for t in result.trajectories] == ["1", "2", "3"]
    assert result.separations == (None, None, None)
    assert not result.goal.flags.writeable
    assert not result.shifts.flags.writeable


def test_a_demonstration_that_ends_elsewhere_is_refused_by_name():
    straight = [point(line([0, 0], [3, 4]), demo=str(n)) for n in (1, 2)]
    # The mean end is (3, 4) of two and, with the third, its own size is 5: 0.49 m away is near, 0.51 m is not.
    near = point(line([0, 0], [3, 4.49]), demo="3", split="test")
    assert to_trajectories([*straight, near], DEFAULT).shifts[2] == pytest.approx([0.0, -0.49])
    far = point(line([0, 0], [3, 4.51]), demo="3", split="test")
    with pytest.raises(DataError) as caught:
        to_trajectories([*straight, far], DEFAULT)
    sentence = "Made, demonstration 3: ends 0.51 m from where the training demonstrations end on average, more than "
    assert str(caught.value).startswith(sentence + "midpoint.end_spread = 0.1 of their size (5 m)")
    moved = to_trajectories([*straight, far], MidpointParameters(end_spread=0.2))
    assert np.array_equal(moved.trajectories[2].position[-1], moved.goal)


def test_given_goal_moves_the_demonstrations():
    result = to_trajectories(pair(), MidpointParameters(goal=(0.5, 1.0), end_spread=1.0))
    assert np.array_equal(result.goal, [0.5, 1.0])
    assert np.array_equal([t.position[-1] for t in result.trajectories], [[0.5, 1.0], [0.5, 1.0]])
    free = to_trajectories(pair(), MidpointParameters(end_spread=1.0))
    assert np.array_equal(result.trajectories[0].velocity, free.trajectories[0].velocity)


@given(
    start=st.lists(st.floats(-5, 5), min_size=3, max_size=3),
    goal=st.lists(st.floats(-5, 5), min_size=3, max_size=3),
)
def test_shift_is_rigid_and_ends_exactly_on_the_goal(start, goal):
    position = np.array(start) + np.random.default_rng(0).normal(size=(20, 3))
    moved = shifted_onto(position, np.array(goal))
    assert np.array_equal(moved[-1], goal)
    np.testing.assert_allclose(np.diff(moved, axis=0), np.diff(position, axis=0), rtol=0, atol=1e-14)


def test_goal_margin_by_hand():
    training = [np.array([[0.0, 0.0], [3.0, 4.0]])]  # diagonal 5, margin 0.5
    inside = MidpointParameters(goal=(3.5, 4.5))
    assert np.array_equal(common_goal(training, inside), [3.5, 4.5])
    with pytest.raises(
        ParameterError, match=r"^midpoint\.goal: \[3\.6, 4\] m .* \[-0\.5, -0\.5\] to \[3\.5, 4\.5\] m\.$"
    ):
        common_goal(training, MidpointParameters(goal=(3.6, 4.0)))
    wider = MidpointParameters(goal=(3.6, 4.0), goal_margin=0.2)
    assert np.array_equal(common_goal(training, wider), [3.6, 4.0])


# --- LASA -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", ["Angle", "Multi_Models_1"])
def test_lasa_passes_through_bit_for_bit(motion):
    demonstrations = read_lasa(motion_file(motion, None), LasaParameters(motion=motion))
    result = to_trajectories(demonstrations, DEFAULT)
    assert np.array_equal(result.goal, [0.0, 0.0])
    assert not result.shifts.any()
    assert result.samples == (1000,) * 7
    for demonstration, trajectory in zip(demonstrations, result.trajectories, strict=True):
        assert np.array_equal(trajectory.time, demonstration.arms["point"].time)
        assert np.array_equal(trajectory.position, demonstration.arms["point"].position)
        again = np.cumsum((trajectory.velocity[1:] + trajectory.velocity[:-1]) / 2 * trajectory.step, axis=0)
        np.testing.assert_allclose(again, trajectory.position[1:] - trajectory.position[0], rtol=0, atol=2e-5)


def test_same_input_same_bytes():
    demonstrations = read_lasa(motion_file("Sine", None), LasaParameters(motion="Sine"))
    parameters = MidpointParameters(samples=333, smoothing=0.02, velocity_window=0.03, polynomial=3)
    first, second = (to_trajectories(demonstrations, parameters) for _ in range(2))
    for one, other in zip(first.trajectories, second.trajectories, strict=True):
        assert one.position.tobytes() == other.position.tobytes()
        assert one.velocity.tobytes() == other.velocity.tobytes()


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("demonstrations", "problem"),
    [
        ([], r"^demonstrations: 0 of 0 demonstrations are for training; at least two are needed\.$"),
        ([point(line([0, 0], [1, 1]))], r"^Made: 1 of 1 demonstrations are for training; at least two are needed\.$"),
        (pair(split="test"), r"^Made: 1 of 2 demonstrations are for training"),
        (
            [*pair(), point(line([0, 0, 0], [1, 1, 1]), demo="3")],
            r"^Made, demonstration 3: has 3 coordinates where Made, demonstration 1 has 2\.$",
        ),
        (
            [*pair(), point(np.ones((20, 2)), demo="3")],
            r"^Made, demonstration 3: never moves: .* 0 m; 1e-06 m at least",
        ),
        ([*pair(), point(line([0, 0], [4e-7, 4e-7]), demo="3")], r"^Made, demonstration 3: never moves"),
        ([*pair(), point([[0, 0]], np.array([0.0]), "3")], r"^Made, demonstration 3: has 1 sample\(s\)"),
        ([*pair(), point(np.ones((4, 1)), demo="3")], r"^Made, demonstration 3: positions have 1 coordinates; 2 or 3"),
        ([*pair(), point(np.ones((4, 2)), np.arange(3.0), "3")], r"^Made, demonstration 3: time of shape \(3,\)"),
        (
            [*pair(), point([[0, 0], [np.nan, 1], [2, 2]], demo="3")],
            r"^Made, demonstration 3: position is not a finite number at sample 2\.$",
        ),
        (
            [*pair(), point(line([0, 0], [1, 1], 3), np.array([0.0, 0.0, 1.0]), "3")],
            r"^Made, demonstration 3: the time stamp of sample 2 \(0 s\) is a duplicate of that of sample 1",
        ),
        (
            [*pair(), point(line([0, 0], [1, 1], 3), np.array([0.0, 2.0, 1.0]), "3")],
            r"^Made, demonstration 3: the time stamp of sample 3 \(1 s\) is before that of sample 2 \(2 s\)",
        ),
        (
            [*pair(), point(line([0, 0], [1, 1], 2), demo="3")],
            r"^Made, demonstration 3: has 2 samples; polynomials of degree 2 need 3: set midpoint\.samples",
        ),
        (
            [*pair(), Demonstration(dataset="Made", demo="3", split="train", arms={"left": pair()[0].arms["point"]})],
            r"^Made, demonstration 3: has the arms left; left and right, or point, are needed\.$",
        ),
        (
            [*pair(), Demonstration(dataset="Made", demo="3", split="train", arms={})],
            r"^Made, demonstration 3: has the arms none; left and right",
        ),
        (
            [arms(np.linspace(0, 1, 9), np.ones((9, 3)), np.linspace(2, 3, 9), np.ones((9, 3)), d) for d in "12"],
            r"^Made, demonstration 1: the arms have no time in common: one ends at 1 s, one starts at 2 s\.$",
        ),
        (
            [arms(np.linspace(0, 1, 9), np.ones((9, 3)), np.linspace(0, 1, 9), np.ones((9, 2)), d) for d in "12"],
            r"^Made, demonstration 1: has 2 coordinates where",
        ),
        (
            [arms(np.linspace(0, 1, 9), np.ones((9, 3)), np.zeros(9), np.ones((9, 3)), d) for d in "12"],
            r"^Made, demonstration 1, right arm: the time stamp of sample 2",
        ),
    ],
)
def test_unusable_demonstrations_are_named(demonstrations, problem):
    with pytest.raises(DataError, match=problem):
        to_trajectories(demonstrations, DEFAULT)


@pytest.mark.parametrize(
    ("change", "location"),
    [
        ({"samples": 9}, "midpoint.samples"),
        ({"samples": 0}, "midpoint.samples"),
        ({"samples": 10**9}, "midpoint.samples"),
        ({"smoothing": -0.1}, "midpoint.smoothing"),
        ({"smoothing": 0.51}, "midpoint.smoothing"),
        ({"smoothing": float("nan")}, "midpoint.smoothing"),
        ({"velocity_window": 0.6}, "midpoint.velocity_window"),
        ({"velocity_window": -1.0}, "midpoint.velocity_window"),
        ({"velocity_window": 0.0}, "midpoint.velocity_window"),
        ({"polynomial": 0}, "midpoint.polynomial"),
        ({"polynomial": 6}, "midpoint.polynomial"),
        ({"goal_margin": -0.1}, "midpoint.goal_margin"),
        ({"goal_margin": float("nan")}, "midpoint.goal_margin"),
        ({"goal_margin": float("inf")}, "midpoint.goal_margin"),
        ({"goal": (0.0, 0.0, 0.0)}, "midpoint.goal"),
        ({"goal": ()}, "midpoint.goal"),
        ({"goal": (5.0, 0.0)}, "midpoint.goal"),
        ({"goal": (float("nan"), 0.0)}, "midpoint.goal"),
        ({"goal": (0.0, float("inf"))}, "midpoint.goal"),
    ],
)
def test_parameters_out_of_range_are_named(change, location):
    with pytest.raises(ParameterError) as caught:
        to_trajectories(pair(), dataclasses.replace(DEFAULT, **change))
    assert caught.value.location == location
    assert str(caught.value).endswith(".")
    assert str(caught.value).count("\n") == 0
