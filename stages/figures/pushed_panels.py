"""Pictures of a box with one arm pushed: what happened over time, and where the way went. Paper Fig. 5d.

Arrays in, SVG documents out. Not here: which roll-outs are shown (`pushed_cases.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stages.figures.carry_panels import ARMS, VIEWS
from stages.figures.excursions import Excursion
from stages.figures.numbers import MM
from stages.figures.style import colour, drawing, limits, panel_width, svg
from stages.policy.parameters import FollowingParameters
from stages.trajectory import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDES = ("left", "right")

LEAST, MOST = 0.3, 1000.0
"""Millimetres between which the axis of deviations goes, by powers of ten: 0.3 mm is nothing."""

BELOW = 0.35
"""How far the axis of displacements goes below 0, as a fraction of what it holds above."""

LINES: tuple[tuple[float, Any], ...] = ((2.8, "-"), (1.2, "-"), (1.0, (0, (4, 3))))
"""Widths and dashes of left pad, right pad and box: where they go together, all are seen."""

ROWS = ("pushed", "named", "x waits")
"""What bars below the curves tell, from the top."""

MARGIN = 0.06
"""Room around the ways, as a fraction of their larger extent."""


@dataclass(frozen=True, kw_only=True)
class Scales:
    """Axes that all pictures share.

    Attributes:
        time: range, seconds from when the push began.
        reach: farthest displacement that is drawn, metres.
        band: of forces that hold the box and do not crush it, newtons.
        force: top of the axis of forces, newtons.
    """

    time: tuple[float, float]
    reach: float
    band: tuple[float, float]
    force: float


def series_panel(went: Excursion, given: FollowingParameters, scales: Scales, title: str, columns: int) -> str:
    """Displacements along the push, deviations, contact forces, and who was pushed, named, waited for, over time."""
    ratios = {"height_ratios": (3.0, 2.6, 2.6, 1.1)}
    with drawing(panel_width(columns), 6.6, 4, 1, sharex=True, gridspec_kw=ratios) as (figure, drawn):
        moved, away, forces, bars = drawn
        for axes in drawn:
            for begin, length in spans(went.acting, went.time):
                axes.axvspan(begin, begin + length, color=colour("muted"), alpha=0.15, lw=0)
        moved.axhline(0.0, color=colour("muted"), lw=0.7)
        for name, line, (width, dashes) in zip((*SIDES, "box"), went.along, LINES, strict=True):
            moved.plot(went.time, line * MM, color=colour(ARMS.get(name, "ink")), lw=width, ls=dashes)
        moved.set(title=title, ylim=(-BELOW * scales.reach * MM, scales.reach * MM))
        moved.set_ylabel("along push [mm]")
        _deviations(away, went, given)
        forces.axhspan(*scales.band, color=colour("series-3"), alpha=0.13, lw=0)
        for arm, line in zip(SIDES, went.force.T, strict=True):
            forces.plot(went.time, line, color=colour(ARMS[arm]), lw=0.9)
        forces.plot(went.time, went.desired, color=colour("ink"), lw=0.9, ls=(0, (5, 3)))
        forces.set(ylim=(0.0, scales.force))
        forces.set_ylabel("force [N]")
        _bars(bars, went)
        bars.set(xlim=scales.time)
        bars.set_xlabel("time since the push began [s]")
        figure.align_ylabels()
        return svg(figure)


def _deviations(axes: Axes, went: Excursion, given: FollowingParameters) -> None:
    """|x - p| and both residuals, with what eqs. (12) and (14) hold them against."""
    for arm, line in zip(SIDES, went.residual.T, strict=True):
        axes.plot(went.time, np.maximum(line * MM, LEAST), color=colour(ARMS[arm]), lw=0.9)
    axes.plot(went.time, np.maximum(went.away * MM, LEAST), color=colour("ink"), lw=1.4)
    axes.axhline(given.deviation_threshold * MM, color=colour("muted"), lw=1.0, ls=(0, (5, 3)))
    for gate in (given.gate, 2.0 * given.gate):
        axes.axhline(gate * MM, color=colour("muted"), lw=1.0, ls=(0, (1.5, 2)))
    axes.set(
        yscale="log", ylim=(LEAST, MOST), yticks=[1.0, 10.0, 100.0, 1000.0], yticklabels=["1", "10", "100", "1000"]
    )
    axes.set_ylabel("deviation [mm]")


def _bars(axes: Axes, went: Excursion) -> None:
    """When each arm was pushed, when it was taken for pushed, and when x waited."""
    top = len(ROWS) - 1
    for row, both in enumerate((went.pushed, went.named)):
        for side, arm in enumerate(SIDES):
            bars = spans(both[:, side], went.time)
            axes.broken_barh(bars, (top - row - 0.35, 0.7), color=colour(ARMS[arm]), lw=0)
    axes.broken_barh(spans(went.waits, went.time), (-0.35, 0.7), color=colour("ink"), lw=0)
    axes.set(ylim=(-0.6, top + 0.6), yticks=range(top + 1), yticklabels=ROWS[::-1])
    axes.tick_params(axis="y", length=0)


def spans(on: NDArray[np.bool_], time: Array) -> list[tuple[float, float]]:
    """When something was so: beginnings and lengths, seconds. `on`: shape (n,); `time`: array, shape (n,), seconds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    last = time.shape[0] - 1
    return [(float(time[a]), float(time[min(b, last)] - time[a])) for a, b in edges.reshape(-1, 2)]


