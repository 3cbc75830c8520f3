"""What arms, pads and box did in one roll-out or one demonstration, as channels of `log.py`: every viewer draws it.

rerun, Foxglove and ROS 2 know these messages: ``/tf`` and ``/tf_static`` place all frames, ``/robot_description`` says
what hangs on them, poses and joint states stand beside. Measured forces are wrenches, as robots record them, and once
more numbers, which rerun plots. What a controller cannot know is below ``/truth``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import DataError
from stages.artifacts.channel import Channel
from stages.artifacts.channels import Flags, JointStates, Numbers, Poses, Transforms, Words, Wrenches
from stages.artifacts.log import read_log, write_log
from stages.policy.carrying import Phase
from stages.trajectory import Array
from stages.world.description import FACE, SIDES, WORLD, Tree, both, description, faces, named, tree, turning

FACING = {"left": (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)), "right": (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))}
"""Quaternions x y z w of the pads as they are wanted: their axis points at the box, along -y and +y."""

UPRIGHT = (0.0, 0.0, 0.0, 1.0)

ROLLOUT, DEMONSTRATION = "roll-out", "demonstration by shared teleoperation"
"""What a log says that it is of, by its key ``what``."""


def write_carry_log(path: Path, rollout: Any, robot: str, parameters: Mapping[str, Any]) -> None:
    """Write one roll-out, with the attributes of `stages.rollout.physics.CarryRollout`.

    Arguments:
        robot: name of the arms.
        parameters: plain values: those of the stage.
    """
    carried, time = rollout.carried, rollout.time
    arms = both(robot, "rollout.scene.robot")
    n, names, fixed_and_moving = time.shape[0], turning(arms), tree(arms, carried.q)
    turns = faces(arms, carried.q)[1]
    midpoint = carried.pads.mean(axis=1)
    deviations = {side: carried.residual[:, k] for k, side in enumerate(SIDES)}
    if rollout.scene_facts["following"]:
        deviations["threshold"] = np.full(n, parameters["following"]["deviation_threshold"])
    room = {"middle": carried.clearance, "box": carried.box_room, "arms": carried.arm_room}
    points = {"box": carried.box, "midpoint": midpoint, "x": rollout.x, "p_hat": rollout.p_hat}
    channels: list[Channel] = [
        Words(topic="/robot_description", time=time[:1], values=(description(robot, arms),), latched=True),
        *_frames(time, *fixed_and_moving, points, {"box": carried.turn}),
        JointStates(
            topic="/joint_states",
            time=time,
            names=names,
            position=carried.q.reshape(n, -1),
            velocity=carried.qdot.reshape(n, -1),
        ),
        *(_pose(f"/{side}/pose", time, carried.pads[:, k], turns[:, k]) for k, side in enumerate(SIDES)),
        *(_pose(f"/{side}/commanded", time, carried.commanded[:, k], FACING[side]) for k, side in enumerate(SIDES)),
        _pose("/box/pose", time, carried.box, carried.turn),
        _pose("/midpoint", time, midpoint),
        _pose("/policy/x", time, rollout.x),
        _pose("/policy/p_hat", time, rollout.p_hat),
        *_wrenches(time, carried.force),
        _numbers("/forces", time, "N", left=carried.force[:, 0], right=carried.force[:, 1], desired=carried.desired),
        _numbers("/truth/contacts", time, "N", left=carried.contact[:, 0], right=carried.contact[:, 1]),
        _numbers("/policy/deviations", time, "m", **deviations),
        _numbers("/policy/lyapunov", time, "m2", V=rollout.lyapunov),
        *((_numbers("/truth/clearances", time, "m", **room),) if np.isfinite(carried.clearance).any() else ()),
        _flags("/policy/gate", time, rollout.gate),
        _phases(time, carried.phase),
        Words(topic="/policy/pushed", time=time, values=tuple(("", *SIDES)[code + 1] for code in carried.named)),
        *(_flags(f"/truth/{side}_pushed", time, carried.acting[:, k]) for k, side in enumerate(SIDES)),
    ]
    said = {"what": ROLLOUT, "rollout": rollout.rollout, "outcome": str(rollout.outcome), "robot": robot}
    write_log(path, channels, {**said, "facts": rollout.scene_facts}, parameters)


BESIDE = (-0.5, 0.0, 0.4)
"""Where viewers draw the master's frame, metres in the world: behind the arms, where nothing else is."""

MASTER, CLUTCH = "/master/pose", "/master/clutch"


