"""Demonstrations become trajectories: midpoint of the arms, uniform clock, velocities, shift onto the goal.

Paper section III-A: eq. (4). A demonstration of a single point goes through the same steps without eq. (4). Nothing is
learned here, and nothing is read or written. Restoring both arms from a midpoint, eq. (13), is the policy's affair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.midpoint.clamp import Clamp, clamp, clamp_axis
from stages.midpoint.parameters import MidpointParameters
from stages.trajectory import Array, Demonstration, Trajectory, check_recording, frozen

UNIFORM = 1e-9
"""Largest deviation from a uniform clock, in sampling periods, at which samples pass through as recorded."""

STILL = 1e-6
"""A demonstration whose bounding box has a smaller diagonal than this, metres, does not move."""

MINIMUM_SAMPLES = 10
MAXIMUM_SAMPLES = 1_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class MidpointResult:
    """Trajectories in the order of the demonstrations, and what was done to make them.

    Attributes:
        trajectories: each ends on the goal.
        goal: array, shape (d,), metres.
        shifts: array, shape (demonstrations, d), metres: what was added to each demonstration's positions.
        separations: distance of the arms, array, shape (samples of the trajectory,), metres; None for a single point.
        clamp_axis: ``x``, ``y`` or ``z``; None where no demonstration is of two arms.
        clamps: separation of the arms along that axis, eq. (13), of each demonstration; None for a single point.
        samples: samples of each trajectory.
    """

    trajectories: tuple[Trajectory, ...]
    goal: Array
    shifts: Array
    separations: tuple[Array | None, ...]
    clamp_axis: str | None
    clamps: tuple[Clamp | None, ...]
    samples: tuple[int, ...]


def to_trajectories(demonstrations: Sequence[Demonstration], parameters: MidpointParameters) -> MidpointResult:
    """Trajectories of all demonstrations, each shifted so that it ends on the common goal.

    Paper eq. (4) where a demonstration is of two arms. The goal is `parameters.goal`, else the mean end point of the
    training demonstrations; test demonstrations do not move it.

    Raises ParameterError where a parameter is out of range or the goal does not fit the data; DataError, naming the
    demonstration, where one cannot be used, or naming the data set, where fewer than two are for training.
    """
    check_parameters(parameters)
    check_demonstrations(demonstrations)
    times, positions, differences = [], [], []
    for demonstration in demonstrations:
        time, position, difference = midpoint_path(demonstration, parameters.samples)
        check_moves(position, demonstration.name)
        check_samples(time.shape[0], parameters.polynomial, demonstration.name)
        times.append(time)
        positions.append(smoothed(position, parameters.smoothing, parameters.polynomial))
        differences.append(difference)

    training = [p for p, demonstration in zip(positions, demonstrations, strict=True) if demonstration.split == "train"]
    goal = common_goal(training, parameters)
    for position, demonstration in zip(positions, demonstrations, strict=True):
        check_end(position, training, parameters.end_spread, demonstration.name)
    shifts = np.array([goal - position[-1] for position in positions])
    trajectories = tuple(
        Trajectory(
            dataset=demonstration.dataset,
            demo=demonstration.demo,
            split=demonstration.split,
            time=time,
            position=shifted_onto(position, goal),
            velocity=velocity_of(time, position, parameters.velocity_window, parameters.polynomial),
        )
        for demonstration, time, position in zip(demonstrations, times, positions, strict=True)
    )
    held = [difference for difference in differences if difference is not None]
    axis = clamp_axis(held, parameters.clamp_axis) if held else None
    return MidpointResult(
        trajectories=trajectories,
        goal=frozen(goal),
        shifts=frozen(shifts),
        separations=tuple(None if d is None else frozen(arm_separation(d)) for d in differences),
        clamp_axis=axis,
        clamps=tuple(None if d is None or axis is None else clamp(d, axis) for d in differences),
        samples=tuple(time.shape[0] for time in times),
    )


def midpoint(left: Array, right: Array) -> Array:
    """Midpoint of both arms' positions, arrays, shape (n, d), metres. Paper eq. (4)."""
    return (left + right) / 2.0


def arm_separation(difference: Array) -> Array:
    """Distance of the arms, array, shape (n,), metres, from left minus right, array, shape (n, d), metres."""
    return np.asarray(np.linalg.norm(difference, axis=1))


