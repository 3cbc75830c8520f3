"""The report's sections of how it came about: certificates, deviations, parameters, provenance.

Results in, sections out.
"""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.report import Paragraph, Section, Table
from pipeline.values import flatten, plain
from stages.artifacts.dynamics import read_components
from stages.figures.deviations import deviations
from stages.figures.numbers import (
    MISSING,
    MM,
    cell,
    given,
    number,
)
from stages.figures.results import Results

SHORT = 12
"""Characters of a digest that are shown: enough to tell them apart and to find them."""


def certificates(results: Results) -> Section:
    """Certificates and solver reports, one row a fit."""
    rows = []
    for point in results.points:
        fit = point.fit
        certificate, solver = fit.get("certificate", {}), fit.get("solver", {})
        residuals = solver.get("residuals", {})
        worst = max(residuals, key=lambda name: residuals[name]) if residuals else None
        rows.append(
            (
                point.name,
                str(point.model.mixture.components),
                given(certificate["margin"]) if "margin" in certificate else MISSING,
                number(max(c["largest_eigenvalue"] for c in read_components(point.files["dynamics"]))),
                number(certificate.get("shifted")),
                str(solver.get("status", MISSING)),
                number(solver.get("iterations")),
                f"{worst} {number(residuals[worst], 2)}" if worst else MISSING,
                number(fit["rmse"] * MM) if "rmse" in fit else MISSING,
                number(fit.get("relative_rmse")),
            )
        )
    text = Paragraph(
        text="A certificate proves, rounding included, that V falls along every solution: A_{k}^{T}P + P A_{k} is at "
        "most minus the margin for every k. The solver's residuals are recomputed from its answer, without units."
    )
    table = Table(
        caption="Certificate and solver report by fit",
        columns=(
            results.points_word[:-1],
            "K",
            "proved margin [1/s]",
            "largest eigenvalue [1/s]",
            "A_{k} shifted",
            "solver",
            "iterations",
            "largest residual",
            "velocity error [mm/s]",
            "relative",
        ),
        rows=tuple(rows),
        collapsed=results.is_sweep,
    )
    return Section(id="certificates", title="Certificates", blocks=(text, table))


def deviations_section(results: Results) -> Section:
    """Where this run departs from the paper's print."""
    rows = deviations(results.shown.point.parameters, [p.resolved for p in results.points])
    table = Table(
        caption="Only what applies to this experiment's parameters",
        columns=("where", "printed", "here", "why"),
        rows=tuple((row.where, row.printed, row.here, row.why) for row in rows),
    )
    return Section(id="deviations", title="Deviations from the paper's print", blocks=(table,))


def parameters(results: Results) -> Section:
    """All parameters by dotted name; what a sweep varies as the list of its values."""
    experiment = results.experiment
    points = [flatten(plain(p.point.parameters)) for p in results.points]
    names = list(dict.fromkeys(name for values in points for name in values))
    rows = [("preset", experiment.preset)]
    rows.append(("seed", ", ".join(dict.fromkeys(str(p.point.seed) for p in results.points))))
    for name in names:
        rows.append((f"`{name}`", ", ".join(dict.fromkeys(cell(values.get(name)) for values in points))))
    table = Table(
        caption="All parameters, defaults included, in SI units; of a sweep all values. A dash: left to the program",
        columns=("parameter", "value"),
        rows=tuple(rows),
    )
    return Section(id="parameters", title="Parameters", blocks=(table,))


def provenance(results: Results) -> Section:
    """What the results were computed from, by key; and on which machine."""
    stages = list(results.shown.records)
    by_stage = []
    for stage in stages:
        records = [p.records[stage] for p in results.points]
        components = [r["components"] for r in records]
        libraries = ", ".join(f"{name} {version}" for name, version in sorted(components[0]["libraries"].items()))
        seeds = ", ".join(dict.fromkeys(str(c["seed"]) for c in components if c["seed"] is not None))
        code = ", ".join(dict.fromkeys(f"`{c['code'][:SHORT]}`" for c in components))
        by_stage.append((stage, code, libraries, components[0]["python"], seeds or MISSING))
    keys = [
        (
            p.name,
            stage,
            f"`{record['key'][:SHORT]}`",
            ", ".join(f"{name} `{entry['digest'][:SHORT]}`" for name, entry in sorted(record["outputs"].items())),
            number(sum(entry["size"] for entry in record["outputs"].values()) / 1e3),
        )
        for p in results.points
        for stage, record in p.records.items()
    ]
    return Section(
        id="provenance",
        title="Provenance",
        blocks=(
            Table(
                caption="What the keys of each stage stand for, beside parameters and inputs",
                columns=("stage", "code", "libraries", "Python", "seed"),
                rows=tuple(by_stage),
            ),
            Table(
                caption=f"Keys and artifacts (first {SHORT} characters of each sha256)",
                columns=("where", "stage", "key", "artifacts", "size [kB]"),
                rows=tuple(keys),
                collapsed=results.is_sweep,
            ),
            _machine(results, stages),
        ),
    )


def _machine(results: Results, stages: Sequence[str]) -> Table:
    """What the store's action records say about where it was computed."""
    records = [record for p in results.points for record in p.records.values()]
    found: dict[str, list[str]] = {}
    for record in records:
        for name, value in record["environment"].items():
            if name != "packages":
                texts = value if isinstance(value, list) else [value]
                found.setdefault(name, []).extend(str(text) for text in texts if text)
    rows = [(name, ", ".join(sorted(set(values))) or MISSING) for name, values in found.items()]
    seconds = [(stage, sum(p.records[stage]["seconds"] for p in results.points)) for stage in stages]
    rows.append(("computed in", ", ".join(f"{stage} {number(value)} s" for stage, value in seconds)))
    return Table(caption="This machine, which is no part of any key", columns=("", "found"), rows=tuple(rows))
