"""Recordings to demonstrations: every format gives the same, two files, episodes, wrenches, division, refusals."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import recording_writers as writers
from robots import TWO_ARMS

from pipeline.code import reached
from pipeline.errors import DataError, ParameterError
from pipeline.stage import StageContext
from pipeline.validation import validate
from stages.artifacts.demonstrations import read_demonstrations
from stages.artifacts.parquet import header
from stages.ingest.parameters import (
    LasaParameters,
    PauseDivision,
    RecordingParameters,
    Source,
    TimeDivision,
    TopicDivision,
)
from stages.ingest.recordings import on_clock, read_recordings
from stages.ingest.sources import check_parameters, labels, locate, source_digest
from stages.ingest.stage import STAGE, sources

ARMS = writers.two_arms()
EXACT = 1e-9


def parameters(layout="pose", files=("recording.bag",), **changes):
    left, right = writers.SELECTIONS[layout]
    declared = changes.pop("sources", (Source(files=tuple(files)),))
    return RecordingParameters(**{"sources": declared, "left": left, "right": right, **changes})


def one(path, layout="pose", **changes):
    demonstrations, report = read_recordings([[path]], parameters(layout, (path.name,), **changes))
    return demonstrations, report


def same(recording, side, quaternion=True, shift=0):
    np.testing.assert_allclose(recording.time, ARMS.seconds[shift:], rtol=0, atol=EXACT)
    np.testing.assert_allclose(recording.position, ARMS.position[side][shift:], rtol=0, atol=EXACT)
    if quaternion:
        np.testing.assert_allclose(recording.quaternion, ARMS.quaternion[side][shift:], rtol=0, atol=EXACT)


# --- the same demonstration, whichever format carried it -------------------------------------------------------------


@pytest.mark.parametrize("container", writers.CONTAINERS)
def test_every_container_of_messages_gives_the_same(tmp_path, container):
    demonstrations, report = one(writers.write(tmp_path, container, "pose", ARMS))
    assert [d.demo for d in demonstrations] == ["1"]
    assert demonstrations[0].split == "train"
    for side in writers.SIDES:
        same(demonstrations[0].arms[side], side)
    assert report.counts == {"messages": 400, "samples": 400, "demonstrations": 1}


@pytest.mark.parametrize("container", ["ros1", "mcap"])
@pytest.mark.parametrize("layout", list(writers.LAYOUTS))
def test_every_layout_of_messages_gives_the_same(tmp_path, container, layout):
    demonstrations, _ = one(writers.write(tmp_path, container, layout, ARMS), layout)
    for side in writers.SIDES:
        arm = demonstrations[0].arms[side]
        same(arm, side, quaternion=layout not in ("point", "xyz"))
        if layout == "point":
            assert arm.quaternion is None
        if layout == "xyz":  # roll .1, pitch .2, yaw .3 about fixed axes
            np.testing.assert_allclose(arm.quaternion[0], [0.0342708, 0.1060205, 0.1435722, 0.9833474], atol=1e-6)


@pytest.mark.parametrize(
    ("container", "layout"),
    [
        ("csv", "csv"),
        ("csv-nanoseconds", "csv"),
        ("parquet", "parquet"),
        ("parquet-lists", "parquet-lists"),
        ("lerobot-v2.1", "lerobot"),
        ("lerobot-v3.0", "lerobot"),
    ],
)
def test_every_table_gives_the_same(tmp_path, container, layout):
    demonstrations, _ = one(writers.write(tmp_path, container, layout, ARMS), layout)
    for side in writers.SIDES:
        same(demonstrations[0].arms[side], side, quaternion=layout != "lerobot")


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left_x,left_y,left_z,left_qx,left_qy,left_qz,left_qw", "table:right_"),
        ("table:left_x,left_y,left_z", "right_x, right_y, right_z"),
    ],
)
def test_columns_by_name(tmp_path, left, right):
    path = writers.write(tmp_path, "csv", "csv", ARMS)
    demonstrations, _ = one(path, left=left, right=right)
    for side in writers.SIDES:
        same(demonstrations[0].arms[side], side, quaternion=False)


def test_elements_of_lerobot_by_name(tmp_path):
    path = writers.write(tmp_path, "lerobot-v2.1", "lerobot", ARMS)
    names = {side: f"observation.state:{side}_x,{side}_y,{side}_z" for side in writers.SIDES}
    demonstrations, _ = one(path, **names)
    for side in writers.SIDES:
        same(demonstrations[0].arms[side], side, quaternion=False)


# --- two files, episodes, joints, wrenches ---------------------------------------------------------------------------


@pytest.mark.parametrize("swapped", [False, True])
def test_two_files_one_an_arm_are_one_demonstration(tmp_path, swapped):
    path = writers.write(tmp_path, "mcap", "pose", ARMS)
    paths = []
    for side in writers.SIDES:

        def messages(builder, side=side):
            return (m for m in writers.LAYOUTS["pose"](builder, ARMS) if side in m[0])

        paths.append(writers.write_ros1(tmp_path / f"{side}.bag", messages))
    whole, _ = one(path)
    paths = paths[::-1] if swapped else paths
    found, _ = read_recordings([paths], parameters(files=[p.name for p in paths]))
    for side in writers.SIDES:
        assert np.array_equal(found[0].arms[side].time, whole[0].arms[side].time)
        assert np.array_equal(found[0].arms[side].position, whole[0].arms[side].position)


def test_two_files_with_one_topic_name_go_by_their_order(tmp_path):
    paths = []
    for side in writers.SIDES:

        def messages(builder, side=side):
            return (("/pose", *m[1:]) for m in writers.LAYOUTS["pose"](builder, ARMS) if side in m[0])

        paths.append(writers.write_ros1(tmp_path / f"{side}.bag", messages))
    found, _ = read_recordings([paths], parameters(files=[p.name for p in paths], left="/pose", right="/pose"))
    for side in writers.SIDES:
        same(found[0].arms[side], side)


def test_episodes_are_demonstrations(tmp_path):
    episodes = [writers.two_arms(seed=seed) for seed in range(3)]
    for version in ("v2.1", "v3.0"):
        path = writers.write_lerobot(tmp_path / version, episodes, version=version)
        demonstrations, _ = one(path, "lerobot")
        assert [d.demo for d in demonstrations] == ["1-0", "1-1", "1-2"]
        for demonstration, arms in zip(demonstrations, episodes, strict=True):
            np.testing.assert_allclose(demonstration.arms["left"].position, arms.position["left"], rtol=0, atol=EXACT)


def test_forward_kinematics_of_messages_and_of_columns(tmp_path):
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(TWO_ARMS)
    seconds = np.arange(100) / 50
    reach = np.sin(seconds)
    joints = {f"{side}_{name}": factor * reach for side in writers.SIDES for name, factor in (("s0", 1.0), ("s1", 0.5))}
    bag = writers.write_mcap(tmp_path / "joints.mcap", writers.joint_states(seconds, joints))
    csv = writers.write_joints_csv(tmp_path / "joints.csv", seconds, joints)
    found = []
    for path, head in ((bag, "/joint_states"), (csv, "table")):
        chosen = parameters(
            files=(path.name,), left=f"{head}:fk(left_hand)", right=f"{head}:fk(right_hand)", urdf="robot.urdf"
        )
        demonstrations, _ = read_recordings([[path]], chosen, urdf)
        found.append(demonstrations[0].arms)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        first, second = (arms[side] for arms in found)
        np.testing.assert_allclose(first.time, second.time, rtol=0, atol=EXACT)
        np.testing.assert_allclose(first.position, second.position, rtol=0, atol=EXACT)
        # shoulder at y = +-.2, links of .4 and .3 m in the plane
        a, b = reach, 1.5 * reach
        expected = np.column_stack(
            [0.4 * np.cos(a) + 0.3 * np.cos(b), 0.2 * sign + 0.4 * np.sin(a) + 0.3 * np.sin(b), np.zeros(100)]
        )
        rows = np.isin(np.round(seconds, 6), np.round(first.time + seconds[0], 6))
        assert rows.all()
        np.testing.assert_allclose(first.position, expected, rtol=0, atol=1e-12)


def test_forces_come_onto_the_arms_clock(tmp_path):
    for layout in writers.WRENCHES:
        left, right = writers.WRENCHES[layout]
        path = writers.write(tmp_path, "mcap", layout, ARMS)
        demonstrations, _ = one(path, layout, left_wrench=left, right_wrench=right)
        for side in writers.SIDES:
            np.testing.assert_allclose(demonstrations[0].arms[side].force, ARMS.force[side], rtol=0, atol=1e-6)


def test_forces_without_headers_follow_the_arms_headers(tmp_path):
    """Simulated time in the headers, wall time in the log: what has no header is brought over."""
    arms = replace(ARMS, stamp=(ARMS.stamp - writers.START) // 2 + 5 * 10**9)

    def messages(builder):
        for message in writers.LAYOUTS["pose"](builder, arms):
            yield message
            side = "left" if "left" in message[0] else "right"
            k = int(np.searchsorted(arms.log, message[2]))
            yield f"/{side}/force", "geometry_msgs/msg/Wrench", message[2], builder.wrench(arms.force[side][k])

    path = writers.write_mcap(tmp_path / "simulated.mcap", messages)
    demonstrations, _ = one(path, left_wrench="/left/force", right_wrench="/right/force", scale=0.5)
    for side in writers.SIDES:
        arm = demonstrations[0].arms[side]
        assert arm.time[-1] == pytest.approx(0.995)
        np.testing.assert_allclose(arm.force, ARMS.force[side], rtol=0, atol=1e-6)
        np.testing.assert_allclose(arm.position, 0.5 * ARMS.position[side], rtol=0, atol=EXACT)


def test_interpolation_knows_nothing_outside_and_in_gaps():
    recorded, values = np.array([1.0, 2.0, 4.0]), np.array([[0.0], [2.0], [6.0]])
    found = on_clock(np.array([0.5, 1.5, 2.0, 3.0, 4.0, 4.5]), recorded, values, 1.5)
    np.testing.assert_array_equal(found[:, 0], [np.nan, 1.0, 2.0, np.nan, 6.0, np.nan])
    assert np.isnan(on_clock(np.arange(3.0), np.zeros(0), np.zeros((0, 3)), 1.0)).all()
    np.testing.assert_array_equal(
        on_clock(np.array([0.0, 1.0]), np.array([1.0]), np.array([[5.0]]), 1.0)[:, 0], [np.nan, 5.0]
    )


# --- division --------------------------------------------------------------------------------------------------------


def twice(rest=100):
    """A reach, a rest of `rest` samples, and the way back."""
    order = np.concatenate([np.arange(200), np.full(rest, 199), np.arange(199, -1, -1)])
    stamp = writers.START + np.arange(order.size, dtype=np.int64) * 10_000_000
    return writers.Arms(
        stamp=stamp,
        log=stamp + 2_000_000,
        position={side: ARMS.position[side][order] for side in writers.SIDES},
        quaternion={side: ARMS.quaternion[side][order] for side in writers.SIDES},
        force={side: ARMS.force[side][order] for side in writers.SIDES},
    )


def test_pauses_divide(tmp_path):
    path = writers.write(tmp_path, "mcap", "pose", twice())
    demonstrations, _ = one(path, division=PauseDivision())
    assert [d.demo for d in demonstrations] == ["1-1", "1-2"]
    for demonstration, end in zip(demonstrations, (199, 0), strict=True):
        arm = demonstration.arms["left"]
        assert arm.time[0] == 0.0
        np.testing.assert_allclose(arm.position[-1], ARMS.position["left"][end], rtol=0, atol=2e-3)
        assert 1.5 < arm.time[-1] < 2.3


def test_times_divide(tmp_path):
    path = writers.write(tmp_path, "ros1", "pose", twice())
    demonstrations, report = one(path, division=TimeDivision(times=(2.2, 2.8)))
    assert [d.demo for d in demonstrations] == ["1-1", "1-2"]
    assert report.counts["pieces_dropped"] == 1
    with pytest.raises(
        DataError, match=r"^recording\.bag: ingest\.division\.times has 9 s; both arms .* 0\.000 to 4\.990"
    ):
        one(path, division=TimeDivision(times=(9.0,)))


@pytest.mark.parametrize(
    ("kind", "values"), [("std_msgs/msg/Bool", (True, False, True)), ("std_msgs/msg/Int32", (4, 5, 6))]
)
def test_a_topic_divides(tmp_path, kind, values):
    arms = twice()

    def messages(builder):
        yield from writers.LAYOUTS["pose"](builder, arms)
        for k, log in enumerate(arms.log):
            value = values[0 if k < 205 else 1 if k < 295 else 2]
            yield "/recording", kind, int(log), builder.make(kind, data=value)

    path = writers.write_mcap(tmp_path / "recording.mcap", messages)
    demonstrations, report = one(path, division=TopicDivision(topic="/recording"))
    # The number's middle stretch is a demonstration in which nothing moves: dropped, and counted.
    assert [d.demo for d in demonstrations] == ["1-1", "1-2"]
    assert report.counts.get("pieces_dropped", 0) == (0 if kind.endswith("Bool") else 1)
    assert [d.arms["left"].time.size for d in demonstrations] == pytest.approx([203, 203], abs=12)


def test_a_column_divides(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    arms = twice()
    columns = {name: pa.array(values) for name, values in writers.columns_of(arms).items()}
    run = np.where(np.arange(arms.log.size) < 250, 0, 1)
    pq.write_table(
        pa.table({"timestamp": pa.array(arms.stamp), "run": pa.array(run), **columns}), tmp_path / "r.parquet"
    )
    demonstrations, _ = one(tmp_path / "r.parquet", "parquet", division=TopicDivision(topic="table:run"))
    assert [d.demo for d in demonstrations] == ["1-1", "1-2"]


# --- clocks, digests, names ------------------------------------------------------------------------------------------


def test_the_log_clock_can_be_asked_for(tmp_path):
    uneven = replace(ARMS, log=ARMS.log + np.arange(200, dtype=np.int64) ** 2 * 1000)
    path = writers.write(tmp_path, "mcap", "pose", uneven)
    by_log, _ = one(path, clock="log")
    by_header, _ = one(path)
    assert by_log[0].arms["left"].time[-1] == pytest.approx(1.99 + 199**2 * 1e-6)
    assert by_header[0].arms["left"].time[-1] == pytest.approx(1.99)


def test_headers_set_back_leave_the_log_clock(tmp_path):
    back = replace(writers.jumping_back(ARMS, 100, 3.0), log=ARMS.log)
    path = writers.write(tmp_path, "mcap", "pose", back)
    demonstrations, report = one(path)
    same(demonstrations[0].arms["left"], "left")
    assert re.match(
        r"^recording\.mcap, left arm: header stamps jump back by 2\.99 s; the times at which", report.notes[0]
    )


def test_a_log_set_back_is_refused_where_there_are_no_headers(tmp_path):
    path = writers.write(tmp_path, "mcap", "xyz", writers.jumping_back(ARMS, 100, 3.0))
    with pytest.raises(
        DataError, match=r"^recording\.mcap, left arm: its clock jumps back by 2\.990 s at message 101, .*: cut the"
    ):
        one(path, "xyz")


def test_digests_are_checked(tmp_path):
    path = writers.write(tmp_path, "ros2-mcap", "pose", ARMS)
    digest = source_digest(path)
    declared = (Source(files=(path.name,), sha256=(digest.upper(),)),)
    read_recordings([[path]], parameters(sources=declared))
    (path / ".hidden").write_text("not counted")
    assert source_digest(path) == digest
    (path / "note.txt").write_text("counted")
    with pytest.raises(
        DataError, match=rf"^recording: is not the recording .* sha256 is [0-9a-f]{{64}}, not {digest.upper()}; restore"
    ):
        read_recordings([[path]], parameters(sources=declared))


def test_names_splits_and_their_conflicts(tmp_path):
    path = writers.write(tmp_path, "csv", "csv", ARMS)
    other = writers.write(tmp_path, "csv", "csv", ARMS, name="other")
    declared = (Source(files=(path.name,), demo="carry"), Source(files=(other.name,), split="test"))
    demonstrations, _ = read_recordings([[path], [other]], parameters("csv", sources=declared, dataset="mine"))
    assert [(d.dataset, d.demo, d.split) for d in demonstrations] == [("mine", "carry", "train"), ("mine", "2", "test")]
    clash = (Source(files=(path.name,), demo="2"), declared[1])
    with pytest.raises(ParameterError, match=r"^ingest\.sources: two demonstrations are called '2'"):
        read_recordings([[path], [other]], parameters("csv", sources=clash))


def test_scale_is_for_lengths(tmp_path):
    millimetres = replace(ARMS, position={side: 1000.0 * ARMS.position[side] for side in writers.SIDES})
    path = writers.write(tmp_path, "mcap", "pose", millimetres)
    demonstrations, _ = one(path, scale=0.001)
    same(demonstrations[0].arms["left"], "left")
    with pytest.raises(DataError, match=r"^recording\.mcap, left arm: its path extends over .* \(--scale 0\.001\)\.$"):
        one(path)


def test_a_single_point(tmp_path):
    path = writers.write(tmp_path, "mcap", "pose", ARMS)
    demonstrations, _ = one(path, left=None, right=None, point="/left/pose")
    assert list(demonstrations[0].arms) == ["point"]
    same(demonstrations[0].arms["point"], "left")


# --- the stage -------------------------------------------------------------------------------------------------------


def test_files_and_folders_are_labelled_and_found_again(tmp_path):
    folder = writers.write(tmp_path / "a", "ros2-sqlite3", "pose", ARMS, name="bag")
    file = writers.write(tmp_path / "b", "ros1", "pose", ARMS)
    chosen = parameters(sources=(Source(files=("a/bag",)), Source(files=("b/recording.bag",))))
    found = sources(chosen, tmp_path)
    assert set(found) == {"bag/metadata.yaml", "bag/bag.db3", "recording.bag"} or "bag/metadata.yaml" in found
    assert found["recording.bag"] == file
    outputs = {"demonstrations": tmp_path / "demonstrations.parquet"}
    context = StageContext(stage="ingest", parameters=chosen, inputs={}, sources=found, outputs=outputs)
    STAGE.run(context)
    demonstrations = read_demonstrations(outputs["demonstrations"])
    assert [d.demo for d in demonstrations] == ["1", "2"]
    same(demonstrations[0].arms["left"], "left")
    assert np.array_equal(demonstrations[0].arms["right"].position, demonstrations[1].arms["right"].position)
    details = header(outputs["demonstrations"])
    assert details["counts"] == {"messages": 800, "samples": 800, "demonstrations": 2}
    assert details["sources"]["a/bag"] == {"messages": 400, "samples": 400, "demonstrations": 1}
    assert STAGE.headline(outputs)["messages"] == 800
    assert folder.is_dir()


def test_equal_names_are_labelled_by_their_paths(tmp_path):
    chosen = parameters(sources=(Source(files=("a/x.bag",)), Source(files=("b/x.bag",))))
    assert labels(chosen) == {"a/x.bag": "a/x.bag", "b/x.bag": "b/x.bag"}
    with pytest.raises(DataError, match=r"^a/x\.bag: does not exist"):
        locate(chosen, tmp_path)
    (tmp_path / "a" / "x.bag").mkdir(parents=True)
    with pytest.raises(DataError, match=r"^x\.bag: the folder is empty"):
        locate(chosen, tmp_path)


@pytest.mark.parametrize(
    ("changes", "location"),
    [
        ({"right": None}, "ingest.right"),
        ({"left": None}, "ingest.left"),
        ({"point": "/p"}, "ingest.point"),
        ({"right": "/left/pose"}, "ingest.right"),
        ({"left": None, "right": None, "point": "/p", "left_wrench": "/w"}, "ingest.left_wrench"),
        ({"sources": (Source(files=("a", "b", "c")),)}, "ingest.sources.0.files"),
        ({"sources": (Source(files=("a",)), Source(files=("./a",)))}, "ingest.sources.1.files"),
        ({"sources": (Source(files=("a",), sha256=("0", "1")),)}, "ingest.sources.0.sha256"),
        (
            {"left": None, "right": None, "point": "/p", "sources": (Source(files=("a", "b")),)},
            "ingest.sources.0.files",
        ),
    ],
)
def test_contradictions_are_named(changes, location):
    with pytest.raises(ParameterError) as caught:
        check_parameters(parameters(**changes))
    assert caught.value.location == location
    assert str(caught.value).endswith(".")


def test_parameters_come_from_toml():
    given = {
        "kind": "recording",
        "sources": [{"files": ["a.bag"]}, {"files": ["l.bag", "r.bag"], "split": "test", "demo": "x"}],
        "left": "/l",
        "right": "/r",
        "division": {"kind": "pauses", "speed": 0.02},
    }
    found = validate(STAGE, given)
    assert found == RecordingParameters(
        sources=(Source(files=("a.bag",)), Source(files=("l.bag", "r.bag"), split="test", demo="x")),
        left="/l",
        right="/r",
        division=PauseDivision(speed=0.02),
    )
    assert validate(STAGE, {"motion": "Angle"}) == LasaParameters(motion="Angle")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"division": {"kind": "pause"}}, "ingest.division.kind: there is no kind 'pause'; did you mean 'pauses'?"),
        ({"division": {"kind": "times"}}, "ingest.division"),
        ({"division": {"kind": "times", "times": [-1.0]}}, "ingest.division.times.0: "),
        (
            {"division": {"kind": "pauses", "sped": 1.0}},
            "ingest.division.sped: unknown parameter; did you mean 'speed'?",
        ),
        ({"sources": []}, "ingest.sources: "),
        ({"sources": [{"files": []}]}, "ingest.sources.0.files: "),
        ({"sources": [{"file": ["a"]}]}, "ingest.sources.0.file"),
        (
            {"sources": [{"files": ["a"], "split": "tst"}]},
            "ingest.sources.0.split: must be 'train' or 'test', not 'tst'.",
        ),
        ({"scale": 0.0}, "ingest.scale: "),
        ({"clock": "auot"}, "ingest.clock: must be 'auto', 'header' or 'log', not 'auot'."),
    ],
)
def test_wrong_parameters_are_named(changes, sentence):
    with pytest.raises(ParameterError) as caught:
        validate(STAGE, {"kind": "recording", "sources": [{"files": ["a"]}], "left": "/l", "right": "/r", **changes})
    assert str(caught.value).startswith(sentence)


def test_lasa_does_not_reach_recording_code():
    lasa = reached(STAGE.modules(LasaParameters(motion="Angle")))
    bags = reached(STAGE.modules(parameters()))
    for module in ("recordings", "selections.selection", "cleaning", "readers.formats", "selections.kinematics"):
        assert f"stages.ingest.{module}" in bags
        assert f"stages.ingest.{module}" not in lasa
    assert "stages.ingest.lasa" not in bags


# --- refusals --------------------------------------------------------------------------------------------------------


def changed(side, **what):
    """The arms with one arm's positions or quaternions changed."""
    found = {}
    for name in ("position", "quaternion"):
        values = {key: value.copy() for key, value in getattr(ARMS, name).items()}
        if name in what:
            what[name](values[side])
        found[name] = values
    return replace(ARMS, **found)


