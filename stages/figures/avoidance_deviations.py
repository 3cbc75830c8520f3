"""Where avoidance departs from the paper's print, and why: rows for `deviations.py`. Parameters in, text out."""

from __future__ import annotations

from stages.figures.conditions import among_obstacles
from stages.figures.deviation import X_DOT, Deviation
from stages.figures.numbers import MINUS, given
from stages.rollout.parameters import RolloutParameters


def avoidance(rollout: RolloutParameters) -> list[Deviation]:
    """Rows that apply to the methods of a roll-out stage; none where there are no obstacles."""
    if not any(among_obstacles(condition) for condition in rollout.conditions):
        return []
    kinds = {method.kind for method in rollout.avoidances}
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
        for method in rollout.avoidances:
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
        if any(method.kind == "roas+" and method.detour for method in rollout.avoidances):
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
