"""What a condition means for one box that is carried: policy, grip, belief, pushes. And what cannot work, said before.

Not here: running them (`physics.py`), and pots (`carry_scenes.py`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.dynamics.lpvds import LpvDs
from stages.policy.admittance import admittance_of, check_stability
from stages.policy.avoidance.parameters import Avoidance, RoasParameters, RoasPlusParameters
from stages.policy.carrying import TOO_DEEP, Clamp
from stages.policy.coupled import PLAIN, Coupling
from stages.policy.coupling import robust_coupling
from stages.policy.estimation import Belief
from stages.policy.mutual import SAG
from stages.policy.parameters import FollowingParameters
from stages.rollout.arm_disturbances import pushes_of
from stages.rollout.carry import CarryTask
from stages.rollout.carry_scenes import MARGIN, NO_POTS, PotScene
from stages.rollout.carry_way import plan
from stages.rollout.parameters import ArmDisturbance, CarryCondition, CarryParameters, Force, Mode, RandomDrag
from stages.rollout.results import Runner
from stages.trajectory import Trajectory
from stages.world.arm_pushes import ArmPush
from stages.world.boxes import check_scene
from stages.world.bullet import CONTACT_STIFFNESS, STEP
from stages.world.parameters import Scene

NAME = re.compile(r"[\w+-][\w.+-]{0,63}")
"""Of a condition: it is part of a file's name."""

AWAY = 0.005
"""Metres between the learned goal and the scene's beyond which they are taken for two different ones."""


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
    check_following(parameters.following, "rollout.following")
    for number, condition in enumerate(parameters.conditions):
        place = f"rollout.conditions.{number}"
        for index, disturbance in enumerate(condition.disturbances):
            check_disturbance(disturbance, f"{place}.disturbances.{index}")
        for index, pot in enumerate(condition.obstacles):
            if pot.radius_spread >= pot.radius:
                raise ParameterError(f"{place}.obstacles.{index}.radius_spread", f"must be less than {pot.radius:g} m.")
        if condition.compliance:
            check_stability(
                parameters.admittance,
                parameters.dt,
                CONTACT_STIFFNESS,
                printed=mode_of(parameters, condition) == "paper",
                location="rollout.admittance",
            )
    least = [believed_error(condition, scene, starts) - condition.length_spread for condition in parameters.conditions]
    check_scene(scene, force, parameters.stand_off, "rollout.scene", min(least))


def check_following(given: FollowingParameters, location: str) -> None:
    """Refuse distances with which an arm could be taken for pushed while x goes on, or would never rest."""
    threshold = given.deviation_threshold
    if not 2.0 * given.gate < threshold:
        raise ParameterError(
            f"{location}.gate", f"must be less than half of deviation_threshold, {0.5 * threshold:g} m."
        )
    if not given.gate < given.lead < SAG * threshold:
        raise ParameterError(
            f"{location}.lead", f"must be more than gate, {given.gate:g} m, and less than {SAG * threshold:g} m."
        )


def check_disturbance(given: ArmDisturbance, location: str) -> None:
    """Refuse a disturbance that has no meaning."""
    if isinstance(given, RandomDrag):
        ranges = (("nearest", "farthest"), ("shortest", "longest"), ("quickest", "slowest"), ("earliest", "latest"))
        for least, most in ranges:
            if getattr(given, least) > getattr(given, most):
                raise ParameterError(f"{location}.{least}", f"must not be more than {most}, {getattr(given, most):g}.")
        return
    if isinstance(given, Force) and not any(given.force):
        raise ParameterError(f"{location}.force", "is nothing: give newtons, or leave the disturbance out.")
    when = [name for name in ("at_fraction", "at_time", "at_state") if getattr(given, name) is not None]
    if len(when) > 1:
        raise ParameterError(f"{location}.{when[1]}", f"must be left out where {when[0]} is given.")
    if given.at_state is not None and len(given.at_state) != 3:
        raise ParameterError(f"{location}.at_state", f"has {len(given.at_state)} coordinates, the motion has 3.")


def runner_of(parameters: CarryParameters, condition: CarryCondition, coupling: Coupling = PLAIN) -> Runner:
    """The controller of a condition; without coupling it is the plain LPV-DS."""
    kind = "clpvds" if condition.coupling else "lpvds"
    return Runner(kind=kind, mode=mode_of(parameters, condition), coupling=coupling if condition.coupling else PLAIN)


