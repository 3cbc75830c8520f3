"""The report's section of Fig. 3: error by condition and controller, and what a push changes.

Results in, a section out. How it is drawn and counted: `accuracy.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.report import Block, Figure, Panel, Section, Table
from stages.evaluate.summary import group, mean
from stages.figures.accuracy import Bar, Change, bar_panel, changes, highest
from stages.figures.intervals import FEW, with_interval
from stages.figures.numbers import MISSING, UNDISTURBED, condition_name, controller_name, number, percent
from stages.figures.results import PointResults, Results, label
from stages.figures.style import controller_keys

MULTI_MODELS = "Multi_Models"
"""LASA's motions with several branches: the demonstrations for training show only one of them."""

MEASURES = (
    ("sea_per_step_mm2", "swept area a step [mm²]", "DTWD, eq. (26)"),
    ("dtw_mm", "dynamic time warping [mm]", "DTW"),
)
"""Column of metrics.parquet, title of the axis, title of the panel."""


def accuracy_section(results: Results) -> Section:
    """Fig. 3: error by condition and controller, with and without the motions of several branches."""
    count = len(results.points)
    single = [point for point in results.points if not point.name.startswith(MULTI_MODELS)]
    choices: dict[str, Sequence[PointResults]] = {"": results.points}
    if 0 < len(single) < count:
        without = f", without {count - len(single)} {MULTI_MODELS}"
        choices = {f", all {count}": results.points, without: single}
    drawn = {(name, note): _bars(results, points, name) for note, points in choices.items() for name, _, _ in MEASURES}
    panels = []
    for note in choices:
        for name, axis, title in MEASURES:
            bars = drawn[name, note]
            top = max(highest(drawn[name, other]) for other in choices)
            alt = f"Bars, {axis}{note}: {_listed(bars)}."
            panels.append(Panel(svg=bar_panel(bars, title + note, axis, top, 2), alt=alt))
    values = drawn["dtw_mm", next(iter(choices))][0].values.shape[0]
    units = results.points_word if results.is_sweep else "demonstrations"
    if values >= FEW:
        marks = f"Lines: 95 % intervals of the mean over {units} (bootstrap)."
    else:
        marks = f"Dots: the {values} {units}."
    figure = Figure(
        panels=tuple(panels),
        columns=2,
        legend=controller_keys(results.controllers, "box"),
        caption="Mean error of the executed path, its excursion included. DTWD, as the paper calls it, is "
        f"eq. (26), the area between the paths a step. DTW is dynamic time warping. {marks}",
    )
    blocks: list[Block] = [figure]
    names = [condition.name for condition in results.conditions]
    if UNDISTURBED in names and len(names) > 1:
        first = next(iter(choices))
        blocks.append(_changes(results, {name: drawn[name, first] for name, _, _ in MEASURES}, units))
    return Section(id="accuracy", title="Accuracy (Fig. 3)", blocks=tuple(blocks))


def _listed(bars: Sequence[Bar]) -> str:
    return "; ".join(
        f"{controller_name(bar.controller)}, {condition_name(bar.condition)}: {number(float(bar.values.mean()))}"
        for bar in bars
    )


def _bars(results: Results, points: Sequence[PointResults], measure: str) -> list[Bar]:
    """For every controller and condition one value a point of a sweep, or one a demonstration."""
    unit = "point" if results.is_sweep else "demo"
    rows = [row for point in points for row in point.rows]
    bars = []
    for (controller, condition), members in group(rows, lambda row: (label(row), row["condition"])).items():
        parts = group(members, lambda row: (row[unit],))
        values = [mean(row[measure] for row in part) for part in parts.values()]
        bars.append(Bar(controller=controller, condition=condition, values=np.array(values, dtype=np.float64)))
    return bars


def _changes(results: Results, bars: Mapping[str, Sequence[Bar]], units: str) -> Table:
    conditions = [condition.name for condition in results.conditions if condition.name != UNDISTURBED]
    found = {
        (name, change.controller, change.condition): change
        for name, drawn in bars.items()
        for change in changes(drawn, UNDISTURBED)
    }
    rows = tuple(
        (controller_name(controller), title, *(change_cell(found.get((name, controller, c))) for c in conditions))
        for name, _, title in MEASURES
        for controller in results.controllers
    )
    intervals = any(change.low is not None for change in found.values())
    note = f" In brackets: 95 % interval over {units} (bootstrap of pairs)." if intervals else ""
    return Table(
        caption=f"Change of the mean error against the same controller undisturbed.{note}",
        columns=("controller", "error", *(condition_name(name) for name in conditions)),
        rows=rows,
    )


def change_cell(change: Change | None) -> str:
    """A change as a table says it: a percentage, and its interval where there is one."""
    if change is None:
        return MISSING
    ends = [percent(end, sign=True) for end in (change.low, change.high) if end is not None]
    return with_interval(percent(change.ratio, sign=True), ends or None)
