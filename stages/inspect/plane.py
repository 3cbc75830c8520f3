"""Roll-outs of a point for the viewer: flow, demonstrations, components, paths, and what happened over time.

Paper Fig. 2. Of two coordinates drawn with y upwards; of three in space, without flow. Not here: obstacles
(`obstacles.py`), two arms (`arms.py`), and how views are laid out (`plane_layout.py`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.report import PALETTE
from stages.figures.numbers import MM
from stages.figures.results import PointResults
from stages.figures.style import limits
from stages.inspect.shown import Shown
from stages.inspect.stream import PLANAR, TRAP, Colour, Stream, rgb
from stages.policy.outcome import Status
from stages.trajectory import Array
from stages.world.description import quaternions

UPWARDS = (1.0, -1.0, 1.0)
"""The viewer's second coordinate points down; a picture of a plane has it point up."""

GRID = 24
"""Arrows of the flow along the longer side."""

DEVIATIONS = (1.0, 2.0)
"""Standard deviations at which components are drawn."""

MARGIN = 0.08

FAR = 0.3
"""A path may widen the picture by at most this multiple of the demonstrations' larger extent on each side."""

STATUSES: dict[str, Colour] = {
    str(Status.ACTIVE): (44, 96, 140),
    str(Status.DETOURING): (170, 96, 30),
    str(Status.YIELDING): (170, 96, 30),
    str(Status.INFEASIBLE): (180, 50, 50),
    str(Status.TOO_FAST): (180, 50, 50),
    str(Status.TRAPPED): (180, 50, 50),
}
"""Colours of what became of a step."""

THIN, DOT = 0.003, 0.009
"""Width of a path and radius of a point, as shares of the demonstrations' larger extent."""

GATE = ("x moves", "x waits")
GATES: dict[str, Colour] = {GATE[0]: (44, 110, 90), GATE[1]: (190, 130, 30)}
"""Words of the lane of the gate."""

INK, TEST, FAINT = (176, 183, 192), (120, 128, 138), (86, 94, 104)
COMPONENT = rgb("series-4", PALETTE)
"""Colours; greys that are seen on a dark page and on a light one, as the viewer follows the system's."""


def draw_model(stream: Stream, root: str, point: PointResults) -> None:
    """Write what roll-outs of a point share below `root`: demonstrations, goal, components; in the plane the flow."""
    midpoints, model = point.midpoints, point.model
    size = extent_of(point)
    for split, colour in (("train", INK), ("test", TEST)):
        ways = [t.position for t in midpoints.of_split(split)]
        stream.ways(f"{root}/demonstrations/{split}", ways, colour, 0.6 * THIN * size)
    stream.spots(f"{root}/goal", midpoints.goal[None], INK, DOT * size, ["goal"])
    means, covariances = model.mixture.means, model.mixture.covariances
    if midpoints.goal.shape[0] == PLANAR:
        rings = [ring for share in DEVIATIONS for ring in ellipses(means, covariances, share)]
        stream.ways(f"{root}/components", rings, (*COMPONENT, 160), 0.5 * THIN * size)
        _flow(stream, f"{root}/flow", point)
    else:
        variances, axes = np.linalg.eigh(covariances)
        axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
        stream.still(
            f"{root}/components",
            stream.rr.Ellipsoids3D(
                centers=means,
                half_sizes=np.sqrt(variances),
                quaternions=quaternions(axes),
                colors=[(*COMPONENT, 60)],
                line_radii=[0.2 * THIN * size],
            ),
        )


def _flow(stream: Stream, root: str, point: PointResults) -> None:
    """Directions of the learned system on a grid."""
    (x0, x1), (y0, y1) = bounds([point])
    step = max(x1 - x0, y1 - y0) / GRID
    grid = np.stack(np.meshgrid(np.arange(x0, x1, step), np.arange(y0, y1, step)), axis=-1).reshape(-1, 2)
    velocity = point.model.velocity(grid)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    arrows = 0.75 * step * np.divide(velocity, speed, out=np.zeros_like(velocity), where=speed > 0.0)
    drawn = stream.rr.Arrows2D(origins=grid - 0.5 * arrows, vectors=arrows, colors=[FAINT], radii=[0.02 * step])
    stream.still(root, drawn)
    stream.spots(f"{root}/heads", grid + 0.5 * arrows, FAINT, 0.07 * step)  # arrows' own cannot be seen at this size