def write_demonstration(
    path: Path, done: Any, seed: int, number: int, robot: str, parameters: Mapping[str, Any]
) -> None:
    """Write a demonstration, with the attributes of `stages.teleoperation.record.Demonstrated`.

    ``/recording`` is true while the box is led: what a policy is learned from.

    Arguments:
        robot: name of the arms.
        parameters: plain values: those of the teleoperation.
    """
    time, midpoint = done.time, done.pads.mean(axis=1)
    arms = both(robot, "scene.robot")
    turns = faces(arms, done.joints)[1]
    said = np.isfinite(done.master).all(axis=1)
    fixed, moving = tree(arms, done.joints)
    channels: list[Channel] = [
        Words(topic="/robot_description", time=time[:1], values=(description(robot, arms),), latched=True),
        *_frames(time, _with_master(fixed), moving, {"box": done.box, "midpoint": midpoint}, {"box": done.turn}),
        JointStates(topic="/joint_states", time=time, names=turning(arms), position=done.joints.reshape(time.size, -1)),
        *(_pose(f"/{side}/pose", time, done.pads[:, k], turns[:, k]) for k, side in enumerate(SIDES)),
        *_wrenches(time, done.force),
        Poses(topic=MASTER, frame="master", time=time[said], position=done.master[said], quaternion=done.handle[said]),
        Flags(topic=CLUTCH, time=time[said], values=done.clutch[said]),
        _pose("/box/pose", time, done.box, done.turn),
        _pose("/midpoint", time, midpoint),
        _numbers("/forces", time, "N", left=done.force[:, 0], right=done.force[:, 1]),
        _flags("/recording", time, done.phase == list(Phase).index(Phase.CARRY)),
        _phases(time, done.phase),
    ]
    write_log(path, channels, {"what": DEMONSTRATION, "seed": seed, "number": number, "robot": robot}, parameters)


def _with_master(fixed: Tree) -> Tree:
    """Frames that never move, and that of the master: viewers draw nothing where a frame hangs on none."""
    return Tree(
        parents=(*fixed.parents, WORLD),
        children=(*fixed.children, "master"),
        places=np.concatenate([fixed.places, np.array([[BESIDE]])], axis=1),
        turns=np.concatenate([fixed.turns, np.array([[UPRIGHT]])], axis=1),
    )


def read_master(path: Path) -> tuple[Any, Any, Any, Any]:
    """Time, position, orientation and clutch of the master in a recording of `write_demonstration`.

    Raises DataError where the file is none, or no master was recorded.
    """
    log = read_log(path)
    missing = [topic for topic in (MASTER, CLUTCH) if topic not in log]
    if missing:
        raise DataError(path.name, f"has no topic {missing[0]}: it is no recording of 'clpv teleop'.")
    pose, clutch = log[MASTER], log[CLUTCH]
    if not (isinstance(pose, Poses) and isinstance(clutch, Flags)):
        raise DataError(path.name, f"its {MASTER} is no pose, or its {CLUTCH} no Bool.")
    return pose.time, pose.position, pose.quaternion, clutch.values


def _frames(
    time: Array,
    fixed: Tree,
    moving: Tree,
    points: Mapping[str, Array],
    turns: Mapping[str, Array | Sequence[float]],
) -> list[Channel]:
    """All frames: once those that never move, and over time those that do.

    `points`: of further frames in the world, arrays, shape (n, 3), metres, by name. `turns`: quaternions x y z w of
    those that are not upright, shape (n, 4) or (4,).
    """
    n = time.shape[0]
    position = np.stack(list(points.values()), axis=1)
    quaternion = np.stack([np.broadcast_to(turns.get(name, UPRIGHT), (n, 4)) for name in points], axis=1)
    still = Transforms(
        topic="/tf_static",
        time=time[:1],
        parents=fixed.parents,
        children=fixed.children,
        position=fixed.places,
        quaternion=fixed.turns,
        latched=True,
    )
    over_time = Transforms(
        topic="/tf",
        time=time,
        parents=(*moving.parents, *(WORLD,) * len(points)),
        children=(*moving.children, *points),
        position=np.concatenate([moving.places, position], axis=1),
        quaternion=np.concatenate([moving.turns, quaternion], axis=1),
    )
    return [still, over_time]


def _pose(topic: str, time: Array, position: Array, quaternion: Array | Sequence[float] = UPRIGHT) -> Poses:
    """Poses in the world; `quaternion`: shape (n, 4) or (4,)."""
    turns = np.broadcast_to(quaternion, (time.shape[0], 4))
    return Poses(topic=topic, frame=WORLD, time=time, position=position, quaternion=turns)


def _wrenches(time: Array, pressed: Array) -> list[Channel]:
    """How hard both pads press, shape (n, 2), newtons, as the wrists' sensors say.

    Along the pads' z axes, which point at the box: a positive force is what a pad does to it.
    """
    found: list[Channel] = []
    for k, side in enumerate(SIDES):
        force = np.zeros((time.shape[0], 3))
        force[:, 2] = pressed[:, k]
        frame, torque = named(side, FACE), np.zeros_like(force)
        found.append(Wrenches(topic=f"/{side}/wrench", frame=frame, time=time, force=force, torque=torque))
    return found


def _numbers(topic: str, time: Array, unit: str, **values: Array) -> Numbers:
    """Numbers by name, arrays, shape (n,)."""
    return Numbers(topic=topic, time=time, unit=unit, names=tuple(values), values=np.column_stack([*values.values()]))


def _flags(topic: str, time: Array, values: NDArray[Any]) -> Flags:
    return Flags(topic=topic, time=time, values=np.asarray(values, dtype=np.bool_))


def _phases(time: Array, codes: NDArray[np.int8]) -> Words:
    """What arms are at, `codes`: indices into `tuple(Phase)`."""
    return Words(topic="/phase", time=time, values=tuple(str(tuple(Phase)[code]) for code in codes))