def fill(value, rows=slice(None)):
    def apply(array):
        array[rows] = value

    return apply


@pytest.mark.parametrize(
    ("arms", "problem"),
    [
        (changed("right", position=fill(0.0)), r"right arm: all positions are zero"),
        (changed("right", position=fill(0.3)), r"right arm: never moves: its path extends over 0 mm"),
        (changed("left", position=fill(np.nan)), r"left arm: 200 of 200 samples have a position that is not a finite"),
        (
            changed("left", position=fill(9.0, slice(100, None))),
            r"left arm: jumps by .* m within 10 ms, 1\.000 s after",
        ),
        (changed("left", quaternion=fill(0.0)), r"left arm: 200 of 200 quaternions are zero"),
    ],
)
def test_bad_numbers_are_refused_by_arm(tmp_path, arms, problem):
    path = writers.write(tmp_path, "mcap", "pose", arms)
    with pytest.raises(DataError, match=rf"^recording\.mcap, {problem}.*\.$"):
        one(path)


def test_arms_without_common_time_and_with_gaps_are_refused(tmp_path):
    def late(builder):
        for topic, name, log, message in writers.LAYOUTS["pose"](builder, ARMS):
            if "right" in topic:
                message.header.stamp.sec += 60
                log += 60 * 10**9
            yield topic, name, log, message

    path = writers.write_mcap(tmp_path / "late.mcap", late)
    with pytest.raises(
        DataError, match=r"^late\.mcap: the arms have no time in common \(left 0\.000 to 1\.990 s, right 60\.000"
    ):
        one(path)

    def missing(builder):
        kept = [*range(80), *range(160, 200)]
        for topic, name, log, message in writers.LAYOUTS["pose"](builder, ARMS):
            if "right" in topic or int(np.searchsorted(ARMS.log, log)) in kept:
                yield topic, name, log, message

    path = writers.write_mcap(tmp_path / "gap.mcap", missing)
    with pytest.raises(
        DataError, match=r"^gap\.mcap: the left arm has no samples for 0\.810 s, from 0\.790 to 1\.600 s: divide"
    ):
        one(path)
    assert len(one(path, longest_gap=1.0)[0]) == 1
    assert [d.demo for d in one(path, division=PauseDivision())[0]] == ["1-1", "1-2"]


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"left": "/lef/pose"}, r"there is no topic '/lef/pose'; did you mean '/left/pose'\?"),
        ({"left": "/left/pose:pose.positon"}, r"messages of type .* hold no position at 'pose\.positon'; did you mean"),
        ({"left": "/left/pose:pose.position.x"}, r"is one number: name three numbers"),
        ({"left": "/left/pose:pose.position.x,pose.position.y"}, r"gives 2 number\(s\), not three numbers"),
        ({"left_wrench": "/left/pose"}, r"messages of type .* hold no force"),
    ],
)
def test_wrong_selections_of_messages_are_named(tmp_path, changes, problem):
    path = writers.write(tmp_path, "ros2-sqlite3", "pose", ARMS)
    with pytest.raises(DataError, match=rf"^recording, {next(iter(changes.values()))}: {problem}.*\.$"):
        one(path, **changes)


