"""Pictures of two arms that carry a box: their way, contact forces over time, a demonstration. Paper Figs. 5b, 5c, 5e.

Arrays in, SVG documents out. Not here: which roll-outs are shown (`carry_section.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stages.figures.numbers import MM
from stages.figures.style import colour, drawing, limits, panel_width, svg
from stages.trajectory import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

VIEWS = {"seen from above": (1, 0), "seen from behind": (1, 2)}
"""Coordinates to the right and upwards; y, which points to the left, is turned round."""

MARGIN = 0.05
"""Room around what is drawn, as a fraction of its larger extent."""

MOST_LINES = 10
"""Roll-outs that are drawn as lines; of more the median, and between which forces nine in ten are."""

HIGHEST = 3.0
"""Top of the axis of forces, as a multiple of the desired one: higher peaks are cut off."""

CLOCK = 400
"""Samples of the clock on which many roll-outs are brought together."""

ARMS = {"left": "series-4", "right": "series-5", "midpoint": "ink"}
"""Name in the palette of each line of a demonstration."""

LINES = {"left": (1.5, "-"), "right": (1.5, "-"), "midpoint": (1.5, (0, (5, 3)))}

LEAST_SPREAD = 10.0
"""Millimetres that the axis of separations spans at least: noise of a tenth of one is not to fill it."""

SMOOTH = 0.1
"""Seconds over which a speed is averaged."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """What panels of ways are drawn over, metres.

    Attributes:
        demonstrations: arrays, shape (n, 3): of the midpoint.
        box: edges of the box, array, shape (3,).
        start, goal: centres of the box, arrays, shape (3,).
    """

    demonstrations: Sequence[Array]
    box: Array
    start: Array
    goal: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Pressed:
    """Contact force of one arm in one roll-out.

    Attributes:
        time: array, shape (n,), seconds from when the box was lifted.
        force: array, shape (n,), newtons.
    """

    time: Array
    force: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Led:
    """Both arms in one demonstration, on one clock.

    Attributes:
        time: array, shape (n,), seconds from the start.
        arms: array, shape (2, n, 3), metres: left and right.
        force: array, shape (2, n), newtons; none: not recorded.
        clamp_axis: coordinate along which the arms clamp.
    """

    time: Array
    arms: Array
    force: Array | None
    clamp_axis: int

    @property
    def midpoint(self) -> Array:
        """Array, shape (n, 3), metres."""
        return np.asarray(self.arms.mean(axis=0))

    @property
    def separation(self) -> Array:
        """Distance of the arms along the clamp axis, array, shape (n,), metres. Paper eq. (13): L."""
        return np.asarray(np.abs(self.arms[0] - self.arms[1])[:, self.clamp_axis])

    @property
    def speed(self) -> Array:
        """Speed of the midpoint, averaged over `SMOOTH`, array, shape (n,), m/s."""
        velocity = np.gradient(self.midpoint, self.time, axis=0)
        width = max(1, min(round(SMOOTH / float(np.median(np.diff(self.time)))), self.time.shape[0]))
        kernel = np.ones(width)
        counts = np.convolve(np.ones(self.time.shape[0]), kernel, mode="same")
        means = [np.convolve(velocity[:, axis], kernel, mode="same") / counts for axis in range(3)]
        return np.asarray(np.linalg.norm(means, axis=0))


def way_frame(way: Way, paths: Sequence[Array], view: tuple[int, int]) -> tuple[tuple[float, float], ...]:
    """Ranges of a view's two coordinates, metres: they hold boxes, demonstrations and paths, shape (n, 3)."""
    shown = list(view)
    corners = [at + sign * 0.5 * way.box for at in (way.start, way.goal) for sign in (-1.0, 1.0)]
    points = np.concatenate([*way.demonstrations, *paths, np.array(corners)])[:, shown]
    return limits(points, MARGIN)


