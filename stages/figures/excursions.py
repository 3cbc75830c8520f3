"""What pushes on an arm did to one roll-out: arrays over time, from when the box was lifted. Paper eq. (14), Fig. 5d.

Recorded roll-outs in, arrays out. Not here: which are shown (`pushed_cases.py`), and metrics (`stages/evaluate`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stages.artifacts.rollouts import RecordedRollout
from stages.evaluate.pushed import deviation
from stages.figures.deviation import Strayed
from stages.policy.carrying import Phase
from stages.trajectory import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Excursion:
    """A pushed roll-out while the box was carried, n samples.

    What is beside x is told against where it was beside x when the box was lifted.

    Attributes:
        time: array, shape (n,), seconds from when the first push began.
        direction: array, shape (3,): of the first push, a unit vector.
        x, midpoint, box: arrays, shape (n, 3), metres: the state of the learned system, pads and box.
        beside: array, shape (3, n, 3), metres: by how much left pad, right pad and box are elsewhere beside x.
        away: array, shape (n,), metres: the same distance of the pads' midpoint. Paper eq. (14): |x - p|.
        residual: array, shape (n, 2), metres: by how much each pad is elsewhere than if nobody touched it, as found.
        force: array, shape (n, 2), newtons: contact forces as they truly were.
        desired: array, shape (n,), newtons: F_d.
        waits: array of bool, shape (n,): the gate of eq. (12) is closed.
        named: array of bool, shape (n, 2): the arm that was taken for pushed.
        pushed: array of bool, shape (n, 2): the arms that truly were.
    """

    time: Array
    direction: Array
    x: Array
    midpoint: Array
    box: Array
    beside: Array
    away: Array
    residual: Array
    force: Array
    desired: Array
    waits: NDArray[np.bool_]
    named: NDArray[np.bool_]
    pushed: NDArray[np.bool_]

    @property
    def along(self) -> Array:
        """How far left pad, right pad and box are away in the direction of the push, array, shape (3, n), metres."""
        return np.asarray(self.beside @ self.direction)

    @property
    def acting(self) -> NDArray[np.bool_]:
        """Whether anyone pushes, array, shape (n,)."""
        return np.asarray(self.pushed.any(axis=1))


def excursion(rollout: RecordedRollout) -> Excursion | None:
    """What a roll-out's pushes did; none: no box was carried, or nobody pushed while it was."""
    carry = rollout.carry
    if carry is None:
        return None
    carried = carry.phase == str(Phase.CARRY)
    acting = carry.pushed.any(axis=1) & carried
    if not acting.any() or not carry.facts["pushes"]:
        return None
    first = carry.facts["pushes"][0]
    push = np.array(first["force"]) if any(first["force"]) else np.array(first["offset"])
    places = np.stack([carry.pads[carried, 0], carry.pads[carried, 1], carry.box[carried]])
    beside = places - rollout.x[carried]
    return Excursion(
        time=rollout.time[carried] - rollout.time[np.argmax(acting)],
        direction=push / np.linalg.norm(push),
        x=rollout.x[carried],
        midpoint=rollout.executed[carried],
        box=carry.box[carried],
        beside=beside - beside[:, :1],
        away=deviation(rollout.executed, rollout.x, carried),
        residual=carry.residual[carried],
        force=carry.contact[carried],
        desired=carry.desired[carried],
        waits=~rollout.gate[carried],
        named=np.column_stack([carry.named[carried] == side for side in ("left", "right")]),
        pushed=carry.pushed[carried],
    )


def strayed(rollouts: Iterable[RecordedRollout]) -> tuple[Strayed, ...]:
    """Where the arms were left by pushes after which they followed each other by eq. (14) as printed."""
    found = []
    for rollout in rollouts:
        if rollout.carry is None or rollout.mode != "paper" or not rollout.carry.facts["following"]:
            continue
        went = excursion(rollout)
        if went is not None:
            let_go = int(np.flatnonzero(went.acting)[-1])
            away = went.away
            found.append(Strayed(let_go=float(away[let_go]), end=float(away[-1]), outcome=rollout.outcome))
    return tuple(found)
