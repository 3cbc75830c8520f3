"""Bad input, as a user meets it: one sentence, an exit code, no traceback, and nothing left behind."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from support import Invoke

Demos = list[dict[str, np.ndarray[Any, Any]]]

EXPERIMENT = """
preset = "robust"
[ingest]
kind = "lasa"
motion = "Curve"
folder = "data"
"""


def good_demos(count: int = 7, samples: int = 120) -> Demos:
    """Curves that end at the origin, in LASA's units and shapes."""
    demos = []
    for number in range(count):
        t = np.linspace(0.0, 2.0, samples)
        left = 1.0 - t / t[-1]
        pos = np.vstack([40.0 * left, (20.0 + number) * left**2])
        demos.append({"pos": pos, "t": t[None, :], "dt": np.array([[t[1]]])})
    return demos


def write(root: Path, demos: Demos, experiment: str = EXPERIMENT) -> Path:
    """A project with one experiment on a folder of .mat files."""
    (root / "data").mkdir(parents=True)
    (root / "runs" / "curve").mkdir(parents=True)
    (root / "runs" / "curve" / "experiment.toml").write_text(experiment)
    cells = np.empty((1, len(demos)), dtype=object)
    for index, demo in enumerate(demos):
        cells[0, index] = demo
    savemat(root / "data" / "Curve.mat", {"demos": cells, "dt": 0.01})
    return root


def refused(clpv: Invoke, root: Path, code: int, *expected: str, arguments: tuple[str, ...] = ()) -> str:
    """Run, and check that it is refused in one sentence that says all of `expected`; returns the sentence."""
    before = tree(root)
    result = clpv(root, "run", "curve", *arguments)
    assert result.exit_code == code, result.output
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1, result.stderr
    assert "Traceback" not in result.output
    for text in expected:
        assert text in lines[0]
    assert str(root) not in lines[0], "an absolute path is nothing for a message"
    left = {path for path in tree(root) - before if not path.startswith("runs/.store")}
    assert left == set()
    assert not list(root.glob("runs/.store/tmp/*"))
    return lines[0]


def tree(root: Path) -> set[str]:
    return {path.relative_to(root).as_posix() for path in root.rglob("*")}


def test_the_good_case_is_good(tmp_path: Path, clpv: Invoke) -> None:
    result = clpv(write(tmp_path, good_demos()), "run", "curve")
    assert result.exit_code == 0, result.output


def put_nan(demos: Demos) -> None:
    demos[4]["pos"][1, 17] = np.nan


def stand_still(demos: Demos) -> None:
    demos[1]["pos"][:] = demos[1]["pos"][:, :1]


def repeat_a_time(demos: Demos) -> None:
    demos[2]["t"][0, 50] = demos[2]["t"][0, 49]


def step_back(demos: Demos) -> None:
    demos[2]["t"][0, 50] = demos[2]["t"][0, 40]


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (put_nan, ("Curve", "5")),
        (stand_still, ("Curve", "2", "move")),
        (repeat_a_time, ("Curve", "3", "time")),
        (step_back, ("Curve", "3", "time")),
    ],
)
def test_a_spoilt_demonstration_is_named(
    tmp_path: Path, clpv: Invoke, spoil: Callable[[Demos], None], expected: tuple[str, ...]
) -> None:
    demos = good_demos()
    spoil(demos)
    refused(clpv, write(tmp_path, demos), 1, *expected)


def test_fewer_than_two_demonstrations(tmp_path: Path, clpv: Invoke) -> None:
    root = write(tmp_path, good_demos(1))
    refused(clpv, root, 1, "two", arguments=("--set", "ingest.train=[1]"))


def test_goal_outside_the_data(tmp_path: Path, clpv: Invoke) -> None:
    root = write(tmp_path, good_demos(), EXPERIMENT + "[midpoint]\ngoal = [5.0, 5.0]\n")
    refused(clpv, root, 2, "midpoint.goal")


def test_unknown_motion_lists_the_valid_ones(tmp_path: Path, clpv: Invoke) -> None:
    root = write(tmp_path, good_demos(), EXPERIMENT.replace('folder = "data"\n', "").replace("Curve", "Angel"))
    sentence = refused(clpv, root, 2, "ingest.motion", "'Angle'", "Sharpc", "Multi_Models_4")
    assert re.search(r"did you mean 'Angle'\?", sentence)


def test_missing_folder(tmp_path: Path, clpv: Invoke) -> None:
    refused(
        clpv, write(tmp_path, good_demos(), EXPERIMENT.replace('"data"', '"nowhere"')), 2, "ingest.folder", "nowhere"
    )


@pytest.mark.parametrize("keep", [0, 1, 100, 0.5, 0.99])
def test_cut_file(tmp_path: Path, clpv: Invoke, keep: float) -> None:
    root = write(tmp_path, good_demos())
    path = root / "data" / "Curve.mat"
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep if keep >= 1 else keep * len(whole))])
    refused(clpv, root, 1, "Curve.mat")


def test_file_that_is_no_matlab_file(tmp_path: Path, clpv: Invoke) -> None:
    root = write(tmp_path, good_demos())
    (root / "data" / "Curve.mat").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    refused(clpv, root, 1, "Curve.mat")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("mixture.sweps=3", ("mixture.sweps", "did you mean 'sweeps'?")),
        ("mixture={kind='pcgmm', alfa=3.0}", ("mixture.alfa", "did you mean 'alpha'?")),
        ("mixtur.alpha=3.0", ("mixtur.alpha", "did you mean 'mixture'?")),
        ("dynamics.margin=high", ("dynamics.margin", "number")),
        ("mixture.sweeps=2.5", ("mixture.sweeps", "integer")),
        ("mixture.kind=pcgm", ("mixture.kind", "did you mean 'pcgmm'?")),
        ("dynamics.margin=nan", ("dynamics.margin", "finite")),
        ("dynamics.straightening=[1.0]", ("dynamics.straightening.0", "less than 1")),
        ("dynamics={kind='pqlf', condition=0.5}", ("dynamics.condition", "greater than or equal to 1")),
        ("mixture.components=[0]", ("mixture.components.0",)),
        ("dynamics.margin=0.0", ("dynamics.margin", "greater than 0")),
        ("rollout.stop_distance=-1.0", ("rollout.stop_distance",)),
        ("rollout.conditions=[{name='a', displacement=[0.0, 0.0, 1.0]}]", ("rollout.conditions.0.displacement",)),
        ("rollout.controllers=[{kind='clpvds', mode='paper', gate=0.0}]", ("rollout.controllers.0.gate", "robust")),
        ("ingest.train=[1, 9]", ("ingest.train", "9")),
        ("preset=papre", ("preset", "did you mean 'paper'?")),
        ("seed=-1", ("seed",)),
    ],
)
def test_a_wrong_parameter_is_named(tmp_path: Path, clpv: Invoke, change: str, expected: tuple[str, ...]) -> None:
    refused(clpv, write(tmp_path, good_demos()), 2, *expected, arguments=("--set", change))


def test_unwritable_runs_folder(tmp_path: Path, clpv: Invoke) -> None:
    root = write(tmp_path, good_demos())
    (root / "runs" / ".store").write_text("a file where the store should be")
    refused(clpv, root, 1, ".store", "writable")
