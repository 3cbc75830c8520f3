"""Which format a file or a folder is of, by what it holds and not by its name, and the recording opened.

What cannot be read is refused in one sentence: a path that is not there, an empty file, a Git LFS pointer, a text file
that is named like a bag, a folder without metadata.yaml, and what nothing here reads.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import DataError
from stages.ingest.readers.message_files import beginning, damage
from stages.ingest.recording import Recording

READ = (
    "ROS 1 .bag, ROS 2 bags (a folder, or a lone .db3 or .mcap), MCAP, CSV, parquet and LeRobot folders "
    "(v2.1 and v3) are read"
)
"""End of the sentence about a format that is not read."""

MCAP = b"\x89MCAP0\r\n"
ROSBAG1 = b"#ROSBAG V"
SQLITE = b"SQLite format 3\x00"
PARQUET = b"PAR1"
ZSTD = b"\x28\xb5\x2f\xfd"

OTHERS = {
    b"\x89HDF\r\n\x1a\n": "an HDF5 file",
    b"PK\x03\x04": "a zip archive",
    b"\x1f\x8b": "a gzip file: unpack it first",
    b"MATLAB 5.0": 'a MATLAB file (LASA motions are ingested by `kind = "lasa"`)',
    b"\x93NUMPY": "a NumPy array",
    b"ARROW1": "an Arrow file: write it as parquet",
    b"RRF2": "a Rerun recording",
}
"""Beginnings of files that people have and that are not read."""

TABLES = {".csv", ".tsv", ".txt"}
BAGS = {".bag", ".db3", ".mcap", ".parquet"}


def open_recording(path: Path, *, recover: bool = False) -> Recording:
    """Open a file or a folder for reading; `recover` reads what is whole of an unfinished or damaged MCAP file.

    Raises DataError, in one sentence that names the file and the remedy, where it is not there, is not of a format that
    is read, or is damaged.
    """
    with damage(path):
        if not path.exists():
            raise DataError(path.name, "does not exist; check the path.")
        return _open_folder(path, recover) if path.is_dir() else _open_file(path, recover)


def _open_file(path: Path, recover: bool) -> Recording:
    from stages.ingest.readers.mcap_files import McapRecording
    from stages.ingest.readers.parquet_files import ParquetRecording
    from stages.ingest.readers.rosbag2_files import SqliteRecording
    from stages.ingest.readers.rosbag_files import Rosbag1Recording
    from stages.ingest.readers.row_files import CsvRecording

    head = beginning(path)
    if head.startswith(ROSBAG1):
        return Rosbag1Recording(path)
    if head.startswith(MCAP):
        return McapRecording(path, recover=recover)
    if head.startswith(SQLITE):
        return SqliteRecording(path)
    if head.startswith(PARQUET):
        return ParquetRecording(path)
    if head.startswith(ZSTD):
        raise DataError(path.name, "is compressed as a whole; unpack it with `zstd -d`, or open the bag's folder.")
    for magic, what in OTHERS.items():
        if head.startswith(magic):
            raise DataError(path.name, f"is {what}; {READ}.")
    suffix = path.suffix.lower()
    if not _is_text(head):
        if suffix in BAGS:
            kind = suffix.lstrip(".")
            raise DataError(
                path.name, f"does not begin as a {kind} file does: it is damaged or something else; {READ}."
            )
        raise DataError(path.name, f"is of no format that is known; {READ}.")
    if suffix in TABLES:
        return CsvRecording(path)
    if path.name == "metadata.yaml":
        raise DataError(path.name, f"describes a ROS 2 bag; name its folder, {path.resolve().parent.name}.")
    if suffix in BAGS:
        raise DataError(path.name, "is a text file that is named like a recording; copy the recording itself.")
    raise DataError(path.name, f"is a text file, but not named .csv; {READ}.")


def _open_folder(path: Path, recover: bool) -> Recording:
    from stages.ingest.readers.parquet_files import LeRobotRecording
    from stages.ingest.readers.rosbag2_files import FolderRecording

    if (path / "metadata.yaml").is_file():
        return FolderRecording(path, recover=recover)
    if (path / "meta" / "info.json").is_file():
        return LeRobotRecording(path)
    files = sorted(entry.name for entry in path.iterdir() if entry.suffix in (BAGS | {".csv"}))
    if files:
        shown = ", ".join(files[:5]) + (", …" if len(files) > 5 else "")
        raise DataError(
            path.name,
            f"is a folder without metadata.yaml (ROS 2) or meta/info.json (LeRobot), but holds {shown}: "
            "name that file.",
        )
    if not any(path.iterdir()):
        raise DataError(path.name, "is an empty folder.")
    raise DataError(path.name, f"is a folder without metadata.yaml (ROS 2) or meta/info.json (LeRobot); {READ}.")


def _is_text(head: bytes) -> bool:
    """Whether the beginning of a file reads as text: UTF-8 that may be cut in its last character, no control codes."""
    if any(byte < 32 and byte not in b"\t\n\r\f" for byte in head):
        return False
    for cut in range(4):
        try:
            head[: len(head) - cut].decode("utf-8-sig")
        except UnicodeDecodeError:
            continue
        return True
    return False
