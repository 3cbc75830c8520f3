"""The midpoint stage: from the arms' recordings to the motion of one point. Paper eq. (4)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.stage import Port, Stage, StageContext
from stages.midpoint.parameters import MidpointParameters


def run(context: StageContext) -> None:
    """Bring every demonstration onto a uniform clock and onto the goal."""
    from stages.artifacts.demonstrations import read_demonstrations
    from stages.artifacts.midpoints import write_midpoints
    from stages.midpoint.midpoint import to_trajectories

    parameters = context.parameters
    result = to_trajectories(read_demonstrations(context.inputs["demonstrations"]), parameters)
    details = {
        "shifts": [[float(value) for value in shift] for shift in result.shifts],
        "smoothing": parameters.smoothing,
        "velocity_window": parameters.velocity_window,
        "polynomial": parameters.polynomial,
    }
    write_midpoints(context.outputs["midpoints"], result.trajectories, result.goal, result.separations, details)


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """How much there is to learn from."""
    from stages.artifacts.midpoints import read_midpoints

    midpoints = read_midpoints(outputs["midpoints"])
    return {
        "demonstrations_train": len(midpoints.of_split("train")),
        "demonstrations_test": len(midpoints.of_split("test")),
        "samples": sum(t.time.shape[0] for t in midpoints.trajectories),
        "top_speed_m_s": midpoints.top_speed,
    }


STAGE = Stage(
    name="midpoint",
    summary="one point's motion on a uniform clock, shifted onto the goal: eq. (4)",
    parameters=MidpointParameters,
    inputs=("demonstrations",),
    outputs=(Port(name="midpoints", filename="midpoints.parquet"),),
    run=run,
    libraries=("numpy", "scipy", "pyarrow"),
    headline=headline,
)
