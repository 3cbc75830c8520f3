"""One log of a roll-out as others read it: rerun, rosbags with the types of ROS 2, and the reader of MCAP itself."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from rerun.chunk import McapReader, RrdReader
from rerun.urdf import UrdfTree
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from pipeline.values import canonical
from stages.artifacts.carry_log import write_carry_log, write_demonstration
from stages.artifacts.log import read_log
from stages.policy.outcome import Outcome
from stages.world.description import both, faces

N = 12
PARAMETERS = {"kind": "bullet", "following": {"deviation_threshold": 0.006}}


@pytest.fixture(scope="module")
def one() -> SimpleNamespace:
    """Both arms move away from where they rest, and the pads are where their joints put them."""
    arms, time = both("iiwa", "robot"), np.arange(N) / 50.0
    q = np.array([one.posture for one in arms]) + 0.02 * np.arange(N)[:, None, None]
    pads, ones = faces(arms, q)[0], np.ones(N)
    middle = pads.mean(axis=1)
    carried = SimpleNamespace(
        q=q,
        qdot=np.ones((N, 2, 7)),
        pads=pads,
        commanded=pads,
        box=middle,
        turn=np.tile([0.0, 0.0, 0.0, 1.0], (N, 1)),
        force=np.column_stack([5.0 * ones, 6.0 * ones]),
        contact=np.column_stack([5.1 * ones, 6.1 * ones]),
        desired=5.5 * ones,
        residual=np.zeros((N, 2)),
        clearance=np.inf * ones,
        box_room=np.inf * ones,
        arm_room=np.inf * ones,
        phase=np.zeros(N, dtype=np.int8),
        named=np.full(N, -1, dtype=np.int8),
        acting=np.zeros((N, 2), dtype=bool),
    )
    return SimpleNamespace(
        carried=carried,
        time=time,
        x=middle,
        p_hat=middle + 0.001,
        gate=ones > 0,
        lyapunov=np.linspace(1.0, 0.0, N),
        rollout="clpvds-robust/held/0",
        outcome=Outcome.ARRIVED,
        scene_facts={"mass": 0.4, "following": True},
    )


@pytest.fixture(scope="module")
def path(one: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "one.mcap"
    write_carry_log(path, one, "iiwa", PARAMETERS)
    return path


@pytest.fixture(scope="module")
def chunks(path: Path) -> list[Any]:
    """What rerun makes of it."""
    file = path.with_suffix(".rrd")
    McapReader(path).stream().write_rrd(file, application_id="clpv", recording_id="one")
    return list(RrdReader(file).stream())


def columns(chunks: list[Any], entity: str, component: str) -> list[Any]:
    """All rows of a component that change with time."""
    batches = [c.to_record_batch() for c in chunks if c.entity_path == entity and not c.is_static]
    return [row for batch in batches if component in batch.schema.names for row in batch[component].to_pylist()]


def test_rerun_places_every_frame(chunks: list[Any], path: Path) -> None:
    log: Any = read_log(path)
    for topic in ("/tf", "/tf_static"):
        channel = log[topic]
        child, parent, place = (
            columns(chunks, topic, f"Transform3D:{name}") for name in ("child_frame", "parent_frame", "translation")
        )
        assert child == [[name] for name in channel.children] * channel.time.size
        assert parent == [[name] for name in channel.parents] * channel.time.size
        assert np.array(place).reshape(-1, 3) == pytest.approx(channel.position.reshape(-1, 3), abs=1e-6)
        turns = np.array(columns(chunks, topic, "Transform3D:quaternion")).reshape(-1, 4)
        assert turns == pytest.approx(channel.quaternion.reshape(-1, 4), abs=1e-6)


def test_rerun_hangs_the_description_on_these_frames(chunks: list[Any], path: Path, tmp_path: Path) -> None:
    """Shapes below the robot's name, each in the frame of its link, which /tf and /tf_static place."""
    log: Any = read_log(path)
    frames = {"world", *log["/tf"].children, *log["/tf_static"].children}
    seen = {}
    for chunk in chunks:
        found = re.fullmatch(r"/two_iiwa/visual_geometries/(\w+)/visual_\d", chunk.entity_path)
        batch = chunk.to_record_batch()
        if found and "CoordinateFrame:frame" in batch.schema.names:
            seen[chunk.entity_path] = (found[1], batch["CoordinateFrame:frame"].to_pylist()[0][0])
    assert {link for link, _ in seen.values()} >= {"left_clpv_pad", "right_lbr_iiwa_link_7"}
    for link, frame in seen.values():
        assert frame == link
        assert frame in frames
    (tmp_path / "two.urdf").write_text(log["/robot_description"].values[0])
    joints = {joint.name for joint in UrdfTree.from_file_path(tmp_path / "two.urdf").joints()}
    assert set(log["/joint_states"].names) < joints


