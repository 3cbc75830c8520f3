"""The simulated world in PyBullet: two arms with pads, a box, a pedestal and a shelf, at 1 kHz.

The arms are driven by torques: computed torque, which makes each joint follow its reference like a mass on a damped
spring (`drive`). What the world says of forces is of two kinds: what a wrist's sensor measures, with noise and bias,
and what the contacts truly are. Every roll-out builds its own world: a restored one would not give the same bytes.

Not here: what the arms are told to do (`stages/policy`), and which arms (`robots.py`).
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.trajectory import Array
from stages.world.chain import forward, reach
from stages.world.engine import bullet
from stages.world.parameters import Scene
from stages.world.pots import Pot, Pots
from stages.world.robots import PAD_MASS, Arm, arm

STEP = 1e-3
"""Seconds of one step of the simulation."""

GRAVITY = 9.81
ITERATIONS = 50
"""Of Bullet's constraint solver in a step."""

CONTACT_STIFFNESS, CONTACT_DAMPING = 1500.0, 30.0
"""N/m and N s/m of each contact point of a pad: rubber. Rigid pads make forces of 0 to 84 N."""

PAD_FRICTION, SUPPORT_FRICTION = 1.0, 0.8

SUPPORT = 0.18
"""Edge of pedestal and shelf, metres: of a longer box pads pass beside them."""

RUNAWAY = 10.0
"""Metres from the middle between the bases beyond which no pad can be."""

