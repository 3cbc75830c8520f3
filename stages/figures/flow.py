"""Fig. 2 of the paper: the flow of the learned system, the demonstrations, and roll-outs that are pushed aside.

Arrays in, SVG documents out. Systems of three coordinates are shown in the planes in which the demonstrations reach
farthest, without flow lines and level lines of V (a flow in a plane does not stay in it). Not here: which cases are
shown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.report import Key
from stages.figures.numbers import MM
from stages.figures.style import colour, drawing, limits, panel_width, svg
from stages.policy.avoidance.shapes import BOX, ELLIPSOID, RADIUS, SIZES, Shapes
from stages.trajectory import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARGIN = 0.07
"""Room around what is drawn, as a fraction of its larger extent."""

FAR = 1.0
"""A path may widen the picture by at most this multiple of the demonstrations' larger extent on each side."""

PLANAR = 2
"""Coordinates of a system whose flow can be drawn."""

GRID = 60
"""Samples of the flow along the longer side."""

FINE = 150
"""Samples of V along the longer side: its level lines may bend sharply."""

LEVELS = 10
"""Level lines of V up to its largest value in the picture, evenly spaced in the square root of V, a length."""

DEVIATIONS = (1.0, 2.0)
"""Standard deviations at which the ellipses of the mixture components are drawn."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """What panels are drawn over, in metres.

    Attributes:
        train, test: demonstrations, arrays, shape (n, d).
        means, covariances: of the mixture, arrays, shape (K, d), (K, d, d).
        goal: array, shape (d,).
        velocity: of states, arrays, shape (n, d), m -> m/s.
        lyapunov: V of states, arrays, shape (n, d), m -> (n,), m^2; none: its level lines are not drawn.
        names: of the coordinates.
        obstacles: where they are at the start; none: there are none.
        traps: array, shape (n, d): minima of V on obstacles; none: not shown.
    """

    train: Sequence[Array]
    test: Sequence[Array]
    means: Array
    covariances: Array
    goal: Array
    velocity: Callable[[Array], Array]
    lyapunov: Callable[[Array], Array] | None = None
    names: Sequence[str] = "xyz"
    obstacles: Shapes | None = None
    traps: Array | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """One roll-out, in metres.

    Attributes:
        x: array, shape (n, d), the state of the learned system; none: it is the executed one.
        executed: array, shape (n, d).
        displaced: sample that holds the displacement; -1: none.
        stopped: whether it ended short of the goal: its end is crossed.
        detour: array of bool, shape (n,): samples on a way out of a trap; none: there are none.
        duration: seconds, for which moving obstacles are shown to move.
    """

    x: Array | None
    executed: Array
    displaced: int
    stopped: bool = False
    detour: NDArray[np.bool_] | None = None
    duration: float = 0.0


def legend(scene: Scene, paths: Sequence[Path]) -> tuple[Key, ...]:
    """What the panels show beside the controllers' own lines."""
    keys = []
    if any(path.x is not None for path in paths):
        keys.append(Key(label="state x of a coupled system: wide band", colour="muted", mark="area"))
    if any(path.displaced > 0 for path in paths):
        keys.append(Key(label="displacement", colour="ink", mark="arrow"))
    if scene.obstacles is not None:
        keys.append(Key(label="obstacles", colour="muted", mark="area"))
        if any(path.stopped for path in paths):
            keys.append(Key(label="end short of the goal", colour="ink", mark="cross"))
    if scene.traps is not None and scene.traps.size:
        keys.append(Key(label="traps: minima of V on obstacles", colour="series-1", mark="dot"))
    if any(path.detour is not None and path.detour.any() for path in paths):
        keys.append(Key(label="detour, on which V rises", colour="series-1"))
    if scene.train:
        keys.append(Key(label="demonstrations, training", colour="ink"))
    if scene.test:
        keys.append(Key(label="demonstrations, test", colour="ink", mark="dashed"))
    if len(scene.means):
        keys.append(Key(label="mixture components, 1 and 2 standard deviations", colour="series-4", mark="area"))
    if scene.goal.shape[0] == PLANAR:
        keys.append(Key(label="flow of the learned system", colour="faint"))
        if scene.lyapunov is not None:
            keys.append(Key(label="level lines of V", colour="series-5"))
    return tuple(keys)


