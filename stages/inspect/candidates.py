"""Which numbers of a recording may be a left or a right end effector, by name, by type and by what moves.

Candidates are selections as `clpv ingest` takes them; how far each moves is found in one pass that keeps no numbers. A
guess for people to look at: nothing is ingested by it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.ingest.recording import Recording, Request, Topic
from stages.ingest.selections import layouts
from stages.ingest.selections.selection import parse

MOVES = 1e-3
"""Metres (or radians of a joint) beyond which something moves: above the noise of a robot's own encoders."""

SAMPLE = 20_000
"""Messages of a topic that are looked at, about: enough to see what moves, few enough to answer in seconds."""

EPISODES = 20
"""Episodes of a data set that are looked at."""

MOST = 60
"""Candidates that are looked at, at most; a tf tree of a humanoid has some hundred frames."""

SIDES = {
    "left": re.compile(r"left|(?<![a-z])l(?![a-z])", re.IGNORECASE),
    "right": re.compile(r"right|(?<![a-z])r(?![a-z])", re.IGNORECASE),
}
"""How names say a side: the word, or the letter alone (``l_gripper``, ``arm_r``)."""

HANDS = re.compile(
    r"end_?effector|end_?point|(?<![a-z])ee(?![a-z])|eef|hand|gripper|tcp|tool|tip|wrist|flange|palm|limb|pose",
    re.IGNORECASE,
)
"""Names of what a hand is."""

WANTED = re.compile(r"command|cmd|desired|goal|target|reference|setpoint|action", re.IGNORECASE)
"""Names of what an arm was told to do rather than did."""

NO_ARM = re.compile(r"caster|wheel|head|neck|torso|laser|camera|base", re.IGNORECASE)
"""Names of joints that carry no hand."""


@dataclass(kw_only=True)
class Candidate:
    """Numbers that may be a pose or a force.

    Attributes:
        text: the selection.
        topic: where it lies.
        role: ``pose`` or ``wrench``.
        side: ``left``, ``right`` or empty.
        extent: metres (newtons) from corner to corner of the box that holds all values; none before they are read.
        oriented: whether it has an orientation.
    """

    text: str
    topic: str
    role: Literal["pose", "wrench"]
    side: str = ""
    extent: float | None = None
    oriented: bool = False

    @property
    def moves(self) -> bool:
        """Whether it moves."""
        return self.extent is not None and self.extent > MOVES

    @property
    def stem(self) -> str:
        """Its name without the side, which the other arm's has as well."""
        return SIDES[self.side].sub("*", self.text) if self.side else self.text

    @property
    def rank(self) -> tuple[bool, bool, bool, bool]:
        """Better ones are larger: moving, done rather than told, named like a hand, with an orientation."""
        return self.moves, not WANTED.search(self.text), bool(HANDS.search(self.text)), self.oriented


@dataclass(kw_only=True)
class Joints:
    """A topic of joint states.

    Attributes:
        moving: names of the joints of arms that move. others: of wheels, heads and the like that do.
    """

    topic: str
    moving: list[str] = field(default_factory=list)
    others: list[str] = field(default_factory=list)


def side(text: str) -> str:
    """``left`` or ``right`` where a name says one of the two, else empty."""
    found = [name for name, pattern in SIDES.items() if pattern.search(text)]
    return found[0] if len(found) == 1 else ""