def ways_frame(
    wents: Sequence[Excursion], demonstrations: Sequence[Array], scales: Scales
) -> tuple[tuple[float, float], ...]:
    """Ranges of x, y and z, metres, that hold demonstrations, shape (n, 3), and ways as far as a push drags them."""
    near = [went.midpoint[went.away <= scales.reach] for went in wents]
    points = np.concatenate([*demonstrations, *(went.x for went in wents), *near])
    (x0, x1), (y0, y1) = limits(points[:, :2], MARGIN)
    _, (z0, z1) = limits(points[:, 1:], MARGIN)
    return (x0, x1), (y0, y1), (z0, z1)


def ways_panel(
    went: Excursion,
    demonstrations: Sequence[Array],
    title: str,
    series: str,
    extent: tuple[tuple[float, float], ...],
    columns: int,
    lost: bool,
) -> str:
    """The way of x, of the pads' midpoint and of the box in two views; pushed parts in the colour of the arm.

    Arguments:
        demonstrations: arrays, shape (n, 3), metres, of the midpoint.
        series: name of the pads' colour in the palette.
        extent: from `ways_frame`, metres.
        lost: whether the roll-out ended short: the end of the pads' way is crossed.
    """
    shares = [np.ptp(extent[up]) / np.ptp(extent[right]) for right, up in VIEWS.values()]
    width = panel_width(columns)
    height = 1.3 + (width - 0.75) * sum(shares)
    with drawing(width, height, 2, 1, gridspec_kw={"height_ratios": shares[::-1]}) as (figure, drawn):
        for axes, (name, view) in zip(drawn, reversed(VIEWS.items()), strict=True):
            shown = list(view)
            for path in demonstrations:
                axes.plot(*(path[:, shown] * MM).T, color=colour("faint"), lw=0.6, zorder=1)
            axes.plot(*(went.x[:, shown] * MM).T, color=colour("ink"), lw=5.0, alpha=0.25, zorder=2)
            axes.plot(*(went.midpoint[:, shown] * MM).T, color=colour(series), lw=1.3, zorder=4)
            axes.plot(*(went.box[:, shown] * MM).T, color=colour("ink"), lw=1.0, ls=(0, (1.5, 2)), zorder=5)
            for side, arm in enumerate(SIDES):
                dragged = np.where(went.pushed[:, side, None], went.midpoint, np.nan)
                if went.pushed[:, side].any():
                    axes.plot(*(dragged[:, shown] * MM).T, color=colour(ARMS[arm]), lw=5.0, alpha=0.6, zorder=3)
            axes.plot(*(went.midpoint[0, shown] * MM), "o", ms=4, color=colour(series), zorder=6)
            if lost:
                end = went.midpoint[-1, shown] * MM
                axes.plot(*end, "X", ms=8, color=colour("ink"), mec=colour("surface"), mew=0.6, zorder=7)
            (x0, x1), (y0, y1) = (extent[axis] for axis in view)
            axes.set(xlim=(x1 * MM, x0 * MM), ylim=(y0 * MM, y1 * MM), aspect="equal", title=f"{title}, {name}")
            axes.set_ylabel(f"{'xyz'[view[1]]} [mm]")
        drawn[-1].set_xlabel("y [mm]")
        return svg(figure)
