"""Parameters of the dynamics stage, one class a kind of dynamics."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Interval, MinLen

from pipeline.stage import NonNegative, Positive, parameters

Share = Annotated[float, Interval(ge=0, lt=1)]
Fraction = Annotated[float, Interval(ge=0, le=1)]
PositiveFraction = Annotated[float, Interval(gt=0, le=1)]


@parameters
class QlfParameters:
    """LPV-DS under the paper's quadratic Lyapunov function, V = |x - x_g|^2: eqs. (6)-(8).

    Attributes:
        margin: A_k + A_k' <= -margin I, 1/s. 1e-3 costs no accuracy; 0 is not strict.
        loss: ``squared``, as the paper's text says, or ``norm``, as eq. (7) is printed.
        tolerance: largest relative residual accepted of the solver.
    """

    kind: Literal["qlf"] = "qlf"
    margin: Positive = 1e-3
    loss: Literal["squared", "norm"] = "squared"
    tolerance: Positive = 1e-6


@parameters
class PqlfParameters:
    """LPV-DS under a learned quadratic Lyapunov function, V = (x - x_g)'P (x - x_g), trace P = d.

    Attributes:
        margin: A_k'P + P A_k <= -margin rate I, with rate = rms speed / rms distance from the goal, 1/s.
        condition: largest condition of P.
        widening: factor of the mixture's covariances, so that its components hand over smoothly.
        blur: standard deviation that is added to them, as a fraction of the motion's size.
        ridge: weight of |A_k + c_k I|^2, c_k the component's own rate, relative to its own Gram matrix.
        guidance: weights of the guides beside the demonstrations that are tried, relative to that of the samples.
        guide_width: distance of the guides from the path, as a fraction of the motion's size.
        guide_decay: length of path over which they lead back, as a fraction of the motion's size.
        speed_limit: largest speed of the system, as a multiple of the training demonstrations' top speed; 0: none, and
            a linear system is twice as fast twice as far away.
        tolerance: largest relative residual accepted of the solver.
    """

    kind: Literal["pqlf"] = "pqlf"
    margin: PositiveFraction = 1e-3
    condition: Annotated[float, Interval(ge=1, le=1e6)] = 50.0
    widening: Annotated[float, Interval(gt=0, le=100)] = 2.0
    blur: Fraction = 0.03
    ridge: Annotated[float, Interval(ge=0, le=1e3)] = 1e-3
    guidance: Annotated[tuple[NonNegative, ...], MinLen(1)] = (0.0, 0.6, 2.0)
    guide_width: PositiveFraction = 0.04
    guide_decay: PositiveFraction = 0.15
    speed_limit: NonNegative = 1.2
    tolerance: Positive = 1e-6


@parameters
class WarpedParameters:
    """LPV-DS in the image of a learned diffeomorphism psi: V = psi'P psi, trace P = d.

    Attributes:
        straightening: how far the warp carries the mean demonstration towards a straight line, 0 to 1, that is tried.
        translations: most Gaussian translations of the warp.
        margin: A_k'P + P A_k <= -margin rate I, with rate = rms speed / rms distance from the goal, 1/s.
        condition: largest condition of P.
        widening: factor of the mixture's covariances, so that its components hand over smoothly.
        blur: standard deviation that is added to them, as a fraction of the motion's size.
        ridge: weight of |A_k + c_k I|^2, c_k the component's own rate, relative to its own Gram matrix.
        guidance: weights of the guides beside the demonstrations that are tried, relative to that of the samples.
        guide_width: distance of the guides from the path, as a fraction of the motion's size.
        guide_decay: length of path over which they lead back, as a fraction of the motion's size.
        speed_limit: largest speed of the system, as a multiple of the training demonstrations' top speed; 0: none, and
            a linear system is twice as fast twice as far away.
        tolerance: largest relative residual accepted of the solver.
    """

    kind: Literal["warped"] = "warped"
    straightening: Annotated[tuple[Share, ...], MinLen(1)] = (0.45, 0.6, 0.75, 0.85)
    translations: Annotated[int, Interval(ge=1, le=1000)] = 30
    margin: PositiveFraction = 0.02
    condition: Annotated[float, Interval(ge=1, le=1e6)] = 50.0
    widening: Annotated[float, Interval(gt=0, le=100)] = 2.0
    blur: Fraction = 0.02
    ridge: Annotated[float, Interval(ge=0, le=1e3)] = 1e-3
    guidance: Annotated[tuple[NonNegative, ...], MinLen(1)] = (0.6,)
    guide_width: PositiveFraction = 0.04
    guide_decay: PositiveFraction = 0.15
    speed_limit: NonNegative = 1.2
    tolerance: Positive = 1e-6


DynamicsParameters = QlfParameters | PqlfParameters | WarpedParameters