def find(recording: Recording, topics: Sequence[Topic]) -> tuple[list[Candidate], list[Joints]]:
    """All candidates with how far they move, by a sample of the messages, and the topics of joint states."""
    every = {topic.name: max(topic.count // SAMPLE, 1) for topic in topics}
    usable = [topic for topic in topics if topic.count and not topic.problem]
    found = [candidate for topic in usable for candidate in _of_topic(topic)]
    joints = [Joints(topic=topic.name) for topic in usable if _is_joints(topic)]
    requests: list[Request] = []
    boxes: list[tuple[Candidate, _Box]] = []
    for candidate in found[:MOST]:
        quantity: Any = "force" if candidate.role == "wrench" else "pose"
        try:
            resolved = parse(candidate.text, "info").resolve(topics, recording.path.name, quantity=quantity)
        except (DataError, ParameterError):
            continue
        box = _Box(resolved.request.extract)
        candidate.oriented = resolved.request.width > 3
        boxes.append((candidate, box))
        wanted = resolved.request
        requests.append(
            Request(topic=wanted.topic, extract=box, width=1, columns=wanted.columns, every=every[wanted.topic])
        )
    frames = [(topic.name, _Frames()) for topic in usable if _is_tf(topic)]
    requests += [Request(topic=name, extract=extract, width=1, every=every[name]) for name, extract in frames]
    movers = [(joint, _Angles()) for joint in joints if joint.topic != "table"]
    requests += [
        Request(topic=joint.topic, extract=extract, width=1, every=every[joint.topic]) for joint, extract in movers
    ]
    _read(recording, requests)
    kept = []
    for candidate, box in boxes:
        candidate.extent = box.extent
        kept.append(candidate)
    for name, extract in frames:
        kept += [
            Candidate(text=f"{name}:{a}->{b}", topic=name, role="pose", side=side(b), extent=box.extent, oriented=True)
            for (a, b), box in extract.boxes.items()
        ]
    for joint, angles in movers:
        moving = [name for name, (low, high) in angles.ranges.items() if high - low > MOVES]
        joint.others = [name for name in moving if NO_ARM.search(name)]
        joint.moving = [name for name in moving if not NO_ARM.search(name)]
    return kept, joints


def best(candidates: Sequence[Candidate], role: str) -> tuple[Candidate, Candidate] | None:
    """The best pair of a left and a right one whose names differ in the side only."""
    pairs = []
    for left in candidates:
        if left.role != role or left.side != "left":
            continue
        for right in candidates:
            if right.role == role and right.side == "right" and right.stem == left.stem:
                pairs.append((min(left.rank, right.rank), left, right))
    if not pairs:
        return None
    _, left, right = max(pairs, key=lambda pair: pair[0])
    return left, right


def _of_topic(topic: Topic) -> list[Candidate]:
    if topic.type == "rows":
        return _of_table(topic)
    if _is_tf(topic):
        return []
    found = []
    for role, quantity in (("pose", "pose"), ("wrench", "force")):
        places = layouts.candidates(topic.fields, quantity)
        if role == "wrench":
            places = [place for place in places if place.rpartition(".")[2] in layouts.FORCES]
        for place in places:
            text = topic.name
            if len(places) > 1 or role == "wrench":
                text = f"{topic.name}:{place.removesuffix('.position')}"
            if role == "wrench" and len(places) == 1 and "Wrench" in topic.type:
                text = topic.name
            found.append(Candidate(text=text, topic=topic.name, role=role, side=side(text)))  # type: ignore[arg-type]
    return found


def _of_table(topic: Topic) -> list[Candidate]:
    """Prefixes of columns x y z, and such names of elements of columns of lists."""
    found = []
    scalars = {name for name in topic.fields if not name.endswith("]")}
    for prefix, role in _prefixes(scalars):
        found.append(Candidate(text=prefix or "x,y,z", topic=topic.name, role=role, side=side(prefix)))
    for column, names in topic.names.items():
        for prefix, role in _prefixes(set(names)):
            text = f"{column}:{','.join(prefix + axis for axis in layouts.AXES)}"
            found.append(Candidate(text=text, topic=topic.name, role=role, side=side(prefix)))
    return found


def _prefixes(names: set[str]) -> list[tuple[str, Literal["pose", "wrench"]]]:
    found: list[tuple[str, Literal["pose", "wrench"]]] = []
    for name in sorted(names):
        prefix = name[:-1]
        if not name.endswith("x") or not {f"{prefix}y", f"{prefix}z"} <= names or f"{prefix}w" in names:
            continue
        if re.search(r"(^|_|\.)(f|force)_?$", prefix, re.IGNORECASE):
            found.append((prefix, "wrench"))
        elif not re.search(
            r"(^|_|\.)(q|r|v|w|a|t|vel|acc|velocity|torque|omega|linear|angular)_?$", prefix, re.IGNORECASE
        ):
            found.append((prefix, "pose"))
    return found


def _is_tf(topic: Topic) -> bool:
    return "transforms[].transform.translation.x" in topic.fields


def _is_joints(topic: Topic) -> bool:
    if topic.type == "rows":
        return {"left_s0", "left_e0", "left_w0", "right_s0"} <= set(topic.fields)
    return topic.type.endswith("/JointState")


def _read(recording: Recording, requests: list[Request]) -> None:
    """One pass for all, or, where a topic cannot be read, one pass for each that can."""
    try:
        for episode in recording.episodes()[:EPISODES]:
            recording.read(requests, episode)
    except DataError:
        for request in requests:
            try:
                recording.read([request], recording.episodes()[0])
            except DataError:
                continue


class _Box:
    """The box that holds the first three numbers of an extractor; gives nothing, so that nothing is kept."""

    def __init__(self, extract: Any) -> None:
        self.inner = extract
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.rows: list[Any] = []

    def __call__(self, message: Any) -> None:
        numbers = self.inner(message)
        if numbers is not None:
            self.rows.append(tuple(numbers[:3]))
            if len(self.rows) >= 1000:
                self._fold()

    def _fold(self) -> None:
        rows = np.array(self.rows, dtype=np.float64)
        self.rows.clear()
        self.low = np.fmin(self.low, rows.min(axis=0, initial=np.inf, where=np.isfinite(rows)))
        self.high = np.fmax(self.high, rows.max(axis=0, initial=-np.inf, where=np.isfinite(rows)))

    @property
    def extent(self) -> float | None:
        """Its diagonal; none where it holds nothing."""
        if self.rows:
            self._fold()
        size = self.high - self.low
        return float(np.linalg.norm(size)) if np.isfinite(size).all() else None


class _Frames:
    """A box for every pair of frames of a TFMessage."""

    def __init__(self) -> None:
        self.boxes: dict[tuple[str, str], _Box] = {}

    def __call__(self, message: Any) -> None:
        for transform in message.transforms:
            key = (transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/"))
            box = self.boxes.get(key)
            if box is None:
                if len(self.boxes) >= MOST * 5:
                    continue
                box = self.boxes[key] = _Box(_translation)
            box(transform)


def _translation(transform: Any) -> tuple[float, float, float]:
    translation = transform.transform.translation
    return translation.x, translation.y, translation.z


class _Angles:
    """Least and largest position of every joint of a JointState."""

    def __init__(self) -> None:
        self.ranges: dict[str, tuple[float, float]] = {}

    def __call__(self, message: Any) -> None:
        for name, value in zip(message.name, message.position, strict=False):
            low, high = self.ranges.get(name, (value, value))
            self.ranges[name] = (min(low, value), max(high, value))
