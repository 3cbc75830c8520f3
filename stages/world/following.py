"""From places of the pads to references of the joints: inverse kinematics a cycle at a time.

The references' own kinematics are inverted, not those of the joints as measured: a pad that is pressed off its place
must not be pulled back, or the joints would fight the admittance. Not here: who commands the pads, and the torques.
"""

from __future__ import annotations

import numpy as np

from stages.compiled import compiled
from stages.trajectory import Array
from stages.world.bullet import World
from stages.world.chain import Chain, forward, joint_velocity, turn_between

RETURN = 50.0
"""1/s, at which the pose's error is taken back."""

POSTURE = 1.0
"""1/s, at which an arm returns to its posture where the pad leaves it free to."""

LOAD_CUTOFF = 5.0
"""Hz, of the low-pass on the load that is fed forward."""


class Follower:
    """Joint references of both arms.

    Attributes:
        q, qdot: arrays, shape (2, m), rad and rad/s.
        torque: array, shape (2, m), newton metres: what the load needs.
    """

    def __init__(self, world: World, q: Array, dt: float) -> None:
        """Begin at q, shape (2, m), rad, which becomes the posture; `dt`: seconds a cycle."""
        self.q, self.qdot, self.torque = np.array(q), np.zeros(q.shape), np.zeros(q.shape)
        self._posture, self._dt = np.array(q), dt
        self._chains = [arm.chain for arm in world.arms]
        self._turns, self._load = world.turns, np.zeros(2)
        self._low, self._high = (np.array([getattr(arm, name) for arm in world.arms]) for name in ("low", "high"))

    def follow(self, pads: Array, velocities: Array, load: Array) -> None:
        """Take in where pads are to be, shape (2, 3), metres, m/s, and what pulls them down, shape (2,), newtons.

        The payload is fed forward as the wrists feel it, downwards only: a support would be pressed on for ever.
        """
        self._load += (1.0 - np.exp(-2.0 * np.pi * LOAD_CUTOFF * self._dt)) * (load - self._load)
        for side, chain in enumerate(self._chains):
            track(
                chain,
                self.q[side],
                self._posture[side],
                pads[side],
                velocities[side],
                self._turns[side],
                max(self._load[side], 0.0),
                self.qdot[side],
                self.torque[side],
            )

    def advance(self) -> None:
        """Let a cycle pass."""
        self.q = np.clip(self.q + self._dt * self.qdot, self._low, self._high)


@compiled
def track(
    chain: Chain,
    q: Array,
    posture: Array,
    pad: Array,
    velocity: Array,
    turn: Array,
    load: float,
    qdot: Array,
    torque: Array,
) -> None:
    """Write joint velocities and the load's torques of one arm; `qdot`, `torque`: shape (m,). Will be modified."""
    at, frame, jacobian, twist = np.empty(3), np.empty((3, 3)), np.empty((6, q.shape[0])), np.empty(6)
    forward(chain, q, at, frame, jacobian)
    twist[:3] = velocity + RETURN * (pad - at)
    twist[3:] = RETURN * turn_between(turn, frame)
    qdot[:] = joint_velocity(jacobian, twist, POSTURE * (posture - q))
    torque[:] = load * jacobian[2]
