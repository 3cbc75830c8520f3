"""ROS 2 recordings: SQLite files and bags, which are folders with a metadata.yaml and SQLite or MCAP files.

Messages are given in the order in which they were written, not sorted by log time as rosbags gives them: a clock that
was set back while recording stays visible. SQLite files are read with Python's own library, which has no trouble with
names that hold a ``?`` or a ``#``. Not here: MCAP itself (`mcap_files.py`).
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.errors import DataError
from stages.ingest.readers.definitions import UndecodableError, decoder, normal
from stages.ingest.readers.mcap_files import McapRecording
from stages.ingest.readers.message_files import Channel, MessageRecording, beginning, damage
from stages.ingest.recording import Integrity

LARGEST_METADATA = 10_000_000
"""Bytes of a metadata.yaml that are parsed at most."""

NEWEST_METADATA = 9
"""Version of metadata.yaml (ROS 2 Kilted) up to which its layout is known."""


class SqliteRecording(MessageRecording):
    """A ROS 2 recording in a SQLite file."""

    def __init__(self, path: Path, format_name: str = "ROS 2 recording (SQLite)") -> None:
        super().__init__(path, format_name)
        wal = path.with_name(f"{path.name}-wal")
        self.lost = ""
        if wal.exists() and wal.stat().st_size > 0:
            self.lost = (
                f"{wal.name} beside it holds messages that were never written into it and are not read; "
                f"`sqlite3 {path.name} 'PRAGMA wal_checkpoint'` writes them."
            )
        with damage(path):
            # `immutable`: nothing is written, not even a lock, so that read-only folders work.
            self.database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
        try:
            with damage(path):
                self._open()
        except BaseException:
            self.database.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self.database.close()

    def _columns(self, table: str) -> set[str]:
        return {row[1] for row in self.database.execute(f"PRAGMA table_info({table})")}

    def _open(self) -> None:
        columns = self._columns("topics")
        if not {"id", "name", "type", "serialization_format"} <= columns or not {
            "id",
            "topic_id",
            "timestamp",
            "data",
        } <= self._columns("messages"):
            raise DataError(
                self.path.name, "is a SQLite database but no ROS 2 recording: it has no tables of topics and messages."
            )
        definitions: dict[str, tuple[str, str]] = {}
        if self._columns("message_definitions"):
            query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            definitions = {normal(name): (encoding, text) for name, encoding, text in self.database.execute(query)}
        counted: dict[int, tuple[int, int, int]] = {
            key: rest
            for key, *rest in self.database.execute(
                "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages GROUP BY topic_id"
            )
        }
        digest = "type_description_hash" if "type_description_hash" in columns else "''"
        rows = self.database.execute(f"SELECT id, name, type, serialization_format, {digest} FROM topics ORDER BY id")
        self.channels = [
            self._channel(int(key), str(topic), normal(str(kind)), (str(encoding), str(found)), definitions, counted)
            for key, topic, kind, encoding, found in rows
        ]
        if stray := counted.keys() - {channel.id for channel in self.channels}:
            raise ValueError(f"it holds messages of {len(stray)} unknown topics")

    @staticmethod
    def _channel(
        key: int,
        topic: str,
        kind: str,
        encoding_and_digest: tuple[str, str],
        definitions: dict[str, tuple[str, str]],
        counted: dict[int, tuple[int, int, int]],
    ) -> Channel:
        found, problem = None, ""
        encoding, digest = encoding_and_digest
        syntax, text = definitions.get(kind, ("ros2msg", ""))
        if encoding != "cdr":
            problem = foreign(encoding)
        else:
            try:
                found = decoder(kind, text, "idl" if syntax == "ros2idl" else "msg", "cdr", digest)
            except UndecodableError as error:
                problem = str(error)
        count, first, last = counted.get(key, (0, None, None))
        return Channel(
            id=key, topic=topic, type=kind, count=count, decoder=found, problem=problem, first=first, last=last
        )

    def messages(self, wanted: frozenset[int]) -> Iterator[tuple[int, int, bytes]]:
        """Messages of the wanted topics, in the order in which they were written."""
        marks = ",".join("?" * len(wanted))
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY id"
        with closing(self.database.cursor()) as cursor:
            yield from cursor.execute(query, sorted(wanted))

    def integrity(self) -> Integrity:
        """Never protected."""
        note = "SQLite recordings carry no checksums: a flipped bit in a message goes unnoticed."
        return Integrity(protected=False, note=note, lost=self.lost)


def foreign(encoding: str) -> str:
    """End of a sentence about a topic that is not encoded as CDR."""
    return f"its messages are encoded as {encoding!r}; cdr is what ROS 2 records and what is read: record them again."


class FolderRecording(MessageRecording):
    """A ROS 2 bag: a folder with metadata.yaml and one or more files, in their order."""

    def __init__(self, path: Path, *, recover: bool = False) -> None:
        with damage(path):
            metadata = self._metadata(path)
        storage = str(metadata["storage_identifier"])
        names = {"sqlite3": "SQLite", "mcap": "MCAP"}
        if storage not in names:
            raise DataError(path.name, f"is stored as {storage!r}; sqlite3 and mcap are read: convert the recording.")
        super().__init__(path, f"ROS 2 bag ({names[storage]})")
        self.parts: list[MessageRecording] = []
        self.temporary: TemporaryDirectory[str] | None = None
        try:
            with damage(path):
                files = self._files(metadata, str(metadata.get("compression_mode") or "").lower())
                for file in files:
                    part = McapRecording(file, recover=recover) if storage == "mcap" else SqliteRecording(file)
                    self.parts.append(part)
            self.remedy = self.parts[0].remedy if self.parts else self.remedy
            self._merge(metadata)
        except BaseException:
            self.close()
            raise

    @staticmethod
    def _metadata(path: Path) -> dict[str, Any]:
        from ruamel.yaml import YAML
        from ruamel.yaml.error import YAMLError

        file = path / "metadata.yaml"
        if file.stat().st_size > LARGEST_METADATA:
            raise DataError(path.name, "its metadata.yaml is too large to be one; record it again.")
        try:
            content = YAML(typ="safe").load(file.read_text(encoding="utf-8"))
            metadata: dict[str, Any] = content["rosbag2_bagfile_information"]
            version = int(metadata["version"])
            for key in ("storage_identifier", "relative_file_paths", "topics_with_message_count"):
                metadata[key]
        except (YAMLError, UnicodeDecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(
                path.name,
                "its metadata.yaml is damaged or not one of a ROS 2 bag; write it anew with `ros2 bag reindex`.",
            ) from error
        if version > NEWEST_METADATA:
            raise DataError(
                path.name,
                f"its metadata.yaml is of version {version}; versions up to {NEWEST_METADATA} are read: "
                "open its .mcap or .db3 file instead.",
            )
        return metadata

    def _files(self, metadata: dict[str, Any], mode: str) -> list[Path]:
        """The files of the bag, uncompressed into a temporary folder where they are compressed as a whole."""
        compression = str(metadata.get("compression_format") or "")
        if mode in ("file", "message") and compression != "zstd":
            raise DataError(self.path.name, f"is compressed by {compression!r}; zstd is read.")
        files = [self.path / PurePath(str(name)).name for name in metadata["relative_file_paths"] or []]
        missing = [file.name for file in files if not file.is_file()]
        if missing:
            raise DataError(
                self.path.name, f"its metadata.yaml names {', '.join(missing)}, not there: copy the folder whole."
            )
        for file in files:
            beginning(file)
        if mode == "message":
            self.unpack = _unpacker()
        if mode != "file":
            return files
        self.temporary = TemporaryDirectory(prefix="clpv-")
        plain = [Path(self.temporary.name) / file.stem for file in files]
        for file, target in zip(files, plain, strict=True):
            with damage(file):
                _unpack_file(file, target)
        return plain

    def _merge(self, metadata: dict[str, Any]) -> None:
        """Channels of all parts, with ids of their own, and the encodings that metadata.yaml names."""
        formats: dict[str, str] = {}
        with damage(self.path):
            for entry in metadata["topics_with_message_count"] or []:
                topic = entry["topic_metadata"]
                formats[str(topic["name"])] = str(topic["serialization_format"])
        self.ids: dict[int, tuple[int, int]] = {}
        for position, part in enumerate(self.parts):
            for channel in part.channels:
                key = len(self.ids)
                self.ids[key] = (position, channel.id)
                values = {**vars(channel), "id": key}
                if (encoding := formats.get(channel.topic, "cdr")) != "cdr":
                    values |= {"decoder": None, "problem": foreign(encoding)}
                self.channels.append(Channel(**values))
        self.claimed = metadata.get("message_count")

    def close(self) -> None:
        """Close the files, and remove what was uncompressed."""
        for part in self.parts:
            part.close()
        if self.temporary is not None:
            self.temporary.cleanup()
            self.temporary = None

    def messages(self, wanted: frozenset[int]) -> Iterator[tuple[int, int, bytes]]:
        """Messages of the wanted channels, file by file."""
        for position, part in enumerate(self.parts):
            keys = {inner: key for key, (owner, inner) in self.ids.items() if owner == position and key in wanted}
            if not keys:
                continue
            for inner, log, raw in part.messages(frozenset(keys)):
                yield keys[inner], log, raw

    def integrity(self) -> Integrity:
        """Protected where each file is, and metadata.yaml counts as many messages as they hold."""
        parts = [part.integrity() for part in self.parts]
        lost = " ".join(part.lost for part in parts if part.lost)
        count = sum(channel.count for channel in self.channels)
        weak = next((part for part in parts if not part.protected), None)
        if weak is not None:
            return Integrity(protected=False, note=weak.note, lost=lost)
        if self.claimed != count:
            note = f"metadata.yaml counts {self.claimed} messages, the files hold {count}: it does not fit them."
            return Integrity(protected=False, note=note, lost=lost)
        note = parts[0].note if parts else "It holds no files, so there is nothing to protect."
        return Integrity(protected=bool(parts), note=note, lost=lost)


def _unpack_file(packed: Path, plain: Path) -> None:
    """Uncompress a file of one zstd frame; one that is cut is an error, which the library's own copying passes over."""
    import zstandard

    unpack = zstandard.ZstdDecompressor().decompressobj()
    with packed.open("rb") as source, plain.open("wb") as target:
        while block := source.read(zstandard.DECOMPRESSION_RECOMMENDED_INPUT_SIZE):
            target.write(unpack.decompress(block))
            if unpack.eof:
                return
    raise ValueError("its end is missing")


def _unpacker() -> Callable[[bytes], bytes]:
    import zstandard

    decompressor = zstandard.ZstdDecompressor()

    def unpack(raw: bytes) -> bytes:
        return bytes(decompressor.decompress(raw))

    return unpack
