"""The report's section of the fits, eqs. (6)-(8): what was learned, the certificate, the solver's report.

Results in, a section out. Numbers are those that the dynamics stage left in the head of dynamics.parquet.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.report import Block, Paragraph, Section, Table
from stages.artifacts.dynamics import read_components
from stages.figures.numbers import MISSING, MM, given, joined, number
from stages.figures.results import PointResults, Results

Row = dict[str, str | float | int | None]

LEARNED = {
    "mixture": "mixture",
    "K": "K",
    "condition": "condition of P",
    "limit": "speed limit [mm/s]",
    "error": "training error [mm/s]",
    "relative": "relative training error",
    "test": "test error [mm/s]",
}
"""What was learned: key of a row -> title of its column. Errors are of the velocity, over every sample."""

PROVED = {
    "margin": "proved margin [1/s]",
    "eigenvalue": "largest eigenvalue [1/s]",
    "shifted": "A_{k} shifted",
    "slope": "steepest slope of psi",
    "status": "solver",
    "form": "form",
    "iterations": "iterations",
    "residual": "largest residual",
    "name": "which",
}
"""What was proved, and the solver's report."""


def certificates(results: Results) -> Section:
    """What was learned and proved, one row a fit; of a sweep also the range over all."""
    rows = [_row(point) for point in results.points]
    blocks: list[Block] = [Paragraph(text=_text(rows))]
    if results.is_sweep:
        blocks += [_ranges(results, rows), Paragraph(text=_counted(results, rows))]
    blocks += [
        _table(
            results,
            rows,
            LEARNED,
            "What was learned, by fit; errors: root mean square velocity error over every sample",
        ),
        _table(results, rows, PROVED, "Certificate and solver report by fit"),
    ]
    return Section(id="certificates", title="Certificates", blocks=tuple(blocks))


def _row(point: PointResults) -> Row:
    """Everything that the tables may show of a fit; none where there is nothing to say."""
    fit: dict[str, Any] = point.fit
    residuals = fit["solver"]["residuals"]
    worst = max(residuals, key=lambda name: residuals[name])
    return {
        "mixture": fit["mixture"],
        "K": point.model.mixture.components,
        "condition": point.condition,
        "limit": None if fit["speed_limit"] is None else fit["speed_limit"] * MM,
        "error": fit["rmse"] * MM,
        "relative": fit["relative_rmse"],
        "test": None if fit["test_rmse"] is None else fit["test_rmse"] * MM,
        "margin": fit["certificate"]["margin"],
        "eigenvalue": max(component["largest_eigenvalue"] for component in read_components(point.files["dynamics"])),
        "shifted": fit["certificate"]["shifted"],
        "slope": fit["certificate"]["warp_slope"],
        "status": fit["solver"]["status"],
        "form": fit["solver"]["form"],
        "iterations": fit["solver"]["iterations"],
        "residual": residuals[worst],
        "name": worst,
    }


def _text(rows: Sequence[Row]) -> str:
    """What a certificate proves: of V in x, or of V in the image of psi."""
    parts = [
        "A certificate proves, rounding included, that V falls along every solution: A_{k}^{T}P + P A_{k} is at most "
        "minus the margin for every k."
    ]
    slopes = [row["slope"] for row in rows if isinstance(row["slope"], float)]
    if slopes:
        parts.append(
            "V = psi(x)^{T}P psi(x) changes along f by psi^{T}(A^{T}P + P A)psi, A the blend of the A_{k}, so that the "
            "same matrices prove the warped system. It needs psi to be one-to-one with psi(x_{g}) = 0: psi is a chain "
            "of translations, each of them one-to-one as its slope stays below 1. The steepest is "
            f"{number(max(slopes))}, rounded up; psi(x_{{g}}) is 0 exactly."
        )
    if any(row["limit"] is not None for row in rows):
        parts.append("The speed limit scales f down, which changes how fast V falls and not whether.")
    parts.append(
        "Form: `gram`, solved in the samples' Gram matrix, whatever their number; `qr`, in the samples themselves, "
        "where the components overlap too much for that. Residuals are recomputed from the answer, without units."
    )
    return " ".join(parts)


def _counted(results: Results, rows: Sequence[Row]) -> str:
    """Which mixtures were taken, which forms of the program were solved, and on how many points each."""
    taken, forms = (_often([str(row[name]) for row in rows]) for name in ("mixture", "form"))
    return f"Number of {results.points_word} by mixture that was taken: {taken}; by form of the program: {forms}."


def _often(names: Sequence[str]) -> str:
    return joined([f"`{name}` {count}" for name, count in Counter(names).most_common()])


def _ranges(results: Results, rows: Sequence[Row]) -> Table:
    """Smallest, median and largest of what is a number."""
    found = []
    for name, title in {**LEARNED, **PROVED}.items():
        values = [value for row in rows if isinstance(value := row[name], int | float)]
        if values:
            median = float(np.median(values))
            found.append((title, *(_cell(name, value) for value in (min(values), median, max(values)))))
    return Table(
        caption=f"Range over all {len(rows)} {results.points_word}; errors: root mean square velocity error",
        columns=("", "smallest", "median", "largest"),
        rows=tuple(found),
    )


def _table(results: Results, rows: Sequence[Row], titles: dict[str, str], caption: str) -> Table:
    """One row a fit; what no fit has is left out."""
    shown = [name for name in titles if any(row[name] is not None for row in rows)]
    return Table(
        caption=caption,
        columns=(results.points_word[:-1], *(titles[name] for name in shown)),
        rows=tuple(
            (point.name, *(_cell(name, row[name]) for name in shown))
            for point, row in zip(results.points, rows, strict=True)
        ),
        collapsed=results.is_sweep,
    )


def _cell(name: str, value: str | float | None) -> str:
    if value is None:
        return MISSING
    if isinstance(value, str):
        return value
    return given(value) if name == "margin" else number(value)
