"""rollouts.parquet: every case of a roll-out stage in one table. Written by rollout, read by evaluate and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.artifacts.parquet import Column, Schema, header, read, vectors, write
from stages.trajectory import Array, frozen

SCHEMA = Schema(
    name="rollouts",
    version=1,
    columns=(
        Column(name="rollout", type="label"),
        Column(name="step", type="int"),
        Column(name="t", unit="s"),
        *vectors("x_", "m"),
        *vectors("p_hat_", "m"),
        Column(name="gate", type="bool"),
        Column(name="lyapunov", unit="m2"),
    ),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedRollout:
    """One case as recorded: what it was, and what happened.

    Attributes:
        rollout: unique name, e.g. ``clpvds-robust/cond1/4``.
        controller, mode, avoidance, condition: of the case.
        dataset, demo, split: of the demonstration from whose first point it starts.
        outcome: how it ended.
        displaced: sample that holds the imposed displacement; -1: none.
        time: array, shape (n,), seconds.
        x: array, shape (n, d), metres: the state of the learned system.
        p_hat: array, shape (n, d), metres: the executed state.
        gate: array, shape (n,), whether x may move from this sample.
        lyapunov: array, shape (n,), V of x, m^2.
    """

    rollout: str
    controller: str
    mode: str
    avoidance: str
    condition: str
    dataset: str
    demo: str
    split: str
    outcome: str
    displaced: int
    time: Array
    x: Array
    p_hat: Array
    gate: NDArray[np.bool_]
    lyapunov: Array

    @property
    def label(self) -> str:
        """The controller as figures and tables call it: its kind, and its mode where it has one of its own."""
        return self.controller if self.controller == "lpvds" else f"{self.controller} {self.mode}"


CASE = ("rollout", "controller", "mode", "avoidance", "condition", "dataset", "demo", "split", "outcome", "displaced")


def write_rollouts(path: Path, rollouts: Sequence[Any], goal: Array, details: Mapping[str, Any]) -> None:
    """Write roll-outs in order; each has the attributes of `RecordedRollout`. `goal`: array, shape (d,), metres."""
    d = goal.shape[0]
    x = np.concatenate([r.x for r in rollouts])
    p_hat = np.concatenate([r.p_hat for r in rollouts])
    columns: dict[str, Any] = {
        "rollout": [name for r in rollouts for name in [r.rollout] * r.time.shape[0]],
        "step": np.concatenate([np.arange(r.time.shape[0]) for r in rollouts]),
        "t": np.concatenate([r.time for r in rollouts]),
        "gate": np.concatenate([r.gate for r in rollouts]),
        "lyapunov": np.concatenate([r.lyapunov for r in rollouts]),
    }
    for index, axis in enumerate("xyz"[:d]):
        columns[f"x_{axis}"] = x[:, index]
        columns[f"p_hat_{axis}"] = p_hat[:, index]
    cases = [{**{name: _plain(getattr(r, name)) for name in CASE}, "samples": int(r.time.shape[0])} for r in rollouts]
    write(path, SCHEMA, columns, {"goal": [float(value) for value in goal], "cases": cases, **details})


def read_rollouts(path: Path) -> tuple[list[RecordedRollout], Array]:
    """Roll-outs in order, and the goal, array, shape (d,), metres."""
    columns, details = read(path, SCHEMA)
    goal = frozen(details["goal"])
    axes = "xyz"[: goal.shape[0]]
    x = np.column_stack([columns[f"x_{axis}"] for axis in axes])
    p_hat = np.column_stack([columns[f"p_hat_{axis}"] for axis in axes])
    rollouts, first = [], 0
    for case in details["cases"]:
        part = slice(first, first + case["samples"])
        first = part.stop
        rollouts.append(
            RecordedRollout(
                **{name: case[name] for name in CASE},
                time=frozen(columns["t"][part]),
                x=frozen(x[part]),
                p_hat=frozen(p_hat[part]),
                gate=columns["gate"][part],
                lyapunov=frozen(columns["lyapunov"][part]),
            )
        )
    return rollouts, goal


def read_details(path: Path) -> dict[str, Any]:
    """What a roll-out table says beside its rows: goal, cases, resolved controllers."""
    return header(path)


def _plain(value: Any) -> Any:
    return int(value) if isinstance(value, int | np.integer) else str(value)
