"""Logs of carried boxes and of demonstrations: what goes in comes out, and `clpv info` and `clpv ingest` read it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pybullet_data
import pytest
from frame_trees import placed
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation
from support import Invoke

from pipeline.errors import DataError
from pipeline.store import file_digest
from stages.artifacts import carry_log
from stages.artifacts.carry_log import CLUTCH, FACING, MASTER, read_master
from stages.artifacts.channel import Channel
from stages.artifacts.channels import Flags, JointStates, Numbers, Poses, Transforms, Words, Wrenches
from stages.artifacts.log import read_details, read_log, read_parameters, write_log
from stages.ingest.parameters import RecordingParameters, Source, TopicDivision
from stages.ingest.recordings import read_recordings
from stages.inspect.bag_info import describe
from stages.policy.carrying import Phase
from stages.policy.outcome import Outcome
from stages.rollout.carry import Carried
from stages.teleoperation.masters import Replay, Seen
from stages.teleoperation.record import Demonstrated
from stages.world.description import both, description, faces, turning

ROBOT = "iiwa"
PARAMETERS = {"kind": "bullet", "following": {"deviation_threshold": 0.006}}
CODES = {phase: code for code, phase in enumerate(Phase)}
PHASES = (Phase.APPROACH, Phase.GRIP, Phase.CARRY, Phase.SET_DOWN, Phase.RELEASE, Phase.DONE)
NAMED = (-1, 0, 0, 1, 1, -1)
SPOKEN = ("/phase", "/policy/pushed", "/robot_description", "/tf_static")
"""Topics of what is said where it changes, or once."""


def write_carry_log(path: Path, one: Any, robot: str = ROBOT) -> None:
    carry_log.write_carry_log(path, one, robot, PARAMETERS)


def write_demonstration(path: Path, done: Demonstrated, seed: int, number: int) -> None:
    carry_log.write_demonstration(path, done, seed, number, ROBOT, {"scene": {"robot": ROBOT}})


def carried(n: int = 6, seed: int = 0) -> SimpleNamespace:
    """A roll-out of n samples; every number differs from every other one."""
    draw = np.random.default_rng(seed).normal
    time = np.arange(n) / 50.0
    arms = Carried(
        time=time,
        x=draw(size=(n, 3)),
        p_hat=draw(size=(n, 3)),
        gate=np.arange(n) % 2 == 0,
        phase=np.array([CODES[PHASES[k % 6]] for k in range(n)], dtype=np.int8),
        q=draw(size=(n, 2, 7)),
        qdot=draw(size=(n, 2, 7)),
        pads=draw(size=(n, 2, 3)),
        commanded=draw(size=(n, 2, 3)),
        box=draw(size=(n, 3)),
        turn=draw(size=(n, 4)),
        force=draw(size=(n, 2)),
        contact=draw(size=(n, 2)),
        desired=draw(size=n),
        residual=draw(size=(n, 2)),
        named=np.array([NAMED[k % 6] for k in range(n)], dtype=np.int8),
        acting=np.column_stack([np.arange(n) % 3 == 1, np.arange(n) % 6 >= 4]),
        clearance=draw(size=n),
        box_room=draw(size=n),
        arm_room=draw(size=n),
        status=np.zeros(n, dtype=np.int8),
        box_contacts=0,
        arm_contacts=0,
        length=0.3,
        mass=0.4,
        outcome=Outcome.ARRIVED,
    )
    return SimpleNamespace(
        carried=arms,
        time=time,
        x=arms.x,
        p_hat=arms.p_hat,
        gate=arms.gate,
        lyapunov=draw(size=n),
        rollout="clpvds-robust/compliant/3",
        outcome=Outcome.ARRIVED,
        scene_facts={"mass": 0.4, "following": True, "bias": [0.1, -0.1], "compliance": True},
    )


def demonstration(n: int = 200, silent: int = 5, seed: int = 0) -> Demonstrated:
    """4 s at 50 Hz; pads are led 0.3 m forward and 0.1 m up from sample 60 to 160, the master is silent at first."""
    generator = np.random.default_rng(seed)
    time = np.arange(n) / 50.0
    s = np.clip((time - 1.2) / 2.0, 0.0, 1.0)
    share = 10 * s**3 - 15 * s**4 + 6 * s**5
    midpoint = np.column_stack([0.4 + 0.3 * share, 0.0 * share, 0.3 + 0.1 * share])
    aside = np.array([0.0, 0.15, 0.0])
    pads = np.stack([midpoint + aside, midpoint - aside], axis=1)
    master = 0.5 * (midpoint - midpoint[0]) + 1e-4 * generator.normal(size=(n, 3))
    master[:silent] = np.nan
    handle = generator.normal(size=(n, 4))
    phase = np.select(
        [time < 0.5, time < 1.0, time < 3.4, time < 3.6, time < 3.9],
        [CODES[p] for p in PHASES[:5]],
        CODES[Phase.DONE],
    )
    return Demonstrated(
        time=time,
        phase=phase.astype(np.int8),
        joints=generator.normal(size=(n, 2, 7)),
        pads=pads,
        force=5.0 + generator.normal(size=(n, 2)),
        box=midpoint,
        turn=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        master=master,
        handle=handle / np.linalg.norm(handle, axis=1)[:, None],
        clutch=(np.arange(n) // 20) % 2 == 1,
        ended=Phase.DONE,
    )


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Path, Demonstrated]:
    done = demonstration()
    write_demonstration(tmp_path / "demo1.mcap", done, 3, 0)
    return tmp_path / "demo1.mcap", done


def carried_log(folder: Path) -> dict[str, Channel]:
    write_carry_log(folder / "carried.mcap", carried())
    return read_log(folder / "carried.mcap")


def of(log: dict[str, Channel], topic: str, kind: type[Channel]) -> Any:
    assert type(log[topic]) is kind
    return log[topic]


def changes(time: np.ndarray, codes: np.ndarray, names: Sequence[str] = tuple(Phase)) -> list[tuple[float, str]]:
    """When a word (a phase, if nothing else is said) was first said, and which."""
    first = [k for k in range(codes.size) if k == 0 or codes[k] != codes[k - 1]]
    return [(float(time[k]), str(names[codes[k]])) for k in first]


# --- roll-outs ------------------------------------------------------------------------------------------------------


def test_a_roll_out_comes_back_as_it_went_in(tmp_path: Path) -> None:
    one = carried()
    write_carry_log(tmp_path / "one.mcap", one)
    log, arms = read_log(tmp_path / "one.mcap"), one.carried
    turns = faces(both(ROBOT, "robot"), arms.q)[1]
    for side, name in enumerate(("left", "right")):
        pose, commanded = of(log, f"/{name}/pose", Poses), of(log, f"/{name}/commanded", Poses)
        assert np.array_equal(pose.position, arms.pads[:, side])
        assert np.array_equal(pose.quaternion, turns[:, side])
        assert np.array_equal(commanded.position, arms.commanded[:, side])
        assert np.array_equal(commanded.quaternion, np.tile(FACING[name], (6, 1)))
        wrench = of(log, f"/{name}/wrench", Wrenches)
        assert np.array_equal(wrench.force, np.column_stack([np.zeros(6), np.zeros(6), arms.force[:, side]]))
        assert not wrench.torque.any()
        assert wrench.frame == f"{name}_pad"
    joints = of(log, "/joint_states", JointStates)
    assert joints.names == turning(both(ROBOT, "robot"))
    assert joints.names[0] == "left_lbr_iiwa_joint_1"
    assert joints.names[13] == "right_lbr_iiwa_joint_7"
    assert np.array_equal(joints.position, arms.q.reshape(6, 14))
    assert np.array_equal(joints.velocity, arms.qdot.reshape(6, 14))
    for topic, position in (
        ("/box/pose", arms.box),
        ("/midpoint", 0.5 * (arms.pads[:, 0] + arms.pads[:, 1])),
        ("/policy/x", one.x),
        ("/policy/p_hat", one.p_hat),
    ):
        assert np.array_equal(of(log, topic, Poses).position, position)
    assert np.array_equal(of(log, "/box/pose", Poses).quaternion, arms.turn)
    assert of(log, "/policy/gate", Flags).values.tolist() == [True, False] * 3
    words = of(log, "/phase", Words)
    assert list(zip(words.time, words.values, strict=True)) == changes(one.time, arms.phase)
    assert all(np.array_equal(channel.time, one.time) for topic, channel in log.items() if topic not in SPOKEN)
    assert [topic for topic, channel in log.items() if channel.latched] == ["/robot_description", "/tf_static"]


def test_numbers_stand_beside_with_names_and_units(tmp_path: Path) -> None:
    one = carried()
    write_carry_log(tmp_path / "one.mcap", one)
    log, arms = read_log(tmp_path / "one.mcap"), one.carried
    wanted = {
        "/forces": ("N", {"left": arms.force[:, 0], "right": arms.force[:, 1], "desired": arms.desired}),
        "/truth/contacts": ("N", {"left": arms.contact[:, 0], "right": arms.contact[:, 1]}),
        "/policy/deviations": (
            "m",
            {"left": arms.residual[:, 0], "right": arms.residual[:, 1], "threshold": np.full(6, 0.006)},
        ),
        "/policy/lyapunov": ("m2", {"V": one.lyapunov}),
        "/truth/clearances": ("m", {"middle": arms.clearance, "box": arms.box_room, "arms": arms.arm_room}),
    }
    assert {topic for topic, channel in log.items() if isinstance(channel, Numbers)} == set(wanted)
    for topic, (unit, values) in wanted.items():
        found = of(log, topic, Numbers)
        assert (found.unit, found.names) == (unit, tuple(values))
        assert np.array_equal(found.values, np.column_stack(list(values.values())))


def test_frames_and_description_are_those_of_the_joints(tmp_path: Path) -> None:
    one = carried()
    write_carry_log(tmp_path / "one.mcap", one)
    log, arms = read_log(tmp_path / "one.mcap"), both(ROBOT, "robot")
    assert of(log, "/robot_description", Words).values == (description(ROBOT, arms),)
    fixed, moving = of(log, "/tf_static", Transforms), of(log, "/tf", Transforms)
    places, turns = faces(arms, one.carried.q)
    for k in range(6):
        found = placed([fixed, moving], k)
        for side, name in enumerate(("left", "right")):
            assert found[f"{name}_pad"][:3, 3] == pytest.approx(places[k, side], abs=1e-9)
            rotation = Rotation.from_quat(turns[k, side]).as_matrix()
            assert found[f"{name}_pad"][:3, :3] == pytest.approx(rotation, abs=1e-9)
        for name, position in (("box", one.carried.box), ("x", one.x), ("p_hat", one.p_hat)):
            assert np.array_equal(found[name][:3, 3], position[k])
        assert np.array_equal(found["midpoint"][:3, 3], one.carried.pads[k].mean(axis=0))


def test_where_there_are_no_pots_there_are_no_clearances(tmp_path: Path) -> None:
    one, far = carried(), np.full(6, np.inf)
    one.carried = replace(one.carried, clearance=far, box_room=far, arm_room=far)
    write_carry_log(tmp_path / "one.mcap", one)
    assert "/truth/clearances" not in read_log(tmp_path / "one.mcap")


def test_who_was_taken_for_pushed_and_who_truly_was(tmp_path: Path) -> None:
    one = carried()
    write_carry_log(tmp_path / "one.mcap", one)
    log = read_log(tmp_path / "one.mcap")
    taken = of(log, "/policy/pushed", Words)
    found = list(zip(taken.time, taken.values, strict=True))
    assert found == [(0.0, ""), (0.02, "left"), (0.06, "right"), (0.1, "")]
    assert found == changes(one.time, one.carried.named + 1, ("", "left", "right"))
    assert of(log, "/truth/left_pushed", Flags).values.tolist() == [False, True, False, False, True, False]
    assert of(log, "/truth/right_pushed", Flags).values.tolist() == [False, False, False, False, True, True]


def test_a_roll_out_has_these_topics_and_no_others(tmp_path: Path) -> None:
    write_carry_log(tmp_path / "one.mcap", carried())
    of_a_side = ("/{}/pose", "/{}/commanded", "/{}/wrench", "/truth/{}_pushed")
    of_policy = {f"/policy/{name}" for name in ("x", "p_hat", "gate", "pushed", "deviations", "lyapunov")}
    of_all = {"/robot_description", "/tf_static", "/tf", "/joint_states", "/box/pose", "/midpoint", "/phase", "/forces"}
    sides = {topic.format(side) for topic in of_a_side for side in ("left", "right")}
    truth = {"/truth/contacts", "/truth/clearances"}
    assert set(read_log(tmp_path / "one.mcap")) == sides | of_policy | of_all | truth


@pytest.mark.parametrize("field", ["named", "acting"])
def test_other_pushes_make_another_log(tmp_path: Path, field: str) -> None:
    one = carried()
    write_carry_log(tmp_path / "one.mcap", one)
    one.carried = replace(one.carried, **{field: np.roll(getattr(one.carried, field), 1, axis=0)})
    write_carry_log(tmp_path / "two.mcap", one)
    assert (tmp_path / "two.mcap").read_bytes() != (tmp_path / "one.mcap").read_bytes()


def test_a_roll_out_says_what_it_was(tmp_path: Path) -> None:
    write_carry_log(tmp_path / "one.mcap", carried())
    assert read_details(tmp_path / "one.mcap") == {
        "what": "roll-out",
        "rollout": "clpvds-robust/compliant/3",
        "outcome": "arrived",
        "robot": "iiwa",
        "facts": {"mass": 0.4, "following": True, "bias": [0.1, -0.1], "compliance": True},
    }
    assert read_parameters(tmp_path / "one.mcap") == PARAMETERS


def test_no_log_depends_on_the_machine(tmp_path: Path) -> None:
    """No path, of this project or of the descriptions that came with a package, in anything that is said in words."""
    write_carry_log(tmp_path / "one.mcap", carried())
    with (tmp_path / "one.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        said = [m.data for _, channel, m in reader.iter_messages(topics=["/robot_description"])]
        said += [a.data for a in reader.iter_attachments()]
        said += [str(m.metadata).encode() for m in reader.iter_metadata()]
    content = b"".join(said)
    assert len(said) == 3
    for path in (Path.cwd(), tmp_path, Path(pybullet_data.getDataPath()), Path.home()):
        assert str(path).encode() not in content
    assert b".urdf" not in content


@pytest.mark.parametrize("name", ["left", "right"])
def test_pads_face_each_other(name: str) -> None:
    """Their z axis points at the box: along -y on the left, +y on the right."""
    x, y, z, w = FACING[name]
    axis = [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)]
    assert axis == pytest.approx([0.0, -1.0 if name == "left" else 1.0, 0.0], abs=1e-15)
    assert x * x + y * y + z * z + w * w == pytest.approx(1.0, abs=1e-15)


def test_the_same_roll_out_gives_the_same_bytes(tmp_path: Path) -> None:
    one = carried()
    write_carry_log(tmp_path / "one.mcap", one)
    write_carry_log(tmp_path / "two.mcap", one)
    one.carried = replace(one.carried, pads=np.asfortranarray(one.carried.pads))
    write_carry_log(tmp_path / "three.mcap", one)
    first = (tmp_path / "one.mcap").read_bytes()
    assert (tmp_path / "two.mcap").read_bytes() == first
    assert (tmp_path / "three.mcap").read_bytes() == first
    write_carry_log(tmp_path / "other.mcap", carried(seed=1))
    assert (tmp_path / "other.mcap").read_bytes() != first


def test_a_roll_out_that_never_began(tmp_path: Path) -> None:
    write_carry_log(tmp_path / "one.mcap", carried(1))
    log = read_log(tmp_path / "one.mcap")
    assert {channel.time.size for channel in log.values()} == {1}


def test_info_finds_the_arms_of_a_roll_out(tmp_path: Path) -> None:
    """Beside the box, the commanded places and the policy's states, which are poses and points as well."""
    one = carried(400)
    walk = np.cumsum(0.001 * one.carried.pads, axis=0)
    one.carried = replace(one.carried, pads=walk)
    write_carry_log(tmp_path / "one.mcap", one)
    command = describe(tmp_path / "one.mcap", recover=False)["command"]
    assert "--left /left/pose --right /right/pose --left-wrench /left/" in command


