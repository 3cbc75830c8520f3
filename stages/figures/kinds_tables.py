"""Tables that compare kinds of dynamics: errors, what changes, what is proved. Numbers in, tables out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.report import Table
from stages.figures.accuracy import Bar, changes
from stages.figures.accuracy_section import MULTI_MODELS, change_cell
from stages.figures.flow import PLANAR
from stages.figures.intervals import FEW, SHARES, brackets, of, spread_cell, tally
from stages.figures.kinds_compared import MEASURES, Comparison
from stages.figures.numbers import MINUS, MISSING, MM, NO_BREAK, kind_name, number, span
from stages.figures.results import Results
from stages.trajectory import Array

LYAPUNOV = {
    "qlf": (f"|x {MINUS} x_{{g}}|^{{2}}", "nothing, eq. (8): spheres"),
    "pqlf": (f"(x {MINUS} x_{{g}})^{{T}}P(x {MINUS} x_{{g}})", "P: ellipsoids"),
    "warped": ("psi(x)^{T}P psi(x)", "P and psi, a diffeomorphism: bent ellipsoids"),
}
"""V of a kind, and what of it is learned: the shapes on which it is constant."""


def errors(comparison: Comparison) -> Table:
    """Mean, its interval, and median; again without the motions of several branches."""
    rows = []
    for note, choice in _choices(comparison).items():
        for kind, units in choice.units.items():
            cells = []
            for name, _, _, digits in MEASURES:
                values = choice.errors(kind, name)
                cells += [_mean(values, f"{name}/{kind}{note}", digits), number(float(np.median(values)), digits)]
            arrived, rollouts = sum(unit.arrived for unit in units), sum(unit.rollouts for unit in units)
            rows.append((kind_name(kind), f"{len(units)}{note}", *cells, tally(arrived, rollouts)))
    word, many = comparison.word, max(map(len, comparison.units.values()))
    over = "" if word == "demonstrations" else f"Means over demonstrations, then over {word}. "
    branches = (
        f"Of {MULTI_MODELS} the training demonstrations show one branch only." if len(_choices(comparison)) > 1 else ""
    )
    return Table(
        caption=f"Errors by kind of dynamics: {comparison.case.said}. {over}{brackets(word, many)}. {branches}".strip(),
        groups=(("", 2), *((axis, 2) for _, axis, _, _ in MEASURES), ("", 1)),
        columns=("dynamics", word, *(("mean", "median") * len(MEASURES)), "arrived"),
        rows=tuple(rows),
    )


def differences(comparison: Comparison) -> Table:
    """By how much each kind changes the mean errors of the first one, in pairs."""
    first, *others = comparison.kinds
    rows = []
    for note, choice in _choices(comparison).items():
        bars = [
            Bar(controller=name, condition=kind, values=choice.errors(kind, name))
            for name, *_ in MEASURES
            for kind in choice.kinds
        ]
        found = {(change.condition, change.controller): change for change in changes(bars, first)}
        for kind in others:
            cells = [change_cell(found.get((kind, name))) for name, *_ in MEASURES]
            rows.append((kind_name(kind), f"{len(choice.units[kind])}{note}", *cells))
    many = " In brackets: 95 % interval (bootstrap of pairs)." if _many(comparison) else ""
    return Table(
        caption=f"Change of the mean errors against {kind_name(first)}.{many}",
        columns=("dynamics", comparison.word, *(axis.partition(" [")[0] for _, axis, *_ in MEASURES)),
        rows=tuple(rows),
    )


def one_by_one(comparison: Comparison) -> Table:
    """Every error of every unit, the kinds side by side."""
    kinds = comparison.kinds
    names = [unit.name for unit in comparison.units[kinds[0]]]
    cells = [
        [number(float(value), digits) for value in comparison.errors(kind, name)]
        for name, _, _, digits in MEASURES
        for kind in kinds
    ]
    word = comparison.word[:-1]
    return Table(
        caption=f"Errors by {word} and kind of dynamics"
        + ("" if word == "demonstration" else ", means over demonstrations, too few of each for an interval"),
        groups=(("", 1), *((axis, len(kinds)) for _, axis, *_ in MEASURES)),
        columns=(word, *(kind_name(kind) for _ in MEASURES for kind in kinds)),
        rows=tuple(zip(names, *cells, strict=True)),
        collapsed=True,
    )


def proofs(results: Results) -> Table:
    """What of V is learned, what is proved of the system, and what its roll-outs showed under all conditions."""
    rows = []
    for kind in results.kinds:
        own = results.of_kind(kind)
        fits = [point.fit for point in own.points]
        slopes = [slope for fit in fits if (slope := fit["certificate"]["warp_slope"]) is not None]
        V, learned = LYAPUNOV.get(kind, (MISSING, MISSING))
        if own.shown.model.dimension == PLANAR:
            learned = learned.replace("spheres", "circles").replace("ellipsoids", "ellipses")
        rows.append(
            (
                kind_name(kind),
                V.replace(" ", NO_BREAK),
                learned,
                of(sum("certificate" in fit for fit in fits), len(fits)),
                span([point.condition for point in own.points]),
                number(max(slopes)) if slopes else MISSING,
                number(max(row["lyapunov_rise_max"] for row in own.rows) * MM**2),
                tally(sum(row["outcome"] == "arrived" for row in own.rows), len(own.rows)),
            )
        )
    columns = ("dynamics", "V", "learned of it", "certified", "condition of P", "steepest slope of psi")
    return Table(
        caption="What is learned of V and proved of each system; all controllers under all conditions. "
        f"{SHARES}; a certificate is proved, and needs none",
        columns=(*columns, "largest rise of V [mm²]", "arrived"),
        rows=tuple(rows),
    )


def _choices(comparison: Comparison) -> dict[str, Comparison]:
    """All units; and those without motions of several branches, where there are such and others."""
    single = {
        kind: [unit for unit in units if not unit.name.startswith(MULTI_MODELS)]
        for kind, units in comparison.units.items()
    }
    if all(0 < len(single[kind]) < len(units) for kind, units in comparison.units.items()):
        return {"": comparison, f", no {MULTI_MODELS}": replace(comparison, units=single)}
    return {"": comparison}


def _many(comparison: Comparison) -> bool:
    return any(len(units) >= FEW for units in comparison.units.values())


def _mean(values: Array, name: str, digits: int) -> str:
    return spread_cell(values.tolist(), range(values.shape[0]), name, digits)
