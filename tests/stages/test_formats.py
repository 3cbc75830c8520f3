"""What a path is, by what it holds, and one right sentence for what is not read."""

from __future__ import annotations

from pathlib import Path

import pytest
import recording_writers as writers

from pipeline.errors import DataError
from stages.ingest.readers.formats import open_recording
from stages.ingest.recording import Recording

NAMES = {
    "ros1": "ROS 1 bag",
    "ros2-sqlite3": "ROS 2 bag (SQLite)",
    "ros2-mcap": "ROS 2 bag (MCAP)",
    "db3": "ROS 2 recording (SQLite)",
    "mcap": "MCAP",
    "csv": "CSV",
    "parquet": "parquet",
    "lerobot-v2.1": "LeRobot v2.1",
    "lerobot-v3.0": "LeRobot v3.0",
}


@pytest.mark.parametrize("container", NAMES)
def test_a_format_is_recognised_by_its_content(tmp_path: Path, container: str) -> None:
    path = writers.write(tmp_path, container, "pose", writers.two_arms(10))
    if container != "csv":  # rows of text are known by their name alone
        path = path.rename(path.with_name("without a suffix"))
    with open_recording(path) as recording:
        assert recording.format == NAMES[container]
        assert recording.path == path
        needed: Recording = recording
        assert needed.topics()


def text(content: bytes | str):
    def make(path: Path) -> None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)

    return make


def folder(*names: str):
    def make(path: Path) -> None:
        path.mkdir()
        for name in names:
            (path / name).write_bytes(b"x")

    return make


POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:abc\nsize 12345\n"

REFUSED = [
    ("gone.bag", lambda path: None, "gone.bag: does not exist; check the path."),
    ("empty.bag", text(""), "empty.bag: is empty; copy it again."),
    ("pointer.bag", text(POINTER), "pointer.bag: is a Git LFS pointer, not the recording itself; fetch it with"),
    ("pointer.mcap", text(POINTER), "git lfs pull"),
    ("pointer.csv", text(POINTER), "git lfs pull"),
    ("text.bag", text("hello, world\n"), "text.bag: is a text file that is named like a recording"),
    ("text.db3", text("hello\n"), "text.db3: is a text file that is named like a recording"),
    ("notes.md", text("# Notes\n"), "notes.md: is a text file, but not named .csv; ROS 1 .bag, ROS 2 bags"),
    ("noise.bag", text(bytes(range(256))), "noise.bag: does not begin as a bag file does"),
    ("noise.xyz", text(bytes(range(256))), "noise.xyz: is of no format that is known; ROS 1 .bag"),
    ("demo.hdf5", text(b"\x89HDF\r\n\x1a\n" + bytes(100)), "demo.hdf5: is an HDF5 file; ROS 1 .bag"),
    ("demo.zip", text(b"PK\x03\x04" + bytes(100)), "demo.zip: is a zip archive"),
    ("demo.mat", text(b"MATLAB 5.0 MAT-file"), "demo.mat: is a MATLAB file"),
    ("demo.bag.zst", text(b"\x28\xb5\x2f\xfd" + bytes(100)), "is compressed as a whole; unpack it with `zstd -d`"),
    ("metadata.yaml", text("rosbag2_bagfile_information:\n"), "metadata.yaml: describes a ROS 2 bag; name its folder"),
    ("bag", folder(), "bag: is an empty folder."),
    ("bag", folder("readme"), "bag: is a folder without metadata.yaml"),
    ("bag", folder("b.db3", "a.mcap"), "meta/info.json (LeRobot), but holds a.mcap, b.db3: name that file."),
]


@pytest.mark.parametrize(("name", "make", "message"), REFUSED, ids=[f"{k}-{row[0]}" for k, row in enumerate(REFUSED)])
def test_what_is_not_read_is_refused_in_one_sentence(tmp_path: Path, name: str, make, message: str) -> None:
    path = tmp_path / name
    make(path)
    with pytest.raises(DataError) as caught:
        open_recording(path)
    said = str(caught.value)
    assert message in said
    assert said.startswith(f"{name}: ")
    assert str(tmp_path) not in said
    assert "\n" not in said


def test_a_file_may_not_be_readable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = writers.write(tmp_path, "mcap", "pose", writers.two_arms(5))

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(DataError, match=r"recording.mcap: may not be read: its permissions forbid it"):
        open_recording(path)


def test_memory_that_is_not_there_is_no_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = writers.write(tmp_path, "mcap", "pose", writers.two_arms(5))

    def exhaust(*_: object) -> None:
        raise MemoryError

    with open_recording(path) as recording:
        monkeypatch.setattr(type(recording), "_chunk", exhaust)
        with pytest.raises(DataError, match="asks for more memory than there is"):
            recording.clocks()
