"""Made motions in space: two LASA motions drawn at once, the first coordinate of the second as depth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

from pipeline.errors import DataError, ParameterError
from pipeline.stage import StageContext
from stages.artifacts.demonstrations import read_demonstrations
from stages.ingest.lasa import in_space, ingest, locate, motion_file, read_lasa
from stages.ingest.parameters import LasaParameters
from stages.ingest.stage import STAGE
from stages.midpoint.midpoint import to_trajectories
from stages.midpoint.parameters import MidpointParameters
from stages.trajectory import ArmRecording, Array, Demonstration


def demonstration(time: Array, position: Array, dataset: str = "Flat", demo: str = "1") -> Demonstration:
    return Demonstration(
        dataset=dataset, demo=demo, split="train", arms={"point": ArmRecording(time=time, position=position)}
    )


def write(folder: Path, motions: Mapping[str, list[tuple[Array, Array]]]) -> Path:
    """A folder of LASA files: for each motion pairs of times, shape (n,), s, and positions, shape (d, n), mm."""
    folder.mkdir(exist_ok=True)
    for name, pairs in motions.items():
        cells = np.empty((1, len(pairs)), dtype=object)
        for index, (time, position) in enumerate(pairs):
            cells[0, index] = {"pos": position, "t": time[None, :]}
        savemat(folder / f"{name}.mat", {"demos": cells, "dt": 0.01})
    return folder


def straight(samples: int, duration: float, top: float = 10.0) -> tuple[Array, Array]:
    """A motion to the origin at constant speed, from (top, 2 top) mm."""
    left = np.linspace(1.0, 0.0, samples)
    return np.linspace(0.0, duration, samples), np.vstack([top * left, 2.0 * top * left])


def test_depth_is_the_first_coordinate_at_the_same_fraction_of_the_time() -> None:
    flat = demonstration(np.array([1.0, 2.0, 3.0]), np.array([[0.4, 0.1], [0.2, 0.3], [0.0, 0.0]]))
    # In a quarter of its time the other falls from 8 to 4, then to 0: half-way through it is at 8/3.
    depth = demonstration(np.array([0.0, 0.5, 2.0]), np.array([[8.0, 9.0], [4.0, 9.0], [0.0, 9.0]]), "Deep", "7")
    made = in_space(flat, depth)
    assert (made.dataset, made.demo, made.split) == ("Flat+Deep", "1", "train")
    point = made.arms["point"]
    assert point.time.tolist() == [1.0, 2.0, 3.0]
    assert point.position == pytest.approx(np.array([[0.4, 0.1, 8.0], [0.2, 0.3, 8.0 / 3.0], [0.0, 0.0, 0.0]]))


@given(st.integers(2, 40), st.integers(2, 40), st.floats(0.1, 10.0), st.floats(0.1, 10.0), st.integers(0, 2**32 - 1))
def test_depth_keeps_the_plane_the_clock_and_the_ends(n: int, m: int, one: float, other: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    flat = demonstration(one * np.arange(float(n)), generator.normal(size=(n, 2)))
    depth = demonstration(3.0 + other * np.arange(float(m)), generator.normal(size=(m, 2)), "Deep")
    point, deep = in_space(flat, depth).arms["point"], depth.arms["point"].position[:, 0]
    assert point.position.shape == (n, 3)
    assert np.array_equal(point.position[:, :2], flat.arms["point"].position)
    assert np.array_equal(point.time, flat.arms["point"].time)
    assert (point.position[0, 2], point.position[-1, 2]) == (deep[0], deep[-1])
    assert deep.min() <= point.position[:, 2].min()
    assert point.position[:, 2].max() <= deep.max()


def test_two_installed_motions_end_at_the_origin_of_space() -> None:
    parameters = LasaParameters(motion="Angle", depth="Sine")
    files = locate(parameters, Path())
    assert list(files) == ["Angle.mat", "Sine.mat"]
    demonstrations, counts = ingest(files, parameters, lambda sentence: pytest.fail(sentence))
    assert counts == {}
    assert [d.demo for d in demonstrations] == list("1234567")
    assert [d.split for d in demonstrations] == ["train"] * 3 + ["test"] * 4
    flat = read_lasa(motion_file("Angle", None), parameters)
    deep = read_lasa(motion_file("Sine", None), parameters)
    for made, one, other in zip(demonstrations, flat, deep, strict=True):
        assert made.dataset == "Angle+Sine"
        position = made.arms["point"].position
        assert np.array_equal(position[:, :2], one.arms["point"].position)
        assert position[0, 2] == other.arms["point"].position[0, 0]
        assert position[-1].tolist() == [0.0, 0.0, 0.0]
    found = to_trajectories(demonstrations, MidpointParameters())
    assert found.goal == pytest.approx(np.zeros(3), abs=1e-12)
    assert {t.dimension for t in found.trajectories} == {3}


def test_a_motion_may_be_its_own_depth() -> None:
    parameters = LasaParameters(motion="Line", depth="Line")
    files = locate(parameters, Path())
    assert list(files) == ["Line.mat"]
    demonstrations, _ = ingest(files, parameters, lambda _: None)
    for made in demonstrations:
        position = made.arms["point"].position
        assert position[:, 2] == pytest.approx(position[:, 0], abs=1e-15)


def test_without_a_depth_the_motion_stays_as_it_was_recorded() -> None:
    parameters = LasaParameters(motion="Line")
    files = locate(parameters, Path())
    assert list(files) == ["Line.mat"]
    demonstrations, _ = ingest(files, parameters, lambda _: None)
    assert {d.dataset for d in demonstrations} == {"Line"}
    assert {d.arms["point"].position.shape[1] for d in demonstrations} == {2}


def test_files_of_a_folder_may_have_other_lengths(tmp_path: Path) -> None:
    write(
        tmp_path / "data",
        {"Flat": [straight(5, 2.0)] * 2, "Deep": [straight(9, 7.0, top=40.0), straight(3, 0.5, top=80.0)]},
    )
    parameters = LasaParameters(motion="Flat", depth="Deep", folder="data", train=(1, 2))
    demonstrations, _ = ingest(locate(parameters, tmp_path), parameters, lambda _: None)
    # Both at constant speed: depth falls as the fraction of time does, from 40 mm and from 80 mm.
    for made, top in zip(demonstrations, (0.04, 0.08), strict=True):
        assert made.arms["point"].position[:, 2] == pytest.approx(top * np.linspace(1.0, 0.0, 5))


def test_the_stage_writes_and_reads_what_it_made(tmp_path: Path) -> None:
    write(tmp_path / "data", {"Flat": [straight(5, 2.0)] * 2, "Deep": [straight(9, 7.0)] * 2})
    parameters = LasaParameters(motion="Flat", depth="Deep", folder="data", train=(1,))
    sources = STAGE.sources(parameters, tmp_path)
    assert set(sources) == {"Flat.mat", "Deep.mat"}
    outputs = {"demonstrations": tmp_path / "demonstrations.parquet"}
    STAGE.run(StageContext(stage="ingest", parameters=parameters, inputs={}, sources=sources, outputs=outputs))
    first, second = read_demonstrations(outputs["demonstrations"])
    assert (first.dataset, first.split, second.split) == ("Flat+Deep", "train", "test")
    assert first.arms["point"].position[0] == pytest.approx([0.01, 0.02, 0.01])


# --- what is refused ------------------------------------------------------------------------------------------------


def test_an_unknown_depth_is_refused_by_its_own_name() -> None:
    with pytest.raises(ParameterError, match="did you mean 'Sine'") as error:
        locate(LasaParameters(motion="Angle", depth="Sin"), Path())
    assert error.value.location == "ingest.depth"
    with pytest.raises(ParameterError, match="there is no motion 'Agnle'") as error:
        locate(LasaParameters(motion="Agnle", depth="Sine"), Path())
    assert error.value.location == "ingest.motion"


def test_a_depth_that_is_not_in_the_folder_is_refused_with_what_is_there(tmp_path: Path) -> None:
    write(tmp_path / "data", {"Flat": [straight(5, 2.0)] * 2})
    with pytest.raises(ParameterError, match=r"there is no motion 'Sine'; Valid: Flat\.$") as error:
        locate(LasaParameters(motion="Flat", depth="Sine", folder="data"), tmp_path)
    assert error.value.location == "ingest.depth"


def test_a_spoilt_depth_is_named(tmp_path: Path) -> None:
    time, position = straight(5, 2.0)
    spoilt = position.copy()
    spoilt[0, 3] = np.nan
    write(tmp_path / "data", {"Flat": [straight(5, 2.0)] * 2, "Deep": [(time, position), (time, spoilt)]})
    parameters = LasaParameters(motion="Flat", depth="Deep", folder="data", train=(1, 2))
    with pytest.raises(DataError, match="position is not a finite number at sample 4") as error:
        ingest(locate(parameters, tmp_path), parameters, lambda _: None)
    assert error.value.source == "Deep.mat, demonstration 2"


def test_a_depth_with_too_few_demonstrations_to_learn_from_is_named(tmp_path: Path) -> None:
    write(tmp_path / "data", {"Flat": [straight(5, 2.0)] * 3, "Deep": [straight(5, 2.0)] * 2})
    parameters = LasaParameters(motion="Flat", depth="Deep", folder="data", train=(1, 3))
    with pytest.raises(ParameterError, match=r"no demonstration 3; Deep\.mat has 1 to 2") as error:
        ingest(locate(parameters, tmp_path), parameters, lambda _: None)
    assert error.value.location == "ingest.train"


def test_a_depth_of_a_motion_in_space_is_refused(tmp_path: Path) -> None:
    time, position = straight(5, 2.0)
    in_the_file = np.vstack([position, position[:1]])
    write(tmp_path / "data", {"Space": [(time, in_the_file)] * 2, "Deep": [straight(5, 2.0)] * 2})
    parameters = LasaParameters(motion="Space", depth="Deep", folder="data", train=(1, 2))
    with pytest.raises((ParameterError, DataError), match="coordinates"):
        ingest(locate(parameters, tmp_path), parameters, lambda _: None)
