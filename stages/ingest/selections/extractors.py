"""From one decoded message to numbers: what a reader calls for every message, compiled once a selection.

A ROS message has attributes, a row of a table is a mapping. No text is parsed here and nothing is looked up by type.
What a message does not hold (an array too short, another pair of frames, another set of joints) gives None, and is
remembered for the sentence that tells why nothing was found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter, itemgetter
from typing import Any

Getter = Callable[[Any], Any]
Step = str | int | slice
"""Of a path: a name, an index, a slice."""

REMEMBERED = 1000
"""Names that an extractor remembers at most for its messages."""


def getter(steps: Sequence[Step]) -> Getter:
    """One function for a path of attributes, indexes and slices."""
    parts: list[Getter] = []
    names: list[str] = []
    for step in (*steps, None):
        if isinstance(step, str):
            names.append(step)
            continue
        if names:
            parts.append(attrgetter(".".join(names)))
            names = []
        if step is not None:
            parts.append(itemgetter(step))
    if not parts:
        return lambda message: message
    if len(parts) == 1:
        return parts[0]

    def chained(message: Any) -> Any:
        for part in parts:
            message = part(message)
        return message

    return chained


class Leaves:
    """Several numbers below one place of a message, e.g. position and orientation of a pose.

    Attributes:
        place: path to the place. leaves: dotted names below it, two or more.
    """

    def __init__(self, place: Sequence[Step], leaves: Sequence[str]) -> None:
        if all(isinstance(step, str) for step in place):
            self._base: Getter | None = None
            self._leaves = attrgetter(*(".".join([*map(str, place), leaf]) for leaf in leaves))
        else:
            self._base, self._leaves = getter(place), attrgetter(*leaves)

    def __call__(self, message: Any) -> Sequence[float] | None:
        """The numbers; None where an array on the way is too short."""
        if self._base is None:
            return self._leaves(message)
        try:
            return self._leaves(self._base(message))
        except IndexError:
            return None


class Numbers:
    """Numbers at several places of a message."""

    def __init__(self, paths: Sequence[Sequence[Step]]) -> None:
        self._getters = [getter(path) for path in paths]

    def __call__(self, message: Any) -> Sequence[float] | None:
        """The numbers; None where an array on the way is too short."""
        try:
            return [get(message) for get in self._getters]
        except IndexError:
            return None


class Part:
    """Neighbouring numbers of an array in a message."""

    def __init__(self, path: Sequence[Step], width: int) -> None:
        self._get, self._width = getter(path), width

    def __call__(self, message: Any) -> Sequence[float] | None:
        """The numbers; None where the array is too short."""
        try:
            found = self._get(message)
        except IndexError:
            return None
        return found if len(found) == self._width else None


class Cells:
    """Columns of a row, or elements of one column of lists."""

    def __init__(self, columns: Sequence[str], elements: Sequence[int] | None = None) -> None:
        self._get = itemgetter(*columns)
        self._single = len(columns) == 1
        self._elements = None if elements is None else list(elements)
        self._least = 0 if elements is None else max(elements) + 1

    def __call__(self, row: Mapping[str, Any]) -> Sequence[float] | None:
        """The numbers; None where a list is too short."""
        found = self._get(row)
        if self._elements is None:
            return (found,) if self._single else found
        if found is None or len(found) < self._least:
            return None
        return [found[index] for index in self._elements]


class Transforms:
    """The transform from one frame to another in a TFMessage; has the stamp of that transform.

    Attributes:
        parent, child: the frames, without a leading slash.
        seen: pairs of frames that other transforms were of.
    """

    def __init__(self, parent: str, child: str) -> None:
        self.parent, self.child = parent.lstrip("/"), child.lstrip("/")
        self._leaves = attrgetter(*(f"translation.{axis}" for axis in "xyz"), *(f"rotation.{axis}" for axis in "xyzw"))
        self._found: Any = None
        self.seen: set[tuple[str, str]] = set()

    def __call__(self, message: Any) -> Sequence[float] | None:
        """Translation and quaternion; None where the message has no such transform."""
        for transform in message.transforms:
            child = transform.child_frame_id.lstrip("/")
            parent = transform.header.frame_id.lstrip("/")
            if child == self.child and parent == self.parent:
                self._found = transform
                return self._leaves(transform.transform)
            if len(self.seen) < REMEMBERED:
                self.seen.add((parent, child))
        return None

    def stamp(self, message: Any) -> tuple[int, int]:
        """Seconds and nanoseconds of the transform that was extracted last."""
        stamp = self._found.header.stamp
        return stamp.sec, stamp.nanosec


class JointPositions:
    """Positions of named joints in a JointState, in a fixed order whatever the order in the message.

    Attributes:
        seen: names of joints in messages that lacked one of those wanted.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = tuple(joints)
        self._names: Any = None
        self._indexes: list[int] | None = None
        self.seen: set[str] = set()

    def __call__(self, message: Any) -> Sequence[float] | None:
        """The positions; None where the message lacks one of the joints or has no positions."""
        names, positions = message.name, message.position
        if self._names is None or names != self._names:
            places = {name: index for index, name in enumerate(names)}
            self._names = names
            self._indexes = [places[joint] for joint in self._joints] if self._joints_in(places) else None
        if self._indexes is None or len(positions) != len(names):
            return None
        return [positions[index] for index in self._indexes]

    def _joints_in(self, places: Mapping[str, int]) -> bool:
        if all(joint in places for joint in self._joints):
            return True
        if len(self.seen) < REMEMBERED:
            self.seen.update(places)
        return False


class Flag:
    """One number, or a truth value, with the memory of which of the two it was.

    Attributes:
        boolean: whether all values so far were truth values.
    """

    def __init__(self, extract: Callable[[Any], Sequence[Any] | None]) -> None:
        self._extract = extract
        self.boolean = True

    def __call__(self, message: Any) -> Sequence[float] | None:
        """The number; a truth value as 0 or 1."""
        found = self._extract(message)
        if found is None:
            return None
        # numpy's own truth value is no bool
        self.boolean = self.boolean and type(found[0]).__name__ in ("bool", "bool_")
        return (float(found[0]),)
