"""midpoints.parquet: the motion of one point, shifted onto the goal. Written by midpoint, read by all later stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import DataError
from stages.artifacts.parquet import Column, Schema, read, runs, vectors, write
from stages.trajectory import Array, Trajectory, frozen

SCHEMA = Schema(
    name="midpoints",
    version=1,
    columns=(
        Column(name="dataset", type="label"),
        Column(name="demo", type="label"),
        Column(name="split", type="label"),
        Column(name="t", unit="s"),
        *vectors("", "m"),
        *vectors("v", "m/s"),
        Column(name="separation", unit="m"),
    ),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Midpoints:
    """Trajectories and their common goal, array, shape (d,), metres."""

    trajectories: tuple[Trajectory, ...]
    goal: Array

    def of_split(self, split: str) -> tuple[Trajectory, ...]:
        """Trajectories of ``train`` or ``test``; ``all`` gives all of them."""
        return tuple(t for t in self.trajectories if split in ("all", t.split))

    @property
    def top_speed(self) -> float:
        """Highest speed over the training demonstrations, m/s."""
        return float(max(np.linalg.norm(t.velocity, axis=1).max() for t in self.of_split("train")))


def write_midpoints(
    path: Path,
    trajectories: Sequence[Trajectory],
    goal: Array,
    separations: Sequence[Array | None],
    details: Mapping[str, Any],
) -> None:
    """Write trajectories; `separations` are the arms' distances over time, metres, or None for a single point."""
    columns: dict[str, Any] = {}
    for name in ("dataset", "demo", "split"):
        columns[name] = [value for t in trajectories for value in [getattr(t, name)] * t.time.shape[0]]
    columns["t"] = np.concatenate([t.time for t in trajectories])
    position = np.concatenate([t.position for t in trajectories])
    velocity = np.concatenate([t.velocity for t in trajectories])
    for index in range(position.shape[1]):
        columns["xyz"[index]] = position[:, index]
        columns["v" + "xyz"[index]] = velocity[:, index]
    if any(separation is not None for separation in separations):
        columns["separation"] = np.concatenate(
            [
                np.full(t.time.shape[0], np.nan) if separation is None else separation
                for t, separation in zip(trajectories, separations, strict=True)
            ]
        )
    write(path, SCHEMA, columns, {"goal": [float(value) for value in goal], **details})


def read_midpoints(path: Path) -> Midpoints:
    """Trajectories in the order in which they were written, and the goal."""
    columns, header = read(path, SCHEMA)
    goal = frozen(header["goal"])
    axes = "xyz"[: goal.shape[0]]
    labels = [f"{dataset}\0{demo}" for dataset, demo in zip(columns["dataset"], columns["demo"], strict=True)]
    trajectories = tuple(
        Trajectory(
            dataset=str(columns["dataset"][first]),
            demo=str(columns["demo"][first]),
            split=str(columns["split"][first]),
            time=columns["t"][first:last],
            position=np.column_stack([columns[axis][first:last] for axis in axes]),
            velocity=np.column_stack([columns["v" + axis][first:last] for axis in axes]),
            separation=_mean(columns["separation"][first:last]),
        )
        for first, last in runs(labels)
    )
    return Midpoints(trajectories=trajectories, goal=goal)


def training_set(midpoints: Midpoints) -> tuple[Array, Array, Array]:
    """All training samples: positions (n, d) m, velocities (n, d) m/s, samples of each demonstration (m,).

    Raises DataError where no demonstration is for training.
    """
    chosen = midpoints.of_split("train")
    if not chosen:
        raise DataError("midpoints", "no demonstration is for training: name some in ingest.train.")
    position = np.concatenate([t.position for t in chosen])
    velocity = np.concatenate([t.velocity for t in chosen])
    return position, velocity, np.array([t.time.shape[0] for t in chosen])


def _mean(separation: Array) -> float | None:
    """Mean of the arms' distances, metres; none: of a single point."""
    return None if np.isnan(separation).any() else float(separation.mean())
