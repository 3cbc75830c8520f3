"""Experiments: experiment.toml, presets, dotted overrides and a sweep, resolved into points of validated parameters.

An experiment file has ``description``, ``preset``, ``seed``, a table for each stage, and a table ``sweep`` whose keys
are dotted names and whose values are lists. Nothing is run here and no artifact is read.
"""

from __future__ import annotations

import copy
import datetime
import itertools
import json
import math
import re
import shlex
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.errors import ParameterError, UsageError, choices
from pipeline.stage import Stage
from pipeline.validation import validate

PRESETS = ("robust", "paper")
DEFAULT_PRESET = "robust"
FILE = "experiment.toml"
MOST_POINTS = 10_000
"""More than this in a sweep is taken for a mistake."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True, kw_only=True)
class Point:
    """One point of a sweep, or the only one of an experiment without a sweep.

    Attributes:
        id: e.g. ``main``, ``motion=Angle`` or ``motion=Angle,seed=1``.
        overrides: dotted name -> value, as the sweep gives them.
        seed: its seed.
        parameters: stage -> validated parameters.
    """

    id: str
    overrides: Mapping[str, Any]
    seed: int
    parameters: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A resolved experiment.

    Attributes:
        name: of its folder.
        folder: below ``runs``.
        description: in its own words.
        preset: whose values apply where it gives none.
        points: of its sweep, or the only one.
        overridden: options of the command line changed it, and its manifest is not its own.
        options: those options, in words.
    """

    name: str
    folder: Path
    description: str
    preset: str
    points: tuple[Point, ...]
    overridden: bool = False
    options: tuple[str, ...] = ()

    def command(self, verb: str) -> str:
        """What to type to have this very experiment, e.g. ``clpv run letters --set mixture.alpha=3``."""
        return shlex.join(["clpv", verb, self.name, *self.options])

    @property
    def manifest_path(self) -> Path:
        """Where its manifest lies."""
        return self.folder / "manifest.json"


def find_root(start: Path) -> Path:
    """The nearest folder, from `start` upward, that holds `runs` with an experiment; `start` where there is none."""
    for folder in (start, *start.parents):
        if next(iter(folder.glob(f"runs/*/{FILE}")), None) is not None:
            return folder
    return start


def experiment_names(root: Path) -> list[str]:
    """Names of the experiments of a project, sorted."""
    return sorted(path.parent.name for path in root.glob(f"runs/*/{FILE}"))


def load_experiment(
    root: Path, name: str, stages: Sequence[Stage], sets: Iterable[str] = (), seed: int | None = None
) -> Experiment:
    """Read and resolve ``runs/<name>/experiment.toml``.

    Raises UsageError where there is no such experiment or no TOML in it, ParameterError (dotted location) for an
    unknown name, a wrong type or a wrong value.
    """
    names = experiment_names(root)
    if name not in names:
        known = f"; {choices(name, names)}" if names else ", nor any other: make one with 'clpv new NAME'."
        raise UsageError(f"There is no experiment {name!r}{known}")
    path = root / "runs" / name / FILE
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:  # not TOML, not UTF-8, a number of thousands of digits
        raise UsageError(f"runs/{name}/{FILE} is not valid TOML: {error}.") from None
    except OSError as error:
        raise UsageError(f"runs/{name}/{FILE} cannot be read: {error.strerror}.") from None
    given = list(sets)
    changes = [parse_override(text) for text in given]
    options = [word for text in given for word in ("--set", text)]
    if seed is not None:
        changes.append(("seed", seed))
        options += ["--seed", str(seed)]
    return replace(resolve(name, path.parent, document, stages, changes), options=tuple(options))


def resolve(
    name: str,
    folder: Path,
    document: Mapping[str, Any],
    stages: Sequence[Stage],
    changes: Sequence[tuple[str, Any]] = (),
) -> Experiment:
    """Resolve a parsed experiment file: overrides, then the sweep, then presets and validation, point by point."""
    table = _undated(document)
    varied = ["preset", "seed", *(stage.name for stage in stages)]
    allowed = ["description", "sweep", *varied]
    for key in table:
        if key not in allowed:
            raise ParameterError(key, f"unknown table or key; {choices(key, allowed)}")
    for location, value in changes:
        _assign(table, location, value, allowed)
    description = table.pop("description", "")
    if not isinstance(description, str):
        raise ParameterError("description", "must be a text.")
    preset = _preset(table)
    points: dict[str, Point] = {}
    for overrides in _grid(table.pop("sweep", {}), [location for location, _ in changes]):
        own = copy.deepcopy(table)
        for location, value in overrides.items():
            _assign(own, location, value, varied)
        point = _point(own, overrides, stages)
        if point.id in points:
            raise ParameterError("sweep", f"two of its points would be called {point.id!r}: write the values apart.")
        points[point.id] = point
    return Experiment(
        name=name,
        folder=folder,
        description=description,
        preset=preset,
        points=tuple(points.values()),
        overridden=bool(changes),
    )


