"""A column of a log (`log.py`): arrays on a clock, which are messages of one ROS 2 type on one topic.

Time counts in seconds from the start of the roll-out and is kept in whole nanoseconds. The kinds of columns are in
`channels.py`. No files here: arrays in, encoded messages out, and back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from stages.artifacts.cdr import Layout
from stages.trajectory import Array, frozen

SECOND = 1_000_000_000
"""Nanoseconds in a second."""

LATEST = 2**31 - 1
"""Seconds that the stamp of a ROS 2 message can count."""

Nanoseconds = NDArray[np.int64]
Shapes = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """A column of a log; its kinds are in the table `CHANNELS` of `channels.py`.

    Attributes:
        topic: name of the topic, e.g. ``/left/pose``.
        time: array, shape (n,), seconds from the start: not negative, never going back.
        latched: whether `ros2 bag play` hands its last messages also to those who subscribe later: what is said once.
    """

    topic: str
    time: Array
    latched: bool = False

    message: ClassVar[str]
    """The ROS 2 type of its messages."""
    arrays: ClassVar[Shapes] = {"values": ()}
    """Names of its arrays beside the time, and the shape of a row of each."""

    def __post_init__(self) -> None:
        for name in ("time", *self.shapes()):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def shapes(self) -> Shapes:
        """As `arrays`, of those that this column has."""
        return self.arrays

    def shared(self) -> dict[str, Any]:
        """Plain values, the same for all its messages; by them `decode` knows the layout also where there are none."""
        return {}

    @classmethod
    def layout(cls, shared: Mapping[str, Any]) -> Layout:
        """How its messages are laid out; the fields are called as the arrays."""
        raise NotImplementedError

    def problem(self) -> str:
        """Why it cannot be written, one sentence that counts rows from 1; empty where it can."""
        time = self.time
        if time.ndim != 1:
            return f"its time has shape {time.shape}; it must be one number a row."
        for name, of_row in self.shapes().items():
            shape, needed = np.shape(getattr(self, name)), (time.size, *of_row)
            if shape != needed:
                return f"its {name} has shape {shape} where its {time.size} times ask for {needed}."
        if not np.isfinite(time).all():
            return f"its time is not a finite number in row {int(np.argmin(np.isfinite(time))) + 1}."
        back = np.diff(time) < 0.0
        if back.any():
            row = int(np.argmax(back))
            return f"its time goes back from {time[row]:.9g} s to {time[row + 1]:.9g} s in row {row + 2}."
        if time.size and not 0.0 <= time[0] <= time[-1] < LATEST:
            return f"its time runs from {time[0]:.9g} s to {time[-1]:.9g} s; it counts from 0 s, up to {LATEST} s."
        return ""

    def encode(self) -> tuple[Nanoseconds, list[bytes]]:
        """Times of its messages, array, shape (m,), nanoseconds, and the messages."""
        time = nanoseconds(self.time)
        stamp = {"seconds": time // SECOND, "nanoseconds": time % SECOND}
        arrays = {name: getattr(self, name) for name in self.shapes()}
        return time, self.layout(self.shared()).encode(time.size, {**stamp, **arrays})

    @classmethod
    def decode(cls, topic: str, shared: Mapping[str, Any], time: Nanoseconds, messages: Sequence[bytes]) -> Self:
        """The column of n messages; `time`: array, shape (n,), nanoseconds.

        Raises KeyError where `shared` lacks something, ValueError where a message is not laid out as it says.
        """
        values = {**shared, **cls.layout(shared).decode(messages)}
        own = {name: value for name, value in values.items() if name in cls.__dataclass_fields__}
        return cls(topic=topic, time=time / SECOND, **own)


def nanoseconds(time: Array) -> Nanoseconds:
    """Times, array, shape (n,), of seconds, to the nearest nanosecond."""
    return np.rint(time * SECOND).astype(np.int64)
