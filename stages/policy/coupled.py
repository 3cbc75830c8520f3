"""The coupled system, paper eqs. (9)-(12): x moves only while the executed state p_hat is with it.

Two couplings. `PaperCoupling` is the printed follower, eqs. (9) and (10), with a gate of finite tolerance: as printed,
p_hat never reaches x (|p_hat - x| falls as 1/(p_max k_c t)), so the exact gate of eq. (12) would never open again.
`RobustCoupling` is a follower of bounded speed that reaches x exactly, so the exact gate works and a coupled roll-out
is as fast as a plain one.

A policy does two things in a step: `observe` the executed state, which decides the gate, and `act`, which moves x and
commands the next executed state. Both are compiled, for any dimension, and allocate nothing. Not here: what the world
makes of the command (`stages/world`), and which controller an experiment asks for (`stages/rollout`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from pipeline.errors import ParameterError
from stages.compiled import compiled
from stages.policy.field import Field, Work, advance
from stages.trajectory import Array

SPEED_ALLOWANCE = 1.2
"""Multiple of the demonstrations' top speed that p_hat must keep up with: a learned field exceeds theirs a little."""

RETURN_ALLOWANCE = 5.0
"""Default speed of the deadbeat follower, as a multiple of the demonstrations' top speed; at least `SPEED_ALLOWANCE`.

It is how fast p_hat may come back after a push, and x waits where it is exceeded. Over LASA, pushed by 20 mm: at 1.2
the mean DTW is 12 % above undisturbed and an undisturbed roll-out takes up to 1.24 x the steps of plain LPV-DS, from
starts where the field is faster than the training demonstrations; at 3, 4.5 % and 1.04 x; at 5, 2 % and 1.00 x.
"""

SUBSTEP = 0.1
"""Largest C dt of one sub-step of the printed follower, eq. (9)."""

UNCOUPLED, DEADBEAT, PRINTED = 0, 1, 2


class Coupling(NamedTuple):
    """A coupling as compiled code takes it; what its kind does not use is 0.

    Attributes:
        kind: UNCOUPLED (plain LPV-DS), DEADBEAT (robust) or PRINTED (paper).
        p_max: eq. (10), 1/s.
        k_c: eq. (10), 1/m.
        gate: tolerance of eq. (12), m.
        v_max: top speed of the deadbeat follower, m/s.
    """

    kind: int
    p_max: float = 0.0
    k_c: float = 0.0
    gate: float = 0.0
    v_max: float = 0.0


PLAIN = Coupling(UNCOUPLED)
"""No coupling: x is the executed state."""


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
        """As `observe` and `act` take it."""
        return Coupling(PRINTED, p_max=self.p_max, k_c=self.k_c, gate=self.gate)


@dataclass(frozen=True, kw_only=True)
class RobustCoupling:
    """A deadbeat follower of bounded speed and the exact gate of eq. (12).

    Attributes:
        v_max: top speed of p_hat relative to x, m/s.
    """

    v_max: float

    @property
    def compiled(self) -> Coupling:
        """As `observe` and `act` take it."""
        return Coupling(DEADBEAT, v_max=self.v_max)


@compiled
def rate(distance: float, p_max: float, k_c: float) -> float:
    """C, 1/s, at a distance |p_hat - x| in metres. Paper eq. (10)."""
    return -p_max * math.expm1(-k_c * distance)


@compiled
def speed_limit(gate: float, p_max: float, k_c: float) -> float:
    """Fastest steady motion of x, m/s, that the printed follower trails by at most `gate` metres: C(gate) gate."""
    return gate * rate(gate, p_max, k_c)


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


def robust_coupling(*, v_max: float | None, top_speed: float, location: str) -> RobustCoupling:
    """Complete the parameter of the deadbeat follower: `v_max`, m/s; none: `RETURN_ALLOWANCE` x `top_speed`, m/s.

    Raises:
        ParameterError: `v_max` is not a positive number; `location` is the dotted place of these parameters.
    """
    if v_max is None:
        v_max = RETURN_ALLOWANCE * top_speed
    _require_positive(f"{location}.v_max", v_max)
    return RobustCoupling(v_max=v_max)


