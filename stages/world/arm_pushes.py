"""Pushes on one arm: a person takes its lead and drags it away, or a force acts on its flange. Paper Fig. 5d.

While an arm is dragged its own commands are not heard, as where a teleoperator displaces it. A drag begins where the
arm was commanded, goes out smoothly, stays, and lets go. Not here: what a person may ask for
(`stages/rollout/parameters.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.trajectory import Array


@dataclass(frozen=True, kw_only=True)
class ArmPush:
    """One push.

    Attributes:
        arm: 0 the left one, 1 the right one.
        cycle: at which it begins; -1: when `steps` says.
        steps: after how many cycles in which x has moved.
        offset: array, shape (3,), metres: where it is dragged; 0 of a force.
        rise: seconds in which it is dragged there.
        hold: seconds for which it is held there, or for which a force acts.
        force: array, shape (3,), newtons; 0 of a drag.
    """

    arm: int
    cycle: int
    steps: int
    offset: Array
    rise: float
    hold: float
    force: Array

    @property
    def drags(self) -> bool:
        """Whether the arm's own commands are not heard."""
        return not self.force.any()


def smooth(share: float) -> tuple[float, float]:
    """A minimum-jerk step from 0 to 1, and its slope, at `share` in [0, 1] of its duration."""
    s = min(max(share, 0.0), 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * s * s * (1.0 - s) ** 2


class ArmPushes:
    """All pushes of a roll-out.

    Attributes:
        acting: array of bool, shape (2,): which arms are pushed now.
        begun: how many have begun.
    """

    def __init__(self, pushes: Sequence[ArmPush], dt: float) -> None:
        """None has begun; `dt`: seconds a cycle."""
        self._pushes, self._dt = tuple(pushes), dt
        self._begun: dict[int, tuple[int, Array]] = {}
        self.acting = np.zeros(2, dtype=np.bool_)

    @property
    def begun(self) -> int:
        """How many have begun."""
        return len(self._begun)

    @property
    def all_begun(self) -> bool:
        """Whether none is still to come."""
        return len(self._begun) == len(self._pushes)

    def act(self, cycle: int, steps: int, pads: Array, velocities: Array, *, carrying: bool) -> Array | None:
        """Take the lead of arms that are dragged; return forces on the flanges, shape (2, 3), newtons, if there are.

        Args:
            cycle: number of the present one, from when the box was first carried.
            steps: in how many of them x has moved.
            pads, velocities: arrays, shape (2, 3), metres and m/s, as commanded. Will be modified.
            carrying: whether a push may begin.
        """
        self.acting[:] = False
        forces = None
        for number, push in enumerate(self._pushes):
            if number not in self._begun:
                due = cycle >= push.cycle if push.cycle >= 0 else steps >= push.steps
                if not (carrying and due):
                    continue
                self._begun[number] = cycle, pads[push.arm].copy()
            since, anchor = self._begun[number]
            passed = (cycle - since) * self._dt
            if passed > push.rise + push.hold:
                continue
            self.acting[push.arm] = True
            if push.drags:
                share, slope = smooth(passed / push.rise if push.rise > 0.0 else 1.0)
                pads[push.arm] = anchor + share * push.offset
                velocities[push.arm] = slope / push.rise * push.offset if push.rise > 0.0 else 0.0
            else:
                forces = np.zeros((2, 3)) if forces is None else forces
                forces[push.arm] += push.force
        return forces
