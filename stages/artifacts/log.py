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
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import DataError
from pipeline.values import canonical
from stages.artifacts.channel import Channel, Nanoseconds
from stages.artifacts.channels import CHANNELS

KEY = "clpv"
"""Name of the metadata record, of what the messages of a channel share, and of the writer."""

CHUNK = 2**18
"""Bytes of a chunk before compression, about a second of a roll-out: what is lost where one is damaged."""

QOS = "offered_qos_profiles"
"""Of the metadata of a channel, which the profile ``ros2`` requires; empty: `ros2 bag play` offers its defaults."""

FOREVER = "{sec: 9223372036, nsec: 854775807}"

LATCHED = f"""- history: 1
  depth: 10
  reliability: 1
  durability: 1
  deadline: {FOREVER}
  lifespan: {FOREVER}
  liveliness: 1
  liveliness_lease_duration: {FOREVER}
  avoid_ros_namespace_conventions: false
"""
"""Keep last, reliable, transient local, automatic, as numbers: Humble reads nothing else; Jazzy and later, which write
words, look at the first one and read both (`convert<rclcpp::QoS>::decode` of rosbag2_storage)."""

PARAMETERS = "parameters.json"
"""Name of the attachment that holds the parameters."""


def write_log(
    path: Path, channels: Sequence[Channel], details: Mapping[str, Any], parameters: Mapping[str, Any] | None = None
) -> None:
    """Write channels as one file, their messages in order of time, those of one time in the order of the channels.

    Arguments:
        details: plain values by name: what this roll-out was. Each is kept as JSON.
        parameters: plain values: with what it was made; an attachment. None: there is none.

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
        if parameters is not None:
            content = canonical(parameters).encode()
            writer.add_attachment(0, 0, PARAMETERS, "application/json", content)
        names = dict.fromkeys(channel.message for channel in channels)
        schemas = {name: writer.register_schema(name, "ros2msg", definitions()[name]) for name in names}
        keys = []
        for channel in channels:
            shared = {KEY: canonical(channel.shared()), QOS: LATCHED if channel.latched else ""}
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
    return _beside(path)[0]


def read_parameters(path: Path) -> dict[str, Any] | None:
    """The parameters with which a log was made; none: it holds none. Raises DataError as `read_details`."""
    return _beside(path)[1]


def library(path: Path) -> str:
    """What wrote an MCAP file, as it says in its beginning; empty where it says nothing, or is no MCAP file."""
    from mcap.records import Header

    try:
        with _records(path) as records:
            first = next(records)
            return str(first.library) if isinstance(first, Header) else ""
    except DataError:
        return ""


def _beside(path: Path) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Details and parameters."""
    from mcap.records import Attachment, DataEnd, Metadata

    details, parameters = None, None
    with _records(path, emit_chunks=True) as records:
        for record in records:
            if isinstance(record, Metadata) and record.name == KEY:
                details = {name: json.loads(text) for name, text in record.metadata.items()}
            elif isinstance(record, Attachment) and record.name == PARAMETERS:
                parameters = json.loads(record.data)
            elif isinstance(record, DataEnd):
                break  # it holds the checksum of all before it
    if details is None:
        raise DataError(path.name, "was not written by clpv; `clpv info` describes recordings of others.")
    return details, parameters


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
    if KEY not in registered.metadata:
        raise DataError(source, "was not written by clpv; `clpv info` describes recordings of others.")
    if message not in CHANNELS:
        kind = message or "an unknown type"
        raise DataError(source, f"holds {kind}, as another version of clpv wrote it: run the stage again.")
    try:
        shared = json.loads(registered.metadata[KEY])
        channel = CHANNELS[message].decode(registered.topic, shared, np.array(times, dtype=np.int64), messages)
        return replace(channel, latched=bool(registered.metadata.get(QOS)))
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
