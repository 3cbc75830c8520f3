"""logs/<rollout>.mcap: everything that moved in one physics roll-out, or in one teleoperation recording.

Columns of arrays (`channels.py`) in, an MCAP file of ROS 2 messages out: it opens in rerun, Foxglove and `ros2 bag`,
`ingest` reads it like any recording, and `read_log` gives the columns back. All times count from the start of the
roll-out: equal arrays, equal bytes. Not here: recordings of others (`stages/ingest/readers`), and the table of all
roll-outs (`rollouts.py`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import DataError, choices
from pipeline.values import canonical
from stages.artifacts.channels import CHANNELS, Channel, Nanoseconds

KEY = "clpv"
"""Name of the metadata record, of what the messages of a channel share, and of the writer."""

CHUNK = 2**18
"""Bytes of a chunk before compression, about a second of a roll-out: what is lost where one is damaged."""

NO_QOS = {"offered_qos_profiles": ""}
"""The profile ``ros2`` requires the name; empty: `ros2 bag play` offers its defaults."""


def write_log(path: Path, channels: Sequence[Channel], details: Mapping[str, Any]) -> None:
    """Write channels as one file, their messages in order of time, those of one time in the order of the channels.

    Arguments:
        details: plain values by name: parameters of the roll-out. Each is kept as JSON.

    Raises DataError, naming the file and the topic, where a channel cannot be written or two have one topic.
    """
    from mcap.writer import CompressionType, Writer

    _check(path, channels)
    encoded = [channel.encode() for channel in channels]
    with path.open("wb") as stream:
        writer: Any = Writer(
            stream, chunk_size=CHUNK, compression=CompressionType.ZSTD, enable_crcs=True, enable_data_crcs=True
        )
        writer.start("ros2", KEY)
        writer.add_metadata(KEY, {name: canonical(details[name]) for name in sorted(details)})
        names = dict.fromkeys(channel.message for channel in channels)
        schemas = {name: writer.register_schema(name, "ros2msg", definitions()[name]) for name in names}
        keys = []
        for channel in channels:
            shared = {KEY: canonical(channel.shared()), **NO_QOS}
            keys.append(writer.register_channel(channel.topic, "cdr", schemas[channel.message], shared))
        for index, time, message in _merged(encoded):
            writer.add_message(keys[index], time, message, time)
        writer.finish()


def read_log(path: Path) -> dict[str, Channel]:
    """The channels of a log by topic, in the order in which they were written; all checksums are checked.

    Raises DataError, naming the file and the topic, where it is no log of clpv, or is damaged.
    """
    from mcap.records import Channel as Registered
    from mcap.records import DataEnd, Message, Schema

    schemas: dict[int, str] = {}
    registered: dict[int, Any] = {}
    found: dict[int, tuple[list[int], list[bytes]]] = {}
    with _records(path) as records:
        for record in records:
            if isinstance(record, Message):
                times, messages = found[record.channel_id]
                times.append(record.log_time)
                messages.append(record.data)
            elif isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Registered):
                registered[record.id] = record
                found.setdefault(record.id, ([], []))
            elif isinstance(record, DataEnd) and registered:
                break  # a log without messages names its channels behind this
    return {
        channel.topic: _decoded(path, channel, schemas.get(channel.schema_id, ""), *found[key])
        for key, channel in registered.items()
    }


def read_details(path: Path) -> dict[str, Any]:
    """What a log says beside its messages; raises DataError where it is no log of clpv, or is damaged."""
    from mcap.records import DataEnd, Metadata

    found = None
    with _records(path, emit_chunks=True) as records:
        for record in records:
            if isinstance(record, Metadata) and record.name == KEY:
                found = {name: json.loads(text) for name, text in record.metadata.items()}
            elif isinstance(record, DataEnd):
                break  # it holds the checksum of all before it
    if found is None:
        raise DataError(path.name, "was not written by clpv; `clpv info` describes recordings of others.")
    return found


@lru_cache(maxsize=1)
def definitions() -> Mapping[str, bytes]:
    """Definitions of the message types of all channels, as ROS 2 Humble has them."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    return {name: store.generate_msgdef(name, ros_version=2)[0].encode() for name in CHANNELS}


def _check(path: Path, channels: Sequence[Channel]) -> None:
    topics = [channel.topic for channel in channels]
    for channel in channels:
        problem = "two channels have this topic." if topics.count(channel.topic) > 1 else channel.problem()
        if problem:
            raise DataError(f"{path.name}, topic {channel.topic}", problem)


def _merged(encoded: Sequence[tuple[Nanoseconds, list[bytes]]]) -> Iterator[tuple[int, int, bytes]]:
    """Number of the channel, time in nanoseconds and bytes of each message, in order of time."""
    messages = [message for _, of_channel in encoded for message in of_channel]
    if not messages:
        return
    times = np.concatenate([time for time, _ in encoded])
    owners = np.repeat(np.arange(len(encoded)), [len(of_channel) for _, of_channel in encoded])
    order = np.argsort(times, kind="stable")
    for index, time, place in zip(owners[order].tolist(), times[order].tolist(), order.tolist(), strict=True):
        yield index, time, messages[place]


def _decoded(path: Path, registered: Any, message: str, times: list[int], messages: list[bytes]) -> Channel:
    source = f"{path.name}, topic {registered.topic}"
    if message not in CHANNELS:
        raise DataError(source, f"holds messages of type {message or 'unknown'}; {choices(message, CHANNELS)}")
    if KEY not in registered.metadata:
        raise DataError(source, "was not written by clpv; `clpv info` describes recordings of others.")
    try:
        shared = json.loads(registered.metadata[KEY])
        return CHANNELS[message].decode(registered.topic, shared, np.array(times, dtype=np.int64), messages)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DataError(source, f"is damaged ({_said(error)}): run the stage again.") from error


@contextmanager
def _records(path: Path, emit_chunks: bool = False) -> Iterator[Iterator[Any]]:
    """Records of a file; whatever is raised where it is missing, damaged or something else becomes one sentence."""
    from mcap.stream_reader import StreamReader

    try:
        with path.open("rb") as stream:
            limit = path.stat().st_size
            yield StreamReader(stream, emit_chunks=emit_chunks, validate_crcs=True, record_size_limit=limit).records
    except FileNotFoundError:
        raise DataError(path.name, "does not exist.") from None
    except OSError as error:
        raise DataError(path.name, f"cannot be read: {error.strerror}.") from error
    except Exception as error:  # on damaged bytes the library raises nearly anything
        raise DataError(path.name, f"is no MCAP file, or is damaged ({_said(error)}): run the stage again.") from error


def _said(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