def test_rerun_draws_poses_and_numbers(chunks: list[Any], one: SimpleNamespace) -> None:
    for topic, position in (
        ("/left/pose", one.carried.pads[:, 0]),
        ("/box/pose", one.carried.box),
        ("/midpoint", one.carried.box),
        ("/policy/x", one.x),
        ("/policy/p_hat", one.p_hat),
        ("/right/commanded", one.carried.commanded[:, 1]),
    ):
        found = np.array(columns(chunks, topic, "InstancePoses3D:translations")).reshape(-1, 3)
        assert found == pytest.approx(position, abs=1e-6)
        assert columns(chunks, topic, "CoordinateFrame:frame") == [["world"]] * N
    assert columns(chunks, "/forces", "Scalars:scalars") == [[5.0, 6.0, 5.5]] * N
    assert columns(chunks, "/truth/contacts", "Scalars:scalars") == [[5.1, 6.1]] * N
    assert columns(chunks, "/policy/deviations", "Scalars:scalars") == [[0.0, 0.0, 0.006]] * N
    assert columns(chunks, "/policy/lyapunov", "Scalars:scalars") == [[v] for v in one.lyapunov.tolist()]
    joints = columns(chunks, "/joint_states/position", "Scalars:scalars")
    assert joints == one.carried.q.reshape(N, 14).tolist()


def test_every_topic_arrives_in_rerun(chunks: list[Any], path: Path) -> None:
    schema = RrdReader(path.with_suffix(".rrd")).store().schema()
    entities = {column.entity_path for column in schema.component_columns()}
    assert entities >= set(read_log(path))


def test_rosbags_reads_every_message(path: Path, one: SimpleNamespace) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    log = read_log(path)
    counts = dict.fromkeys(log, 0)
    with AnyReader([path], default_typestore=store) as reader:
        for connection, time, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            k = counts[connection.topic]
            counts[connection.topic] += 1
            if connection.topic == "/tf":
                last = message.transforms[-1]
                assert (last.header.frame_id, last.child_frame_id) == ("world", "p_hat")
                assert last.transform.translation.x == one.p_hat[k, 0]
                assert all(t.header.stamp.nanosec == time for t in message.transforms)
            elif connection.topic == "/forces":
                (dimension,) = message.layout.dim
                assert (dimension.label, dimension.size) == ("left, right, desired", 3)
                assert message.data.tolist() == [5.0, 6.0, 5.5]
            elif connection.topic == "/joint_states":
                assert message.position.tolist() == one.carried.q[k].ravel().tolist()
                assert message.name[7] == "right_lbr_iiwa_joint_1"
    assert counts == {topic: channel.time.size for topic, channel in log.items()}


def test_the_core_reader_finds_messages_parameters_and_facts(path: Path) -> None:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        (attached,), (facts,) = list(reader.iter_attachments()), list(reader.iter_metadata())
        messages = [channel.topic for _, channel, _ in reader.iter_messages()]
    assert attached.data == canonical(PARAMETERS).encode()
    assert json.loads(facts.metadata["facts"]) == {"mass": 0.4, "following": True}
    assert messages[:3] == ["/robot_description", "/tf_static", "/tf"]  # before all others of their time
    with path.open("rb") as stream:
        assert sum(1 for _ in NonSeekingReader(stream, validate_crcs=True).iter_messages()) == len(messages)


@pytest.fixture(scope="module")
def demonstration(one: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same motion, demonstrated."""
    path = tmp_path_factory.mktemp("demonstration") / "demo1.mcap"
    done = SimpleNamespace(
        time=one.time,
        phase=np.zeros(N, dtype=np.int8),
        joints=one.carried.q,
        pads=one.carried.pads,
        force=one.carried.force,
        box=one.carried.box,
        turn=one.carried.turn,
        master=one.x,
        handle=one.carried.turn,
        clutch=np.ones(N, dtype=bool),
    )
    write_demonstration(path, done, 0, 0, "iiwa", PARAMETERS)
    return path


@pytest.mark.parametrize("kind", ["path", "demonstration"])
def test_every_frame_hangs_on_the_world(kind: str, request: pytest.FixtureRequest) -> None:
    """Viewers draw nothing at all where one frame of a message is nowhere."""
    log: Any = read_log(request.getfixturevalue(kind))
    parents = {}
    for topic in ("/tf", "/tf_static"):
        parents |= dict(zip(log[topic].children, log[topic].parents, strict=True))
    used = {channel.frame for channel in log.values() if hasattr(channel, "frame")}
    assert used >= {"world", "left_pad", "right_pad"}
    for name in (*used, *parents):
        frame, steps = name, 0
        while frame != "world":
            frame, steps = parents[frame], steps + 1
            assert steps <= len(parents), f"{name} hangs on itself"


def test_a_demonstration_is_read_by_rerun_rosbags_and_the_core_reader(demonstration: Path) -> None:
    file = demonstration.with_suffix(".rrd")
    McapReader(demonstration).stream().write_rrd(file, application_id="clpv", recording_id="demo")
    entities = {column.entity_path for column in RrdReader(file).store().schema().component_columns()}
    assert entities >= set(read_log(demonstration))
    with AnyReader([demonstration], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        found = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()]
    with demonstration.open("rb") as stream:
        reading = make_reader(stream, validate_crcs=True)
        (attached,) = list(reading.iter_attachments())
        assert len(found) == sum(1 for _ in reading.iter_messages())
    assert attached.name == "parameters.json"
