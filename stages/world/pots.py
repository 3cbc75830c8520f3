"""Flowerpots in the simulated world: their shape, and how far box and arms are from them. Paper Fig. 6.

Not here: the sphere that keeps the policy away from one (`stages/rollout/carry_scenes.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.trajectory import Array

FAR = 0.5
"""Metres beyond which nobody asks how far something is from a pot."""

ROD, LEAST_FOOT = 0.015, 0.01
"""Radius of the rod that a pot stands on, and its least height, metres."""

POT_PROFILE = ((0.0, 0.60), (0.35, 0.80), (0.40, 1.0), (0.75, 0.85), (1.0, 0.30))
"""Of a pot with its plant: heights from its foot, and radii there, as shares of its height and of half its width."""

POT_SIDES = 16


@dataclass(frozen=True, kw_only=True)
class Pot:
    """A flowerpot that is in the way.

    Attributes:
        centre: its middle at the start, metres.
        height, width: with its plant, metres.
    """

    centre: tuple[float, float, float]
    height: float
    width: float

    @property
    def reach(self) -> float:
        """Radius of the ball about its middle that holds it, metres."""
        return 0.5 * math.hypot(self.height, self.width)

    @property
    def foot(self) -> float:
        """Height of the rod that it stands on, metres."""
        return max(self.centre[2] - 0.5 * self.height, LEAST_FOOT)


def lathe(pot: Pot) -> Array:
    """Corners of a flowerpot about its middle, array, shape (n, 3), metres: rings from its foot to its top."""
    angles = np.linspace(0.0, 2.0 * math.pi, POT_SIDES, endpoint=False)
    round_ = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(POT_SIDES)])
    up = np.array([0.0, 0.0, 1.0])
    return np.vstack([(0.5 * pot.width * r) * round_ + ((h - 0.5) * pot.height) * up for h, r in POT_PROFILE])


def triangles() -> NDArray[np.int64]:
    """What `lathe`'s corners span, array, shape (m, 3), seen from outside counter-clockwise: the sides, foot, top."""
    found = []
    for ring in range(len(POT_PROFILE) - 1):
        for k in range(POT_SIDES):
            a, b = ring * POT_SIDES + k, ring * POT_SIDES + (k + 1) % POT_SIDES
            found += [(a, b, a + POT_SIDES), (b, b + POT_SIDES, a + POT_SIDES)]
    top = (len(POT_PROFILE) - 1) * POT_SIDES
    for k in range(1, POT_SIDES - 1):
        found += [(0, k + 1, k), (top, top + k, top + k + 1)]
    return np.array(found)


class Pots:
    """The pots of one world, and what they ask of its box and arms."""

    def __init__(self, engine: Any, client: int, pots: Sequence[Pot], box: int, arms: Sequence[int]) -> None:
        """Put the pots there. `engine`: pybullet; `client`, `box`, `arms`: its numbers for the world and its bodies."""
        self._bullet, self._client, self._pots, self._box, self._arms = engine, client, tuple(pots), box, tuple(arms)
        self._standing = [self._put(pot) for pot in pots]

    def _put(self, pot: Pot) -> tuple[int, int]:
        """A flowerpot, and the rod that it stands on."""
        engine, client = self._bullet, self._client
        shape = engine.createCollisionShape(engine.GEOM_MESH, vertices=lathe(pot).tolist(), physicsClientId=client)
        body = int(engine.createMultiBody(0.0, shape, -1, pot.centre, physicsClientId=client))
        rod = engine.createCollisionShape(engine.GEOM_CYLINDER, radius=ROD, height=pot.foot, physicsClientId=client)
        place = (pot.centre[0], pot.centre[1], 0.5 * pot.foot)
        return body, int(engine.createMultiBody(0.0, rod, -1, place, physicsClientId=client))

    def move(self, centres: Array) -> None:
        """Put the pots' middles to `centres`, shape (m, 3), metres."""
        upright = (0.0, 0.0, 0.0, 1.0)
        for (body, rod), pot, centre in zip(self._standing, self._pots, centres, strict=True):
            at, client = [float(value) for value in centre], self._client
            self._bullet.resetBasePositionAndOrientation(body, at, upright, physicsClientId=client)
            foot = 0.5 * pot.foot + at[2] - pot.centre[2]
            self._bullet.resetBasePositionAndOrientation(rod, (at[0], at[1], foot), upright, physicsClientId=client)

    def room(self) -> tuple[float, float]:
        """How far the box, and the nearer arm, are from the nearest pot or its rod, metres; at most `FAR`.

        Negative: one is inside of the other.
        """
        near = {True: FAR, False: FAR}
        for body in (self._box, *self._arms):
            for part in (part for pair in self._standing for part in pair):
                found = self._bullet.getClosestPoints(body, part, FAR, physicsClientId=self._client)
                least = min((point[8] for point in found), default=FAR)
                near[body == self._box] = min(near[body == self._box], least)
        return near[True], near[False]

    def touched(self) -> tuple[bool, bool]:
        """Whether the box, and whether an arm, touches a pot or its rod."""
        return self._touches(self._box), any(self._touches(body) for body in self._arms)

    def _touches(self, body: int) -> bool:
        return any(
            contact[8] <= 0.0
            for pair in self._standing
            for part in pair
            for contact in self._bullet.getContactPoints(body, part, physicsClientId=self._client)
        )
