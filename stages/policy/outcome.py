"""How a roll-out can end. The text of each member is what to do about it. Not an error: an outcome is a result."""

from __future__ import annotations

from enum import StrEnum


class Outcome(StrEnum):
    """How a roll-out ended: `str(outcome)` is what tables hold, `outcome.remedy` is what to do about it."""

    remedy: str

    def __new__(cls, name: str, remedy: str) -> Outcome:
        """A member whose value is `name`."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.remedy = remedy
        return member

    ARRIVED = "arrived", "The executed state reached the goal: nothing to do."
    TIMEOUT = (
        "timeout",
        "The time was over before the executed state reached the goal: raise rollout.max_duration or "
        "rollout.stop_distance; if the gate stayed closed, raise the follower's speed (p_max or gate, v_max).",
    )
    DIVERGED = (
        "diverged",
        "The state ran away from the goal: use rollout.integrator = cayley, or a smaller rollout.dt.",
    )
