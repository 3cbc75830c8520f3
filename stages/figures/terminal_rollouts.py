"""What ``clpv show`` draws of roll-outs: executed paths, distances from the goal, and how hard two arms press.

Of many conditions one is shown, where something happens; of many roll-outs those that can be told apart. Titles say
which. Files of the stage and of the stages before it in, small plots out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.plots import Bars, Plot, Series
from stages.artifacts.rollouts import RecordedRollout, RecordedScene
from stages.figures.flow import outline
from stages.figures.numbers import MM, counted
from stages.figures.terminal import GOAL, SIDES, Place, dotted, line, plane_of, plane_plot, points
from stages.trajectory import Array

MOST = 4
"""Cases that are shown beside each other."""

FAR = 0.5
"""A path may widen a picture by this multiple of what the demonstrations span, on each side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Roll-outs that differ in their starts only, and the obstacles among which they are.

    Attributes:
        name: what tells it from the other cases.
        rollouts: at least one.
        scene: of all of them; none: there are no obstacles.
    """

    name: str
    rollouts: tuple[RecordedRollout, ...]
    scene: RecordedScene | None


def rollout(files: Mapping[str, Path]) -> list[Plot | Bars]:
    """Executed paths by case, distances from the goal over time, and of arms the contact forces of one roll-out."""
    from stages.artifacts.midpoints import read_midpoints
    from stages.artifacts.rollouts import read_rollouts, read_scenes

    rollouts, goal = read_rollouts(files["rollouts"])
    if not rollouts:
        return []
    demonstrations = [t.position for t in read_midpoints(files["midpoints"]).trajectories]
    cases, left_out = cases_of(rollouts, read_scenes(files["rollouts"]))
    plots = [*_paths(cases, demonstrations, goal), _distances(cases, goal, left_out)]
    first = next((r for r in rollouts if r.carry is not None and r.carry.pushed.any()), rollouts[0])
    return [*plots, *_forces(first)]


def cases_of(rollouts: Sequence[RecordedRollout], scenes: Mapping[str, RecordedScene]) -> tuple[list[Case], int]:
    """At most `MOST` cases, the first and the last among them, and how many are left out.

    Of the first condition with a disturbance or an obstacle, else of the first; of arms, whose conditions are what is
    to be compared, of all. Of a case with several scenes, the roll-outs in the first.
    """
    arms = any(r.carry is not None for r in rollouts)
    eventful = next((r for r in rollouts if r.disturbed or r.scene), rollouts[0])
    groups: dict[tuple[str, ...], list[RecordedRollout]] = {}
    for one in rollouts:
        if arms or one.condition == eventful.condition:
            groups.setdefault((one.condition,) if arms else (one.label, one.avoidance, one.condition), []).append(one)
    keys = list(groups)
    told = [at for at in range(len(keys[0])) if at == len(keys[0]) - 1 or len({key[at] for key in keys}) > 1]
    kept = np.unique(np.linspace(0, len(keys) - 1, min(MOST, len(keys))).round().astype(int))
    cases = []
    for key in (keys[k] for k in kept):
        scene = groups[key][0].scene
        members = tuple(r for r in groups[key] if r.scene == scene)
        cases.append(Case(name=", ".join(key[at] for at in told), rollouts=members, scene=scenes.get(scene)))
    return cases, len(keys) - len(cases)


def _paths(cases: Sequence[Case], demonstrations: Sequence[Array], goal: Array) -> list[Plot | Bars]:
    plane = plane_of(demonstrations)
    dots = dotted("demonstrations", demonstrations, plane)
    drawn = {}
    for case in cases:
        edges = [] if case.scene is None else _edges(case.scene, plane)
        paths = line("executed", [_near(r.executed, demonstrations) for r in case.rollouts], plane)
        title = f"{case.name}: {counted(len(case.rollouts), 'path')}"
        drawn[title] = [dots, *edges, paths, points("goal", [goal], plane, GOAL)]
    within = [one for series in drawn.values() for one in series]
    return [plane_plot(title, plane, series, within) for title, series in drawn.items()]


def _near(path: Array, demonstrations: Sequence[Array]) -> Array:
    """A path, array, shape (n, d), metres, without what lies far from where the demonstrations are: nan there."""
    pooled = np.concatenate(list(demonstrations))
    low, high = pooled.min(axis=0), pooled.max(axis=0)
    room = FAR * (high - low).max()
    inside = ((path >= low - room) & (path <= high + room)).all(axis=1)
    return np.where(inside[:, None], path, np.nan)


def _edges(scene: RecordedScene, plane: Place) -> list[Series]:
    """Outlines of obstacles at the start, mm."""
    found = [outline(scene.shapes, k, plane) for k in range(scene.shapes.number)]
    moving = " at the start" if np.any(scene.shapes.velocities) else ""
    return [line(f"obstacle{moving}", found, (0, 1), mark="#", faint=True)] if found else []


def _distances(cases: Sequence[Case], goal: Array, left_out: int) -> Plot:
    """Distances over time, of a box from its goal where arms carry one, of the first roll-out of each case."""
    series = []
    for case in cases:
        one = case.rollouts[0]
        path, end = (one.executed, goal) if one.carry is None else (one.carry.box, np.array(one.carry.facts["goal"]))
        series.append(Series(name=case.name, x=one.time, y=np.linalg.norm(path - end, axis=1) * MM))
    first = cases[0].rollouts[0]
    what = f"from the goal, demonstration {first.demo}" if first.carry is None else "of the box from its goal"
    title = f"Distance {what}" + (f" ({counted(left_out, 'case')} not drawn)" if left_out else "")
    return Plot(title=title, x_label="t [s]", y_label="distance [mm]", series=tuple(series))


def _forces(one: RecordedRollout) -> list[Plot | Bars]:
    if one.carry is None:
        return []
    pressed = [
        Series(name=f"{side} arm", x=one.time, y=one.carry.contact[:, k], mark=mark)
        for k, (side, mark) in enumerate(SIDES.items())
    ]
    wanted = Series(name="F_d", x=one.time, y=one.carry.desired, mark="d")
    title = f"Contact forces of {one.rollout} ({one.outcome})"
    return [Plot(title=title, x_label="t [s]", y_label="force [N]", series=(*pressed, wanted))]
