"""The learned system as the way of a carried box, and what moves on it. Paper eqs. (9)-(12)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.parameters import Avoidance, Obstacle
from stages.policy.controller import Controller
from stages.policy.coupled import Coupling
from stages.trajectory import Array

ENDED_WITHIN = 1e-3
"""Metres from the goal at which a planned way is at its end."""


class PolicyWay:
    """The learned system as the way of the midpoint: the executed state of the coupled system is what is commanded."""

    def __init__(self, controller: Controller, stop_distance: float) -> None:
        """`stop_distance`: metres from the goal at which the way is at its end."""
        self.controller, self._stop = controller, stop_distance
        self.p_hat: Array = controller.x
        self.steps = 0

    def step(self, midpoint: Array, *, return_speed: float | None = None) -> Array:
        """The next p_hat, shape (3,), metres. Paper eqs. (9)-(12)."""
        self.p_hat = self.controller.step(midpoint, return_speed=return_speed)
        self.steps += self.controller.moving
        return self.p_hat

    @property
    def ended(self) -> bool:
        """Whether p_hat is at the goal."""
        return bool(np.linalg.norm(self.p_hat - self.controller.model.goal) <= self._stop)

    def gap(self, midpoint: Array) -> float:
        """How far a midpoint, shape (3,), metres, is from x, metres; of a plain LPV-DS it is where x is."""
        return float(np.linalg.norm(midpoint - self.controller.x)) if self.controller.coupled else 0.0


class Moves:
    """Obstacles that move: where they are, told to the policy.

    Attributes:
        centres: array, shape (m, 3), metres, now.
    """

    def __init__(self, obstacles: Sequence[Obstacle], controller: Controller) -> None:
        """They are where they begin."""
        self._begin = np.array([one.centre for one in obstacles]).reshape(-1, 3)
        self._velocity = np.array([one.velocity or (0.0, 0.0, 0.0) for one in obstacles]).reshape(-1, 3)
        self.moving, self._controller = bool(self._velocity.any()), controller
        self.centres = self._begin
        seen = controller.seen
        self._same = seen is not None and seen.number == self._begin.shape[0]

    def see(self, time: float) -> None:
        """Let them be where they are after so many seconds; spheres that were merged stay where they were."""
        self.centres = self._begin + time * self._velocity
        if self.moving and self._same:
            self._controller.see(self.centres, self._velocity)


def plan(
    model: LpvDs,
    start: Array,
    coupling: Coupling,
    *,
    top_speed: float,
    dt: float,
    longest: float,
    obstacles: Sequence[Obstacle] = (),
    avoidance: Avoidance | None = None,
) -> Array:
    """The way that the policy would lead the midpoint if nobody pushed, shape (n, 3), metres, from `start`.

    Raises DataError where it cannot begin: start or goal is inside of an obstacle.
    """
    controller = Controller(
        model, start, dt=dt, coupling=coupling, top_speed=top_speed, obstacles=obstacles, avoidance=avoidance
    )
    way, moves = PolicyWay(controller, ENDED_WITHIN), Moves(obstacles, controller)
    found = [np.array(start)]
    for cycle in range(round(longest / dt)):
        if way.ended:
            break
        moves.see(cycle * dt)
        found.append(way.step(found[-1]))
    return np.array(found)
