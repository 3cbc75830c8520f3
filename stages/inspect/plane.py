"""Roll-outs of a point for the viewer: flow, demonstrations, components, obstacles, paths, and what happened over time.

Paper Figs. 2 and 4. Of two coordinates drawn with y upwards; of three in space, without flow. Not here: two arms
(`arms.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.report import PALETTE
from stages.artifacts.rollouts import RecordedScene
from stages.figures.flow import outline
from stages.figures.numbers import MM, condition_name, controller_name, method_title
from stages.figures.results import PointResults
from stages.figures.style import limits
from stages.inspect.shown import Shown, case_of, undisturbed_first
from stages.inspect.stream import PLANAR, Colour, Stream, rgb
from stages.policy.avoidance.shapes import BOX, RADIUS, REACH, SIZES
from stages.policy.outcome import Status
from stages.trajectory import Array
from stages.world.description import quaternions

UPWARDS = (1.0, -1.0, 1.0)
"""The viewer's second coordinate points down; a picture of a plane has it point up."""

GRID = 24
"""Arrows of the flow along the longer side."""

DEVIATIONS = (1.0, 2.0)
"""Standard deviations at which components are drawn."""

MOMENTS = 150
"""Moments at which a moving obstacle is drawn, at most."""

MARGIN = 0.08

FAR = 0.3
"""A path may widen the picture by at most this multiple of the demonstrations' larger extent on each side."""

BESIDE = np.array([1.5, -1.0, 0.8])
"""From the middle of the demonstrations to where the viewer looks from in space, in their larger extent."""

FEW = 4
"""Cases up to which each plot has a legend; of more, one plot."""

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

INK, TEST, FAINT, OBSTACLE = (176, 183, 192), (120, 128, 138), (86, 94, 104), (150, 158, 168)
COMPONENT, TRAP = rgb("series-4", PALETTE), rgb("series-1", PALETTE)
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


def draw_obstacles(stream: Stream, root: str, scene: RecordedScene, time: Array) -> None:
    """Write obstacles below `root`, in the plane as outlines, in space as bodies; and traps on them.

    `time`: array, shape (n,), seconds; those that move are drawn at up to `MOMENTS` of these.
    """
    shapes, d = scene.shapes, scene.shapes.centres.shape[1]
    moments = time[np.unique(np.linspace(0, time.shape[0] - 1, MOMENTS).astype(int))]
    size = float(shapes.measures[:, REACH].max(initial=0.0))
    for index in range(shapes.number):
        entity, velocity = f"{root}/{index + 1}", shapes.velocities[index]
        if d == PLANAR:
            edge = outline(shapes, index, (0, 1))
            if velocity.any():
                moved = edge[None] + moments[:, None, None] * velocity
                columns = stream.rr.LineStrips2D.columns(
                    strips=list(moved), colors=[OBSTACLE] * len(moments), radii=[0.02 * size] * len(moments)
                )
                stream.columns(entity, moments, columns)
            else:
                stream.ways(entity, [edge], OBSTACLE, 0.04 * size)
        else:
            half = shapes.measures[index, SIZES:] + (shapes.measures[index, RADIUS] if not shapes.kinds[index] else 0.0)
            if shapes.kinds[index] == BOX:
                half = shapes.measures[index, SIZES:] + shapes.measures[index, RADIUS]
                body = stream.rr.Boxes3D(half_sizes=[half], colors=[(*OBSTACLE, 90)], fill_mode="solid")
            else:
                body = stream.rr.Ellipsoids3D(half_sizes=[half], colors=[(*OBSTACLE, 90)], fill_mode="solid")
            stream.still(entity, body)
            turn = quaternions(shapes.frames[index][None])
            where = shapes.centres[index] + moments[:, None] * velocity
            stream.columns(
                entity,
                moments,
                stream.rr.Transform3D.columns(translation=where, quaternion=np.repeat(turn, len(moments), axis=0)),
            )
    if scene.traps is not None and scene.traps.size:
        stream.spots(f"{root}/traps", scene.traps, TRAP, 0.1 * size, ["trap"] * len(scene.traps))


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
