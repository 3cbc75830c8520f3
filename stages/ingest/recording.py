"""What a recording is, whatever format carries it: topics that can be listed, and numbers that can be read from them.

Each format implements `Recording` in a module of its own; `open_recording` (in `readers/formats.py`) finds the right
one. Not here: what the numbers mean (`selections/selection.py`), and what is done about bad ones (`cleaning.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from stages.trajectory import Array

Nanoseconds = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic of a recording, or the one table of a file of rows.

    Attributes:
        name: as recorded; ``/`` is added by nobody. A table's is ``table``.
        type: message type, e.g. ``geometry_msgs/msg/PoseStamped``; of a table ``rows``.
        count: messages or rows.
        first, last: log time of the first and the last message, nanoseconds; none where there is none.
        fields: dotted names of the numbers that a message holds, in order, headers left out; ``data[]`` is an array of
            numbers, ``data[7]`` one of fixed length, ``poses[].position.x`` a number within an array of messages; empty
            where the type is not known. Of a table its columns, with ``[]`` or ``[7]`` for columns of lists.
        names: of a table: names of the elements of its columns of lists, where the recording gives them (LeRobot).
        problem: why it cannot be decoded, one sentence; empty where it can.
    """

    name: str
    type: str
    count: int
    first: int | None = None
    last: int | None = None
    fields: tuple[str, ...] = ()
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    problem: str = ""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Numbers wanted of every message of a topic: an extractor turns a decoded message into numbers.

    Attributes:
        topic: name of the topic.
        extract: object with ``__call__(message) -> sequence of floats`` of fixed length, or None for a message that
            holds nothing of it (another tf pair); a message is what the format decodes to: attributes for ROS messages,
            a mapping from column names for a row (floats; numpy arrays for columns of lists). Where it has a method
            ``stamp(message) -> (seconds, nanoseconds)`` that gives the stamp instead of the message's own header (the
            header of the transform that was chosen); it is called right after the extraction, for the same message.
        columns: for tables: the columns that it needs; formats of rows read no others.
        width: how many numbers it gives.
        every: decode only every so manieth message, where a sample is enough (`clpv info`).
    """

    topic: str
    extract: Any
    width: int
    columns: tuple[str, ...] = ()
    every: int = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Numbers of one request, in the order in which they lie in the recording (not sorted: clocks may jump back).

    Attributes:
        log_time: array, shape (n,), nanoseconds: when the message was recorded.
        stamp: array, shape (n,), nanoseconds: of the message's own header, or None where the type has none.
        values: array, shape (n, width).
    """

    log_time: Nanoseconds
    stamp: Nanoseconds | None
    values: Array


@dataclass(frozen=True, kw_only=True)
class Integrity:
    """What protects a recording's content, and what was lost of it.

    Attributes:
        protected: whether a checksum covers the content that is read, so that a flipped bit is noticed.
        note: one sentence for people: what protects it, or that nothing does.
        lost: one sentence: how much of an unfinished recording could not be recovered; empty: nothing.
    """

    protected: bool
    note: str
    lost: str = ""


class Recording(Protocol):
    """A recording that is open for reading. All errors are DataError: file's name, place, remedy.

    Attributes:
        path: file or folder.
        format: for people, e.g. ``ROS 1 bag``, ``ROS 2 bag (MCAP)``, ``CSV``.

    A context manager: leaving it closes the file.
    """

    path: Path
    format: str

    def topics(self) -> list[Topic]:
        """All topics, sorted by name."""

    def integrity(self) -> Integrity:
        """What protects the content; for recovered recordings, what was lost."""

    def episodes(self) -> list[str]:
        """Names of the episodes that the recording holds (LeRobot); all others are one, named ``""``."""

    def read(self, requests: Sequence[Request], episode: str = "") -> list[Samples]:
        """Numbers of the requests, in their order; streams, and holds no more than what is asked for."""

    def clocks(self) -> dict[str, tuple[Nanoseconds, Nanoseconds | None]]:
        """Log times and header stamps (none where the type has no header) of every topic, in the recorded order."""

    def close(self) -> None:
        """Close the file; the recording cannot be read after it."""

    def __enter__(self) -> Self:
        """The recording itself."""

    def __exit__(self, *error: object) -> None:
        """Close the file."""


@dataclass(frozen=True, kw_only=True)
class ClockHealth:
    """What is wrong with a clock, counted.

    Attributes:
        zero: stamps that are 0. backward: steps back. duplicate: stamps equal to their predecessor.
        gaps: steps longer than 5 x the median step. longest_gap: seconds.
        offset: median of log time minus stamp, seconds; none without stamps.
    """

    zero: int = 0
    backward: int = 0
    duplicate: int = 0
    gaps: int = 0
    longest_gap: float = 0.0
    offset: float | None = None


@dataclass(kw_only=True)
class Report:
    """What was found and done while recordings became demonstrations.

    Attributes:
        counts: by name, over all recordings; sources: the same of each recording.
        notes: sentences for the user.
    """

    counts: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    sources: dict[str, dict[str, int]] = field(default_factory=dict)

    def count(self, name: str, number: int = 1) -> None:
        """Add to a count."""
        if number:
            self.counts[name] = self.counts.get(name, 0) + number

    def add(self, source: str, other: Report) -> None:
        """Take over what was found in one recording."""
        for name, number in other.counts.items():
            self.count(name, number)
        self.notes.extend(other.notes)
        self.sources[source] = other.counts
