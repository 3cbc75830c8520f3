"""Where a position, a pose or a force lies among the numbers of a message or a table.

Works on the dotted names that a `Topic` lists (`data[]` an array, `data[7]` one of fixed length, `poses[].position.x` a
number within an array of messages). Nothing is read here.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from stages.ingest.selections.extractors import Step

Layout = Literal["position", "quaternion", "euler", "joints", "number"]
"""What the numbers of a selection are: x y z; with a quaternion; with roll pitch yaw; joint positions; one number."""

AXES = ("x", "y", "z")
TURNS = ("x", "y", "z", "w")
EULER = ("roll", "pitch", "yaw")
QUATERNION = ("qx", "qy", "qz", "qw")
POSITIONS = ("position", "translation", "point")
"""What ROS's own messages call a position."""

FORCES = ("force",)
ORIENTATIONS = ("orientation", "rotation", "quaternion")
NOT_POSITIONS = (
    *ORIENTATIONS,
    "linear",
    "angular",
    "force",
    "torque",
    "velocity",
    "linear_velocity",
    "angular_velocity",
    "acceleration",
    "linear_acceleration",
    "magnetic_field",
    "scale",
)
"""Triples x y z that are something else, by the names that ROS's own messages give them."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """A field that a selection names, found among a topic's.

    Attributes:
        steps: path to it.
        below: what lies below it: dotted names, `[]` or `[7]` of an array; an empty name: it is a number itself.
    """

    steps: tuple[Step, ...]
    below: tuple[str, ...]


def steps_of(path: str) -> tuple[Step, ...]:
    """A path such as ``poses[0].position`` or ``data[0:3]`` as steps; raises ValueError, with a problem, for others."""
    steps: list[Step] = []
    for name in path.split("."):
        match = re.fullmatch(r"([^\[\]]+)((?:\[\d+\])*)(\[\d+:\d+\])?", name.strip())
        if match is None:
            raise ValueError(f"{path!r} is not a path such as pose.position, poses[0] or data[0:3]")
        steps.append(match[1].strip())
        steps.extend(int(index) for index in re.findall(r"\d+", match[2]))
        if match[3]:
            first, last = map(int, re.findall(r"\d+", match[3]))
            if first >= last:
                raise ValueError(f"{match[3]} in {path!r} is empty: a slice is [first:past the last]")
            steps.append(slice(first, last))
    if any(isinstance(step, slice) for step in steps[:-1]):
        raise ValueError(f"{path!r} has a slice that is not at its end")
    return tuple(steps)


def find(fields: Sequence[str], steps: Sequence[Step]) -> Field | None:
    """What lies at a path among fields; None where nothing does."""
    below = []
    for field in fields:
        rest = _below(field, steps)
        if rest is not None:
            below.append(rest)
    return Field(steps=tuple(steps), below=tuple(below)) if below else None


def _below(field: str, steps: Sequence[Step]) -> str | None:
    """What of a field's name is left behind a path."""
    rest = field
    for step in steps:
        if isinstance(step, str):
            rest = rest.removeprefix(".")
            if not rest.startswith(step) or rest[len(step) : len(step) + 1] not in ("", ".", "["):
                return None
            rest = rest[len(step) :]
        else:
            match = re.match(r"\[(\d*)\]", rest)
            if match is None:
                return None
            last = step if isinstance(step, int) else step.stop - 1
            if match[1] and last >= int(match[1]):
                return None
            rest = rest[match.end() :]
    return rest.removeprefix(".")


def triples(below: Sequence[str]) -> list[str]:
    """Places, dotted, below which x, y and z lie and no w; "" is the place itself. Nothing within variable arrays."""
    names = set(below)
    places = [name.removesuffix("x").removesuffix(".") for name in below if name == "x" or name.endswith(".x")]
    return [
        place
        for place in places
        if all(_join(place, axis) in names for axis in AXES) and _join(place, "w") not in names and "[" not in place
    ]


def candidates(below: Sequence[str], quantity: str) -> list[str]:
    """Triples that may be the position (or the force) that is meant: those named so, else those not named otherwise."""
    found = triples(below)
    wanted = FORCES if quantity == "force" else POSITIONS
    if "" in found:
        return [""]
    named = [place for place in found if _last(place) in wanted]
    if named:
        return named
    others = {*NOT_POSITIONS, *(() if quantity == "pose" else POSITIONS)}
    return [place for place in found if _last(place) not in others]


def pose_leaves(below: Sequence[str], place: str) -> tuple[Layout, tuple[str, ...]]:
    """Layout (``position``, ``quaternion`` or ``euler``) and dotted names of the numbers of the pose at a triple."""
    names = set(below)
    position = tuple(_join(place, axis) for axis in AXES)
    beside = place.rpartition(".")[0]
    for orientation in ORIENTATIONS:
        quaternion = tuple(_join(_join(beside, orientation), axis) for axis in TURNS)
        if names.issuperset(quaternion):
            return "quaternion", position + quaternion
    kinds: tuple[tuple[Layout, tuple[str, ...]], ...] = (("quaternion", QUATERNION), ("euler", EULER))
    for layout, turns in kinds:
        flat = tuple(_join(beside, turn) for turn in turns)
        if names.issuperset(flat):
            return layout, position + flat
    return "position", position


def array_length(below: Sequence[str]) -> int | None:
    """Length of an array of numbers: 0 where it varies, None where the place is no array of numbers."""
    match = re.fullmatch(r"\[(\d*)\]", below[0]) if len(below) == 1 else None
    return None if match is None else int(match[1] or 0)


def _join(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name


def _last(place: str) -> str:
    return place.rpartition(".")[2]
