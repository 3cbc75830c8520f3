"""From what was recorded of an arm to samples that can be used: each thing done is counted, the rest is refused.

One clock for all arms, samples in order of time, no duplicates, no samples that are not numbers, no spikes, unit
quaternions of continuous sign. What cannot be repaired without inventing motion is refused, by name and with its time:
clocks that were set back, jumps, arms that never move. Not here: gaps, rest and division, which concern both arms at
once (`segments.py`). Arrays in, arrays out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import DataError
from stages.ingest.clocks import LATE, SECOND, lateness
from stages.ingest.parameters import RecordingParameters
from stages.ingest.recording import Nanoseconds, Report
from stages.ingest.selections.resolved import Track
from stages.trajectory import Array

TOO_MANY = 0.2
"""Fraction of an arm's samples beyond which removing them is no repair."""

FEWEST = 10
"""Samples of an arm below which there is no motion to learn from."""

FASTEST = 5.0
"""m/s. A step longer than `largest_jump` and faster than this is no motion: collaborative arms reach 1 to 2 m/s."""

DISPROPORTION = 10.0
"""Nor is one that is this many times faster than the steps before and behind it."""

DEAD = 1e-3
"""m. An arm whose path has a bounding box with a smaller diagonal never moves."""

ABSURD = 1e9
"""Larger numbers, of metres or in a quaternion, are garbage and are treated like those that are not finite."""

LARGE = 20.0
"""m. Coordinates beyond this suggest millimetres; a path that extends further is refused."""

HALF_WINDOW = 3
"""Samples on each side, of which the running median is taken: spikes of up to three samples are found."""


TELEPORT = 0.02
"""m. A step from this length on is hardly motion, if it is faster than `FASTEST` and out of proportion."""

PLAUSIBLE = 1.0
"""m/s. What an arm at this speed reaches between two samples is motion and no spike; collaborative arms reach it."""

NOTABLE = 0.01
"""Fraction of an arm's samples removed as spikes that is worth a sentence."""

BLOCK = 50_000
"""Samples whose windows are copied at a time."""

SPIKE = 0.005
"""m. Nothing nearer to the running median than this is an outlier."""

GAUSSIAN = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""

