"""The report's sections of roll-outs: Fig. 2, all motions at a glance, and why the coupled system recovers.

Results in, sections out. How they are drawn: `flow.py`, `overview.py`, `recovery.py`.
"""

from __future__ import annotations

import numpy as np

from pipeline.report import Block, Figure, Key, Panel, Section
from stages.artifacts.rollouts import RecordedRollout, RecordedScene
from stages.figures.conditions import farthest, said
from stages.figures.flow import Path, Scene, flow_panel, frame, legend, planes
from stages.figures.numbers import MM, UNDISTURBED, condition_name, controller_name, joined, number
from stages.figures.overview import COLUMNS, Motion, motion_panel
from stages.figures.recovery import Case, recovery_panel
from stages.figures.results import PointResults, Results
from stages.figures.style import controller_colours, controller_keys
from stages.policy.outcome import Outcome, Status
from stages.rollout.parameters import Condition
from stages.trajectory import Array

MOST_COLUMNS = 3


def rollouts_section(results: Results) -> Section:
    """Fig. 2, and all motions of a sweep at a glance."""
    blocks: list[Block] = [_fig2(results)]
    if results.is_sweep:
        blocks.append(_overview(results))
    return Section(id="rollouts", title="Roll-outs (Fig. 2)", blocks=tuple(blocks))


def _fig2(results: Results) -> Figure:
    """Rows: the farthest push in each direction, or undisturbed where there is none. Columns: controllers."""
    shown = results.shown
    scene = scene_of(shown)
    pushed = farthest(results.conditions)
    names = {c.name: f"{condition_name(c.name)}, {said(c)}" for c in pushed}
    if not names:
        names = {r.condition: condition_name(r.condition) for r in shown.rollouts[:1]}
    cases = {
        (condition, controller): found
        for condition in names
        for controller in results.controllers
        if (found := [r for r in shown.rollouts if (r.condition, r.label) == (condition, controller)])
    }
    paths = {case: [path_of(r) for r in found] for case, found in cases.items()}
    extents = {plane: frame(scene, list(paths.values()), plane) for plane in planes([*scene.train, *scene.test])}
    colours = controller_colours(results.controllers)
    columns = min(MOST_COLUMNS, max(2, len(results.controllers)))
    if len(extents) > 1:
        columns = len(extents)
    panels = []
    for (condition, controller), drawn in paths.items():
        title = f"{controller_name(controller)}: {names[condition]}"
        arrived = sum(r.outcome == "arrived" for r in cases[condition, controller])
        reached = f"{arrived} of {len(drawn)} roll-outs reach the goal"
        for plane, extent in extents.items():
            alt = f"{title}. {reached}, drawn {_over(plane, len(extents))}."
            svg = flow_panel(scene, drawn, title, colours[controller], extent, plane, columns)
            panels.append(Panel(svg=svg, alt=alt))
    return Figure(
        panels=tuple(panels),
        columns=columns,
        legend=(
            *controller_keys(results.controllers),
            *legend(scene, [path for drawn in paths.values() for path in drawn]),
        ),
        caption=_fig2_caption(shown, pushed, results.controllers, len(extents)),
    )


def _over(plane: tuple[int, int], count: int) -> str:
    """What a panel's paths are drawn over: the flow, or one of `count` planes."""
    return "over the flow" if count == 1 else f"in the plane of {'xyz'[plane[0]]} and {'xyz'[plane[1]]}"


def _fig2_caption(shown: PointResults, pushed: list[Condition], controllers: list[str], count: int) -> str:
    splits = dict.fromkeys({"train": "training"}.get(r.split, r.split) for r in shown.rollouts)
    sentences = [f"{shown.name}. Executed paths from the first points of the {joined(list(splits))} demonstrations."]
    if pushed:
        sentences.append("Each is pushed aside once, on its way.")
        if "lpvds" in controllers:
            sentences.append("Plain LPV-DS goes on from where it was put.")
        if set(controllers) - {"lpvds"}:
            sentences.append(
                "A coupled system returns to where it was, while its state x waits, and goes on from there."
            )
    sentences.append("Dots: starts; star: goal.")
    if count > 1:
        sentences.append(
            "The two planes hold the coordinate in which the demonstrations reach farthest, and one other each."
        )
    return " ".join(sentences)


def scene_of(point: PointResults, among: RecordedScene | None = None) -> Scene:
    """Demonstrations, mixture and flow of a point, and the obstacles of one of its scenes."""
    midpoints, model = point.midpoints, point.model
    return Scene(
        train=[t.position for t in midpoints.of_split("train")],
        test=[t.position for t in midpoints.of_split("test")],
        means=model.mixture.means,
        covariances=model.mixture.covariances,
        goal=midpoints.goal,
        velocity=model.velocity,
        lyapunov=model.lyapunov,
        obstacles=None if among is None else among.shapes,
        traps=None if among is None else among.traps,
    )


