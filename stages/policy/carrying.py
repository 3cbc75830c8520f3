"""Carrying a box between two pads: approach, grip, carry along a way, set down, let go. Paper eqs. (13)-(18).

In the plane across the clamp axis pads are where eq. (13) puts them, along it the admittance of eqs. (15)-(18) moves
them out or in: hybrid force-position control. The velocity of the way is fed forward, or a moving box would cost
D v/(k_p + 1) of force. One call a cycle, measured forces in, places of the pads out. Not here: joints (`stages/world`),
and what happens when an arm is pushed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from stages.policy.admittance import FORCE, OFFSET, RATE, Admittance, begin, comply, leak, sense, settled_force
from stages.policy.estimation import KNOWN, Belief, BoxEstimate
from stages.policy.mutual import NOBODY, SIDES, Arms, MutualFollowing
from stages.policy.parameters import FollowingParameters
from stages.trajectory import Array

TOUCH = 0.2
"""Share of F_d from which a pad counts as touching."""

SETTLED = 0.1
"""Share of F_d within which the force has to be of what it settles at, before the box is carried."""

GRIP_TIME, GRIP_PATIENCE = 0.5, 5.0
"""Seconds that the force has to be settled; seconds after which a grip has failed."""

TOO_DEEP = 0.04
"""Metres beyond the box's face at which a pad that still touches nothing has missed it."""

LEAST = 0.04
"""Share of F_d below which a pad has lost the box."""

LOST_TIME = 0.2
"""Seconds without force on a pad after which the box is lost."""

SET_DOWN_SPEED, SET_DOWN_DEPTH = 0.02, 0.004
"""m/s and metres: after the way's end pads go on down by so much. The support carries the box by then, and the pads
slide on its faces."""

REST = 0.3
"""Seconds between the end of the way and letting go."""


class Phase(StrEnum):
    """What the arms are at."""

    APPROACH = "approach"
    GRIP = "grip"
    CARRY = "carry"
    SET_DOWN = "set-down"
    RELEASE = "release"
    DONE = "done"
    MISSED = "missed"
    LOST = "lost"
    STOPPED = "stopped"


ENDED = (Phase.DONE, Phase.MISSED, Phase.LOST, Phase.STOPPED)

HELD = (Phase.CARRY, Phase.STOPPED)
"""The box hangs between the pads."""


class Way(Protocol):
    """Where the midpoint of the pads goes: a policy, or an operator."""

    def step(self, midpoint: Array, *, return_speed: float | None) -> Array:
        """The next midpoint, shape (3,), metres, from the present one.

        `return_speed`: the way waits, and the midpoint comes back to it at so many m/s; none: it goes on.
        """

    @property
    def ended(self) -> bool:
        """Whether the way is at its end."""

    def gap(self, midpoint: Array) -> float:
        """How far a midpoint, shape (3,), metres, is from where the way waits, metres."""


@dataclass(frozen=True, kw_only=True)
class Clamp:
    """How the box is held.

    Attributes:
        length: L, metres, as the controller knows it.
        admittance: of both arms; none: no compliance, pads stay where eq. (13) puts them.
        squeeze: metres that each pad goes beyond the face, without compliance.
        stand_off: metres from the faces at which pads begin and end.
        approach_speed: m/s, until contact.
        release_speed: m/s.
        following: how arms follow each other, and when x waits; none: neither.
        printed: whether they follow each other by eq. (14) as printed.
        mutual: whether they follow each other at all; if not, x waits only.
        belief: what is taken for granted of the box, and what is found out.
    """

    length: float
    admittance: Admittance | None
    squeeze: float
    stand_off: float
    approach_speed: float
    release_speed: float
    following: FollowingParameters | None = None
    printed: bool = False
    mutual: bool = True
    belief: Belief = KNOWN


