"""The coupled system: how p_hat follows x, and when x may move. Paper eqs. (9)-(12).

Two followers. The printed one, eqs. (9) and (10), with a gate of finite tolerance: as printed, p_hat never reaches x
(|p_hat - x| falls as 1/(p_max k_c t)), so the exact gate of eq. (12) would never open again. And a deadbeat one of
bounded speed that reaches x exactly, so that the exact gate works and a coupled roll-out is as fast as a plain one.

Compiled, for any dimension, nothing is allocated. Not here: their parameters (`coupling.py`), and a whole step of a
policy (`policy.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stages.compiled import lean
from stages.trajectory import Array

SUBSTEP = 0.1
"""Largest C dt of one sub-step of the printed follower, eq. (9)."""

UNCOUPLED, DEADBEAT, PRINTED = 0, 1, 2


class Coupling(NamedTuple):
    """A coupling as compiled code takes it; what its kind does not use is 0.

    Attributes:
        kind: UNCOUPLED (plain LPV-DS), DEADBEAT (robust) or PRINTED (paper).
        p_max: eq. (10), 1/s.
        k_c: eq. (10), 1/m.
        gate: tolerance of eq. (12), m; 0: exact.
        v_max: top speed of the deadbeat follower, m/s.
    """

    kind: int
    p_max: float = 0.0
    k_c: float = 0.0
    gate: float = 0.0
    v_max: float = 0.0


PLAIN = Coupling(UNCOUPLED)
"""No coupling: x is the executed state."""


@lean
def rate(distance: float, p_max: float, k_c: float) -> float:
    """C, 1/s, at a distance |p_hat - x| in metres. Paper eq. (10)."""
    return -p_max * math.expm1(-k_c * distance)


@lean
def speed_limit(gate: float, p_max: float, k_c: float) -> float:
    """Fastest steady motion of x, m/s, that the printed follower trails by at most `gate` metres: C(gate) gate."""
    return gate * rate(gate, p_max, k_c)


@lean
def distance(x: Array, p_hat: Array) -> float:
    """|p_hat - x|, metres, of two arrays, shape (d,), metres."""
    squared = 0.0
    for i in range(x.shape[0]):
        squared += (p_hat[i] - x[i]) ** 2
    return math.sqrt(squared)


@lean
def observe(coupling: Coupling, x: Array, p_hat: Array, was_open: bool) -> bool:
    """Take in the executed state and decide whether x may move. Paper eq. (12).

    Args:
        coupling: how.
        x: array, shape (d,), metres. Will be modified where nothing is coupled: it then becomes `p_hat`.
        p_hat: array, shape (d,), metres, the executed state as measured.
        was_open: the previous answer; True before the first step.

    Returns:
        delta(x, p_hat): within the tolerance, and until twice the tolerance is exceeded; exactly x == p_hat where the
        tolerance is 0; always True where nothing is coupled.
    """
    if coupling.gate > 0.0:
        return distance(x, p_hat) <= (2.0 * coupling.gate if was_open else coupling.gate)
    if coupling.kind == DEADBEAT:
        is_open = True
        for i in range(x.shape[0]):
            is_open &= x[i] == p_hat[i]
        return is_open
    for i in range(x.shape[0]):
        x[i] = p_hat[i]
    return True


@lean
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


@lean
def follow_printed_explicitly(x: Array, p_hat: Array, dt: float, p_max: float, k_c: float) -> None:
    """Move p_hat towards x by one explicit Euler step of eq. (9), which overshoots where C dt > 1. For comparison.

    Arguments as of `follow_printed`.
    """
    share = rate(distance(x, p_hat), p_max, k_c) * dt
    for i in range(x.shape[0]):
        p_hat[i] += share * (x[i] - p_hat[i])


@lean
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
