"""What `clpv info` says: topics, clocks, and the line to copy or why there is none."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
import recording_writers as writers
from recording_writers import Builder

from pipeline.errors import DataError
from stages.ingest.recording import ClockHealth
from stages.inspect.bag_info import describe, describe_or_refuse, lines
from stages.inspect.candidates import side
from stages.inspect.clock_health import disorder, health, rate

MS = 1_000_000


def ns(*milliseconds: int) -> np.ndarray:
    return np.array(milliseconds, dtype=np.int64) * MS


@pytest.fixture(scope="module")
def arms() -> writers.Arms:
    return writers.two_arms(60)


EXPECTED = {
    "pose": ("/left/pose", "/right/pose"),
    "endpoint": ("/robot/limb/left/endpoint_state", "/robot/limb/right/endpoint_state"),
    "odometry": ("/left_arm/odom", "/right_arm/odom"),
    "transform": ("/vicon/left_hand", "/vicon/right_hand"),
    "point": ("/left/tip", "/right/tip"),
    "xyz": ("/tracker/left", "/tracker/right"),
    "nested": ("/two_arms/state:left.pose", "/two_arms/state:right.pose"),
    "tf": ("/tf:base->left_hand", "/tf:base->right_hand"),
}


@pytest.mark.parametrize("layout", EXPECTED)
@pytest.mark.parametrize("container", ["ros1", "mcap"])
def test_the_line_selects_both_hands(tmp_path: Path, container: str, layout: str, arms: writers.Arms) -> None:
    path = writers.write(tmp_path, container, layout, arms)
    found = describe(path)
    words = shlex.split(found["command"])
    left, right = EXPECTED[layout]
    assert words[:8] == ["clpv", "ingest", "recording", str(path), "--left", left, "--right", right]
    assert found["reason"].startswith("By their names")
    json.dumps(found)


@pytest.mark.parametrize(
    ("container", "left", "right"),
    [
        ("csv", "left_", "right_"),
        ("parquet", "left_", "right_"),
        (
            "lerobot-v2.1",
            "observation.state:left_x,left_y,left_z",
            "observation.state:right_x,right_y,right_z",
        ),
    ],
)
def test_the_line_selects_columns(tmp_path: Path, container: str, left: str, right: str, arms: writers.Arms) -> None:
    path = writers.write(tmp_path, container, "", arms)
    words = shlex.split(describe(path)["command"])
    assert words[4:] == ["--left", left, "--right", right]


def test_wrenches_are_selected_with_the_poses(tmp_path: Path, arms: writers.Arms) -> None:
    words = shlex.split(describe(writers.write(tmp_path, "ros2-mcap", "with-wrench", arms))["command"])
    assert words[8:] == ["--left-wrench", "/left/wrench", "--right-wrench", "/right/wrench"]
    words = shlex.split(describe(writers.write(tmp_path, "ros1", "nested", arms))["command"])
    assert words[9::2] == ["/two_arms/state:left.wrench.force", "/two_arms/state:right.wrench.force"]


def test_lists_without_names_have_to_be_selected(tmp_path: Path, arms: writers.Arms) -> None:
    found = describe(writers.write(tmp_path, "parquet-lists", "", arms))
    assert found["command"] == ""
    assert "--left 'left_pose[0:3]'" in found["reason"]


def test_a_description_holds_what_the_file_holds(tmp_path: Path, arms: writers.Arms) -> None:
    path = writers.write(tmp_path, "mcap", "pose", arms)
    found = describe(path)
    assert found["file"] == "recording.mcap"
    assert found["format"] == "MCAP"
    assert found["bytes"] == path.stat().st_size
    assert (found["messages"], found["episodes"], found["protected"], found["lost"]) == (120, 1, True, "")
    assert found["start"] == arms.log[0]
    assert found["duration"] == pytest.approx(0.59)
    left = found["topics"][0]
    assert (left["name"], left["count"], left["problem"]) == ("/left/pose", 60, "")
    assert left["hz"] == pytest.approx(100.0)
    assert left["clock"]["of"] == "header"
    assert left["clock"]["offset"] == pytest.approx(0.002)
    assert left["looks_like"][0].startswith("left end effector, moves 0.")
    rows = lines(found)
    assert [row["topic"] for row in rows] == ["/left/pose", "/right/pose"]
    assert rows[0]["clock"] == "header: sane"
    assert rows[0]["Hz"] == 100.0


def test_a_clock_set_back_is_counted_and_told(tmp_path: Path, arms: writers.Arms) -> None:
    jumping = writers.jumping_back(arms, 30, 0.2, stamps=False)
    found = describe(writers.write(tmp_path, "ros1", "pose", jumping))
    clock = found["topics"][0]["clock"]
    assert (clock["backward"], clock["log_backward"], clock["opposite"]) == (0, 1, 1)
    assert any("/left/pose: header stamps and log times disagree in their order 1 times" in n for n in found["notes"])
    assert "log 1 back" in lines(found)[0]["clock"]


def test_clock_health_counts() -> None:
    log = ns(1, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120)
    stamp = ns(0, 10, 20, 20, 30, 25, 35, 45, 55, 155, 165, 175, 185)
    assert health(log, stamp) == ClockHealth(zero=1, backward=1, duplicate=1, gaps=1, longest_gap=0.1, offset=0.001)
    assert health(log - log[0], log - log[0]).zero == 0  # the log's own clock begins there
    assert health(log, log - 5 * MS).offset == pytest.approx(0.005)
    assert health(log, None) == ClockHealth()
    assert health(ns(0, 10, 20, 0, 10, 20), None, resets=1).backward == 0
    assert health(ns(), None) == ClockHealth()
    assert health(ns(), ns()) == ClockHealth()


def test_bursts_are_no_gaps() -> None:
    burst = np.sort(np.concatenate([ns(*range(0, 1000, 10)), ns(*range(0, 1000, 10)) + 1000]))
    assert health(burst, None).gaps == 0
    assert health(np.delete(burst, slice(40, 80)), None).gaps == 1


def test_rate_and_disorder() -> None:
    assert rate(ns(0, 10, 20, 40)) == pytest.approx(100.0)
    assert rate(ns(5)) is None
    assert rate(ns(5, 5)) is None
    assert disorder(ns(0, 1, 2, 3), ns(0, 1, 0, 1)) == 1
    assert disorder(ns(0, 1, 2), None) == 0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/left/pose", "left"),
        ("/ft/l_gripper_motor", "left"),
        ("/arm_r/ee", "right"),
        ("/tf:base->right_hand", "right"),
        ("/camera/color", ""),
        ("/left_to_right", ""),
        ("/LeftArm/pose", "left"),
    ],
)
def test_sides_are_told_by_names(text: str, expected: str) -> None:
    assert side(text) == expected


def still(layout: str):
    def messages(builder: Builder):
        arms = writers.two_arms(20)
        for values in (*arms.position.values(), *arms.quaternion.values()):
            values[:] = values[0]
        return writers.LAYOUTS[layout](builder, arms)

    return messages


def test_what_does_not_move_is_not_offered(tmp_path: Path) -> None:
    found = describe(writers.write_ros1(tmp_path / "still.bag", still("pose")))
    assert found["command"] == ""
    assert found["reason"] == "It holds poses, but none of them moves: there is no motion to learn."


def test_joint_states_are_offered_with_a_urdf(tmp_path: Path) -> None:
    seconds = np.arange(20) / 10
    arm = {"left_s0": np.sin(seconds), "right_s0": np.cos(seconds)}
    path = writers.write_ros1(tmp_path / "2024 joints.bag", writers.joint_states(seconds, arm))
    words = shlex.split(describe(path)["command"])
    assert words == [
        *("clpv", "ingest", "bag-2024-joints", str(path), "--urdf", "ROBOT.urdf"),
        *("--left", "/joint_states:fk(LEFT_LINK)", "--right", "/joint_states:fk(RIGHT_LINK)"),
    ]
    wheels = {"fl_caster_joint": seconds, "left_s0": np.zeros(20)}
    path = writers.write_ros1(tmp_path / "wheels.bag", writers.joint_states(seconds, wheels))
    found = describe(path)
    assert found["command"] == ""
    assert "no joint of an arm moves (only fl_caster_joint and the like)" in found["reason"]


def test_baxters_joint_recorder_is_offered_with_its_grippers(tmp_path: Path) -> None:
    names = [f"{side}_{joint}" for side in writers.SIDES for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
    path = writers.write_joints_csv(tmp_path / "b.csv", np.arange(5) / 10, {name: np.arange(5.0) for name in names})
    assert "--left 'table:fk(left_gripper)' --right 'table:fk(right_gripper)'" in describe(path)["command"]


def one_topic(topic: str, name: str, make):
    def messages(builder: Builder):
        for k in range(10):
            yield topic, name, writers.START + k * MS, make(builder, k)

    return messages


def test_other_recordings_get_a_reason(tmp_path: Path, arms: writers.Arms) -> None:
    text = one_topic("/chatter", "std_msgs/msg/String", lambda b, k: b.make("std_msgs/msg/String", data="x"))
    found = describe(writers.write_ros1(tmp_path / "text.bag", text))
    assert found["reason"] == "It holds no pose and no joint positions of an arm, only std_msgs/msg/String."
    found = describe(writers.write_ros1(tmp_path / "none.bag", lambda builder: iter(())))
    assert found["reason"].startswith("It holds no messages")
    assert (found["duration"], found["start"], found["topics"]) == (None, None, [])
    path = writers.write_ros2(tmp_path / "xml", text, serialization="xml")
    found = describe(path)
    assert found["reason"].startswith("None of its topics can be decoded: /chatter: its messages are encoded as 'xml'")
    assert lines(found)[0]["looks like"].startswith("its messages are encoded as 'xml'")


def test_a_single_moving_point_is_offered_as_one(tmp_path: Path) -> None:
    name = "geometry_msgs/msg/Point"
    point = one_topic("/ball", name, lambda b, k: b.make(name, x=float(k), y=0.0, z=100.0 * k))
    found = describe(writers.write_ros1(tmp_path / "ball.bag", point))
    assert shlex.split(found["command"])[4:] == ["--point", "/ball", "--scale", "0.001"]
    assert found["notes"] == ["/ball moves 900 m: if it is in millimetres, set the scale to 0.001."]


def test_a_second_pose_that_was_only_commanded_is_not_preferred(tmp_path: Path, arms: writers.Arms) -> None:
    def messages(builder: Builder):
        for topic, name, log, message in writers.LAYOUTS["pose"](builder, arms):
            yield f"/command{topic}", name, log, message
            yield topic, name, log, message

    words = shlex.split(describe(writers.write_ros1(tmp_path / "a.bag", messages))["command"])
    assert words[5::2] == ["/left/pose", "/right/pose"]


def test_episodes_are_counted_and_their_starts_are_no_steps_back(tmp_path: Path) -> None:
    episodes = [writers.two_arms(20, seed=k, rate=50) for k in range(3)]
    found = describe(writers.write_lerobot(tmp_path / "set", episodes, version="v3.0"))
    assert found["episodes"] == 3
    assert found["topics"][0]["clock"]["backward"] == 0
    assert found["format"] == "LeRobot v3.0"


def test_what_was_lost_is_told_and_refusals_are_plain(tmp_path: Path, arms: writers.Arms) -> None:
    path = writers.write(tmp_path, "mcap", "pose", writers.two_arms(400))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataError, match="--recover"):
        describe(path)
    assert describe(path, recover=True)["lost"].startswith("Lost: the last ")
    refused = describe_or_refuse(path)
    assert refused["file"] == "recording.mcap"
    assert "--recover" in refused["error"]
