"""The same two-arm demonstration in every format, written by the formats' own writers. For tests only.

`write(folder, container, layout, arms)` writes it and gives the path; `SELECTIONS[layout]` says how the two arms are
selected. Numbers and stamps are exact in every format: times are whole milliseconds, values are 64-bit floats.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

START = 1_700_000_000_000_000_000
"""Nanoseconds: when the recordings begin."""

SIDES = ("left", "right")

CUSTOM = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "two_arms_msgs/msg/ArmState": (
        "string name\ngeometry_msgs/Pose pose\ngeometry_msgs/Wrench wrench\nfloat64[7] joints\nfloat64[] extra\n"
    ),
    "two_arms_msgs/msg/TwoArms": (
        "std_msgs/Header header\nuint8 mode\ntwo_arms_msgs/ArmState[] arms\n"
        "two_arms_msgs/ArmState left\ntwo_arms_msgs/ArmState right\n"
    ),
    "baxter_core_msgs/msg/EndpointState": (
        "std_msgs/Header header\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\ngeometry_msgs/Wrench wrench\n"
    ),
    "tracker_msgs/msg/Position": ("float64 x\nfloat64 y\nfloat64 z\nfloat64 roll\nfloat64 pitch\nfloat64 yaw\n"),
}
"""Messages that no standard set of types has."""


@dataclass(frozen=True, kw_only=True)
class Arms:
    """Two arms on one clock: `stamp` and `log`, shape (n,), ns; the others, shape (n, 3) and (n, 4), x y z w."""

    stamp: np.ndarray
    log: np.ndarray
    position: dict[str, np.ndarray]
    quaternion: dict[str, np.ndarray]
    force: dict[str, np.ndarray]

    @property
    def seconds(self) -> np.ndarray:
        return (self.stamp - self.stamp[0]) / 1e9


def two_arms(count: int = 200, *, seed: int = 0, rate: int = 100, delay: int = 2_000_000) -> Arms:
    """A reach of two arms that carry a rod: minimum jerk, about half a metre in `count` / `rate` seconds."""
    generator = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, count)
    reach = 10 * s**3 - 15 * s**4 + 6 * s**5
    goal = np.array([0.5, 0.2, 0.3]) + 0.02 * generator.standard_normal(3)
    bow = np.column_stack([np.zeros(count), 0.1 * np.sin(np.pi * s), 0.05 * np.sin(2 * np.pi * s)])
    middle = np.array([0.3, 0.0, 0.1]) + reach[:, None] * goal + bow
    half = np.array([0.0, 0.2, 0.0])
    angle = 0.3 * reach
    turned = np.column_stack([np.zeros((count, 2)), np.sin(angle / 2), np.cos(angle / 2)])
    stamp = START + np.arange(count, dtype=np.int64) * (1_000_000_000 // rate)
    return Arms(
        stamp=stamp,
        log=stamp + delay,
        position={"left": middle + half, "right": middle - half},
        quaternion={"left": turned, "right": turned * np.array([1.0, 1.0, -1.0, 1.0])},
        force={side: np.column_stack([reach, -reach, 2.0 + s]) * sign for side, sign in (("left", 1), ("right", -1))},
    )


def store(ros: int) -> Typestore:
    """Standard and custom types of ROS 1 or ROS 2."""
    types = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_JAZZY)
    for name, text in CUSTOM.items():
        types.register(get_types_from_msg(text, name))
    return types


class Builder:
    """Messages of one ROS version out of plain numbers."""

    def __init__(self, ros: int) -> None:
        self.ros = ros
        self.types = store(ros)
        self.count = 0

    def make(self, kind: str, /, **fields: Any) -> Any:
        return self.types.types[kind](**fields)

    def header(self, stamp: int, frame: str = "base") -> Any:
        self.count += 1
        time = self.make("builtin_interfaces/msg/Time", sec=int(stamp // 10**9), nanosec=int(stamp % 10**9))
        extra = {"seq": self.count} if self.ros == 1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **extra)

    def numbers(self, name: str, names: str, values: Any) -> Any:
        return self.make(name, **{key: float(value) for key, value in zip(names, values, strict=True)})

    def vector(self, values: Any) -> Any:
        return self.numbers("geometry_msgs/msg/Vector3", "xyz", values)

    def pose(self, position: Any, quaternion: Any) -> Any:
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.numbers("geometry_msgs/msg/Point", "xyz", position),
            orientation=self.numbers("geometry_msgs/msg/Quaternion", "xyzw", quaternion),
        )

    def wrench(self, force: Any) -> Any:
        return self.make("geometry_msgs/msg/Wrench", force=self.vector(force), torque=self.vector((0.1, 0.2, 0.3)))

    def transform(self, stamp: int, frame: str, child: str, position: Any, quaternion: Any) -> Any:
        return self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp, frame),
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.vector(position),
                rotation=self.numbers("geometry_msgs/msg/Quaternion", "xyzw", quaternion),
            ),
        )

    def serialize(self, message: Any, name: str) -> bytes:
        serialize = self.types.serialize_ros1 if self.ros == 1 else self.types.serialize_cdr
        return bytes(serialize(message, name))


Message = tuple[str, str, int, Any]
"""Topic, type, log time in nanoseconds, message."""


def _posed(name: str, topic: str, build: Callable[[Builder, Arms, str, int], Any]) -> Callable[..., Iterator[Message]]:
    """A layout of one topic an arm."""

    def layout(builder: Builder, arms: Arms) -> Iterator[Message]:
        for k, log in enumerate(arms.log):
            for side in SIDES:
                yield topic.format(side), name, int(log), build(builder, arms, side, k)

    return layout


def _pose(b: Builder, arms: Arms, side: str, k: int) -> Any:
    return b.pose(arms.position[side][k], arms.quaternion[side][k])


def _pose_stamped(b: Builder, arms: Arms, side: str, k: int) -> Any:
    return b.make("geometry_msgs/msg/PoseStamped", header=b.header(int(arms.stamp[k])), pose=_pose(b, arms, side, k))


def _endpoint(b: Builder, arms: Arms, side: str, k: int) -> Any:
    twist = b.make("geometry_msgs/msg/Twist", linear=b.vector((1.0, 2.0, 3.0)), angular=b.vector((0.0, 0.0, 0.0)))
    return b.make(
        "baxter_core_msgs/msg/EndpointState",
        header=b.header(int(arms.stamp[k])),
        pose=_pose(b, arms, side, k),
        twist=twist,
        wrench=b.wrench(arms.force[side][k]),
    )


def _odometry(b: Builder, arms: Arms, side: str, k: int) -> Any:
    twist = b.make("geometry_msgs/msg/Twist", linear=b.vector((1.0, 2.0, 3.0)), angular=b.vector((0.0, 0.0, 0.0)))
    return b.make(
        "nav_msgs/msg/Odometry",
        header=b.header(int(arms.stamp[k])),
        child_frame_id=f"{side}_hand",
        pose=b.make("geometry_msgs/msg/PoseWithCovariance", pose=_pose(b, arms, side, k), covariance=np.zeros(36)),
        twist=b.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def _transform(b: Builder, arms: Arms, side: str, k: int) -> Any:
    return b.transform(int(arms.stamp[k]), "base", f"{side}_hand", arms.position[side][k], arms.quaternion[side][k])


def _point(b: Builder, arms: Arms, side: str, k: int) -> Any:
    return b.make(
        "geometry_msgs/msg/PointStamped",
        header=b.header(int(arms.stamp[k])),
        point=b.numbers("geometry_msgs/msg/Point", "xyz", arms.position[side][k]),
    )


def _xyz(b: Builder, arms: Arms, side: str, k: int) -> Any:
    x, y, z = (float(value) for value in arms.position[side][k])
    return b.make("tracker_msgs/msg/Position", x=x, y=y, z=z, roll=0.1, pitch=0.2, yaw=0.3)


def _array(b: Builder, arms: Arms, side: str, k: int) -> Any:
    layout = b.make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    data = np.concatenate([arms.position[side][k], arms.quaternion[side][k]])
    return b.make("std_msgs/msg/Float64MultiArray", layout=layout, data=data)


def _nested(builder: Builder, arms: Arms) -> Iterator[Message]:
    """Both arms in one custom message, as fields of their own and as elements of an array."""
    for k, log in enumerate(arms.log):
        states = {
            side: builder.make(
                "two_arms_msgs/msg/ArmState",
                name=side,
                pose=_pose(builder, arms, side, k),
                wrench=builder.wrench(arms.force[side][k]),
                joints=np.arange(7.0),
                extra=np.arange(k % 4, dtype=np.float64),
            )
            for side in SIDES
        }
        message = builder.make(
            "two_arms_msgs/msg/TwoArms",
            header=builder.header(int(arms.stamp[k])),
            mode=1,
            arms=list(states.values()),
            **states,
        )
        yield "/two_arms/state", "two_arms_msgs/msg/TwoArms", int(log), message


def _tf(builder: Builder, arms: Arms) -> Iterator[Message]:
    """Both hands and a wheel in /tf, the hands in one message or each in its own, in turn."""
    name = "tf2_msgs/msg/TFMessage"
    for k, log in enumerate(arms.log):
        left, right = (_transform(builder, arms, side, k) for side in SIDES)
        wheel = builder.transform(int(arms.stamp[k]), "odom", "wheel", (k, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        groups = [[wheel, left, right]] if k % 2 else [[left], [wheel], [right]]
        for group in groups:
            yield "/tf", name, int(log), builder.make(name, transforms=group)


LAYOUTS: dict[str, Callable[[Builder, Arms], Iterator[Message]]] = {
    "pose": _posed("geometry_msgs/msg/PoseStamped", "/{}/pose", _pose_stamped),
    "endpoint": _posed("baxter_core_msgs/msg/EndpointState", "/robot/limb/{}/endpoint_state", _endpoint),
    "odometry": _posed("nav_msgs/msg/Odometry", "/{}_arm/odom", _odometry),
    "transform": _posed("geometry_msgs/msg/TransformStamped", "/vicon/{}_hand", _transform),
    "point": _posed("geometry_msgs/msg/PointStamped", "/{}/tip", _point),
    "xyz": _posed("tracker_msgs/msg/Position", "/tracker/{}", _xyz),
    "array": _posed("std_msgs/msg/Float64MultiArray", "/{}_ee", _array),
    "nested": _nested,
    "tf": _tf,
}
"""How two arms lie in messages. ``xyz`` and ``array`` carry no header: their clock is the log time."""

SELECTIONS: dict[str, tuple[str, str]] = {
    "pose": ("/left/pose", "/right/pose"),
    "endpoint": ("/robot/limb/left/endpoint_state", "/robot/limb/right/endpoint_state"),
    "odometry": ("/left_arm/odom", "/right_arm/odom"),
    "transform": ("/vicon/left_hand", "/vicon/right_hand"),
    "point": ("/left/tip", "/right/tip"),
    "xyz": ("/tracker/left", "/tracker/right"),
    "array": ("/left_ee:data[0:7]", "/right_ee:data[0:7]"),
    "nested": ("/two_arms/state:left.pose", "/two_arms/state:arms[1].pose"),
    "tf": ("/tf:base->left_hand", "/tf:base->right_hand"),
    "csv": ("left_", "right_"),
    "parquet": ("left_", "right_"),
    "parquet-lists": ("left_pose[0:7]", "right_pose[0:7]"),
    "lerobot": ("observation.state[0:3]", "observation.state[3:6]"),
}
"""Layout -> the selections of the left and the right arm."""

WRENCHES: dict[str, tuple[str, str]] = {
    "endpoint": ("/robot/limb/left/endpoint_state:wrench.force", "/robot/limb/right/endpoint_state:wrench.force"),
    "nested": ("/two_arms/state:left.wrench.force", "/two_arms/state:right.wrench.force"),
    "with-wrench": ("/left/wrench", "/right/wrench"),
}


def with_wrench(builder: Builder, arms: Arms) -> Iterator[Message]:
    """Stamped poses, and a stamped wrench of each arm."""
    name = "geometry_msgs/msg/WrenchStamped"
    for message in LAYOUTS["pose"](builder, arms):
        yield message
        k = int(np.searchsorted(arms.log, message[2]))
        side = "left" if "left" in message[0] else "right"
        wrench = builder.make(
            name, header=builder.header(int(arms.stamp[k])), wrench=builder.wrench(arms.force[side][k])
        )
        yield f"/{side}/wrench", name, message[2], wrench


LAYOUTS["with-wrench"] = with_wrench
SELECTIONS["with-wrench"] = SELECTIONS["pose"]


def write_ros1(
    path: Path,
    messages: Callable[[Builder], Iterator[Message]],
    *,
    compression: str = "",
    chunk: int = 16_384,
    legacy: bool = False,
) -> Path:
    """A ROS 1 bag; `legacy` names the header's type as ROS did before 2011: ``roslib/Header``."""
    builder = Builder(1)
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    writer.chunk_threshold = chunk
    with writer:
        connections: dict[str, Any] = {}
        for topic, name, log, message in messages(builder):
            if topic not in connections:
                definition, digest = builder.types.generate_msgdef(name, ros_version=1)
                if legacy:
                    definition = definition.replace("std_msgs/Header", "roslib/Header")
                connections[topic] = writer.add_connection(topic, name, msgdef=definition, md5sum=digest)
            writer.write(connections[topic], log, builder.serialize(message, name))
    return path


