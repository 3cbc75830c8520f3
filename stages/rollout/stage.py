"""The rollout stage: controllers x conditions x methods of avoidance x starts in the kinematic world.

Paper eqs. (9)-(12) and (19)-(23), Figs. 2 to 4.
"""

from __future__ import annotations

from collections import Counter
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
    from stages.rollout.notices import notices
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
    done = simulate(model, starts, parameters, midpoints.top_speed, draw=context.generator)
    for sentence in notices(done, parameters):
        context.warn(sentence)
    details = {
        "top_speed": midpoints.top_speed,
        "controllers": [{"kind": r.kind, "mode": r.mode, "coupling": r.coupling._asdict()} for r in done.runners],
    }
    write_rollouts(context.outputs["rollouts"], done.rollouts, done.scenes, midpoints.goal, details)


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """How many roll-outs there are, and how they ended; of scenes, how many have traps."""
    from stages.artifacts.rollouts import read_details

    details = read_details(outputs["rollouts"])
    cases, scenes = details["cases"], details["scenes"]
    ended = Counter(case["outcome"] for case in cases)
    figures = {"rollouts": len(cases), "arrived": ended.pop("arrived", 0), **dict(sorted(ended.items()))}
    figures["steps"] = sum(case["samples"] - 1 for case in cases)
    if scenes:
        figures["scenes"] = len(scenes)
        figures["scenes with traps"] = sum(bool(scene["traps"]) for scene in scenes)
    return figures


STAGE = Stage(
    name="rollout",
    summary="controllers x conditions x methods of avoidance x starts: eqs. (9)-(12), (19)-(23)",
    parameters=RolloutParameters,
    inputs=("midpoints", "dynamics"),
    outputs=(Port(name="rollouts", filename="rollouts.parquet"),),
    run=run,
    presets={
        "paper": {"mode": "paper", "avoidances": [{"kind": "roas"}]},
        "robust": {"mode": "robust", "avoidances": [{"kind": "roas+"}]},
    },
    random=True,
    libraries=("numpy", "scipy", "numba", "pyarrow"),
    headline=headline,
    warm="stages.warm:rollout",
)
