"""Means of metrics over roll-outs: by kind of dynamics, controller, mode and condition. Rows in, rows out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

KEYS = ("dynamics", "controller", "mode", "avoidance", "condition")
MEANS = (
    "velocity_rmse_mm_s",
    "dtw_mm",
    "dtw_per_step_mm",
    "sea_mm2",
    "sea_per_step_mm2",
    "steps",
    "duration_s",
    "final_error_mm",
)

COLLISIONS = ("collided", "infeasible", "too-fast")
"""Outcomes in which the executed state touched an obstacle."""


def by_condition(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One row for each kind of dynamics, controller, mode, avoidance and condition, in the order in which they appear.

    Beside the means it counts the roll-outs, those that arrived, and those whose gate never closed although they were
    displaced (null without a gate).
    """
    groups = group(rows, lambda row: tuple(row[name] for name in KEYS))
    summary = []
    for key, members in groups.items():
        displaced = [row for row in members if row["displaced_step"] is not None] if key[1] != "lpvds" else []
        summary.append(
            {
                **dict(zip(KEYS, key, strict=True)),
                "rollouts": len(members),
                "arrived": sum(row["outcome"] == "arrived" for row in members),
                **{name: mean(row[name] for row in members) for name in MEANS},
                "collided": sum(row["outcome"] in COLLISIONS for row in members),
                "trapped": sum(row["outcome"] == "trapped" for row in members),
                "lyapunov_rise_max": max(row["lyapunov_rise_max"] for row in members),
                "energy_rise_max": max(row["energy_rise_max"] for row in members),
                "clearance_min_mm": min(
                    (row["clearance_min_mm"] for row in members if row["clearance_min_mm"] is not None), default=None
                ),
                "gate_never_closed": sum(row["gate_closed_steps"] == 0 for row in displaced) if displaced else None,
                "recovery_s": mean(row["recovery_s"] for row in members),
            }
        )
    return summary


def group(
    rows: Iterable[Mapping[str, Any]], key: Callable[[Mapping[str, Any]], tuple[Any, ...]]
) -> dict[tuple[Any, ...], list[Mapping[str, Any]]]:
    """Rows by key, keys in the order in which they appear."""
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def mean(values: Iterable[float | None]) -> float | None:
    """Exactly rounded mean of the values that are there; none where there is none."""
    present: Sequence[float] = [value for value in values if value is not None]
    return math.fsum(present) / len(present) if present else None
