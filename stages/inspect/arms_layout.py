"""How the viewer shows two arms that carry a box: the arms, beside or below them what happened over time.

Not here: what is drawn (`arms.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stages.figures.numbers import condition_name
from stages.inspect.shown import Shown
from stages.world.camera import ABOVE, FRONT, MIDDLE

NAME = "two arms"

ABREAST = 3
"""Carried boxes that are shown side by side; more of them stand behind each other, by condition."""

PLOTS = {
    "force": "true forces [N]: left blue, right orange, F_d green, its band grey",
    "measured": "forces as measured, filtered [N]: left blue, right orange",
    "deviation": "deviation [mm]: left blue, right orange, midpoint from x grey, threshold red",
    "lyapunov": "V of x [mm\u00b2]",
    "clearance": "room [mm]: box to pot brown, arms to pot blue, middle to safety sphere pink",
}
"""Parts of the entities of plots, and what the viewer calls them."""


def layout(rrb: Any, shown: Sequence[Shown], entity: Any) -> Any:
    """How the viewer shows them: the arms, beside or below them what happened over time.

    Arguments:
        rrb: the module rerun.blueprint.
        entity: parts of a path -> entity path.
    """
    if len(shown) > ABREAST:
        groups: dict[str, list[Any]] = {}
        for one in shown:
            groups.setdefault(condition_name(one.rollout.condition), []).append(_alone(rrb, one, entity))
        return rrb.Tabs(*(rrb.Tabs(*some, name=name) for name, some in groups.items()), name=NAME)
    if len(shown) == 1:
        return _alone(rrb, shown[0], entity)
    columns = [
        rrb.Vertical(_picture(rrb, one, entity), _over_time(rrb, one, entity, alone=False), row_shares=[2, 3])
        for one in shown
    ]
    return rrb.Horizontal(*columns, name=NAME)


def _alone(rrb: Any, one: Shown, entity: Any) -> Any:
    """One carried box: the arms, and beside them what happened."""
    parts = (_picture(rrb, one, entity), _over_time(rrb, one, entity, alone=True))
    return rrb.Horizontal(*parts, column_shares=[5, 4], name=one.name)


def _picture(rrb: Any, one: Shown, entity: Any) -> Any:
    eye = rrb.EyeControls3D(position=ABOVE if among_pots(one) else FRONT, look_target=MIDDLE, eye_up=(0.0, 0.0, 1.0))
    return rrb.Spatial3DView(origin=f"{entity(one.root)}/scene", name="/".join(one.root), eye_controls=eye)


def among_pots(one: Shown) -> bool:
    """Whether something is in the way of the box."""
    return one.rollout.carry is not None and bool(one.rollout.carry.facts["pots"])


def _over_time(rrb: Any, one: Shown, entity: Any, *, alone: bool) -> Any:
    """Forces, deviations, V, room, and lanes; where others are shown beside it, in fewer pieces."""
    root = entity(one.root)

    def plot(part: str) -> Any:
        legend = rrb.PlotLegend(visible=False)  # it would lie over the curves; their colours are in the title
        return rrb.TimeSeriesView(origin=f"{root}/plot/{part}", name=PLOTS[part], plot_legend=legend)

    near = [plot("clearance")] if np.isfinite(one.rollout.clearance).any() else []
    lanes = rrb.StateTimelineView(origin=f"{root}/lane", name="phase, gate, pushes")
    force, deviation = plot("force"), plot("deviation")
    if alone:
        rest = rrb.Tabs(*near, plot("lyapunov"), plot("measured"))
        return rrb.Vertical(force, deviation, rest, lanes, row_shares=[3, 3, 2, 3])
    others = rrb.Tabs(*near, deviation, plot("lyapunov"))
    return rrb.Vertical(force, others, lanes, row_shares=[3, 3, 4])
