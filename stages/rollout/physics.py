"""Roll-outs in the simulated world: conditions x boxes, each carried by two arms. Paper Figs. 5b, 5c.

Boxes vary from roll-out to roll-out as the scene says, the same under all conditions. What cannot work is said before
anything runs. Not here: one box (`carry.py`), metrics (`stages/evaluate`) and files (`stage.py`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.dynamics.lpvds import LpvDs
from stages.policy.admittance import admittance_of, check_stability
from stages.policy.carrying import TOO_DEEP, Clamp
from stages.policy.coupling import robust_coupling
from stages.policy.outcome import Outcome
from stages.rollout.carry import Carried, carry
from stages.rollout.parameters import CarryCondition, CarryParameters, Mode
from stages.rollout.results import Rollout, Runner, Simulated
from stages.trajectory import Trajectory, frozen
from stages.world.boxes import check_scene, grip_ratio, varied
from stages.world.bullet import CONTACT_STIFFNESS, STEP
from stages.world.parameters import Scene

Draw = Callable[..., np.random.Generator]

FIRM = 1.7
"""2 mu F_d/(m g) from which a box does not creep on its pads."""

NAME = re.compile(r"[\w+-][\w.+-]{0,63}")
"""Of a condition: it is part of a file's name."""

AWAY = 0.005
"""Metres between the learned goal and the scene's beyond which they are taken for two different ones."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CarryRollout(Rollout):
    """One box, carried: a roll-out, and beside it

    Attributes:
        carried: what happened to arms and box.
        scene_facts: what this box is: mass, friction, centre of mass, start, biases, length error, compliance.
    """

    carried: Carried
    scene_facts: dict[str, Any]


def simulate(
    model: LpvDs,
    starts: Sequence[Trajectory],
    parameters: CarryParameters,
    top_speed: float,
    draw: Draw,
    progress: Callable[[int, int], None] | None = None,
) -> Simulated:
    """Carry every box under every condition.

    Args:
        model: the learned system, in space.
        starts: demonstrations; a roll-out is compared with the one that starts nearest.
        parameters: of the stage.
        top_speed: of the demonstrations, m/s.
        draw: names -> random numbers.
        progress: told how many are done, and how many there are.

    Raises:
        ParameterError: the scene cannot work, e.g. friction cannot hold the box; with the parameter's dotted place.
        DataError: the demonstrations are of another task.
    """
    check(parameters, model, starts)
    coupling = robust_coupling(v_max=parameters.v_max, top_speed=top_speed, location="rollout").compiled
    scenes = [varied(parameters.scene, draw("box", str(number))) for number in range(parameters.count)]
    done: list[CarryRollout] = []
    for condition in parameters.conditions:
        for number, box in enumerate(scenes):
            spread = condition.length_spread * draw("length", str(number)).uniform(-1.0, 1.0)
            scene = replace(box, length_error=box.length_error + condition.length_error + spread)
            carried = carry(
                scene,
                model,
                coupling,
                clamp_of(parameters, condition, scene),
                draw("noise", condition.name, str(number)),
                force=parameters.admittance.force,
                top_speed=top_speed,
                dt=parameters.dt,
                stop_distance=parameters.stop_distance,
                max_duration=parameters.max_duration,
                record=parameters.record,
            )
            done.append(_rollout(condition, number, scene, carried, parameters, model, starts))
            if progress is not None:
                progress(len(done), len(scenes) * len(parameters.conditions))
    runner = Runner(kind="clpvds", mode=parameters.mode, coupling=coupling)
    found = Simulated(rollouts=tuple(done), scenes=(), runners=(runner,))
    return replace(found, notices=tuple(notices(done)))


def notices(done: Sequence[CarryRollout]) -> Iterator[str]:
    """Boxes that friction holds only just, and those that were not delivered: a sentence each."""
    weak = [r for r in done if r.scene_facts["grip_ratio"] < FIRM]
    if weak:
        yield (
            f"{len(weak)} roll-outs have a box with 2 mu F_d/(m g) below {FIRM:g}, the first {weak[0].rollout}: it may "
            "creep; raise admittance.force."
        )
    for outcome in dict.fromkeys(r.outcome for r in done if r.outcome is not Outcome.ARRIVED):
        names = [r.rollout for r in done if r.outcome is outcome]
        yield f"{len(names)} roll-outs ended {outcome}, the first {names[0]}. {outcome.remedy}"


def check(parameters: CarryParameters, model: LpvDs, starts: Sequence[Trajectory]) -> None:
    """Refuse what cannot work, before anything runs. Raises ParameterError or DataError."""
    scene, force = parameters.scene, parameters.admittance.force
    if model.dimension != 3:
        raise DataError("dynamics", f"a box is carried in space; the learned system has {model.dimension} coordinates.")
    if not starts:
        raise DataError("rollout", "there is no demonstration to compare with.")
    steps = parameters.dt / STEP
    if abs(steps - round(steps)) > 1e-9 or steps < 0.5:
        raise ParameterError("rollout.dt", f"{parameters.dt:g} s is no whole number of milliseconds.")
    away = float(np.linalg.norm(model.goal - np.array(scene.goal)))
    if away > AWAY:
        goal = ", ".join(f"{value:.3f}" for value in model.goal)
        raise ParameterError(
            "rollout.scene.goal", f"the demonstrations end {1e3 * away:.0f} mm away from it, at [{goal}] m."
        )
    names = [condition.name for condition in parameters.conditions]
    if not names:
        raise ParameterError("rollout.conditions", "must be at least one.")
    for number, name in enumerate(names):
        if not NAME.fullmatch(name):
            raise ParameterError(
                f"rollout.conditions.{number}.name", f"{name!r} must be letters, digits, '_', '.', '+' or '-'."
            )
        if name in names[:number]:
            raise ParameterError(f"rollout.conditions.{number}.name", f"{name!r} is the name of an earlier condition.")
    if parameters.squeeze >= TOO_DEEP:
        raise ParameterError("rollout.squeeze", f"must be less than {TOO_DEEP:g} m: so deep, a pad has missed the box.")
    for condition in parameters.conditions:
        if condition.compliance:
            check_stability(
                parameters.admittance,
                parameters.dt,
                CONTACT_STIFFNESS,
                printed=mode_of(parameters, condition) == "paper",
                location="rollout.admittance",
            )
    shortest = min(condition.length_error - condition.length_spread for condition in parameters.conditions)
    check_scene(scene, force, parameters.stand_off, "rollout.scene", shortest)


def mode_of(parameters: CarryParameters, condition: CarryCondition) -> Mode:
    """Which form of the admittance a condition has."""
    return condition.mode or parameters.mode


def clamp_of(parameters: CarryParameters, condition: CarryCondition, scene: Scene) -> Clamp:
    """How a box is held under a condition."""
    return Clamp(
        length=scene.box[1] + scene.length_error,
        admittance=admittance_of(parameters.admittance, printed=mode_of(parameters, condition) == "paper")
        if condition.compliance
        else None,
        squeeze=parameters.squeeze,
        stand_off=parameters.stand_off,
        approach_speed=parameters.approach_speed,
        release_speed=parameters.approach_speed,
    )


def _rollout(
    condition: CarryCondition,
    number: int,
    scene: Scene,
    carried: Carried,
    parameters: CarryParameters,
    model: LpvDs,
    starts: Sequence[Trajectory],
) -> CarryRollout:
    nearest = min(starts, key=lambda start: float(np.linalg.norm(start.position[0] - np.array(scene.start))))
    n = carried.time.shape[0]
    return CarryRollout(
        rollout=f"clpvds-{mode_of(parameters, condition)}/{condition.name}/{number}",
        controller="clpvds",
        mode=mode_of(parameters, condition),
        avoidance="none",
        condition=condition.name,
        dataset=nearest.dataset,
        demo=nearest.demo,
        split=nearest.split,
        scene="",
        time=carried.time,
        x=carried.x,
        p_hat=carried.p_hat,
        gate=carried.gate,
        lyapunov=frozen(model.lyapunov(carried.x)),
        clearance=frozen(np.full(n, math.inf)),
        status=np.zeros(n, dtype=np.int8),
        disturbed=(),
        missed=0,
        outcome=carried.outcome,
        carried=carried,
        scene_facts={
            "compliance": condition.compliance,
            "force": parameters.admittance.force,
            "mass": scene.mass,
            "friction": scene.friction,
            "centre_of_mass": list(scene.centre_of_mass),
            "start": list(scene.start),
            "goal": list(scene.goal),
            "box": list(scene.box),
            "bias": list(scene.bias),
            "noise": scene.noise,
            "length_error": scene.length_error,
            "grip_ratio": grip_ratio(scene, parameters.admittance.force),
        },
    )