# --- demonstrations -------------------------------------------------------------------------------------------------


def test_a_demonstration_comes_back_as_it_went_in(recorded: tuple[Path, Demonstrated]) -> None:
    path, done = recorded
    log = read_log(path)
    for side, name in enumerate(("left", "right")):
        assert np.array_equal(of(log, f"/{name}/pose", Poses).position, done.pads[:, side])
        assert np.array_equal(of(log, f"/{name}/wrench", Wrenches).force[:, 2], done.force[:, side])
    assert np.array_equal(of(log, "/box/pose", Poses).position, done.box)
    words = of(log, "/phase", Words)
    assert list(zip(words.time, words.values, strict=True)) == changes(done.time, done.phase)
    led = of(log, "/recording", Flags)
    assert np.array_equal(led.time, done.time)
    # From 1.0 s on, before 3.4 s.
    assert np.array_equal(led.values, (np.arange(200) >= 50) & (np.arange(200) < 170))
    frames = of(log, "/tf", Transforms)
    assert frames.children[-2:] == ("box", "midpoint")
    assert np.array_equal(frames.position[:, -1], done.pads.mean(axis=1))
    joints = of(log, "/joint_states", JointStates)
    assert np.array_equal(joints.position, done.joints.reshape(200, 14))
    assert joints.names == of(carried_log(path.parent), "/joint_states", JointStates).names
    assert read_parameters(path) == {"scene": {"robot": ROBOT}}
    forces = of(log, "/forces", Numbers)
    assert (forces.names, forces.unit) == (("left", "right"), "N")
    assert np.array_equal(forces.values, done.force)
    assert read_details(path) == {
        "what": "demonstration by shared teleoperation",
        "seed": 3,
        "number": 0,
        "robot": ROBOT,
    }