def write_ros2(
    path: Path,
    messages: Callable[[Builder], Iterator[Message]],
    *,
    storage: str = "sqlite3",
    compression: str = "",
    serialization: str = "cdr",
    definitions: bool = True,
) -> Path:
    """A ROS 2 bag, a folder; `compression` is ``file``, ``message`` or ``storage``."""
    builder = Builder(2)
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if compression:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, name, log, message in messages(builder):
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, name, typestore=builder.types, serialization_format=serialization
                )
            writer.write(connections[topic], log, builder.serialize(message, name))
    if not definitions and storage == "sqlite3":
        _drop_definitions(next(path.glob("*.db3")))
    return path


def _drop_definitions(path: Path) -> None:
    """Make a database of today one of ROS 2 Foxy: no table of definitions."""
    import sqlite3

    with sqlite3.connect(path) as connection:
        connection.execute("DROP TABLE message_definitions")
        connection.execute("DROP TABLE schema")
        connection.execute("DROP TABLE metadata")
        connection.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
    connection.close()


def write_mcap(
    path: Path,
    messages: Callable[[Builder], Iterator[Message]],
    *,
    ros: int = 2,
    profile: str | None = None,
    compression: str = "zstd",
    crcs: bool = True,
    chunked: bool = True,
    indexed: bool = True,
    chunk: int = 16_384,
    definitions: bool = True,
) -> Path:
    """An MCAP file by the core writer, as the project writes its own logs."""
    builder = Builder(ros)
    with path.open("wb") as stream:
        writer = McapWriter(
            stream,
            chunk_size=chunk,
            compression=CompressionType[compression.upper()],
            enable_crcs=crcs,
            use_chunking=chunked,
            index_types=IndexType.ALL if indexed else IndexType.NONE,
            use_statistics=indexed,
            repeat_channels=indexed,
            repeat_schemas=indexed,
            use_summary_offsets=indexed,
        )
        writer.start(profile if profile is not None else f"ros{ros}", "clpv tests")
        channels: dict[str, int] = {}
        for topic, name, log, message in messages(builder):
            if topic not in channels:
                text = builder.types.generate_msgdef(name, ros_version=ros)[0] if definitions else ""
                plain = name.replace("/msg/", "/") if ros == 1 else name
                schema = writer.register_schema(plain, f"ros{ros}msg", text.encode())
                channels[topic] = writer.register_channel(topic, "ros1" if ros == 1 else "cdr", schema)
            writer.add_message(channels[topic], log, builder.serialize(message, name), log)
        writer.finish()
    return path


