"""The report's section on what the arms find out about the box: its length L and its mass, which the paper knows.

Results in, a section out. Only where an experiment makes the controller take the box for another one, or says what it
may find out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.report import Paragraph, Section, Table
from stages.figures.carry_cases import Held, carry_parameters, held_groups
from stages.figures.carry_section import is_plain
from stages.figures.intervals import SHARES, tally
from stages.figures.numbers import MISSING, MM, given, number, span
from stages.figures.results import Results
from stages.policy.estimation import FIRM
from stages.rollout.carry_conditions import mode_of

GRAM = 1e3
"""Grams per kilogram."""


def estimates_section(results: Results | None) -> Section | None:
    """What boxes were taken for, and how they were held; none where no condition asks. `results`: of carrying arms."""
    groups = [] if results is None else [held for held in held_groups(results) if is_plain(held)]
    if not any(_doubts(held) for held in groups):
        return None
    raises = any(carry_parameters(held.points[0]).least_friction for held in groups)
    text = (
        "Eq. (13) takes L for granted, and the arms feed half of the box's weight forward. Found out: L from where the "
        "pads stand when the grip has settled, a little less than the box is long, as pads give way; the mass from "
        "what hangs on the wrists after the lift."
    )
    if raises:
        text += (
            f" From the mass follows the force: F_{{d}} is raised until 2 mu F_{{d}}/(m g) is {given(FIRM)} for the "
            "least friction that pads can count on."
        )
    return Section(
        id="estimates",
        title="What the arms find out about the box",
        blocks=(Paragraph(text=text), estimates_table(groups), grips_table(groups)),
    )


def estimates_table(groups: Sequence[Held]) -> Table:
    """L and mass as they were taken for, at first and in the end, against the truth."""
    rows = []
    for held in groups:
        carries = held.carries
        lengths, masses = [carry.facts["box"][1] * MM for carry in carries], [carry.facts["mass"] for carry in carries]
        rows.append(
            (
                held.name,
                span(lengths, 4),
                span([carry.facts["length_error"] * MM for carry in carries]),
                _yes(finds(held, "length")),
                _range([row["length_error_mm"] for row in held.rows]),
                span(masses),
                *_masses(held),
            )
        )
    return Table(
        caption="What the controller took boxes for, least to most over the boxes. Errors: taken for minus truth; a "
        "mass that is not found out is the one that is fed forward to the end",
        groups=(("", 1), ("L [mm]", 4), ("mass", 4)),
        columns=(
            "condition",
            "truth",
            "error at first",
            "found out",
            "error in the end",
            "truth [kg]",
            "error at first [g]",
            "found out",
            "error in the end [g]",
        ),
        rows=tuple(rows),
    )


def grips_table(groups: Sequence[Held]) -> Table:
    """How boxes were held, by what was known of them."""
    rows = []
    for held in groups:
        ratios = [
            row["grip_ratio"] * row["desired_force_n"] / carry.facts["force"]
            for row, carry in zip(held.rows, held.carries, strict=True)
        ]
        rows.append(
            (
                held.name,
                tally(sum(bool(row["delivered"]) for row in held.rows), len(held.rows)),
                span(held.desired),
                number(min(ratios)),
                _range([row["force_mean_n"] for row in held.rows]),
                *(
                    _range([row[name] for row in held.rows])
                    for name in ("tilt_max_deg", "slip_max_mm", "delivery_error_mm")
                ),
            )
        )
    return Table(
        caption="How the same boxes were held, least to most over the boxes. Least grip ratio: 2 mu F_{d}/(m g) with "
        f"F_{{d}} as it was in the end. {SHARES}",
        columns=(
            "condition",
            "delivered",
            "F_{d} in the end [N]",
            "least grip ratio",
            "mean force [N]",
            "tilt [deg]",
            "slip [mm]",
            "error of delivery [mm]",
        ),
        rows=tuple(rows),
    )


def finds(held: Held, what: str) -> bool | None:
    """Whether ``length`` or ``mass`` is found out; none: the condition is not among the point's."""
    if held.asked is None:
        return None
    told = getattr(held.asked, f"finds_{what}")
    return mode_of(carry_parameters(held.points[0]), held.asked) != "paper" if told is None else bool(told)


def _doubts(held: Held) -> bool:
    """Whether a condition is about what is known of the box."""
    asked = held.asked
    if asked is None:
        return False
    told = bool(asked.finds_length) or asked.finds_mass is not None
    return told or asked.mass_error != 0.0 or asked.length == "demonstrations"


def _masses(held: Held) -> tuple[str, str, str]:
    """Error at first, grams, whether it is found out, error in the end, grams."""
    found = finds(held, "mass")
    if held.asked is None or found is None:
        return MISSING, MISSING, MISSING
    truth = [carry.facts["mass"] for carry in held.carries]
    first = [(max(mass + held.asked.mass_error, 0.0) - mass) * GRAM for mass in truth]
    end = [row["mass_error_g"] for row in held.rows] if found else first
    return _range(first), _yes(found), _range(end)


def _range(values: Sequence[Any]) -> str:
    known = [value for value in values if value is not None]
    return span(known) if known else MISSING


def _yes(told: bool | None) -> str:
    return MISSING if told is None else "yes" if told else "no"