def test_the_same_demonstration_gives_the_same_bytes(tmp_path: Path) -> None:
    names = ("one", "two", "seed", "number")
    for name, (seed, number) in zip(names, [(3, 0), (3, 0), (4, 0), (3, 1)], strict=True):
        write_demonstration(tmp_path / name, demonstration(), seed, number)
    found = [(tmp_path / name).read_bytes() for name in names]
    assert found[0] == found[1]
    assert len(set(found)) == 3


def test_a_master_is_recorded_once_it_has_spoken(recorded: tuple[Path, Demonstrated]) -> None:
    path, done = recorded
    time, position, quaternion, clutch = read_master(path)
    assert np.array_equal(time, done.time[5:])
    assert np.array_equal(position, done.master[5:])
    assert np.array_equal(quaternion, done.handle[5:])
    assert np.array_equal(clutch, done.clutch[5:])
    replay = Replay(time, position, quaternion, clutch, source=path.name)
    sample = replay.sample(float(time[20] - time[0]), Seen(np.zeros(3)))
    assert sample is not None
    assert sample.position == pytest.approx(position[20])
    assert sample.clutch == clutch[20]


def test_a_demonstration_that_no_master_spoke_in_can_be_written_and_not_replayed(tmp_path: Path) -> None:
    write_demonstration(tmp_path / "mute.mcap", demonstration(silent=200), 0, 0)
    time, position, quaternion, clutch = read_master(tmp_path / "mute.mcap")
    assert time.size == 0
    with pytest.raises(DataError, match=r"^mute\.mcap: "):
        Replay(time, position, quaternion, clutch, source="mute.mcap")