NORM = 1e-3
"""Deviation of a quaternion's norm from 1 that is counted; shorter than this it has no direction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CleanArm:
    """Samples of one arm that can be used.

    Attributes:
        time: array, shape (n,), nanoseconds, increasing.
        position: array, shape (n, 3), metres.
        quaternion: array, shape (n, 4), x y z w, or None.
    """

    time: Nanoseconds
    position: Array
    quaternion: Array | None


def clean(track: Track, clock: str, source: str, parameters: RecordingParameters, report: Report) -> CleanArm:
    """Usable samples of one arm on the chosen clock; `source` is what messages call the arm.

    Adds to `report`. Raises DataError where what is left could not be trusted.
    """
    time = track.stamp if clock == "header" and track.stamp is not None else track.log_time
    position, quaternion = track.values, track.quaternion
    total = time.shape[0]
    report.count("messages", total)

    kept = track.stamped if clock == "header" else np.ones(total, dtype=np.bool_)
    report.count("zero_stamps", int((~kept).sum()))
    finite = (np.abs(position) < ABSURD).all(axis=1)  # nan is not
    report.count("not_finite", int((kept & ~finite).sum()))
    if not kept.any():
        raise DataError(source, "all header stamps are zero: set ingest.clock to 'log'.")
    if (kept & finite).sum() < (1.0 - TOO_MANY) * total:
        raise DataError(
            source,
            f"{total - int((kept & finite).sum())} of {total} samples have a position that is not a finite number or a "
            "stamp of zero: select another topic or field, or repair the recording.",
        )
    kept = kept & finite
    time, position = time[kept], position[kept]
    quaternion = None if quaternion is None else quaternion[kept]

    order = in_order(time, source, _remedy(track, clock), report)
    time, position = time[order], position[order]
    quaternion = None if quaternion is None else quaternion[order]

    kept = ~_placeholders(position, parameters.largest_jump)
    report.count("placeholders", int((~kept).sum()))
    time, position = time[kept], position[kept]
    quaternion = None if quaternion is None else quaternion[kept]

    check_extent(position, total, source, report)
    if parameters.outlier_threshold > 0.0:
        kept = ~outliers(time, position, parameters.outlier_threshold)
        removed = int((~kept).sum())
        report.count("outliers", removed)
        if removed > NOTABLE * kept.size:
            report.notes.append(
                f"{source}: {removed} of {kept.size} samples were removed as spikes; look whether they are motion "
                "(ingest.outlier_threshold = 0 keeps them)."
            )
        if removed > TOO_MANY * kept.size:
            raise DataError(
                source,
                f"{removed} of {kept.size} samples are outliers: raise ingest.outlier_threshold, or set it to 0.",
            )
        time, position = time[kept], position[kept]
        quaternion = None if quaternion is None else quaternion[kept]
    check_jumps(time, position, source, parameters, report)
    check_moves(position, source)
    if quaternion is not None:
        quaternion = clean_quaternions(quaternion, source, report)
    return CleanArm(time=time, position=position, quaternion=quaternion)


def in_order(time: Nanoseconds, source: str, remedy: str, report: Report) -> NDArray[np.intp]:
    """Indexes that bring samples into order of time without duplicates; of equal stamps the first stays.

    Raises DataError where the clock was set back: sorting would then mix two stretches of the motion.
    """
    late = lateness(time)
    if late.max(initial=0) > LATE:
        index = int(np.argmax(late > LATE))
        raise DataError(
            source,
            f"its clock jumps back by {late[index] / SECOND:.3f} s at message {index + 1}, "
            f"{(time[:index].max() - time[0]) / SECOND:.3f} s after the first: {remedy}.",
        )
    report.count("reordered", int((late > 0).sum()))
    order = np.argsort(time, kind="stable")
    fresh = np.ones(time.size, dtype=np.bool_)
    fresh[1:] = np.diff(time[order]) > 0
    report.count("duplicates", int((~fresh).sum()))
    return np.asarray(order[fresh])


def _remedy(track: Track, clock: str) -> str:
    """What may be done about a clock that was set back, as a clause."""
    other = track.log_time if clock == "header" else track.stamp
    if other is not None and other.any() and lateness(other).max() <= LATE:
        return f"set ingest.clock to {'log' if clock == 'header' else 'header'!r}"
    return "cut the recording there, or record it again"


def check_extent(position: Array, total: int, source: str, report: Report) -> None:
    """Refuse positions, array, shape (n, 3), metres, left of `total`: too few, all zero, or in another unit."""
    if position.shape[0] < FEWEST:
        raise DataError(
            source,
            f"has {position.shape[0]} usable sample(s) in {total} message(s), at different times; at least {FEWEST} "
            "are needed: set ingest.clock, or record it again.",
        )
    if not position.any():
        raise DataError(source, "all positions are zero: the arm was not tracked; select another topic or field.")
    # From the 1st to the 99th percentile, so that a spike is no way.
    low, high = np.percentile(position, (1.0, 99.0), axis=0)
    extent = float(np.linalg.norm(high - low))
    if extent > LARGE:
        raise DataError(
            source,
            f"its path extends over {extent:.4g} m: no arm's does; if lengths are in millimetres, set ingest.scale to "
            "0.001 (--scale 0.001).",
        )
    largest = float(np.abs(position).max())
    if largest > LARGE:
        report.notes.append(
            f"{source}: coordinates reach {largest:.4g} m; if lengths are in millimetres, set ingest.scale to 0.001 "
            "(--scale 0.001)."
        )


def check_moves(position: Array, source: str) -> None:
    """Refuse positions, array, shape (n, 3), metres, of a dead arm."""
    extent = float(np.linalg.norm(np.ptp(position, axis=0)))
    if extent < DEAD:
        raise DataError(
            source, f"never moves: its path extends over {1e3 * extent:.3g} mm; select the topic of an arm that does."
        )


def outliers(time: Nanoseconds, position: Array, threshold: float) -> NDArray[np.bool_]:
    """Which positions, array, shape (n, 3), metres, are spikes: Hampel's filter on distances from the running median.

    A spike is further from the median of its neighbours than `threshold` robust standard deviations of their distances,
    than 5 mm, and than an arm at `PLAUSIBLE` speed moves between two samples: at 10 Hz a short press is motion.
    """
    least = max(SPIKE, PLAUSIBLE * float(np.median(np.diff(time))) / SECOND)
    width = 2 * HALF_WINDOW + 1
    padded = np.pad(position, ((HALF_WINDOW, HALF_WINDOW), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, width, axis=0)
    centre = np.empty_like(position)
    for begin in range(0, position.shape[0], BLOCK):
        # The median; a partition is ten times as fast as numpy's own median.
        centre[begin : begin + BLOCK] = np.partition(windows[begin : begin + BLOCK], HALF_WINDOW)[..., HALF_WINDOW]
    found = np.linalg.norm(position - centre, axis=1) > least
    # Few are left: only their windows are looked at.
    suspects = np.flatnonzero(found)
    distances = np.linalg.norm(windows[suspects] - centre[suspects][:, :, None], axis=1)
    found[suspects] = distances[:, HALF_WINDOW] > threshold * GAUSSIAN * np.median(distances, axis=1)
    return np.asarray(found)


def check_jumps(
    time: Nanoseconds, position: Array, source: str, parameters: RecordingParameters, report: Report
) -> None:
    """Refuse a step that no arm makes: longer than `largest_jump`, and too fast or out of proportion to its neighbours.

    A shorter one (from `TELEPORT` metres) that is too fast and, in length too, out of proportion is counted and told.

    Steps over a gap are left to the rule for gaps.
    """
    seconds = np.diff(time) / SECOND
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    speeds = steps / seconds
    padded = np.pad(speeds, 1)
    around = np.maximum(padded[:-2], padded[2:])
    jumps = (steps > parameters.largest_jump) & (seconds <= parameters.longest_gap)
    jumps &= (speeds > FASTEST) | (speeds > DISPROPORTION * around)
    if jumps.any():
        index = int(np.argmax(jumps))
        raise DataError(
            source,
            f"jumps by {steps[index]:.3f} m within {1e3 * seconds[index]:.0f} ms, "
            f"{(time[index + 1] - time[0]) / SECOND:.3f} s after its first sample: cut the recording there, or raise "
            f"ingest.largest_jump ({parameters.largest_jump:g} m) if that is a motion.",
        )
    padded = np.pad(steps, 1)
    beside = np.maximum(padded[:-2], padded[2:])
    teleports = (steps > TELEPORT) & (speeds > FASTEST) & (steps > DISPROPORTION * beside)
    if teleports.any():
        index = int(np.argmax(teleports))
        report.count("teleports", int(teleports.sum()))
        report.notes.append(
            f"{source}: moves {1e3 * steps[index]:.0f} mm within {1e3 * seconds[index]:.3g} ms, "
            f"{(time[index + 1] - time[0]) / SECOND:.3f} s after its first sample: was tracking lost there? "
            f"ingest.largest_jump ({parameters.largest_jump:g} m), set lower, refuses it."
        )


def clean_quaternions(quaternion: Array, source: str, report: Report) -> Array:
    """Unit quaternions, array, shape (n, 4), of continuous sign; zero ones are interpolated between their neighbours.

    Raises DataError where too many are zero or not finite.
    """
    norm = np.linalg.norm(np.where(np.abs(quaternion) < ABSURD, quaternion, 0.0), axis=1)
    valid = (norm > NORM) & (np.abs(quaternion) < ABSURD).all(axis=1)
    zero = int((~valid).sum())
    report.count("zero_quaternions", zero)
    if zero > TOO_MANY * valid.size:
        raise DataError(
            source,
            f"{zero} of {valid.size} quaternions are zero or not finite: select the position alone, such as "
            "/topic:pose.position.",
        )
    report.count("unnormalised_quaternions", int((np.abs(norm[valid] - 1.0) > NORM).sum()))
    unit = quaternion[valid] / norm[valid, None]
    signs = np.where((unit[1:] * unit[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    report.count("quaternion_flips", int((signs < 0.0).sum()))
    unit = unit * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
    if zero:
        places = np.arange(valid.size)
        unit = np.column_stack([np.interp(places, places[valid], unit[:, axis]) for axis in range(4)])
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return np.asarray(unit)


def _placeholders(position: Array, largest_jump: float) -> NDArray[np.bool_]:
    """Samples that are exactly zero where all others are far from zero: published before the arm was known."""
    zero = np.asarray(~position.any(axis=1))
    if not zero.any() or zero.mean() > TOO_MANY:
        return np.zeros(zero.size, dtype=np.bool_)
    nearest = float(np.linalg.norm(position[~zero], axis=1).min())
    return zero if nearest > largest_jump else np.zeros(zero.size, dtype=np.bool_)
