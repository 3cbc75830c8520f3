"""Damage of every kind, by hand and at random: one sentence that names the file, or the numbers that were written."""

from __future__ import annotations

import functools
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import recording_writers as writers
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from pipeline.errors import DataError
from stages.ingest.readers.formats import open_recording
from stages.ingest.recording import Integrity, Request, Samples

LONGEST = 5.0
"""Seconds within which the smallest of files is read or refused."""

COUNT = 40


class Left:
    """The position of the left arm, in a message or in a row."""

    def __init__(self, table: bool) -> None:
        self.table = table

    def __call__(self, message):
        if self.table:
            return [message["left_x"], message["left_y"], message["left_z"]]
        p = message.pose.position
        return [p.x, p.y, p.z]


class State:
    def __call__(self, row):
        return row["observation.state"][:3]


def request(container: str) -> Request:
    if container.startswith("lerobot"):
        return Request(topic="table", extract=State(), width=3, columns=("observation.state",))
    if container == "parquet-lists":
        return Request(topic="table", extract=lambda row: row["left_pose"][:3], width=3, columns=("left_pose",))
    if container in writers.TABLES:
        return Request(topic="table", extract=Left(True), width=3, columns=("left_x", "left_y", "left_z"))
    return Request(topic="/left/pose", extract=Left(False), width=3)


def read(path: Path, container: str, *, recover: bool = False) -> tuple[Samples, Integrity]:
    with open_recording(path, recover=recover) as recording:
        recording.topics()
        (samples,) = recording.read([request(container)], recording.episodes()[0])
        return samples, recording.integrity()


def largest(path: Path) -> Path:
    """The file that holds the messages."""
    if path.is_file():
        return path
    return max((file for file in path.rglob("*") if file.is_file()), key=lambda file: file.stat().st_size)


Damage = Callable[[bytearray], bytes | bytearray]


def cut(part: float) -> Damage:
    return lambda data: data[: int(part * len(data))]


def flip(offset: int, mask: int = 0x10) -> Damage:
    def damage(data: bytearray) -> bytearray:
        data[offset] ^= mask
        return data

    return damage


def flip_behind(mark: bytes, offset: int = 0, mask: int = 0x10, *, last: bool = False) -> Damage:
    def damage(data: bytearray) -> bytearray:
        place = data.rindex(mark) if last else data.index(mark)
        data[place + len(mark) + offset] ^= mask
        return data

    return damage


def put(mark: bytes, content: bytes, *, last: bool = False) -> Damage:
    def damage(data: bytearray) -> bytearray:
        place = data.rindex(mark) if last else data.index(mark)
        data[place : place + len(content)] = content
        return data

    return damage


def lengthen_message(data: bytearray) -> bytearray:
    """Let the first MCAP message say that it is 16 MB longer than it is."""
    found = re.search(rb"\x05.\x00{7}\x01\x00", data, re.DOTALL)
    assert found is not None
    data[found.start() + 4] = 1
    return data


