"""The report's sections, in order, and its head.

Results in, sections out. The other sections have modules of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pipeline.report import Block, Code, Paragraph, Section
from stages.evaluate.summary import by_condition
from stages.figures.accuracy_section import accuracy_section
from stages.figures.animation import carry_animation
from stages.figures.carry_section import carry_section, carry_sentence
from stages.figures.certificates_section import certificates
from stages.figures.estimates_section import estimates_section
from stages.figures.kinds_section import kinds_section, kinds_sentence
from stages.figures.numbers import (
    UNDISTURBED,
    condition_name,
    controller_name,
    joined,
    kind_name,
    number,
    percent,
)
from stages.figures.obstacles_section import obstacles_section, obstacles_sentence
from stages.figures.pots_section import pots_section, pots_sentence
from stages.figures.pushed_section import pushed_section, pushed_sentence
from stages.figures.record_sections import deviations_section, parameters, provenance
from stages.figures.recordings_section import recordings_section
from stages.figures.results import Results, label
from stages.figures.rollout_sections import recovery_section, rollouts_section
from stages.figures.sampler_section import sampler_section
from stages.figures.tables import facts, metrics


def lead(results: Results) -> list[Block]:
    """The head: description, the result in a sentence, how to get it again."""
    experiment = results.experiment
    points = results.carrying(arms=False)
    free = None if points is None else points.own.part(among=False)
    arms = results.own.carrying(arms=True)
    sentences = [
        pushed_sentence(arms),
        pots_sentence(arms),
        carry_sentence(arms),
        "" if points is None else obstacles_sentence(points),
        "" if points is None else kinds_sentence(points),
        "" if free is None else result_sentence(free.rows),
    ]
    about = experiment.description or "An experiment without a description."
    if experiment.overridden:
        about = f"{about.rstrip('.')}. Options of the command changed it for this report, see below."
    commands = [experiment.command("run"), experiment.command("report"), experiment.command("inspect")]
    if not experiment.overridden:  # a manifest is that of the file as it is
        commands.insert(1, experiment.command("verify"))
    return [
        Paragraph(text=about),
        Paragraph(text=" ".join(sentence for sentence in sentences if sentence)),
        Code(text="\n".join(commands)),
    ]


def sections(results: Results) -> list[Section]:
    """All sections, in order; those that show one kind of dynamics of several say which in their title.

    Where arms carry a box, those of roll-outs of a point are left out.
    """
    own, points = results.own, results.carrying(arms=False)
    free = None if points is None else points.own.part(among=False)
    without = (rollouts_section, accuracy_section, metrics, recovery_section, facts)
    shown = [
        recordings_section(own),
        *(section(free) for section in without if free is not None),
        certificates(own),
        sampler_section(own),
        deviations_section(own),
    ]
    kinds = None if points is None else kinds_section(points)
    if kinds is not None:
        of_kind = f" \u00b7 {kind_name(results.kind)}"
        shown = [section and replace(section, title=section.title + of_kind) for section in shown]
    obstacles = None if points is None else obstacles_section(points)
    made = [
        *_of_arms(own.carrying(arms=True)),
        obstacles,
        kinds,
        *shown,
        parameters(results),
        provenance(results),
    ]
    return [section for section in made if section is not None]


def _of_arms(arms: Results | None) -> list[Section]:
    """What shows two arms that carry a box, a moving picture first; nothing where none do."""
    if arms is None:
        return []
    made = [pushed_section(arms), pots_section(arms), carry_section(arms), estimates_section(arms)]
    first, *others = [section for section in made if section is not None]
    return [replace(first, blocks=(carry_animation(arms.shown), *first.blocks)), *others]


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
