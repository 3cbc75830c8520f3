"""Tables of boxes with one arm pushed: what each part of the strategy is good for. Paper Fig. 5d. Rows in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.report import Table
from stages.evaluate.force import BAND
from stages.evaluate.pushed import AWAY
from stages.figures.carry_cases import Held, asks, difference
from stages.figures.carry_tables import largest
from stages.figures.intervals import SHARES, brackets, mean_cell, tally
from stages.figures.numbers import MISSING, MM, given, number, percent, span
from stages.rollout.carry_guard import TILTED

SLIPPED = 10.0
"""Millimetres on its pads beyond which a box that was delivered was not held well."""

IN_BAND = 0.95
"""Share of the time in which the forces have to be within the band."""

Rows = Sequence[dict[str, Any]]


def held_well(row: dict[str, Any]) -> bool:
    """Whether a box was delivered, never tilted by more than 10 degrees, and never slipped by more than 10 mm."""
    return bool(row["delivered"]) and row["tilt_max_deg"] < TILTED and row["slip_max_mm"] < SLIPPED


def in_band(row: dict[str, Any]) -> bool:
    """Whether both forces were within the band for nearly all of the time in which the box was carried."""
    return row["band_fraction"] is not None and row["band_fraction"] >= IN_BAND


def named_right(row: dict[str, Any]) -> bool:
    """Whether the arms that truly were pushed were taken for pushed, and no other."""
    return bool(row["named"] == row["pushed"])


def false_alarm(row: dict[str, Any]) -> bool:
    """Whether an arm was taken for pushed though nobody pushed."""
    return row["pushed"] is None and row["named"] is not None


def changed(row: dict[str, Any]) -> str:
    """What a roll-out, from its row, does otherwise than the robust form, in words for a column of them."""
    told = difference(row)
    return "nothing" if told == MISSING else told


def ablations_table(groups: Sequence[Held]) -> Table:
    """What became of boxes, by what was left out of the strategy: those that were pushed, and at first one calm case.

    Further calm cases are about what is known of the box, and say nothing of the strategy.
    """
    calm = [held for held in groups if not held.pushed][:1]
    rows = []
    for held in [*calm, *(held for held in groups if held.pushed)]:
        pushed = sum(row["pushed"] is not None for row in held.rows)
        rows.append(
            (
                held.name,
                changed(held.rows[0]),
                number(pushed) if held.pushed else MISSING,
                tally(sum(bool(row["delivered"]) for row in held.rows), len(held.rows)),
                tally(sum(map(held_well, held.rows)), len(held.rows)),
                tally(sum(map(in_band, held.rows)), len(held.rows)),
                _most(held.rows, "tilt_max_deg"),
                _most(held.rows, "slip_max_mm"),
            )
        )
    low, high = (given(share * groups[0].given[0]) for share in BAND)
    return Table(
        caption="Ablations: the same boxes, each time with one part of the strategy left out, or as printed. Pushed: "
        "how many were, as some are lost before; a dash: nobody was to be. Held well: delivered, never tilted by "
        f"{given(TILTED)} degrees nor slipped by {given(SLIPPED)} mm. In the band: both forces within {low} to {high} "
        f"N for {percent(IN_BAND)} of the time in which the box was carried, delivered or not. {SHARES}",
        groups=(("", 3), ("boxes", 3), ("largest", 2)),
        columns=(
            "condition",
            "what is different",
            "pushed",
            "delivered",
            "held well",
            "in the band",
            "tilt [deg]",
            "slip [mm]",
        ),
        rows=tuple(rows),
    )


def following_table(groups: Sequence[Held]) -> Table:
    """Who was taken for pushed, and what waited for whom, by what was left out of the strategy."""
    rows = []
    for held in groups:
        pushed = [row for row in held.rows if row["pushed"] is not None]
        told = [row for row in pushed if asks(row)]
        calm = [row for row in held.rows if row["pushed"] is None and asks(row)]
        rows.append(
            (
                held.name,
                changed(held.rows[0]),
                tally(sum(map(named_right, told)), len(told)),
                tally(sum(map(false_alarm, calm)), len(calm)),
                _most(pushed, "deviation_max_mm"),
                _most(pushed, "moved_while_away_mm"),
                _most(pushed, "box_back_mm"),
                mean_cell(pushed, "recovery_s"),
            )
        )
    return Table(
        caption="Who was pushed, and how far everything went. Named right: the pushed arm was taken for pushed, and no "
        "other; false alarms: an arm was, though nobody pushed; a dash: nobody asks, or nobody was pushed. Away: the "
        f"pads' midpoint, beside x; x moved: while that was more than {given(AWAY * MM)} mm; box back: how far it was "
        "from its place beside x when x went on after waiting. Recovery: from the push's end until x moved, mean. "
        f"Where x does not wait it is what is commanded, and goes along. {brackets('roll-outs', largest(groups))}",
        groups=(("", 2), ("roll-outs", 2), ("largest [mm]", 3), ("", 1)),
        columns=(
            "condition",
            "what is different",
            "named right",
            "false alarms",
            "away",
            "x moved",
            "box back",
            "recovery [s]",
        ),
        rows=tuple(rows),
    )


def pushes_table(groups: Sequence[Held]) -> Table:
    """Every roll-out in which arms were to be pushed: how, and what came of it."""
    several = len({point.point.id for held in groups for point in held.points}) > 1
    rows = []
    for held in groups:
        for row, recorded in zip(held.rows, held.rollouts, strict=True):
            asked = [] if recorded.carry is None else recorded.carry.facts["pushes"]
            rows.append(
                (
                    f"{row['point']}: {row['rollout']}" if several else row["rollout"],
                    "; ".join(f"{push['arm']} {pushed_by([push])}" for push in asked),
                    row["pushed"] or "never",
                    (row["named"] or "nobody") if asks(row) else MISSING,
                    row["outcome"],
                    *(number(row[name]) for name in ("tilt_max_deg", "slip_max_mm")),
                    MISSING if row["band_fraction"] is None else percent(row["band_fraction"]),
                    *(number(row[name]) for name in ("deviation_max_mm", "moved_while_away_mm", "box_back_mm")),
                    number(row["recovery_s"]),
                )
            )
    return Table(
        caption=f"The {len(rows)} roll-outs with pushes one by one. Recovery: from the push's end until x moved again",
        columns=(
            "roll-out",
            "push",
            "pushed",
            "named",
            "outcome",
            "tilt [deg]",
            "slip [mm]",
            "in the band",
            "away [mm]",
            "x moved [mm]",
            "box back [mm]",
            "recovery [s]",
        ),
        rows=tuple(rows),
        collapsed=True,
    )


def pushed_by(pushes: Sequence[dict[str, Any]]) -> str:
    """How arms were pushed, in words; `pushes`: as facts keep them."""
    drags = [push for push in pushes if not any(push["force"])]
    forces = [push for push in pushes if any(push["force"])]
    parts = []
    if drags:
        far = span([float(np.linalg.norm(push["offset"])) * MM for push in drags])
        rise, all_ = (span([share(push) for push in drags]) for share in (lambda p: p["rise"], _lasting))
        parts.append(f"dragged {far} mm away within {rise} s, let go after {all_} s")
    if forces:
        strength = span([float(np.linalg.norm(push["force"])) for push in forces])
        parts.append(f"{strength} N for {span([_lasting(push) for push in forces])} s")
    return "; ".join(parts)


def _lasting(push: dict[str, Any]) -> float:
    return float(push["rise"] + push["hold"])


def _most(rows: Rows, name: str) -> str:
    return number(max((row[name] for row in rows if row[name] is not None), default=None))
