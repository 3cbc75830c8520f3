"""metrics.parquet: one row a roll-out. Written by evaluate, read by people, the command line and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stages.artifacts.parquet import Column, Schema, records, write

SCHEMA = Schema(
    name="metrics",
    version=6,
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
        Column(name="compliance", type="bool"),
        Column(name="following", type="bool"),
        Column(name="coupling", type="bool"),
        Column(name="delivered", type="bool"),
        Column(name="dropped", type="bool"),
        Column(name="delivery_error_mm", unit="mm"),
        Column(name="tilt_max_deg", unit="deg"),
        Column(name="slip_left_mm", unit="mm"),
        Column(name="slip_right_mm", unit="mm"),
        Column(name="slip_max_mm", unit="mm"),
        Column(name="force_mean_n", unit="N"),
        Column(name="force_std_n", unit="N"),
        Column(name="force_p5_n", unit="N"),
        Column(name="force_p95_n", unit="N"),
        Column(name="band_fraction"),
        Column(name="grip_ratio"),
        Column(name="bias_n", unit="N"),
        Column(name="pushed", type="text"),
        Column(name="named", type="text"),
        Column(name="deviation_max_mm", unit="mm"),
        Column(name="moved_while_away_mm", unit="mm"),
        Column(name="box_back_mm", unit="mm"),
        Column(name="desired_force_n", unit="N"),
        Column(name="length_error_mm", unit="mm"),
        Column(name="mass_error_g", unit="g"),
        Column(name="box_room_min_mm", unit="mm"),
        Column(name="arm_room_min_mm", unit="mm"),
        Column(name="box_contacts", type="int"),
        Column(name="arm_contacts", type="int"),
    ),
)


def write_metrics(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows; a column that a row does not hold is null there."""
    write(path, SCHEMA, {column.name: [row.get(column.name) for row in rows] for column in SCHEMA.columns}, {})


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Rows in the order in which they were written."""
    return records(path)