def planes(demonstrations: Sequence[Array]) -> list[tuple[int, int]]:
    """The planes that are shown, each as two coordinates in order.

    Of two coordinates the only one; of more, that of the two in which the demonstrations reach farthest, and that of
    the farthest and the third.
    """
    points = np.concatenate(list(demonstrations))
    farthest = np.argsort(points.min(axis=0) - points.max(axis=0), kind="stable").tolist()
    return [(min(farthest[0], other), max(farthest[0], other)) for other in farthest[1:3]]


def frame(
    scene: Scene, panels: Sequence[Sequence[Path]], plane: tuple[int, int]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of the two coordinates of a plane, metres, for all panels: they hold all that is near the demonstrations.

    `panels`: the paths of each.
    """
    shown = list(plane)
    obstacles = [] if scene.obstacles is None else [scene.obstacles.centres]
    known = np.concatenate([*scene.train, *scene.test, scene.goal[None], *obstacles])[:, shown]
    low, high = known.min(axis=0), known.max(axis=0)
    reach = FAR * float((high - low).max())
    paths = [path.executed[:, shown].clip(low - reach, high + reach) for panel in panels for path in panel]
    return limits(np.concatenate([known, *paths]), MARGIN)


def flow_panel(
    scene: Scene,
    paths: Sequence[Path],
    title: str,
    series: str,
    extent: tuple[tuple[float, float], tuple[float, float]],
    plane: tuple[int, int],
    columns: int,
) -> str:
    """One panel: a controller under a condition.

    Arguments:
        series: name of the controller's colour in the palette.
        extent: from `frame`, metres.
        plane: from `planes`.
        columns: panels beside each other.
    """
    (x0, x1), (y0, y1) = extent
    width = panel_width(columns)
    height = 0.75 + (width - 0.65) * min(1.25, (y1 - y0) / (x1 - x0))
    with drawing(width, height) as (figure, (axes,)):
        if scene.goal.shape[0] == PLANAR:
            _draw_flow(axes, scene, extent)
        _draw_scene(axes, scene, plane)
        if scene.obstacles is not None:
            _draw_obstacles(axes, scene.obstacles, plane, max((path.duration for path in paths), default=0.0))
        for path in paths:
            _draw_path(axes, path, plane, colour(series))
        if scene.traps is not None:
            axes.plot(
                *(scene.traps[:, list(plane)].T * MM), "o", ms=7, color=colour("series-1"), mec=colour("ink"), zorder=9
            )
        axes.plot(*(scene.goal[list(plane)] * MM), "*", ms=13, color=colour("ink"), mec=colour("surface"), zorder=9)
        axes.set(xlim=(x0 * MM, x1 * MM), ylim=(y0 * MM, y1 * MM), aspect="equal", title=title)
        axes.set_xlabel(f"{scene.names[plane[0]]} [mm]")
        axes.set_ylabel(f"{scene.names[plane[1]]} [mm]")
        return svg(figure)


def _draw_flow(axes: Axes, scene: Scene, extent: tuple[tuple[float, float], tuple[float, float]]) -> None:
    """Flow lines, and level lines of V; of two coordinates."""
    xs, ys, states = _grid(extent, GRID)
    flow = scene.velocity(states).reshape(*ys.shape, *xs.shape, 2)
    axes.streamplot(
        xs * MM, ys * MM, flow[..., 0], flow[..., 1],
        color=colour("faint"), linewidth=0.6, arrowsize=0.7, density=0.9, zorder=1,
    )  # fmt: skip
    if scene.lyapunov is not None:
        xs, ys, states = _grid(extent, FINE)
        root = np.sqrt(scene.lyapunov(states)).reshape(*ys.shape, *xs.shape)
        levels = np.linspace(0.0, root.max(), LEVELS + 1)[1:-1]
        axes.contour(xs * MM, ys * MM, root, levels, colors=colour("series-5"), linewidths=0.8, alpha=0.8, zorder=2)


def _grid(extent: tuple[tuple[float, float], tuple[float, float]], most: int) -> tuple[Array, Array, Array]:
    """Coordinates along both axes, and the states of the grid, shape (n, 2), row by row; `most` on the longer side."""
    (x0, x1), (y0, y1) = extent
    longest = max(x1 - x0, y1 - y0)
    xs = np.linspace(x0, x1, max(8, round(most * (x1 - x0) / longest)))
    ys = np.linspace(y0, y1, max(8, round(most * (y1 - y0) / longest)))
    return xs, ys, np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)


def _draw_scene(axes: Axes, scene: Scene, shown: tuple[int, int]) -> None:
    """Components of the mixture, and demonstrations."""
    from matplotlib.patches import Ellipse

    for mean, covariance in zip(scene.means, scene.covariances, strict=True):
        block = covariance[np.ix_(shown, shown)]
        variances, directions = np.linalg.eigh(block)
        angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
        for deviation in DEVIATIONS:
            long, short = 2 * deviation * np.sqrt(variances[::-1]) * MM
            ellipse = Ellipse(
                tuple(mean[list(shown)] * MM), long, short, angle=angle, fc=colour("series-4"), ec="none", alpha=0.13
            )
            axes.add_patch(ellipse)
    for demonstration in scene.test:
        axes.plot(*(demonstration[:, shown].T * MM), color=colour("ink"), lw=0.9, ls=(0, (5, 3)), alpha=0.8, zorder=3)
    for demonstration in scene.train:
        axes.plot(*(demonstration[:, shown].T * MM), color=colour("ink"), lw=0.9, alpha=0.8, zorder=3)


def outline(shapes: Shapes, index: int, plane: tuple[int, int], points: int = 120) -> Array:
    """The outline of an obstacle seen along the other coordinates, array, shape (points, 2), metres.

    The point farthest in each direction of the plane: of a convex shape these make its shadow's edge.
    """
    d = shapes.centres.shape[1]
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    directions = np.zeros((points, d))
    directions[:, plane[0]], directions[:, plane[1]] = np.cos(angle), np.sin(angle)
    frame, sizes = shapes.frames[index], shapes.measures[index, SIZES:]
    local = directions @ frame
    if shapes.kinds[index] == BOX:
        local = np.sign(local) * sizes
    elif shapes.kinds[index] == ELLIPSOID:
        local = local * sizes**2 / np.linalg.norm(local * sizes, axis=1, keepdims=True)
    else:
        local = np.zeros_like(local)
    farthest = shapes.centres[index] + local @ frame.T + shapes.measures[index, RADIUS] * directions
    farthest[-1] = farthest[0]  # of a box, a corner and the middle of an edge are equally far in that direction
    return np.asarray(farthest[:, list(plane)])


def _draw_obstacles(axes: Axes, shapes: Shapes, plane: tuple[int, int], duration: float) -> None:
    """Obstacles at the start; those that move with where they are at the end, and an arrow."""
    shown = list(plane)
    for index in range(shapes.number):
        edge = outline(shapes, index, plane) * MM
        axes.fill(*edge.T, fc=colour("muted"), ec=colour("ink"), lw=0.8, alpha=0.45, zorder=3.5)
        way = shapes.velocities[index, shown] * duration * MM
        if way.any():
            axes.plot(*(edge + way).T, color=colour("muted"), lw=0.8, ls=(0, (4, 3)), zorder=3.5)
            centre = shapes.centres[index, shown] * MM
            arrow = {"arrowstyle": "-|>", "color": colour("muted"), "lw": 0.8, "shrinkA": 0, "shrinkB": 0}
            drawn = axes.annotate(
                "", xy=tuple(centre + way), xytext=tuple(centre), arrowprops=arrow, annotation_clip=False, zorder=3.6
            )
            if drawn.arrow_patch is not None:
                drawn.arrow_patch.set_clip_box(axes.bbox)


def _draw_path(axes: Axes, path: Path, shown: tuple[int, int], line: str) -> None:
    """The executed path, broken where it is displaced, the state x beside it where they differ, the displacement."""
    executed = path.executed[:, shown] * MM
    if path.x is not None:
        axes.plot(*(path.x[:, shown].T * MM), color=line, lw=5.5, alpha=0.3, zorder=4)
    parts = [executed] if path.displaced <= 0 else [executed[: path.displaced], executed[path.displaced :]]
    for part in parts:
        axes.plot(*part.T, color=line, lw=1.9, zorder=5)
    axes.plot(*executed[0], "o", ms=4, color=line, zorder=6)
    if path.detour is not None and path.detour.any():
        there = np.where(path.detour[:, None], executed, np.nan)
        axes.plot(*there.T, color=colour("series-1"), lw=2.4, zorder=7)
    if path.stopped:
        axes.plot(*executed[-1], "X", ms=7, color=colour("ink"), mec=colour("surface"), mew=0.6, zorder=8)
    if path.displaced > 0:
        arrow = {
            "arrowstyle": "-|>",
            "color": colour("ink"),
            "lw": 0.8,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 9,
        }
        axes.annotate(
            "", xy=tuple(executed[path.displaced]), xytext=tuple(executed[path.displaced - 1]),
            arrowprops=arrow, zorder=8,
        )  # fmt: skip
