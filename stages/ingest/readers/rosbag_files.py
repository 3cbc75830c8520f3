"""ROS 1 bags: plain, bz2, lz4, and those with legacy definitions.

Messages are given in the order in which they lie in the file, not sorted by log time as rosbags gives them: a clock
that was set back while recording stays visible. rosbags reads the file's structure. Not here: ROS 2
(`rosbag2_files.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np

from pipeline.errors import DataError
from stages.ingest.readers.definitions import UndecodableError, decoder
from stages.ingest.readers.message_files import Channel, MessageRecording, damage
from stages.ingest.recording import Integrity

U32 = Struct("<I")
TIME = Struct("<II")

ENTRY = Struct("<III")
ENTRIES = np.dtype([("seconds", "<u4"), ("nanoseconds", "<u4"), ("offset", "<u4")])
"""Of an index: log time, and where in the chunk the message lies."""

MESSAGE_DATA, CONNECTION = b"\x02", b"\x07"
"""Opcodes of ROS 1 records that lie in a chunk."""


class Rosbag1Recording(MessageRecording):
    """A ROS 1 bag, format 2.0."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "ROS 1 bag")
        self.remedy = "copy or record it again, or try `rosbag reindex` and `rosbag fix`"
        with damage(path, self.remedy):
            self.reader = _reader(path)
            self._open_reader()
            try:
                self.channels = [self._channel(connection) for connection in self.reader.connections]
                self.stream = path.open("rb")
            except BaseException:
                self.reader.close()
                raise

    def _open_reader(self) -> None:
        from rosbags.rosbag1 import ReaderError

        try:
            self.reader.open()
        except ReaderError as error:
            if "not indexed" in str(error):
                raise DataError(
                    self.path.name, "was not closed by its recorder, so it has no index; run `rosbag reindex` on it."
                ) from error
            if "encryption" in str(error):
                raise DataError(self.path.name, "is encrypted; decrypt it with `rosbag decrypt`.") from error
            if "Bag version" in str(error):
                raise DataError(self.path.name, "is of a format before 2.0; convert it with `rosbag fix`.") from error
            raise

    def close(self) -> None:
        """Close the file."""
        if self.reader.bio is not None:
            self.reader.close()
            self.stream.close()

    def _channel(self, connection: Any) -> Channel:
        found, problem, count = None, "", 0
        ends: list[int] = []
        for _, entries in self.reader.entries.get(connection.id, ()):
            times = np.frombuffer(entries, dtype=ENTRIES)
            count += len(times)
            nanoseconds = times["seconds"].astype(np.int64) * 1_000_000_000 + times["nanoseconds"]
            if len(times):
                ends += [int(nanoseconds.min()), int(nanoseconds.max())]
        if count != sum(info.connection_counts.get(connection.id, 0) for info in self.reader.chunk_infos):
            raise ValueError("its index does not agree with itself")
        try:
            found = decoder(connection.msgtype, connection.msgdef.data, "msg", "ros1", connection.digest)
        except UndecodableError as error:
            problem = str(error)
        return Channel(
            id=connection.id,
            topic=connection.topic,
            type=connection.msgtype,
            count=count,
            decoder=found,
            problem=problem,
            first=min(ends, default=None),
            last=max(ends, default=None),
        )

    def messages(self, wanted: frozenset[int]) -> Iterator[tuple[int, int, bytes]]:
        """Messages of the wanted connections, chunk by chunk as they lie in the file."""
        by_chunk: dict[int, list[tuple[int, bytes]]] = {}
        for key in wanted:
            for position, entries in self.reader.entries.get(key, ()):
                by_chunk.setdefault(position, []).append((key, entries))
        message = _Heads().message
        for position in sorted(by_chunk):
            chunk = self.reader.chunks[position]
            self.stream.seek(chunk.datapos)
            packed = self.stream.read(chunk.datasize)
            if len(packed) != chunk.datasize:
                raise ValueError("a chunk reaches beyond its end")
            content = chunk.decompressor(packed)
            places = [
                (offset, seconds * 1_000_000_000 + nanoseconds, key)
                for key, entries in by_chunk[position]
                for seconds, nanoseconds, offset in ENTRY.iter_unpack(entries)
            ]
            for offset, time, key in sorted(places):
                found, recorded, raw = message(content, offset)
                if found != key or recorded != time:
                    raise ValueError("its index does not agree with its messages")
                yield key, time, raw

    def integrity(self) -> Integrity:
        """Never protected: bz2 alone checks its chunks, and nothing checks the index."""
        kinds = {chunk.decompressor.__name__ for chunk in self.reader.chunks.values()}
        if kinds == {"decompress"} and all(
            chunk.decompressor.__module__ == "bz2" for chunk in self.reader.chunks.values()
        ):
            return Integrity(
                protected=False,
                note="bz2 checks its chunks, but nothing checks its index: ROS 1 bags carry no checksums of their own.",
            )
        return Integrity(
            protected=False, note="ROS 1 bags carry no checksums: a flipped bit in a message goes unnoticed."
        )


