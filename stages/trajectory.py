"""Demonstrations as recorded and trajectories as learned from: read-only arrays, SI units. Arrays only, no files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import DataError

Array = NDArray[np.float64]


def frozen(values: object) -> Array:
    """A read-only, contiguous float64 copy of `values`."""
    array = np.array(values, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmRecording:
    """What one arm (or one point) did in one demonstration.

    Attributes:
        time: array, shape (n,), seconds, as recorded.
        position: array, shape (n, d), metres, d = 2 or 3.
        quaternion: array, shape (n, 4), x y z w, or None.
        force: array, shape (n, 3), newtons, or None.
    """

    time: Array
    position: Array
    quaternion: Array | None = None
    force: Array | None = None

    def __post_init__(self) -> None:
        for name in ("time", "position", "quaternion", "force"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, frozen(value))


def check_recording(recording: ArmRecording, source: str) -> None:
    """Refuse a recording whose samples cannot be used; messages count samples from 1 and call it `source`.

    Raises DataError where time and position differ in length, there are fewer than two samples or not 2 or 3
    coordinates, a value is not finite, or time does not increase from each sample to the next.
    """
    time, position = recording.time, recording.position
    if time.ndim != 1 or position.ndim != 2 or time.shape[0] != position.shape[0]:
        raise DataError(source, f"time of shape {time.shape} does not go with positions of shape {position.shape}.")
    if position.shape[1] not in (2, 3):
        raise DataError(source, f"positions have {position.shape[1]} coordinates; 2 or 3 are needed.")
    if time.shape[0] < 2:
        raise DataError(source, f"has {time.shape[0]} sample(s); at least two are needed.")
    for name, finite in (("time", np.isfinite(time)), ("position", np.isfinite(position).all(axis=1))):
        if not finite.all():
            raise DataError(source, f"{name} is not a finite number at sample {int(np.argmin(finite)) + 1}.")
    increases = np.diff(time) > 0.0
    if not increases.all():
        index = int(np.argmin(increases))
        fault = "a duplicate of" if time[index + 1] == time[index] else "before"
        raise DataError(
            source,
            f"the time stamp of sample {index + 2} ({time[index + 1]:.9g} s) is {fault} that of sample {index + 1} "
            f"({time[index]:.9g} s); time must increase.",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """One demonstration as recorded: `arms` maps ``left`` and ``right``, or ``point`` alone, to their recordings.

    Attributes:
        dataset: the collection it is of (a LASA motion, a folder of bags).
        demo: its name within the collection.
        split: ``train`` or ``test``.
    """

    dataset: str
    demo: str
    split: str
    arms: Mapping[str, ArmRecording] = field(repr=False)

    @property
    def name(self) -> str:
        """What messages call it."""
        return f"{self.dataset}, demonstration {self.demo}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """The motion of one point on a uniform clock, shifted onto the goal: what is learned from and compared with.

    Attributes:
        dataset, demo, split: as of the demonstration.
        time: array, shape (n,), seconds, from 0, uniform.
        position: array, shape (n, d), metres.
        velocity: array, shape (n, d), metres per second.
        separation: mean distance of the arms along the clamp axis, L of eq. (13), metres; none: of a single point.
    """

    dataset: str
    demo: str
    split: str
    time: Array
    position: Array
    velocity: Array
    separation: float | None = None

    def __post_init__(self) -> None:
        for name in ("time", "position", "velocity"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.position.shape != self.velocity.shape or self.position.shape[0] != self.time.shape[0]:
            raise DataError(self.name, "time, position and velocity have different lengths.")

    @property
    def name(self) -> str:
        """What messages call it."""
        return f"{self.dataset}, demonstration {self.demo}"

    @property
    def dimension(self) -> int:
        """Number of coordinates, 2 or 3."""
        return int(self.position.shape[1])

    @property
    def step(self) -> float:
        """Sampling period of its clock, seconds."""
        return float((self.time[-1] - self.time[0]) / (self.time.shape[0] - 1))

    @property
    def duration(self) -> float:
        """Seconds from its first sample to its last."""
        return float(self.time[-1] - self.time[0])
