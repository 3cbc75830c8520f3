"""MCAP files of any profile, with ROS messages in them: the project's own logs, ROS 2 bags, others' recordings.

The core `mcap` library gives the index, the chunks and their checksums; the walk over a chunk is here, since the
library builds an object of every message of every topic. A file whose recorder did not finish it has no index: on
demand it is read chunk by chunk, and what could not be read is said. Messages in JSON or protobuf are refused by topic.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from struct import Struct
from typing import Any

from pipeline.errors import DataError
from stages.ingest.readers.definitions import Decoder, UndecodableError, decoder, normal
from stages.ingest.readers.mcap_records import (
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER_OP,
    MESSAGE,
    MESSAGE_INDEX,
    MESSAGE_OP,
    RECORD,
    SCHEMA,
    chunk_content,
    definition,
    message_times,
    records,
)
from stages.ingest.readers.message_files import Channel, MessageRecording, damage
from stages.ingest.recording import Integrity

MAGIC = b"\x89MCAP0\r\n"
FOOTER = Struct("<BQQQI")
"""Opcode, length, start of the summary, start of its offsets, CRC of the summary."""
CRC_IN_CHUNK = RECORD.size + 24
"""Offset of a chunk's CRC: after its record's head, its times and its size."""

RECOVER = "`--recover` reads the chunks that are whole"

ENCODINGS = {"cdr": "cdr", "ros1": "ros1"}
SYNTAX = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl", "": "msg"}


class McapRecording(MessageRecording):
    """An MCAP file.

    Attributes:
        chunks: offsets of the chunks that are read, in their order, each with its channels, or None where unknown.
        loose: (start, end) of runs of messages outside chunks.
        lost: what could not be recovered.
        scanned: whether the index was not used.
    """

    def __init__(self, path: Path, *, recover: bool = False, format_name: str = "MCAP") -> None:
        super().__init__(path, format_name)
        self.chunks: list[tuple[int, frozenset[int] | None]] = []
        self.loose: list[tuple[int, int]] = []
        self.lost = ""
        self.scanned = False
        self.summary_protected = False
        self.schemas: dict[int, Any] = {}
        self.mcap_channels: dict[int, Any] = {}
        self.counts: dict[int, int] = {}
        self.spans: dict[int, tuple[int, int]] = {}
        self.remedy = f"copy it again, or {RECOVER}"
        with damage(path):
            self.stream = path.open("rb")
        try:
            with damage(path, self.remedy):
                self.size = self.stream.seek(0, 2)
                self._open(recover)
                self.channels = [self._channel(key) for key in sorted(self.mcap_channels)]
        except BaseException:
            self.stream.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self.stream.close()

    def _open(self, recover: bool) -> None:
        if self._at(0, len(MAGIC)) != MAGIC:
            raise DataError(self.path.name, "is not an MCAP file: it does not begin as one.")
        finished = self.size >= 2 * len(MAGIC) + FOOTER.size and self._at(self.size - 8, 8) == MAGIC
        if recover:
            self._borrow_definitions()
            self._scan(recover=True)
        elif not finished:
            raise DataError(
                self.path.name, f"is unfinished: its recorder did not close it, or it was cut short; {RECOVER}."
            )
        elif not self._index():
            self._scan(recover=False)

    def _borrow_definitions(self) -> None:
        """Take types and channels from the index where it is whole: the chunk that defined them may be damaged."""
        with suppress(Exception):
            self._index()
        self.chunks, self.counts, self.spans = [], {}, {}

    def _at(self, offset: int, length: int) -> bytes:
        self.stream.seek(offset)
        return self.stream.read(length)

    def _index(self) -> bool:
        """Take channels, counts and chunks from the summary at the end; False where it does not hold them all."""
        from mcap.reader import SeekingReader

        end = self.size - len(MAGIC)
        footer = self._at(end - FOOTER.size, FOOTER.size)
        opcode, length, start, _, crc = FOOTER.unpack(footer)
        if opcode != FOOTER_OP or length != 20:
            raise ValueError("its footer is no footer")
        if start == 0:
            return False
        if not len(MAGIC) <= start <= end - FOOTER.size:
            raise ValueError("its index lies outside the file")
        content = self._at(start, end - 4 - start)
        if crc != 0 and zlib.crc32(content) != crc:
            raise ValueError("the checksum of its index is wrong")
        self.stream.seek(0)
        summary = SeekingReader(self.stream, record_size_limit=self.size).get_summary()
        statistics = None if summary is None else summary.statistics
        if summary is None or statistics is None or not self._complete(summary):
            return False
        self.summary_protected = crc != 0
        self.schemas, self.mcap_channels = summary.schemas, summary.channels
        self.counts = {key: statistics.channel_message_counts.get(key, 0) for key in summary.channels}
        indexes = sorted(summary.chunk_indexes, key=lambda index: int(index.chunk_start_offset))
        for index in indexes:
            known = frozenset(index.message_index_offsets)
            self.chunks.append((index.chunk_start_offset, known or None))
        self._spans(indexes)
        return True

    @staticmethod
    def _complete(summary: Any) -> bool:
        """Whether the summary holds what the data hold: all channels with their schemas, and all messages in chunks."""
        statistics = summary.statistics
        needed = {channel.schema_id for channel in summary.channels.values()} - {0}
        return (
            statistics.channel_count == len(summary.channels)
            and needed <= set(summary.schemas)
            and statistics.chunk_count == len(summary.chunk_indexes)
            and (statistics.message_count == 0 or statistics.chunk_count > 0)
        )

    def _spans(self, indexes: list[Any]) -> None:
        """First and last log time of each channel, from the message indexes of its first and its last chunk."""
        ends: dict[int, list[Any]] = {}
        for index in indexes:
            for key in index.message_index_offsets:
                ends.setdefault(key, [index, index])[1] = index
        for key, (first, last) in ends.items():
            times = [time for index in (first, last) for time in self._times(index, key)]
            if times:
                self.spans[key] = (min(times), max(times))

    def _times(self, index: Any, key: int) -> list[int]:
        """Log times of a channel's messages in one chunk, by the chunk's index."""
        opcode, length = RECORD.unpack(self._at(index.message_index_offsets[key], RECORD.size))
        if opcode != MESSAGE_INDEX or length > self.size:
            return []
        times = message_times(self.stream.read(length))
        return [time for time in times if index.message_start_time <= time <= index.message_end_time]

    def _scan(self, *, recover: bool) -> None:
        """Walk through the records of the file; when recovering, leave out what cannot be read and count it."""
        self.scanned = True
        position, damaged, ended = len(MAGIC), 0, False
        while position + RECORD.size <= self.size:
            opcode, length = RECORD.unpack(self._at(position, RECORD.size))
            end = position + RECORD.size + length
            if end > self.size or opcode == 0:
                break
            if opcode in (DATA_END, FOOTER_OP):
                ended = True
                break
            try:
                self._take(opcode, position, end)
            except Exception:
                if not recover:
                    raise
                damaged += 1
            position = end
        if not ended and not recover:
            raise ValueError("its records end before its footer")
        self.lost = self._lost(damaged, 0 if ended else self.size - position)

    def _lost(self, damaged: int, rest: int) -> str:
        parts = []
        if damaged:
            kept = len(self.chunks)
            parts.append(f"{damaged} damaged record{'s' * (damaged > 1)} beside {kept} whole chunks")
        if rest:
            parts.append(f"the last {rest:,} of {self.size:,} bytes, an unfinished chunk or index")
        if not parts:
            return ""
        return f"Lost: {' and '.join(parts)}; recovered: {sum(self.counts.values()):,} messages."

    def _take(self, opcode: int, position: int, end: int) -> None:
        """Note what one record of the file holds."""
        if opcode == CHUNK:
            content = self._chunk(position)
            counts: dict[int, int] = {}
            found: dict[int, tuple[int, int]] = {}
            for inner, start, stop in records(content):
                if inner == MESSAGE_OP:
                    self._note(content, start, stop, counts, found)
                else:
                    self._define(inner, content[start:stop])
            self.chunks.append((position, frozenset(counts)))
            self._add(counts, found)
        elif opcode == MESSAGE_OP:
            counts, found = {}, {}
            start = position + RECORD.size
            self._note(self._at(start, MESSAGE.size), 0, end - start, counts, found)
            if self.loose and self.loose[-1][1] == position:
                self.loose[-1] = (self.loose[-1][0], end)
            else:
                self.loose.append((position, end))
            self._add(counts, found)
        elif opcode in (SCHEMA, CHANNEL):
            self._define(opcode, self._at(position + RECORD.size, end - position - RECORD.size))

    def _note(
        self, content: bytes, start: int, stop: int, counts: dict[int, int], found: dict[int, tuple[int, int]]
    ) -> None:
        if stop - start < MESSAGE.size:
            raise ValueError("a message is shorter than its head")
        key, _, log, _ = MESSAGE.unpack_from(content, start)
        if key not in self.mcap_channels:
            raise ValueError("a message is of no channel")
        counts[key] = counts.get(key, 0) + 1
        first, last = found.get(key, (log, log))
        found[key] = (min(first, log), max(last, log))

    def _add(self, counts: dict[int, int], found: dict[int, tuple[int, int]]) -> None:
        for key, count in counts.items():
            self.counts[key] = self.counts.get(key, 0) + count
            first, last = self.spans.get(key, found[key])
            self.spans[key] = (min(first, found[key][0]), max(last, found[key][1]))

    def _define(self, opcode: int, content: bytes) -> None:
        """Take a schema or a channel that the data define; other records do not matter here."""
        found = definition(opcode, content)
        if opcode == SCHEMA:
            self.schemas.setdefault(found.id, found)
        elif opcode == CHANNEL:
            self.mcap_channels.setdefault(found.id, found)

    def _chunk(self, offset: int) -> bytes:
        """Content of the chunk at an offset, uncompressed and checked."""
        opcode, length = RECORD.unpack(self._at(offset, RECORD.size))
        if opcode != CHUNK or offset + RECORD.size + length > self.size:
            raise ValueError("its index points to no chunk")
        return chunk_content(self.stream.read(length))

    def _channel(self, key: int) -> Channel:
        channel = self.mcap_channels[key]
        schema = self.schemas.get(channel.schema_id)
        name = normal(schema.name) if schema is not None and schema.name else "unknown"
        first, last = self.spans.get(key, (None, None))
        found, problem = self._decoder(channel, schema, name)
        return Channel(
            id=key,
            topic=channel.topic,
            type=name,
            count=self.counts.get(key, 0),
            decoder=found,
            problem=problem,
            first=first,
            last=last,
        )

    @staticmethod
    def _decoder(channel: Any, schema: Any, name: str) -> tuple[Decoder | None, str]:
        encoding, syntax = channel.message_encoding, "" if schema is None else schema.encoding
        if encoding not in ENCODINGS or syntax not in SYNTAX:
            kind = encoding if encoding not in ENCODINGS else syntax
            what = {"json": "JSON", "jsonschema": "JSON"}.get(kind, repr(kind))
            return None, (
                f"its messages are encoded as {what}; only ROS messages are read (cdr or ros1 with ros2msg, ros2idl "
                "or ros1msg definitions): record them as ROS messages, or export columns as CSV or parquet."
            )
        try:
            text = "" if schema is None else schema.data.decode()
            return decoder(name, text, SYNTAX[syntax], ENCODINGS[encoding]), ""
        except UndecodableError as error:
            return None, str(error)
        except UnicodeDecodeError:
            return None, "the definition of its type is damaged."

    def messages(self, wanted: frozenset[int]) -> Iterator[tuple[int, int, bytes]]:
        """Messages of the wanted channels, as they lie in the file; chunks without any are not read."""
        runs: list[tuple[int, int | None, frozenset[int] | None]] = [
            *((offset, None, keys) for offset, keys in self.chunks),
            *((start, end, None) for start, end in self.loose),
        ]
        unpack_record, unpack_message, head = RECORD.unpack_from, MESSAGE.unpack_from, MESSAGE.size
        for offset, end, keys in sorted(runs, key=lambda run: run[0]):
            if keys is not None and not keys & wanted:
                continue
            if end is not None:
                yield from self._loose_messages(offset, end, wanted)
                continue
            content = self._chunk(offset)
            position, size = 0, len(content)
            while position < size:
                opcode, length = unpack_record(content, position)
                start = position + 9
                position = start + length
                if position > size:
                    raise ValueError("a record reaches beyond its chunk")
                if opcode == MESSAGE_OP:
                    key, _, log, _ = unpack_message(content, start)
                    if key in wanted:
                        yield key, log, content[start + head : position]

    def _loose_messages(self, position: int, end: int, wanted: frozenset[int]) -> Iterator[tuple[int, int, bytes]]:
        while position < end:
            _, length = RECORD.unpack(self._at(position, RECORD.size))
            content = self.stream.read(length)
            key, _, log, _ = MESSAGE.unpack_from(content, 0)
            if key in wanted:
                yield key, log, content[MESSAGE.size :]
            position += RECORD.size + length

    def integrity(self) -> Integrity:
        """Protected where every chunk and the index carry a checksum."""
        with damage(self.path, self.remedy):
            checked = [any(self._at(offset + CRC_IN_CHUNK, 4)) for offset, _ in self.chunks]
        if self.scanned:
            note = "Read without an index, so that a chunk that is missing would go unnoticed."
            if self.loose:
                note = "Messages lie outside chunks, where no checksum protects them: a flipped bit goes unnoticed."
            return Integrity(protected=False, note=note, lost=self.lost)
        if not all(checked):
            note = "Its chunks carry no checksum (rosbags writes such files): a flipped bit goes unnoticed."
            return Integrity(protected=False, note=note)
        if not self.summary_protected:
            note = "Its index carries no checksum: a flipped bit in it may go unnoticed."
            return Integrity(protected=False, note=note)
        return Integrity(protected=True, note="Checksums of its chunks and its index protect it.")
