"""Which roll-outs show the most, for a picture or a recording that shows few. Roll-outs in, roll-outs out."""

from __future__ import annotations

from collections.abc import Sequence

from stages.artifacts.rollouts import RecordedRollout


def telling(rollouts: Sequence[RecordedRollout], alike: str = "") -> list[RecordedRollout]:
    """One carried box, pushed or blocked if there is such a one; or of a point every condition, of random scenes one.

    `alike`: name of a carried box that another one is compared with: the one of this name, where there is one.
    """
    carried = [r for r in rollouts if r.carry is not None]
    if carried:
        same = [r for r in carried if r.rollout == alike]
        eventful = [r for r in carried if r.carry is not None and (r.carry.pushed.any() or r.carry.facts["pots"])]
        return (same or eventful or carried)[:1]
    first: dict[str, str] = {}
    for r in rollouts:
        first.setdefault(r.condition, r.scene)
    return [r for r in rollouts if r.scene == first[r.condition]]
