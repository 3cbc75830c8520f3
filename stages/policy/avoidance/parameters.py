"""What can be set about obstacles and about how they are avoided: one class a shape, one class a method."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, MinLen
from pydantic import Discriminator

from pipeline.stage import NonNegative, Positive, parameters

Vector = Annotated[tuple[float, ...], MinLen(2)]
Lengths = Annotated[tuple[Positive, ...], MinLen(2)]


@parameters
class Sphere:
    """A sphere, in the plane a disc.

    Attributes:
        centre: where it is at the start, metres.
        radius: safety distance included, metres.
        velocity: m/s, known to the policy; none: it stands.
    """

    kind: Literal["sphere"] = "sphere"
    centre: Vector
    radius: Positive
    velocity: Vector | None = None


@parameters
class Box:
    """A box with rounded edges, in the plane a rectangle.

    Attributes:
        centre: where it is at the start, metres.
        half_extents: along its axes, metres, the rounding not included.
        rounding: how far its surface lies outside of them: a safety distance, metres.
        rotation: of its axes: in the plane an angle, rad; in space a quaternion x y z w; none: along the coordinates.
        velocity: m/s, known to the policy; none: it stands.
        cover: stand for it by the smallest sphere about its centre: a flat face can hold up what a sphere cannot.
    """

    kind: Literal["box"] = "box"
    centre: Vector
    half_extents: Lengths
    rounding: NonNegative = 0.0
    rotation: tuple[float, ...] | None = None
    velocity: Vector | None = None
    cover: bool = False


@parameters
class Ellipsoid:
    """An ellipsoid, in the plane an ellipse.

    Attributes:
        centre: where it is at the start, metres.
        semi_axes: metres.
        rotation: of its axes: in the plane an angle, rad; in space a quaternion x y z w; none: along the coordinates.
        velocity: m/s, known to the policy; none: it stands.
        cover: stand for it by the smallest sphere about its centre: a flat side can hold up what a sphere cannot.
    """

    kind: Literal["ellipsoid"] = "ellipsoid"
    centre: Vector
    semi_axes: Lengths
    rotation: tuple[float, ...] | None = None
    velocity: Vector | None = None
    cover: bool = False


Obstacle = Annotated[Sphere | Box | Ellipsoid, Discriminator("kind")]


@parameters
class NoAvoidance:
    """Obstacles are run into.

    Attributes:
        name: in tables; none: the kind.
    """

    kind: Literal["none"] = "none"
    name: str | None = None


@parameters
class RoasParameters:
    """The printed strategy, eqs. (19)-(23), with xdot of the learned system on their right-hand side.

    Attributes:
        name: in tables; none: the kind.
        unit: of length in which the equations are evaluated, metres: they are quadratic in speed, so it matters.
    """

    kind: Literal["roas"] = "roas"
    name: str | None = None
    unit: Positive = 1.0


@parameters
class RoasPlusParameters:
    """Our version: never enters an obstacle, never raises V, and goes round what is in the way.

    Attributes:
        name: in tables; none: the kind.
        rate: largest share of the distance to an obstacle that a second may take away, 1/s; none: 10, or 1/dt if that
            is less. More than 1/dt is refused.
        gain: speed of steering where all way is lost, as a multiple of the learned system's.
        margin: distance that is kept beyond every obstacle, metres.
        swiftness: top speed while steering, as a multiple of the learned system's speed at the place.
        speed_limit: top speed of giving way to moving obstacles, m/s; none: 1.5 x the demonstrations' top speed.
        detour: leave a place where V has a minimum on an obstacle by a way on which V rises for a while, and which ends
            where V is lower than before. With V = |x - x_g|^2 there are no such places on spheres.
        recover: begin inside of an obstacle, and leave it.
        merge: let spheres that overlap be one: the smallest sphere that holds them.
    """

    kind: Literal["roas+"] = "roas+"
    name: str | None = None
    rate: Positive | None = None
    gain: Positive = 1.0
    margin: NonNegative = 0.0
    swiftness: Annotated[float, Ge(1)] = 1.5
    speed_limit: Positive | None = None
    detour: bool = True
    recover: bool = False
    merge: bool = True


@parameters
class ApfParameters:
    """Artificial potential field: a repulsion within a range, which grows without bound. Khatib (1986).

    Attributes:
        name: in tables; none: the kind.
        range: distance from an obstacle at which repulsion begins, metres; none: the obstacle's own radius.
        gain: repulsion is gain (range/h - 1) (range/h)^2 at the distance h, m/s; none: 0.1 x the demonstrations' top
            speed.
        speed_limit: top speed, m/s; none: 1.5 x the demonstrations' top speed.
    """

    kind: Literal["apf"] = "apf"
    name: str | None = None
    range: Positive | None = None
    gain: Positive | None = None
    speed_limit: Positive | None = None


@parameters
class ModulationParameters:
    """Modulation of the learned velocity by a matrix for each obstacle. Khansari-Zadeh and Billard (2012).

    Attributes:
        name: in tables; none: the kind.
        reactivity: how far an obstacle is felt: its influence falls as (distance/radius)^(-2/reactivity).
        margin: distance that is kept beyond every obstacle, metres.
    """

    kind: Literal["modulation"] = "modulation"
    name: str | None = None
    reactivity: Positive = 1.0
    margin: NonNegative = 0.0


@parameters
class CbfParameters:
    """The velocity nearest to the learned one that keeps clear: a control barrier function. Ames et al. (2017).

    Attributes:
        name: in tables; none: the kind.
        rate: largest share of the distance to an obstacle that a second may take away, 1/s; none: 10, or 1/dt if that
            is less. More than 1/dt is refused.
        margin: distance that is kept beyond every obstacle, metres.
        speed_limit: top speed, m/s; none: 1.5 x the demonstrations' top speed.
        recover: begin inside of an obstacle, and leave it.
    """

    kind: Literal["cbf"] = "cbf"
    name: str | None = None
    rate: Positive | None = None
    margin: NonNegative = 0.0
    speed_limit: Positive | None = None
    recover: bool = False


Avoidance = Annotated[
    NoAvoidance | RoasParameters | RoasPlusParameters | ApfParameters | ModulationParameters | CbfParameters,
    Discriminator("kind"),
]
