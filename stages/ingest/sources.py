"""The files of a recording experiment: which they are, what the store calls them, and their digests.

Light: this is asked whenever the state of an experiment is, and imports no reader.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.errors import DataError, ParameterError
from stages.ingest.parameters import RecordingParameters

UNREAD = frozenset({".mp4", ".mkv", ".avi", ".webm", ".png", ".jpg", ".jpeg"})
"""Suffixes of files in a folder that no reader reads: the cameras of a LeRobot data set can be most of its bytes."""


def locate(parameters: RecordingParameters, root: Path) -> Mapping[str, Path]:
    """Label -> file of all recordings (of a folder: all its files) and of the robot description.

    A label is the file's name, or its path as given where two have one name; behind a folder's stands the path in it.
    Raises ParameterError where selections or sources contradict each other, DataError where a file does not exist.
    """
    check_parameters(parameters)
    found: dict[str, Path] = {}
    for given, label in labels(parameters).items():
        path = root / given
        if not path.exists():
            raise DataError(given, "does not exist: name a file or a folder, relative to the project.")
        if path.is_file():
            found[label] = path
        else:
            found.update({f"{label}/{part.relative_to(path).as_posix()}": part for part in files_of(path)})
    return found


def regroup(parameters: RecordingParameters, files: Mapping[str, Path]) -> tuple[list[list[Path]], Path | None]:
    """The recordings of each source, and the robot description, among labelled files."""
    names = labels(parameters)

    def path(given: str) -> Path:
        label = names[given]
        if label in files:
            return files[label]
        inner = next(key for key in files if key.startswith(f"{label}/"))
        return files[inner].parents[inner[len(label) + 1 :].count("/")]

    groups = [[path(given) for given in source.files] for source in parameters.sources]
    return groups, None if parameters.urdf is None else path(parameters.urdf)


def labels(parameters: RecordingParameters) -> dict[str, str]:
    """File or folder as given -> its label; depends on the parameters alone."""
    given = [file for source in parameters.sources for file in source.files]
    given += [] if parameters.urdf is None else [parameters.urdf]
    names = [Path(file).name or "folder" for file in given]
    return {
        file: name if names.count(name) == 1 else Path(file).as_posix() for file, name in zip(given, names, strict=True)
    }


def files_of(folder: Path) -> list[Path]:
    """The files of a folder that a reader may read, sorted; hidden ones, films and pictures are none.

    Raises DataError where there are none.
    """
    found = [
        path
        for path in sorted(folder.rglob("*"))
        if path.is_file()
        and path.suffix.lower() not in UNREAD
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    ]
    if not found:
        raise DataError(folder.name, "the folder is empty: a recording is a file, or a folder with its files.")
    return found


def source_digest(path: Path) -> str:
    """sha256 of a file; of a folder over the sorted relative paths and digests of its files, one a line.

    Raises DataError where it cannot be read.
    """
    try:
        if path.is_file():
            with path.open("rb") as stream:
                return hashlib.file_digest(stream, "sha256").hexdigest()
        lines = [f"{part.relative_to(path).as_posix()} {source_digest(part)}\n" for part in files_of(path)]
    except OSError as error:
        raise DataError(path.name, f"cannot be read: {error.strerror}.") from None
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def check_digests(paths: Sequence[Path], expected: Sequence[str]) -> None:
    """Raise DataError where a file is not the one whose digest was given."""
    for path, digest in zip(paths, expected, strict=False):
        found = source_digest(path)
        if found != digest.lower():
            raise DataError(
                path.name,
                f"is not the recording that the experiment was made with: its sha256 is {found}, not {digest}; restore "
                "it, or correct ingest.sources.",
            )


def check_parameters(parameters: RecordingParameters) -> None:
    """Raise ParameterError where selections or sources are missing, too many or contradict each other."""
    arms = [name for name in ("left", "right") if getattr(parameters, name) is not None]
    if parameters.point is not None and arms:
        raise ParameterError("ingest.point", "does not go with left or right: select both arms, or a single point.")
    if parameters.point is None and len(arms) < 2:
        missing = "left" if "left" not in arms else "right"
        raise ParameterError(f"ingest.{missing}", "must be given: select both arms, or a single point.")
    if parameters.point is not None and (parameters.left_wrench or parameters.right_wrench):
        raise ParameterError("ingest.left_wrench", "does not go with a single point: select both arms.")
    if arms and parameters.left == parameters.right and any(len(source.files) == 1 for source in parameters.sources):
        raise ParameterError("ingest.right", "is the same selection as ingest.left: two arms are needed.")
    seen: set[str] = set()
    for index, source in enumerate(parameters.sources):
        place = f"ingest.sources.{index}"
        if len(source.files) > (1 if parameters.point is not None else 2):
            raise ParameterError(f"{place}.files", "names too many files: one, or one an arm.")
        if source.sha256 and len(source.sha256) != len(source.files):
            raise ParameterError(f"{place}.sha256", f"has {len(source.sha256)} digests of {len(source.files)} files.")
        for file in source.files:
            if Path(file).as_posix() in seen:
                raise ParameterError(f"{place}.files", f"{file!r} is named more than once.")
            seen.add(Path(file).as_posix())
