"""Fig. 3 of the paper: error by condition and controller, as bars with the uncertainty of the mean over a dataset.

Arrays in, SVG documents out; and the numbers behind it: means over motions, their confidence intervals, and by how much
a condition changes a controller's error, motion by motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stages.figures.intervals import FEW, bootstrap_interval, change_interval
from stages.figures.numbers import condition_name, number
from stages.figures.style import colour, controller_colours, drawing, panel_width, svg
from stages.trajectory import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Bar:
    """One bar: the values that it is the mean of (one a motion, or one a demonstration), as an array, shape (n,)."""

    controller: str
    condition: str
    values: Array


def bar_panel(bars: Sequence[Bar], title: str, axis: str, top: float, columns: int) -> str:
    """Bars grouped by condition; with `FEW` values or more a 95 % interval, else a dot for each value.

    Arguments:
        title: of the panel; axis: what the bars measure, with its unit.
        top: largest value of the axis, so that panels side by side can share one.
    """
    conditions = list(dict.fromkeys(bar.condition for bar in bars))
    controllers = list(dict.fromkeys(bar.controller for bar in bars))
    colours = controller_colours(controllers)
    width = 0.8 / max(2, len(controllers))
    with drawing(panel_width(columns), 3.4) as (figure, (axes,)):
        for bar in bars:
            place = conditions.index(bar.condition) + width * (
                controllers.index(bar.controller) - 0.5 * (len(controllers) - 1)
            )
            mean = float(bar.values.mean())
            axes.bar(place, mean, 0.92 * width, color=colour(colours[bar.controller]))
            if bar.values.shape[0] >= FEW:
                low, high = bootstrap_interval(bar.values, f"{axis}/{bar.controller}/{bar.condition}")
                axes.plot([place, place], [low, high], color=colour("surface"), lw=2.6, solid_capstyle="butt")
                axes.plot([place, place], [low, high], color=colour("ink"), lw=1.2, solid_capstyle="butt")
            else:
                across = place + 0.22 * width * np.linspace(-1, 1, bar.values.shape[0])
                axes.plot(across, bar.values, "o", ms=3.5, color=colour("surface"), mec=colour("ink"), mew=0.9)
            axes.annotate(
                number(mean, 2 if mean < 1 else 3), (place, 0), xytext=(0, 4), textcoords="offset points",
                ha="center", fontsize=7.5, color=colour("surface"),
            )  # fmt: skip
        if len(conditions) == 1:
            axes.set_xlim(-1.0, 1.0)  # one group of bars is no wider than of several
        axes.set_xticks(range(len(conditions)), [condition_name(name) for name in conditions])
        axes.tick_params(axis="x", length=0)
        axes.set(ylim=(0, top), title=title)
        axes.set_ylabel(axis)
        axes.grid(axis="y")
        return svg(figure)


def highest(bars: Sequence[Bar]) -> float:
    """Where the axis of `bar_panel` may end: above every mark."""
    tops = []
    for bar in bars:
        many = bar.values.shape[0] >= FEW
        tops.append(bootstrap_interval(bar.values, "")[1] if many else float(bar.values.max()))
    return 1.05 * max(tops)


@dataclass(frozen=True, kw_only=True)
class Change:
    """By how much a condition changes a controller's error against its own undisturbed value, as a ratio less one.

    Attributes:
        ratio: of the means, less one.
        low, high: 95 % interval over motions or demonstrations, resampled in pairs; none where they are few.
    """

    controller: str
    condition: str
    ratio: float
    low: float | None
    high: float | None


def changes(bars: Sequence[Bar], undisturbed: str) -> list[Change]:
    """Changes of all bars of other conditions; values of the same index belong together."""
    base: Mapping[str, Bar] = {bar.controller: bar for bar in bars if bar.condition == undisturbed}
    found = []
    for bar in bars:
        if bar.condition == undisturbed or bar.controller not in base:
            continue
        before, after = base[bar.controller].values, bar.values
        low = high = None
        if after.shape[0] >= FEW:
            low, high = change_interval(before, after, f"change/{bar.controller}/{bar.condition}")
        ratio = float(after.mean() / before.mean() - 1.0)
        found.append(Change(controller=bar.controller, condition=bar.condition, ratio=ratio, low=low, high=high))
    return found