def way_panel(
    way: Way,
    paths: Sequence[Array],
    lost: Sequence[bool],
    title: str,
    series: str,
    extent: tuple[tuple[float, float], ...],
    view: tuple[int, int],
    columns: int,
) -> str:
    """Ways of the midpoint, demonstrations, and the box where it stands and where it goes.

    Arguments:
        paths: arrays, shape (n, 3), metres.
        lost: whether each ended short: its end is crossed.
        series: name of the paths' colour in the palette.
        extent: from `way_frame`, metres.
        view: one of `VIEWS`.
        columns: panels beside each other.
    """
    from matplotlib.patches import Rectangle

    (x0, x1), (y0, y1) = extent
    shown, width = list(view), panel_width(columns)
    with drawing(width, 0.75 + (width - 0.65) * min(1.25, (y1 - y0) / (x1 - x0))) as (figure, (axes,)):
        edges = way.box[shown] * MM
        for at, dashes in ((way.start, (0, (5, 3))), (way.goal, "-")):
            corner = at[shown] * MM - 0.5 * edges
            axes.add_patch(Rectangle(tuple(corner), *edges, fc=colour("muted"), ec="none", alpha=0.10, zorder=1))
            axes.add_patch(Rectangle(tuple(corner), *edges, fc="none", ec=colour("muted"), lw=1.0, ls=dashes, zorder=2))
        for demonstration in way.demonstrations:
            axes.plot(*(demonstration[:, shown].T * MM), color=colour("ink"), lw=0.8, alpha=0.8, zorder=3)
        for path, short in zip(paths, lost, strict=True):
            drawn = path[:, shown] * MM
            axes.plot(*drawn.T, color=colour(series), lw=1.3, zorder=4)
            axes.plot(*drawn[0], "o", ms=4, color=colour(series), zorder=5)
            if short:
                axes.plot(*drawn[-1], "X", ms=9, color=colour("ink"), mec=colour("surface"), mew=0.6, zorder=7)
        axes.plot(*(way.goal[shown] * MM), "*", ms=13, color=colour("ink"), mec=colour("surface"), zorder=6)
        axes.set(xlim=(x1 * MM, x0 * MM), ylim=(y0 * MM, y1 * MM), aspect="equal", title=title)
        axes.set_xlabel(f"{'xyz'[view[0]]} [mm]")
        axes.set_ylabel(f"{'xyz'[view[1]]} [mm]")
        return svg(figure)


def force_panel(
    pressed: Sequence[Pressed],
    phases: Mapping[str, float],
    desired: Sequence[float],
    band: tuple[float, float],
    title: str,
    series: str,
    span: tuple[float, float],
    columns: int,
) -> str:
    """Contact force of one arm over time, several roll-outs.

    Arguments:
        phases: name -> when it began, seconds from when the box was lifted.
        desired: F_d, newtons; several where roll-outs differ in it.
        band: of forces that hold the box and do not crush it, newtons.
        series: name of the lines' colour in the palette.
        span: of time, seconds.
        columns: panels beside each other.
    """
    top = force_top(desired, band)
    with drawing(panel_width(columns), 2.9) as (figure, (axes,)):
        axes.axhspan(*band, color=colour("series-3"), alpha=0.13, lw=0)
        for force in desired:
            axes.axhline(force, color=colour("ink"), lw=0.9, ls=(0, (5, 3)), zorder=4)
        if len(pressed) <= MOST_LINES:
            for one in pressed:
                axes.plot(one.time, one.force, color=colour(series), lw=0.9, zorder=3)
        else:
            clock, low, middle, high = spread(pressed, span)
            axes.fill_between(clock, low, high, color=colour(series), alpha=0.35, lw=0)
            axes.plot(clock, middle, color=colour(series), lw=1.2, zorder=3)
        for name, begin in phases.items():
            axes.axvline(begin, color=colour("muted"), lw=0.7, ls=(0, (1.5, 2)), zorder=2)
            axes.text(
                begin, 0.985 * top, name, rotation=90, va="top", ha="left", fontsize=8, color=colour("muted"),
                clip_on=True,
            )  # fmt: skip
        axes.set(xlim=span, ylim=(0.0, top), title=title)
        axes.set_xlabel("time since the lift [s]")
        axes.set_ylabel("contact force [N]")
        return svg(figure)


