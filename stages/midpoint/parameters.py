"""Parameters of the midpoint stage."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, Interval

from pipeline.stage import NonNegative, Positive, parameters


@parameters
class MidpointParameters:
    """How recordings become trajectories.

    Attributes:
        samples: samples of each trajectory on its uniform clock; none: as many as were recorded.
        smoothing: width of the Savitzky-Golay window as a fraction of the duration, 0 to 0.5; 0: positions as recorded.
        velocity_window: width of the differentiator's window as a fraction of the duration, at least 3 samples.
        polynomial: degree of the local polynomials, 1 to 5.
        goal: where the motion ends, metres; none: the mean end point of the training demonstrations.
        goal_margin: how far outside the data's bounding box a given goal may lie, as a fraction of the box's diagonal.
        end_spread: how far from the mean end of the training demonstrations one may end, as a fraction of their size,
            and still be shifted onto the goal. 0.1: demonstrations that end elsewhere are another motion.
        clamp_axis: axis along which two arms hold the object between them; ``auto``: along which they are apart most.
        separation_limit: largest deviation of the arms' separation along that axis from its mean, in one
            demonstration, that passes without a warning, metres. 0.02: what soft pads and loose grips give.
    """

    samples: Annotated[int, Ge(10)] | None = None
    smoothing: Annotated[float, Interval(ge=0, le=0.5)] = 0.0
    velocity_window: Annotated[float, Interval(gt=0, le=0.5)] = 0.005
    polynomial: Annotated[int, Interval(ge=1, le=5)] = 2
    goal: tuple[float, ...] | None = None
    goal_margin: NonNegative = 0.1
    end_spread: NonNegative = 0.1
    clamp_axis: Literal["auto", "x", "y", "z"] = "auto"
    separation_limit: Positive = 0.02