def pose(topic: str) -> Poses:
    return Poses(
        topic=topic,
        frame="f",
        time=np.arange(3.0),
        position=np.zeros((3, 3)),
        quaternion=np.tile([0, 0, 0, 1.0], (3, 1)),
    )


def flag(topic: str) -> Flags:
    return Flags(topic=topic, time=np.arange(3.0), values=np.ones(3, dtype=bool))


@pytest.mark.parametrize(
    ("channels", "sentence"),
    [
        ([], "has no topic /master/pose: it is no recording of 'clpv teleop'."),
        ([flag(CLUTCH)], "has no topic /master/pose: it is no recording of 'clpv teleop'."),
        ([pose(MASTER)], "has no topic /master/clutch: it is no recording of 'clpv teleop'."),
        ([flag(MASTER), flag(CLUTCH)], "its /master/pose is no pose, or its /master/clutch no Bool."),
        ([pose(MASTER), pose(CLUTCH)], "its /master/pose is no pose, or its /master/clutch no Bool."),
    ],
)
def test_a_file_without_a_master_is_refused(tmp_path: Path, channels: list[Channel], sentence: str) -> None:
    write_log(tmp_path / "file.mcap", channels, {})
    with pytest.raises(DataError) as caught:
        read_master(tmp_path / "file.mcap")
    assert (caught.value.source, caught.value.problem) == ("file.mcap", sentence)


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("nothing")
    for name in ("text.mcap", "nix.mcap"):
        with pytest.raises(DataError, match=rf"^{name}: ") as caught:
            read_master(tmp_path / name)
        assert "Traceback" not in str(caught.value)
    write_carry_log(tmp_path / "rollout.mcap", carried())
    with pytest.raises(DataError, match="has no topic /master/pose"):
        read_master(tmp_path / "rollout.mcap")


