"""Kinds of dynamics compared motion by motion, as dots on a line; and how far a motion moves away from its goal.

Arrays in, SVG documents and numbers out. Not here: which motions and errors are compared (`kinds_section.py`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.report import Key
from stages.dynamics.lpvds import LpvDs
from stages.figures.flow import Path, Scene
from stages.figures.numbers import given, kind_name
from stages.figures.style import colour, drawing, panel_width, svg
from stages.trajectory import Array

COLOURS = {"qlf": "muted", "pqlf": "series-5", "warped": "series-4"}
"""Name in the palette for each kind: none that a controller has."""

OTHER = "ink"
FEWEST = 3
"""Marks of a logarithmic axis that are enough."""

NEAREST = 0.15
"""Smallest distance of two marks, as a fraction of the axis; their numbers have up to five digits."""

ROW = 0.19
"""Height of a motion's line, inches."""


def kind_keys(kinds: Sequence[str]) -> tuple[Key, ...]:
    """Legend entries of kinds of dynamics."""
    return tuple(Key(label=kind_name(kind), colour=COLOURS.get(kind, OTHER), mark="dot") for kind in kinds)


def strip_panel(names: Sequence[str], values: Mapping[str, Array], title: str, axis: str, columns: int) -> str:
    """One error of every motion under every kind: a line a motion, a dot a kind, the first kind lowest.

    Arguments:
        names: of the motions, from top to bottom.
        values: kind -> the error of each motion, array, shape (n,).
        title: of the panel; axis: what is measured, with its unit.
        columns: panels beside each other.
    """
    from matplotlib.ticker import NullLocator

    every = np.stack(list(values.values()))
    places = np.arange(len(names))
    with drawing(panel_width(columns), 0.85 + ROW * len(names)) as (figure, (axes,)):
        axes.hlines(places, every.min(axis=0), every.max(axis=0), color=colour("faint"), lw=1.0, zorder=1)
        for depth, (kind, found) in enumerate(values.items()):
            axes.plot(
                found, places, "o", ms=5.5, color=colour(COLOURS.get(kind, OTHER)), mec=colour("surface"), mew=0.6,
                zorder=2 + depth,
            )  # fmt: skip
        if every.min() > 0:
            axes.set_xscale("log")
            axes.xaxis.set_minor_locator(NullLocator())
            marks = ticks(float(every.min()), float(every.max()))
            axes.set_xticks(marks, [given(mark) for mark in marks])
        axes.set_yticks(places, names, fontsize=8)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x")
        axes.set(title=title)
        axes.set_xlabel(axis)
        return svg(figure)


def ticks(low: float, high: float) -> list[float]:
    """Marks of a logarithmic axis from `low` to `high`, both positive: 1, 2, 5 times a power of ten, or what is round.

    They are inside, and no nearer to each other than their numbers are wide.
    """
    from matplotlib.ticker import MaxNLocator

    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    marks = [factor * 10.0**power for power in powers for factor in (1, 2, 5)]
    if sum(low <= mark <= high for mark in marks) < FEWEST:
        marks = [float(mark) for mark in MaxNLocator(6).tick_values(low, high)]
    kept: list[float] = []
    for mark in marks:
        if low <= mark <= high and not (kept and math.log(mark / kept[-1]) < NEAREST * math.log(high / low)):
            kept.append(mark)
    return kept


def image_scene(scene: Scene, model: LpvDs) -> Scene:
    """A scene as psi shows it: demonstrations and flow in the image, where V = psi'P psi is quadratic.

    Arguments:
        scene: of a warped system.
        model: the system.
    """
    warp = model.warp
    assert warp is not None

    def velocity(image: Array) -> Array:
        z = warp.invert(image)
        return np.asarray(np.einsum("nij,nj->ni", warp.apply(z)[1], model.velocity(z + model.goal)))

    def lyapunov(image: Array) -> Array:
        return np.asarray(np.einsum("ni,ij,nj->n", image, model.lyapunov_matrix, image))

    d = model.dimension
    return Scene(
        train=[warp.apply(path - model.goal)[0] for path in scene.train],
        test=[warp.apply(path - model.goal)[0] for path in scene.test],
        means=np.empty((0, d)),
        covariances=np.empty((0, d, d)),
        goal=np.zeros(d),
        velocity=velocity,
        lyapunov=lyapunov,
        names=("psi₁", "psi₂", "psi₃"),
    )


def image_path(path: Path, model: LpvDs) -> Path:
    """An undisturbed roll-out as psi shows it."""
    assert model.warp is not None
    return Path(x=None, executed=model.warp.apply(path.executed - model.goal)[0], displaced=-1)


def moving_away(path: Array, goal: Array) -> float:
    """Share of a path's length on which its distance from the goal rises.

    `path`: array, shape (n, d), metres. `goal`: array, shape (d,), metres.
    """
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    rises = np.diff(np.linalg.norm(path - goal, axis=1)) > 0.0
    return float(lengths[rises].sum() / lengths.sum())