CASES: dict[str, tuple[str, Damage, str]] = {
    "ros1 cut in its magic": ("ros1", lambda data: data[:8], "text file that is named"),
    "ros1 cut behind its magic": ("ros1", lambda data: data[:13], "damaged"),
    "ros1 cut in its header": ("ros1", cut(0.01), "damaged"),
    "ros1 cut in its first chunk": ("ros1", cut(0.3), "index looks damaged"),
    "ros1 cut in its index": ("ros1", cut(0.98), "damaged"),
    "ros1 last byte missing": ("ros1", lambda data: data[:-1], "damaged"),
    "ros1 never closed": ("ros1", put(b"index_pos=", b"index_pos=" + bytes(8)), "rosbag reindex"),
    "ros1 of format 1.2": ("ros1", put(b"#ROSBAG V2.0", b"#ROSBAG V1.2"), "format before 2.0"),
    "ros1 flip in its header": ("ros1", flip_behind(b"chunk_count="), "damaged"),
    "ros1 flip in an operation": ("ros1", flip_behind(b"op=\x05", -1), "damaged"),
    "ros1 flip in an index": ("ros1", flip_behind(b"op=\x04", 60), "damaged"),
    "ros1 unknown compression": ("ros1", put(b"compression=none", b"compression=nine"), "not supported"),
    "bz2 flip in its chunk": ("ros1-bz2", flip(6000), "damaged"),
    "lz4 cut in its chunk": ("ros1-lz4", cut(0.5), "damaged"),
    "db3 cut": ("db3", cut(0.5), "malformed|damaged"),
    "db3 cut to its header": ("db3", lambda data: data[:100], "damaged|no ROS 2 recording"),
    "db3 flip in its schema": ("db3", put(b"CREATE TABLE topics", b"CREATE TABLE tipocs"), "damaged|no tables"),
    "db3 of something else": ("db3", put(b"TABLE messages", b"TABLE massages"), "damaged|no tables"),
    "db3 unknown type": ("db3", lambda d: d.replace(b"PoseStamped", b"PoseStumped"), "does not match its digest"),
    "db3 wrong serialization": ("db3", lambda d: d.replace(b"PoseStampedcdr", b"PoseStampedxml"), "encoded as 'xml'"),
    "mcap cut in its magic": ("mcap", lambda data: data[:5], "no format|damaged|does not begin"),
    "mcap cut in its header": ("mcap", lambda data: data[:20], "unfinished: .*--recover"),
    "mcap cut in a chunk": ("mcap", cut(0.5), "unfinished: .*--recover"),
    "mcap cut in its index": ("mcap", cut(0.97), "unfinished: .*--recover"),
    "mcap last byte missing": ("mcap", lambda data: data[:-1], "unfinished"),
    "mcap flip in a chunk": ("mcap", flip_behind(b"zstd", 200), "damaged .*--recover"),
    "mcap flip in a chunk's size": ("mcap", flip_behind(b"zstd", -15), "damaged .*--recover"),
    "mcap unknown compression": ("mcap", put(b"zstd", b"zzzz"), "compressed by 'zzzz'"),
    "mcap flip in its index": ("mcap", flip_behind(b"/left/pose", 0, last=True), "checksum of its index is wrong"),
    "mcap flip in its footer": ("mcap", flip(-30), "damaged"),
    "mcap plain, other topic": ("mcap-plain", lambda d: d.replace(b"/left/pose", b"/lost/pose"), "no topic /left/pose"),
    "mcap plain, longer record": ("mcap-plain", lengthen_message, "reaches beyond its chunk"),
    "mcap unindexed, cut": ("mcap-unindexed", lambda d: d[: len(d) // 2] + d[-37:], "damaged"),
    "mcap schema of another type": ("mcap-plain", lambda d: d.replace(b"float64 x", b"float32 x"), "damaged"),
    "mcap json": (
        "mcap-plain",
        lambda d: d.replace(b"\x03\x00\x00\x00cdr", b"\x03\x00\x00\x00xml"),
        "encoded as 'xml'",
    ),
    "ros2 mcap cut": ("ros2-mcap", cut(0.6), "unfinished"),
    "ros2 zstd file flipped": ("ros2-sqlite3-file", flip(1), "damaged"),
    "ros2 zstd file cut": ("ros2-sqlite3-file", cut(0.5), "damaged"),
    "csv cut in a row": ("csv", cut(0.501), "row 20: has .* cells|is no number"),
    "csv cut in its header": ("csv", lambda data: data[:10], "no column"),
    "csv binary in it": ("csv", flip(3000, 0x80), "damaged"),
    "parquet cut": ("parquet", cut(0.5), "damaged"),
    "parquet flip in its footer": ("parquet", flip(-6), "damaged"),
    "lerobot cut": ("lerobot-v2.1", cut(0.5), "episode_000000.parquet: is damaged"),
    "lerobot pointer": ("lerobot-v3.0", lambda d: b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
    "ros2 pointer": ("ros2-mcap", lambda d: b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
    "ros2 empty file": ("ros2-sqlite3", lambda d: b"", "is empty"),
}


def check_sentence(error: DataError, folder: Path) -> None:
    said = str(error)
    assert "\n" not in said
    assert str(folder) not in said
    assert len(said) < 500
    assert said.endswith((".", "`")), said
    assert "Traceback" not in said


@pytest.mark.parametrize("name", CASES)
def test_damage_is_told_in_one_sentence(tmp_path: Path, name: str) -> None:
    container, damage, message = CASES[name]
    path = writers.write(tmp_path, container, "pose", writers.two_arms(COUNT))
    read(path, container)
    file = largest(path)
    file.write_bytes(bytes(damage(bytearray(file.read_bytes()))))
    with pytest.raises(DataError, match=message) as caught:
        read(path, container)
    check_sentence(caught.value, tmp_path)
    assert caught.value.source.startswith((path.name, file.name, file.name.removesuffix(".zstd")))


METADATA = {
    "not yaml": ("", "{{{", "metadata.yaml is damaged"),
    "empty": (None, "", "metadata.yaml is damaged"),
    "no storage": ("storage_identifier", "storage", "metadata.yaml is damaged"),
    "unknown storage": ("storage_identifier: sqlite3", "storage_identifier: rocksdb", "is stored as 'rocksdb'"),
    "of the future": ("version: 9", "version: 99", "is of version 99; versions up to 9 are read"),
    "file not there": ("- recording.db3", "- other.db3", "names other.db3, not there"),
    "wrong serialization": ("serialization_format: cdr", "serialization_format: protobuf", "encoded as 'protobuf'"),
    "unknown compression": (
        "compression_format: ''\n  compression_mode: ''",
        "compression_format: lzma\n  compression_mode: file",
        "is compressed by 'lzma'",
    ),
}


@pytest.mark.parametrize("name", METADATA)
def test_damaged_metadata_is_told_in_one_sentence(tmp_path: Path, name: str) -> None:
    old, new, message = METADATA[name]
    path = writers.write(tmp_path, "ros2-sqlite3", "pose", writers.two_arms(5))
    file = path / "metadata.yaml"
    text = file.read_text()
    assert not old or old in text
    file.write_text("" if old is None else text.replace(old, new) if old else new)
    with pytest.raises(DataError, match=message) as caught:
        read(path, "ros2-sqlite3")
    check_sentence(caught.value, tmp_path)


@pytest.mark.parametrize(("old", "new"), [(b"float64[7] joints", b"float~4[7] joints"), (b"uint8 mode", b"uint64 mo")])
def test_a_damaged_definition_is_told(tmp_path: Path, old: bytes, new: bytes) -> None:
    path = writers.write(tmp_path, "ros1", "nested", writers.two_arms(5))
    path.write_bytes(path.read_bytes().replace(old, new.ljust(len(old), b" ")))
    pose = Request(topic="/two_arms/state", extract=lambda m: (m.left.pose.position.x,), width=1)
    with open_recording(path) as recording, pytest.raises(DataError, match="the definition of its type") as caught:
        recording.read([pose])
    check_sentence(caught.value, tmp_path)


def test_a_damaged_definition_of_a_standard_type_is_not_needed(tmp_path: Path) -> None:
    path = writers.write(tmp_path, "ros1", "pose", writers.two_arms(5))
    path.write_bytes(path.read_bytes().replace(b"float64 x", b"float64 q"))
    samples, _ = read(path, "ros1")
    np.testing.assert_array_equal(samples.values, writers.two_arms(5).position["left"])


@functools.cache
def written(container: str) -> tuple[str, dict[str, bytes], Samples]:
    """Name, files and numbers of an undamaged recording."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = writers.write(Path(folder), container, "pose", writers.two_arms(COUNT))
        files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
        contents = {str(file.relative_to(folder)): file.read_bytes() for file in files}
        return str(path.relative_to(folder)), contents, read(path, container)[0]


@st.composite
def damages(draw: st.DrawFn) -> tuple[str, float, list[tuple[float, int]], float]:
    """Which file, where it is flipped, and where it is cut (1: not at all)."""
    container = draw(st.sampled_from([*writers.CONTAINERS, *writers.TABLES]))
    which = draw(st.floats(0, 1, exclude_max=True))
    flips = draw(st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), max_size=4))
    end = draw(st.one_of(st.just(1.0), st.floats(0, 1)))
    return container, which, flips, end


def same(left: Samples, right: Samples) -> bool:
    stamps = (left.stamp is None) == (right.stamp is None)
    return (
        stamps
        and (left.stamp is None or np.array_equal(left.stamp, right.stamp))
        and np.array_equal(left.log_time, right.log_time)
        and np.array_equal(left.values, right.values)
    )


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@example(("mcap", 0.0, [(0.5, 3)], 1.0), False)
@example(("mcap", 0.0, [], 0.7), True)
@given(damages(), st.booleans())
def test_random_damage_gives_numbers_or_one_sentence(
    tmp_path_factory: pytest.TempPathFactory,
    damage: tuple[str, float, list[tuple[float, int]], float],
    recover: bool,
) -> None:
    container, which, flips, end = damage
    name, contents, expected = written(container)
    folder = tmp_path_factory.mktemp("damaged")
    chosen = sorted(contents)[int(which * len(contents))]
    for file, content in contents.items():
        data = bytearray(content)
        if file == chosen:
            for place, bit in flips:
                data[int(place * len(data))] ^= 1 << bit
            data = data[: int(end * len(data))] if end < 1.0 else data
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(data)
    began = time.monotonic()
    try:
        samples, integrity = read(folder / name, container, recover=recover)
    except DataError as error:
        check_sentence(error, folder)
    else:
        assert samples.values.shape == (len(samples.log_time), 3)
        assert not integrity.protected or same(samples, expected)
        if not flips and container == "mcap":
            assert same(samples, expected) or integrity.lost
    assert time.monotonic() - began < LONGEST


@settings(max_examples=200)
@given(st.lists(st.tuples(st.integers(0, 2**31), st.integers(0, 7)), min_size=1, max_size=8))
def test_no_flip_in_a_protected_recording_changes_its_numbers(
    tmp_path_factory: pytest.TempPathFactory, flips: list[tuple[int, int]]
) -> None:
    name, contents, expected = written("mcap")
    data = bytearray(contents[name])
    for place, bit in flips:
        data[place % len(data)] ^= 1 << bit
    path = tmp_path_factory.mktemp("flipped") / name
    path.write_bytes(data)
    try:
        samples, _ = read(path, "mcap")
    except DataError:
        return
    assert same(samples, expected)
