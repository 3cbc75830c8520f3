"""One box carried once: policy and arms in the simulated world, and what was recorded. Paper Fig. 5.

Not here: which boxes (`physics.py`), the phases (`stages/policy/carrying.py`) and the simulator (`stages/world`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stages.dynamics.lpvds import LpvDs
from stages.policy.carrying import ENDED, Carrier, Clamp, Phase, tilt
from stages.policy.controller import Controller
from stages.policy.coupled import Coupling
from stages.policy.outcome import Outcome
from stages.trajectory import Array, frozen
from stages.world.bullet import STEP, World
from stages.world.following import Follower
from stages.world.parameters import Scene

MISPLACED, TILTED = 0.020, 10.0
"""Metres from the goal, and degrees, beyond which a box that was let go is not delivered."""

FALL = 0.8
"""Seconds that are recorded on after the box is lost: it falls, or hangs on."""

PHASES = tuple(Phase)


class PolicyWay:
    """The learned system as the way of the midpoint: the executed state of the coupled system is what is commanded."""

    def __init__(self, controller: Controller, stop_distance: float) -> None:
        """`stop_distance`: metres from the goal at which the way is at its end."""
        self.controller, self._stop = controller, stop_distance
        self.p_hat: Array = controller.x

    def step(self, midpoint: Array) -> Array:
        """The next p_hat, shape (3,), metres. Paper eqs. (9)-(12)."""
        self.p_hat = self.controller.step(midpoint)
        return self.p_hat

    @property
    def ended(self) -> bool:
        """Whether p_hat is at the goal."""
        return bool(np.linalg.norm(self.p_hat - self.controller.model.goal) <= self._stop)


@dataclass(frozen=True, kw_only=True, eq=False)
class Carried:
    """What happened to a box; n samples.

    Attributes:
        time: array, shape (n,), seconds.
        x, p_hat: arrays, shape (n, 3), metres.
        gate: array of bool, shape (n,).
        phase: array of int, shape (n,): an index into `PHASES`.
        q, qdot: arrays, shape (n, 2, m), rad and rad/s.
        pads: array, shape (n, 2, 3), metres, as measured.
        commanded: array, shape (n, 2, 3), metres.
        box, turn: arrays, shapes (n, 3), metres, and (n, 4), quaternion x y z w.
        force: array, shape (n, 2), newtons, as measured and filtered.
        contact: array, shape (n, 2), newtons, as they truly are.
        outcome: how it ended.
    """

    time: Array
    x: Array
    p_hat: Array
    gate: NDArray[np.bool_]
    phase: NDArray[np.int8]
    q: Array
    qdot: Array
    pads: Array
    commanded: Array
    box: Array
    turn: Array
    force: Array
    contact: Array
    outcome: Outcome


def carry(
    scene: Scene,
    model: LpvDs,
    coupling: Coupling,
    clamp: Clamp,
    generator: np.random.Generator,
    *,
    force: float,
    top_speed: float,
    dt: float,
    stop_distance: float,
    max_duration: float,
    record: float,
) -> Carried:
    """Carry one box.

    Args:
        scene: as it is for this box, without variation.
        model: the learned system, with its goal where the box is to stand.
        coupling: how p_hat follows x.
        clamp: how the box is held.
        generator: of the sensors' noise.
        force: F_d, newtons.
        top_speed: of the demonstrations, m/s.
        dt: seconds a cycle.
        stop_distance: metres.
        max_duration: seconds.
        record: samples a second.
    """
    start = np.array(scene.start)
    controller = Controller(model, start, dt=dt, coupling=coupling, top_speed=top_speed)
    way = PolicyWay(controller, stop_distance)
    carrier = Carrier(way, start, clamp, dt, force)
    steps, every = round(dt / STEP), max(1, round(1.0 / (record * dt)))
    rows: list[tuple[object, ...]] = []
    left = FALL
    with World(scene, generator) as world:
        follower = Follower(world, world.put(carrier.pads), dt)
        for cycle in range(round(max_duration / dt) + 1):
            hands = world.hands()
            falling = carrier.phase is Phase.LOST and left > 0.0
            over = carrier.phase in ENDED and not falling
            if cycle % every == 0 or over:
                box, turn = world.box_pose()
                rows.append(
                    (
                        cycle * dt,
                        controller.x,
                        way.p_hat,
                        controller.moving,
                        PHASES.index(carrier.phase),
                        hands.q,
                        hands.qdot,
                        hands.pads,
                        carrier.pads.copy(),
                        box,
                        turn,
                        carrier.forces,
                        world.contact_forces(),
                    )
                )
            if over:
                break
            if falling:
                left -= dt
                follower.qdot[:] = follower.torque[:] = 0.0
            else:
                carrier.step(hands.force)
                follower.follow(carrier.pads, carrier.velocities, hands.load)
            world.drive(follower.q, follower.qdot, follower.torque, steps)
            follower.advance()
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    time, x, p_hat, gate, phase, q, qdot, pads, commanded, box, turn, filtered, contact = columns
    return Carried(
        time=frozen(time),
        x=frozen(x),
        p_hat=frozen(p_hat),
        gate=gate,
        phase=phase.astype(np.int8),
        q=frozen(q),
        qdot=frozen(qdot),
        pads=frozen(pads),
        commanded=frozen(commanded),
        box=frozen(box),
        turn=frozen(turn),
        force=frozen(filtered),
        contact=frozen(contact),
        outcome=_outcome(carrier.phase, box[-1], turn[-1], np.array(scene.goal)),
    )


def _outcome(phase: Phase, box: Array, turn: Array, goal: Array) -> Outcome:
    if phase is Phase.MISSED:
        return Outcome.NOT_GRIPPED
    if phase is Phase.LOST:
        return Outcome.LOST_BOX
    if phase is not Phase.DONE:
        return Outcome.TIMEOUT
    delivered = np.linalg.norm(box - goal) <= MISPLACED and float(tilt(turn)) <= TILTED
    return Outcome.ARRIVED if delivered else Outcome.MISPLACED
