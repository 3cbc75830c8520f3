"""What recordings of messages have in common: topics out of channels, numbers out of streamed messages, clocks.

A format gives its channels and an iterator over encoded messages in the order in which they lie in the file; the rest
is here, and so is the one place that turns what a library raises on damaged bytes into a DataError.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from pipeline.errors import DataError
from stages.ingest.names import nearest
from stages.ingest.readers.definitions import Decoder, first_line
from stages.ingest.recording import Integrity, Nanoseconds, Request, Samples, Topic

AGAIN = "copy or record it again"
"""Remedy for what is damaged and cannot be repaired here."""

LFS = b"version https://git-lfs.github.com/spec/"
"""How a Git LFS pointer begins, the text file that stands in for a file that was not fetched."""

HEAD = 512
"""Bytes by which a format is recognised."""


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One stream of messages of one type; a topic has one a publisher.

    Attributes:
        id: unique in the recording.
        topic, type: names, the type's as ROS 2 writes it.
        count: messages, as the recording's index says.
        decoder: None where its messages cannot be decoded; then `problem` ends the sentence that says why.
        first, last: log time of the first and the last message, nanoseconds.
    """

    id: int
    topic: str
    type: str
    count: int
    decoder: Decoder | None
    problem: str = ""
    first: int | None = None
    last: int | None = None


@contextmanager
def damage(path: Path, remedy: str = AGAIN) -> Iterator[None]:
    """Turn anything that a library raises on damaged bytes into one sentence about the file."""
    try:
        yield
    except DataError:
        raise
    except FileNotFoundError as error:
        raise DataError(path.name, "does not exist.") from error
    except PermissionError as error:
        raise DataError(path.name, "may not be read: its permissions forbid it.") from error
    except MemoryError as error:
        raise DataError(path.name, f"is damaged (it asks for more memory than there is); {remedy}.") from error
    except Exception as error:
        said = first_line(error).replace(str(path), path.name).replace("('", "").replace(".',)", "")
        said = re.sub(r"/[^\s'\",:]*/", "", said)
        raise DataError(path.name, f"is damaged ({said}); {remedy}.") from error


def beginning(path: Path) -> bytes:
    """The first bytes of a file; raises DataError where it has none, or is only a pointer to what was not fetched."""
    if not path.is_file():
        raise DataError(path.name, "is neither a file nor a folder.")
    with path.open("rb") as stream:
        head = stream.read(HEAD)
    if not head:
        raise DataError(path.name, "is empty; copy it again.")
    if head.startswith(LFS):
        raise DataError(path.name, "is a Git LFS pointer, not the recording itself; fetch it with `git lfs pull`.")
    return head