def test_a_wrong_pair_of_frames_lists_those_there_are(tmp_path):
    path = writers.write(tmp_path, "ros1", "tf", ARMS)
    with pytest.raises(
        DataError, match=r"no transform of that pair of frames; did you mean 'base->left_hand'\? Valid: "
    ):
        one(path, "tf", left="/tf:base->left_hnad")
    with pytest.raises(DataError, match=r"hold transforms: name a pair, such as /tf:parent->child\.$"):
        one(path, "tf", left="/tf")


def test_wrong_selections_of_columns_are_named(tmp_path):
    path = writers.write(tmp_path, "csv", "csv", ARMS)
    with pytest.raises(DataError, match=r"^recording\.csv, lft_: 'lft_' is neither a column of numbers nor a prefix"):
        one(path, "csv", left="lft_")
    with pytest.raises(DataError, match=r"has no column of numbers 'left_w'; did you mean 'left_qw'\?"):
        one(path, "csv", left="left_x,left_y,left_w")


def test_two_files_of_one_arm_are_refused(tmp_path):
    path = writers.write(tmp_path, "mcap", "pose", ARMS)
    other = writers.write(tmp_path, "ros1", "point", ARMS)
    with pytest.raises(DataError, match=r"^recording\.bag: none of the selections is of this recording"):
        read_recordings([[path, other]], parameters(files=(path.name, other.name)))


def test_same_input_same_bytes(tmp_path):
    path = Path(writers.write(tmp_path, "mcap", "endpoint", ARMS))
    first, second = (one(path, "endpoint")[0][0].arms for _ in range(2))
    for side in writers.SIDES:
        assert first[side].position.tobytes() == second[side].position.tobytes()
        assert first[side].time.tobytes() == second[side].time.tobytes()
