"""A new experiment from recordings: the text of its experiment.toml. Nothing is run or written here."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import UsageError
from stages.ingest.card import toml
from stages.ingest.sources import source_digest

PAIR = "+"
"""Joins two files, one an arm, into one source: ``left.bag+right.bag``."""


@dataclass(frozen=True, kw_only=True)
class Selections:
    """What the command line says about recordings; names as of `stages.ingest.parameters.RecordingParameters`."""

    left: str | None = None
    right: str | None = None
    point: str | None = None
    left_wrench: str | None = None
    right_wrench: str | None = None
    urdf: str | None = None
    clock: str | None = None
    scale: float | None = None
    recover: bool | None = None

    def given(self) -> dict[str, Any]:
        """Those that were given."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class NewSource:
    """A source as given: files relative to the project, their digests, and whether it is for testing."""

    files: tuple[str, ...]
    sha256: tuple[str, ...]
    test: bool


def new_sources(root: Path, given: Sequence[str], test: Sequence[str]) -> list[NewSource]:
    """Sources as the command line names them, from the current folder. Raises UsageError where one is not there."""
    unknown = [name for name in test if name not in given]
    if unknown:
        raise UsageError(f"--test {unknown[0]}: it is none of the sources; name it exactly as there.")
    sources = []
    for text in given:
        # A name that holds a plus is one file, if there is such a file.
        names = [text] if Path(text).exists() else text.split(PAIR)
        paths = [Path(name).resolve() for name in names]
        for name, path in zip(names, paths, strict=True):
            if not path.exists():
                raise UsageError(f"There is no file or folder {name!r}; two files, one an arm: left.bag+right.bag.")
        files = tuple(relative(root, str(path)) for path in paths)
        sources.append(NewSource(files=files, sha256=tuple(map(source_digest, paths)), test=text in test))
    return sources


def relative(root: Path, name: str) -> str:
    """A file or folder, given from the current folder, as the project names it; UsageError if it is not there."""
    path = Path(name).resolve()
    if not path.exists():
        raise UsageError(f"There is no file or folder {name!r}.")
    return Path(os.path.relpath(path, root.resolve())).as_posix()


def division(text: str | None) -> dict[str, Any] | None:
    """``pauses``, ``times:3.5,8`` or ``topic:/recording`` as parameters. Raises UsageError for anything else."""
    if text is None:
        return None
    kind, _, rest = text.partition(":")
    if kind in ("none", "pauses") and not rest:
        return {"kind": kind}
    if kind == "topic" and rest:
        return {"kind": kind, "topic": rest}
    if kind == "times":
        try:
            times = [float(part) for part in rest.split(",")]
        except ValueError:
            times = []
        if times and all(map(math.isfinite, times)):
            return {"kind": kind, "times": times}
    raise UsageError(f"--divide {text}: write pauses, times:3.5,8 (seconds) or topic:/recording.")


def experiment_text(
    name: str, sources: Sequence[NewSource], selections: Selections, divided: dict[str, Any] | None
) -> str:
    """The text of experiment.toml for these recordings; valid TOML whatever the names are."""
    lines = [
        f"description = {toml(f'{name}: a policy learned from {len(sources)} recording(s)')}",
        'preset = "robust"',
        "seed = 0",
        "",
        "[ingest]",
        'kind = "recording"',
        f"dataset = {toml(name)}",
        *(f"{key} = {toml(value)}" for key, value in selections.given().items()),
    ]
    if divided is not None:
        inner = ", ".join(f"{key} = {toml(value)}" for key, value in divided.items())
        lines.append(f"division = {{ {inner} }}")
    for source in sources:
        lines += [
            "",
            "[[ingest.sources]]",
            f"files = {toml(list(source.files))}",
            f"sha256 = {toml(list(source.sha256))}",
        ]
        if source.test:
            lines.append('split = "test"')
    lines += [
        "",
        "# Windows as fractions of the duration: sensors are noisier than a tablet. 0 leaves positions as recorded.",
        "[midpoint]",
        "smoothing = 0.02",
        "velocity_window = 0.02",
        "",
        '# Two simulated arms that carry a box, instead of all that follows here: kind = "bullet".',
        "[rollout]",
        "controllers = [",
        '    { kind = "lpvds" },',
        '    { kind = "clpvds" },',
        "]",
        "# A push: a displacement of the executed state, metres, one number a coordinate, at half the path:",
        '# { name = "push", disturbances = [{ kind = "displacement", offset = [0.0, 0.0, 0.05] }] },',
        "# A ball on the way, where it is and how large, metres:",
        '# { name = "ball", obstacles = [{ kind = "sphere", centre = [0.5, 0.0, 0.3], radius = 0.1 }] },',
        'conditions = [{ name = "none" }]',
    ]
    return "\n".join(lines) + "\n"
