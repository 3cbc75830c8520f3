"""What a log (`log.py`) can hold: columns of arrays on a clock, each of them messages of one ROS 2 type on one topic.

Time counts in seconds from the start of the roll-out and is kept in whole nanoseconds; lengths are in metres, angles in
radians. No files here: arrays in, encoded messages out, and back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from stages.artifacts.cdr import Layout, decode_texts, encode_texts
from stages.trajectory import Array, frozen

SECOND = 1_000_000_000
"""Nanoseconds in a second."""

LATEST = 2**31 - 1
"""Seconds that the stamp of a ROS 2 message can count."""

Nanoseconds = NDArray[np.int64]
Shapes = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """A column of a log; its kinds are in the table `CHANNELS`.

    Attributes:
        topic: name of the topic, e.g. ``/left/pose``.
        time: array, shape (n,), seconds from the start: not negative, never going back.
    """

    topic: str
    time: Array

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Framed(Channel):
    """Vectors that are given in a frame; their messages are a header and the numbers of the arrays in order.

    Attributes:
        frame: its name.
    """

    frame: str

    def shared(self) -> dict[str, Any]:
        """The frame."""
        return {"frame": self.frame}

    @classmethod
    def layout(cls, shared: Mapping[str, Any]) -> Layout:
        """Header and numbers."""
        layout = Layout().stamp().text(shared["frame"])
        for name, shape in cls.arrays.items():
            layout = layout.numbers(name, *shape)
        return layout


@dataclass(frozen=True, kw_only=True, eq=False)
class Poses(Framed):
    """Poses of a body, geometry_msgs/msg/PoseStamped.

    Attributes:
        position: array, shape (n, 3), metres.
        quaternion: array, shape (n, 4), x y z w.
    """

    position: Array
    quaternion: Array

    message: ClassVar[str] = "geometry_msgs/msg/PoseStamped"
    arrays: ClassVar[Shapes] = {"position": (3,), "quaternion": (4,)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Wrenches(Framed):
    """Forces and torques on a body, geometry_msgs/msg/WrenchStamped.

    Attributes:
        force: array, shape (n, 3), newtons.
        torque: array, shape (n, 3), newton metres.
    """

    force: Array
    torque: Array

    message: ClassVar[str] = "geometry_msgs/msg/WrenchStamped"
    arrays: ClassVar[Shapes] = {"force": (3,), "torque": (3,)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Points(Framed):
    """Positions of a point, geometry_msgs/msg/PointStamped.

    Attributes:
        position: array, shape (n, 3), metres.
    """

    position: Array

    message: ClassVar[str] = "geometry_msgs/msg/PointStamped"
    arrays: ClassVar[Shapes] = {"position": (3,)}


@dataclass(frozen=True, kw_only=True, eq=False)
class JointStates(Channel):
    """States of k joints, one or more, sensor_msgs/msg/JointState.

    Attributes:
        names: of the joints.
        position: array, shape (n, k), radians or metres.
        velocity: array, shape (n, k), radians or metres per second, or None.
        effort: array, shape (n, k), newton metres or newtons, or None.
    """

    names: tuple[str, ...]
    position: Array
    velocity: Array | None = None
    effort: Array | None = None

    message: ClassVar[str] = "sensor_msgs/msg/JointState"

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        super().__post_init__()

    def shapes(self) -> Shapes:
        """Of `position`, and of `velocity` and `effort` where they are given."""
        given = [name for name in ("position", "velocity", "effort") if getattr(self, name) is not None]
        return dict.fromkeys(given, (len(self.names),))

    def shared(self) -> dict[str, Any]:
        """Names of the joints, and which arrays are given."""
        return {"names": list(self.names), "given": list(self.shapes())}

    def problem(self) -> str:
        """Why it cannot be written, one sentence that counts rows from 1; empty where it can."""
        return super().problem() if self.names else "it names no joints."

    @classmethod
    def layout(cls, shared: Mapping[str, Any]) -> Layout:
        """Header without a frame, names, and three lists of numbers, of which those that are not given are empty."""
        names = shared["names"]
        layout = Layout().stamp().text("").texts(names)
        for name in ("position", "velocity", "effort"):
            given = name in shared["given"]
            layout = layout.count(len(names)).numbers(name, len(names)) if given else layout.count(0)
        return layout


@dataclass(frozen=True, kw_only=True, eq=False)
class Numbers(Channel):
    """A number, std_msgs/msg/Float64.

    Attributes:
        unit: SI unit of the number; "": it has none.
        values: array, shape (n,).
    """

    unit: str = ""
    values: Array

    message: ClassVar[str] = "std_msgs/msg/Float64"

    def shared(self) -> dict[str, Any]:
        """The unit, which the messages themselves do not say."""
        return {"unit": self.unit}

    @classmethod
    def layout(cls, shared: Mapping[str, Any]) -> Layout:
        """The number."""
        return Layout().number("values")


@dataclass(frozen=True, kw_only=True, eq=False)
class Flags(Channel):
    """What is true or false, std_msgs/msg/Bool.

    Attributes:
        values: array of bool, shape (n,).
    """

    values: NDArray[np.bool_]

    message: ClassVar[str] = "std_msgs/msg/Bool"

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=np.bool_)
        values.flags.writeable = False
        object.__setattr__(self, "time", frozen(self.time))
        object.__setattr__(self, "values", values)

    @classmethod
    def layout(cls, shared: Mapping[str, Any]) -> Layout:
        """The flag."""
        return Layout().truth("values")


@dataclass(frozen=True, kw_only=True, eq=False)
class Words(Channel):
    """A text that seldom changes (the phase), std_msgs/msg/String: a message where it changes, none between.

    Attributes:
        values: n texts; read back, only those that differ from the one before, with their times.
    """

    values: tuple[str, ...]

    message: ClassVar[str] = "std_msgs/msg/String"

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", frozen(self.time))
        object.__setattr__(self, "values", tuple(self.values))

    def encode(self) -> tuple[Nanoseconds, list[bytes]]:
        """Times of the changes, array, shape (m,), nanoseconds, and their messages."""
        changes = [k for k, value in enumerate(self.values) if k == 0 or value != self.values[k - 1]]
        return nanoseconds(self.time[changes]), encode_texts(self.values[k] for k in changes)

    @classmethod
    def decode(cls, topic: str, shared: Mapping[str, Any], time: Nanoseconds, messages: Sequence[bytes]) -> Self:
        """The texts of n messages; `time`: array, shape (n,), nanoseconds. Raises ValueError where one is none."""
        return cls(topic=topic, time=time / SECOND, values=decode_texts(messages))


CHANNELS: Mapping[str, type[Channel]] = {
    kind.message: kind for kind in (Poses, Wrenches, Points, JointStates, Numbers, Flags, Words)
}
"""What is read of each type of messages."""


def nanoseconds(time: Array) -> Nanoseconds:
    """Times, array, shape (n,), of seconds, to the nearest nanosecond."""
    return np.rint(time * SECOND).astype(np.int64)
