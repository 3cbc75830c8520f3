"""ROS 1 and ROS 2 bags: every container and layout gives the numbers that were written, in the order of the file."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
import recording_writers as writers
from recording_writers import Arms, Builder
from rosbags.rosbag1 import Writer

from pipeline.errors import DataError
from stages.ingest.readers.formats import open_recording
from stages.ingest.recording import Recording, Request, Samples


class Pose:
    """Position and orientation at a dotted place of a message."""

    def __init__(self, place: str) -> None:
        self.place = place

    def __call__(self, message: object) -> list[float]:
        value = message
        for step in self.place.split("."):
            value = value[int(step)] if step.isdigit() else getattr(value, step)
        p, q = value.position, value.orientation
        return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


class Hand:
    """The transform of one child in a TFMessage, with its own stamp."""

    def __init__(self, child: str) -> None:
        self.child, self.found = child, None

    def __call__(self, message: object) -> list[float] | None:
        for transform in message.transforms:
            if transform.child_frame_id == self.child:
                self.found = transform
                t, r = transform.transform.translation, transform.transform.rotation
                return [t.x, t.y, t.z, r.x, r.y, r.z, r.w]
        return None

    def stamp(self, message: object) -> tuple[int, int]:
        return self.found.header.stamp.sec, self.found.header.stamp.nanosec


POSES = {
    "pose": [("/left/pose", Pose("pose")), ("/right/pose", Pose("pose"))],
    "endpoint": [
        ("/robot/limb/left/endpoint_state", Pose("pose")),
        ("/robot/limb/right/endpoint_state", Pose("pose")),
    ],
    "odometry": [("/left_arm/odom", Pose("pose.pose")), ("/right_arm/odom", Pose("pose.pose"))],
    "nested": [("/two_arms/state", Pose("left.pose")), ("/two_arms/state", Pose("arms.1.pose"))],
    "tf": [("/tf", Hand("left_hand")), ("/tf", Hand("right_hand"))],
}


def read(recording: Recording, layout: str) -> list[Samples]:
    requests = [Request(topic=topic, extract=extract, width=7) for topic, extract in POSES[layout]]
    return recording.read(requests)


def check(samples: list[Samples], arms: Arms) -> None:
    for side, found in zip(writers.SIDES, samples, strict=True):
        expected = np.hstack([arms.position[side], arms.quaternion[side]])
        np.testing.assert_array_equal(found.values, expected)
        np.testing.assert_array_equal(found.log_time, arms.log)
        assert found.stamp is not None
        np.testing.assert_array_equal(found.stamp, arms.stamp)


@pytest.fixture(scope="module")
def arms() -> Arms:
    return writers.two_arms(60)


@pytest.mark.parametrize("layout", POSES)
@pytest.mark.parametrize("container", ["ros1", "ros2-sqlite3", "ros2-mcap"])
def test_every_layout_gives_what_was_written(tmp_path: Path, container: str, layout: str, arms: Arms) -> None:
    with open_recording(writers.write(tmp_path, container, layout, arms)) as recording:
        check(read(recording, layout), arms)


@pytest.mark.parametrize(
    ("container", "name"),
    [
        ("ros1-bz2", "ROS 1 bag"),
        ("ros1-lz4", "ROS 1 bag"),
        ("ros1-legacy", "ROS 1 bag"),
        ("ros2-sqlite3-message", "ROS 2 bag (SQLite)"),
        ("ros2-sqlite3-file", "ROS 2 bag (SQLite)"),
        ("ros2-mcap-storage", "ROS 2 bag (MCAP)"),
        ("db3", "ROS 2 recording (SQLite)"),
    ],
)
def test_every_container_gives_what_was_written(tmp_path: Path, container: str, name: str, arms: Arms) -> None:
    with open_recording(writers.write(tmp_path, container, "nested", arms)) as recording:
        assert recording.format == name
        assert recording.episodes() == [""]
        check(read(recording, "nested"), arms)
        assert not recording.integrity().protected


def test_topics_are_sorted_and_list_their_numbers(tmp_path: Path, arms: Arms) -> None:
    with open_recording(writers.write(tmp_path, "ros1", "nested", arms)) as recording:
        (topic,) = recording.topics()
    assert (topic.type, topic.count, topic.problem) == ("two_arms_msgs/msg/TwoArms", 60, "")
    assert (topic.first, topic.last) == (arms.log[0], arms.log[-1])
    assert topic.fields[0] == "mode"
    assert {"arms[].pose.position.x", "left.joints[7]", "right.extra[]", "left.wrench.force.z"} <= set(topic.fields)
    assert not any("header" in field for field in topic.fields)
    with open_recording(writers.write(tmp_path, "ros2-mcap", "with-wrench", arms)) as recording:
        names = [topic.name for topic in recording.topics()]
    assert names == ["/left/pose", "/left/wrench", "/right/pose", "/right/wrench"]


@pytest.mark.parametrize("container", ["ros1", "ros2-sqlite3", "db3", "ros2-mcap", "mcap"])
def test_a_clock_that_was_set_back_stays_in_the_order_of_the_file(tmp_path: Path, container: str, arms: Arms) -> None:
    jumping = writers.jumping_back(arms, 30, 0.2, stamps=False)
    with open_recording(writers.write(tmp_path, container, "pose", jumping)) as recording:
        samples = read(recording, "pose")
        clocks = recording.clocks()
    check(samples, jumping)
    assert (np.diff(samples[0].log_time) < 0).sum() == 1
    np.testing.assert_array_equal(clocks["/left/pose"][0], jumping.log)
    np.testing.assert_array_equal(clocks["/left/pose"][1], jumping.stamp)


def test_headerless_messages_have_no_stamps(tmp_path: Path, arms: Arms) -> None:
    with open_recording(writers.write(tmp_path, "ros1", "xyz", arms)) as recording:
        request = Request(topic="/tracker/left", extract=lambda m: (m.x, m.y, m.z), width=3)
        (found,) = recording.read([request])
        clocks = recording.clocks()
    assert found.stamp is None
    assert clocks["/tracker/left"][1] is None
    np.testing.assert_array_equal(found.values, arms.position["left"])


def test_a_header_that_is_not_the_first_field_gives_the_stamp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(writers.CUSTOM, "late_msgs/msg/Late", "float64 x\nstd_msgs/Header header\n")

    def messages(builder: Builder):
        for k in range(5):
            header = builder.header(writers.START + k)
            yield "/late", "late_msgs/msg/Late", 10 + k, builder.make("late_msgs/msg/Late", x=float(k), header=header)

    for path in (
        writers.write_ros1(tmp_path / "late.bag", messages),
        writers.write_ros2(tmp_path / "late", messages),
    ):
        with open_recording(path) as recording:
            (found,) = recording.read([Request(topic="/late", extract=lambda m: (m.x,), width=1)])
            clocks = recording.clocks()
        expected = writers.START + np.arange(5)
        np.testing.assert_array_equal(found.stamp, expected)
        np.testing.assert_array_equal(clocks["/late"][1], expected)


def test_databases_without_definitions_use_the_standard_types(tmp_path: Path, arms: Arms) -> None:
    path = writers.write_ros2(tmp_path / "foxy", lambda b: writers.LAYOUTS["pose"](b, arms), definitions=False)
    with open_recording(path) as recording:
        check(read(recording, "pose"), arms)
    path = writers.write_ros2(tmp_path / "custom", lambda b: writers.LAYOUTS["nested"](b, arms), definitions=False)
    with open_recording(path) as recording:
        (topic,) = recording.topics()
        assert "two_arms_msgs/msg/TwoArms is neither defined in the recording nor a standard one" in topic.problem
        with pytest.raises(DataError, match="cannot be decoded: its type two_arms_msgs"):
            read(recording, "nested")


def test_a_wrong_definition_gives_way_to_the_standard_type_that_the_digest_names(tmp_path: Path, arms: Arms) -> None:
    path = writers.write(tmp_path, "db3", "pose", arms)
    with sqlite3.connect(path) as database:
        database.execute("UPDATE message_definitions SET encoded_message_definition = 'float64 other'")
    database.close()
    with open_recording(path) as recording:
        check(read(recording, "pose"), arms)


def test_several_files_of_one_bag_are_read_one_after_the_other(tmp_path: Path, arms: Arms) -> None:
    bag = writers.write(tmp_path, "ros2-sqlite3", "pose", arms)
    first = bag / "recording.db3"
    second = bag / "recording_1.db3"
    second.write_bytes(first.read_bytes())
    for file, condition in ((first, "timestamp > ?"), (second, "timestamp <= ?")):
        with sqlite3.connect(file) as database:
            database.execute(f"DELETE FROM messages WHERE {condition}", [int(arms.log[29])])
        database.close()
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    assert "- recording.db3" in text
    metadata.write_text(text.replace("- recording.db3", "- recording.db3\n  - recording_1.db3", 1))
    with open_recording(bag) as recording:
        check(read(recording, "pose"), arms)
        assert {topic.name: topic.count for topic in recording.topics()} == {"/left/pose": 60, "/right/pose": 60}


def test_names_that_sqlite_would_misread_are_opened(tmp_path: Path, arms: Arms) -> None:
    path = writers.write(tmp_path, "db3", "pose", arms)
    strange = path.rename(tmp_path / "run #3? 50%20 left.db3")
    with open_recording(strange) as recording:
        check(read(recording, "pose"), arms)


def test_messages_in_a_write_ahead_log_are_not_passed_over_in_silence(tmp_path: Path, arms: Arms) -> None:
    path = writers.write(tmp_path, "db3", "pose", arms)
    path.with_name(f"{path.name}-wal").write_bytes(b"frames")
    with open_recording(path) as recording:
        assert "recording.db3-wal beside it holds messages" in recording.integrity().lost


def test_a_topic_of_two_publishers_is_one_topic(tmp_path: Path) -> None:
    builder = Builder(1)
    name = "geometry_msgs/msg/Point"
    path = tmp_path / "two.bag"
    with Writer(path) as writer:
        first, second = (
            writer.add_connection("/point", name, typestore=builder.types, callerid=caller) for caller in ("/a", "/b")
        )
        for k in range(10):
            point = builder.make(name, x=float(k), y=0.0, z=0.0)
            writer.write(second if k % 2 else first, k, builder.serialize(point, name))
    with open_recording(path) as recording:
        (topic,) = recording.topics()
        (found,) = recording.read([Request(topic="/point", extract=lambda m: (m.x,), width=1)])
        (sampled,) = recording.read([Request(topic="/point", extract=lambda m: (m.x,), width=1, every=5)])
    assert topic.count == 10
    np.testing.assert_array_equal(found.values[:, 0], np.arange(10))
    assert len(sampled.values) == 2


def test_wrong_topics_fields_and_widths_are_named(tmp_path: Path, arms: Arms) -> None:
    with open_recording(writers.write(tmp_path, "ros1", "pose", arms)) as recording:
        with pytest.raises(DataError, match=r"recording.bag: holds no topic /left/pos: did you mean '/left/pose'"):
            recording.read([Request(topic="/left/pos", extract=Pose("pose"), width=7)])
        with pytest.raises(DataError, match=r"topic /left/pose: message 1 does not hold what is selected"):
            recording.read([Request(topic="/left/pose", extract=Pose("left.pose"), width=7)])
        with pytest.raises(DataError, match="7 numbers instead of 3"):
            recording.read([Request(topic="/left/pose", extract=Pose("pose"), width=3)])
        with pytest.raises(DataError, match="holds no episodes"):
            recording.read([], "7")


def test_two_requests_of_one_topic_and_none_at_all(tmp_path: Path, arms: Arms) -> None:
    with open_recording(writers.write(tmp_path, "ros1", "pose", arms)) as recording:
        request = Request(topic="/left/pose", extract=Pose("pose"), width=7)
        first, second = recording.read([request, request])
        np.testing.assert_array_equal(first.values, second.values)
        assert recording.read([]) == []
        (nothing,) = recording.read([Request(topic="/left/pose", extract=lambda message: None, width=2)])
        assert nothing.values.shape == (0, 2)
