"""Parameters of the rollout stage: which controllers run under which conditions from which starts."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import MinLen
from pydantic import Discriminator

from pipeline.stage import Count, NonNegative, Positive, UnitInterval, Whole, parameters
from stages.policy.avoidance.parameters import Avoidance, Obstacle, RoasPlusParameters
from stages.policy.parameters import AdmittanceParameters, FollowingParameters
from stages.world.parameters import Scene

Mode = Literal["paper", "robust"]
Vector = Annotated[tuple[float, ...], MinLen(2)]


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
        tolerance: 0: the gate is exact; else it opens within this and closes beyond twice this, m: more than the noise
            of the executed state, which would keep an exact gate closed. Only in robust mode.
    """

    kind: Literal["clpvds"] = "clpvds"
    mode: Mode | None = None
    k_c: Positive = 100.0
    p_max: Positive | None = None
    gate: NonNegative | None = 0.002
    v_max: Positive | None = None
    tolerance: NonNegative = 0.0


@parameters
class Displacement:
    """The executed state is displaced at once, and let go: the paper's simulated disturbance.

    Attributes:
        offset: metres, one number a coordinate.
        at_fraction: when, as a fraction of the arc length of the controller's own undisturbed path; the paper: 0.5.
        at_time: when, seconds from the start.
        at_state: when, as the place on that path nearest to this state, metres. One of the three; none of them: half.
    """

    kind: Literal["displacement"] = "displacement"
    offset: Vector
    at_fraction: UnitInterval | None = None
    at_time: NonNegative | None = None
    at_state: Vector | None = None


@parameters
class Held:
    """The executed state is displaced at once and held there, whatever is commanded: the paper's disturbance of an arm.

    Attributes:
        offset: metres, one number a coordinate.
        duration: seconds.
        at_fraction, at_time, at_state: when, as of a displacement.
    """

    kind: Literal["held"] = "held"
    offset: Vector
    duration: Positive
    at_fraction: UnitInterval | None = None
    at_time: NonNegative | None = None
    at_state: Vector | None = None


@parameters
class Ramp:
    """The executed state is dragged away in a straight line, held, and let go.

    Attributes:
        offset: metres, one number a coordinate, where it is dragged.
        rise: seconds that this takes.
        hold: seconds that it is held there.
        at_fraction, at_time, at_state: when, as of a displacement.
    """

    kind: Literal["ramp"] = "ramp"
    offset: Vector
    rise: Positive
    hold: NonNegative = 0.0
    at_fraction: UnitInterval | None = None
    at_time: NonNegative | None = None
    at_state: Vector | None = None


@parameters
class Noise:
    """The executed state is shaken: every sample is displaced by a normal random vector.

    Attributes:
        std: standard deviation of each coordinate of each sample's displacement, metres.
        duration: seconds.
        at_fraction, at_time, at_state: when, as of a displacement.
    """

    kind: Literal["noise"] = "noise"
    std: Positive
    duration: Positive
    at_fraction: UnitInterval | None = None
    at_time: NonNegative | None = None
    at_state: Vector | None = None


Disturbance = Annotated[Displacement | Held | Ramp | Noise, Discriminator("kind")]


@parameters
class RandomScenes:
    """Scenes of random spheres that all block the way which the learned system would take from a start.

    Lengths are relative to the distance from the start to the goal. The seed of the experiment draws them, the same for
    all controllers and methods.

    Attributes:
        count: scenes for each start.
        fewest, most: spheres in a scene.
        smallest, largest: radii of spheres.
        apart: room between any two spheres; negative: they may overlap by so much.
        free: room between a sphere and start or goal.
        speed: top speed of the spheres, as a multiple of the top speed on the way; 0: they stand. A moving sphere is on
            the way when the state would be there.
        common: one scene for all starts, placed on the way from the first of them; it may not block the others.
    """

    count: Count = 1
    fewest: Count = 1
    most: Count = 5
    smallest: Positive = 0.05
    largest: Positive = 0.2
    apart: float = 0.02
    free: Positive = 0.02
    speed: NonNegative = 0.0
    common: bool = False