def _reader(path: Path) -> Any:
    """rosbags' reader with an index that takes 12 bytes a message: its own takes a hundred and more."""
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import Header, RecordType, read_bytes, read_uint32

    class CompactReader(Reader):
        """Keeps the entries of the index as they lie in the file, by connection and chunk."""

        def __init__(self, path: Path) -> None:
            super().__init__(path)
            self.entries: dict[int, list[tuple[int, bytes]]] = {}

        def read_index_data(self, pos: int, indexes: Any) -> None:
            """Take the entries of one connection in one chunk."""
            if self.bio is None:
                raise ValueError("the file is not open")
            header = Header.read(self.bio, RecordType.IDXDATA)
            size = read_uint32(self.bio)
            if header.get_uint32("ver") != 1 or size != header.get_uint32("count") * ENTRY.size:
                raise ValueError("an index record is not as long as it says")
            content = read_bytes(self.bio, size)
            self.entries.setdefault(header.get_uint32("conn"), []).append((pos, content))

    return CompactReader(path)


class _Heads:
    """Finds messages in chunks; remembers how their records begin, since all of a bag's begin alike."""

    def __init__(self) -> None:
        self.length = -1
        self.connection, self.time = 0, 0
        self.between: list[tuple[int, int, bytes]] = []

    def message(self, content: bytes, offset: int) -> tuple[int, int, bytes]:
        """Connection, log time in nanoseconds and bytes of the message at an offset of a chunk."""
        (length,) = U32.unpack_from(content, offset)
        if length != self.length or any(content[offset + a : offset + b] != same for a, b, same in self.between):
            return self._learn(content, offset)
        (connection,) = U32.unpack_from(content, offset + self.connection)
        seconds, nanoseconds = TIME.unpack_from(content, offset + self.time)
        start = offset + 8 + length
        end = start + U32.unpack_from(content, start - 4)[0]
        if end > len(content):
            raise ValueError("a message reaches beyond its chunk")
        return connection, seconds * 1_000_000_000 + nanoseconds, content[start:end]

    def _learn(self, content: bytes, offset: int) -> tuple[int, int, bytes]:
        """The same by parsing; a connection's own record may lie before its first message."""
        while True:
            (length,) = U32.unpack_from(content, offset)
            fields = _fields(content, offset + 4, offset + 4 + length)
            start = offset + 8 + length
            end = start + U32.unpack_from(content, start - 4)[0]
            operation = fields.get(b"op", (0, b""))[1]
            if operation != CONNECTION or end > len(content):
                break
            offset = end
        if operation != MESSAGE_DATA or end > len(content):
            raise ValueError("its index points to no message")
        (connection_at, connection), (time_at, time) = fields[b"conn"], fields[b"time"]
        self.length, self.connection, self.time = length, connection_at - offset, time_at - offset
        seconds, nanoseconds = TIME.unpack(time)
        values = sorted([(self.connection, self.connection + 4), (self.time, self.time + 8)])
        ends = [4, *(place for value in values for place in value), 4 + length]
        self.between = [
            (a, b, content[offset + a : offset + b]) for a, b in zip(ends[::2], ends[1::2], strict=True) if a < b
        ]
        return U32.unpack(connection)[0], seconds * 1_000_000_000 + nanoseconds, content[start:end]


def _fields(content: bytes, position: int, end: int) -> dict[bytes, tuple[int, bytes]]:
    """Name -> offset and bytes of the fields of a record's head."""
    fields: dict[bytes, tuple[int, bytes]] = {}
    while position < end:
        (size,) = U32.unpack_from(content, position)
        name, equals, value = content[position + 4 : position + 4 + size].partition(b"=")
        if not equals or position + 4 + size > end:
            raise ValueError("the head of a record is damaged")
        fields[name] = (position + 5 + len(name), value)
        position += 4 + size
    return fields
