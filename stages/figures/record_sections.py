"""The report's sections of how it came about: deviations, parameters, provenance.

Results in, sections out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.report import Section, Table
from pipeline.values import flatten, plain
from stages.figures.deviations import deviations
from stages.figures.numbers import MISSING, cell, kind_name, number
from stages.figures.results import KIND, PointResults, Results

SHORT = 12
"""Characters of a digest that are shown: enough to tell them apart and to find them."""


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
    """All parameters by dotted name, of a sweep the list of all values; by kind of dynamics where kinds differ."""
    experiment = results.experiment
    by_kind = {kind: _values(results.of_kind(kind).points) for kind in results.kinds}
    stages = list(results.shown.point.parameters)
    names = dict.fromkeys(name for values in by_kind.values() for name in values)
    rows = [("preset", experiment.preset)]
    rows.append(("seed", ", ".join(dict.fromkeys(str(p.point.seed) for p in results.points))))
    for name in sorted(names, key=lambda name: stages.index(name.partition(".")[0])):
        found = {kind: values[name] for kind, values in by_kind.items() if name in values}
        of_all = len(found) == len(by_kind) and len(set(found.values())) == 1
        text = ", ".join(found) if name == KIND else found[results.kind] if of_all else _apart(found)
        rows.append((f"`{name}`", text))
    table = Table(
        caption="All parameters, defaults included, in SI units; of a sweep all values. A dash: left to the program",
        columns=("parameter", "value"),
        rows=tuple(rows),
    )
    return Section(id="parameters", title="Parameters", blocks=(table,))


def _values(points: Sequence[PointResults]) -> dict[str, str]:
    """Dotted name -> all values that it has at these points, in order."""
    flat = [flatten(plain(point.point.parameters)) for point in points]
    names = dict.fromkeys(name for values in flat for name in values)
    return {name: ", ".join(dict.fromkeys(cell(values[name]) for values in flat if name in values)) for name in names}


def _apart(found: Mapping[str, str]) -> str:
    """Values by kind of dynamics, as in ``QLF, P-QLF: 0.001; warped: 0.03``."""
    kinds: dict[str, list[str]] = {}
    for kind, value in found.items():
        kinds.setdefault(value, []).append(kind_name(kind))
    return "; ".join(f"{', '.join(names)}: {value}" for value, names in kinds.items())


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
            f"{p.name}, {kind_name(p.kind)}" if len(results.kinds) > 1 else p.name,
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