def columns_of(arms: Arms) -> dict[str, np.ndarray]:
    """Named columns of both arms: ``left_x`` … ``left_qw``, then the right arm's."""
    columns = {}
    for side in SIDES:
        names = [f"{side}_{axis}" for axis in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        values = np.hstack([arms.position[side], arms.quaternion[side]])
        columns.update(zip(names, values.T, strict=True))
    return columns


def write_csv(path: Path, arms: Arms, *, time: str = "time", nanoseconds: bool = False, delimiter: str = ",") -> Path:
    """Named columns; times in seconds with all nine decimals, or as whole nanoseconds."""
    columns = columns_of(arms)
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream, delimiter=delimiter)
        writer.writerow([time, *columns])
        for k, stamp in enumerate(arms.stamp):
            seconds = f"{stamp // 10**9}.{stamp % 10**9:09d}"
            row = [repr(float(values[k])) for values in columns.values()]
            writer.writerow([str(stamp) if nanoseconds else seconds, *row])
    return path


def write_parquet(path: Path, arms: Arms, *, lists: bool = False, time: str = "timestamp") -> Path:
    """Named columns, or one column of lists an arm; times in whole nanoseconds."""
    columns: dict[str, Any] = {time: pa.array(arms.stamp)}
    if lists:
        for side in SIDES:
            poses = np.hstack([arms.position[side], arms.quaternion[side]])
            columns[f"{side}_pose"] = pa.array(poses.tolist(), pa.list_(pa.float64()))
    else:
        columns.update({name: pa.array(values) for name, values in columns_of(arms).items()})
    pq.write_table(pa.table(columns), path)
    return path


