"""MCAP by the core reader: profiles, encodings, checksums, and what is recovered of an unfinished file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import recording_writers as writers
from mcap.writer import Writer
from recording_writers import Arms
from rosbags.typesys import Stores, get_types_from_idl, get_typestore

from pipeline.errors import DataError
from stages.ingest.readers.formats import open_recording
from stages.ingest.recording import Recording, Request, Samples


def position(message: object) -> tuple[float, float, float]:
    p = message.pose.position
    return p.x, p.y, p.z


REQUESTS = [Request(topic=f"/{side}/pose", extract=position, width=3) for side in writers.SIDES]


def read(recording: Recording) -> list[Samples]:
    return recording.read(REQUESTS)


@pytest.fixture(scope="module")
def arms() -> Arms:
    return writers.two_arms(300)


@pytest.mark.parametrize(
    ("container", "protected", "note"),
    [
        ("mcap", True, "Checksums of its chunks and its index protect it."),
        ("mcap-ros1", True, "Checksums"),
        ("mcap-other-profile", True, "Checksums"),
        ("mcap-plain", False, "chunks carry no checksum"),
        ("mcap-unchunked", False, "outside chunks"),
        ("mcap-unindexed", False, "without an index"),
    ],
)
def test_every_kind_gives_what_was_written(
    tmp_path: Path, container: str, protected: bool, note: str, arms: Arms
) -> None:
    with open_recording(writers.write(tmp_path, container, "pose", arms)) as recording:
        for side, found in zip(writers.SIDES, read(recording), strict=True):
            np.testing.assert_array_equal(found.values, arms.position[side])
            np.testing.assert_array_equal(found.log_time, arms.log)
            np.testing.assert_array_equal(found.stamp, arms.stamp)
        integrity = recording.integrity()
        (left, _) = recording.topics()
    assert (left.count, left.first, left.last) == (300, arms.log[0], arms.log[-1])
    assert left.type == "geometry_msgs/msg/PoseStamped"
    assert integrity.protected == protected
    assert note in integrity.note
    assert integrity.lost == ""


def test_rosbags_own_mcap_is_said_to_be_unprotected(tmp_path: Path, arms: Arms) -> None:
    bag = writers.write(tmp_path, "ros2-mcap", "pose", arms)
    for path in (bag, next(bag.glob("*.mcap"))):
        with open_recording(path) as recording:
            assert "rosbags writes such files" in recording.integrity().note
            np.testing.assert_array_equal(read(recording)[0].values, arms.position["left"])


def test_schemas_without_text_use_the_standard_types(tmp_path: Path, arms: Arms) -> None:
    path = writers.write_mcap(tmp_path / "bare.mcap", lambda b: writers.LAYOUTS["pose"](b, arms), definitions=False)
    with open_recording(path) as recording:
        np.testing.assert_array_equal(read(recording)[1].values, arms.position["right"])


def test_definitions_in_idl(tmp_path: Path) -> None:
    text = "module my_msgs { module msg { struct Spot { double x; double y; double z; }; }; };"
    name = "my_msgs/msg/Spot"
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_idl(text))
    path = tmp_path / "idl.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "tests")
        schema = writer.register_schema(name, "ros2idl", f"{'=' * 80}\nIDL: {name}\n{text}".encode())
        channel = writer.register_channel("/spot", "cdr", schema)
        writer.add_message(channel, 7, bytes(types.serialize_cdr(types.types[name](x=1.0, y=2.0, z=3.0), name)), 7)
        writer.finish()
    with open_recording(path) as recording:
        (found,) = recording.read([Request(topic="/spot", extract=lambda m: (m.x, m.y, m.z), width=3)])
        assert recording.topics()[0].fields == ("x", "y", "z")
    assert found.values.tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize(
    ("encoding", "schema", "word"), [("json", "jsonschema", "JSON"), ("protobuf", "protobuf", "protobuf")]
)
def test_json_and_protobuf_are_refused_by_topic(tmp_path: Path, encoding: str, schema: str, word: str) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "tests")
        channel = writer.register_channel("/left/pose", encoding, writer.register_schema("Pose", schema, b"{}"))
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with open_recording(path) as recording:
        (topic,) = recording.topics()
        assert word in topic.problem
        assert "record them as ROS messages" in topic.problem
        with pytest.raises(DataError, match=f"other.mcap, topic /left/pose: cannot be decoded: .*{word}"):
            recording.read(REQUESTS[:1])


def unfinished(tmp_path: Path, arms: Arms, part: float) -> Path:
    path = writers.write(tmp_path, "mcap", "pose", arms)
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    return path


def test_an_unfinished_file_offers_to_recover(tmp_path: Path, arms: Arms) -> None:
    with pytest.raises(
        DataError, match=r"recording.mcap: is unfinished: .* `--recover` reads the chunks that are whole"
    ):
        open_recording(unfinished(tmp_path, arms, 0.6))


@pytest.mark.parametrize("part", [0.3, 0.6, 0.9])
def test_whole_chunks_are_recovered_and_the_loss_is_said(tmp_path: Path, arms: Arms, part: float) -> None:
    path = unfinished(tmp_path, arms, part)
    with open_recording(path, recover=True) as recording:
        left, right = read(recording)
        integrity = recording.integrity()
        counts = {topic.name: topic.count for topic in recording.topics()}
    kept = len(left.values)
    assert part * 300 - 150 < kept < part * 300 + 60
    assert abs(kept - len(right.values)) <= 1
    np.testing.assert_array_equal(left.values, arms.position["left"][:kept])
    assert counts == {"/left/pose": kept, "/right/pose": len(right.values)}
    assert integrity.lost.startswith("Lost: the last ")
    assert f"recovered: {kept + len(right.values)} messages" in integrity.lost
    assert not integrity.protected


def test_a_damaged_chunk_is_left_out_and_counted(tmp_path: Path, arms: Arms) -> None:
    path = writers.write(tmp_path, "mcap", "pose", arms)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with open_recording(path) as recording, pytest.raises(DataError, match=r"recording.mcap: is damaged .*--recover"):
        read(recording)
    with open_recording(path, recover=True) as recording:
        left, _ = read(recording)
        assert recording.integrity().lost.startswith("Lost: 1 damaged record beside ")
    assert 150 < len(left.values) < 300


def test_a_whole_file_loses_nothing_when_recovered(tmp_path: Path, arms: Arms) -> None:
    with open_recording(writers.write(tmp_path, "mcap", "pose", arms), recover=True) as recording:
        assert len(read(recording)[0].values) == 300
        assert recording.integrity().lost == ""


def test_a_damaged_first_chunk_does_not_cost_the_channels_it_defined(tmp_path: Path, arms: Arms) -> None:
    path = writers.write(tmp_path, "mcap", "pose", arms)
    content = bytearray(path.read_bytes())
    content[content.index(b"zstd") + 40] ^= 255
    path.write_bytes(content)
    with open_recording(path, recover=True) as recording:
        left, _ = read(recording)
    assert 150 < len(left.values) < 300


def test_chunks_without_a_selected_topic_are_not_read(tmp_path: Path, arms: Arms) -> None:
    def messages(builder: writers.Builder):
        yield from writers.LAYOUTS["pose"](builder, arms)
        for k in range(200):
            yield (
                "/other",
                "std_msgs/msg/String",
                int(arms.log[-1]) + k,
                builder.make("std_msgs/msg/String", data="x" * 400),
            )

    path = writers.write_mcap(tmp_path / "two.mcap", messages, compression="none", chunk=4096)
    content = bytearray(path.read_bytes())
    content[content.rindex(b"x" * 300)] = 7
    path.write_bytes(content)
    with open_recording(path) as recording:
        assert len(read(recording)[0].values) == 300
        with pytest.raises(DataError, match="crc validation failed"):
            recording.clocks()
