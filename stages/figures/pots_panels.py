"""Pictures of a box that is carried round flowerpots: from the side and from above. Paper Fig. 6.

Arrays in, SVG documents out. Not here: which roll-outs are shown (`pots_cases.py`), and clearance over time
(`clearance.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from stages.figures.numbers import MM
from stages.figures.pots_cases import Round
from stages.figures.style import colour, drawing, limits, panel_width, svg
from stages.trajectory import Array
from stages.world.pots import POT_PROFILE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

VIEWS = {"seen from the right": (0, 2), "seen from above": (0, 1)}
"""Coordinates to the right and upwards: x points forward."""

MARGIN = 0.05
"""Room around what is drawn, as a fraction of its larger extent."""

STRAY = 0.15
"""Metres beyond boxes, spheres and demonstrations up to which ways are drawn: a way can be thrown far."""


def round_frame(cases: Sequence[Round], ways: Sequence[Array]) -> tuple[tuple[float, float], ...]:
    """Ranges of x, y and z, metres, that hold boxes, spheres and, as far as they stay near, ways, shape (n, 3)."""
    points, corners = [], []
    for one in cases:
        half = 0.5 * np.array(one.carry.facts["box"])
        points += [np.array(one.carry.facts[name]) + sign * half for name in ("start", "goal") for sign in (-1.0, 1.0)]
        corners += [one.carry.box[one.nearest] + sign * half for sign in (-1.0, 1.0)]
        for time in (0.0, one.moved):
            for centre, radius in zip(one.pots.at(time), one.pots.radii, strict=True):
                points += [centre - radius, centre + radius]
    known = np.array(points)
    low, high = known.min(axis=0) - STRAY, known.max(axis=0) + STRAY
    shown = (*ways, *(one.way for one in cases), np.array(corners))
    near = [way[((way >= low) & (way <= high)).all(axis=1)] for way in shown]
    every = np.concatenate([known, *near])
    (x0, x1), (y0, y1) = limits(every[:, :2], MARGIN)
    _, (z0, z1) = limits(every[:, 1:], MARGIN)
    return (x0, x1), (y0, y1), (z0, z1)


def round_panel(
    one: Round,
    free: Array | None,
    demonstrations: Sequence[Array],
    title: str,
    series: str,
    extent: tuple[tuple[float, float], ...],
    columns: int,
    lost: bool,
) -> str:
    """The box's way round the pots, from the side and from above; pots at the start, dashed, and when it is nearest.

    Arguments:
        free: the box's way with nothing avoided, array, shape (n, 3), metres; none: there is none.
        demonstrations: arrays, shape (n, 3), metres, of the midpoint.
        series: name of the way's colour in the palette.
        extent: from `round_frame`, metres.
        lost: whether the roll-out ended short: the end of the way is crossed.
    """
    shares = [np.ptp(extent[up]) / np.ptp(extent[right]) for right, up in VIEWS.values()]
    width = panel_width(columns)
    height = 1.3 + (width - 0.75) * sum(shares)
    with drawing(width, height, 2, 1, gridspec_kw={"height_ratios": shares}) as (figure, drawn):
        for axes, (name, view) in zip(drawn, VIEWS.items(), strict=True):
            shown = list(view)
            for path in demonstrations:
                axes.plot(*(path[:, shown] * MM).T, color=colour("faint"), lw=0.6, zorder=1)
            _pots(axes, one, view)
            for centre, line, dashes in (
                (np.array(one.carry.facts["start"]), "muted", (0, (5, 3))),
                (np.array(one.carry.facts["goal"]), "muted", "-"),
                (one.carry.box[one.nearest], series, (0, (1.5, 2))),
            ):
                _box(axes, one, centre, view, line, dashes)
            if free is not None:
                axes.plot(*(free[:, shown] * MM).T, color=colour("ink"), lw=1.1, ls=(0, (5, 3)), zorder=4)
            way = one.way[:, shown] * MM
            axes.plot(*way.T, color=colour(series), lw=1.8, zorder=5)
            axes.plot(*way[0], "o", ms=4, color=colour(series), zorder=6)
            nearest = one.carry.box[one.nearest, shown] * MM
            axes.plot(*nearest, "D", ms=5, color=colour(series), mec=colour("surface"), mew=0.6, zorder=7)
            if lost:
                axes.plot(*way[-1], "X", ms=8, color=colour("ink"), mec=colour("surface"), mew=0.6, zorder=8)
            goal = np.array(one.carry.facts["goal"])[shown] * MM
            axes.plot(*goal, "*", ms=11, color=colour("ink"), mec=colour("surface"), zorder=7)
            (x0, x1), (y0, y1) = (extent[axis] for axis in view)
            axes.set(xlim=(x0 * MM, x1 * MM), ylim=(y0 * MM, y1 * MM), aspect="equal")
            axes.set_ylabel(f"{'xyz'[view[1]]} [mm]")
            axes.set_title(title if axes is drawn[0] else name, fontweight="bold" if axes is drawn[0] else "normal")
        drawn[-1].set_xlabel("x [mm]")
        return svg(figure)


def _pots(axes: Axes, one: Round, view: tuple[int, int]) -> None:
    """Safety spheres, what the policy sees of them, and pots."""
    from matplotlib.patches import Circle, FancyBboxPatch, Polygon

    moments: list[tuple[float, Any]] = [(one.moved, "-")]
    if one.pots.moving:
        moments.insert(0, (0.0, (0, (2, 2))))
    line: dict[str, Any] = {"fc": "none", "ec": colour("series-5"), "lw": 1.2}
    for time, dashes in moments:
        for k, centre in enumerate(one.pots.at(time) * MM):
            x, y = (float(centre[axis]) for axis in view)
            radius, along = float(one.pots.radii[k]) * MM, float(one.pots.along[k]) * MM
            axes.add_patch(Circle((x, y), radius, ls=dashes, zorder=3, **line))
            if dashes == "-":
                axes.add_patch(Circle((x, y), radius, fc=colour("series-5"), ec="none", alpha=0.10, zorder=1))
                if along > 0.0 and view[1] == 1:  # a rod with round ends; from the side it is the circle
                    drawn_out = FancyBboxPatch(
                        (x, y - along), 0.0, 2.0 * along, boxstyle=f"round,pad={radius},rounding_size={radius}",
                        mutation_aspect=1.0, ls=(0, (1.5, 2)), zorder=3, **line,
                    )  # fmt: skip
                    axes.add_patch(drawn_out)
            width, tall = float(one.pots.widths[k]) * MM, float(one.pots.heights[k]) * MM
            if view[1] == 1:
                axes.add_patch(Circle((x, y), 0.5 * width, fc="none", ec=colour("ink"), lw=1.0, ls=dashes, zorder=3))
            else:
                outline = profile(width, tall) + np.array([x, y])
                axes.add_patch(Polygon(outline, fc="none", ec=colour("ink"), lw=1.0, ls=dashes, zorder=3))


def profile(width: float, height: float) -> Array:
    """Outline of a pot with its plant about its middle, array, shape (n, 2), in the unit of both."""
    right = np.array([(0.5 * width * radius, (up - 0.5) * height) for up, radius in POT_PROFILE])
    return np.concatenate([right, right[::-1] * [-1.0, 1.0]])


def _box(axes: Axes, one: Round, centre: Array, view: tuple[int, int], series: str, dashes: Any) -> None:
    """The box as if it stood upright; `centre`: array, shape (3,), metres."""
    from matplotlib.patches import Rectangle

    shown = list(view)
    edges = np.array(one.carry.facts["box"])[shown] * MM
    corner = centre[shown] * MM - 0.5 * edges
    axes.add_patch(Rectangle(tuple(corner), *edges, fc="none", ec=colour(series), lw=0.9, ls=dashes, zorder=2))
