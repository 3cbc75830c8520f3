"""The report's section on obstacles: Fig. 4, clearance over time, and methods in numbers. Results in, a section out.

How it is drawn: `flow.py`, `clearance.py`; the numbers: `avoidance_tables.py`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.report import Block, Figure, Panel, Section
from stages.artifacts.rollouts import RecordedRollout
from stages.evaluate.summary import COLLISIONS
from stages.figures.avoidance_tables import (
    REFUSED,
    declared,
    methods_of,
    methods_table,
    range_table,
    systems_tables,
    traps_table,
)
from stages.figures.clearance import Line, clearance_panel, method_colour, method_keys
from stages.figures.flow import PLANAR, Path, Scene, flow_panel, frame, legend, planes
from stages.figures.numbers import MM, counted, joined, kind_name, method_title, number
from stages.figures.results import PointResults, Results
from stages.figures.rollout_sections import path_of, scene_of
from stages.policy.outcome import Outcome, Status

MOST_CONDITIONS, MOST_METHODS = 3, 3


def obstacles_section(results: Results) -> Section | None:
    """Methods of avoidance side by side; none where no roll-out had an obstacle. `results`: of all kinds."""
    among = results.own.part(among=True)
    if among is None:
        return None
    blocks: list[Block] = [_fig4(among), _clearances(among), methods_table(among, results.own.part(among=False))]
    every = results.part(among=True)
    tables = [*systems_tables(among), range_table(among), None if every is None else traps_table(every)]
    blocks += [table for table in tables if table is not None]
    caught = None if every is None else _caught(every)
    if caught is not None:
        blocks.append(caught)
    own = f" \u00b7 {kind_name(results.kind)}" if len(results.kinds) > 1 else ""
    return Section(id="obstacles", title=f"Obstacles (Fig. 4){own}", blocks=tuple(blocks))


def obstacles_sentence(results: Results) -> str:
    """What the methods came to, for the report's head; empty where there were no obstacles."""
    among = results.own.part(among=True)
    if among is None:
        return ""
    said = []
    names = dict.fromkeys([*_chosen(among), *_best_rival(among)])
    for name in names:
        begun = [r for r in among.rows if r["avoidance"] == name and r["outcome"] not in REFUSED]
        if begun:
            arrived = sum(r["outcome"] == Outcome.ARRIVED for r in begun)
            hit = sum(r["outcome"] in COLLISIONS for r in begun)
            said.append(f"{method_title(name)} {arrived} of {len(begun)} ({hit} collided)")
    if not said:
        return "Among obstacles, no roll-out could begin."
    return f"Among obstacles, roll-outs that reached the goal without a collision: {joined(said)}."


def _best_rival(results: Results) -> list[str]:
    """Of the methods that pictures do not show and that are not ours, the one that arrives most often."""
    rivals = [name for name, method in declared(results).items() if method.kind in ("modulation", "cbf")]
    arrived = {
        name: sum(r["outcome"] == Outcome.ARRIVED for r in results.rows if r["avoidance"] == name) for name in rivals
    }
    return [max(rivals, key=lambda name: arrived[name])] if rivals else []


def _chosen(results: Results) -> list[str]:
    """The methods that pictures show: the potential field that arrives most often, the printed one, ours."""
    methods = declared(results)
    arrived = {
        name: sum(r["outcome"] == Outcome.ARRIVED for r in results.rows if r["avoidance"] == name) for name in methods
    }
    picked = []
    for kind in ("apf", "roas", "roas+"):
        of_kind = [name for name, method in methods.items() if method.kind == kind]
        if of_kind:
            picked.append(
                max(of_kind, key=lambda name: arrived[name]) if kind == "apf" else of_kind[-1 if kind == "roas+" else 0]
            )
    return picked or list(methods)[:MOST_METHODS]


def _cases(point: PointResults, condition: str, method: str) -> list[RecordedRollout]:
    """The roll-outs of a condition and method in one scene: of all starts where they share it, else of one.

    The scene is the condition's first in which every method could begin, or its first.
    """
    of_condition = [r for r in point.rollouts if r.condition == condition]
    refused = {r.scene for r in of_condition if r.outcome in REFUSED}
    scenes = list(dict.fromkeys(r.scene for r in of_condition))
    scene = next((name for name in scenes if name not in refused), scenes[0])
    found = [r for r in of_condition if (r.scene, r.avoidance) == (scene, method)]
    return [r for r in found if r.label == found[0].label]


