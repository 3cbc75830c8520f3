"""Which pushed roll-outs the report draws, and on which axes: one of each way to do it, of the same box. Groups in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.artifacts.rollouts import RecordedRollout
from stages.evaluate.force import BAND
from stages.figures.carry_cases import Held, carry_parameters, difference
from stages.figures.carry_panels import force_top
from stages.figures.excursions import Excursion, excursion
from stages.figures.pushed_panels import Scales
from stages.policy.parameters import FollowingParameters

MOST = 6
"""Ways that pictures show; tables show all."""

BEFORE, AFTER = 1.5, 8.0
"""Seconds that pictures show before the push, and, at most, after the last one has ended."""

BEYOND = 1.25
"""Room above the farthest that a push drags anything away, as a multiple of it: what strays farther is cut off."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """One roll-out that is drawn.

    Attributes:
        held: the group that it stands for.
        rollout: as recorded.
        went: what its pushes did.
    """

    held: Held
    rollout: RecordedRollout
    went: Excursion


def chosen(groups: Sequence[Held]) -> list[Shown]:
    """One roll-out of each group, the first of each way to do it before further ones; of groups that were pushed.

    Of the first box that was pushed in all of them; where there is none, of the first that was.
    """
    found = {held: cases for held in groups if (cases := _cases(held))}
    if not found:
        return []
    common = set.intersection(*(set(cases) for cases in found.values()))
    ways = {difference(held.rows[0]): held for held in reversed(found)}
    order = sorted(found, key=lambda held: held is not ways[difference(held.rows[0])])[:MOST]
    first = next((number for number in next(iter(found.values())) if number in common), None)
    return [
        cases[first] if first is not None else next(iter(cases.values()))
        for held, cases in found.items()
        if held in order
    ]


def scales(shown: Sequence[Shown]) -> Scales:
    """Axes that all pictures share; at least one roll-out."""
    wents = [one.went for one in shown]
    reach = BEYOND * max(float(np.abs(went.along[:, went.acting]).max()) for went in wents)
    first = shown[0].held.given[0]
    low, high = (share * first for share in BAND)
    end = max(float(went.time[went.acting][-1]) for went in wents) + AFTER
    return Scales(
        time=(-BEFORE, min(end, max(float(went.time[-1]) for went in wents))),
        reach=reach,
        band=(low, high),
        force=force_top((first,), (low, high)),
    )


def following_of(held: Held) -> FollowingParameters:
    """How the arms of a group follow each other."""
    return carry_parameters(held.points[0]).following


def _cases(held: Held) -> dict[str, Shown]:
    """Pushed roll-outs of a group's first point by the number of the box."""
    own = {row["rollout"] for row in held.rows if row["point"] == held.points[0].point.id}
    found = {}
    for rollout in held.points[0].rollouts:
        went = excursion(rollout) if rollout.rollout in own else None
        if went is not None:
            found[rollout.rollout.rpartition("/")[2]] = Shown(held=held, rollout=rollout, went=went)
    return found
