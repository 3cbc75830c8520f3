"""How near each method of avoidance comes to an obstacle, over time. Arrays in, SVG documents out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.report import Key
from stages.figures.numbers import MM, method_title
from stages.figures.style import colour, drawing, panel_width, svg
from stages.trajectory import Array

COLOURS = {"roas+": "series-2", "roas": "series-3", "apf": "series-4", "cbf": "series-1", "modulation": "series-5"}
"""By kind of method."""

HIGH = 1.15
"""Top of the axis, as a multiple of the distance from which every path starts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """One roll-out.

    Attributes:
        method: its name; kind: of the method.
        time: array, shape (n,), seconds.
        clearance: array, shape (n,), metres.
        stopped: whether it ended short of the goal.
    """

    method: str
    kind: str
    time: Array
    clearance: Array
    stopped: bool


def method_colour(kind: str) -> str:
    """Name of a method's colour in the palette."""
    return COLOURS.get(kind, "muted")


def method_keys(kinds: Mapping[str, str]) -> tuple[Key, ...]:
    """Legend entries: method -> kind. The second of a kind is dashed, further ones dotted."""
    marks = styles(kinds)
    return tuple(
        Key(label=method_title(name), colour=method_colour(kind), mark=("line", "dashed", "dotted")[marks[name]])
        for name, kind in kinds.items()
    )


def styles(kinds: Mapping[str, str]) -> dict[str, int]:
    """0, 1 or 2 for each method: how many of its kind come before it, at most 2."""
    seen: dict[str, int] = {}
    found = {}
    for name, kind in kinds.items():
        found[name] = min(seen.get(kind, 0), 2)
        seen[kind] = seen.get(kind, 0) + 1
    return found


def clearance_panel(
    lines: Sequence[Line],
    title: str,
    columns: int,
    *,
    marks: Mapping[str, int] | None = None,
    extent: tuple[float, tuple[float, float]] | None = None,
) -> str:
    """Distance of the executed state from the nearest obstacle over time, mm; a cross where a path ends short.

    `marks`: as of `styles`, where panels share a legend. `extent`: the last second, and the range in mm, where they
    share axes.
    """
    marks = styles({line.method: line.kind for line in lines}) if marks is None else marks
    low, top = _limits(lines) if extent is None else extent[1]
    with drawing(panel_width(columns), 3.0) as (figure, (axes,)):
        axes.axhspan(low, 0.0, color=colour("muted"), alpha=0.35, lw=0)
        axes.grid(axis="y")
        for line in lines:
            dashes = ("-", (0, (5, 3)), (0, (1.5, 2)))[marks[line.method]]
            drawn = colour(method_colour(line.kind))
            axes.plot(line.time, line.clearance * MM, color=drawn, ls=dashes, lw=1.5)
            if line.stopped:
                axes.plot(
                    line.time[-1], line.clearance[-1] * MM, "X", ms=7, color=drawn, mec=colour("surface"), mew=0.6
                )
        longest = _longest(lines) if extent is None else extent[0]
        axes.set(xlim=(0.0, max(longest, 1e-9)), ylim=(low, top), title=title)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("clearance [mm]")
        return svg(figure)


def whole_extent(lines: Sequence[Line]) -> tuple[float, tuple[float, float]]:
    """The last second of the longest path, and the range that holds all that arrive, mm; all, where none does."""
    kept = [line for line in lines if not line.stopped] or list(lines)
    low, top = (float(bound([bound(line.clearance) for line in kept])) * MM for bound in (np.nanmin, np.nanmax))
    top = max(HIGH * top, 1.0)
    return _longest(lines), (min(-0.12 * top, HIGH * low), top)


def _longest(lines: Sequence[Line]) -> float:
    """The last second of the longest path that arrives; of the longest, where none does."""
    return max(float(line.time[-1]) for line in [line for line in lines if not line.stopped] or lines)


def _limits(lines: Sequence[Line]) -> tuple[float, float]:
    """Range of the axis, mm: from a little inside of an obstacle, or as deep as a path begins, to where paths begin."""
    first = [float(line.clearance[0]) * MM for line in lines]
    top = HIGH * max(first)
    if not top > 0.0:  # all begin inside
        top = max(HIGH * max(float(line.clearance.max()) * MM for line in lines), 1.0)
    return min(-0.12 * top, HIGH * min(first)), top