def force_top(desired: Sequence[float], band: tuple[float, float]) -> float:
    """Top of the axis of forces, newtons."""
    return max(HIGHEST * max(desired), 1.2 * band[1])


def spread(pressed: Sequence[Pressed], span: tuple[float, float]) -> tuple[Array, Array, Array, Array]:
    """A clock, seconds, and the 5th, 50th and 95th percentile of forces on it, newtons: arrays, shape (n,).

    Where no roll-out has begun, or all have ended, they are nan.
    """
    clock = np.linspace(*span, CLOCK)
    values = np.array([np.interp(clock, one.time, one.force, left=np.nan, right=np.nan) for one in pressed])
    there = ~np.isnan(values).all(axis=0)
    found = np.full((3, CLOCK), np.nan)
    found[:, there] = np.nanpercentile(values[:, there], (5.0, 50.0, 95.0), axis=0)
    low, middle, high = found
    return clock, low, middle, high


def position_panel(led: Led, title: str, columns: int) -> str:
    """Coordinates of both arms and of their midpoint over time."""
    with drawing(panel_width(columns), 5.2, 3, 1, sharex=True) as (figure, drawn):
        for axis, axes in enumerate(drawn):
            lines = {"left": led.arms[0], "right": led.arms[1], "midpoint": led.midpoint}
            for name, path in lines.items():
                width, dashes = LINES[name]
                axes.plot(led.time, path[:, axis] * MM, color=colour(ARMS[name]), lw=width, ls=dashes)
            axes.set_ylabel(f"{'xyz'[axis]} [mm]")
        return _over_time(figure, drawn, led, title)


def strokes_panel(led: Led, title: str, columns: int) -> str:
    """Speed of the midpoint, separation of the arms, and forces where they were recorded, over time."""
    count = 2 if led.force is None else 3
    with drawing(panel_width(columns), 5.2, count, 1, sharex=True) as (figure, drawn):
        drawn[0].plot(led.time, led.speed * MM, color=colour("ink"), lw=1.2)
        drawn[0].set_ylabel("speed [mm/s]")
        drawn[0].set_ylim(bottom=0)
        drawn[1].plot(led.time, led.separation * MM, color=colour("ink"), lw=1.2)
        drawn[1].set_ylabel("separation [mm]")
        drawn[1].set_ylim(*_at_least(led.separation * MM, LEAST_SPREAD))
        if led.force is not None:
            for name, force in zip(("left", "right"), led.force, strict=True):
                drawn[2].plot(led.time, force, color=colour(ARMS[name]), lw=0.8)
            drawn[2].set_ylabel("force [N]")
            drawn[2].set_ylim(bottom=0)
        return _over_time(figure, drawn, led, title)


def _at_least(values: Array, span: float) -> tuple[float, float]:
    """Range of an axis that holds all values and is no narrower than `span`."""
    middle, half = 0.5 * float(values.min() + values.max()), 0.55 * float(values.max() - values.min())
    return middle - max(half, 0.5 * span), middle + max(half, 0.5 * span)


def _over_time(figure: Figure, drawn: Sequence[Axes], led: Led, title: str) -> str:
    for axes in drawn:
        axes.grid(axis="y")
        axes.ticklabel_format(axis="y", useOffset=False)
    drawn[0].set(title=title, xlim=(float(led.time[0]), float(led.time[-1])))
    drawn[-1].set_xlabel("time [s]")
    figure.align_ylabels()
    return svg(figure)