def midpoint_path(demonstration: Demonstration, samples: int | None) -> tuple[Array, Array, Array | None]:
    """The demonstration's point on a uniform clock: time from 0 (n,) s, position (n, d) m, left minus right (n, d) m.

    Both arms are brought onto one clock inside the time that they have in common; of a single point there is no left
    minus right. Paper eq. (4).
    Raises DataError where the arms are neither ``left`` and ``right`` nor ``point``, or have no time in common.
    """
    arms = demonstration.arms
    if set(arms) not in ({"point"}, {"left", "right"}):
        raise DataError(
            demonstration.name,
            f"has the arms {', '.join(sorted(arms)) or 'none'}; left and right, or point, are needed.",
        )
    clock = uniform_clock([arm.time for arm in arms.values()], samples, demonstration.name)
    on_clock = {name: resampled(arm.time, arm.position, clock) for name, arm in arms.items()}
    time = clock - clock[0]
    if "point" in on_clock:
        return time, on_clock["point"], None
    left, right = on_clock["left"], on_clock["right"]
    return time, midpoint(left, right), left - right


def uniform_clock(times: Sequence[Array], samples: int | None, source: str) -> Array:
    """A uniform clock, array, shape (n,), seconds, over the time that all recordings cover.

    Arguments:
        times: time stamps of each recording, arrays, shape (m,), seconds, increasing.
        samples: n; none: as many as the densest recording has in that time.

    Where all have one clock, uniform already and of n samples, it is returned bit for bit.
    Raises DataError, naming `source`, where the recordings have no time in common.
    """
    first = times[0]
    if samples in (None, first.shape[0]) and is_uniform(first) and all(np.array_equal(first, t) for t in times[1:]):
        return first
    start, end = max(t[0] for t in times), min(t[-1] for t in times)
    if not start < end:
        raise DataError(
            source, f"the arms have no time in common: one ends at {end:.9g} s, one starts at {start:.9g} s."
        )
    count = samples or max(2, *(int(np.count_nonzero((t >= start) & (t <= end))) for t in times))
    return np.linspace(start, end, count)


def is_uniform(time: Array) -> bool:
    """Whether time stamps, array, shape (n,), seconds, are uniform to 1e-9 of their sampling period."""
    uniform = np.linspace(time[0], time[-1], time.shape[0])
    period = (time[-1] - time[0]) / (time.shape[0] - 1)
    return bool(np.abs(time - uniform).max() <= UNIFORM * period)


def resampled(time: Array, values: Array, clock: Array) -> Array:
    """Values, array, shape (n, d), recorded at `time`, shape (n,), s, as they are at `clock`, shape (m,), s, within it.

    Akima's interpolation: exact for straight lines on any clock and for parabolas on a uniform one; it is local, so
    two messages that arrived almost at once do not make it overshoot as a cubic spline does.
    """
    if np.array_equal(time, clock):
        return values
    from scipy.interpolate import Akima1DInterpolator

    return np.asarray(Akima1DInterpolator(time, values, axis=0)(clock))


def window_length(fraction: float, samples: int, least: int) -> int:
    """An odd number of samples: `fraction` of all `samples`, at least `least`, at most all of them."""
    return min(max(round(fraction * samples), least) | 1, samples - 1 + samples % 2)


def smoothed(position: Array, fraction: float, polynomial: int) -> Array:
    """Positions, array, shape (n, d), metres, smoothed by a Savitzky-Golay filter; as they are where `fraction` is 0.

    The window is `fraction` of the samples, and wide enough to smooth with polynomials of that degree.
    """
    if fraction == 0.0:
        return position
    from scipy.signal import savgol_filter

    window = window_length(fraction, position.shape[0], least=polynomial + 2)
    return np.asarray(savgol_filter(position, window, polynomial, axis=0, mode="interp"))


def velocity_of(time: Array, position: Array, fraction: float, polynomial: int) -> Array:
    """Velocities, array, shape (n, d), m/s, of positions, array, shape (n, d), m, on a uniform clock, shape (n,), s.

    A Savitzky-Golay differentiator with a window of `fraction` of the samples: exact for polynomials up to its degree,
    at the ends too.
    """
    from scipy.signal import savgol_filter

    window = window_length(fraction, position.shape[0], least=polynomial + 1)
    step = (time[-1] - time[0]) / (time.shape[0] - 1)
    return np.asarray(savgol_filter(position, window, polynomial, deriv=1, delta=step, axis=0, mode="interp"))


def common_goal(training: Sequence[Array], parameters: MidpointParameters) -> Array:
    """Where the motion ends, array, shape (d,), metres: as given, else the mean end of `training`, arrays (n, d), m.

    Raises ParameterError where a given goal has another dimension, is not finite, or lies outside the training data's
    bounding box, enlarged on each side by `parameters.goal_margin` of its diagonal.
    """
    if parameters.goal is None:
        return np.asarray(np.mean([position[-1] for position in training], axis=0))
    goal = np.array(parameters.goal, dtype=np.float64)
    points = np.concatenate(training)
    if goal.shape != (points.shape[1],):
        raise ParameterError("midpoint.goal", f"has {goal.size} coordinates; the data have {points.shape[1]}.")
    low, high = points.min(axis=0), points.max(axis=0)
    margin = parameters.goal_margin * float(np.linalg.norm(high - low))
    low, high = low - margin, high + margin
    if not ((goal >= low) & (goal <= high)).all():
        raise ParameterError(
            "midpoint.goal",
            f"{_text(goal)} m lies outside the data; it must lie within {_text(low)} to {_text(high)} m.",
        )
    return goal


