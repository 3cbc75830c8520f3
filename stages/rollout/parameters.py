"""Parameters of the rollout stage: which controllers run under which conditions from which starts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator

from pipeline.stage import NonNegative, Positive, UnitInterval, parameters

Mode = Literal["paper", "robust"]


@parameters
class LpvdsController:
    """The plain LPV-DS of eq. (6): the executed state is the state x itself."""

    kind: Literal["lpvds"] = "lpvds"


@parameters
class ClpvdsController:
    """The coupled system of eqs. (9)-(12): x waits while the executed state p_hat is away from it.

    Attributes:
        mode: ``paper``, the printed follower with a gate of finite tolerance, or ``robust``, a deadbeat follower with
            the exact gate of eq. (12); none: the roll-out's own mode.
        k_c: eq. (10), 1/m. Paper: 100 on the robot. Only in paper mode.
        p_max: eq. (10), 1/s; none: so that the gate lets 1.2 x the demonstrations' top speed pass. Only in paper mode.
        gate: tolerance of the gate of eq. (12), m; it opens within `gate` and closes beyond 2 `gate`; none: from p_max,
            so that 1.2 x the demonstrations' top speed passes. Only in paper mode.
        v_max: top speed of the deadbeat follower, m/s; none: 5 x the demonstrations' top speed. Only in robust mode.
    """

    kind: Literal["clpvds"] = "clpvds"
    mode: Mode | None = None
    k_c: Positive = 100.0
    p_max: Positive | None = None
    gate: NonNegative | None = 0.002
    v_max: Positive | None = None


@parameters
class Condition:
    """What happens to the executed state on the way.

    Attributes:
        name: of the condition, as in the tables: ``none``, ``cond1``.
        displacement: added once to the executed state, metres, one number a coordinate; none: nothing happens.
        at_fraction: when, as a fraction of the arc length of the controller's own undisturbed path; the paper: 0.5.
        at_time: when, seconds from the start; instead of `at_fraction`.
    """

    name: str = "none"
    displacement: tuple[float, ...] | None = None
    at_fraction: UnitInterval | None = None
    at_time: NonNegative | None = None


Controller = Annotated[LpvdsController | ClpvdsController, Discriminator("kind")]


@parameters
class RolloutParameters:
    """The cases of one roll-out stage: controllers x conditions x starts.

    Attributes:
        mode: of the coupled controllers that name none of their own.
        controllers: what runs.
        conditions: under what.
        starts: from the first points of which demonstrations.
        integrator: ``cayley`` (V never rises) or ``euler`` (explicit, for comparison).
        dt: step, seconds; none: the sampling period of the start's demonstration.
        stop_distance: a roll-out has arrived when the executed state is this near the goal, metres.
        max_duration: longest roll-out, as a multiple of the start's demonstration.
    """

    mode: Mode = "robust"
    controllers: tuple[Controller, ...] = (LpvdsController(), ClpvdsController())
    conditions: tuple[Condition, ...] = (Condition(),)
    starts: Literal["test", "train", "all"] = "test"
    integrator: Literal["cayley", "euler"] = "cayley"
    dt: Positive | None = None
    stop_distance: Positive = 0.0005
    max_duration: Positive = 3.0