def parse_override(text: str) -> tuple[str, Any]:
    """Split ``a.b=value``; the value is TOML where it is (numbers, lists, booleans, quoted texts), else a text."""
    location, separator, value = text.partition("=")
    if not separator or not location.strip():
        raise UsageError(f"--set {text}: write it as name=value, e.g. --set mixture.alpha=3.")
    try:
        (found,) = tomllib.loads(f"value = {value}").values()
    except (ValueError, RecursionError):
        return location.strip(), value.strip()
    dated = isinstance(found, datetime.date | datetime.time)
    return location.strip(), value.strip() if dated else found


def _undated(document: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a parsed file in which the dates and times that TOML knows are texts, as parameters know none."""
    copied: dict[str, Any] = json.loads(json.dumps(document, default=str))
    return copied


def _point(table: dict[str, Any], overrides: Mapping[str, Any], stages: Sequence[Stage]) -> Point:
    seed = table.get("seed", 0)
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise ParameterError("seed", f"must be a whole number from 0, not {seed!r}.")
    preset = _preset(table)
    resolved = {}
    for stage in stages:
        given = table.get(stage.name, {})
        if not isinstance(given, dict):
            raise ParameterError(stage.name, "must be a table of parameters.")
        resolved[stage.name] = validate(stage, _with_preset(given, stage.preset(preset, given)))
    return Point(id=_label(overrides), overrides=dict(overrides), seed=seed, parameters=resolved)


def _preset(table: Mapping[str, Any]) -> str:
    """The preset that a table names. Raises ParameterError."""
    preset = table.get("preset", DEFAULT_PRESET)
    if preset not in PRESETS:
        raise ParameterError("preset", f"there is no preset {preset!r}; {choices(str(preset), PRESETS)}")
    return str(preset)


def _with_preset(given: Mapping[str, Any], preset: Mapping[str, Any]) -> dict[str, Any]:
    """The preset's parameters below the given ones; a preset speaks only of its own kind."""
    if "kind" in given and "kind" in preset and given["kind"] != preset["kind"]:
        return dict(given)
    merged = {**preset, **given}
    for name, value in preset.items():
        if isinstance(value, Mapping) and isinstance(given.get(name), Mapping):
            merged[name] = _with_preset(given[name], value)
    return merged


def _grid(sweep: Any, overridden: Sequence[str]) -> list[dict[str, Any]]:
    """All combinations of a sweep's axes, the last axis fastest; an axis that the command line sets is no axis."""
    if not isinstance(sweep, dict):
        raise ParameterError("sweep", "must be a table from dotted parameter names to lists.")
    axes = {}
    for location, values in _axes(sweep).items():
        if not isinstance(values, list) or not values:
            raise ParameterError(f"sweep.{location}", "must be a list with at least one value.")
        if len({json.dumps(value, sort_keys=True) for value in values}) < len(values):
            raise ParameterError(f"sweep.{location}", "names a value twice.")
        if location not in overridden:
            axes[location] = values
    count = math.prod(map(len, axes.values()))
    if count > MOST_POINTS:
        raise ParameterError("sweep", f"has {count} points; at most {MOST_POINTS} are taken.")
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


def _axes(sweep: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Axes by dotted name, whether written ``"a.b" = […]`` or ``a.b = […]``."""
    axes: dict[str, Any] = {}
    for key, value in sweep.items():
        location = f"{prefix}{key}"
        axes.update(_axes(value, f"{location}.") if isinstance(value, dict) else {location: value})
    return axes


def _label(overrides: Mapping[str, Any]) -> str:
    """Short: the last part of each dotted name where that is clear, and the value."""
    if not overrides:
        return "main"
    short = [location.rpartition(".")[2] for location in overrides]
    labels = [tail if short.count(tail) == 1 else location for tail, location in zip(short, overrides, strict=True)]
    texts = [value if isinstance(value, str) else json.dumps(value) for value in overrides.values()]
    return ",".join(f"{label}={text}" for label, text in zip(labels, texts, strict=True))


def _assign(document: dict[str, Any], location: str, value: Any, allowed: Sequence[str]) -> None:
    """Set a dotted name; numbers index lists, missing tables are made. Modifies `document`."""
    parts = location.split(".")
    if parts[0] not in allowed or parts[0] == "sweep":
        valid = [name for name in allowed if name != "sweep"]
        raise ParameterError(location, f"unknown stage or key; {choices(parts[0], valid)}")
    here: Any = document
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        if isinstance(here, list):
            index = int(part) if part.isdecimal() else -1
            if not 0 <= index < len(here):
                where = ".".join(parts[:depth])
                raise ParameterError(location, f"{where} is a list of {len(here)}: number its items from 0.")
            if last:
                here[index] = value
            else:
                here = here[index]
        elif isinstance(here, dict):
            if last:
                here[part] = value
            else:
                here = here.setdefault(part, {})
        else:
            raise ParameterError(location, f"{'.'.join(parts[:depth])} is a value and has no parts.")