class MessageRecording:
    """A recording of messages; formats derive from it, fill `channels` and give `messages`."""

    def __init__(self, path: Path, format_name: str) -> None:
        self.path = path
        self.format = format_name
        self.remedy = AGAIN
        self.channels: list[Channel] = []
        self.unpack: Callable[[bytes], bytes] | None = None

    def messages(self, wanted: frozenset[int]) -> Iterator[tuple[int, int, bytes]]:
        """Channel, log time in nanoseconds and bytes of each message of the wanted channels, in the file's order."""
        raise NotImplementedError

    def integrity(self) -> Integrity:
        """What protects the content; for recovered recordings, what was lost."""
        raise NotImplementedError

    def close(self) -> None:
        """Close the file; the recording cannot be read after it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def episodes(self) -> list[str]:
        """One, without a name."""
        return [""]

    def topics(self) -> list[Topic]:
        """All topics, sorted by name."""
        return [self._topic(name, channels) for name, channels in sorted(self._by_topic().items())]

    def _by_topic(self) -> dict[str, list[Channel]]:
        groups: dict[str, list[Channel]] = {}
        for channel in self.channels:
            groups.setdefault(channel.topic, []).append(channel)
        return groups

    def _topic(self, name: str, channels: list[Channel]) -> Topic:
        types = sorted({channel.type for channel in channels})
        problem = next((channel.problem for channel in channels if channel.problem), "")
        if len(types) > 1:
            problem = f"it carries messages of several types ({', '.join(types)})."
        decoder = channels[0].decoder
        return Topic(
            name=name,
            type=types[0] if len(types) == 1 else "several",
            count=sum(channel.count for channel in channels),
            first=min((channel.first for channel in channels if channel.first is not None), default=None),
            last=max((channel.last for channel in channels if channel.last is not None), default=None),
            fields=decoder.fields if decoder is not None and not problem else (),
            problem=problem,
        )

    def read(self, requests: Sequence[Request], episode: str = "") -> list[Samples]:
        """Numbers of the requests, in their order and in the order of the file; streams.

        Raises DataError where a topic is not there or cannot be decoded, a message does not hold what is asked of it,
        or the file is damaged.
        """
        if episode:
            raise DataError(self.path.name, f"holds no episodes, so none is called {episode!r}.")
        collectors = [_Collector(request) for request in requests]
        by_channel: dict[int, tuple[Channel, list[_Collector]]] = {}
        groups = self._by_topic()
        for collector in collectors:
            name = collector.request.topic
            if name not in groups:
                raise DataError(self.path.name, f"holds no topic {name}: {nearest(name, groups)}")
            topic = self._topic(name, groups[name])
            if topic.problem:
                raise DataError(f"{self.path.name}, topic {name}", f"cannot be decoded: {topic.problem}")
            for channel in groups[name]:
                by_channel.setdefault(channel.id, (channel, []))[1].append(collector)
        with damage(self.path, self.remedy):
            self._collect(by_channel)
        return [collector.samples() for collector in collectors]

    def _collect(self, by_channel: dict[int, tuple[Channel, list[_Collector]]]) -> None:
        """Stream the messages once and hand each to the collectors of its channel."""
        table: dict[int, Any] = {}
        counts = dict.fromkeys(by_channel, 0)
        for key, (channel, collectors) in by_channel.items():
            if channel.decoder is not None:
                first = channel.decoder.header == "first"
                every = min(collector.request.every for collector in collectors)
                table[key] = (channel.decoder.decode, channel.decoder.stamp if first else None, collectors, every)
                for collector in collectors:
                    collector.stamped |= channel.decoder.header != "none"
        unpack = self.unpack
        for key, log, raw in self.messages(frozenset(table)):
            decode, stamp_of, collectors, every = table[key]
            counts[key] += 1
            if every > 1 and counts[key] % every:
                continue
            channel = by_channel[key][0]
            if unpack is not None:
                raw = unpack(raw)
            try:
                message = decode(raw)
            except Exception as error:
                raise DataError(
                    f"{self.path.name}, topic {channel.topic}",
                    f"message {counts[key]} is damaged ({first_line(error)}); {self.remedy}.",
                ) from error
            for collector in collectors:
                try:
                    collector.add(message, log, None if stamp_of is None else stamp_of(raw))
                except DataError:
                    raise
                except Exception as error:
                    raise DataError(
                        f"{self.path.name}, topic {channel.topic}",
                        f"message {counts[key]} does not hold what is selected of it ({first_line(error)}); "
                        "`clpv info` lists the fields of every topic.",
                    ) from error
        for key, (channel, _) in by_channel.items():
            if counts[key] != channel.count:
                raise DataError(
                    f"{self.path.name}, topic {channel.topic}",
                    f"is damaged: {channel.count} messages by its index, {counts[key]} found; {self.remedy}.",
                )

    def clocks(self) -> dict[str, tuple[Nanoseconds, Nanoseconds | None]]:
        """Log times and header stamps of every topic, in the recorded order; nothing but the stamps is decoded."""
        logs: dict[str, array[int]] = {channel.topic: array("q") for channel in self.channels}
        stamps: dict[str, array[int]] = {}
        by_id = {channel.id: channel for channel in self.channels}
        for channel in self.channels:
            if channel.decoder is not None and channel.decoder.header != "none":
                stamps[channel.topic] = array("q")
        with damage(self.path, self.remedy):
            for key, log, raw in self.messages(frozenset(by_id)):
                channel = by_id[key]
                logs[channel.topic].append(log)
                decoder = channel.decoder
                if decoder is None or decoder.header == "none":
                    continue
                if self.unpack is not None:
                    raw = self.unpack(raw)
                first = decoder.header == "first"
                stamps[channel.topic].append(decoder.stamp(raw) if first else _stamp(decoder.decode(raw)))
        whole = {name for name, times in stamps.items() if len(times) == len(logs[name])}
        return {
            name: (integers(times), integers(stamps[name]) if name in whole else None) for name, times in logs.items()
        }


class _Collector:
    """Numbers of one request, as they come."""

    def __init__(self, request: Request) -> None:
        self.request = request
        self.extract = request.extract
        self.width = request.width
        self.own_stamp = getattr(request.extract, "stamp", None)
        self.stamped = self.own_stamp is not None
        self.log = array("q")
        self.stamp = array("q")
        self.values = array("d")

    def add(self, message: Any, log: int, stamp: int | None) -> None:
        """Append the numbers of a message, if it holds any."""
        numbers = self.extract(message)
        if numbers is None:
            return
        if len(numbers) != self.width:
            raise ValueError(f"{len(numbers)} numbers instead of {self.width}")
        self.values.extend(numbers)
        self.log.append(log)
        if self.own_stamp is not None:
            seconds, nanoseconds = self.own_stamp(message)
            self.stamp.append(int(seconds) * 1_000_000_000 + int(nanoseconds))
        elif self.stamped:
            self.stamp.append(_stamp(message) if stamp is None else stamp)

    def samples(self) -> Samples:
        """All that was appended."""
        values = np.frombuffer(self.values, dtype=np.float64).reshape(-1, self.width)
        return Samples(log_time=integers(self.log), stamp=integers(self.stamp) if self.stamped else None, values=values)


def integers(values: array[int]) -> Nanoseconds:
    """An array, shape (n,), over the same memory."""
    return np.frombuffer(values, dtype=np.int64)


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
