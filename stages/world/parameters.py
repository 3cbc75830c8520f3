"""What can be set about the simulated world: two arms, a box, where it stands and where it goes."""

from __future__ import annotations

from typing import Literal

from pipeline.stage import NonNegative, Positive, parameters

Place = tuple[float, float, float]


@parameters
class Variation:
    """What differs from roll-out to roll-out, drawn uniformly from the seed; half widths of the ranges, 0: nothing.

    Attributes:
        mass: kg.
        friction: of the box, which pads multiply with their own.
        start: of the box's start, x and y, metres.
        centre_of_mass: of each coordinate, metres.
        bias: of each wrist's force sensor, newtons.
    """

    mass: NonNegative = 0.0
    friction: NonNegative = 0.0
    start: NonNegative = 0.0
    centre_of_mass: NonNegative = 0.0
    bias: NonNegative = 0.0


@parameters
class Scene:
    """Two arms beside each other and a box between them, clamped along y: x forward, y to the left, z up.

    Attributes:
        robot: ``iiwa`` or ``panda``, of the pybullet wheel, or ``baxter``, which robot_descriptions fetches.
        box: edges of the box, metres; the second one, L, is clamped.
        mass: of the box, kg.
        friction: of the box; pads multiply it with their own, 1.
        centre_of_mass: of the box, from its centre, metres.
        start: centre of the box where it stands, metres.
        goal: centre of the box where it is to stand, metres.
        length_error: by how much the controller takes L for longer than it is, metres.
        noise: standard deviation of each wrist's force sensor, newtons.
        bias: of the left and the right wrist's force sensor, newtons.
        variation: what differs from roll-out to roll-out.
    """

    robot: Literal["iiwa", "panda", "baxter"] = "iiwa"
    box: tuple[Positive, Positive, Positive] = (0.20, 0.30, 0.20)
    mass: Positive = 0.4
    friction: Positive = 1.0
    centre_of_mass: Place = (0.0, 0.0, 0.0)
    start: Place = (0.45, -0.15, 0.35)
    goal: Place = (0.65, 0.15, 0.47)
    length_error: float = 0.0
    noise: NonNegative = 0.3
    bias: tuple[float, float] = (0.0, 0.0)
    variation: Variation = Variation()
