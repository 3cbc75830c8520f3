"""A demonstration: a master leads two arms that carry a box in the simulated world. Paper eqs. (1)-(3), Fig. 5e.

Shared control: the arms grip, press and let go by themselves, the operator leads the way in between. The same world and
the same carrier as in roll-outs; only the way is another. Arrays out. Not here: files (`stages/demonstrate.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stages.policy.carrying import ENDED, Carrier, Clamp, Phase
from stages.teleoperation.mapping import Clutch, MasterSample, SharedTeleoperation
from stages.teleoperation.masters import Master, Seen
from stages.trajectory import Array, frozen
from stages.world.bullet import STEP, World
from stages.world.following import Follower


class OperatorWay:
    """Where a master leads the midpoint of the pads.

    Attributes:
        time: of the present cycle, seconds.
        seen: what the master sees then.
        sample: what it has said last; none: nothing yet.
        lost: cycles in which it was not followed, as it was stale or not finite.
        limited: cycles in which the workspace held the pads back.
    """

    def __init__(self, mapping: SharedTeleoperation, master: Master) -> None:
        self._mapping, self._master = mapping, master
        self.time, self.seen = 0.0, Seen(mapping.pads.midpoint)
        self.sample: MasterSample | None = None
        self.lost = self.limited = 0

    def step(self, midpoint: Array, *, return_speed: float | None = None) -> Array:
        """The next midpoint, shape (3,), metres; it waits for nothing but the operator. Paper eqs. (1)-(3)."""
        found = np.asarray(self._mapping.step(self.time, self.sample).midpoint)
        self.lost += self._mapping.status is Clutch.LOST
        self.limited += self._mapping.limited
        return found

    def ask(self, time: float, seen: Seen) -> None:
        """Let the master look and say where it is; `time`: seconds."""
        self.time, self.seen = time, seen
        said = self._master.sample(time, seen)
        self.sample = self.sample if said is None else said

    def gap(self, midpoint: Array) -> float:
        """An operator waits for nothing: 0 metres."""
        return 0.0

    @property
    def ended(self) -> bool:
        """Whether the operator has finished."""
        return self._master.done


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstrated:
    """What happened in a demonstration; n samples.

    Attributes:
        time: array, shape (n,), seconds.
        phase: array of int, shape (n,): an index into `tuple(Phase)`.
        joints: array, shape (n, 2, m), rad, as measured.
        pads: array, shape (n, 2, 3), metres, as measured.
        force: array, shape (n, 2), newtons: pressing forces, as measured.
        box, turn: arrays, shapes (n, 3), metres, and (n, 4), quaternion x y z w.
        master: array, shape (n, 3), metres, in the master's frame; nan: it has said nothing yet.
        handle: array, shape (n, 4): the master's orientation, quaternion x y z w.
        clutch: array of bool, shape (n,): the master is engaged.
        lost, limited: seconds in which the master was not followed, and in which the workspace held the pads back.
        ended: how.
    """

    time: Array
    phase: NDArray[np.int8]
    joints: Array
    pads: Array
    force: Array
    box: Array
    turn: Array
    master: Array
    handle: Array
    clutch: NDArray[np.bool_]
    lost: float = 0.0
    limited: float = 0.0
    ended: Phase


def demonstrate(
    world: World,
    mapping: SharedTeleoperation,
    master: Master,
    clamp: Clamp,
    *,
    force: float,
    dt: float,
    record: float,
    longest: float,
) -> Demonstrated:
    """Let a master lead one demonstration.

    Args:
        world: will be stepped.
        mapping: from the master to the pads, at the box's start.
        master: who leads.
        clamp: how the box is held.
        force: F_d, newtons.
        dt: seconds a cycle.
        record: samples a second.
        longest: seconds after which it is broken off.
    """
    way = OperatorWay(mapping, master)
    carrier = Carrier(way, np.array(world.scene.start), clamp, dt, force)
    follower = Follower(world, world.put(carrier.pads), dt)
    steps, every = round(dt / STEP), max(1, round(1.0 / (record * dt)))
    phases, rows = tuple(Phase), []
    silent = MasterSample(0.0, np.full(3, np.nan), np.array([0.0, 0.0, 0.0, 1.0]), False)
    for cycle in range(round(longest / dt) + 1):
        hands = world.hands()
        way.ask(cycle * dt, Seen(hands.pads.mean(axis=0), str(carrier.phase)))
        if cycle % every == 0 or carrier.phase in ENDED:
            sample, (box, turn) = way.sample or silent, world.box_pose()
            rows.append(
                (
                    cycle * dt,
                    phases.index(carrier.phase),
                    hands.q,
                    hands.pads,
                    hands.force,
                    box,
                    turn,
                    sample.position,
                    sample.quaternion,
                    sample.clutch,
                )
            )
        if carrier.phase in ENDED:
            break
        carrier.step(hands.force)
        follower.follow(carrier.pads, carrier.velocities, hands.load)
        world.drive(follower.q, follower.qdot, follower.torque, steps)
        follower.advance()
    time, phase, joints, pads, pressed, box, turn, position, handle, clutch = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    return Demonstrated(
        time=frozen(time),
        phase=phase.astype(np.int8),
        joints=frozen(joints),
        pads=frozen(pads),
        force=frozen(pressed),
        box=frozen(box),
        turn=frozen(turn),
        master=frozen(position),
        handle=frozen(handle),
        clutch=clutch.astype(np.bool_),
        lost=dt * way.lost,
        limited=dt * way.limited,
        ended=carrier.phase,
    )
