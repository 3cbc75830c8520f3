"""The rollout stage: controllers x conditions x methods of avoidance x starts; or two arms that carry boxes.

Paper eqs. (9)-(23), Figs. 2 to 6.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from pipeline.stage import Port, Stage, StageContext
from stages.rollout.parameters import StageParameters

IMPLEMENTATIONS = {
    "kinematic": "stages.rollout.simulate:simulate",
    "bullet": "stages.rollout.physics:simulate",
}
"""Kind -> (learned system, starts, parameters, top speed, random numbers) -> Simulated."""


def run(context: StageContext) -> None:
    """Run all cases and write them as one table; of the simulated world, a log of each as well."""
    from pipeline.errors import DataError
    from stages.artifacts.dynamics import read_dynamics
    from stages.artifacts.midpoints import read_midpoints
    from stages.artifacts.rollouts import write_rollouts

    parameters = context.parameters
    midpoints = read_midpoints(context.inputs["midpoints"])
    model = read_dynamics(context.inputs["dynamics"])
    wanted = getattr(parameters, "starts", "all")
    starts = midpoints.of_split(wanted)
    if not starts and wanted == "test":
        # Recordings without a declared split are all for training, and are evaluated on themselves; rows say so.
        starts = midpoints.of_split("train")
    if not starts:
        raise DataError("rollout.starts", f"no demonstration is of the split {wanted!r}.")
    simulate = STAGE.implementation(parameters.kind)
    done = simulate(model, starts, parameters, midpoints.top_speed, draw=context.generator)
    for sentence in done.notices:
        context.warn(sentence)
    details = {
        "top_speed": midpoints.top_speed,
        "controllers": [{"kind": r.kind, "mode": r.mode, "coupling": r.coupling._asdict()} for r in done.runners],
    }
    write_rollouts(context.outputs["rollouts"], done.rollouts, done.scenes, midpoints.goal, details)
    if "logs" in context.outputs:
        from pipeline.values import plain
        from stages.artifacts.carry_log import write_carry_log

        context.outputs["logs"].mkdir()
        for rollout in done.rollouts if parameters.logs else ():
            path = context.outputs["logs"] / f"{rollout.rollout.replace('/', '_')}.mcap"
            write_carry_log(path, rollout, parameters.scene.robot, plain(parameters))


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
    summary="roll-outs: controllers x conditions x avoidance x starts, or arms that carry boxes: eqs. (9)-(23)",
    parameters=StageParameters,
    inputs=("midpoints", "dynamics"),
    outputs=(
        Port(name="rollouts", filename="rollouts.parquet"),
        Port(name="logs", filename="logs", folder=True, kinds=("bullet",)),
    ),
    run=run,
    presets={
        "paper": {"mode": "paper", "avoidances": [{"kind": "roas"}]},
        "robust": {"mode": "robust", "avoidances": [{"kind": "roas+"}]},
    },
    kind_presets={
        # The values that the paper gives by name: Sect. III.
        "bullet": {
            "paper": {"mode": "paper", "admittance": {"force": 5.0, "k_p": 25.0, "k_d": 2.0}},
            "robust": {"mode": "robust"},
        },
    },
    implementations=IMPLEMENTATIONS,
    random=True,
    # mcap, rosbags and zstandard write the logs, which only `bullet` has, from this module.
    libraries=("numpy", "scipy", "numba", "pyarrow", "mcap", "rosbags", "zstandard"),
    kind_libraries={"bullet": ("pybullet",)},
    headline=headline,
    warm="stages.warm:rollout",
    plots="stages.figures.terminal_rollouts:rollout",
)
