"""Recordings in parquet: files with named columns, of numbers or of lists of numbers, and LeRobot data sets.

A LeRobot data set's clock is frame_index / fps, which its 32-bit ``timestamp`` repeats with seven digits. Foreign files
are read here, so this module alone of this stage imports pyarrow; the project's own tables are in `stages.artifacts`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import DataError
from stages.ingest.names import nearest
from stages.ingest.readers.message_files import beginning, damage
from stages.ingest.readers.row_files import PEEKED, UNITS, RowRecording, nanoseconds_in

BATCH = 4096
"""Rows of a parquet file that are held at a time."""

FLOAT32_STEPS = 1e-3
"""Seconds by which a LeRobot timestamp may differ from frame_index / fps, where both are the same clock."""


class ParquetRecording(RowRecording):
    """A parquet file with named columns, of numbers or of lists of numbers."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "parquet")
        with damage(path):
            self.types = _columns(path)
            self.columns = tuple(self.types)
            self.clock = self.find_clock()
            self.fields = tuple(f"{column}{suffix}" for column, suffix in self.types.items() if column != self.clock)
            peeked: list[float] = []
            for batch in _batches(path, [self.clock]):
                peeked = [float(value) for value in _clock_numbers(batch[self.clock])[:PEEKED]]
                break
            self.unit = 1 if _is_timestamp(path, self.clock) else nanoseconds_in(self.clock, peeked)

    def rows(self, columns: Sequence[str], episode: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Time in nanoseconds and values of the columns, row by row; a missing value is not a number (NaN)."""
        for batch in _batches(self.path, list(dict.fromkeys([self.clock, *columns]))):
            times = _nanoseconds(_clock_numbers(batch[self.clock]), self.unit, self.path.name)
            yield from zip(times, _mappings(batch, columns, len(times)), strict=True)


class LeRobotRecording(RowRecording):
    """A LeRobot data set, v2.1 (a file an episode) or v3 (several episodes a file); each episode is a demonstration."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "LeRobot")
        self.files: dict[str, list[Path]] = {}
        with damage(path, "fetch the data set again"):
            info = json.loads((path / "meta" / "info.json").read_text(encoding="utf-8"))
            self._open(info if isinstance(info, dict) else {})

    def _open(self, info: dict[str, Any]) -> None:
        version = str(info.get("codebase_version", "of no version"))
        if not version.startswith(("v2", "v3")):
            raise DataError(self.path.name, f"is a LeRobot data set {version}; v2.1 and v3 are read: convert it.")
        self.format = f"LeRobot {version}"
        self.fps = float(info["fps"])
        if not (math.isfinite(self.fps) and self.fps > 0):
            raise DataError(self.path.name, f"meta/info.json says {self.fps:g} frames a second, which is impossible.")
        files = sorted((self.path / "data").glob("chunk-*/*.parquet"))
        if not files:
            raise DataError(
                self.path.name, "has no data/chunk-*/*.parquet: only its description is here; fetch the data."
            )
        found: dict[int, list[Path]] = {}
        for file in files:
            beginning(file)
            for episode in self._episodes_in(file):
                found.setdefault(episode, []).append(file)
        total = info.get("total_episodes")
        if isinstance(total, int) and total != len(found):
            raise DataError(
                self.path.name, f"has {len(found)} of the {total} episodes of meta/info.json; fetch the data set whole."
            )
        self.files = {str(episode): found[episode] for episode in sorted(found)}
        with damage(files[0]):
            types = _columns(files[0])
        self.columns = tuple(types)
        self.clock = "frame_index" if "frame_index" in types else self.find_clock()
        self.fields = tuple(f"{column}{suffix}" for column, suffix in types.items())
        self.names = _element_names(info.get("features"))

    def _episodes_in(self, file: Path) -> list[int]:
        with damage(file, "fetch the data set again"):
            if "episode_index" in _columns(file):
                found: set[int] = set()
                for batch in _batches(file, ["episode_index"]):
                    found.update(int(value) for value in np.unique(batch["episode_index"]))
                return sorted(found)
        match = re.fullmatch(r"episode_(\d+)", file.stem)
        if match is None:
            raise DataError(file.name, "has no column episode_index, and no number of an episode in its name.")
        return [int(match[1])]

    def episodes(self) -> list[str]:
        """Their numbers, as text."""
        return list(self.files)

    def rows(self, columns: Sequence[str], episode: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Time in nanoseconds from the episode's start and values of the columns, row by row."""
        for file in self.files[episode]:
            with damage(file, "fetch the data set again"):
                there = _columns(file)
                if missing := [column for column in (self.clock, *columns) if column not in there]:
                    raise DataError(file.name, f"has no column {missing[0]!r}; {nearest(missing[0], there)}")
                extra = [name for name in ("episode_index", "timestamp") if name in there]
                for batch in _batches(file, list(dict.fromkeys([self.clock, *columns, *extra]))):
                    yield from self._batch_rows(batch, columns, episode, file.name)

    def _batch_rows(
        self, batch: dict[str, Any], columns: Sequence[str], episode: str, source: str
    ) -> Iterator[tuple[int, Mapping[str, Any]]]:
        if "episode_index" in batch:
            mine = np.flatnonzero(np.asarray(batch["episode_index"]) == int(episode))
            batch = {name: values[mine] for name, values in batch.items()}
        clock = _clock_numbers(batch[self.clock])
        if not len(clock):
            return
        if self.clock == "frame_index":
            times = clock / self.fps
            stamps = batch.get("timestamp")
            if stamps is not None and not np.allclose(stamps, times, rtol=1e-6, atol=FLOAT32_STEPS):
                times = np.asarray(stamps, dtype=np.float64)
            nanoseconds = _nanoseconds(times, UNITS["s"], source)
        else:
            nanoseconds = _nanoseconds(clock, nanoseconds_in(self.clock, clock[:PEEKED].tolist()), source)
        yield from zip(nanoseconds, _mappings(batch, columns, len(clock)), strict=True)


def _element_names(features: Any) -> dict[str, tuple[str, ...]]:
    """Names of the elements of each feature: a list of names, or a mapping that holds one (``motors``)."""
    found: dict[str, tuple[str, ...]] = {}
    for column, feature in features.items() if isinstance(features, dict) else ():
        names = feature.get("names") if isinstance(feature, dict) else None
        if isinstance(names, dict):
            inner = list(names.values())
            names = inner[0] if len(inner) == 1 and isinstance(inner[0], list) else list(names)
        if isinstance(names, list) and all(isinstance(name, str) for name in names):
            found[str(column)] = tuple(names)
    return found


def _columns(path: Path) -> dict[str, str]:
    """Name -> suffix (``""``, ``[7]`` or ``[]``) of the columns of numbers and of lists of numbers."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    found: dict[str, str] = {}
    for field in pq.read_schema(path):
        kind, suffix = field.type, ""
        if pa.types.is_fixed_size_list(kind):
            kind, suffix = kind.value_type, f"[{kind.list_size}]"
        elif pa.types.is_list(kind) or pa.types.is_large_list(kind):
            kind, suffix = kind.value_type, "[]"
        number = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)
        if number or (not suffix and pa.types.is_timestamp(kind)):
            found[field.name] = suffix
    return found


def _is_timestamp(path: Path, column: str) -> bool:
    import pyarrow as pa
    import pyarrow.parquet as pq

    return bool(pa.types.is_timestamp(pq.read_schema(path).field(column).type))


def _batches(path: Path, columns: list[str]) -> Iterator[dict[str, Any]]:
    """Columns as arrays (lists as arrays of arrays), a few thousand rows at a time."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        for batch in file.iter_batches(batch_size=BATCH, columns=columns, use_threads=False):
            found: dict[str, Any] = {}
            for name, column in zip(batch.schema.names, batch.columns, strict=True):
                if pa.types.is_timestamp(column.type):
                    column = column.cast(pa.timestamp("ns", column.type.tz)).cast(pa.int64())
                found[name] = column.to_numpy(zero_copy_only=False)
            yield found


def _clock_numbers(values: Any) -> Any:
    if values.ndim != 1 or values.dtype.kind not in "iuf":
        raise ValueError("its clock is no column of numbers")
    return values


def _nanoseconds(values: Any, unit: int, source: str) -> list[int]:
    """Times of a column in nanoseconds; whole numbers exactly."""
    if values.dtype.kind in "iu":
        return [int(value) * unit for value in values.tolist()]
    if not np.isfinite(values).all():
        raise DataError(source, "has a row without a time; remove it.")
    if len(values) and float(np.abs(values).max()) * unit >= 2**63:
        raise DataError(source, "has times beyond what fits nanoseconds; check their unit.")
    return [round(value * unit) for value in values.astype(np.float64).tolist()]


def _mappings(batch: dict[str, Any], columns: Sequence[str], count: int) -> Iterator[Mapping[str, Any]]:
    """Row by row, a mapping from column to value."""
    if not columns:
        return ({} for _ in range(count))
    lists = [batch[name].tolist() if batch[name].dtype != object else batch[name] for name in columns]
    return (dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True))
