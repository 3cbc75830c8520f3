"""The rollout stage: controllers x conditions x starts in the kinematic world. Paper eqs. (9)-(12), Figs. 2 and 3."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.stage import Port, Stage, StageContext
from stages.rollout.parameters import RolloutParameters


def run(context: StageContext) -> None:
    """Run all cases and write them as one table."""
    from pipeline.errors import DataError
    from stages.artifacts.dynamics import read_dynamics
    from stages.artifacts.midpoints import read_midpoints
    from stages.artifacts.rollouts import write_rollouts
    from stages.rollout.cases import resolve
    from stages.rollout.simulate import simulate

    parameters = context.parameters
    midpoints = read_midpoints(context.inputs["midpoints"])
    model = read_dynamics(context.inputs["dynamics"])
    starts = midpoints.of_split(parameters.starts)
    if not starts and parameters.starts == "test":
        # Recordings without a declared split are all for training, and are evaluated on themselves; rows say so.
        starts = midpoints.of_split("train")
    if not starts:
        raise DataError("rollout.starts", f"no demonstration is of the split {parameters.starts!r}.")
    rollouts = simulate(model, starts, parameters, midpoints.top_speed)
    pushed = {condition.name for condition in parameters.conditions if condition.displacement is not None}
    unpushed = [r.rollout for r in rollouts if r.condition in pushed and r.displaced < 0]
    if unpushed:
        context.warn(
            f"{len(unpushed)} roll-outs ended before their displacement, the first {unpushed[0]}: lower at_time."
        )
    runners = resolve(parameters, midpoints.top_speed)
    details = {
        "top_speed": midpoints.top_speed,
        "controllers": [{"kind": r.kind, "mode": r.mode, "coupling": r.coupling._asdict()} for r in runners],
    }
    write_rollouts(context.outputs["rollouts"], rollouts, midpoints.goal, details)


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """How many roll-outs there are, and how many arrived."""
    from stages.artifacts.rollouts import read_details

    cases = read_details(outputs["rollouts"])["cases"]
    return {
        "rollouts": len(cases),
        "arrived": sum(case["outcome"] == "arrived" for case in cases),
        "steps": sum(case["samples"] - 1 for case in cases),
    }


STAGE = Stage(
    name="rollout",
    summary="controllers x conditions x starts: eqs. (9)-(12)",
    parameters=RolloutParameters,
    inputs=("midpoints", "dynamics"),
    outputs=(Port(name="rollouts", filename="rollouts.parquet"),),
    run=run,
    presets={"paper": {"mode": "paper"}, "robust": {"mode": "robust"}},
    libraries=("numpy", "scipy", "numba", "pyarrow"),
    headline=headline,
    warm="stages.warm:rollout",
)