# --- as a recording of demonstrations -------------------------------------------------------------------------------


def test_info_tells_the_arms_of_a_demonstration(recorded: tuple[Path, Demonstrated]) -> None:
    command = describe(recorded[0], recover=False)["command"]
    assert "--left /left/pose --right /right/pose" in command
    assert "--left-wrench /left/wrench --right-wrench /right/wrench" in command


def test_ingest_reads_the_stretch_that_was_led(recorded: tuple[Path, Demonstrated]) -> None:
    path, done = recorded
    given = RecordingParameters(
        dataset="made",
        sources=(Source(files=("demo1.mcap",), sha256=(file_digest(path),)),),
        left="/left/pose",
        right="/right/pose",
        left_wrench="/left/wrench",
        right_wrench="/right/wrench",
        division=TopicDivision(topic="/recording"),
        trim=False,
    )
    (found,) = read_recordings([[path]], given)[0]
    for side, name in enumerate(("left", "right")):
        arm = found.arms[name]
        # Recorded from 1.0 s; at 3.4 s the topic says that it is over.
        kept = slice(50, 50 + arm.time.shape[0])
        assert 120 <= arm.time.shape[0] <= 121
        assert arm.position == pytest.approx(done.pads[kept, side], abs=1e-12)
        assert arm.force is not None
        assert arm.force[:, 2] == pytest.approx(done.force[kept, side], abs=1e-9)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with two demonstrations."""
    folder = tmp_path / "datasets" / "made"
    folder.mkdir(parents=True)
    (tmp_path / "runs").mkdir()
    for number in range(2):
        write_demonstration(folder / f"demo{number + 1}.mcap", demonstration(seed=number), 0, number)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_commands_read_demonstrations(project: Path, clpv: Invoke) -> None:
    files = [f"datasets/made/demo{number}.mcap" for number in (1, 2)]
    shown = clpv(project, "info", files[0])
    assert shown.exit_code == 0, shown.output
    assert "left end effector" in shown.stdout
    arms = [f"--{name} /{name.replace('-', '/') if '-' in name else f'{name}/pose'}" for name in ("left", "right")]
    wrenches = ["--left-wrench", "/left/wrench", "--right-wrench", "/right/wrench"]
    words = [word for arm in arms for word in arm.split()]
    result = clpv(project, "ingest", "made", *files, *words, *wrenches, "--divide", "topic:/recording")
    assert result.exit_code == 0, result.output
    found = json.loads(clpv(project, "show", "made", "--json").stdout)
    assert found["data"]["ingest: counts"].startswith("demonstrations 2, train 2")
    text = (project / "datasets" / "made" / "dataset.toml").read_text()
    assert all(f"demo{number}" in text for number in (1, 2))


def test_where_nobody_follows_there_is_no_threshold(tmp_path: Path) -> None:
    one = carried()
    one.scene_facts = {**one.scene_facts, "following": False}
    write_carry_log(tmp_path / "one.mcap", one)
    assert of(read_log(tmp_path / "one.mcap"), "/policy/deviations", Numbers).names == ("left", "right")
