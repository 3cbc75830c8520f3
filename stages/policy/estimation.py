"""What a controller knows of the box between its pads: length and mass, taken for granted or found out.

The paper takes both as given and names it as a limit. L is where the pads stand when the grip has settled; the mass is
what hangs on the wrists once the box is off its support. Arrays in, numbers out. Not here: who measures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stages.trajectory import Array

GRAVITY = 9.81

CLEAR = 0.010
"""Metres above where it was gripped at which a box is off its support."""

WEIGHING = 0.3
"""Seconds for which it has to hang quietly until its mass is believed."""

LOAD_CUTOFF = 5.0
"""Hz, of the low-pass on what pulls the pads down."""

GONE = 0.2
"""Share of the box's weight below which what hangs on the wrists is not the box."""

FIRM = 1.7
"""2 mu F_d/(m g) from which a box does not creep on its pads."""

RAISE = 1.5
"""N/s, at most, at which F_d is raised for a heavy box: what the arms give way by then is not taken for a push."""


@dataclass(frozen=True, kw_only=True)
class Belief:
    """What is taken for granted of the box, and what is found out.

    Attributes:
        finds_length: take L from where the pads stand when they hold the box.
        finds_mass: take the mass from the wrists, once it is lifted.
        mass: of the box as it is believed, kg: what is fed forward where the mass is not found out.
        friction: on which the pads can count at least: F_d is raised for a box that turns out too heavy for it; 0: F_d
            stays as it is.
    """

    finds_length: bool = False
    finds_mass: bool = True
    mass: float = 0.0
    friction: float = 0.0


KNOWN = Belief()


class BoxEstimate:
    """Length and mass of one box.

    Attributes:
        length: L, metres.
        mass: kg; nan: it has not been weighed.
        gone: what hangs on the wrists is not the box: it fell, or stands.
    """

    def __init__(self, belief: Belief, length: float, dt: float) -> None:
        """Begin with what is believed; `length`: L, metres; `dt`: seconds a cycle."""
        self._belief, self._dt = belief, dt
        self._share = 1.0 - math.exp(-2.0 * math.pi * LOAD_CUTOFF * dt)
        self._load = np.zeros(2)
        self._hung = self._sum = 0.0
        self._raised = self._rise = self._gained = 0.0
        self.length, self.mass, self.gone = length, math.nan, False

    @property
    def measures_length(self) -> bool:
        """Whether L is found out."""
        return self._belief.finds_length

    def span(self, pads: Array) -> float:
        """Take L from where the pads stand, shape (2, 3), metres; return by how much offsets grow, metres."""
        if not self._belief.finds_length:
            return 0.0
        before, self.length = self.length, float(pads[0, 1] - pads[1, 1])
        return 0.5 * (before - self.length)

    def _feel(self, load: Array) -> None:
        """Take in what pulls each pad down, shape (2,), newtons."""
        self._load += self._share * (load - self._load)

    def weigh(self, load: Array, height: float, *, calm: bool, rise: float = 0.0) -> None:
        """Take in what pulls each pad down, shape (2,), newtons, at `height`, metres, above where it was gripped.

        `calm`: nobody is pushed. `rise`: velocity of the pads upwards, m/s: what it changes by weighs, too.
        """
        self._feel(load)
        hangs = float(self._load.sum())
        if math.isnan(self.mass) and calm and height >= CLEAR:
            self._gained += rise - self._rise if self._hung > 0.0 else 0.0
            self._hung += self._dt
            self._sum += self._dt * hangs
            if self._hung >= WEIGHING:
                self.mass = self._sum / (self._hung * GRAVITY + self._gained)
        self._rise = rise
        self.gone = hangs < GONE * self.mass * GRAVITY  # nan: not weighed, not gone

    def firm(self, force: float) -> float:
        """F_d, newtons, with which the box does not creep: `force`, or more; it rises slowly."""
        if not (self._belief.finds_mass and self._belief.friction > 0.0) or math.isnan(self.mass):
            return force + self._raised
        needed = FIRM * self.mass * GRAVITY / (2.0 * self._belief.friction)
        self._raised = min(self._raised + RAISE * self._dt, max(needed - force, 0.0))
        return force + self._raised

    def payload(self, load: Array, held: bool) -> Array:
        """What is to be fed forward, shape (2,), newtons: `load`, shape (2,), as it is felt, or as it is believed.

        `held`: the box hangs between the pads.
        """
        return load if self._belief.finds_mass else np.full(2, 0.5 * self._belief.mass * GRAVITY * held)
