"""All motions of a sweep at a glance: demonstrations and undisturbed roll-outs, one small picture each.

Arrays in, SVG documents out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stages.figures.flow import planes
from stages.figures.numbers import MM
from stages.figures.style import colour, controller_colours, drawing, limits, panel_width, svg
from stages.trajectory import Array

COLUMNS = 6
MOST_SAMPLES = 150
"""Samples of a path in a picture of less than two inches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """One small picture, all in metres.

    Attributes:
        name: its title.
        demonstrations: arrays, shape (n, d).
        rollouts: label of a controller -> executed paths, arrays, shape (n, d).
        goal: array, shape (d,).
    """

    name: str
    demonstrations: Sequence[Array]
    rollouts: Mapping[str, Sequence[Array]]
    goal: Array


def motion_panel(motion: Motion) -> str:
    """A motion to its own scale, without axes."""
    width = panel_width(COLUMNS)
    with drawing(width, width + 0.2) as (figure, (axes,)):
        shown = list(planes(motion.demonstrations)[0])
        colours = controller_colours(list(motion.rollouts))
        for demonstration in motion.demonstrations:
            axes.plot(*_thinned(demonstration[:, shown]).T, color=colour("faint"), lw=0.9)
        for depth, (label, paths) in enumerate(motion.rollouts.items()):
            # The first controller is widest and lowest, so that one that covers it leaves it to be seen.
            wide = 2.8 if depth == 0 and len(motion.rollouts) > 1 else 1.0
            for path in paths:
                axes.plot(*_thinned(path[:, shown]).T, color=colour(colours[label]), lw=wide)
        axes.plot(*(motion.goal[shown] * MM), "*", ms=8, color=colour("ink"), mec=colour("surface"), mew=0.5)
        paths = [path for paths in motion.rollouts.values() for path in paths]
        (x0, x1), (y0, y1) = limits(np.concatenate([*motion.demonstrations, *paths])[:, shown] * MM, 0.06)
        half = 0.5 * max(x1 - x0, y1 - y0)
        axes.set(xlim=(0.5 * (x0 + x1) - half, 0.5 * (x0 + x1) + half), aspect="equal")
        axes.set(ylim=(0.5 * (y0 + y1) - half, 0.5 * (y0 + y1) + half))
        axes.set_title(motion.name, fontsize=9, fontweight="normal", loc="center")
        axes.set_axis_off()
        return svg(figure)


def _thinned(path: Array) -> Array:
    """At most `MOST_SAMPLES` of a path's samples, the ends among them, mm."""
    keep = np.unique(np.linspace(0, path.shape[0] - 1, min(MOST_SAMPLES, path.shape[0])).round().astype(int))
    return np.asarray(path[keep] * MM)