def _require_positive(location: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ParameterError(location, f"must be a positive number, not {value:g}.")


@compiled
def distance(x: Array, p_hat: Array) -> float:
    """|p_hat - x|, metres, of two arrays, shape (d,), metres."""
    squared = 0.0
    for i in range(x.shape[0]):
        squared += (p_hat[i] - x[i]) ** 2
    return math.sqrt(squared)


@compiled
def observe(coupling: Coupling, x: Array, p_hat: Array, was_open: bool) -> bool:
    """Take in the executed state and decide whether x may move. Paper eq. (12).

    Args:
        coupling: how.
        x: array, shape (d,), metres. Will be modified where nothing is coupled: it then becomes `p_hat`.
        p_hat: array, shape (d,), metres, the executed state as measured.
        was_open: the previous answer; True before the first step.

    Returns:
        delta(x, p_hat): exactly x == p_hat for the deadbeat follower; within the tolerance, and until twice the
        tolerance is exceeded, for the printed one; always True where nothing is coupled.
    """
    if coupling.kind == PRINTED:
        return distance(x, p_hat) <= (2.0 * coupling.gate if was_open else coupling.gate)
    if coupling.kind == DEADBEAT:
        is_open = True
        for i in range(x.shape[0]):
            is_open &= x[i] == p_hat[i]
        return is_open
    for i in range(x.shape[0]):
        x[i] = p_hat[i]
    return True


@compiled
def follow_printed(x: Array, p_hat: Array, dt: float, p_max: float, k_c: float) -> None:
    """Move p_hat towards x by eq. (9), x held. Paper eqs. (9), (10).

    The distance e is carried on by e <- e exp(-C h) with C taken at the middle of a sub-step, whose length h makes
    C h <= 0.1 at its start: it never overshoots, whatever p_max dt is, and is within 0.3 % of the exact solution.

    Args:
        x: array, shape (d,), metres.
        p_hat: array, shape (d,), metres. Will be modified.
        dt: seconds.
        p_max: 1/s.
        k_c: 1/m.
    """
    start = distance(x, p_hat)
    gap, left = start, dt
    while left > 0.0 and gap > 0.0:
        C = rate(gap, p_max, k_c)
        h = left if C * left <= SUBSTEP else SUBSTEP / C
        gap *= math.exp(-rate(gap * math.exp(-0.5 * C * h), p_max, k_c) * h)
        left = left - h if h < left else 0.0
    if start > 0.0:
        for i in range(x.shape[0]):
            p_hat[i] = x[i] + (p_hat[i] - x[i]) * (gap / start)


@compiled
def follow_deadbeat(x: Array, p_hat: Array, dt: float, v_max: float) -> None:
    """Move p_hat towards x at `v_max`, and onto x exactly where that is within reach: our replacement of eq. (9).

    Args:
        x: array, shape (d,), metres.
        p_hat: array, shape (d,), metres. Will be modified.
        dt: seconds.
        v_max: m/s.
    """
    gap, reach = distance(x, p_hat), v_max * dt
    for i in range(x.shape[0]):
        p_hat[i] = x[i] if gap <= reach else p_hat[i] + (reach / gap) * (x[i] - p_hat[i])


@compiled
def act(coupling: Coupling, field: Field, x: Array, p_hat: Array, is_open: bool, dt: float, work: Work) -> None:
    """Move x by one step of the learned field if the gate is open, then let p_hat follow it. Paper eqs. (9)-(11).

    x moves first and p_hat follows where it went, so that an undisturbed deadbeat follower loses no step.

    Args:
        coupling: how p_hat follows.
        field: the learned system and its integrator.
        x: array, shape (d,), metres. Will be modified.
        p_hat: array, shape (d,), metres: the executed state in, the commanded one out. Will be modified.
        is_open: what `observe` answered.
        dt: seconds.
        work: scratch of `advance`. Will be modified.
    """
    if is_open:
        advance(field, x, dt, work)
    if coupling.kind == PRINTED:
        follow_printed(x, p_hat, dt, coupling.p_max, coupling.k_c)
    elif coupling.kind == DEADBEAT:
        follow_deadbeat(x, p_hat, dt, coupling.v_max)
    else:
        for i in range(x.shape[0]):
            p_hat[i] = x[i]


def energy(x: Array, p_hat: Array, goal: Array) -> Array:
    """The Lyapunov candidate of the coupled system, |x - x_g|^2 + |p_hat - x|^2, square metres. Paper eq. (24).

    Args:
        x: array, shape (n, d), metres.
        p_hat: array, shape (n, d), metres.
        goal: array, shape (d,), metres.

    Returns:
        array, shape (n,).
    """
    z, e = x - goal, p_hat - x
    return np.asarray((z * z).sum(axis=1) + (e * e).sum(axis=1))
