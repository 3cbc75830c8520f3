"""Logs of roll-outs: the bytes of rosbags, columns that come back, one file for equal arrays, and what reads it."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk, ChunkIndex, DataEnd, Footer
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory, QosReliability, QosTime
from rosbags.rosbag2.metadata import dump_qos_v8
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from pipeline.errors import DataError
from stages.artifacts.channels import (
    CHANNELS,
    Channel,
    Flags,
    JointStates,
    Numbers,
    Poses,
    Transforms,
    Words,
    Wrenches,
)
from stages.artifacts.log import (
    KEY,
    LATCHED,
    PARAMETERS,
    definitions,
    library,
    read_details,
    read_log,
    read_parameters,
    write_log,
)
from stages.ingest.parameters import RecordingParameters, Source
from stages.ingest.recordings import read_recordings
from stages.inspect.bag_info import describe

ROOT = Path(__file__).resolve().parents[2]
HUMBLE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = HUMBLE.types


# --- channels, drawn and made ----------------------------------------------------------------------------------------


def numbers(*shape: int) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, shape, elements=st.floats())


@st.composite
def channels(draw: st.DrawFn, kind: type[Channel], topic: str = "/topic") -> Any:
    """Any channel of a kind: nan, infinite and negative zero among its numbers, times that repeat, texts of any length.

    Up to 2^50 ns, 13 days, a float keeps whole nanoseconds.
    """
    time = np.array(sorted(draw(st.lists(st.integers(0, 2**50), max_size=4))), dtype=np.int64) / 1e9
    n, base = time.size, {"topic": topic, "time": time, "latched": draw(st.booleans())}
    if kind is Poses:
        return Poses(**base, frame=draw(st.text()), position=draw(numbers(n, 3)), quaternion=draw(numbers(n, 4)))
    if kind is Wrenches:
        return Wrenches(**base, frame=draw(st.text()), force=draw(numbers(n, 3)), torque=draw(numbers(n, 3)))
    if kind is Transforms:
        frames = draw(st.lists(st.tuples(st.text(max_size=6), st.text(max_size=6)), min_size=1, max_size=3))
        parents, children = zip(*frames, strict=True)
        position, quaternion = draw(numbers(n, len(frames), 3)), draw(numbers(n, len(frames), 4))
        return Transforms(**base, parents=parents, children=children, position=position, quaternion=quaternion)
    if kind is JointStates:
        names = draw(st.lists(st.text(max_size=6), min_size=1, max_size=3))
        of_joints = numbers(n, len(names))
        velocity, effort = draw(st.none() | of_joints), draw(st.none() | of_joints)
        return JointStates(**base, names=tuple(names), position=draw(of_joints), velocity=velocity, effort=effort)
    if kind is Numbers:
        names = tuple(draw(st.lists(st.text(max_size=6), min_size=1, max_size=3)))
        return Numbers(**base, names=names, unit=draw(st.sampled_from(["", "m"])), values=draw(numbers(n, len(names))))
    if kind is Flags:
        return Flags(**base, values=draw(arrays(np.bool_, n)))
    return Words(**base, values=tuple(draw(st.lists(st.text(max_size=5), min_size=n, max_size=n))))


KINDS = pytest.mark.parametrize("kind", CHANNELS.values(), ids=lambda kind: kind.__name__)


def carry(n: int = 1500, seed: int = 0) -> list[Channel]:
    """What two arms that carry a box log, 14 topics at 100 Hz: minimum jerk, and noise in every digit."""
    generator = np.random.default_rng(seed)
    time = np.arange(n) * 0.01
    s = np.linspace(0.0, 1.0, n)
    reach = np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, [0.5, 0.2, 0.3])
    turned = np.column_stack([np.zeros((n, 2)), np.sin(0.1 * s), np.cos(0.1 * s)])

    def noisy(path: np.ndarray) -> np.ndarray:
        return path + 1e-5 * generator.standard_normal(path.shape)

    found: list[Channel] = []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        position = noisy(reach + np.array([0.3, 0.2 * sign, 0.1]))
        force, torque = noisy(np.outer(s, [2.0, -5.0 * sign, 9.0])), noisy(np.zeros((n, 3)))
        found += [
            Poses(topic=f"/{side}/pose", frame="world", time=time, position=position, quaternion=turned),
            Wrenches(topic=f"/{side}/wrench", frame="world", time=time, force=force, torque=torque),
            Numbers(topic=f"/{side}/grip", time=time, names=("grip",), unit="N", values=noisy(5.0 + s)[:, None]),
            Flags(topic=f"/{side}/contact", time=time, values=s > 0.2),
        ]
    return [
        *found,
        Poses(topic="/box/pose", frame="world", time=time, position=noisy(reach), quaternion=turned),
        Poses(topic="/x", frame="world", time=time, position=noisy(reach), quaternion=turned),
        Poses(topic="/p_hat", frame="world", time=time, position=noisy(reach), quaternion=turned),
        Numbers(topic="/lyapunov", time=time, names=("V",), unit="m2", values=noisy(np.exp(-s))[:, None]),
        Flags(topic="/gate", time=time, values=s < 0.9),
        Words(topic="/phase", time=time, values=tuple("reach" if k < 0.2 else "carry" for k in s)),
    ]


def point(topic: str = "/x", time: Any = (0.0, 0.01, 0.02), **changes: Any) -> Poses:
    position, turned = np.arange(3.0 * len(time)).reshape(-1, 3), np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1))
    base = {"topic": topic, "frame": "world", "time": time, "position": position, "quaternion": turned}
    return Poses(**{**base, **changes})


def same(a: Channel, b: Channel) -> None:
    """All fields are equal, to the bit."""
    assert type(a) is type(b)
    for field in fields(a):
        left, right = getattr(a, field.name), getattr(b, field.name)
        if isinstance(left, np.ndarray):
            assert (left.dtype, left.shape, left.tobytes()) == (right.dtype, right.shape, right.tobytes())
            assert not right.flags.writeable
        else:
            assert left == right


def written(channel: Any) -> Any:
    """The channel as it comes back: of words, those that change."""
    if not isinstance(channel, Words):
        return channel
    kept = [k for k in range(len(channel.values)) if k == 0 or channel.values[k] != channel.values[k - 1]]
    return replace(channel, time=channel.time[kept], values=tuple(channel.values[k] for k in kept))


def lying(path: Path) -> list[tuple[str, int, int, bytes]]:
    """Topic, log time, publish time and bytes of the messages, as they lie in the file."""
    with path.open("rb") as stream:
        found = NonSeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, m.log_time, m.publish_time, m.data) for _, channel, m in found]


# --- the bytes of rosbags --------------------------------------------------------------------------------------------


def header(time: float, frame: str) -> Any:
    seconds, nanoseconds = divmod(round(time * 1e9), 10**9)
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def xyz(name: str, values: np.ndarray) -> Any:
    return TYPES[f"geometry_msgs/msg/{name}"](**dict(zip("xyzw", values.tolist(), strict=False)))


def pose(c: Poses, k: int) -> Any:
    position, orientation = xyz("Point", c.position[k]), xyz("Quaternion", c.quaternion[k])
    inner = TYPES["geometry_msgs/msg/Pose"](position=position, orientation=orientation)
    return TYPES[c.message](header=header(c.time[k], c.frame), pose=inner)


def wrench(c: Wrenches, k: int) -> Any:
    inner = TYPES["geometry_msgs/msg/Wrench"](force=xyz("Vector3", c.force[k]), torque=xyz("Vector3", c.torque[k]))
    return TYPES[c.message](header=header(c.time[k], c.frame), wrench=inner)


def joints(c: JointStates, k: int) -> Any:
    names = ("position", "velocity", "effort")
    values = {name: np.zeros(0) if getattr(c, name) is None else getattr(c, name)[k] for name in names}
    return TYPES[c.message](header=header(c.time[k], ""), name=list(c.names), **values)


def transforms(c: Transforms, k: int) -> Any:
    found = []
    for j, (parent, child) in enumerate(zip(c.parents, c.children, strict=True)):
        place, turn = xyz("Vector3", c.position[k, j]), xyz("Quaternion", c.quaternion[k, j])
        inner = TYPES["geometry_msgs/msg/Transform"](translation=place, rotation=turn)
        made = TYPES["geometry_msgs/msg/TransformStamped"]
        found.append(made(header=header(c.time[k], parent), child_frame_id=child, transform=inner))
    return TYPES[c.message](transforms=found)


def named_numbers(c: Numbers, k: int) -> Any:
    size = len(c.names)
    dimension = TYPES["std_msgs/msg/MultiArrayDimension"](label=", ".join(c.names), size=size, stride=size)
    layout = TYPES["std_msgs/msg/MultiArrayLayout"](dim=[dimension], data_offset=0)
    return TYPES[c.message](layout=layout, data=c.values[k])


MESSAGES: dict[type[Channel], Callable[[Any, int], Any]] = {
    Poses: pose,
    Wrenches: wrench,
    Transforms: transforms,
    JointStates: joints,
    Numbers: named_numbers,
    Flags: lambda c, k: TYPES[c.message](data=bool(c.values[k])),
    Words: lambda c, k: TYPES[c.message](data=c.values[k]),
}


@KINDS
@given(data=st.data())
def test_messages_have_the_bytes_of_rosbags(kind: type[Channel], data: st.DataObject) -> None:
    channel = written(data.draw(channels(kind)))
    time, messages = channel.encode()
    expected = [MESSAGES[kind](channel, k) for k in range(channel.time.size)]
    assert messages == [bytes(HUMBLE.serialize_cdr(message, channel.message)) for message in expected]
    assert time.tolist() == [round(t * 1e9) for t in channel.time.tolist()]


def test_a_pose_by_hand() -> None:
    channel = Poses(topic="/pose", frame="ab", time=[1.5], position=[[1, 2, 3]], quaternion=[[0, 0, 0, 1]])
    one, two, three = (np.float64(k).tobytes() for k in (1, 2, 3))
    stamp = b"\x01\x00\x00\x00" + (500_000_000).to_bytes(4, "little")
    text = b"\x03\x00\x00\x00ab\x00" + bytes(1)  # 16 bytes after the encapsulation: the doubles begin at once
    assert channel.encode()[1] == [b"\x00\x01\x00\x00" + stamp + text + one + two + three + bytes(24) + one]


def test_numbers_by_hand() -> None:
    channel = Numbers(topic="/forces", time=[0.0], names=("a", "b"), unit="N", values=[[1.0, 2.0]])
    of = [k.to_bytes(4, "little") for k in (1, 5, 2, 2, 0, 2)]  # dimensions, label, size, stride, offset, numbers
    text = of[0] + of[1] + b"a, b\x00" + bytes(3) + b"".join(of[2:])
    assert len(text) == 32  # the doubles begin at once
    assert channel.encode()[1] == [b"\x00\x01\x00\x00" + text + np.array([1.0, 2.0]).tobytes()]
    assert channel.shared() == {"names": ["a", "b"], "unit": "N"}


def test_transforms_by_hand() -> None:
    channel = Transforms(
        topic="/tf",
        time=[1.5],
        parents=("a", "a"),
        children=("b", "c"),
        position=[[[1, 2, 3], [4, 5, 6]]],
        quaternion=[[[0, 0, 0, 1], [1, 0, 0, 0]]],
    )
    stamp = b"\x01\x00\x00\x00" + (500_000_000).to_bytes(4, "little")
    names = b"\x02\x00\x00\x00a\x00\x00\x00\x02\x00\x00\x00%b\x00"
    first = stamp + names % b"b" + bytes(6) + np.array([1.0, 2, 3, 0, 0, 0, 1]).tobytes()
    second = stamp + names % b"c" + bytes(2) + np.array([4.0, 5, 6, 1, 0, 0, 0]).tobytes()
    # 4 + 8 + 14 bytes before the first doubles, which begin at 32; 88 + 8 + 14 before the second ones, at 112.
    assert channel.encode()[1] == [b"\x00\x01\x00\x00\x02\x00\x00\x00" + first + second]


def test_definitions_are_those_of_humble() -> None:
    assert set(definitions()) == {kind.message for kind in MESSAGES}
    for name, text in definitions().items():
        assert text.decode() == HUMBLE.generate_msgdef(name, ros_version=2)[0]


# --- what goes in comes out ------------------------------------------------------------------------------------------


@given(data=st.data())
def test_columns_come_back(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    kinds = data.draw(st.lists(st.sampled_from(list(CHANNELS.values())), max_size=4))
    given_ = [data.draw(channels(kind, f"/topic{k}")) for k, kind in enumerate(kinds)]
    path = tmp_path_factory.mktemp("log") / "log.mcap"
    write_log(path, given_, {})
    found = read_log(path)
    assert list(found) == [channel.topic for channel in given_]
    for channel in given_:
        same(written(channel), found[channel.topic])


def test_times_are_kept_in_whole_nanoseconds(tmp_path: Path) -> None:
    write_log(tmp_path / "log.mcap", [point(time=[0.1 + 2e-10, 1 / 3, 0.5])], {})
    found = read_log(tmp_path / "log.mcap")["/x"].time
    assert found.tolist() == [0.1, 0.333333333, 0.5]


def test_details_come_back(tmp_path: Path) -> None:
    details = {"seed": 3, "box": {"mass": 0.5, "size": [0.2, 0.3]}, "controller": "clpvds", "note": None}
    write_log(tmp_path / "log.mcap", [point()], details)
    assert read_details(tmp_path / "log.mcap") == details
    with (tmp_path / "log.mcap").open("rb") as stream:
        (record,) = make_reader(stream).iter_metadata()
    assert (record.name, list(record.metadata)) == (KEY, ["box", "controller", "note", "seed"])
    assert record.metadata["box"] == '{"mass":0.5,"size":[0.2,0.3]}'


def test_parameters_come_back(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, [point()], {"seed": 3}, {"b": [1, 2.5], "a": {"kind": "bullet"}})
    assert read_parameters(path) == {"a": {"kind": "bullet"}, "b": [1, 2.5]}
    assert read_details(path) == {"seed": 3}
    with path.open("rb") as stream:
        (found,) = make_reader(stream).iter_attachments()
    assert (found.name, found.media_type, found.create_time, found.log_time) == (PARAMETERS, "application/json", 0, 0)
    assert found.data == b'{"a":{"kind":"bullet"},"b":[1,2.5]}'
    write_log(path, [point()], {})
    assert read_parameters(path) is None


def test_what_wrote_a_file(tmp_path: Path) -> None:
    write_log(tmp_path / "log.mcap", [point()], {})
    assert library(tmp_path / "log.mcap") == "clpv"
    assert library(foreign(tmp_path / "other.mcap", "std_msgs/msg/String", {})) != "clpv"
    (tmp_path / "text.mcap").write_text("nothing")
    assert library(tmp_path / "text.mcap") == library(tmp_path / "none.mcap") == ""


def test_words_are_written_where_they_change(tmp_path: Path) -> None:
    words = Words(topic="/phase", time=[0.0, 0.1, 0.2, 0.3, 0.4], values=["reach", "reach", "carry", "carry", "reach"])
    write_log(tmp_path / "log.mcap", [words], {})
    found = read_log(tmp_path / "log.mcap")["/phase"]
    assert isinstance(found, Words)
    assert (found.time.tolist(), found.values) == ([0.0, 0.2, 0.4], ("reach", "carry", "reach"))
    assert len(lying(tmp_path / "log.mcap")) == 3


def test_channels_and_logs_may_be_empty(tmp_path: Path) -> None:
    empty = JointStates(topic="/joints", names=("a", "b"), time=(), position=np.zeros((0, 2)), effort=np.zeros((0, 2)))
    for number, given_ in enumerate([[point(), empty], [empty, point("/y", time=())], []]):
        path = tmp_path / f"{number}.mcap"
        write_log(path, given_, {"seed": 1})
        found = read_log(path)
        assert list(found) == [channel.topic for channel in given_]
        for channel in given_:
            same(channel, found[channel.topic])
        assert read_details(path) == {"seed": 1}
        assert describe(path)["messages"] == len(lying(path)) == sum(channel.time.size for channel in given_)


# --- one file for equal arrays ---------------------------------------------------------------------------------------


def test_two_processes_write_the_same_bytes(tmp_path: Path) -> None:
    write_log(tmp_path / "log.mcap", carry(200), {"b": {"y": 1, "x": 2}, "a": 1})
    text = (
        "import sys; sys.path.insert(0, 'tests/stages'); from pathlib import Path; from test_log import carry\n"
        "from stages.artifacts.log import write_log\n"
        "write_log(Path(sys.argv[1]), carry(200), {'a': 1, 'b': {'x': 2, 'y': 1}})"
    )
    for seed in ("1", "2"):
        command = [sys.executable, "-c", text, str(tmp_path / f"{seed}.mcap")]
        subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, "PYTHONHASHSEED": seed, "TZ": f"UTC-{seed}"})
    digests = {hashlib.sha256(path.read_bytes()).hexdigest() for path in tmp_path.glob("*.mcap")}
    assert len(digests) == 1


def test_no_version_is_named(tmp_path: Path) -> None:
    write_log(tmp_path / "log.mcap", [point()], {})
    with (tmp_path / "log.mcap").open("rb") as stream:
        head = make_reader(stream).get_header()
    assert (head.profile, head.library) == ("ros2", "clpv")


def test_messages_lie_in_order_of_time_and_of_channels(tmp_path: Path) -> None:
    given_ = [
        point("/c", time=[0.0, 0.2, 0.2, 0.4]),
        point("/a", time=[0.1, 0.2, 0.3]),
        Words(topic="/b", time=[0.2, 0.4], values=("reach", "carry")),
    ]
    write_log(tmp_path / "log.mcap", given_, {})
    found = lying(tmp_path / "log.mcap")
    tenths = [("/c", 0), ("/a", 1), ("/c", 2), ("/c", 2), ("/a", 2), ("/b", 2), ("/a", 3), ("/c", 4), ("/b", 4)]
    assert [(topic, log) for topic, log, _, _ in found] == [(topic, 10**8 * time) for topic, time in tenths]
    assert all(log == publish for _, log, publish, _ in found)
    of_c = [data for topic, _, _, data in found if topic == "/c"]
    assert of_c == given_[0].encode()[1]


def test_a_rollout_of_fifteen_seconds_stays_below_a_megabyte(tmp_path: Path) -> None:
    write_log(tmp_path / "log.mcap", carry(), {})
    assert len(lying(tmp_path / "log.mcap")) == 13 * 1500 + 2
    assert (tmp_path / "log.mcap").stat().st_size < 1_000_000


# --- refusals --------------------------------------------------------------------------------------------------------

JOINTS = {"topic": "/x", "time": (0.0,), "names": ("a", "b")}
FAULTS: dict[str, tuple[Channel, str]] = {
    "positions": (point(position=np.zeros((2, 3))), r"its position has shape \(2, 3\) where its 3 times ask for \(3,"),
    "plane": (point(position=np.zeros((3, 2))), r"its position has shape \(3, 2\) where"),
    "velocity": (
        JointStates(**JOINTS, position=np.zeros((1, 2)), velocity=np.zeros((1, 3))),
        r"its velocity has shape \(1, 3\) where its 1 times ask for \(1, 2\)\.",
    ),
    "no numbers": (Numbers(topic="/x", time=(0.0,), names=(), values=np.zeros((1, 0))), "it names no numbers"),
    "numbers": (
        Numbers(topic="/x", time=(0.0,), names=("a", "b"), values=np.zeros((1, 3))),
        r"its values has shape \(1, 3\) where its 1 times ask for \(1, 2\)\.",
    ),
    "no frames": (
        Transforms(topic="/x", time=(), parents=(), children=(), position=np.zeros(0), quaternion=np.zeros(0)),
        r"it names 0 parents for 0 frames\.",
    ),
    "frames": (
        Transforms(topic="/x", time=(), parents=("a",), children=("b", "c"), position=(), quaternion=()),
        r"it names 1 parents for 2 frames\.",
    ),
    "no joints": (JointStates(**{**JOINTS, "names": ()}, position=np.zeros((1, 0))), "it names no joints"),
    "words": (Words(topic="/x", time=(0.0, 1.0), values=("carry",)), r"its values has shape \(1,\) where its 2 times"),
    "flags": (Flags(topic="/x", time=(0.0,), values=np.zeros((1, 1))), r"its values has shape \(1, 1\) where"),
    "clock": (point(time=np.zeros((3, 1))), r"its time has shape \(3, 1\)"),
    "nan": (point(time=[0.0, np.nan, 0.02]), r"its time is not a finite number in row 2\."),
    "infinite": (point(time=[0.0, 0.01, np.inf]), r"its time is not a finite number in row 3\."),
    "back": (point(time=[0.0, 0.02, 0.01]), r"its time goes back from 0\.02 s to 0\.01 s in row 3\."),
    "before": (point(time=[-0.01, 0.0, 0.01]), r"its time runs from -0\.01 s to 0\.01 s; it counts from 0 s"),
    "epoch": (point(time=[0.0, 1.0, 2.0**31]), "its time runs from 0 s to 2.14748365e"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_channels_that_cannot_be_written_are_refused(tmp_path: Path, fault: str) -> None:
    channel, message = FAULTS[fault]
    with pytest.raises(DataError, match=f"^log.mcap, topic /x: {message}"):
        write_log(tmp_path / "log.mcap", [point("/y"), channel], {})
    assert not (tmp_path / "log.mcap").exists()


def test_one_topic_has_one_channel(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"^log.mcap, topic /y: two channels have this topic\.$"):
        write_log(tmp_path / "log.mcap", [point(), point("/y"), point("/y")], {})


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("phase,time\n" * 10)
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "folder.mcap").mkdir()
    for read in (read_log, read_details):
        for name in ("text", "empty"):
            with pytest.raises(DataError, match=f"^{name}.mcap: is no MCAP file, or is damaged"):
                read(tmp_path / f"{name}.mcap")
        with pytest.raises(DataError, match=r"^none.mcap: does not exist\."):
            read(tmp_path / "none.mcap")
        with pytest.raises(DataError, match=r"^folder.mcap: cannot be read: "):
            read(tmp_path / "folder.mcap")


def test_every_flipped_bit_in_the_data_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, carry(100), {"seed": 1})
    content = path.read_bytes()
    with path.open("rb") as stream:
        end = make_reader(stream).get_summary().chunk_indexes[-1]
    data = end.chunk_start_offset + end.chunk_length + end.message_index_length
    for place in np.random.default_rng(0).integers(8, data, 60):
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(place % 8)
        path.write_bytes(damaged)
        for read in (read_log, read_details):
            with pytest.raises(DataError, match=r"^log.mcap: is no MCAP file, or is damaged \(.+\): run the stage ag"):
                read(path)


@pytest.mark.parametrize("part", [0.01, 0.3, 0.8])
def test_a_cut_log_is_refused(tmp_path: Path, part: float) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, carry(100), {})
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    with pytest.raises(DataError, match=r"^log.mcap: is no MCAP file, or is damaged"):
        read_log(path)


def foreign(path: Path, message: str, metadata: dict[str, str], data: bytes = bytes(12)) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "tests")
        schema = writer.register_schema(message, "ros2msg", b"")
        writer.add_message(writer.register_channel("/x", "cdr", schema, metadata), 7, data, 7)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("message", "metadata", "said"),
    [
        ("std_msgs/msg/Float64", {}, "was not written by clpv"),
        (
            "std_msgs/msg/Float64",
            {KEY: "{}"},
            "holds std_msgs/msg/Float64, as another version of clpv wrote it: run the stage again",
        ),
        ("std_msgs/msg/Bool", {}, "was not written by clpv"),
        ("geometry_msgs/msg/PoseStamped", {KEY: "{}"}, r"is damaged \('frame'\): run the stage again"),
        ("geometry_msgs/msg/PoseStamped", {KEY: '{"frame":"world"}'}, r"is damaged \(message 1 has 12 bytes instead"),
        ("std_msgs/msg/String", {KEY: "{}"}, r"is damaged \(message 1 is not a text\)"),
        ("std_msgs/msg/Bool", {KEY: "{}"}, r"is damaged \(message 1 has 12 bytes instead of 5\)"),
    ],
)
def test_logs_of_others_are_refused(tmp_path: Path, message: str, metadata: dict[str, str], said: str) -> None:
    path = foreign(tmp_path / "other.mcap", message, metadata)
    with pytest.raises(DataError, match=f"^other.mcap, topic /x: {said}"):
        read_log(path)
    with pytest.raises(DataError, match=r"^other.mcap: was not written by clpv; `clpv info`"):
        read_details(path)


# --- what else reads it ----------------------------------------------------------------------------------------------


def test_channels_say_what_the_profile_asks_for(tmp_path: Path) -> None:
    """https://mcap.dev/spec/registry, profile ros2."""
    write_log(tmp_path / "log.mcap", [*carry(3), point("/once", time=[0.0], latched=True)], {})
    with (tmp_path / "log.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
        assert channel.metadata["offered_qos_profiles"] == (LATCHED if channel.topic == "/once" else "")
        assert schema.data == definitions()[schema.name]


def test_latched_topics_are_offered_as_humble_writes_them(tmp_path: Path) -> None:
    """Humble reads whole numbers only; rosbags reads them as Jazzy does, and writes the same for bags of Humble."""
    write_log(tmp_path / "log.mcap", [point("/once", time=[0.0], latched=True), point()], {})
    with AnyReader([tmp_path / "log.mcap"], default_typestore=HUMBLE) as reader:
        offered = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
    (once,) = offered["/once"]
    assert offered["/x"] == []
    assert (once.durability, once.reliability) == (QosDurability.TRANSIENT_LOCAL, QosReliability.RELIABLE)
    assert (once.history, once.depth) == (QosHistory.KEEP_LAST, 10)
    forever = QosTime((2**63 - 1) // 10**9, (2**63 - 1) % 10**9)
    assert once.deadline == once.lifespan == once.liveliness_lease_duration == forever
    load = YAML(typ="safe").load
    assert load(LATCHED) == load(dump_qos_v8([once]))


def test_the_core_reader_validates_every_checksum(tmp_path: Path) -> None:
    write_log(tmp_path / "log.mcap", carry(300), {})
    with (tmp_path / "log.mcap").open("rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    chunks = [record for record in records if isinstance(record, Chunk)]
    assert len(chunks) > 1
    assert all(chunk.compression == "zstd" and chunk.uncompressed_crc for chunk in chunks)
    assert all(index.message_index_offsets for index in records if isinstance(index, ChunkIndex))
    assert all(record.data_section_crc for record in records if isinstance(record, DataEnd))
    assert all(record.summary_crc for record in records if isinstance(record, Footer))
    with (tmp_path / "log.mcap").open("rb") as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) == 13 * 300 + 2


def test_rosbags_reads_it(tmp_path: Path) -> None:
    given_ = carry(50)
    write_log(tmp_path / "log.mcap", given_, {})
    with AnyReader([tmp_path / "log.mcap"], default_typestore=HUMBLE) as reader:
        assert {c.topic: c.msgtype for c in reader.connections} == {c.topic: c.message for c in given_}
        (left,) = [c for c in reader.connections if c.topic == "/left/pose"]
        found = [(time, reader.deserialize(raw, c.msgtype)) for c, time, raw in reader.messages([left])]
    assert [time for time, _ in found] == [10_000_000 * k for k in range(50)]
    assert [m.pose.position.x for _, m in found] == given_[0].position[:, 0].tolist()
    assert {m.header.frame_id for _, m in found} == {"world"}


def test_info_describes_it_and_names_both_arms(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_log(path, carry(200), {})
    found = describe(path)
    assert found["command"] == (
        f"clpv ingest log {path} --left /left/pose --right /right/pose "
        "--left-wrench /left/wrench --right-wrench /right/wrench"
    )
    assert (found["protected"], found["lost"], found["duration"]) == (True, "", pytest.approx(1.99))
    assert {topic["name"]: topic["type"] for topic in found["topics"]} == {c.topic: c.message for c in carry(2)}
    assert not any(topic["problem"] for topic in found["topics"])


@pytest.mark.parametrize(("start", "clock"), [(0.01, "auto"), (0.0, "log")])
def test_ingest_reads_poses_and_wrenches_of_both_arms(tmp_path: Path, start: float, clock: Any) -> None:
    path = tmp_path / "log.mcap"
    given_: list[Any] = [replace(channel, time=channel.time + start) for channel in carry(200)]
    write_log(path, given_, {})
    parameters = RecordingParameters(
        sources=(Source(files=("log.mcap",)),),
        left="/left/pose",
        right="/right/pose",
        left_wrench="/left/wrench",
        right_wrench="/right/wrench",
        clock=clock,
        trim=False,
    )
    (demonstration,), report = read_recordings([[path]], parameters)
    by_topic = {channel.topic: channel for channel in given_}
    for side in ("left", "right"):
        arm, pose = demonstration.arms[side], by_topic[f"/{side}/pose"]
        np.testing.assert_allclose(arm.time, pose.time - start, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(arm.position, pose.position)
        np.testing.assert_allclose(arm.quaternion, pose.quaternion, rtol=0, atol=1e-15)
        np.testing.assert_allclose(arm.force, by_topic[f"/{side}/wrench"].force, rtol=0, atol=1e-12)
    assert report.notes == []