def path_of(rollout: RecordedRollout) -> Path:
    """A roll-out as it is drawn: with its state x where that is not the executed one."""
    x = None if rollout.controller == "lpvds" or rollout.scene else rollout.x
    return Path(
        x=x,
        executed=rollout.p_hat,
        displaced=rollout.displaced,
        stopped=bool(rollout.scene) and rollout.outcome != Outcome.ARRIVED,
        detour=np.asarray(rollout.status == str(Status.DETOURING)),
        duration=float(rollout.time[-1]),
    )


def _overview(results: Results) -> Figure:
    """The plain and the robust system where there are such, under the first condition: undisturbed."""
    names = [condition.name for condition in results.conditions]
    condition = UNDISTURBED if UNDISTURBED in names else names[0]
    labels = [name for name in results.controllers if name in ("lpvds", "clpvds robust")] or results.controllers
    panels = []
    for point in results.points:
        rollouts: dict[str, list[Array]] = {name: [] for name in labels}
        for r in point.rollouts:
            if r.condition == condition and r.label in labels:
                rollouts[r.label].append(r.p_hat)
        motion = Motion(
            name=point.name,
            demonstrations=[t.position for t in point.midpoints.trajectories],
            rollouts=rollouts,
            goal=point.midpoints.goal,
        )
        drawn = sum(len(paths) for paths in rollouts.values())
        alt = f"{motion.name}: {len(motion.demonstrations)} demonstrations, {drawn} roll-outs."
        panels.append(Panel(svg=motion_panel(motion), alt=alt))
    covered = " Where a thin line covers a wide one, both controllers go the same way." if len(labels) > 1 else ""
    return Figure(
        panels=tuple(panels),
        columns=COLUMNS,
        legend=(*controller_keys(labels), Key(label="demonstrations", colour="faint")),
        caption=f"All {len(panels)} {results.points_word}, {condition_name(condition)}, each to its own scale."
        + covered,
    )


def recovery_section(results: Results) -> Section | None:
    """Why it recovers: one pushed roll-out of each coupled controller. None where there is no such roll-out."""
    shown = results.shown
    for condition in farthest(results.conditions):
        cases = [r for r in shown.rollouts if r.condition == condition.name and r.displaced > 0]
        if any(r.controller != "lpvds" for r in cases):
            return _recovery(results, condition, cases)
    return None


def _recovery(results: Results, condition: Condition, cases: list[RecordedRollout]) -> Section:
    shown = results.shown
    demo = next(r.demo for r in cases if r.controller != "lpvds")
    same = {r.label: _case(r, shown) for r in cases if r.demo == demo}
    plain = same.pop("lpvds", None)
    top = 1.08 * MM * max(float(case.gap.max()) for case in same.values())
    panels = []
    for name, case in same.items():
        waited = float(np.count_nonzero(~case.gate[:-1]) * (case.time[1] - case.time[0]))
        alt = (
            f"{controller_name(name)}: the distance of the executed state from x rises to "
            f"{number(float(case.gap.max()) * MM)} mm and falls again; x waits for {number(waited)} s in all."
        )
        panels.append(Panel(svg=recovery_panel(case, plain, controller_name(name), top, len(same)), alt=alt))
    sentences = [
        f"{shown.name}, demonstration {demo}, {condition_name(condition.name)} "
        f"({said(condition)}). Above: how far the executed state is from x."
    ]
    if any(case.tolerance > 0 for case in same.values()):
        sentences.append("Dotted: the tolerance of the gate, and its double, where it closes.")
    sentences.append(
        "Below: V of x. While the gate is closed x stands still and V with it; the push does not enter it."
    )
    if plain is not None:
        sentences.append("Plain LPV-DS has no state apart: the push moves x itself, and V with it.")
    figure = Figure(
        panels=tuple(panels),
        columns=min(MOST_COLUMNS, len(panels)),
        legend=(
            *controller_keys([*(["lpvds"] if plain is not None else []), *same]),
            Key(label="gate closed: x waits", colour="faint", mark="area"),
        ),
        caption=" ".join(sentences),
    )
    return Section(id="recovery", title="Why it recovers", blocks=(figure,))


def _case(rollout: RecordedRollout, shown: PointResults) -> Case:
    return Case(
        label=rollout.label,
        time=rollout.time,
        gap=np.linalg.norm(rollout.p_hat - rollout.x, axis=1),
        gate=rollout.gate,
        lyapunov=rollout.lyapunov,
        tolerance=shown.resolved.couplings.get(rollout.label, {}).get("gate", 0.0),
    )