ACCURACY = 1e-6
"""Metres and rad within which a pose counts as reached."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hands:
    """The two arms as measured.

    Attributes:
        q, qdot: arrays, shape (2, m), rad and rad/s.
        pads: array, shape (2, 3), metres: middles of the pads' faces.
        velocity: array, shape (2, 3), m/s, of those.
        force: array, shape (2,), newtons: pressing forces at the wrists, with noise and bias.
        load: array, shape (2,), newtons: what pulls each pad down beside its own weight.
    """

    q: Array
    qdot: Array
    pads: Array
    velocity: Array
    force: Array
    load: Array


class World:
    """Two arms and a box; use as a context manager, so that the simulator is left in any case."""

    def __init__(
        self,
        scene: Scene,
        generator: np.random.Generator,
        location: str = "rollout.scene",
        pots: Sequence[Pot] = (),
    ) -> None:
        """Build the scene as it is, without variation.

        `generator`: of the sensors' noise. `location`: dotted place. `pots`: what stands in the way.
        Raises ParameterError where pads could not reach the box at its start or at its goal.
        """
        self.scene, self._noise, self._location, self._pots = scene, generator, location, tuple(pots)
        self.arms: tuple[Arm, Arm] = (
            arm(scene.robot, True, f"{location}.robot"),
            arm(scene.robot, False, f"{location}.robot"),
        )
        self.turns = [_facing(one, side) for one, side in zip(self.arms, (1.0, -1.0), strict=True)]
        self._bullet = bullet()
        self.client = self._bullet.connect(self._bullet.DIRECT)
        try:
            self._build()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> World:
        """The world itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the simulator."""
        self.close()

    def close(self) -> None:
        """Leave the simulator."""
        if self.client >= 0:
            self._bullet.disconnect(self.client)
            self.client = -1

    def _build(self) -> None:
        engine, client, scene = self._bullet, self.client, self.scene
        engine.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=client)
        engine.setPhysicsEngineParameter(
            fixedTimeStep=STEP,
            numSolverIterations=ITERATIONS,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        self.bodies = [self._load(one) for one in self.arms]
        self.joints = [list(one.turning) for one in self.arms]
        self.supports = [self._support(name, getattr(scene, name)) for name in ("start", "goal")]
        self.box = self._body(scene.mass, scene.box, scene.start, scene.centre_of_mass)
        engine.changeDynamics(
            self.box, -1, lateralFriction=scene.friction, linearDamping=0.0, angularDamping=0.0, physicsClientId=client
        )
        self.pots = Pots(engine, client, self._pots, self.box, self.bodies)

    def _load(self, one: Arm) -> int:
        engine, client = self._bullet, self.client
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "arm.urdf")
            path.write_text(one.description, encoding="utf-8")
            body = int(engine.loadURDF(str(path), one.chain.place.tolist(), useFixedBase=True, physicsClientId=client))
        for joint in range(one.pad + 1):
            engine.changeDynamics(
                body, joint, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client
            )
        engine.changeDynamics(
            body,
            one.pad,
            lateralFriction=PAD_FRICTION,
            contactStiffness=CONTACT_STIFFNESS,
            contactDamping=CONTACT_DAMPING,
            physicsClientId=client,
        )
        engine.enableJointForceTorqueSensor(body, one.pad, True, physicsClientId=client)
        # Bullet's own motors hold every joint until they are switched off.
        engine.setJointMotorControlArray(
            body, one.turning, engine.VELOCITY_CONTROL, forces=[0.0] * len(one.turning), physicsClientId=client
        )
        return body

    def _support(self, name: str, place: Any) -> int:
        """What the box stands on at its start or goal, up to its lower face."""
        half = 0.5 * self.scene.box[2]
        height = place[2] - half
        if height <= 0.0:
            raise ParameterError(
                f"{self._location}.{name}",
                f"{list(place)} puts the box into the ground: its centre must be higher than {half:g} m.",
            )
        body = self._body(0.0, (SUPPORT, SUPPORT, height), (place[0], place[1], height / 2.0), (0.0, 0.0, 0.0))
        self._bullet.changeDynamics(body, -1, lateralFriction=SUPPORT_FRICTION, physicsClientId=self.client)
        return body

    def _body(self, mass: float, edges: Any, place: Any, centre_of_mass: Any) -> int:
        engine, client = self._bullet, self.client
        shape = engine.createCollisionShape(
            engine.GEOM_BOX,
            halfExtents=[e / 2.0 for e in edges],
            collisionFramePosition=[-c for c in centre_of_mass],
            physicsClientId=client,
        )
        at = [p + c for p, c in zip(place, centre_of_mass, strict=True)]
        return int(engine.createMultiBody(mass, shape, -1, at, physicsClientId=client))

    def put(self, pads: Array) -> Array:
        """Put both arms so that their pads are at `pads`, shape (2, 3), metres, at rest; return q, shape (2, m), rad.

        Raises ParameterError where an arm cannot.
        """
        found = []
        for side in range(2):
            found.append(self.joints_at(side, pads[side]))
        self.pose(np.array(found))
        return np.array(found)

    def pose(self, q: Array) -> None:
        """Put both arms to joint angles, shape (2, m), rad, at rest."""
        for body, joints, angles in zip(self.bodies, self.joints, q, strict=True):
            for joint, angle in zip(joints, angles, strict=True):
                self._bullet.resetJointState(body, joint, float(angle), physicsClientId=self.client)

    def joints_at(self, side: int, pad: Array) -> Array:
        """Joint angles, shape (m,), rad, at which a pad is at a place, shape (3,), metres. Raises ParameterError."""
        one = self.arms[side]
        q = np.array(one.posture)
        missing = reach(one.chain, q, np.array(pad), self.turns[side], 500, ACCURACY)
        if missing > ACCURACY or (q < one.low).any() or (q > one.high).any():
            raise ParameterError(
                self._location,
                f"the {('left', 'right')[side]} arm cannot bring its pad to [{', '.join(f'{v:.3g}' for v in pad)}] m: "
                "move start or goal nearer, or take a shorter box.",
            )
        return q

    def hands(self) -> Hands:
        """What is measured now; draws the sensors' noise."""
        engine, client = self._bullet, self.client
        q, qdot, force, load = [], [], np.empty(2), np.empty(2)
        pads, velocity = np.empty((2, 3)), np.empty((2, 3))
        for side, (body, joints, one) in enumerate(zip(self.bodies, self.joints, self.arms, strict=True)):
            states = engine.getJointStates(body, [*joints, one.pad], physicsClientId=client)
            q.append([state[0] for state in states[:-1]])
            qdot.append([state[1] for state in states[:-1]])
            rotation, jacobian = np.empty((3, 3)), np.empty((6, len(joints)))
            forward(one.chain, np.array(q[side]), pads[side], rotation, jacobian)
            velocity[side] = jacobian[:3] @ np.array(qdot[side])
            reaction = rotation @ np.array(states[-1][2][:3])
            force[side] = float(states[-1][2][2]) + self.scene.bias[side]
            load[side] = reaction[2] - PAD_MASS * GRAVITY
        if not (np.isfinite(pads).all() and np.abs(pads).max() < RUNAWAY):
            raise DataError(self._location, "the simulation ran away: lower the admittance's gains, or dt.")
        if self.scene.noise:
            force += self.scene.noise * self._noise.normal(size=2)
        return Hands(q=np.array(q), qdot=np.array(qdot), pads=pads, velocity=velocity, force=force, load=load)

    def drive(self, q: Array, qdot: Array, torque: Array, steps: int, pushes: Array | None = None) -> None:
        """Let `steps` steps pass in which the joints follow references that move on at `qdot`.

        `q`, `qdot`: arrays, shape (2, m), rad and rad/s: references now. `torque`: array, shape (2, m), newton metres,
        beside what the motion needs. `pushes`: array, shape (2, 3), newtons: from outside, on each arm's flange, behind
        the wrist's sensor.
        """
        engine, client = self._bullet, self.client
        read, inverse = engine.getJointStates, engine.calculateInverseDynamics
        command, mode, advance = engine.setJointMotorControlArray, engine.TORQUE_CONTROL, engine.stepSimulation
        # Lists: for seven numbers they are three times as fast as arrays.
        arms = [
            (
                body,
                joints,
                one.stiffness.tolist(),
                (2.0 * np.sqrt(one.stiffness)).tolist(),
                one.torque.tolist(),
                q[side].tolist(),
                qdot[side].tolist(),
                torque[side].tolist(),
            )
            for side, (body, joints, one) in enumerate(zip(self.bodies, self.joints, self.arms, strict=True))
        ]
        for step in range(1, steps + 1):
            passed = step * STEP
            for body, joints, stiffness, damping, most, wanted, rate, more in arms:
                states = read(body, joints, physicsClientId=client)
                at, moving = [state[0] for state in states], [state[1] for state in states]
                acceleration = [
                    k * (p + passed * v - x) + c * (v - w)
                    for k, c, p, v, x, w in zip(stiffness, damping, wanted, rate, at, moving, strict=True)
                ]
                needed = inverse(body, at, moving, acceleration, physicsClientId=client)
                forces = [min(max(n + m, -t), t) for n, m, t in zip(needed, more, most, strict=True)]
                command(body, joints, mode, forces=forces, physicsClientId=client)
            if pushes is not None:
                self._push(pushes)
            advance(physicsClientId=client)

    def _push(self, pushes: Array) -> None:
        """Let forces from outside, shape (2, 3), newtons, act on the flanges for a step."""
        for body, one, force in zip(self.bodies, self.arms, pushes, strict=True):
            at = self._bullet.getLinkState(body, one.turning[-1], physicsClientId=self.client)[0]
            self._bullet.applyExternalForce(
                body, one.turning[-1], force.tolist(), at, self._bullet.WORLD_FRAME, physicsClientId=self.client
            )

    def box_pose(self) -> tuple[Array, Array]:
        """Centre of the box (not of its mass), shape (3,), metres, and its quaternion x y z w, shape (4,)."""
        at, turn = self._bullet.getBasePositionAndOrientation(self.box, physicsClientId=self.client)
        rotation = np.array(self._bullet.getMatrixFromQuaternion(turn)).reshape(3, 3)
        centre = np.array(at) - rotation @ np.array(self.scene.centre_of_mass)
        if not np.isfinite(centre).all():
            raise DataError(self._location, "the simulation ran away: the box is nowhere.")
        return centre, np.array(turn)

    def put_box(self, centre: Array, turn: Array) -> None:
        """Put the box (its centre, not that of its mass) to a place, shape (3,), metres, and a quaternion x y z w."""
        rotation = np.array(self._bullet.getMatrixFromQuaternion(turn.tolist())).reshape(3, 3)
        at = centre + rotation @ np.array(self.scene.centre_of_mass)
        self._bullet.resetBasePositionAndOrientation(self.box, at.tolist(), turn.tolist(), physicsClientId=self.client)

    def contact_forces(self) -> Array:
        """The true normal forces between each pad and the box, shape (2,), newtons."""
        found = np.zeros(2)
        for side, (body, one) in enumerate(zip(self.bodies, self.arms, strict=True)):
            contacts = self._bullet.getContactPoints(body, self.box, one.pad, -1, physicsClientId=self.client)
            found[side] = sum(contact[9] for contact in contacts)
        return found

    def touching(self) -> bool:
        """Whether anything is inside of something else: an arm of a support, the box or the other arm; the box of one.

        The box stands on its own support, and touches it.
        """
        engine, client = self._bullet, self.client
        engine.performCollisionDetection(physicsClientId=client)
        everything = range(engine.getNumBodies(physicsClientId=client))
        pairs = [(body, other) for body in self.bodies for other in everything if other != body]
        pairs += [(self.box, support) for support in self.supports]
        return any(
            contact[8] < -ACCURACY
            for body, other in pairs
            for contact in engine.getContactPoints(body, other, physicsClientId=client)
        )


def _facing(one: Arm, side: float) -> Array:
    """The pad's orientation: its axis points at the box; about it, as in the posture. Shape (3, 3)."""
    rotation, jacobian = np.empty((3, 3)), np.empty((6, one.posture.shape[0]))
    forward(one.chain, np.array(one.posture), np.empty(3), rotation, jacobian)
    axis = np.array([0.0, -side, 0.0])
    across = rotation[:, 0] - axis * (rotation[:, 0] @ axis)
    across /= math.sqrt(across @ across)
    return np.ascontiguousarray(np.column_stack([across, np.cross(axis, across), axis]))
