"""How the executed state p_hat follows x: the parameters of both couplings, completed and checked. Paper eqs. (9)-(12).

Not here: the follower and the gate themselves (`coupled.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.optimize import brentq

from pipeline.errors import ParameterError
from stages.policy.coupled import DEADBEAT, PRINTED, Coupling, speed_limit

SPEED_ALLOWANCE = 1.2
"""Multiple of the demonstrations' top speed that p_hat must keep up with: a learned field exceeds theirs a little."""

RETURN_ALLOWANCE = 5.0
"""Default speed of the deadbeat follower, as a multiple of the demonstrations' top speed; at least `SPEED_ALLOWANCE`.

It is how fast p_hat may come back after a push, and x waits where it is exceeded. Over LASA, pushed by 20 mm: at 1.2
the mean DTW is 12 % above undisturbed and an undisturbed roll-out takes up to 1.24 x the steps of plain LPV-DS, from
starts where the field is faster than the training demonstrations; at 3, 4.5 % and 1.04 x; at 5, 2 % and 1.00 x.
"""


@dataclass(frozen=True, kw_only=True)
class PaperCoupling:
    """The printed follower and a gate with hysteresis: it opens where |p_hat - x| <= gate, closes beyond 2 gate.

    Attributes:
        p_max: eq. (10), 1/s: the largest rate, not a speed.
        k_c: eq. (10), 1/m.
        gate: tolerance in place of the equality of eq. (12), m.
    """

    p_max: float
    k_c: float
    gate: float

    @property
    def compiled(self) -> Coupling:
        """As `observe` and `follow` take it."""
        return Coupling(PRINTED, p_max=self.p_max, k_c=self.k_c, gate=self.gate)


@dataclass(frozen=True, kw_only=True)
class RobustCoupling:
    """A deadbeat follower of bounded speed and the exact gate of eq. (12), or one of a tolerance.

    Attributes:
        v_max: top speed of p_hat, m/s. x is no faster.
        tolerance: 0: the gate is exact; otherwise it opens where |p_hat - x| <= tolerance and closes beyond twice that,
            m: what noise would keep closed for ever.
    """

    v_max: float
    tolerance: float = 0.0

    @property
    def compiled(self) -> Coupling:
        """As `observe` and `follow` take it."""
        return Coupling(DEADBEAT, gate=self.tolerance, v_max=self.v_max)


def gate_for(p_max: float, k_c: float, speed: float) -> float:
    """The tolerance of the gate, metres, whose speed limit is `speed`, m/s: p_max eps (1 - exp(-k_c eps)) = speed."""
    # eps (1 - exp(-k_c eps)) lies between eps k_c eps / (1 + k_c eps) and eps, which brackets the root.
    low = speed / p_max
    high = 0.5 * (low + math.sqrt(low * (low + 4.0 / k_c)))
    if not low < high:  # they agree to rounding: the exponential is nil
        return low
    return float(brentq(lambda gate: speed_limit(gate, p_max, k_c) - speed, low, high * (1 + 1e-9), xtol=1e-15 * low))


def p_max_for(gate: float, k_c: float, speed: float) -> float:
    """The p_max, 1/s, at which `gate` metres have the speed limit `speed`, m/s."""
    return -speed / (gate * math.expm1(-k_c * gate))


def paper_coupling(
    *, p_max: float | None, k_c: float, gate: float | None, top_speed: float, location: str
) -> PaperCoupling:
    """Complete the parameters of the printed follower so that `SPEED_ALLOWANCE` x `top_speed` passes. Eqs. (9)-(12).

    Args:
        p_max: eq. (10), 1/s; none: from `gate`.
        k_c: eq. (10), 1/m.
        gate: tolerance of eq. (12), m; none: from `p_max`.
        top_speed: of the demonstrations, m/s.
        location: dotted place of these parameters, for messages.

    Raises:
        ParameterError: `gate` is 0, both are given and x would outrun the follower, or neither is given.
    """
    given = {"k_c": k_c, "p_max": p_max, "gate": gate}
    if gate == 0.0:
        raise ParameterError(
            f"{location}.gate",
            "0 cannot work in paper mode: the printed follower never reaches x (its distance falls as "
            "1/(p_max k_c t)), so x would never move again; give metres, or mode = robust, whose gate is exact.",
        )
    for name, value in given.items():
        if value is not None:
            _require_positive(f"{location}.{name}", value)
    wanted = SPEED_ALLOWANCE * top_speed
    if gate is not None and p_max is not None:
        limit = speed_limit(gate, p_max, k_c)
        if limit < top_speed:
            raise ParameterError(
                f"{location}.gate",
                f"x would outrun p_hat, which with p_max = {p_max:g} 1/s and k_c = {k_c:g} 1/m trails within "
                f"{gate:g} m only up to {limit:.3g} m/s, while the demonstrations reach {top_speed:.3g} m/s; "
                f"p_max = {p_max_for(gate, k_c, wanted):.3g} or gate = {gate_for(p_max, k_c, wanted):.3g} would do.",
            )
        return PaperCoupling(p_max=p_max, k_c=k_c, gate=gate)
    if gate is not None:
        return PaperCoupling(p_max=p_max_for(gate, k_c, wanted), k_c=k_c, gate=gate)
    if p_max is not None:
        return PaperCoupling(p_max=p_max, k_c=k_c, gate=gate_for(p_max, k_c, wanted))
    raise ParameterError(f"{location}.gate", "paper mode needs gate (metres), p_max (1/s) or both; neither is given.")


def robust_coupling(*, v_max: float | None, tolerance: float = 0.0, top_speed: float, location: str) -> RobustCoupling:
    """Complete the parameters of the deadbeat follower: `v_max`, m/s; none: `RETURN_ALLOWANCE` x `top_speed`, m/s.

    Raises:
        ParameterError: `v_max` is not positive, or `tolerance`, m, is negative; `location` is the dotted place of these
            parameters.
    """
    if v_max is None:
        v_max = RETURN_ALLOWANCE * top_speed
    _require_positive(f"{location}.v_max", v_max)
    if not (math.isfinite(tolerance) and tolerance >= 0.0):
        raise ParameterError(f"{location}.tolerance", f"must be metres, 0 or more, not {tolerance:g}.")
    return RobustCoupling(v_max=v_max, tolerance=tolerance)


def check_explicit(coupling: PaperCoupling, dt: float, location: str) -> None:
    """Refuse a step, seconds, at which explicit Euler of eq. (9) overshoots: C dt must not exceed 1, and C <= p_max.

    Raises:
        ParameterError: naming the largest step and the largest p_max; `location` is the dotted place of the parameters.
    """
    if coupling.p_max * dt > 1.0:
        raise ParameterError(
            f"{location}.p_max",
            f"{coupling.p_max:.4g} 1/s with dt = {dt:g} s makes C dt = {coupling.p_max * dt:.3g}, and explicit Euler "
            f"of eq. (9) overshoots beyond 1: use integrator = cayley, dt <= {1.0 / coupling.p_max:.3g} or "
            f"p_max <= {1.0 / dt:.3g}.",
        )


def _require_positive(location: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ParameterError(location, f"must be a positive number, not {value:g}.")
