"""What happens under a condition, in words and as one push that pictures can show. Parameters in, text out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stages.figures.numbers import MM, given, joined, vector_mm
from stages.rollout.parameters import Condition, Disturbance, Held, Noise, Ramp
from stages.trajectory import Array

HALF = 0.5
"""Where a disturbance comes that does not say: a fraction of the arc length."""


def among_obstacles(condition: Condition) -> bool:
    """Whether a condition has obstacles."""
    return bool(condition.obstacles) or condition.scenes is not None


def push_of(condition: Condition) -> Array | None:
    """The offset of a condition with a single disturbance that has one, array, shape (d,), metres; none: another."""
    if len(condition.disturbances) != 1:
        return None
    (only,) = condition.disturbances
    return None if isinstance(only, Noise) or not any(only.offset) else np.array(only.offset)


def said(condition: Condition) -> str:
    """What the disturbances of a condition do, as ``[0, -20] mm``, or in more words where they do more."""
    return joined([_said(disturbance) for disturbance in condition.disturbances]) if condition.disturbances else ""


def _said(disturbance: Disturbance) -> str:
    if isinstance(disturbance, Noise):
        return f"noise of {given(disturbance.std * MM)} mm for {given(disturbance.duration)} s"
    offset = vector_mm(disturbance.offset)
    if isinstance(disturbance, Held):
        return f"{offset}, held for {given(disturbance.duration)} s"
    if isinstance(disturbance, Ramp):
        hold = f", held for {given(disturbance.hold)} s" if disturbance.hold else ""
        return f"{offset} within {given(disturbance.rise)} s{hold}"
    return offset


def when(disturbance: Disturbance) -> str:
    """When a disturbance comes."""
    if disturbance.at_time is not None:
        return f"{given(disturbance.at_time)} s after the start"
    if disturbance.at_state is not None:
        return f"where the controller's own undisturbed path is nearest to {vector_mm(disturbance.at_state)}"
    fraction = HALF if disturbance.at_fraction is None else disturbance.at_fraction
    return f"at {given(fraction)} of the arc length of the controller's own undisturbed path"


def farthest(conditions: Sequence[Condition], limit: int = 3) -> list[Condition]:
    """Conditions with one push; of those in the same direction only the farthest. At most `limit`."""
    chosen: list[tuple[Condition, Array]] = []
    for condition in conditions:
        push = push_of(condition)
        if push is None:
            continue
        for index, (_, other) in enumerate(chosen):
            if push @ other >= (1 - 1e-9) * np.linalg.norm(push) * np.linalg.norm(other):
                if np.linalg.norm(push) > np.linalg.norm(other):
                    chosen[index] = (condition, push)
                break
        else:
            chosen.append((condition, push))
    return [condition for condition, _ in chosen][:limit]
