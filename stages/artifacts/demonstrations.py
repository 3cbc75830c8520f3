"""demonstrations.parquet: what the arms did, as recorded. Written by ingest, read by midpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stages.artifacts.parquet import Column, Schema, read, runs, vectors, write
from stages.trajectory import ArmRecording, Array, Demonstration

SCHEMA = Schema(
    name="demonstrations",
    version=1,
    columns=(
        Column(name="dataset", type="label"),
        Column(name="demo", type="label"),
        Column(name="split", type="label"),
        Column(name="arm", type="label"),
        Column(name="t", unit="s"),
        *vectors("", "m"),
        *vectors("q", "1", "xyzw"),
        *vectors("f", "N"),
    ),
)


def write_demonstrations(path: Path, demonstrations: Sequence[Demonstration], details: Mapping[str, Any]) -> None:
    """Write demonstrations in order, arm after arm; a coordinate, orientation or force that was not recorded is nan.

    Arguments:
        details: plain values about how they were made, kept as metadata.
    """
    parts: dict[str, list[Array]] = {column.name: [] for column in SCHEMA.columns if column.type == "float"}
    labels: dict[str, list[str]] = {"dataset": [], "demo": [], "split": [], "arm": []}
    for demonstration in demonstrations:
        for arm, recording in demonstration.arms.items():
            count = recording.time.shape[0]
            for name, value in zip(
                labels, (demonstration.dataset, demonstration.demo, demonstration.split, arm), strict=True
            ):
                labels[name].extend([value] * count)
            parts["t"].append(recording.time)
            _append(parts, ("x", "y", "z"), recording.position, count)
            _append(parts, ("qx", "qy", "qz", "qw"), recording.quaternion, count)
            _append(parts, ("fx", "fy", "fz"), recording.force, count)
    columns = {name: np.concatenate(values) for name, values in parts.items()}
    write(path, SCHEMA, {**labels, **columns}, details)


def read_demonstrations(path: Path) -> list[Demonstration]:
    """Demonstrations in the order in which they were written."""
    columns, _ = read(path, SCHEMA)
    keys = list(zip(columns["dataset"], columns["demo"], strict=True))
    demonstrations = []
    for first, last in runs([f"{dataset}\0{demo}" for dataset, demo in keys]):
        arms = {}
        for begin, end in runs(columns["arm"][first:last].tolist()):
            part = slice(first + begin, first + end)
            arms[str(columns["arm"][part.start])] = ArmRecording(
                time=columns["t"][part],
                position=_stack(columns, ("x", "y", "z"), part),
                quaternion=_optional(columns, ("qx", "qy", "qz", "qw"), part),
                force=_optional(columns, ("fx", "fy", "fz"), part),
            )
        demonstrations.append(
            Demonstration(
                dataset=str(keys[first][0]), demo=str(keys[first][1]), split=str(columns["split"][first]), arms=arms
            )
        )
    return demonstrations


def _append(parts: dict[str, list[Array]], names: Sequence[str], values: Array | None, count: int) -> None:
    for index, name in enumerate(names):
        present = values is not None and index < values.shape[1]
        parts[name].append(values[:, index] if present and values is not None else np.full(count, np.nan))


def _stack(columns: dict[str, Array], names: Sequence[str], part: slice) -> Array:
    """Coordinates side by side, without a last one that is nan throughout (planar data)."""
    kept = [columns[name][part] for name in names]
    if np.isnan(kept[-1]).all():
        kept.pop()
    return np.column_stack(kept)


def _optional(columns: dict[str, Array], names: Sequence[str], part: slice) -> Array | None:
    values = np.column_stack([columns[name][part] for name in names])
    return None if np.isnan(values).all() else values
