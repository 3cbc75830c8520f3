"""The evaluate stage: metrics of each roll-out against the demonstration that it starts from. Paper eq. (26)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pipeline.stage import Port, Stage, StageContext
from stages.evaluate.parameters import EvaluateParameters


def run(context: StageContext) -> None:
    """Compare every roll-out's executed path with its demonstration."""
    from stages.artifacts.dynamics import read_details, read_dynamics
    from stages.artifacts.metrics import write_metrics
    from stages.artifacts.midpoints import read_midpoints
    from stages.artifacts.rollouts import read_rollouts, read_scenes
    from stages.dynamics.lpvds import velocity_error
    from stages.evaluate.compare import MM, compare
    from stages.evaluate.force import grip, way_error
    from stages.evaluate.pushed import pushed

    references = {(t.dataset, t.demo): t for t in read_midpoints(context.inputs["midpoints"]).trajectories}
    rollouts, goal = read_rollouts(context.inputs["rollouts"])
    scenes = read_scenes(context.inputs["rollouts"])
    model, kind = read_dynamics(context.inputs["dynamics"]), read_details(context.inputs["dynamics"])["kind"]
    errors = {name: velocity_error(model, [reference]) * MM for name, reference in references.items()}
    rows = []
    for rollout in rollouts:
        compared = compare(
            time=rollout.time,
            x=rollout.x,
            executed=rollout.executed,
            gate=rollout.gate,
            lyapunov=rollout.lyapunov,
            clearance=rollout.clearance,
            status=rollout.status,
            disturbed=rollout.disturbed,
            outcome=rollout.outcome,
            reference=references[rollout.dataset, rollout.demo],
            goal=goal,
            samples=context.parameters.samples,
            p_hat=rollout.p_hat,
        )
        names = ("dataset", "controller", "mode", "avoidance", "condition", "demo", "split", "rollout")
        displaced = {"displaced_step": rollout.displaced if rollout.displaced >= 0 else None}
        traps = scenes[rollout.scene].traps if rollout.scene else None
        scene = {"scene": rollout.scene or None, "traps": None if traps is None else traps.shape[0]}
        field = {"dynamics": kind, "velocity_rmse_mm_s": errors[rollout.dataset, rollout.demo]}
        held = {} if rollout.carry is None else asdict(grip(rollout.carry, rollout.outcome))
        if rollout.carry is not None:  # pads slide on down after the way's end
            held |= asdict(pushed(rollout.carry, rollout.x, rollout.gate))
            held["final_error_mm"] = way_error(rollout.carry, rollout.executed, goal) * MM
        rows.append(
            {
                **{name: getattr(rollout, name) for name in names},
                **field,
                **asdict(compared),
                **displaced,
                **scene,
                **held,
            }
        )
    write_metrics(context.outputs["metrics"], rows)


def rows(outputs: Mapping[str, Path]) -> list[dict[str, Any]]:
    """Rows of metrics.parquet."""
    from stages.artifacts.metrics import read_metrics

    return read_metrics(outputs["metrics"])


def summarise(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means by kind of dynamics, controller, mode, method of avoidance and condition."""
    from stages.evaluate.summary import by_condition

    return by_condition(rows)


ALONE = ("dtw_mm", "sea_mm2", "sea_per_step_mm2", "steps", "final_error_mm", "arrived")
AMONG = ("dtw_mm", "steps", "arrived", "collided")
"""Figures of a group of roll-outs, without and among obstacles."""


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """Means by controller, mode, method of avoidance and condition, under one name each."""
    figures = {}
    for group in summarise(rows(outputs)):
        method = f"/{group['avoidance']}" if group["avoidance"] != "none" else ""
        case = f"{group['controller']}/{group['mode']}{method}/{group['condition']}"
        for name in AMONG if method else ALONE:
            figures[f"{name} {case}"] = group[name]
    return figures


STAGE = Stage(
    name="evaluate",
    summary="swept error area (26), dynamic time warping, recovery, clearance, contact force",
    parameters=EvaluateParameters,
    inputs=("midpoints", "dynamics", "rollouts"),
    outputs=(Port(name="metrics", filename="metrics.parquet"),),
    run=run,
    libraries=("numpy", "numba", "pyarrow"),
    headline=headline,
    rows=rows,
    summarise=summarise,
    warm="stages.warm:evaluate",
    plots="stages.figures.terminal:evaluate",
)
