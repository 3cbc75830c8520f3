"""metrics.parquet: one row a roll-out. Written by evaluate, read by people, the command line and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stages.artifacts.parquet import Column, Schema, records, write

SCHEMA = Schema(
    name="metrics",
    version=4,
    columns=(
        Column(name="dataset", type="text"),
        Column(name="dynamics", type="text"),
        Column(name="controller", type="text"),
        Column(name="mode", type="text"),
        Column(name="avoidance", type="text"),
        Column(name="condition", type="text"),
        Column(name="demo", type="text"),
        Column(name="split", type="text"),
        Column(name="rollout", type="text"),
        Column(name="outcome", type="text"),
        Column(name="velocity_rmse_mm_s", unit="mm/s"),
        Column(name="dtw_mm", unit="mm"),
        Column(name="dtw_per_step_mm", unit="mm"),
        Column(name="sea_mm2", unit="mm2"),
        Column(name="sea_per_step_mm2", unit="mm2"),
        Column(name="steps", type="int"),
        Column(name="duration_s", unit="s"),
        Column(name="final_error_mm", unit="mm"),
        Column(name="lyapunov_rise_max", unit="m2"),
        Column(name="energy_rise_max", unit="m2"),
        Column(name="clearance_min_mm", unit="mm"),
        Column(name="avoiding_steps", type="int"),
        Column(name="detour_steps", type="int"),
        Column(name="yielding_steps", type="int"),
        Column(name="flagged_steps", type="int"),
        Column(name="gate_closed_steps", type="int"),
        Column(name="recovery_s", unit="s"),
        Column(name="displaced_step", type="int"),
        Column(name="scene", type="text"),
        Column(name="traps", type="int"),
    ),
)


def write_metrics(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows; each holds all columns, None where there is nothing to say."""
    write(path, SCHEMA, {column.name: [row[column.name] for row in rows] for column in SCHEMA.columns}, {})


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Rows in the order in which they were written."""
    return records(path)
