"""Roll-outs in the simulated world: conditions x boxes, each carried by two arms. Paper Figs. 5b, 5c.

Boxes vary from roll-out to roll-out as the scene says, the same under all conditions. What cannot work is said before
anything runs. Not here: one box (`carry.py`), metrics (`stages/evaluate`) and files (`stage.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.shapes import spheres
from stages.policy.estimation import FIRM
from stages.policy.outcome import Outcome
from stages.rollout.arm_disturbances import SIDES
from stages.rollout.carry import Carried, CarryTask, carry
from stages.rollout.carry_conditions import avoidance_of, believed, check, coupling_of, mode_of, runner_of, task_of
from stages.rollout.carry_scenes import PotScene, scene_of
from stages.rollout.cases import method_name
from stages.rollout.disturbances import spans_of
from stages.rollout.parameters import CarryCondition, CarryParameters, Flowerpot
from stages.rollout.results import Rollout, Simulated
from stages.rollout.scenes import Scene as Obstructed
from stages.trajectory import Trajectory, frozen
from stages.world.arm_pushes import ArmPush
from stages.world.boxes import grip_ratio, varied
from stages.world.pots import Pot

Draw = Callable[..., np.random.Generator]


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
    coupling = coupling_of(parameters, top_speed)
    scenes = [varied(parameters.scene, draw("box", str(number))) for number in range(parameters.count)]
    ways: dict[tuple[tuple[Flowerpot, ...], int], PotScene] = {}
    tasks: list[tuple[CarryCondition, int, CarryTask]] = []
    for index, condition in enumerate(parameters.conditions):
        for number, box in enumerate(scenes):
            known = (condition.obstacles, number)
            if known not in ways:
                ways[known] = scene_of(
                    condition.obstacles,
                    draw("pots", str(number)),
                    box,
                    model,
                    coupling,
                    top_speed=top_speed,
                    dt=parameters.dt,
                    longest=parameters.max_duration,
                    location=f"rollout.conditions.{index}.obstacles",
                )
            scene = believed(condition, box, starts, draw("length", str(number)))
            task = task_of(parameters, condition, scene, model, top_speed, draw("push", str(number)), ways[known])
            tasks.append((condition, number, task))
    done: list[CarryRollout] = []
    for condition, number, task in tasks:
        carried = carry(task, draw("noise", condition.name, str(number)))
        refused = ways[condition.obstacles, number].refused
        done.append(_rollout(condition, number, task, carried, parameters, starts, refused))
        if progress is not None:
            progress(len(done), len(tasks))
    shown = {f"{c.name}/{n}": ways[c.obstacles, n] for c in parameters.conditions for n in range(len(scenes))}
    found = Simulated(
        rollouts=tuple(done),
        scenes=tuple(safety_of(name, scene) for name, scene in shown.items() if scene.pots),
        runners=tuple(dict.fromkeys(runner_of(parameters, condition, coupling) for condition in parameters.conditions)),
    )
    return replace(found, notices=tuple(notices(done)))


def notices(done: Sequence[CarryRollout]) -> Iterator[str]:
    """Boxes that friction holds only just, and those that were not delivered: a sentence each."""
    weak = [r for r in done if r.scene_facts["grip_ratio"] < FIRM]
    if weak:
        yield (
            f"{len(weak)} roll-outs have a box with 2 mu F_d/(m g) below {FIRM:g}, the first {weak[0].rollout}: it may "
            "creep; raise admittance.force."
        )
    near = [r for r in done for pot in r.scene_facts["pots"] if pot["radius"] < apart(pot, r.scene_facts["box"])]
    if near:
        yield (
            f"{len(near)} roll-outs have a pot that the box can touch while its middle is outside of the safety "
            f"sphere, the first {near[0].rollout}: raise obstacles.radius, or look at the contacts."
        )
    for outcome in dict.fromkeys(r.outcome for r in done if r.outcome is not Outcome.ARRIVED):
        names = [r.rollout for r in done if r.outcome is outcome]
        yield f"{len(names)} roll-outs ended {outcome}, the first {names[0]}. {outcome.remedy}"


def apart(pot: Mapping[str, Any], box: Sequence[float]) -> float:
    """Farthest that the middle of an upright box can be from that of a pot which it touches, metres, seen along y."""
    return math.hypot(0.5 * (pot["width"] + box[0]), 0.5 * (pot["height"] + box[2]))


def safety_of(name: str, scene: PotScene) -> Obstructed:
    """The safety spheres of a scene, as they are kept beside the rows."""
    centres = np.array([pot.centre for pot in scene.pots])
    velocities = np.array([one.velocity or (0.0, 0.0, 0.0) for one in scene.obstacles])
    return Obstructed(
        name=name, shapes=spheres(centres, np.array(scene.radii), velocities), cover=(False,) * len(centres)
    )


def pushed(push: ArmPush) -> dict[str, Any]:
    """A push as facts keep it."""
    return {
        "arm": SIDES[push.arm],
        "offset": push.offset.tolist(),
        "force": push.force.tolist(),
        "rise": push.rise,
        "hold": push.hold,
    }


def potted(pot: Pot, radius: float) -> dict[str, Any]:
    """A pot, and the radius of its safety sphere, as facts keep them."""
    return {"centre": list(pot.centre), "height": pot.height, "width": pot.width, "radius": radius}


def _rollout(
    condition: CarryCondition,
    number: int,
    task: CarryTask,
    carried: Carried,
    parameters: CarryParameters,
    starts: Sequence[Trajectory],
    refused: int,
) -> CarryRollout:
    nearest = min(starts, key=lambda start: float(np.linalg.norm(start.position[0] - np.array(task.scene.start))))
    return CarryRollout(
        rollout=f"{runner_of(parameters, condition).label}/{condition.name}/{number}",
        controller=runner_of(parameters, condition).kind,
        mode=mode_of(parameters, condition),
        avoidance=method_name(avoidance_of(parameters, condition)) if task.obstacles else "none",
        condition=condition.name,
        dataset=nearest.dataset,
        demo=nearest.demo,
        split=nearest.split,
        scene=f"{condition.name}/{number}" if task.obstacles else "",
        time=carried.time,
        x=carried.x,
        p_hat=carried.p_hat,
        gate=carried.gate,
        lyapunov=frozen(task.model.lyapunov(carried.x)),
        clearance=carried.clearance,
        status=carried.status,
        disturbed=spans_of(np.any(carried.acting, axis=1)),
        missed=0,
        outcome=carried.outcome,
        carried=carried,
        scene_facts=facts_of(condition, task, carried, refused),
    )


def facts_of(condition: CarryCondition, task: CarryTask, carried: Carried, refused: int = 0) -> dict[str, Any]:
    """What a carried box was, and what the controller took it for: what metrics and figures know beside the samples.

    `refused`: how many draws of the pots were refused before there was a way.
    """
    scene = task.scene
    return {
        "compliance": condition.compliance,
        "following": condition.following,
        "coupling": condition.coupling,
        "length_found": carried.length,
        "mass_found": None if math.isnan(carried.mass) else carried.mass,
        "pushes": [pushed(push) for push in task.pushes],
        "pots": [potted(pot, radius) for pot, radius in zip(task.pots, task.radii, strict=True)],
        "refused": refused,
        "box_contacts": carried.box_contacts,
        "arm_contacts": carried.arm_contacts,
        "force": task.force,
        "mass": scene.mass,
        "friction": scene.friction,
        "centre_of_mass": list(scene.centre_of_mass),
        "start": list(scene.start),
        "goal": list(scene.goal),
        "box": list(scene.box),
        "bias": list(scene.bias),
        "noise": scene.noise,
        "length_error": scene.length_error,
        "grip_ratio": grip_ratio(scene, task.force),
    }
