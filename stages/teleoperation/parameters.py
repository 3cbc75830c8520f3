"""Parameters of teleoperation: how the master's motion becomes that of the arms, and one class a kind of master."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Gt, Interval, Len
from pydantic import AllowInfNan, Discriminator

from pipeline.stage import NonNegative, Positive, UnitInterval, Whole, parameters
from stages.policy.parameters import AdmittanceParameters
from stages.world.parameters import Scene, Variation

Point = Annotated[tuple[float, ...], Len(3, 3)]


@parameters
class MappingParameters:
    """How the arms follow the master. Paper eqs. (1)-(3).

    Attributes:
        alpha: scale of eq. (2): metres of the arms for a metre of the master.
        R_mf: rotation of eq. (2) from the master's base frame to the arms': nine numbers, row by row, or a unit
            quaternion, x y z w.
        separation: L of eq. (3), m: how far the right pad is from the left one along -y.
        low_pass: the master's motion is halved in power at this frequency, Hz; inf: it is not filtered. 3: a hand
            steers below 2 Hz and trembles at 8 to 12 Hz.
        stale: a sample of the master older than this is not followed any more, s.
        low, high: corners of the box in which both pads stay, m, in the arms' base frame.
    """

    alpha: Positive = 1.0
    R_mf: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    separation: Positive
    low_pass: Annotated[float, Gt(0), AllowInfNan(True)] = 3.0
    stale: Positive = 0.1
    low: Point
    high: Point


@parameters
class SimulatedOperatorParameters:
    """A made operator at a small haptic device.

    Attributes:
        stroke: diameter of the ball of the device's workspace that the hand keeps to, m. 0.12: the shorter sides of the
            Touch X that the paper uses.
        speed: top speed of the hand in a long stroke, m/s.
        tremor: root mean square of each coordinate of the hand's tremor, m.
        tremor_band: lowest and highest frequency of it, Hz. 8 to 12: physiological tremor.
        aim: largest error of a stroke, along each axis, as a share of its length.
        reaction: time from seeing to moving, s.
        pause: mean of a further hesitation, s; each is between half and one and a half of it.
        tolerance: a via-point counts as reached within this, m, of the pads' midpoint.
        stops: the hand stops at every via-point. Otherwise one smooth stroke may lead through several, whose corners
            the lag of the low-pass and of the arms cuts, by millimetres where they move at 0.5 m/s.
    """

    kind: Literal["simulated"] = "simulated"
    stroke: Positive = 0.12
    speed: Positive = 0.15
    tremor: Annotated[float, Interval(ge=0, lt=0.001)] = 0.0002
    tremor_band: Annotated[tuple[Positive, ...], Len(2, 2)] = (8.0, 12.0)
    aim: Annotated[float, Interval(ge=0, le=0.2)] = 0.01
    reaction: NonNegative = 0.2
    pause: NonNegative = 0.1
    tolerance: Positive = 0.002
    stops: bool = False


@parameters
class ReplayParameters:
    """A recorded stream of a master.

    Attributes:
        file: relative to the project.
    """

    kind: Literal["replay"] = "replay"
    file: str


@parameters
class KeyboardParameters:
    """Keys move a master that is not there, at constant speed. Keys are named as pygame names them.

    Attributes:
        speed: of the master, m/s.
        slow: share of it while the key for slow is held.
        forward, back: keys for +x and -x of the master's frame; left, right: +y and -y; up, down: +z and -z.
        clutch: key that engages while it is held.
        slowly: key for slow, while it is held.
        leave: key that ends the demonstration.
    """

    kind: Literal["keyboard"] = "keyboard"
    speed: Positive = 0.1
    slow: UnitInterval = 0.25
    forward: str = "w"
    back: str = "s"
    left: str = "a"
    right: str = "d"
    up: str = "e"
    down: str = "q"
    clutch: str = "space"
    slowly: str = "left shift"
    leave: str = "escape"


@parameters
class GamepadParameters:
    """Two sticks move a master that is not there, at a speed that grows with their deflection.

    Numbers of axes and buttons are those that pygame 2 gives an Xbox 360 controller; deflecting an axis towards -1 is
    forward, left, up.

    Attributes:
        speed: of the master at full deflection of an axis, m/s.
        deadzone: share of the deflection that counts as none.
        forward: axis for x of the master's frame, +x at -1; left: for y, +y at -1; up: for z, +z at -1.
        clutch: button that engages while it is held.
        leave: button that ends the demonstration.
        device: number of the gamepad among those connected.
    """

    kind: Literal["gamepad"] = "gamepad"
    speed: Positive = 0.15
    deadzone: Annotated[float, Interval(ge=0, lt=1)] = 0.1
    forward: Whole = 1
    left: Whole = 0
    up: Whole = 4
    clutch: Whole = 5
    leave: Whole = 7
    device: Whole = 0


MasterParameters = Annotated[
    SimulatedOperatorParameters | ReplayParameters | KeyboardParameters | GamepadParameters, Discriminator("kind")
]


@parameters
class TeleopParameters:
    """Demonstrations by one master and two followers in the simulated world: `clpv teleop`.

    Attributes:
        scene: arms, box, start and goal, and how they vary from demonstration to demonstration.
        master: who leads.
        alpha, R_mf, low_pass, stale: of the mapping, as of `MappingParameters`.
        low, high: corners of the box in which both pads stay, m.
        admittance: of the arms, which press by themselves.
        lift: how high the simulated operator lifts the box, and from how high above the goal it sets it down, m.
        stand_off: of the pads from the faces, at the start and the end, m.
        approach_speed: of the pads until they touch, m/s.
        dt: cycle of the controller, s: whole milliseconds.
        record: samples a second that are kept.
        longest: a demonstration is broken off after so long, s.
    """

    scene: Scene = Scene(variation=Variation(start=0.02))
    master: MasterParameters = SimulatedOperatorParameters()
    alpha: Positive = 1.0
    R_mf: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    low_pass: Annotated[float, Gt(0), AllowInfNan(True)] = 3.0
    stale: Positive = 0.1
    low: Point = (0.30, -0.60, 0.10)
    high: Point = (0.85, 0.60, 0.90)
    admittance: AdmittanceParameters = AdmittanceParameters()
    lift: Positive = 0.10
    stand_off: Positive = 0.05
    approach_speed: Positive = 0.05
    dt: Positive = 0.004
    record: Positive = 50.0
    longest: Positive = 120.0
