"""The report's section that compares kinds of dynamics, where an experiment has several. Results in, a section out.

How it is drawn: `kinds.py`, `flow.py`. All other sections show the experiment's own kind alone.
"""

from __future__ import annotations

import numpy as np

from pipeline.report import Block, Figure, Panel, Paragraph, Section
from stages.evaluate.summary import mean
from stages.figures.flow import PLANAR, flow_panel, frame, legend, planes
from stages.figures.kinds import image_path, image_scene, kind_keys, moving_away, strip_panel
from stages.figures.kinds_compared import GAIN, MEASURES, Comparison, compare_kinds
from stages.figures.kinds_tables import differences, errors, one_by_one, proofs
from stages.figures.numbers import UNDISTURBED, joined, kind_name, number, percent
from stages.figures.results import PointResults, Results
from stages.figures.rollout_sections import MOST_COLUMNS, path_of, scene_of
from stages.figures.style import controller_colours, controller_keys


def kinds_section(results: Results) -> Section | None:
    """Kinds of dynamics side by side: errors, motion by motion, and the flow of one motion; none where there is one."""
    if len(results.kinds) < 2:
        return None
    comparison = compare_kinds(results)
    blocks: list[Block] = [_introduction(results), errors(comparison)]
    if comparison.paired:
        blocks += [differences(comparison), _strips(comparison), _flows(results, comparison)]
    blocks.append(proofs(results))
    if comparison.paired:
        blocks.append(one_by_one(comparison))
    return Section(id="kinds", title="Kinds of dynamics", blocks=tuple(blocks))


def kinds_sentence(results: Results) -> str:
    """What the kinds differ in, and which one is shown in the other sections; empty where there is one."""
    if len(results.kinds) < 2:
        return ""
    comparison = compare_kinds(results)
    means = [
        f"{number(float(comparison.errors(kind, GAIN).mean()), 4)} mm under {kind_name(kind)}"
        for kind in comparison.kinds
    ]
    return (
        f"Mean dynamic time warping distance to the demonstrations ({comparison.case.said}): {joined(means)} dynamics. "
        f"All that follows is of {kind_name(results.kind)} dynamics, the experiment's own."
    )


def _introduction(results: Results) -> Paragraph:
    names = joined([kind_name(kind) for kind in results.kinds])
    return Paragraph(
        text=f"The same demonstrations, learned under several Lyapunov functions: {names}. A solution crosses the "
        "level lines of V inwards and never outwards, so that the shapes which V may take bound what can be followed: "
        "under the paper's, no motion that moves away from its goal on its way. All other sections show "
        f"`dynamics.kind = {results.kind}` alone, the experiment's own; parameters and provenance are of all."
    )


def _strips(comparison: Comparison) -> Figure:
    kinds, order = comparison.kinds, comparison.order()
    names = [comparison.units[kinds[0]][index].name for index in order]
    panels = []
    for name, axis, title, digits in MEASURES:
        values = {kind: comparison.errors(kind, name)[order] for kind in kinds}
        means = [f"{kind_name(kind)} {number(float(found.mean()), digits)}" for kind, found in values.items()]
        lower = int(np.count_nonzero(values[kinds[-1]] < values[kinds[0]]))
        alt = (
            f"Dots, {axis}, {len(names)} {comparison.word}. Means: {', '.join(means)}. {kind_name(kinds[-1])} is below "
            f"{kind_name(kinds[0])} on {lower}."
        )
        panels.append(Panel(svg=strip_panel(names, values, title, axis, len(MEASURES)), alt=alt))
    return Figure(
        panels=tuple(panels),
        columns=len(MEASURES),
        legend=kind_keys(kinds),
        caption=f"The same errors one by one, on logarithmic axes. On top: where {kind_name(kinds[-1])} dynamics lower "
        f"the dynamic time warping distance of {kind_name(kinds[0])} most, in millimetres.",
    )


def _flows(results: Results, comparison: Comparison) -> Figure:
    """Flow, level lines of V and roll-outs of the motion with the largest gain, under every kind."""
    case, of_kinds = comparison.case, {kind: results.of_kind(kind) for kind in comparison.kinds}
    several = any(own.is_sweep for own in of_kinds.values())
    index = comparison.order()[0]
    points = {kind: own.points[index if several else 0] for kind, own in of_kinds.items()}
    paths = {kind: [path_of(r) for r in point.rollouts if case.holds(vars(r))] for kind, point in points.items()}
    shown = points[comparison.kinds[0]]
    scene = scene_of(shown)
    planar = scene.goal.shape[0] == PLANAR
    drawn = []
    for kind, point in points.items():
        found = comparison.errors(kind, GAIN)
        title = f"{kind_name(kind)}: DTW {number(float(found[index] if several else found.mean()), 4)} mm"
        over = " over the flow and the level lines of V" if planar else ""
        alt = f"{title}. {len(paths[kind])} roll-outs of {shown.name}{over}."
        drawn.append((scene_of(point), paths[kind], title, alt, list(paths.values())))
    for kind, point in points.items():
        if planar and point.model.warp is not None and case.condition == UNDISTURBED:
            image = [image_path(path, point.model) for path in paths[kind]]
            title = f"{kind_name(kind)}, as psi shows it"
            alt = f"{title}: the same roll-outs in the image of psi, where the level lines of V are ellipses."
            drawn.append((image_scene(scene_of(point), point.model), image, title, alt, [image]))
    columns = MOST_COLUMNS if len(drawn) == MOST_COLUMNS else 2
    series = controller_colours([case.controller])[case.controller]
    plane = planes([*scene.train, *scene.test])[0]
    panels = []
    for below, above, title, alt, together in drawn:
        svg = flow_panel(below, above, title, series, frame(below, together, plane), plane, columns)
        panels.append(Panel(svg=svg, alt=alt))
    return Figure(
        panels=tuple(panels),
        columns=columns,
        legend=(*controller_keys([case.controller]), *legend(scene, [])),
        caption=_flows_caption(shown, comparison, planar=planar),
    )


def _flows_caption(shown: PointResults, comparison: Comparison, *, planar: bool) -> str:
    goal = shown.midpoints.goal
    away = mean(moving_away(t.position, goal) for t in shown.midpoints.of_split("train")) or 0.0
    several = comparison.word != "demonstrations"
    gain = f", where {kind_name(comparison.kinds[-1])} dynamics gain most" if several else ""
    text = (
        f"{shown.name}{gain}. Its training demonstrations move away from the goal on {percent(away)} of their way. "
        f"Roll-outs: {comparison.case.said}. Dots: starts; star: goal."
    )
    if planar:
        text += " Level lines of V are evenly spaced in its square root; the flow crosses all of them inwards."
    if planar and "warped" in comparison.kinds:
        text += " psi straightens the motion part of the way, until ellipses will do; in x they are bent."
    return text
