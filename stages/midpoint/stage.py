"""The midpoint stage: from the arms' recordings to the motion of one point. Paper eq. (4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pipeline.stage import Port, Stage, StageContext
from stages.midpoint.parameters import MidpointParameters


def run(context: StageContext) -> None:
    """Bring every demonstration onto a uniform clock and onto the goal."""
    from stages.artifacts.demonstrations import read_demonstrations
    from stages.artifacts.midpoints import write_midpoints
    from stages.midpoint.clamp import varies
    from stages.midpoint.midpoint import to_trajectories

    parameters = context.parameters
    result = to_trajectories(read_demonstrations(context.inputs["demonstrations"]), parameters)
    details: dict[str, Any] = {
        "shifts": [[float(value) for value in shift] for shift in result.shifts],
        "smoothing": parameters.smoothing,
        "velocity_window": parameters.velocity_window,
        "polynomial": parameters.polynomial,
    }
    if result.clamp_axis is not None:
        details["clamp_axis"] = result.clamp_axis
        details["separation"] = [None if found is None else asdict(found) for found in result.clamps]
        for trajectory, found in zip(result.trajectories, result.clamps, strict=True):
            sentence = (
                "" if found is None else varies(found, parameters.separation_limit, result.clamp_axis, trajectory.name)
            )
            if sentence:
                context.warn(sentence)
    write_midpoints(context.outputs["midpoints"], result.trajectories, result.goal, result.separations, details)


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """How much there is to learn from; of two arms, their separation along the clamp axis."""
    from stages.artifacts.midpoints import read_midpoints
    from stages.artifacts.parquet import header

    midpoints = read_midpoints(outputs["midpoints"])
    held = [found for found in header(outputs["midpoints"]).get("separation", ()) if found is not None]
    figures: dict[str, float] = {
        "demonstrations_train": len(midpoints.of_split("train")),
        "demonstrations_test": len(midpoints.of_split("test")),
        "samples": sum(t.time.shape[0] for t in midpoints.trajectories),
        "top_speed_m_s": midpoints.top_speed,
    }
    if held:
        figures["separation_m"] = sum(found["mean"] for found in held) / len(held)
        figures["separation_deviation_m"] = max(found["deviation"] for found in held)
    return figures


STAGE = Stage(
    name="midpoint",
    summary="one point's motion on a uniform clock, shifted onto the goal: eq. (4)",
    parameters=MidpointParameters,
    inputs=("demonstrations",),
    outputs=(Port(name="midpoints", filename="midpoints.parquet"),),
    run=run,
    libraries=("numpy", "scipy", "pyarrow"),
    headline=headline,
    plots="stages.figures.terminal:midpoint",
)
