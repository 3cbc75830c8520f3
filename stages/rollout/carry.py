"""One box carried once: policy and arms in the simulated world, and what was recorded. Paper Fig. 5.

Not here: which boxes (`physics.py`), the phases (`stages/policy/carrying.py`) and the simulator (`stages/world`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.parameters import Avoidance, Obstacle
from stages.policy.carrying import ENDED, Carrier, Clamp, Phase
from stages.policy.controller import Controller
from stages.policy.coupled import Coupling
from stages.policy.mutual import NOBODY, Arms
from stages.policy.outcome import Outcome, Status
from stages.rollout.carry_guard import Guard, outcome_of
from stages.rollout.carry_way import Moves, PolicyWay
from stages.trajectory import Array, frozen
from stages.world.arm_pushes import ArmPush, ArmPushes
from stages.world.bullet import STEP, Hands, World
from stages.world.following import Follower
from stages.world.parameters import Scene
from stages.world.pots import Pot

AFTER = 0.8
"""Seconds that are recorded on after the arms have stopped: a box that is lost falls, or hangs on."""

STOPS = (Phase.LOST, Phase.STOPPED)

PHASES, STATUSES = tuple(Phase), tuple(Status)

TYPES = {"gate": np.bool_, "phase": np.int8, "named": np.int8, "acting": np.bool_, "status": np.int8}
"""Of columns that are no floating-point numbers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CarryTask:
    """One box to be carried.

    Attributes:
        scene: as it is for this box, without variation.
        model: the learned system, with its goal where the box is to stand.
        coupling: how p_hat follows x.
        clamp: how the box is held.
        force: F_d, newtons.
        top_speed: of the demonstrations, m/s.
        dt: seconds a cycle.
        stop_distance: metres.
        max_duration: seconds.
        record: samples a second.
        pushes: on the arms.
        obstacles: as the policy takes them.
        radii: of the safety spheres about their centres, metres.
        avoidance: how it avoids them.
        pots: what stands in them.
    """

    scene: Scene
    model: LpvDs
    coupling: Coupling
    clamp: Clamp
    force: float
    top_speed: float
    dt: float
    stop_distance: float
    max_duration: float
    record: float
    pushes: tuple[ArmPush, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    radii: tuple[float, ...] = ()
    avoidance: Avoidance | None = None
    pots: tuple[Pot, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Carried:
    """What happened to a box; n samples.

    Attributes:
        time: array, shape (n,), seconds.
        x, p_hat: arrays, shape (n, 3), metres.
        gate: array of bool, shape (n,): x moves in the step that follows the sample.
        phase: array of int, shape (n,): an index into `PHASES`.
        q, qdot: arrays, shape (n, 2, m), rad and rad/s.
        pads: array, shape (n, 2, 3), metres, as measured.
        commanded: array, shape (n, 2, 3), metres: by the policy, also of an arm that does not hear it.
        box, turn: arrays, shapes (n, 3), metres, and (n, 4), quaternion x y z w.
        force: array, shape (n, 2), newtons, as measured and filtered.
        contact: array, shape (n, 2), newtons, as they truly are.
        desired: array, shape (n,), newtons: F_d.
        residual: array, shape (n, 2), metres: by how much each pad is elsewhere than if nobody touched it, as found.
        named: array of int, shape (n,): the arm that is taken for pushed, 0 or 1; -1: none.
        acting: array of bool, shape (n, 2): the arms that truly are pushed.
        clearance: array, shape (n,), metres: least distance of the box's middle from a safety sphere since the sample
            before; inf: there is none.
        box_room, arm_room: arrays, shape (n,), metres: how far box and arms are from the nearest pot; inf: there is
            none.
        status: array of int, shape (n,): codes of `stages.policy.outcome.Status`, of the step that follows.
        box_contacts, arm_contacts: cycles in which the box, or an arm, touched a pot.
        length, mass: what the controller took the box for in the end, metres and kg; nan: it was not weighed.
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
    desired: Array
    residual: Array
    named: NDArray[np.int8]
    acting: NDArray[np.bool_]
    clearance: Array
    box_room: Array
    arm_room: Array
    status: NDArray[np.int8]
    box_contacts: int
    arm_contacts: int
    length: float
    mass: float
    outcome: Outcome


class Watch:
    """How near box and arms come to safety spheres and pots.

    Attributes:
        box_contacts, arm_contacts: cycles in which the box, or an arm, touched a pot.
    """

    def __init__(self, task: CarryTask) -> None:
        """Nothing has been seen."""
        self._radii = np.array(task.radii)
        self._pots = bool(task.pots)
        self._clear = math.inf
        self.box_contacts = self.arm_contacts = 0

    def look(self, world: World, centres: Array) -> None:
        """Look in a cycle; `centres`: array, shape (m, 3), metres, of the spheres."""
        if self._radii.size:
            away = np.linalg.norm(world.box_pose()[0] - centres, axis=1) - self._radii
            self._clear = min(self._clear, float(away.min()))
        if self._pots:
            box, arms = world.pots.touched()
            self.box_contacts += box
            self.arm_contacts += arms

    def take(self, world: World) -> tuple[float, float, float]:
        """Clearance since the last time, and room of the box and of the arms now, metres; inf: there is nothing."""
        clear, self._clear = self._clear, math.inf
        return (clear, *(world.pots.room() if self._pots else (math.inf, math.inf)))


class Recorder:
    """Rows of `Carried`, one a sample."""

    def __init__(self) -> None:
        """There is none."""
        self._rows: list[dict[str, Any]] = []

    def sample(self, time: float, world: World, hands: Hands, way: PolicyWay, carrier: Carrier, watch: Watch) -> None:
        """Take down what is now; `time`: seconds. What becomes of the step that follows is `follow`'s."""
        box, turn = world.box_pose()
        clearance, box_room, arm_room = watch.take(world)
        self._rows.append(
            {
                "time": time,
                "x": way.controller.x,
                "p_hat": way.p_hat,
                "phase": PHASES.index(carrier.phase),
                "q": hands.q,
                "qdot": hands.qdot,
                "pads": hands.pads,
                "commanded": carrier.pads.copy(),
                "box": box,
                "turn": turn,
                "force": carrier.forces,
                "contact": world.contact_forces(),
                "desired": carrier.desired,
                "clearance": clearance,
                "box_room": box_room,
                "arm_room": arm_room,
            }
        )
        self.follow(way, carrier, np.zeros(2, dtype=np.bool_))

    def follow(self, way: PolicyWay, carrier: Carrier, acting: NDArray[np.bool_]) -> None:
        """Take down what came of the step after the last sample; `acting`: shape (2,): the arms that are pushed."""
        mutual, controller = carrier.mutual, way.controller
        self._rows[-1] |= {
            "gate": controller.moving,
            "status": STATUSES.index(controller.status),
            "residual": np.zeros(2) if mutual is None else np.linalg.norm(mutual.residual, axis=1),
            "named": NOBODY if mutual is None else mutual.pushed,
            "acting": acting.copy(),
        }

    def carried(self, carrier: Carrier, watch: Watch, outcome: Callable[[Array, Array], Outcome]) -> Carried:
        """All of it; `outcome`: from where the box is in the end, and its quaternion, to how it ended."""
        columns: dict[str, Any] = {name: np.array([row[name] for row in self._rows]) for name in self._rows[0]}
        for name, column in columns.items():
            columns[name] = column.astype(TYPES[name]) if name in TYPES else frozen(column)
        return Carried(
            **columns,
            box_contacts=watch.box_contacts,
            arm_contacts=watch.arm_contacts,
            length=carrier.box.length,
            mass=carrier.box.mass,
            outcome=outcome(columns["box"][-1], columns["turn"][-1]),
        )


def carry(task: CarryTask, generator: np.random.Generator) -> Carried:
    """Carry one box; `generator`: of the sensors' noise."""
    dt, start, reaches = task.dt, np.array(task.scene.start), np.array([pot.reach for pot in task.pots])
    controller = Controller(
        task.model,
        start,
        dt=dt,
        coupling=task.coupling,
        top_speed=task.top_speed,
        obstacles=task.obstacles,
        avoidance=task.avoidance,
    )
    way, moves = PolicyWay(controller, task.stop_distance), Moves(task.obstacles, controller)
    carrier = Carrier(way, start, task.clamp, dt, task.force)
    pushes, guard, watch, recorder = ArmPushes(task.pushes, dt), Guard(dt), Watch(task), Recorder()
    steps, every = round(dt / STEP), max(1, round(1.0 / (task.record * dt)))
    left, carrying, fault = AFTER, 0, None
    with World(task.scene, generator, pots=task.pots) as world:
        follower = Follower(world, world.put(carrier.pads), dt)
        follower.shun(moves.centres, reaches)
        for cycle in range(round(task.max_duration / dt) + 1):
            hands = world.hands()
            watch.look(world, moves.centres)
            stopping = carrier.phase in STOPS and left > 0.0
            over = carrier.phase in ENDED and not stopping
            sampled = cycle % every == 0 or over
            if sampled:
                recorder.sample(cycle * dt, world, hands, way, carrier, watch)
            if over:
                break
            force = None
            if stopping:
                left -= dt
                follower.stop()
            else:
                moves.see(carrying * dt)
                before = controller.x
                carrier.step(hands.force, Arms(hands.pads, hands.velocity, hands.load))
                pads, velocities, leads = carrier.pads.copy(), carrier.velocities.copy(), carrier.phase is Phase.CARRY
                carrying += leads
                force = pushes.act(carrying, way.steps, pads, velocities, carrying=leads)
                follower.follow(pads, velocities, carrier.payload(hands.load))
                moved = float(np.linalg.norm(controller.x - before))
                fault = guard.fault(follower, carrier.mutual, pushes.acting) or guard.stuck(moved, carrying=leads)
                if fault is not None:
                    carrier.stop()
                    follower.stop()
                if sampled:
                    recorder.follow(way, carrier, pushes.acting)
            if moves.moving:
                world.pots.move(moves.centres)
                follower.shun(moves.centres, reaches)
            world.drive(follower.q, follower.qdot, follower.torque, steps, force)
            follower.advance()
    return recorder.carried(carrier, watch, lambda box, turn: fault or outcome_of(carrier.phase, box, turn, task.scene))