class Carrier:
    """One box carried once.

    Attributes:
        phase: what the arms are at.
        midpoint: array, shape (3,), metres: p_hat.
        pads, velocities: arrays, shape (2, 3), metres and m/s: of the left and the right pad, as commanded.
        mutual: who is pushed; none: the arms do not ask.
        box: what is known of the box.
    """

    def __init__(self, way: Way, start: Array, clamp: Clamp, dt: float, force: float) -> None:
        """Begin with pads at the stand-off beside `start`, shape (3,), metres; `dt`: seconds; `force`: F_d, N."""
        self._way, self._clamp, self._dt, self._desired = way, clamp, dt, force
        self._admittance = clamp.admittance or Admittance(1.0, 1.0, 0.0, 0.0, force, False, 0.0, 10.0)
        self._state = np.zeros((2, 4))
        self._state[:, OFFSET] = clamp.stand_off
        self.midpoint = np.array(start)
        self.phase = Phase.APPROACH
        self._since = self._settled = self._lost = 0.0
        self._depth, self._lifted_from = 0.0, float(start[2])
        self._touched, self._deeper = np.zeros(2, dtype=np.bool_), np.zeros(2)
        self._arms: Arms | None = None
        self.box = BoxEstimate(clamp.belief, clamp.length, dt)
        self.pads, self.velocities = np.empty((2, 3)), np.empty((2, 3))
        self.mutual: MutualFollowing | None = None
        self._place(np.zeros(3))
        if clamp.following is not None:
            self.mutual = MutualFollowing(clamp.following, dt, self.pads, printed=clamp.printed, on=clamp.mutual)

    @property
    def forces(self) -> Array:
        """Pressing forces as the admittance sees them, filtered, shape (2,), newtons."""
        return self._state[:, FORCE].copy()

    @property
    def offsets(self) -> Array:
        """How far pads stand outside of their places by eq. (13), shape (2,), metres."""
        return self._state[:, OFFSET].copy()

    @property
    def desired(self) -> float:
        """F_d now, newtons: more than was asked for where the box has turned out to be heavy."""
        return self._admittance.force

    def payload(self, load: Array) -> Array:
        """What is to be fed forward, shape (2,), newtons; `load`: what pulls each pad down, shape (2,), newtons."""
        return self.box.payload(load, self.phase in HELD)

    def stop(self) -> None:
        """Hold still from now on: something cannot go on."""
        self._enter(Phase.STOPPED)
        self.velocities[:] = 0.0

    def step(self, measured: Array, arms: Arms | None = None) -> None:
        """Take in measured pressing forces, shape (2,), newtons, and move `pads` on by a cycle.

        `arms`: where they are; without it nobody is pushed, and nothing is found out about the box.
        """
        sense(self._admittance, measured, self._dt, self._state)
        self._since += self._dt
        self._arms = arms
        if self.phase in ENDED:
            return
        if arms is not None:
            self._watch(arms)
        velocity = np.zeros(3)
        if self.phase is Phase.APPROACH:
            self._approach()
        elif self.phase is Phase.RELEASE:
            self._state[:, RATE] = self._clamp.release_speed
            self._state[:, OFFSET] += self._dt * self._clamp.release_speed
            if (self._state[:, OFFSET] >= self._clamp.stand_off).all():
                self._enter(Phase.DONE)
        else:
            self._hold()
            if self.phase is Phase.GRIP:
                self._grip()
            elif self.phase is Phase.CARRY:
                velocity = self._carry()
            elif self.phase is Phase.SET_DOWN:
                velocity = self._set_down()
        self._place(velocity)

    def _enter(self, phase: Phase) -> None:
        self.phase, self._since = phase, 0.0

    def _watch(self, arms: Arms) -> None:
        """Find out who is pushed, and what the box weighs."""
        if self.mutual is not None and self.phase in (Phase.GRIP, Phase.CARRY):
            settling = self.phase is Phase.GRIP
            self.mutual.observe(arms, self.pads, self.velocities, self.midpoint, settling=settling)
        if self.phase is Phase.CARRY:
            calm = self.mutual is None or not self.mutual.waits
            height, rise = float(self.midpoint[2]) - self._lifted_from, float(arms.velocity[:, 2].mean())
            self.box.weigh(arms.load, height, calm=calm, rise=rise)
            if self._clamp.admittance is not None:
                raised = self.box.firm(self._desired)
                self._admittance = self._admittance._replace(force=raised)
        else:
            self._lifted_from = float(self.midpoint[2])

    def _approach(self) -> None:
        """Each pad goes inwards until it touches; without compliance, to its place, or a squeeze beyond the touch."""
        touching = self._state[:, FORCE] >= TOUCH * self._desired
        if self._clamp.admittance is not None:
            there = touching
        elif self.box.measures_length:
            self._touched |= touching
            self._deeper = np.where(self._touched, self._deeper + self._dt * self._clamp.approach_speed, 0.0)
            there = self._deeper > self._clamp.squeeze
        else:
            there = self._state[:, OFFSET] <= -self._clamp.squeeze
        self._state[:, RATE] = np.where(there, 0.0, -self._clamp.approach_speed)
        self._state[:, OFFSET] += self._dt * self._state[:, RATE]
        if there.all():
            begin(self._admittance, self._state)
            self._enter(Phase.GRIP)
        elif (self._state[:, OFFSET] < -TOO_DEEP).any():
            self._enter(Phase.MISSED)

    def _hold(self) -> None:
        """Press on, and notice a box that is gone. An arm that is pushed does not press: the other one does."""
        pushed = NOBODY if self.mutual is None else self.mutual.pushed
        if self._clamp.admittance is None:
            self._state[:, RATE] = 0.0
        elif pushed == NOBODY:
            comply(self._admittance, self._dt, self._state)
        else:
            offset = self._state[pushed, OFFSET]
            comply(self._admittance._replace(leak=0.0), self._dt, self._state)
            self._state[pushed, OFFSET], self._state[pushed, RATE] = offset, 0.0
            if self.mutual is not None and self.mutual.returning:
                leak(self._admittance, self._dt, self._state)
        if self.phase is Phase.CARRY:
            # A biased sensor still reads something where nothing is; a box that has come to stand presses on.
            least = TOUCH if self.box.gone else LEAST
            gone = (self._state[:, FORCE] < least * self._desired).any()
            self._lost = self._lost + self._dt if gone else 0.0
            if self._lost >= LOST_TIME:
                self._enter(Phase.LOST)

    def _grip(self) -> None:
        a = self._admittance
        settles = settled_force(a.force, a.k_p) if a.printed else a.force
        near = (np.abs(self._state[:, FORCE] - settles) <= SETTLED * self._desired).all()
        self._settled = self._settled + self._dt if near else 0.0
        if self._settled >= GRIP_TIME or (self._clamp.admittance is None and self._since >= GRIP_TIME):
            if self._arms is not None:
                self._state[:, OFFSET] += self.box.span(self._arms.pads)
            self._enter(Phase.CARRY)
        elif self._since >= GRIP_PATIENCE:
            self._enter(Phase.MISSED)

    def _carry(self) -> Array:
        midpoint, speed = self.midpoint, None
        if self.mutual is not None:
            midpoint = self.mutual.pull(midpoint)
            speed = self.mutual.return_speed(self._way.gap(midpoint))
        following = self._way.step(midpoint, return_speed=speed)
        velocity = (following - midpoint) / self._dt
        self.midpoint = np.array(following)
        if self.mutual is not None:
            self.mutual.recovered(self._way.gap(self.midpoint))
        if self._way.ended and speed is None:
            self._enter(Phase.SET_DOWN)
        return velocity

    def _set_down(self) -> Array:
        velocity = np.zeros(3)
        if self._depth < SET_DOWN_DEPTH:
            velocity[2] = -SET_DOWN_SPEED
            self._depth += self._dt * SET_DOWN_SPEED
            self.midpoint = self.midpoint + self._dt * velocity
            self._since = 0.0
        elif self._since >= REST:
            self._enter(Phase.RELEASE)
        return velocity

    def _place(self, velocity: Array) -> None:
        """Put the pads beside the midpoint. Paper eqs. (13), (14), (18)."""
        self.pads[:], self.velocities[:] = self.midpoint, velocity
        if self.mutual is not None and self._arms is not None and self.phase in (Phase.CARRY, Phase.SET_DOWN):
            self.mutual.place(self._arms, self.pads, self.velocities, self._state[:, OFFSET], self.box.length)
        for arm, side in enumerate(SIDES):
            self.pads[arm, 1] += side * (0.5 * self.box.length + self._state[arm, OFFSET])
            self.velocities[arm, 1] += side * self._state[arm, RATE]


def tilt(turn: Array) -> Array:
    """Angle of a box's vertical axis from the vertical, degrees. `turn`: quaternions x y z w, shape (..., 4)."""
    upright = 1.0 - 2.0 * (turn[..., 0] ** 2 + turn[..., 1] ** 2)
    return np.asarray(np.degrees(np.arccos(np.clip(upright, -1.0, 1.0))))
