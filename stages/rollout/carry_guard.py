"""What cannot go on, and how it ends: arms that are not where they are led, pushes without an end, boxes that fell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stages.policy.carrying import Phase, tilt
from stages.policy.mutual import NOBODY, MutualFollowing
from stages.policy.outcome import Outcome
from stages.trajectory import Array
from stages.world.following import Follower
from stages.world.parameters import Scene

MISPLACED, TILTED = 0.020, 10.0
"""Metres from the goal, and degrees, beyond which a box that was let go is not delivered."""

FELL = 0.05
"""Metres below the lower one of start and goal at which a lost box has fallen."""

UNREACHED, UNREACHED_TIME = 0.01, 0.3
"""Metres, and seconds for which an arm's references may be so far from where its pad is to be."""

STRETCHED = 0.05
"""m/rad: an arm whose smallest singular value is below cannot move its pad as it is led."""

STILL, STILL_TIME = 1e-4, 3.0
"""m/s below which x stands still, and seconds for which it may, short of the goal."""

PATIENCE = 10.0
"""Seconds for which x waits for an arm."""


class Guard:
    """Notices what cannot go on, and stops the arms: an arm that is not where it is to be, or a push without an end."""

    def __init__(self, dt: float) -> None:
        self._dt, self._missing, self._waited, self._still = dt, 0.0, 0.0, 0.0

    def fault(self, follower: Follower, mutual: MutualFollowing | None, acting: NDArray[np.bool_]) -> Outcome | None:
        """What is wrong, if anything; `acting`: array of bool, shape (2,): the arms that are truly pushed."""
        away = (follower.missing > UNREACHED) & ~acting  # of an arm that is dragged, a person says where it is
        self._missing = self._missing + self._dt if away.any() else 0.0
        self._waited = self._waited + self._dt if mutual is not None and mutual.waits else 0.0
        if self._missing >= UNREACHED_TIME:
            return Outcome.OUT_OF_REACH if acting.any() else self._cause(follower) or Outcome.OUT_OF_REACH
        if self._waited >= PATIENCE:
            led = mutual is not None and mutual.follows and mutual.pushed == NOBODY  # as printed: by nobody
            return Outcome.HELD if led or acting.any() else self._cause(follower) or Outcome.HELD
        return None

    @staticmethod
    def _cause(follower: Follower) -> Outcome | None:
        """What keeps an arm from where it is led, if it is the arm itself."""
        if follower.limited.any():
            return Outcome.JOINT_LIMIT
        return Outcome.SINGULAR if min(map(follower.dexterity, range(2))) < STRETCHED else None

    def stuck(self, moved: float, *, carrying: bool) -> Outcome | None:
        """Whether the way stands still short of the goal; `moved`: metres that x has moved in the cycle."""
        still = carrying and moved <= STILL * self._dt
        self._still = self._still + self._dt if still and self._waited == 0.0 else 0.0
        return Outcome.TRAPPED if self._still >= STILL_TIME else None


def outcome_of(phase: Phase, box: Array, turn: Array, scene: Scene) -> Outcome:
    """How a roll-out ended whose arms were at `phase` in the end, and its box at `box`, shape (3,), metres, turned by a
    quaternion x y z w."""
    if phase is Phase.MISSED:
        return Outcome.NOT_GRIPPED
    if phase is Phase.LOST:
        fell = box[2] < min(scene.start[2], scene.goal[2]) - FELL
        return Outcome.DROPPED if fell else Outcome.LOST_BOX
    if phase is not Phase.DONE:
        return Outcome.TIMEOUT
    delivered = np.linalg.norm(box - np.array(scene.goal)) <= MISPLACED and float(tilt(turn)) <= TILTED
    return Outcome.ARRIVED if delivered else Outcome.MISPLACED
