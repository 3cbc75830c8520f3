"""Where avoidance departs from the paper's print, and why: rows for `deviations.py`. Parameters in, text out."""

from __future__ import annotations

from collections.abc import Sequence

from stages.figures.conditions import among_obstacles
from stages.figures.deviation import X_DOT, Deviation
from stages.figures.numbers import MINUS, MM, given, span
from stages.policy.avoidance.parameters import Avoidance
from stages.rollout.carry_conditions import avoidance_of
from stages.rollout.parameters import CarryParameters, RolloutParameters

PAPER_RADIUS = 0.23
"""Metres. Paper section III-B."""


def avoidance(rollout: RolloutParameters) -> list[Deviation]:
    """Rows that apply to the methods of a roll-out stage; none where there are no obstacles."""
    return _methods(rollout.avoidances) if any(among_obstacles(condition) for condition in rollout.conditions) else []


def pots(rollout: CarryParameters) -> list[Deviation]:
    """Rows that apply to what is in the way of a carried box; none where nothing is."""
    among = [condition for condition in rollout.conditions if condition.obstacles]
    if not among:
        return []
    asked = [pot for condition in among for pot in condition.obstacles]
    radius = span(
        [bound for pot in asked for bound in (pot.radius - pot.radius_spread, pot.radius + pot.radius_spread)]
    )
    along = [pot.along * MM for pot in asked if pot.along > 0.0]
    rows = [
        *_methods([avoidance_of(rollout, condition) for condition in among]),
        Deviation(
            where="Fig. 6, r",
            printed=f"r = {given(PAPER_RADIUS)} m, for the volume of pot and box",
            here=f"r = {radius} m, for a box of {' x '.join(given(edge * MM) for edge in rollout.scene.box)} mm and a "
            f"pot of {span([pot.width * MM for pot in asked])} x {span([pot.height * MM for pot in asked])} mm.",
            why="The box is another one. The distance of the box from the pot, beside that of its middle from the "
            "sphere, is measured in every roll-out.",
        ),
    ]
    if along:
        rows.append(
            Deviation(
                where="(19)-(23), hands",
                printed="A sphere, for the middle of the box",
                here=f"The policy sees it drawn out by {span(along)} mm along the clamp axis to either side, as a rod "
                "with round ends; clearance is told from the sphere. Links of the arms lean away from the pot where "
                "the pads leave them free to.",
                why="Beside the box are hands: a way past the side of a sphere would lead one of them through the pot.",
            )
        )
    spread = [pot.spread * MM for pot in asked if pot.spread > 0.0]
    if spread:
        rows.append(
            Deviation(
                where="Fig. 6, scenes",
                printed="One pot",
                here="One for each box, drawn within "
                f"{span(spread)} mm of each coordinate, again until start and goal are "
                "outside, and arms can follow the way of ROAS+ round it. Draws that were refused are counted.",
                why="What no arm can reach says nothing of a method of avoidance. The same scenes under all methods.",
            )
        )
    return rows


def _methods(methods: Sequence[Avoidance]) -> list[Deviation]:
    """Rows that apply to methods of avoidance."""
    kinds = {method.kind for method in methods}
    rows = []
    if "roas" in kinds:
        rows.append(
            Deviation(
                where="(20)-(22)",
                printed=f"d\u0307 holds {X_DOT}, which (22) makes of d\u0307",
                here=f"d\u0307 = {X_DOT}_{{o}} {MINUS} f(x); the forces of several obstacles are added.",
                why="The implicit form has no root, one or two. What is printed is for one obstacle.",
            )
        )
        for method in methods:
            if method.kind == "roas" and method.unit != 1.0:
                rows.append(
                    Deviation(
                        where="(19)-(21)",
                        printed="No unit of length",
                        here=f"`{method.name or method.kind}`: evaluated in units of {given(method.unit)} m.",
                        why="The force is quadratic in speed: its strength depends on the unit. Shown, not mended.",
                    )
                )
    if "roas+" in kinds:
        rows.append(
            Deviation(
                where="(19)-(23)",
                printed="A force orthogonal to the way to the goal, whatever it does to the clearance",
                here="ROAS+: the velocity nearest to a wanted one that keeps clear of obstacles and does not raise V.",
                why="As printed the force is nothing head-on, pulls in where it should push, and enters obstacles.",
            )
        )
        if any(method.kind == "roas+" and method.detour for method in methods):
            rows.append(
                Deviation(
                    where="(25)",
                    printed="V falls always",
                    here="V rises on detours around traps, which end lower than they began, and where moving obstacles "
                    "are given way to; both are counted.",
                    why="With a learned V an obstacle may have a place from which every way along it raises V. With "
                    f"V = |x {MINUS} x_{{g}}|^{{2}} and spheres that stand there is none.",
                )
            )
    return rows
