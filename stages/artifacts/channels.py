"""The kinds of columns that a log (`log.py`) can hold, one for each ROS 2 type of messages: the table `CHANNELS`.

Lengths are in metres, angles in radians. No files here: arrays in, encoded messages out, and back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from stages.artifacts.cdr import Layout, decode_texts, encode_texts
from stages.artifacts.channel import SECOND, Channel, Nanoseconds, Shapes, nanoseconds
from stages.trajectory import Array, frozen


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
class Transforms(Channel):
    """Where k frames are in those that they hang on, one or more, tf2_msgs/msg/TFMessage.

    Attributes:
        parents, children: names of the frames, k each: what hangs on a parent is a child.
        position: array, shape (n, k, 3), metres, of each child in its parent.
        quaternion: array, shape (n, k, 4), x y z w.
    """

    parents: tuple[str, ...]
    children: tuple[str, ...]
    position: Array
    quaternion: Array

    message: ClassVar[str] = "tf2_msgs/msg/TFMessage"

    def __post_init__(self) -> None:
        object.__setattr__(self, "parents", tuple(self.parents))
        object.__setattr__(self, "children", tuple(self.children))
        super().__post_init__()

    def shapes(self) -> Shapes:
        """Of both arrays."""
        return {"position": (len(self.children), 3), "quaternion": (len(self.children), 4)}

    def shared(self) -> dict[str, Any]:
        """Names of the frames."""
        return {"parents": list(self.parents), "children": list(self.children)}

    def problem(self) -> str:
        """Why it cannot be written, one sentence that counts rows from 1; empty where it can."""
        if not self.children or len(self.parents) != len(self.children):
            return f"it names {len(self.parents)} parents for {len(self.children)} frames."
        return super().problem()

    @classmethod
    def layout(cls, shared: Mapping[str, Any]) -> Layout:
        """The number of transforms, and of each a header, the child's name, and the numbers."""
        pairs = list(zip(shared["parents"], shared["children"], strict=True))
        layout = Layout().count(len(pairs))
        for part, (parent, child) in enumerate(pairs):
            layout = layout.stamp().text(parent).text(child)
            layout = layout.numbers("position", 3, part).numbers("quaternion", 4, part)
        return layout


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
    """Numbers that have names, k of them, one or more, std_msgs/msg/Float64MultiArray: what every viewer plots.

    Attributes:
        names: of the numbers.
        unit: SI unit of all of them; "": they have none.
        values: array, shape (n, k).
    """

    names: tuple[str, ...]
    unit: str = ""
    values: Array

    message: ClassVar[str] = "std_msgs/msg/Float64MultiArray"

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        super().__post_init__()

    def shapes(self) -> Shapes:
        """Of `values`."""
        return {"values": (len(self.names),)}

    def shared(self) -> dict[str, Any]:
        """Names and unit; the messages themselves say the names only."""
        return {"names": list(self.names), "unit": self.unit}

    def problem(self) -> str:
        """Why it cannot be written, one sentence that counts rows from 1; empty where it can."""
        return super().problem() if self.names else "it names no numbers."

    @classmethod
    def layout(cls, shared: Mapping[str, Any]) -> Layout:
        """One dimension, its label the names, its size and its stride; no offset; the numbers."""
        names = shared["names"]
        layout = Layout().count(1).text(", ".join(names)).count(len(names)).count(len(names)).count(0)
        return layout.count(len(names)).numbers("values", len(names))


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
    kind.message: kind for kind in (Transforms, Poses, Wrenches, JointStates, Numbers, Flags, Words)
}
"""What is read of each type of messages."""