def coupling_of(parameters: CarryParameters, top_speed: float) -> Coupling:
    """How p_hat follows x where nobody pushes; `top_speed`: of the demonstrations, m/s.

    In both modes: the printed follower trails x by more than any threshold of eq. (14) at which the box is kept.
    """
    return robust_coupling(v_max=parameters.v_max, top_speed=top_speed, location="rollout").compiled


def believed(
    condition: CarryCondition, scene: Scene, starts: Sequence[Trajectory], generator: np.random.Generator
) -> Scene:
    """The scene with what the controller of a condition takes for L; `generator`: of errors that differ."""
    error = believed_error(condition, scene, starts) + condition.length_spread * generator.uniform(-1.0, 1.0)
    return replace(scene, length_error=scene.length_error + float(error))


def believed_error(condition: CarryCondition, scene: Scene, starts: Sequence[Trajectory]) -> float:
    """By how much at first the controller takes a box for longer than it is, beside the scene's own error, metres."""
    known = separation_of(starts) - scene.box[1] if condition.length == "demonstrations" else 0.0
    return condition.length_error + known


def separation_of(starts: Sequence[Trajectory]) -> float:
    """Mean distance of the arms in the demonstrations, metres: L of eq. (4). Raises DataError where they have none."""
    known = [start.separation for start in starts if start.separation is not None]
    if not known:
        raise DataError("rollout", "the demonstrations are of one point: length = demonstrations needs two arms.")
    return float(np.mean(known))


def task_of(
    parameters: CarryParameters,
    condition: CarryCondition,
    scene: Scene,
    model: LpvDs,
    top_speed: float,
    generator: np.random.Generator,
    pots: PotScene = NO_POTS,
) -> CarryTask:
    """One box under one condition, among pots; `generator`: of random pushes."""
    coupling = coupling_of(parameters, top_speed)
    pushes: list[ArmPush] = []
    if condition.disturbances:
        way = plan(
            model,
            np.array(scene.start),
            coupling,
            top_speed=top_speed,
            dt=parameters.dt,
            longest=parameters.max_duration,
            obstacles=pots.obstacles,
            avoidance=avoidance_of(parameters, condition),
        )
        pushes = pushes_of(condition.disturbances, way, parameters.dt, generator)
    return CarryTask(
        scene=scene,
        model=model,
        coupling=coupling if condition.coupling else PLAIN,
        clamp=clamp_of(parameters, condition, scene),
        force=parameters.admittance.force,
        top_speed=top_speed,
        dt=parameters.dt,
        stop_distance=parameters.stop_distance,
        max_duration=parameters.max_duration,
        record=parameters.record,
        pushes=tuple(pushes),
        obstacles=pots.obstacles,
        radii=pots.radii,
        avoidance=avoidance_of(parameters, condition) if pots.obstacles else None,
        pots=pots.pots,
    )


def mode_of(parameters: CarryParameters, condition: CarryCondition) -> Mode:
    """Which form of the admittance a condition has."""
    return condition.mode or parameters.mode


def avoidance_of(parameters: CarryParameters, condition: CarryCondition) -> Avoidance:
    """How pots are avoided under a condition."""
    if condition.avoidance is not None:
        return condition.avoidance
    return RoasParameters() if mode_of(parameters, condition) == "paper" else RoasPlusParameters(margin=MARGIN)


def clamp_of(parameters: CarryParameters, condition: CarryCondition, scene: Scene) -> Clamp:
    """How a box is held under a condition."""
    printed = mode_of(parameters, condition) == "paper"
    finds_length, finds_mass = condition.finds_length, condition.finds_mass
    return Clamp(
        length=scene.box[1] + scene.length_error,
        admittance=admittance_of(parameters.admittance, printed=printed) if condition.compliance else None,
        squeeze=parameters.squeeze,
        stand_off=parameters.stand_off,
        approach_speed=parameters.approach_speed,
        release_speed=parameters.approach_speed,
        following=parameters.following,
        printed=printed,
        mutual=condition.following,
        belief=Belief(
            finds_length=not printed if finds_length is None else finds_length,
            finds_mass=not printed if finds_mass is None else finds_mass,
            mass=max(scene.mass + condition.mass_error, 0.0),
            friction=parameters.least_friction or 0.0,
        ),
    )
