"""What moves the arms: the protocol of all masters, and the replay of a recorded one.

A made operator is in `simulated.py`, keyboard and gamepad are in `devices.py`. Arrays in, arrays out. Not here: reading
a recording from a file.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import DataError
from stages.teleoperation.mapping import MasterSample
from stages.trajectory import ArmRecording, Array, check_recording

LONGEST_GAP = 0.05
"""Between samples that are farther apart in time a replay does not interpolate, s: the master was silent."""

UNIT_TOLERANCE = 1e-3
"""Largest deviation of a recorded quaternion's length from 1; recorded in single precision it is below 1e-6."""


class Seen(NamedTuple):
    """What an operator sees.

    Attributes:
        midpoint: array, shape (3,), metres, between the pads, in the arms' base frame: where they are, not where they
            are commanded to be.
        phase: name of what is going on.
    """

    midpoint: Array
    phase: str = ""


class Master(Protocol):
    """A source of samples, asked once a tick."""

    @property
    def done(self) -> bool:
        """Whether nothing more is to come."""
        ...

    def sample(self, time: float, seen: Seen) -> MasterSample | None:
        """Return the master's present sample; none: nothing has come. `time`: of the tick, seconds, not decreasing."""
        ...


class Replay:
    """A recorded stream: positions and orientations are interpolated, the clutch is held; so is all in a gap."""

    def __init__(
        self,
        time: ArrayLike,
        position: ArrayLike,
        quaternion: ArrayLike,
        clutch: ArrayLike,
        *,
        start: float = 0.0,
        longest_gap: float = LONGEST_GAP,
        source: str = "replay",
    ) -> None:
        """Take a stream of n samples.

        Args:
            time: array, shape (n,), seconds, increasing.
            position: array, shape (n, 3), metres, in the master's base frame.
            quaternion: array, shape (n, 4), x y z w.
            clutch: array of bool, shape (n,).
            start: time of the tick at which the first sample is said, seconds.
            longest_gap: seconds; in a longer one the sample before is repeated with its own time, so that it becomes
                stale as it was when it was recorded.
            source: what messages call it.

        Raises:
            DataError: the arrays do not go together, time does not increase, a number is not finite, or a quaternion is
                not of length 1.
        """
        recording = ArmRecording(time=_array(time), position=_array(position), quaternion=_array(quaternion))
        check_recording(recording, source)
        self._time, self._position = recording.time - recording.time[0] + start, recording.position
        if self._position.shape[1] != 3:
            raise DataError(source, f"a master moves in 3 coordinates, not {self._position.shape[1]}.")
        self._quaternion = _unit(recording.quaternion, self._time.shape[0], source)
        self._clutch = _switch(clutch, self._time.shape[0], source)
        self._longest_gap = longest_gap
        self._done = False

    @property
    def done(self) -> bool:
        """Whether the last sample has been said."""
        return self._done

    def sample(self, time: float, seen: Seen) -> MasterSample | None:
        """Return the stream's sample at `time`, seconds; none before the first, the last one after the end."""
        k = int(np.searchsorted(self._time, time, side="right")) - 1
        if k < 0:
            return None
        self._done = k == self._time.shape[0] - 1
        position, quaternion, said = self._position[k], self._quaternion[k], float(self._time[k])
        if not self._done and self._time[k + 1] - self._time[k] <= self._longest_gap:
            said = time
            share = (time - self._time[k]) / (self._time[k + 1] - self._time[k])
            position = position + share * (self._position[k + 1] - position)
            quaternion = _between(quaternion, self._quaternion[k + 1], float(share))
        return MasterSample(said, position, quaternion, bool(self._clutch[k]))


def _between(p: Array, q: Array, share: float) -> Array:
    """The unit quaternion, shape (4,), at `share` of the shorter way from p to q, unit quaternions, shape (4,)."""
    mixed = (1.0 - share) * p + share * (q if p @ q >= 0.0 else -q)
    return np.asarray(mixed / np.linalg.norm(mixed))


def _array(values: ArrayLike) -> Array:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        return np.array(np.nan)


def _unit(quaternion: Array | None, n: int, source: str) -> Array:
    """The quaternions, shape (n, 4), made exactly of length 1; raises DataError where they are far from it."""
    if quaternion is None or quaternion.shape != (n, 4):
        shape = None if quaternion is None else quaternion.shape
        raise DataError(source, f"quaternions must be of shape {(n, 4)}, one a time stamp, not {shape}.")
    length = np.linalg.norm(quaternion, axis=1)
    unit = np.abs(length - 1.0) <= UNIT_TOLERANCE
    if not unit.all():
        index = int(np.argmin(unit))
        raise DataError(
            source, f"the quaternion of sample {index + 1} has length {length[index]:.6g}, which must be 1."
        )
    return np.asarray(quaternion / length[:, None])


def _switch(clutch: ArrayLike, n: int, source: str) -> NDArray[np.bool_]:
    given = np.array(clutch)
    if given.shape != (n,) or not np.isin(given, (0, 1)).all():
        raise DataError(source, f"the clutch must be {n} times true or false, one a time stamp.")
    return given.astype(np.bool_)
