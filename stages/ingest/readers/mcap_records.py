"""Records of MCAP files: bytes in, schemas, channels, times and the content of chunks out. No files.

The core `mcap` library parses them; what is checked beyond it is that a chunk is compressed by what is known, is as
long as it says and no longer than can be, since the library allocates before it looks.
"""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from struct import Struct
from typing import Any

RECORD = Struct("<BQ")
"""Opcode and length: what precedes a record's content."""
MESSAGE = Struct("<HIQQ")
"""Channel, sequence, log time, publish time: what precedes a message's content."""

FOOTER_OP, SCHEMA, CHANNEL, MESSAGE_OP, CHUNK, MESSAGE_INDEX, DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x0F

LARGEST_CHUNK = 2**31
"""Bytes of an uncompressed chunk that are read at most; recorders write chunks of about a megabyte."""


def records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the records of a chunk; raises ValueError where one reaches beyond it."""
    position, size = 0, len(content)
    while position < size:
        opcode, length = RECORD.unpack_from(content, position)
        start = position + RECORD.size
        position = start + length
        if position > size:
            raise ValueError("a record reaches beyond its chunk")
        yield opcode, start, position


def definition(opcode: int, content: bytes) -> Any:
    """The schema or the channel that a record holds; None for other records."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    reader = {SCHEMA: Schema.read, CHANNEL: Channel.read}.get(opcode)
    return None if reader is None else reader(ReadDataStream(BytesIO(content)))


def message_times(content: bytes) -> list[int]:
    """Log times, nanoseconds, that a message index holds."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import MessageIndex

    return [time for time, _ in MessageIndex.read(ReadDataStream(BytesIO(content))).records]


def chunk_content(record: bytes) -> bytes:
    """Content of a chunk record, uncompressed; raises ValueError where it, or its checksum, is not what it says."""
    import zstandard
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream

    chunk = Chunk.read(ReadDataStream(BytesIO(record)))
    if chunk.compression not in ("", "zstd", "lz4"):
        raise ValueError(f"a chunk is compressed by {chunk.compression!r}; zstd and lz4 are read")
    if chunk.uncompressed_size > LARGEST_CHUNK:
        raise ValueError("a chunk claims to be larger than 2 GB")
    sizes = (-1, chunk.uncompressed_size)
    if chunk.compression == "zstd" and zstandard.frame_content_size(chunk.data) not in sizes:
        raise ValueError("a chunk's size is not what it says")
    if chunk.uncompressed_size == 0:
        return b""
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    if size != chunk.uncompressed_size:
        raise ValueError("a chunk's size is not what it says")
    return stream.read(size)
