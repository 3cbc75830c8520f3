"""What arms, pads and box did in one roll-out or one demonstration, as channels of `log.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import DataError
from stages.artifacts.channels import Channel, Flags, JointStates, Points, Poses, Words, Wrenches
from stages.artifacts.log import read_log, write_log
from stages.policy.carrying import Phase

FRAME, SIDES = "world", ("left", "right")
FACING = {"left": (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)), "right": (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))}
"""Quaternions x y z w of the pads: their axis points at the box, along -y and +y."""


def write_carry_log(path: Path, rollout: Any) -> None:
    """Write one roll-out, with the attributes of `stages.rollout.physics.CarryRollout`."""
    carried, time = rollout.carried, rollout.time
    n = time.shape[0]
    channels: list[Channel] = []
    for side, name in enumerate(SIDES):
        facing, pressed, true = np.tile(FACING[name], (n, 1)), np.zeros((n, 3)), np.zeros((n, 3))
        pressed[:, 2], true[:, 2] = carried.force[:, side], carried.contact[:, side]
        joints = tuple(f"{name}_{k + 1}" for k in range(carried.q.shape[2]))
        channels += [
            Poses(topic=f"/{name}/pose", frame=FRAME, time=time, position=carried.pads[:, side], quaternion=facing),
            Points(topic=f"/{name}/commanded", frame=FRAME, time=time, position=carried.commanded[:, side]),
            Wrenches(topic=f"/{name}/wrench", frame=f"{name}_pad", time=time, force=pressed, torque=np.zeros((n, 3))),
            Wrenches(
                topic=f"/truth/{name}_contact", frame=f"{name}_pad", time=time, force=true, torque=np.zeros((n, 3))
            ),
            JointStates(
                topic=f"/{name}/joint_states",
                names=joints,
                time=time,
                position=carried.q[:, side],
                velocity=carried.qdot[:, side],
            ),
        ]
    channels += [
        Poses(topic="/box/pose", frame=FRAME, time=time, position=carried.box, quaternion=carried.turn),
        Points(topic="/policy/x", frame=FRAME, time=time, position=rollout.x),
        Points(topic="/policy/p_hat", frame=FRAME, time=time, position=rollout.p_hat),
        Flags(topic="/policy/gate", time=time, values=np.asarray(rollout.gate, dtype=np.bool_)),
        Words(topic="/phase", time=time, values=tuple(str(tuple(Phase)[code]) for code in carried.phase)),
        Words(topic="/policy/pushed", time=time, values=tuple(("", *SIDES)[code + 1] for code in carried.named)),
        *(
            Flags(topic=f"/truth/{name}_pushed", time=time, values=np.asarray(carried.acting[:, side], dtype=np.bool_))
            for side, name in enumerate(SIDES)
        ),
    ]
    details = {"rollout": rollout.rollout, "outcome": str(rollout.outcome), "facts": rollout.scene_facts}
    write_log(path, channels, details)


MASTER, CLUTCH = "/master/pose", "/master/clutch"


def write_demonstration(path: Path, done: Any, seed: int, number: int) -> None:
    """Write a demonstration, with the attributes of `stages.teleoperation.record.Demonstrated`.

    ``/recording`` is true while the box is led: what a policy is learned from.
    """
    time, n = done.time, done.time.shape[0]
    channels: list[Channel] = []
    for side, name in enumerate(SIDES):
        facing, pressed = np.tile(FACING[name], (n, 1)), np.zeros((n, 3))
        pressed[:, 2] = done.force[:, side]
        channels += [
            Poses(topic=f"/{name}/pose", frame=FRAME, time=time, position=done.pads[:, side], quaternion=facing),
            Wrenches(topic=f"/{name}/wrench", frame=f"{name}_pad", time=time, force=pressed, torque=np.zeros((n, 3))),
        ]
    said = np.isfinite(done.master).all(axis=1)
    led = done.phase == list(Phase).index(Phase.CARRY)
    channels += [
        Poses(topic=MASTER, frame="master", time=time[said], position=done.master[said], quaternion=done.handle[said]),
        Flags(topic=CLUTCH, time=time[said], values=done.clutch[said]),
        Poses(topic="/box/pose", frame=FRAME, time=time, position=done.box, quaternion=done.turn),
        Flags(topic="/recording", time=time, values=np.asarray(led, dtype=np.bool_)),
        Words(topic="/phase", time=time, values=tuple(str(tuple(Phase)[code]) for code in done.phase)),
    ]
    write_log(path, channels, {"what": "demonstration by shared teleoperation", "seed": seed, "number": number})


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
