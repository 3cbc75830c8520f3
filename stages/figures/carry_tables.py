"""Tables of boxes that two arms carried: how many were delivered, how they were held. Paper Figs. 5b, 5c. Rows in."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pipeline.report import Table
from stages.evaluate.force import BAND
from stages.figures.carry_cases import LAWS, Held
from stages.figures.intervals import SHARES, brackets, mean_cell, spread_cell, tally
from stages.figures.numbers import MISSING, MM, given, kind_name, number, percent, span
from stages.policy.estimation import FIRM
from stages.policy.outcome import Outcome

Rows = Sequence[dict[str, Any]]


def delivery_table(groups: Sequence[Held]) -> Table:
    """Delivered, dropped, tilt and slip by how the box was held."""
    heads, lead = _heads(groups)
    rows = []
    for held in groups:
        delivered = [row for row in held.rows if row["delivered"]]
        firm = [row for row in held.rows if row["grip_ratio"] >= FIRM]
        weak = [row for row in held.rows if row["grip_ratio"] < FIRM]
        errors = [r.carry.facts["length_error"] * MM for r in held.rollouts if r.carry is not None]
        rows.append(
            (
                *lead(held),
                span(errors) if errors else MISSING,
                tally(len(delivered), len(held.rows)),
                number(sum(row["dropped"] for row in held.rows)),
                _otherwise(held.rows),
                mean_cell(delivered, "delivery_error_mm"),
                number(_most(delivered, "delivery_error_mm")),
                number(_most(held.rows, "tilt_max_deg")),
                *(cell for part in (firm, weak) for cell in _slip(part)),
            )
        )
    return Table(
        caption="Delivered: let go upright, within 20 mm of the goal; errors are of those. Dropped: fell. Tilt, and "
        "slip on the pads: largest while carried, those that lost the box included. Grip ratio: "
        f"2 mu F_{{d}}/(m g); below {given(FIRM)} a box may creep, and is counted apart. "
        f"{brackets('roll-outs', largest(groups))}",
        groups=(
            ("", len(heads) + 4),
            ("error of delivery [mm]", 2),
            ("", 1),
            (f"grip ratio at least {given(FIRM)}", 2),
            (f"below {given(FIRM)}", 2),
        ),
        columns=(
            *heads,
            "error of L [mm]",
            "delivered",
            "dropped",
            "ended otherwise",
            "mean",
            "largest",
            "tilt [deg]",
            *("boxes", "slip [mm]") * 2,
        ),
        rows=tuple(rows),
    )


def force_table(groups: Sequence[Held]) -> Table:
    """Contact forces by how the box was held."""
    heads, lead = _heads(groups)
    biased = any(row["bias_n"] for held in groups for row in held.rows)
    rows = []
    for held in groups:
        carried = [row for row in held.rows if row["force_mean_n"] is not None]
        means = [row["force_mean_n"] for row in carried]
        beyond = [row["force_mean_n"] + row["bias_n"] for row in carried]
        rows.append(
            (
                *lead(held),
                number(len(carried)),
                span(held.desired),
                span(held.settles) if held.settles else MISSING,
                mean_cell(carried, "force_mean_n"),
                span(means) if means else MISSING,
                *([spread_cell(beyond, range(len(beyond)), "beyond")] if biased else []),
                mean_cell(carried, "force_std_n"),
                number(min((row["force_p5_n"] for row in carried), default=None)),
                number(_most(carried, "force_p95_n")),
                mean_cell(carried, "band_fraction", ratio=True),
                _share(min((row["band_fraction"] for row in carried), default=None)),
            )
        )
    low, high = (given(share * groups[0].given[0]) for share in BAND)
    caption = (
        f"Contact force while carried, as it truly was, both arms pooled. Band: both forces within {low} to {high} N"
    )
    if biased:
        caption += "; beyond the bias: plus the mean bias of the sensors, which the arms cannot know"
    return Table(
        caption=f"{caption}. {brackets('roll-outs', largest(groups), shares=False)}",
        groups=(
            ("", len(heads) + 3),
            ("mean force [N]", 3 if biased else 2),
            ("", 1),
            ("percentiles [N]", 2),
            ("time in the band", 2),
        ),
        columns=(
            *heads,
            "carried",
            "F_{d} [N]",
            "settles at [N]",
            "mean",
            "least to most",
            *(["beyond the bias"] if biased else []),
            "deviation [N]",
            "5th, lowest",
            "95th, highest",
            "mean",
            "least",
        ),
        rows=tuple(rows),
    )


def rollouts_table(groups: Sequence[Held]) -> Table:
    """Every roll-out: what its box was, and what became of it."""
    several = len({point.point.id for held in groups for point in held.points}) > 1
    rows = []
    for held in groups:
        for row, recorded in zip(held.rows, held.rollouts, strict=True):
            facts = {} if recorded.carry is None else recorded.carry.facts
            rows.append(
                (
                    f"{row['point']}: {row['rollout']}" if several else row["rollout"],
                    row["outcome"],
                    number(facts.get("mass")),
                    number(facts.get("friction")),
                    number(row["grip_ratio"]),
                    _signed(facts.get("length_error")),
                    number(row["delivery_error_mm"]),
                    number(row["tilt_max_deg"]),
                    number(row["slip_max_mm"]),
                    *(number(row[f"force_{name}_n"]) for name in ("mean", "std", "p5", "p95")),
                    _share(row["band_fraction"]),
                    number(row["dtw_mm"], 4),
                )
            )
    return Table(
        caption=f"The {len(rows)} roll-outs one by one. DTW: of the pads' midpoint, to the demonstration that starts "
        "nearest",
        columns=(
            "roll-out",
            "outcome",
            "mass [kg]",
            "friction",
            "2 mu F_{d}/(m g)",
            "error of L [mm]",
            "error [mm]",
            "tilt [deg]",
            "slip [mm]",
            "force [N]",
            "deviation [N]",
            "5 % [N]",
            "95 % [N]",
            "in the band",
            "DTW [mm]",
        ),
        rows=tuple(rows),
        collapsed=True,
    )


def failures_table(groups: Sequence[Held]) -> Table | None:
    """How roll-outs ended that did not deliver, and what helps; none: all delivered."""
    rows = []
    for held in groups:
        counted = Counter(row["outcome"] for row in held.rows if row["outcome"] != Outcome.ARRIVED)
        for outcome, count in counted.items():
            remedy = next((o.remedy for o in Outcome if o.value == outcome), "")
            rows.append((held.name, LAWS[held.law], tally(count, len(held.rows)), outcome, remedy))
    if not rows:
        return None
    return Table(
        caption=f"Boxes that were not delivered. {SHARES}",
        columns=("condition", "pressing", "roll-outs", "outcome", "what helps"),
        rows=tuple(rows),
    )


def largest(groups: Sequence[Held]) -> int:
    """Roll-outs of the group that has most."""
    return max(len(held.rows) for held in groups)


def _heads(groups: Sequence[Held]) -> tuple[tuple[str, ...], Callable[[Held], tuple[str, ...]]]:
    """Titles of the first columns, and their cells: only what tells groups apart."""
    varied, kinds = any(held.variant for held in groups), any(held.kind for held in groups)
    titles = ("condition", "pressing", *(["sweep"] if varied else []), *(["dynamics"] if kinds else []))

    def cells(held: Held) -> tuple[str, ...]:
        apart = ([held.variant] if varied else []) + ([kind_name(held.kind)] if kinds else [])
        return (held.condition, LAWS[held.law], *apart)

    return titles, cells


def _otherwise(rows: Rows) -> str:
    counted = Counter(row["outcome"] for row in rows if row["outcome"] != Outcome.ARRIVED)
    return ", ".join(f"{outcome}: {count}" for outcome, count in counted.items()) or MISSING


def _slip(rows: Rows) -> tuple[str, str]:
    return (number(len(rows)), number(_most(rows, "slip_max_mm"))) if rows else (MISSING, MISSING)


def _most(rows: Rows, name: str) -> float | None:
    return max((row[name] for row in rows if row[name] is not None), default=None)


def _share(value: float | None) -> str:
    return MISSING if value is None or math.isnan(value) else percent(value)


def _signed(metres: float | None) -> str:
    if metres is None:
        return MISSING
    return given(float(np.round(metres * MM, 2)))
