"""Which roll-outs among flowerpots the report draws, and where pots were. Paper Fig. 6. Groups in, arrays out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.artifacts.rollouts import RecordedCarry, RecordedRollout
from stages.figures.carry_cases import Held, carry_parameters
from stages.figures.numbers import method_title
from stages.figures.results import PointResults
from stages.policy.carrying import Phase
from stages.rollout.carry_conditions import avoidance_of
from stages.trajectory import Array

MOST_BOXES = 3
"""Boxes whose clearance over time is drawn; tables show all."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pots:
    """Flowerpots of one roll-out, and their safety spheres.

    Attributes:
        centres, velocities: arrays, shape (m, 3), metres, at the start, and m/s.
        radii, heights, widths: arrays, shape (m,), metres: of spheres, and of pots with their plants.
        along: array, shape (m,), metres by which the policy sees the sphere drawn out to either side along y.
    """

    centres: Array
    velocities: Array
    radii: Array
    heights: Array
    widths: Array
    along: Array

    @property
    def moving(self) -> bool:
        """Whether any of them moves."""
        return bool(self.velocities.any())

    def at(self, time: float) -> Array:
        """Where they are when they have moved for so many seconds, array, shape (m, 3), metres."""
        return np.asarray(self.centres + time * self.velocities)


@dataclass(frozen=True, kw_only=True, eq=False)
class Round:
    """One roll-out among pots.

    Attributes:
        held: the group that it belongs to.
        rollout: as recorded.
        carry: what arms and box did.
        pots: in its way.
    """

    held: Held
    rollout: RecordedRollout
    carry: RecordedCarry
    pots: Pots

    @property
    def number(self) -> str:
        """Of the box: the same under all conditions."""
        return self.rollout.rollout.rpartition("/")[2]

    @property
    def way(self) -> Array:
        """Of the middle of the box, from the lift until the arms let go, array, shape (n, 3), metres."""
        led = np.isin(self.carry.phase, (str(Phase.CARRY), str(Phase.SET_DOWN)))
        return self.carry.box[led] if led.any() else self.carry.box[:1]

    @property
    def nearest(self) -> int:
        """The sample at which the box was nearest to a sphere, or deepest inside."""
        clearance = self.rollout.clearance
        return 0 if np.isnan(clearance).all() else int(np.nanargmin(clearance))

    @property
    def moved(self) -> float:
        """For how long pots have moved then, seconds: they do while the box is carried."""
        led = np.flatnonzero(self.carry.phase == str(Phase.CARRY))
        if not led.size:
            return 0.0
        time = self.rollout.time
        return float(time[min(max(self.nearest, led[0]), led[-1])] - time[led[0]])


def rounds(groups: Sequence[Held]) -> list[Round]:
    """All roll-outs that had pots in their way, of the groups' first points, in order."""
    return [
        Round(held=held, rollout=rollout, carry=rollout.carry, pots=_pots(held, held.points[0], rollout, rollout.carry))
        for held in groups
        for rollout in held.rollouts
        if rollout.carry is not None and rollout.carry.facts["pots"] and rollout in held.points[0].rollouts
    ]


def alike(cases: Sequence[Round]) -> list[list[Round]]:
    """Roll-outs of the same box among the same pots, by method: at most `MOST_BOXES` boxes for each kind of pots."""
    found: dict[tuple[object, ...], list[Round]] = {}
    for one in cases:
        pots = (*(tuple(map(float, values.ravel())) for values in (one.pots.centres, one.pots.velocities)),)
        found.setdefault((one.held.variant, one.held.kind, one.number, *pots, *map(float, one.pots.radii)), []).append(
            one
        )
    sets: dict[tuple[str, ...], list[list[Round]]] = {}
    for members in found.values():
        sets.setdefault(tuple(one.held.title for one in members), []).append(members)
    return [members for boxes in sets.values() for members in boxes[:MOST_BOXES]]


def method_of(held: Held) -> tuple[str, str]:
    """Name and kind of the method by which a group avoids pots."""
    name = str(held.rows[0]["avoidance"])
    return name, name if held.asked is None else avoidance_of(carry_parameters(held.points[0]), held.asked).kind


def case_title(held: Held) -> str:
    """What pictures and tables call a group: its method, and its condition where that says something else."""
    name, kind = method_of(held)
    method = method_title(kind if name == held.condition else name)
    return method if held.name == kind else f"{held.name}: {method}"


def _pots(held: Held, point: PointResults, rollout: RecordedRollout, carry: RecordedCarry) -> Pots:
    known = carry.facts["pots"]
    scene = point.scenes.get(rollout.scene)
    asked = () if held.asked is None else held.asked.obstacles
    along = [pot.along for pot in asked] if len(asked) == len(known) else [0.0] * len(known)
    centres = np.array([pot["centre"] for pot in known])
    return Pots(
        centres=centres,
        velocities=np.zeros(centres.shape) if scene is None else scene.shapes.velocities,
        radii=np.array([pot["radius"] for pot in known]),
        heights=np.array([pot["height"] for pot in known]),
        widths=np.array([pot["width"] for pot in known]),
        along=np.array(along),
    )