LEROBOT_NAMES = ["left_x", "left_y", "left_z", "right_x", "right_y", "right_z"]


def write_lerobot(path: Path, episodes: list[Arms], *, version: str = "v2.1") -> Path:
    """A LeRobot folder with both arms' positions in ``observation.state``; the clock is frame_index / fps."""
    fps = round(1e9 / float(np.median(np.diff(episodes[0].stamp))))
    tables = []
    for index, arms in enumerate(episodes):
        state = np.hstack([arms.position[side] for side in SIDES])
        frames = np.arange(len(state))
        tables.append(
            pa.table(
                {
                    "observation.state": pa.array(state.tolist(), pa.list_(pa.float64(), 6)),
                    "timestamp": pa.array((frames / fps).astype(np.float32)),
                    "frame_index": pa.array(frames),
                    "episode_index": pa.array(np.full(len(state), index)),
                }
            )
        )
    (path / "meta").mkdir(parents=True)
    folder = path / "data" / "chunk-000"
    folder.mkdir(parents=True)
    if version == "v2.1":
        for index, table in enumerate(tables):
            pq.write_table(table, folder / f"episode_{index:06d}.parquet")
        lines = [{"episode_index": k, "tasks": ["carry"], "length": len(t)} for k, t in enumerate(tables)]
        (path / "meta" / "episodes.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
        data_path = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    else:
        pq.write_table(pa.concat_tables(tables), folder / "file-000.parquet")
        data_path = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    info = {
        "codebase_version": version,
        "robot_type": "two arms",
        "total_episodes": len(tables),
        "total_frames": sum(len(table) for table in tables),
        "fps": fps,
        "data_path": data_path,
        "features": {
            "observation.state": {"dtype": "float64", "shape": [6], "names": LEROBOT_NAMES},
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        },
    }
    (path / "meta" / "info.json").write_text(json.dumps(info))
    return path


def write_joints_csv(path: Path, seconds: np.ndarray, joints: dict[str, np.ndarray]) -> Path:
    """A file of Baxter's joint_recorder: ``time,left_s0,…,left_gripper,…``; seconds from the start, radians."""
    with path.open("w", newline="") as stream:
        stream.write(",".join(["time", *joints]) + "\n")
        for k, second in enumerate(seconds):
            stream.write(",".join([f"{second:.9f}", *(repr(float(values[k])) for values in joints.values())]) + "\n")
    return path


def joint_states(seconds: np.ndarray, joints: dict[str, np.ndarray]) -> Callable[[Builder], Iterator[Message]]:
    """The same joints as JointState messages on /joint_states."""
    name = "sensor_msgs/msg/JointState"

    def messages(builder: Builder) -> Iterator[Message]:
        for k, second in enumerate(seconds):
            stamp = START + round(float(second) * 1e9)
            message = builder.make(
                name,
                header=builder.header(stamp),
                name=list(joints),
                position=np.array([values[k] for values in joints.values()]),
                velocity=np.zeros(0),
                effort=np.zeros(0),
            )
            yield "/joint_states", name, stamp, message

    return messages


CONTAINERS = (
    "ros1",
    "ros1-bz2",
    "ros1-lz4",
    "ros1-legacy",
    "ros2-sqlite3",
    "ros2-sqlite3-message",
    "ros2-sqlite3-file",
    "ros2-mcap",
    "ros2-mcap-storage",
    "db3",
    "mcap",
    "mcap-ros1",
    "mcap-other-profile",
    "mcap-plain",
    "mcap-unchunked",
    "mcap-unindexed",
)
"""Formats of messages; any layout fits in any of them."""

TABLES = ("csv", "csv-nanoseconds", "parquet", "parquet-lists", "lerobot-v2.1", "lerobot-v3.0")
"""Formats of rows; layouts do not apply. See SELECTIONS for csv, parquet, parquet-lists and lerobot."""


def write(folder: Path, container: str, layout: str, arms: Arms, name: str = "recording") -> Path:
    """Write `arms` in one of CONTAINERS or TABLES below `folder` and give the path to open."""
    folder.mkdir(parents=True, exist_ok=True)
    kind, _, option = container.partition("-")
    if container in TABLES:
        if kind == "csv":
            return write_csv(folder / f"{name}.csv", arms, nanoseconds=bool(option))
        if kind == "parquet":
            return write_parquet(folder / f"{name}.parquet", arms, lists=bool(option))
        return write_lerobot(folder / name, [arms], version=option)

    def messages(builder: Builder) -> Iterator[Message]:
        return LAYOUTS[layout](builder, arms)

    if kind == "ros1":
        legacy = option == "legacy"
        return write_ros1(folder / f"{name}.bag", messages, compression="" if legacy else option, legacy=legacy)
    if kind == "ros2":
        storage, _, compression = option.partition("-")
        return write_ros2(folder / name, messages, storage=storage, compression=compression)
    if kind == "db3":
        return next(write_ros2(folder / name, messages).glob("*.db3"))
    options: dict[str, dict[str, Any]] = {
        "": {},
        "ros1": {"ros": 1},
        "other-profile": {"profile": "px4"},
        "plain": {"compression": "none", "crcs": False},
        "unchunked": {"chunked": False},
        "unindexed": {"indexed": False},
    }
    return write_mcap(folder / f"{name}.mcap", messages, **options[option])


def jumping_back(arms: Arms, at: int, seconds: float, *, stamps: bool = True) -> Arms:
    """The same arms on a clock that is set back by `seconds` at sample `at`."""
    step = np.where(np.arange(len(arms.log)) >= at, round(seconds * 1e9), 0)
    return replace(arms, log=arms.log - step, stamp=arms.stamp - step if stamps else arms.stamp)