def draw_rollout(stream: Stream, root: str, one: Shown) -> None:
    """Write a roll-out below `root`: x, p_hat and the executed path, and what happened over time."""
    rollout, size = one.rollout, extent_of(one.point)
    executed, time = rollout.executed, rollout.time
    cut = rollout.displaced
    parts = [executed] if cut <= 0 else [executed[:cut], executed[cut:]]
    if rollout.controller != "lpvds":
        stream.ways(f"{root}/x/way", [rollout.x], (*one.colour, 70), 3.0 * THIN * size)
        stream.place(f"{root}/x", time, rollout.x, (*one.colour, 150), 1.5 * DOT * size)
        stream.place(f"{root}/p_hat", time, rollout.p_hat, INK, 0.5 * DOT * size)
        gap = np.linalg.norm(rollout.p_hat - rollout.x, axis=1)
        stream.series(f"{root}/plot/gap/p_hat", time, MM * gap, one.colour, one.name)
    stream.ways(f"{root}/executed/way", parts, one.colour, THIN * size)
    stream.place(f"{root}/executed", time, executed, one.colour, DOT * size)
    stream.series(f"{root}/plot/lyapunov/V", time, MM * MM * rollout.lyapunov, one.colour, one.name)
    if np.isfinite(rollout.clearance).any():
        stream.series(f"{root}/plot/clearance/least", time, MM * rollout.clearance, one.colour, one.name)
    _lanes(stream, f"{root}/lane", one)


def _lanes(stream: Stream, root: str, one: Shown) -> None:
    """Whether x moves, when it was pushed, and what became of the steps."""
    rollout = one.rollout
    if gated(one):
        stream.states(f"{root}/gate", rollout.time, np.where(rollout.gate, *GATE), GATES)
    if rollout.disturbed:
        pushed = np.full(rollout.time.shape, "", dtype=object)
        for first, last in rollout.disturbed:
            pushed[first : last + 1] = "pushed"
        stream.states(f"{root}/disturbance", rollout.time, pushed, {"pushed": TRAP})
    if rollout.scene:
        status = np.where(rollout.status == str(Status.FREE), "", rollout.status)
        stream.states(f"{root}/avoidance", rollout.time, status, STATUSES)


def gated(one: Shown) -> bool:
    """Whether there is a gate that something could close."""
    return one.rollout.controller != "lpvds" and bool(one.rollout.disturbed or not one.rollout.gate.all())


def extent_of(point: PointResults) -> float:
    """The demonstrations' larger extent, metres."""
    points = np.concatenate([t.position for t in point.midpoints.trajectories])
    return float(np.ptp(points, axis=0).max())


def bounds(
    points: Sequence[PointResults], paths: Sequence[Array] = ()
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of both coordinates of a plane, metres, that hold demonstrations and goals; paths within their extent."""
    known = np.concatenate(
        [np.concatenate([*(t.position for t in p.midpoints.trajectories), p.midpoints.goal[None]]) for p in points]
    )
    reach = float(np.ptp(known, axis=0).max())
    near = [path.clip(known.min(axis=0) - FAR * reach, known.max(axis=0) + FAR * reach) for path in paths]
    return limits(np.concatenate([known, *near]), MARGIN)


def ellipses(means: Array, covariances: Array, deviations: float) -> list[Array]:
    """Outlines of components, K arrays, shape (65, 2), metres, so many standard deviations from the means.

    `means`: shape (K, 2), metres; `covariances`: shape (K, 2, 2).
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 65)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    factors = np.linalg.cholesky(covariances)
    return [mean + deviations * ring @ factor.T for mean, factor in zip(means, factors, strict=True)]
