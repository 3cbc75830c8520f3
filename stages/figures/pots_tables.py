"""Tables of boxes that were carried round flowerpots, by method of avoidance. Paper Fig. 6. Rows in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.report import Table
from stages.artifacts.rollouts import RecordedCarry
from stages.figures.carry_cases import Held
from stages.figures.carry_tables import largest
from stages.figures.intervals import brackets, mean_cell, tally
from stages.figures.numbers import MISSING, MM, given, method_title, number, span
from stages.figures.pots_cases import method_of
from stages.policy.outcome import Outcome

Row = dict[str, Any]


def went_round(row: Row) -> bool:
    """Whether a box was delivered, its middle outside of every safety sphere, and nothing touched a pot."""
    return bool(row["delivered"]) and row["clearance_min_mm"] >= 0.0 and not touched(row)


def touched(row: Row) -> bool:
    """Whether the box or an arm touched a pot."""
    return bool(row["box_contacts"] or row["arm_contacts"])


def methods_table(groups: Sequence[Held]) -> Table:
    """What became of boxes round pots, by method."""
    rows = []
    for held in groups:
        arrived = [row for row in held.rows if row["delivered"]]
        refused = [carry.facts["refused"] for carry in held.carries]
        rows.append(
            (
                held.name,
                method_title(method_of(held)[1]),
                tally(sum(map(went_round, held.rows)), len(held.rows)),
                tally(len(arrived), len(held.rows)),
                _outcomes(held.rows),
                _least(held.rows, "clearance_min_mm"),
                *(_touches(held.rows, f"{what}_contacts") for what in ("box", "arm")),
                *(_least(held.rows, f"{what}_room_min_mm") for what in ("box", "arm")),
                mean_cell(arrived, "duration_s"),
                span(refused),
            )
        )
    return Table(
        caption="Round a pot, by method. Went round: delivered, the middle of the box outside of every safety sphere, "
        "and nothing touched a pot. A box that is delivered after it has touched one does not count. Least clearance: "
        "of the box's middle from the sphere, negative: inside. Touched: roll-outs in which the box, or an arm, "
        "touched a pot. Least room: between pot and box, pot and arm. Duration: of those delivered, mean. Refused: "
        "scenes of each box that were drawn before, and left no way that the arms can reach. "
        f"{brackets('roll-outs', largest(groups))}",
        groups=(("", 5), ("", 1), ("touched", 2), ("least room [mm]", 2), ("", 2)),
        columns=(
            "condition",
            "method",
            "went round",
            "delivered",
            "ended otherwise",
            "least clearance [mm]",
            "box",
            "arm",
            "box",
            "arm",
            "duration [s]",
            "refused",
        ),
        rows=tuple(rows),
    )


def rounds_table(groups: Sequence[Held]) -> Table:
    """Every roll-out among pots: where they stood, and how near it came."""
    several = len({point.point.id for held in groups for point in held.points}) > 1
    rows = []
    for held in groups:
        for row, carry in zip(held.rows, held.carries, strict=True):
            rows.append(
                (
                    f"{row['point']}: {row['rollout']}" if several else row["rollout"],
                    *_placed(carry),
                    row["outcome"],
                    number(row["clearance_min_mm"]),
                    *(number(row[f"{what}_room_min_mm"]) for what in ("box", "arm")),
                    *(number(row[f"{what}_contacts"]) for what in ("box", "arm")),
                    number(row["duration_s"]),
                    number(carry.facts["refused"]),
                )
            )
    return Table(
        caption=f"The {len(rows)} roll-outs among pots one by one. Touching: cycles of the controller",
        groups=(("", 1), ("pots at the start", 2), ("", 2), ("least room [mm]", 2), ("touching", 2), ("", 2)),
        columns=(
            "roll-out",
            "centre [mm]",
            "r [mm]",
            "outcome",
            "clearance [mm]",
            "box",
            "arm",
            "box",
            "arm",
            "duration [s]",
            "refused",
        ),
        rows=tuple(rows),
        collapsed=True,
    )


def _placed(carry: RecordedCarry) -> tuple[str, str]:
    pots = carry.facts["pots"]
    centres = ["[" + ", ".join(given(float(np.round(c * MM))) for c in pot["centre"]) + "]" for pot in pots]
    return "; ".join(centres), "; ".join(number(pot["radius"] * MM) for pot in pots)


def _touches(rows: Sequence[Row], name: str) -> str:
    return number(sum(bool(row[name]) for row in rows))


def _least(rows: Sequence[Row], name: str) -> str:
    return number(min((row[name] for row in rows if row[name] is not None), default=None))


def _outcomes(rows: Sequence[Row]) -> str:
    counted = Counter(row["outcome"] for row in rows if row["outcome"] != Outcome.ARRIVED)
    return ", ".join(f"{outcome}: {count}" for outcome, count in counted.items()) or MISSING
