"""The report's sections, in order; its head; and how the mixture was found.

Results in, sections out. The other sections have modules of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.report import Block, Code, Figure, Panel, Paragraph, Section
from stages.evaluate.summary import by_condition, mean
from stages.figures.accuracy_section import accuracy_section
from stages.figures.numbers import UNDISTURBED, condition_name, controller_name, joined, number, percent
from stages.figures.record_sections import certificates, deviations_section, parameters, provenance
from stages.figures.recordings_section import recordings_section
from stages.figures.results import Results, label
from stages.figures.rollout_sections import recovery_section, rollouts_section
from stages.figures.sampler import sampler_panels
from stages.figures.tables import facts, metrics


def lead(results: Results) -> list[Block]:
    """The head: description, the result in a sentence, how to get it again."""
    experiment = results.experiment
    changed = " Options of the command changed the experiment for this report." if experiment.overridden else ""
    return [
        Paragraph(text=(experiment.description or "An experiment without a description.") + changed),
        Paragraph(text=result_sentence(results.rows)),
        Code(text=f"clpv run {experiment.name}\nclpv verify {experiment.name}"),
    ]


def sections(results: Results) -> list[Section]:
    """All sections, in order."""
    made = [
        recordings_section(results),
        rollouts_section(results),
        accuracy_section(results),
        metrics(results),
        recovery_section(results),
        facts(results),
        certificates(results),
        sampler_section(results),
        deviations_section(results),
        parameters(results),
        provenance(results),
    ]
    return [section for section in made if section is not None]


def result_sentence(rows: Sequence[dict[str, Any]]) -> str:
    """What came out, in plain words, from the rows alone."""
    groups = by_condition(rows)
    arrived, total = sum(g["arrived"] for g in groups), sum(g["rollouts"] for g in groups)
    goals = f"{arrived} of {total} roll-outs reached the goal."
    warped, swept = _changes(groups, "dtw_mm"), _changes(groups, "sea_per_step_mm2")
    if warped:
        parts = [f"by {change} for {controller_name(name)}" for name, change in warped.items()]
        return (
            "Against the same controller undisturbed, a push on the way changes the mean dynamic time warping distance "
            f"to the demonstrations {joined(parts)}; the swept area of eq. (26) by {joined(list(swept.values()))}. "
            + goals
        )
    several = len({g["condition"] for g in groups}) > 1
    means = []
    for g in groups:
        condition = f", {condition_name(g['condition'])}" if several else ""
        means.append(f"{controller_name(label(g))}{condition} {number(g['dtw_mm'], 4)} mm")
    return f"Mean dynamic time warping distance to the demonstrations: {joined(means)}. {goals}"


def _changes(groups: Sequence[dict[str, Any]], measure: str) -> dict[str, str]:
    """For each controller, by how much its mean changes from undisturbed to the other conditions."""
    base = {label(g): g[measure] for g in groups if g["condition"] == UNDISTURBED}
    ratios: dict[str, list[float]] = {}
    for g in groups:
        if g["condition"] != UNDISTURBED and base.get(label(g)):
            ratios.setdefault(label(g), []).append(g[measure] / base[label(g)] - 1.0)
    spans = {}
    for name, values in ratios.items():
        low, high = percent(min(values), sign=True), percent(max(values), sign=True)
        spans[name] = low if low == high else f"{low} to {high}"
    return spans


def sampler_section(results: Results) -> Section:
    """How the mixture of the shown point was found."""
    shown = results.shown
    columns, criterion = shown.sampler
    kind = shown.point.parameters["mixture"].kind
    drawn = sampler_panels(columns["log_posterior"], columns["components"], criterion, kind)
    words = ("what is maximised, step by step", "the number of components")
    panels = tuple(Panel(svg=svg, alt=f"Line: {what}.") for svg, what in zip(drawn, words, strict=False))
    caption = f"{shown.name}: {shown.model.mixture.components} components."
    if results.is_sweep:
        counts = [point.model.mixture.components for point in results.points]
        caption += f" Over all {results.points_word}: {min(counts)} to {max(counts)}, mean {number(mean(counts))}."
    if kind == "pcgmm":
        caption += " The state of highest posterior is kept, then polished on all points."
    figure = Figure(panels=panels, caption=caption, columns=2)
    return Section(id="sampler", title="How the mixture was found", blocks=(figure,))