def _fig4(results: Results) -> Figure:
    """Rows: conditions. Columns: methods."""
    shown = results.shown
    methods, kinds = _chosen(results), {name: method.kind for name, method in declared(results).items()}
    conditions = [condition.name for condition in results.conditions][:MOST_CONDITIONS]
    cases = {(c, m): found for c in conditions for m in methods if (found := _cases(shown, c, m))}
    base = scene_of(shown)
    scenes = {
        c: replace(
            base, obstacles=shown.scenes[found[0].scene].shapes, means=base.means[:0], covariances=base.covariances[:0]
        )
        for (c, _), found in cases.items()
    }
    paths = {case: [path_of(r) for r in found] for case, found in cases.items()}
    views = planes([*base.train, *base.test])
    columns = len(methods) if len(views) == 1 else len(views)
    panels = []
    for (condition, method), drawn in paths.items():
        scene = scenes[condition]
        ended = [r.outcome for r in cases[condition, method]]
        title = f"{method_title(method)}: {condition}"
        never, count = sum(o in REFUSED for o in ended), scene.obstacles.number if scene.obstacles else 0
        text = (
            f"{title}. {ended.count('arrived')} of {len(ended)} roll-outs reach the goal"
            f"{f', {never} could not begin' if never else ''}, among {counted(count, 'obstacle')}."
        )
        for view in views:
            extent = frame(scene, [_kept(paths[condition, m], scene) for m in methods if (condition, m) in paths], view)
            svg = flow_panel(scene, drawn, title, method_colour(kinds[method]), extent, view, columns)
            panels.append(Panel(svg=svg, alt=text))
    every = [path for drawn in paths.values() for path in drawn]
    first = next(iter(scenes.values()))
    sentences = [
        f"{shown.name}. Executed paths among obstacles, by method.",
        "Of the potential fields, the one whose range arrives most often."
        if sum(kind == "apf" for kind in kinds.values()) > 1
        else "",
        "Dots: starts; star: goal; a cross: a roll-out that collided, was trapped, ran out of time, or could not "
        "begin.",
    ]
    return Figure(
        panels=tuple(panels), columns=columns, legend=legend(first, every), caption=" ".join(filter(None, sentences))
    )


def _kept(paths: list[Path], scene: Scene) -> list[Path]:
    """Paths as far as they stay near: the printed strategy can throw a state far away."""
    known = np.concatenate([*scene.train, *scene.test])
    size = float(np.linalg.norm(known.max(axis=0) - known.min(axis=0)))
    middle = known.mean(axis=0)
    return [
        replace(
            path,
            executed=path.executed[np.linalg.norm(path.executed - middle, axis=1) < size],
            displaced=-1,
            detour=None,
        )
        for path in paths
    ]


def _clearances(results: Results) -> Figure:
    """Clearance over time, of all methods, from one start under each condition."""
    shown = results.shown
    methods, kinds = methods_of(results), {name: method.kind for name, method in declared(results).items()}
    conditions = [condition.name for condition in results.conditions][:MOST_CONDITIONS]
    panels = []
    for condition in conditions:
        lines = []
        for method in methods:
            found = _cases(shown, condition, method)
            if found:
                r = found[0]
                stopped = r.outcome != Outcome.ARRIVED
                lines.append(
                    Line(method=method, kind=kinds[method], time=r.time, clearance=r.clearance, stopped=stopped)
                )
        if lines:
            least = "; ".join(
                f"{method_title(line.method)} {number(float(line.clearance.min()) * MM)} mm" for line in lines
            )
            alt = f"{condition}: least clearance over the roll-out: {least}."
            panels.append(Panel(svg=clearance_panel(lines, condition, len(conditions)), alt=alt))
    return Figure(
        panels=tuple(panels),
        columns=max(1, min(MOST_CONDITIONS, len(panels))),
        legend=method_keys({name: kinds[name] for name in methods}),
        caption=f"{shown.name}, the first start: distance of the executed state from the nearest obstacle. Shaded: "
        "inside. A cross: where a roll-out collided, was trapped, or ran out of time.",
    )


def _caught(results: Results) -> Figure | None:
    """A trap, and the way out of it: the first roll-out with a detour, in the plane."""
    for point in results.points:
        for r in point.rollouts:
            if point.model.dimension != PLANAR or not (r.status == str(Status.DETOURING)).any():
                continue
            base = scene_of(point, point.scenes[r.scene])
            scene = replace(base, means=base.means[:0], covariances=base.covariances[:0], test=[])
            path = path_of(r)
            extent = frame(scene, [[path]], (0, 1))
            title = f"{method_title(r.avoidance)} on {kind_name(point.kind)} dynamics"
            svg = flow_panel(scene, [path], title, method_colour("roas+"), extent, (0, 1), 2)
            alt = f"{title}: a path stops at a trap on an obstacle, goes round it while V rises, and reaches the goal."
            return Figure(
                panels=(Panel(svg=svg, alt=alt),),
                columns=2,
                legend=legend(scene, [path]),
                caption=f"{point.name}, {r.condition}, demonstration {r.demo}: a trap and the detour that leaves it. "
                "On the obstacle's side the level lines of V bend more than the obstacle: every way along it raises V.",
            )
    return None
