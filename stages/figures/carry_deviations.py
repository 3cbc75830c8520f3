"""Where the carrying of a box departs from the paper's print, and why: rows for `deviations.py`. Parameters in.

Not here: pushes on the arms (`following_deviations.py`), pots in the way (`avoidance_deviations.py`).
"""

from __future__ import annotations

from stages.figures.deviation import Deviation
from stages.figures.numbers import MINUS, MM, given, number
from stages.policy.admittance import settled_force
from stages.rollout.parameters import CarryParameters

Y_DOT, Y_DDOT, E_DOT = "y\u0307", "y\u0308", "e\u0307"


def carrying(rollout: CarryParameters) -> list[Deviation]:
    """Rows on eqs. (15)-(18) that apply."""
    rows = []
    if any(condition.compliance for condition in rollout.conditions):
        rows += _admittance(rollout)
    if not all(condition.compliance for condition in rollout.conditions):
        rows.append(
            Deviation(
                where="Fig. 5c, without compliance",
                printed="How far the pads go in is not printed",
                here=f"Each goes {given(rollout.squeeze * MM)} mm beyond the face of the box, whose length L the "
                "controller knows with the error that the tables give.",
                why="Pads at the faces touch without a force: without compliance, the force is what the error of L "
                "makes it.",
            )
        )
    return rows


def _admittance(rollout: CarryParameters) -> list[Deviation]:
    given_, printed = rollout.admittance, rollout.mode == "paper"
    push = f"(k_{{p}} + 1) e_{{f}} + k_{{d}} {E_DOT}_{{f}}"
    implicit = "" if printed else f", with {Y_DOT}^{{+}} in the damping"
    rows = [
        Deviation(
            where="(15), (16)",
            printed="K_{v} has e_{y} below the line, and the other sign",
            here=f"K_{{v}} e_{{y}} is put into (15) as a whole, and K_{{v}} is never evaluated: M {Y_DDOT} = {push} "
            f"{'+ F_{d} ' if printed else ''}{MINUS} D {Y_DOT}, y outwards, e_{{f}} = F {MINUS} F_{{d}}. The right arm "
            "mirrors the left one.",
            why="e_{y} is 0 where the pad is in its place; with the printed sign a pad that presses too hard would go "
            "on inwards.",
        ),
        Deviation(
            where="(17)",
            printed=f"M {Y_DOT} below the line; the steps of {Y_DOT} and y are incomplete",
            here=f"M below the line, {Y_DOT}^{{+}} = {Y_DOT} + {Y_DDOT} dt, y^{{+}} = y + {Y_DOT}^{{+}} dt{implicit}.",
            why=f"As printed the units do not fit, and the fraction has no value at rest, where {Y_DOT} = 0."
            + ("" if printed else " Damping, taken at the end of the step, cannot overshoot."),
        ),
        _bias(rollout),
        Deviation(
            where="(18)",
            printed="y is the pad's place along the clamp axis",
            here=f"y is an offset on its place by (13), and the way's velocity is fed forward. {_leak(rollout)}",
            why="(15) to (17) know forces alone: y would drift from where the way puts the pads, and a box that moves "
            f"along the clamp axis would cost D v/(k_{{p}} + 1) of force.{_why_leak(rollout)}",
        ),
        Deviation(
            where="(15)-(17), values",
            printed="M, D and how the force is filtered are not printed",
            here=f"M = {given(given_.mass)} kg, D = {given(given_.damping)} N s/m, both virtual; a low-pass of "
            f"{given(given_.cutoff)} Hz on the measured force; steps of {given(rollout.dt)} s. Pads approach at "
            f"{given(rollout.approach_speed * MM)} mm/s until they touch; half of the box's weight is fed forward to "
            "each arm, as its wrist feels it.",
            why="The arms lag behind their commands: lighter virtual masses than they can follow make the force "
            "oscillate.",
        ),
    ]
    return rows


def _bias(rollout: CarryParameters) -> Deviation:
    force, k_p = rollout.admittance.force, rollout.admittance.k_p
    settles = (
        f"At rest (k_{{p}} + 1)(F {MINUS} F_{{d}}) + F_{{d}} = 0: the force settles at F_{{d}} k_{{p}}/(k_{{p}} + 1) = "
        f"{number(settled_force(force, k_p))} N, not at {given(force)} N."
    )
    if rollout.mode == "paper":
        return Deviation(
            where="(17), + F_{d}", printed="F_{d} is added to the fraction", here="As printed.", why=settles
        )
    return Deviation(
        where="(17), + F_{d}",
        printed="F_{d} is added to the fraction",
        here="Not added.",
        why=f"{settles} Without it, at F_{{d}}.",
    )


def _leak(rollout: CarryParameters) -> str:
    leak = rollout.admittance.leak
    if rollout.mode == "paper" or leak == 0.0:
        return ""
    return f"What both arms' offsets have in common leaks away at {given(leak)} 1/s."


def _why_leak(rollout: CarryParameters) -> str:
    if not _leak(rollout):
        return ""
    return " No force sees the common offset: the bias of a sensor would drive it, and the box, on and on."
