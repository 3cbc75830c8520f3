"""How a roll-out can end, and what became of a step. The text of each member is what to do about it, or what it means.

Not errors: an outcome is a result.
"""

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
    COLLIDED = (
        "collided",
        "The executed state entered an obstacle: use avoidance of kind roas+, or, where a disturbance pushed it in, "
        "roas+ with recover = true.",
    )
    INFEASIBLE = (
        "infeasible",
        "Moving obstacles closed in from several sides, and no velocity kept clear of all; every such step was "
        "flagged: raise the margin, or slow the obstacles down.",
    )
    TOO_FAST = (
        "too-fast",
        "A moving obstacle caught up with the state, which the speed limit held back; every such step was flagged: "
        "raise the avoidance's speed_limit, if the robot can.",
    )
    TRAPPED = (
        "trapped",
        "The state stood still against an obstacle for a second, short of the goal: use avoidance of kind roas+ with "
        "detour = true; of a box or an ellipsoid, cover = true.",
    )
    GOAL_INSIDE = (
        "goal-inside",
        "The goal lies inside of an obstacle or within its margin: move the obstacle, or lower radius or margin.",
    )
    START_INSIDE = (
        "start-inside",
        "The start lies inside of an obstacle or within its margin: move the obstacle, or set recover = true to let "
        "the state leave it.",
    )
    NOT_GRIPPED = (
        "not-gripped",
        "The pads found no box, or no steady force on it: check scene.start, scene.box and length_error; without "
        "compliance the pads press only if they are told to go deeper than the box is wide (squeeze).",
    )
    LOST_BOX = (
        "lost-box",
        "A pad lost the box on the way: use compliance = true; with it, raise the desired force or check length_error.",
    )
    DROPPED = (
        "dropped",
        "A pad lost the box on the way, and it fell: as of lost-box; a heavy box needs more force, and an arm that is "
        "pushed needs following = true.",
    )
    HELD = (
        "held",
        "x waited for 10 s for an arm that stayed away from where it was led, and the arms stopped: let go of it, or "
        "see what is in its way; with eq. (14) as printed nothing leads the arms back: use mode = robust.",
    )
    OUT_OF_REACH = (
        "out-of-reach",
        "An arm was held, or had to follow the other one, beyond what it can reach, and the arms stopped: push less "
        "far, or carry nearer to the bases.",
    )
    JOINT_LIMIT = (
        "joint-limit",
        "A joint came to its limit and kept a pad from its place, and the arms stopped: move start, goal or obstacles "
        "so that the way stays nearer to the arms' posture.",
    )
    SINGULAR = (
        "singular",
        "An arm came to a pose in which it cannot move its pad as led, e.g. stretched out, and the arms stopped: move "
        "start, goal or obstacles nearer to the bases.",
    )
    MISPLACED = (
        "misplaced",
        "The box was let go, but not upright within 20 mm of the goal: look at its slip; raise the desired force, or "
        "lower the speed of the way.",
    )
    SWALLOWED = (
        "swallowed",
        "Obstacles overlap, and the sphere that holds them holds the start or the goal, too: set them apart, or set "
        "merge = false and accept that the state may be trapped between them.",
    )


class Status(StrEnum):
    """What became of a step among obstacles; `list(Status)[code]` is the name of a code of compiled code."""

    meaning: str

    def __new__(cls, name: str, meaning: str) -> Status:
        """A member whose value is `name`."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.meaning = meaning
        return member

    FREE = "free", "No obstacle is in the way: the step is the learned system's."
    ACTIVE = "active", "The step was led round an obstacle; V does not rise."
    DETOURING = "detouring", "On a way out of a trap, on which V may rise until the way ends, lower than it began."
    YIELDING = "yielding", "Giving way to a moving obstacle, or leaving one; V may rise."
    INFEASIBLE = "infeasible", "No velocity keeps clear of all obstacles: the one that misses least was taken."
    TOO_FAST = "too-fast", "No velocity within the speed limit keeps clear: the one that misses least was taken."
    TRAPPED = "trapped", "Nothing has moved for a second."