def check_end(position: Array, training: Sequence[Array], spread: float, source: str) -> None:
    """Raise DataError, naming `source`, where a demonstration ends elsewhere than those for training do on average.

    `position`: array, shape (n, d), metres. `training`: such arrays. `spread`: what is near, as a fraction of the mean
    diagonal of the training demonstrations' bounding boxes.
    """
    mean = np.mean([other[-1] for other in training], axis=0)
    size = float(np.mean([np.linalg.norm(np.ptp(other, axis=0)) for other in training]))
    away = float(np.linalg.norm(position[-1] - mean))
    if away > spread * size:
        raise DataError(
            source,
            f"ends {away:.3g} m from where the training demonstrations end on average, more than midpoint.end_spread = "
            f"{spread:g} of their size ({size:.3g} m): one motion ends in one place; leave it out, make an experiment "
            "of each goal, or raise midpoint.end_spread to have it shifted.",
        )


def shifted_onto(position: Array, goal: Array) -> Array:
    """Positions, array, shape (n, d), metres, moved as a whole: the last is exactly `goal`, array, shape (d,)."""
    moved = position + (goal - position[-1])
    moved[-1] = goal
    return np.asarray(moved)


def check_moves(position: Array, source: str) -> None:
    """Raise DataError, naming `source`, where positions, array, shape (n, d), metres, never leave one point."""
    extent = float(np.linalg.norm(np.ptp(position, axis=0)))
    if not extent >= STILL:
        raise DataError(source, f"never moves: its path extends over {extent:.3g} m; {STILL:g} m at least are needed.")


def check_samples(samples: int, polynomial: int, source: str) -> None:
    """Raise DataError, naming `source`, where a window of all samples is too short for polynomials of that degree."""
    least = (polynomial + 1) | 1
    if samples < least:
        raise DataError(
            source,
            f"has {samples} samples; polynomials of degree {polynomial} need {least}: set midpoint.samples, "
            "or a lower midpoint.polynomial.",
        )


def check_demonstrations(demonstrations: Sequence[Demonstration]) -> None:
    """Raise DataError where a recording cannot be used, dimensions differ, or fewer than two are for training."""
    dimension = None
    for demonstration in demonstrations:
        for name, arm in demonstration.arms.items():
            check_recording(arm, demonstration.name if name == "point" else f"{demonstration.name}, {name} arm")
            dimension = dimension or arm.position.shape[1]
            if arm.position.shape[1] != dimension:
                raise DataError(
                    demonstration.name,
                    f"has {arm.position.shape[1]} coordinates where {demonstrations[0].name} has {dimension}.",
                )
    count = sum(demonstration.split == "train" for demonstration in demonstrations)
    if count < 2:
        datasets = ", ".join(dict.fromkeys(demonstration.dataset for demonstration in demonstrations))
        raise DataError(
            datasets or "demonstrations",
            f"{count} of {len(demonstrations)} demonstrations are for training; at least two are needed.",
        )


def check_parameters(parameters: MidpointParameters) -> None:
    """Raise ParameterError where a parameter is out of range."""
    samples, polynomial = parameters.samples, parameters.polynomial
    if samples is not None and not MINIMUM_SAMPLES <= samples <= MAXIMUM_SAMPLES:
        raise ParameterError(
            "midpoint.samples", f"{samples} is out of range; {MINIMUM_SAMPLES} to {MAXIMUM_SAMPLES} are possible."
        )
    if not 1 <= polynomial <= 5:
        raise ParameterError("midpoint.polynomial", f"{polynomial} is out of range; 1 to 5 are possible.")
    if not 0.0 <= parameters.smoothing <= 0.5:
        raise ParameterError("midpoint.smoothing", f"{parameters.smoothing:g} is out of range; 0 to 0.5 are possible.")
    if not 0.0 < parameters.velocity_window <= 0.5:
        raise ParameterError(
            "midpoint.velocity_window",
            f"{parameters.velocity_window:g} is out of range; more than 0, to 0.5, are possible.",
        )
    for name in ("goal_margin", "end_spread"):
        value = getattr(parameters, name)
        if not 0.0 <= value < np.inf:
            raise ParameterError(f"midpoint.{name}", f"{value:g} must be 0 or more, and finite.")


def _text(point: Array) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in point)}]"
