"""How two arms press on what is between them: variable-stiffness admittance. Paper eqs. (15)-(18).

y is how far an arm stands OUTSIDE of its place beside the midpoint, metres, positive away from the box; F the pressing
force, e_f = F - F_d. With the stiffness of (16), whose sign is the other one, (15) is

    M yddot = (k_p + 1) e_f + k_d e_f' + F_d - D ydot        (17), printed with M ydot below the line

and is stepped as ydot+ = ydot + yddot dt, y+ = y + ydot+ dt. As (16) divides by e_y it is never evaluated. The F_d at
the end leaves a bias: the force settles at F_d k_p/(k_p + 1), 4.81 N for 5. (18) taken literally leaves y without a
reference; so y is an offset on the place of eq. (13). ``robust``: no bias, the damping taken at the end of the step,
and the part of y that both arms share leaks away: no force sees it, and a sensor's bias would drive it for ever.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pipeline.errors import ParameterError
from stages.compiled import compiled
from stages.policy.parameters import AdmittanceParameters
from stages.trajectory import Array

OFFSET, RATE, FORCE, ERROR = range(4)
"""Columns of an admittance's state: y, m; ydot, m/s; the filtered force, N; e_f of the step before, N."""


class Admittance(NamedTuple):
    """Parameters, as compiled code takes them.

    Attributes:
        mass: M, kg, virtual.
        damping: D, N s/m, virtual.
        k_p: eq. (16).
        k_d: eq. (16), s.
        force: F_d, N.
        printed: whether (17) is taken as printed.
        leak: 1/s, of the offset that both arms share; 0 as printed.
        cutoff: Hz, of the low-pass on the force.
    """

    mass: float
    damping: float
    k_p: float
    k_d: float
    force: float
    printed: bool
    leak: float
    cutoff: float


def admittance_of(given: AdmittanceParameters, *, printed: bool) -> Admittance:
    """Parameters as compiled code takes them; `printed`: eq. (17) as printed."""
    return Admittance(
        mass=given.mass,
        damping=given.damping,
        k_p=given.k_p,
        k_d=given.k_d,
        force=given.force,
        printed=printed,
        leak=0.0 if printed else given.leak,
        cutoff=given.cutoff,
    )


@compiled
def sense(admittance: Admittance, measured: Array, dt: float, state: Array) -> None:
    """Take in the pressing forces of the left and the right arm, N, shape (2,). `state`: shape (2, 4), modified."""
    share = 1.0 - math.exp(-2.0 * math.pi * admittance.cutoff * dt)
    for arm in range(2):
        state[arm, FORCE] += share * (measured[arm] - state[arm, FORCE])


@compiled
def comply(admittance: Admittance, dt: float, state: Array) -> None:
    """Move both offsets by one step of dt seconds. Paper eqs. (15)-(17). `state`: shape (2, 4). Will be modified."""
    for arm in range(2):
        error = state[arm, FORCE] - admittance.force
        push = (admittance.k_p + 1.0) * error + admittance.k_d * (error - state[arm, ERROR]) / dt
        if admittance.printed:
            push += admittance.force
            state[arm, RATE] += dt * (push - admittance.damping * state[arm, RATE]) / admittance.mass
        else:
            rate = state[arm, RATE] + dt * push / admittance.mass
            state[arm, RATE] = rate / (1.0 + dt * admittance.damping / admittance.mass)
        state[arm, OFFSET] += dt * state[arm, RATE]
        state[arm, ERROR] = error
    leak(admittance, dt, state)


@compiled
def leak(admittance: Admittance, dt: float, state: Array) -> None:
    """Let what both offsets share leak away for dt seconds: no force sees it. `state`: shape (2, 4), modified."""
    # Outwards is +y of the left arm and -y of the right one.
    shared = 0.5 * (state[0, OFFSET] - state[1, OFFSET])
    shift = shared * (math.exp(-admittance.leak * dt) - 1.0)
    state[0, OFFSET] += shift
    state[1, OFFSET] -= shift


@compiled
def begin(admittance: Admittance, state: Array) -> None:
    """Begin to comply from where the arms are, without a kick. `state`: shape (2, 4). Will be modified."""
    for arm in range(2):
        state[arm, ERROR] = state[arm, FORCE] - admittance.force


def check_stability(given: AdmittanceParameters, dt: float, stiffness: float, *, printed: bool, location: str) -> None:
    """Refuse gains that oscillate on a contact of this stiffness, N/m, at this cycle, seconds.

    2 dt (D + k_d k) + dt^2 (k_p + 1) k < 4 M: the discrete loop of eq. (17) without lag. D counts where it is taken as
    printed only. Raises ParameterError; `location` is the dotted place of the parameters.
    """
    damping = given.damping if printed else 0.0
    needed = 0.25 * (2.0 * dt * (damping + given.k_d * stiffness) + dt**2 * (given.k_p + 1.0) * stiffness)
    if needed >= given.mass:
        raise ParameterError(
            f"{location}.mass",
            f"{given.mass:g} kg let the arms oscillate on a contact of {stiffness:g} N/m at dt = {dt:g} s: more than "
            f"{needed:.3g} kg are needed, or a smaller k_d, damping or dt.",
        )


def settled_force(force: float, k_p: float) -> float:
    """Where the printed law settles, N: F_d k_p/(k_p + 1)."""
    return force * k_p / (k_p + 1.0)
