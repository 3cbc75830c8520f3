"""CSV, parquet and LeRobot: columns by name, clocks in any unit, episodes, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import recording_writers as writers
from recording_writers import Arms

from pipeline.errors import DataError
from stages.ingest.readers.formats import open_recording
from stages.ingest.readers.row_files import nanoseconds_in
from stages.ingest.recording import Request, Samples


class Columns:
    def __init__(self, *names: str) -> None:
        self.names = names

    def __call__(self, row: dict[str, float]) -> list[float]:
        return [row[name] for name in self.names]


class Part:
    def __init__(self, column: str, first: int, last: int) -> None:
        self.column, self.part = column, slice(first, last)

    def __call__(self, row: dict[str, np.ndarray]) -> np.ndarray:
        return row[self.column][self.part]


def of(*columns: str) -> Request:
    return Request(topic="table", extract=Columns(*columns), width=len(columns), columns=columns)


LEFT = of("left_x", "left_y", "left_z")


def read(path: Path, request: Request = LEFT, episode: str = "") -> Samples:
    with open_recording(path) as recording:
        (found,) = recording.read([request], episode)
    return found


def write_text(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def arms() -> Arms:
    return writers.two_arms(60)


@pytest.mark.parametrize("container", ["csv", "csv-nanoseconds", "parquet"])
def test_named_columns_give_what_was_written_with_exact_times(tmp_path: Path, container: str, arms: Arms) -> None:
    path = writers.write(tmp_path, container, "", arms)
    found = read(path)
    np.testing.assert_array_equal(found.values, arms.position["left"])
    np.testing.assert_array_equal(found.log_time, arms.stamp)
    assert found.stamp is None
    with open_recording(path) as recording:
        (topic,) = recording.topics()
        assert (topic.name, topic.type, topic.count) == ("table", "rows", 60)
        assert (topic.first, topic.last) == (arms.stamp[0], arms.stamp[-1])
        assert topic.fields == tuple(writers.columns_of(arms))
        assert not recording.integrity().protected
        np.testing.assert_array_equal(recording.clocks()["table"][0], arms.stamp)


def test_columns_of_lists(tmp_path: Path, arms: Arms) -> None:
    path = writers.write(tmp_path, "parquet-lists", "", arms)
    request = Request(topic="table", extract=Part("right_pose", 0, 3), width=3, columns=("right_pose",))
    np.testing.assert_array_equal(read(path, request).values, arms.position["right"])
    with open_recording(path) as recording:
        assert recording.topics()[0].fields == ("left_pose[]", "right_pose[]")


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_each_lerobot_episode_is_read_alone(tmp_path: Path, version: str) -> None:
    episodes = [writers.two_arms(40, seed=seed, rate=50) for seed in range(3)]
    path = writers.write_lerobot(tmp_path / "set", episodes, version=version)
    request = Request(topic="table", extract=Part("observation.state", 3, 6), width=3, columns=("observation.state",))
    with open_recording(path) as recording:
        assert recording.format == f"LeRobot {version}"
        assert recording.episodes() == ["0", "1", "2"]
        (topic,) = recording.topics()
        assert topic.count == 120
        assert "observation.state[6]" in topic.fields
        assert topic.names["observation.state"] == tuple(writers.LEROBOT_NAMES)
    for index, episode in enumerate(episodes):
        found = read(path, request, str(index))
        np.testing.assert_array_equal(found.values, episode.position["right"])
        np.testing.assert_array_equal(found.log_time, episode.stamp - episode.stamp[0])
    with pytest.raises(DataError, match=r"set: has no episode '3'"):
        read(path, request, "3")


def test_lerobot_timestamps_that_are_no_frames_over_fps_are_the_clock(tmp_path: Path) -> None:
    path = writers.write_lerobot(tmp_path / "set", [writers.two_arms(10, rate=50)])
    file = path / "data" / "chunk-000" / "episode_000000.parquet"
    table = pq.read_table(file)
    uneven = pa.array(np.cumsum(np.full(10, 0.03)))
    pq.write_table(table.set_column(table.schema.get_field_index("timestamp"), "timestamp", uneven), file)
    found = read(path, of("frame_index"), "0")
    np.testing.assert_allclose(np.diff(found.log_time), 0.03e9, atol=1)


@pytest.mark.parametrize(
    ("name", "values", "unit"),
    [
        ("time", [0.0, 0.01, 0.02], 10**9),
        ("t", [1.7e9, 1.7e9 + 0.01], 10**9),
        ("stamp", [1.7e12, 1.7e12 + 10], 10**6),
        ("stamp", [1.7e15, 1.7e15 + 1e4], 10**3),
        ("stamp", [1.7e18, 1.7e18 + 1e7], 1),
        ("stamp", [0, 10_000_000, 20_000_000], 1),
        ("time", [0, 1, 2, 3], 10**9),
        ("time_ms", [0, 10, 20], 10**6),
        ("timestamp_us", [0, 10, 20], 10**3),
        ("time_ns", [0, 10, 20], 1),
        ("time_s", [1.7e18], 10**9),
        ("rosbagTimestamp", [5], 1),
        ("time", [], 10**9),
        ("time", [float("nan")], 10**9),
    ],
)
def test_the_unit_of_a_clock_follows_from_its_name_or_its_numbers(name: str, values: list[float], unit: int) -> None:
    assert nanoseconds_in(name, values) == unit


def test_decimal_seconds_lose_no_nanosecond(tmp_path: Path) -> None:
    rows = "\n".join(f"1700000000.{k:09d},{k},0,0" for k in range(1, 50))
    path = write_text(tmp_path / "a.csv", f"time,left_x,left_y,left_z\n{rows}\n")
    np.testing.assert_array_equal(read(path).log_time, 1_700_000_000 * 10**9 + np.arange(1, 50))


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiters_comments_blank_lines_and_byte_order_marks(tmp_path: Path, delimiter: str) -> None:
    text = "\ufeff# T, left_x, left_y, left_z\n0,1,2,3\n\n0.5, 4,,6\n".replace(",", delimiter)
    path = write_text(tmp_path / "a.csv", text)
    found = read(path)
    np.testing.assert_array_equal(found.values, [[1, 2, 3], [4, np.nan, 6]])
    np.testing.assert_array_equal(found.log_time, [0, 500_000_000])


def test_what_rostopic_echo_writes_is_read(tmp_path: Path) -> None:
    columns = [f"field.pose.position.{axis}" for axis in "xyz"]
    path = write_text(tmp_path / "a.csv", f"%time,{','.join(columns)}\n1700000000000000001,1,2,3\n")
    found = read(path, of(*columns))
    assert found.log_time.tolist() == [1700000000000000001]
    assert found.values.tolist() == [[1, 2, 3]]


def test_baxters_joint_recorder(tmp_path: Path) -> None:
    names = [
        f"{side}_{joint}" for side in writers.SIDES for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2", "gripper")
    ]
    seconds = np.arange(20) / 100
    joints = {name: np.sin(seconds + k) for k, name in enumerate(names)}
    path = writers.write_joints_csv(tmp_path / "baxter.csv", seconds, joints)
    found = read(path, of("left_s0", "right_w2"))
    np.testing.assert_array_equal(found.values, np.column_stack([joints["left_s0"], joints["right_w2"]]))
    with open_recording(path) as recording:
        assert recording.format == "CSV (Baxter's joint_recorder)"
        assert recording.topics()[0].fields == tuple(names)


def test_timestamps_and_missing_values_in_parquet(tmp_path: Path) -> None:
    stamps = pa.array([1_000, 2_000, 3_000], pa.timestamp("us"))
    table = pa.table(
        {"time": stamps, "left_x": [1.0, None, 3.0], "left_y": [1, 2, 3], "left_z": [0.0, 0.0, 0.0], "s": ["a"] * 3}
    )
    path = tmp_path / "a.parquet"
    pq.write_table(table, path)
    found = read(path)
    np.testing.assert_array_equal(found.log_time, [1_000_000, 2_000_000, 3_000_000])
    np.testing.assert_array_equal(found.values[:, 0], [1.0, np.nan, 3.0])
    with open_recording(path) as recording:
        assert recording.topics()[0].fields == ("left_x", "left_y", "left_z")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,1,2\n1,2,3\n", "begins with numbers: its first line must name the columns"),
        ("left_x,left_y,left_z\n1,2,3\n", "has no column for the time; name one 'time'"),
        ("time,a,a\n0,1,2\n", "names the column 'a' more than once"),
        ("time,,a\n0,1,2\n", "has no name for its column 2"),
        ("only words here\n", "has no header line of column names"),
        ("time,left_x,left_y,left_z\n0,1,2\n", "row 1: has 3 cells where the header names 4 columns"),
        ("time,left_x,left_y,left_z\n0,1,2,3\n1,1,2,oops\n", "row 2: column 'left_z' holds 'oops', which is no number"),
        ("time,left_x,left_y,left_z\nnever,1,2,3\n", "row 1: its time, column 'time', is 'never', which is none"),
        ("time,left_x,left_y,left_z\nnan,1,2,3\n", "row 1: its time, column 'time', is 'nan'"),
        ("time,left_x,left_y,left_z\n1e300,1,2,3\n", "row 1: its time"),
        ("time,left_x,left_y,left_z\n1e999999999,1,2,3\n", "row 1: its time"),
        ("time,left_x,left_y,left_z\n1e99999999,1,2,3\n", "row 1: its time"),
        ("time,left_x,left_y\n0,1,2\n", "has no column 'left_z'"),
        ("time,left_x,left_y,left_z\n0,1,2,3\n" + '"', "damaged|cells"),
    ],
)
def test_what_is_wrong_with_a_csv_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DataError, match=message) as caught:
        read(write_text(tmp_path / "a.csv", text))
    assert caught.value.source.startswith("a.csv")


def test_topics_and_rows_that_are_not_there(tmp_path: Path, arms: Arms) -> None:
    path = writers.write(tmp_path, "csv", "", arms)
    with pytest.raises(DataError, match="its one topic is 'table', not '/left'"):
        read(path, Request(topic="/left", extract=Columns(), width=3))
    with pytest.raises(DataError, match="row 1: does not hold what is selected of it"):
        read(path, Request(topic="table", extract=Columns("left_x"), width=2, columns=("left_x",)))


def damaged_set(path: Path, what: str) -> Path:
    writers.write_lerobot(path, [writers.two_arms(10, rate=50), writers.two_arms(10, rate=50)])
    info = path / "meta" / "info.json"
    content = json.loads(info.read_text())
    if what == "old":
        info.write_text(json.dumps(content | {"codebase_version": "v1.6"}))
    elif what == "no data":
        for file in (path / "data").rglob("*.parquet"):
            file.unlink()
    elif what == "one missing":
        (path / "data" / "chunk-000" / "episode_000001.parquet").unlink()
    elif what == "no rate":
        info.write_text(json.dumps(content | {"fps": 0}))
    elif what == "no json":
        info.write_text("{")
    elif what == "pointer":
        file = path / "data" / "chunk-000" / "episode_000001.parquet"
        file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    return path


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("old", r"set: is a LeRobot data set v1.6; v2.1 and v3 are read"),
        ("no data", r"set: has no data/chunk-\*/\*.parquet: only its description is here"),
        ("one missing", r"set: has 1 of the 2 episodes of meta/info.json"),
        ("no rate", r"set: meta/info.json says 0 frames a second"),
        ("no json", r"set: is damaged .*fetch the data set again"),
        ("pointer", r"episode_000001.parquet: is a Git LFS pointer"),
    ],
)
def test_what_is_wrong_with_a_lerobot_folder_is_named(tmp_path: Path, what: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        open_recording(damaged_set(tmp_path / "set", what))