@parameters
class Condition:
    """What happens to the executed state on the way, and what is in the way.

    Attributes:
        name: of the condition, as in the tables: ``none``, ``cond1``.
        disturbances: of the executed state, in any number and order.
        obstacles: spheres, boxes, ellipsoids; standing or moving.
        scenes: random spheres instead.
    """

    name: str = "none"
    disturbances: tuple[Disturbance, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    scenes: RandomScenes | None = None


Controller = Annotated[LpvdsController | ClpvdsController, Discriminator("kind")]


@parameters
class RolloutParameters:
    """Cases in the kinematic world: controllers x conditions x methods of avoidance x starts.

    Attributes:
        mode: of the coupled controllers that name none of their own.
        controllers: what runs.
        conditions: under what.
        avoidances: how obstacles are avoided; each runs under every condition that has obstacles.
        starts: from the first points of which demonstrations.
        integrator: ``cayley`` (V never rises) or ``euler`` (explicit, for comparison).
        dt: step, seconds; none: the sampling period of the start's demonstration.
        stop_distance: a roll-out has arrived when the executed state is this near the goal, metres.
        max_duration: longest roll-out, as a multiple of the start's demonstration.
        replicate: other random numbers, with the same seed.
    """

    kind: Literal["kinematic"] = "kinematic"
    mode: Mode = "robust"
    controllers: tuple[Controller, ...] = (LpvdsController(), ClpvdsController())
    conditions: tuple[Condition, ...] = (Condition(),)
    avoidances: tuple[Avoidance, ...] = (RoasPlusParameters(),)
    starts: Literal["test", "train", "all"] = "test"
    integrator: Literal["cayley", "euler"] = "cayley"
    dt: Positive | None = None
    stop_distance: Positive = 0.0005
    max_duration: Positive = 3.0
    replicate: Whole = 0


Place = tuple[float, float, float]
Side = Literal["left", "right"]


@parameters
class Drag:
    """One arm is taken by the hand, dragged away smoothly, held, and let go: a teleoperated disturbance, Fig. 5d.

    Attributes:
        arm: which one; the controller is not told.
        offset: where it is dragged, metres from where it was commanded when this began.
        rise: seconds that this takes.
        hold: seconds that it is held there.
        at_fraction: when, as a fraction of the arc length of the policy's way; none of the three: half.
        at_time: when, seconds from when the box was first carried.
        at_state: when, as the place on that way nearest to this one, metres.
    """

    kind: Literal["drag"] = "drag"
    arm: Side = "left"
    offset: Place
    rise: NonNegative = 0.6
    hold: NonNegative = 0.8
    at_fraction: UnitInterval | None = None
    at_time: NonNegative | None = None
    at_state: Vector | None = None


@parameters
class Force:
    """A force acts on the flange of one arm.

    Attributes:
        arm: which one; the controller is not told.
        force: newtons.
        duration: seconds.
        at_fraction, at_time, at_state: when, as of a drag.
    """

    kind: Literal["force"] = "force"
    arm: Side = "left"
    force: Place
    duration: Positive
    at_fraction: UnitInterval | None = None
    at_time: NonNegative | None = None
    at_state: Vector | None = None


@parameters
class RandomDrag:
    """A drag of a random arm, in a random direction, at a random moment; the same for a box under all conditions.

    Attributes:
        nearest, farthest: metres that it is dragged away.
        shortest, longest: seconds from when it begins to when it is let go.
        quickest, slowest: seconds of these in which it is dragged.
        earliest, latest: when it begins, as a fraction of the arc length of the policy's way.
    """

    kind: Literal["random"] = "random"
    nearest: Positive = 0.03
    farthest: Positive = 0.10
    shortest: Positive = 1.0
    longest: Positive = 2.0
    quickest: Positive = 0.4
    slowest: Positive = 0.8
    earliest: UnitInterval = 0.1
    latest: UnitInterval = 0.9


ArmDisturbance = Annotated[Drag | Force | RandomDrag, Discriminator("kind")]


@parameters
class Flowerpot:
    """A flowerpot, and the sphere about its middle from which the middle of the box is to stay away. Paper Fig. 6.

    Attributes:
        centre: of both, until the box is lifted, metres.
        radius: of the sphere, the size of the box included, metres. Paper: 0.23, for its box.
        along: metres by which the policy sees the sphere drawn out along the clamp axis, to either side: the hands
            beside the box have to pass, too; 0: the sphere alone.
        velocity: m/s, known to the policy; none: it stands.
        height, width: of the pot with its plant, metres.
        spread: half width of the range of each coordinate of the centre, from which each box's is drawn, metres.
        radius_spread: the same of the radius.
    """

    centre: Place = (0.58, 0.0, 0.39)
    radius: Positive = 0.18
    along: NonNegative = 0.2
    velocity: Place | None = None
    height: Positive = 0.24
    width: Positive = 0.10
    spread: NonNegative = 0.0
    radius_spread: NonNegative = 0.0


@parameters
class CarryCondition:
    """How the box is held, and what happens on the way.

    Attributes:
        name: of the condition, as in the tables.
        compliance: press by admittance; else pads stay where eq. (13) puts them.
        following: the arms follow each other when one is pushed, eq. (14); else each stays with its own place.
        coupling: x waits and p_hat comes back to it, eqs. (9)-(12); else the way goes on from wherever p_hat is.
        mode: of the admittance and of eq. (14); none: the roll-out's own.
        length_error: by how much the controller takes the box for longer than it is, metres, beside the scene's own;
            without compliance this decides how hard it is pressed.
        length_spread: half width of the range, about that, from which each box's is drawn, metres.
        length: what L is first taken for: ``scene``, as it is, but for the errors; ``demonstrations``, the mean
            distance of the arms in them, errors added.
        mass_error: by how much the controller takes the box for heavier than it is, kg, where it does not find out.
        finds_length: take L from where the pads stand when they hold the box; none: in robust mode.
        finds_mass: feed forward what hangs on the wrists, and weigh the box after lift-off; else what the controller
            takes for its mass is fed forward; none: in robust mode.
        disturbances: of the arms.
        obstacles: in the way; drawn anew until start and goal are outside and the arms can reach a way round.
        avoidance: how the policy avoids them; none: ROAS+ with 5 mm beyond the spheres, in paper mode ROAS as printed.
    """

    name: str = "compliant"
    compliance: bool = True
    following: bool = True
    coupling: bool = True
    mode: Mode | None = None
    length_error: float = 0.0
    length_spread: NonNegative = 0.0
    length: Literal["scene", "demonstrations"] = "scene"
    mass_error: float = 0.0
    finds_length: bool | None = None
    finds_mass: bool | None = None
    disturbances: tuple[ArmDisturbance, ...] = ()
    obstacles: tuple[Flowerpot, ...] = ()
    avoidance: Avoidance | None = None


@parameters
class CarryParameters:
    """Cases in the simulated world: conditions x boxes, each carried by two arms along the policy's way.

    Attributes:
        mode: ``paper``, eq. (17) as printed, or ``robust``; of the conditions that name none of their own.
        scene: arms, box, start and goal, and how they vary.
        conditions: how the box is held.
        count: boxes under each condition; the same for all.
        admittance: of the arms.
        following: of the arms, when one is pushed.
        least_friction: on which the pads can count: F_d is raised for a box that weighs too much for it; none: F_d
            stays.
        squeeze: metres that pads go beyond the faces without compliance.
        approach_speed: of the pads until they touch, m/s.
        stand_off: of the pads from the faces, at the start and the end, metres.
        v_max: top speed of p_hat, m/s; none: 5 x the demonstrations' top speed.
        dt: cycle of the controller, seconds: whole milliseconds.
        stop_distance: the way is at its end when p_hat is this near the goal, metres.
        max_duration: longest roll-out, seconds.
        record: samples a second that are kept.
        logs: whether an MCAP log of each roll-out is kept.
        replicate: other random numbers, with the same seed.
    """

    kind: Literal["bullet"] = "bullet"
    mode: Mode = "robust"
    scene: Scene = Scene()
    conditions: tuple[CarryCondition, ...] = (CarryCondition(),)
    count: Count = 7
    admittance: AdmittanceParameters = AdmittanceParameters()
    following: FollowingParameters = FollowingParameters()
    least_friction: Positive | None = None
    squeeze: NonNegative = 0.002
    approach_speed: Positive = 0.05
    stand_off: Positive = 0.05
    v_max: Positive | None = None
    dt: Positive = 0.004
    stop_distance: Positive = 0.001
    max_duration: Positive = 60.0
    record: Positive = 50.0
    logs: bool = True
    replicate: Whole = 0


StageParameters = RolloutParameters | CarryParameters
"""What the rollout stage takes, told apart by `kind`."""
