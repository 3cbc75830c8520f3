"""Two arms that follow each other when one is pushed: who it is, what waits, and where the arms go. Eqs. (12)-(14).

An arm is pushed where its pad is elsewhere than a twin that nobody touches: the same commands, through the same lag.
Two forms of eq. (14). ``paper``, as printed: both arms follow where the other one is, which leaves their midpoint to
nobody: it does not come back from where the push has left it, and may drift on. ``robust``: the pushed arm is led back
from where it is, and the other one follows it with its own offset for the force. What is commanded never jumps: what
differs at a switch is blended out.

One call a cycle. Not here: how hard the arms press (`admittance.py`), the phases (`carrying.py`), and how p_hat returns
to x (`coupled.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stages.policy.parameters import FollowingParameters
from stages.trajectory import Array

NOBODY, LEFT, RIGHT = -1, 0, 1
SIDES = (1.0, -1.0)
"""Of the left and the right arm along the clamp axis, y."""

ADAPTED, SETTLED, RELEARNED, CENTRED = 3.0, 0.1, 0.3, 2.0
"""Seconds in which what an arm is off by anyhow is learned, sag and calibration: while carrying, while gripping, and
when it has come back from a push, in another pose and to another force than before, and is off by no more than sag; and
what the midpoint is off by then, after what both offsets share has leaked away."""


SAG = 0.75
"""Share of the threshold up to which what an arm is off by, when it has come back and rests, is taken for sag."""


class Arms(NamedTuple):
    """Both arms as measured.

    Attributes:
        pads: array, shape (2, 3), metres.
        velocity: array, shape (2, 3), m/s.
        load: array, shape (2,), newtons: what pulls each pad down beside its own weight.
    """

    pads: Array
    velocity: Array
    load: Array


class Twin:
    """Where both pads would be if nobody touched the arms: what is commanded, behind a critically damped lag.

    Attributes:
        pads, velocity: arrays, shape (2, 3), metres and m/s.
    """

    def __init__(self, pads: Array, lag: float) -> None:
        """Begin at rest at `pads`, shape (2, 3), metres; `lag`: rate of the arms' inner loop, 1/s."""
        self.pads, self.velocity, self._lag = np.array(pads), np.zeros(pads.shape), lag

    def step(self, pads: Array, velocity: Array, dt: float) -> None:
        """Let a cycle pass at whose end `pads`, shape (2, 3), metres, are commanded, and their velocity, m/s.

        Exact for a reference that moves evenly: e'' + 2 w e' + w^2 e = 0.
        """
        begin = pads - dt * velocity
        error, rate = self.pads - begin, self.velocity - velocity
        slope, fade = rate + self._lag * error, math.exp(-self._lag * dt)
        self.pads = pads + fade * (error + dt * slope)
        self.velocity = velocity + fade * (rate - self._lag * dt * slope)


