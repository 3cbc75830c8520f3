"""From places of the pads to references of the joints: inverse kinematics a cycle at a time.

The references' own kinematics are inverted, not those of the joints as measured: a pad that is pressed off its place
must not be pulled back, or the joints would fight the admittance. Not here: who commands the pads, and the torques.
"""

from __future__ import annotations

import math

import numpy as np

from stages.compiled import compiled
from stages.trajectory import Array
from stages.world.bullet import World
from stages.world.chain import Chain, forward, joint_velocity, lean_away, turn_between

RETURN = 50.0
"""1/s, at which the pose's error is taken back."""

POSTURE = 1.0
"""1/s, at which an arm returns to its posture where the pad leaves it free to."""

NEAR, LEAN = 0.15, 10.0
"""Metres from a pot at which links begin to lean away from it, where the pad leaves them free to, and 1/s."""

LOAD_CUTOFF = 5.0
"""Hz, of the low-pass on the load that is fed forward."""


class Follower:
    """Joint references of both arms.

    Attributes:
        q, qdot: arrays, shape (2, m), rad and rad/s.
        torque: array, shape (2, m), newton metres: what the load needs.
        missing: array, shape (2,), metres: how far the references are from where the pads are to be.
        limited: array of bool, shape (2,): whether a joint is held back by its limit.
    """

    def __init__(self, world: World, q: Array, dt: float) -> None:
        """Begin at q, shape (2, m), rad, which becomes the posture; `dt`: seconds a cycle."""
        self.q, self.qdot, self.torque = np.array(q), np.zeros(q.shape), np.zeros(q.shape)
        self._posture, self._dt = np.array(q), dt
        self._chains = [arm.chain for arm in world.arms]
        self._turns, self._load = world.turns, np.zeros(2)
        self._balls = np.zeros((0, 4))
        self.missing, self.limited = np.zeros(2), np.zeros(2, dtype=np.bool_)
        self._speed = [arm.speed for arm in world.arms]
        self._low, self._high = (np.array([getattr(arm, name) for arm in world.arms]) for name in ("low", "high"))

    def shun(self, centres: Array, radii: Array) -> None:
        """Let the links lean away from balls, centres, shape (k, 3), metres, and radii, shape (k,), metres."""
        self._balls = np.column_stack([centres, radii])

    def follow(self, pads: Array, velocities: Array, load: Array) -> None:
        """Take in where pads are to be, shape (2, 3), metres, m/s, and what pulls them down, shape (2,), newtons.

        The payload is fed forward as the wrists feel it, downwards only: a support would be pressed on for ever.
        """
        self._load += (1.0 - np.exp(-2.0 * np.pi * LOAD_CUTOFF * self._dt)) * (load - self._load)
        for side, chain in enumerate(self._chains):
            self.missing[side] = track(
                chain,
                self.q[side],
                self._posture[side],
                pads[side],
                velocities[side],
                self._turns[side],
                self._speed[side],
                self._balls,
                max(self._load[side], 0.0),
                self.qdot[side],
                self.torque[side],
            )

    def advance(self) -> None:
        """Let a cycle pass."""
        wanted = self.q + self._dt * self.qdot
        self.q = np.clip(wanted, self._low, self._high)
        self.limited = (self.q != wanted).any(axis=1)

    def dexterity(self, side: int) -> float:
        """Smallest singular value of an arm's Jacobian, m/rad: near 0 it is stretched out, or its wrist is singular."""
        at, frame, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, self.q.shape[1]))
        forward(self._chains[side], self.q[side], at, frame, jacobian)
        return float(np.linalg.svd(jacobian, compute_uv=False)[-1])

    def stop(self) -> None:
        """Stand still: references do not move on."""
        self.qdot[:] = 0.0


@compiled
def track(
    chain: Chain,
    q: Array,
    posture: Array,
    pad: Array,
    velocity: Array,
    turn: Array,
    speed: Array,
    balls: Array,
    load: float,
    qdot: Array,
    torque: Array,
) -> float:
    """Write joint velocities and the load's torques of one arm; return how far its references are from the pad, metres.

    No joint is faster than its limit, `speed`, shape (m,), rad/s: all are slowed down alike. Links lean away from
    `balls`, shape (k, 4): centres and radii, metres. `qdot`, `torque`: shape (m,). Will be modified.
    """
    at, frame, jacobian, twist = np.empty(3), np.empty((3, 3)), np.empty((6, q.shape[0])), np.empty(6)
    forward(chain, q, at, frame, jacobian)
    twist[:3] = velocity + RETURN * (pad - at)
    twist[3:] = RETURN * turn_between(turn, frame)
    pull = POSTURE * (posture - q)
    for k in range(balls.shape[0]):
        lean_away(chain, q, balls[k, :3], balls[k, 3], NEAR, LEAN, pull)
    qdot[:] = joint_velocity(jacobian, twist, pull)
    fastest = np.abs(qdot / speed).max()
    if fastest > 1.0:
        qdot /= fastest
    torque[:] = load * jacobian[2]
    return math.sqrt(((pad - at) ** 2).sum())
