"""How the viewer shows roll-outs of a point: a tab a condition, a picture a case, and below what happened over time.

Not here: what is drawn (`plane.py`, `obstacles.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stages.figures.numbers import condition_name, controller_name, method_title
from stages.inspect.plane import bounds, extent_of, gated
from stages.inspect.shown import Shown, case_of, undisturbed_first
from stages.inspect.stream import PLANAR

BESIDE = np.array([1.5, -1.0, 0.8])
"""From the middle of the demonstrations to where the viewer looks from in space, in their larger extent."""

FEW = 4
"""Cases up to which each plot has a legend; of more, one plot."""


def layout(rrb: Any, shown: Sequence[Shown], entity: Any) -> Any:
    """How the viewer shows them: a tab a condition; in it a picture a controller and method, below what happened.

    Arguments:
        rrb: the module rerun.blueprint.
        entity: parts of a path -> entity path.
    """
    tabs = []
    for condition in undisturbed_first(list(dict.fromkeys(one.rollout.condition for one in shown))):
        of = [one for one in shown if one.rollout.condition == condition]
        cases: dict[tuple[Any, ...], list[Shown]] = {}
        for one in of:
            cases.setdefault((one.model, case_of(one.rollout)), []).append(one)
        several = len({one.model for one in of}) > 1
        views = [_view(rrb, some, entity, several=several) for some in cases.values()]
        pictures = views[0] if len(views) == 1 else rrb.Grid(*views, grid_columns=columns_of(len(views)))
        # Over time one start of each case: more lines than that nobody tells apart.
        told = [some[0] for some in cases.values()]
        name = condition_name(condition)
        tabs.append(rrb.Vertical(pictures, _plots(rrb, told, entity), name=name, row_shares=[3, 2]))
    return tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs, name="roll-outs")


def columns_of(views: int) -> int:
    """In how many columns pictures stand, so that as few places as can be stay empty."""
    return views if views <= 3 else 2 if views == 4 else 3 if views <= 6 else 4


def _view(rrb: Any, some: Sequence[Shown], entity: Any, *, several: bool) -> Any:
    """The picture of a case: its roll-outs over the model."""
    first = some[0]
    method = "" if first.rollout.avoidance == "none" else f", {method_title(first.rollout.avoidance)}"
    of = f" \u00b7 {'/'.join(first.model[:-1])}" if several else ""
    name = f"{controller_name(first.rollout.label)}{method}{of}"
    contents = [f"+ {entity(first.model)}/**"]
    contents += [f"+ {entity(one.scene)}/**" for one in some if one.scene]
    for one in some:
        contents += [f"+ {entity(one.root)}/**", f"- {entity(one.root)}/plot/**", f"- {entity(one.root)}/lane/**"]
    if first.rollout.x.shape[1] != PLANAR:
        known = np.concatenate([t.position for t in first.point.midpoints.trajectories])
        middle, size = 0.5 * (known.min(axis=0) + known.max(axis=0)), extent_of(first.point)
        eye = rrb.EyeControls3D(position=middle + size * BESIDE, look_target=middle, eye_up=(0.0, 0.0, 1.0))
        return rrb.Spatial3DView(origin="/", contents=contents, name=name, eye_controls=eye)
    (x0, x1), (y0, y1) = bounds([first.point], [one.rollout.executed for one in some])
    seen = rrb.VisualBounds2D(x_range=[x0, x1], y_range=[-y1, -y0])
    return rrb.Spatial2DView(origin="/", contents=contents, name=name, visual_bounds=seen)


def _plots(rrb: Any, told: Sequence[Shown], entity: Any) -> Any:
    """Over time: distance from x, V, clearance; and below, lanes of words."""
    plots = []
    start = f"start {told[0].rollout.demo}"
    for part, name in (
        ("gap", f"executed from x [mm], {start}"),
        ("lyapunov", f"V of x [mm\u00b2], {start}"),
        ("clearance", f"clearance [mm], {start}"),
    ):
        some = [one for one in told if _has(one, part)]
        if some:
            contents = [f"+ {entity(one.root)}/plot/{part}/**" for one in some]
            seen = len(told) <= FEW or part == "lyapunov"
            legend = rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=seen)
            plots.append(rrb.TimeSeriesView(origin="/", contents=contents, name=name, plot_legend=legend))
    if any(gated(one) or one.rollout.disturbed or one.rollout.scene for one in told):
        lanes = [f"+ {entity(one.root)}/lane/**" for one in told]
        plots.append(rrb.StateTimelineView(origin="/", contents=lanes, name="gate, pushes, avoidance"))
    return rrb.Horizontal(*plots)


def _has(one: Shown, part: str) -> bool:
    if part == "gap":
        return gated(one)
    return part != "clearance" or bool(np.isfinite(one.rollout.clearance).any())