class MutualFollowing:
    """Who is pushed, and what comes of it.

    Attributes:
        pushed: NOBODY, LEFT or RIGHT; in the printed form always NOBODY, as it does not ask.
        follows: whether eq. (14) is on.
        waits: whether x has to wait.
        residual: array, shape (2, 3), metres: by how much pads are elsewhere than they would be if nobody touched them.
    """

    def __init__(self, given: FollowingParameters, dt: float, pads: Array, *, printed: bool, on: bool = True) -> None:
        """Begin with `pads` commanded, shape (2, 3), metres, at rest; `dt`: seconds a cycle.

        `printed`: eq. (14) as printed. `on`: whether the arms follow each other at all; if not, only x waits.
        """
        self._given, self._dt, self._printed, self._on = given, dt, printed, on
        self._twin, self._usual = Twin(pads, given.lag), np.zeros((2, 3))
        self._off_middle, self._usual_middle = np.zeros(3), np.zeros(3)
        self.residual = np.zeros((2, 3))
        self.pushed, self.follows, self.waits = NOBODY, False, False
        self._speed = self._calm = 0.0
        self._back = self._gave = False
        self._bump, self._switched, self._other = np.zeros(3), False, LEFT
        self._last = np.array(pads)

    @property
    def deviation(self) -> float:
        """The larger residual, metres."""
        return math.sqrt(float((self.residual**2).sum(axis=1).max()))

    @property
    def returning(self) -> bool:
        """Whether the pushed arm comes back: nobody holds it any more."""
        return self.pushed != NOBODY and not self._gave

    @property
    def strayed(self) -> float:
        """How far the midpoint of the pads is from p_hat, metres, beside what it is off by anyhow. Paper eq. (4)."""
        off = self._off_middle - self._usual_middle
        return math.sqrt(off @ off)

    def observe(self, arms: Arms, pads: Array, velocity: Array, midpoint: Array, *, settling: bool = False) -> None:
        """Take in where the arms are after a cycle.

        Args:
            arms: as measured.
            pads, velocity: arrays, shape (2, 3), metres and m/s, as commanded in the cycle.
            midpoint: array, shape (3,), metres: p_hat.
            settling: they grip yet: learn what they are off by.
        """
        self._twin.step(pads, velocity, self._dt)
        off = arms.pads - self._twin.pads
        self._off_middle = arms.pads.mean(axis=0) - midpoint
        rests = self._back and self.deviation <= SAG * self._given.deviation_threshold
        learn = 1.0 / SETTLED if settling else 0.0 if self.waits else 1.0 / ADAPTED
        again = self.waits and rests and not (settling or self._printed)
        slowly = 1.0 / CENTRED if again and self.pushed == NOBODY else learn
        self._usual_middle += min(slowly * self._dt, 1.0) * (self._off_middle - self._usual_middle)
        self._usual += min((1.0 / RELEARNED if again else learn) * self._dt, 1.0) * (off - self._usual)
        self.residual = off - self._usual
        if settling:
            return
        threshold = self._given.deviation_threshold
        if self._printed:
            self.follows = self._on and self.strayed > threshold
            self.waits = self.follows or self._gate(self.strayed)
            return
        far = self.deviation
        self.waits = self.pushed != NOBODY or self._gate(max(far, 0.5 * self.strayed if self.waits else 0.0))
        if self._on and self.pushed == NOBODY and far > threshold:
            self.pushed = int(np.argmax((self.residual**2).sum(axis=1)))
            self.follows = self._switched = self._gave = True
            self._speed = 0.0

    def _gate(self, far: float) -> bool:
        """Whether x waits: beyond twice the gate, and until within it again. Paper eq. (12), with hysteresis."""
        return far > (self._given.gate if self.waits else 2.0 * self._given.gate)

    def pull(self, midpoint: Array) -> Array:
        """The midpoint, shape (3,), metres, from which the pushed arm is led back: it gives way, a little at a time."""
        if self.pushed == NOBODY:
            return midpoint
        off = self.residual[self.pushed]
        far = math.sqrt(off @ off)
        self._gave = far > self._given.lead
        if not self._gave:
            return midpoint
        shift = off * (1.0 - self._given.lead / far) * min(self._dt / self._given.yielding, 1.0)
        self._twin.pads[self.pushed] += shift
        self.residual[self.pushed] = off - shift
        self._speed = 0.0
        return np.asarray(midpoint + shift)

    def return_speed(self, gap: float) -> float | None:
        """At which p_hat comes back to x, m/s; none: x does not wait. `gap`: how far p_hat is from it, metres."""
        if not self.waits:
            return None
        self._back, limit = gap == 0.0, self._given.return_acceleration
        self._speed = min(self._speed + limit * self._dt, self._given.return_speed)
        return min(self._speed, math.sqrt(2.0 * limit * gap) + limit * self._dt)

    def recovered(self, gap: float) -> bool:
        """Whether a push is over: the arms go by eq. (13) again. `gap`: how far p_hat is from x, metres."""
        if self.pushed == NOBODY:
            return False
        calm = gap == 0.0 and self.deviation <= self._given.gate
        self._calm = self._calm + self._dt if calm else 0.0
        if self._calm < self._given.blend:
            return False
        self.pushed, self.follows, self._calm, self._switched = NOBODY, False, 0.0, True
        return True

    def place(self, arms: Arms, middles: Array, velocity: Array, offsets: Array, length: float) -> None:
        """Tell each arm about which midpoint it stands. Paper eqs. (13), (14).

        Args:
            arms: as measured.
            middles: array, shape (2, 3), metres: p_hat, of each arm. Will be modified.
            velocity: array, shape (2, 3), m/s, of those. Will be modified.
            offsets: array, shape (2,), metres: how far outside of its place each arm stands for the force's sake.
            length: L, metres.
        """
        if self._printed:
            if self.follows:
                for arm, side in enumerate(SIDES):
                    middles[arm] = arms.pads[1 - arm]
                    middles[arm, 1] += side * 0.5 * length
                    velocity[arm] = 0.0  # (14) prints places only
            return
        if self.pushed != NOBODY:
            self._other = 1 - self.pushed
            middles[self._other] = arms.pads[self.pushed] - self._usual[self.pushed]
            middles[self._other, 1] -= SIDES[self.pushed] * (0.5 * length + offsets[self.pushed])
            velocity[self._other] = arms.velocity[self.pushed]
        if self._switched:
            self._bump, self._switched = self._last[self._other] - middles[self._other], False
        self._bump *= math.exp(-self._dt / self._given.blend)
        middles[self._other] += self._bump
        velocity[self._other] -= self._bump / self._given.blend
        self._last[:] = middles
