"""What became of pushes and pots on the way of a carried box. Paper eq. (14), Figs. 5d, 6.

How far a box is away is measured from where it would be if nobody pushed: of x, with the distance between them as it
was when it was first carried. Arms and box as they truly were. Not here: how the box was held (`force.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.policy.carrying import Phase
from stages.trajectory import Array

MM, GRAM = 1e3, 1e3

AWAY = 0.005
"""Metres beyond which the pads' midpoint is away."""

SIDES = ("left", "right")


@dataclass(frozen=True, kw_only=True)
class Pushed:
    """Columns of `metrics.parquet` that a carried box fills.

    Attributes:
        following: whether the arms followed each other.
        coupling: whether x waited.
        pushed: the arms that truly were pushed, "left", "right" or "left right"; none: nobody was.
        named: the arms that were taken for pushed, alike; none: nobody was.
        deviation_max_mm: farthest that the pads' midpoint was from where it would have been, mm.
        moved_while_away_mm: how far x moved while that was more than 5 mm, mm.
        box_back_mm: how far the box was from where it would have been when x went on after it had waited, the most, mm;
            none: it did not wait, or never went on.
        desired_force_n: F_d in the end, newtons.
        length_error_mm: by how much the controller took the box for longer than it is in the end, mm.
        mass_error_g: the same of its mass, where it was weighed, g.
        box_room_min_mm, arm_room_min_mm: least distance of box and arms from a pot, mm; none: there was none.
        box_contacts, arm_contacts: cycles in which they touched one; none: there was none.
    """

    following: bool
    coupling: bool
    pushed: str | None
    named: str | None
    deviation_max_mm: float | None
    moved_while_away_mm: float | None
    box_back_mm: float | None
    desired_force_n: float
    length_error_mm: float
    mass_error_g: float | None
    box_room_min_mm: float | None
    arm_room_min_mm: float | None
    box_contacts: int | None
    arm_contacts: int | None


def pushed(carry: Any, x: Array, gate: NDArray[np.bool_]) -> Pushed:
    """Measure what pushes and pots did to one box.

    Args:
        carry: with the attributes of `stages.artifacts.rollouts.RecordedCarry`.
        x: array, shape (n, 3), metres: the state of the learned system.
        gate: array of bool, shape (n,): x moves in the step that follows the sample.
    """
    facts, carried = carry.facts, carry.phase == str(Phase.CARRY)
    far: float | None = None
    moved: float | None = None
    back: float | None = None
    if carried.any():
        away = deviation(carry.pads.mean(axis=1), x, carried)
        steps = np.linalg.norm(np.diff(x[carried], axis=0), axis=1)
        far, moved = float(away.max()) * MM, float(steps[away[:-1] > AWAY].sum()) * MM
        open_ = gate[carried]
        resumed = np.flatnonzero(~open_[:-1] & open_[1:]) + 1
        if resumed.size:
            back = float(deviation(carry.box, x, carried)[resumed].max()) * MM
    found, pots = facts["mass_found"], bool(facts["pots"])
    true = [side for column, side in enumerate(SIDES) if carry.pushed[:, column].any()]
    named = [side for side in SIDES if (carry.named == side).any()]
    return Pushed(
        following=bool(facts["following"]),
        coupling=bool(facts["coupling"]),
        pushed=" ".join(true) or None,
        named=" ".join(named) or None,
        deviation_max_mm=far,
        moved_while_away_mm=moved,
        box_back_mm=back,
        desired_force_n=float(carry.desired[-1]),
        length_error_mm=(float(facts["length_found"]) - float(facts["box"][1])) * MM,
        mass_error_g=None if found is None else (float(found) - float(facts["mass"])) * GRAM,
        box_room_min_mm=float(carry.box_room.min()) * MM if pots else None,
        arm_room_min_mm=float(carry.arm_room.min()) * MM if pots else None,
        box_contacts=int(facts["box_contacts"]) if pots else None,
        arm_contacts=int(facts["arm_contacts"]) if pots else None,
    )


def deviation(place: Array, x: Array, carried: NDArray[np.bool_]) -> Array:
    """How far something is from where it would be beside x, metres, one a carried sample.

    `place`, `x`: arrays, shape (n, 3), metres. `carried`: array of bool, shape (n,), at least one of them true.
    """
    beside = (place - x)[carried]
    return np.asarray(np.linalg.norm(beside - beside[0], axis=1))
