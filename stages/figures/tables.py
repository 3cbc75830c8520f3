"""The report's sections of what came out, as tables: metrics and counted facts.

Results in, sections out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.report import Block, Section, Table
from stages.evaluate.summary import KEYS, by_condition, group, mean
from stages.figures.conditions import said
from stages.figures.intervals import FEW, SHARES, brackets, change_interval, mean_cell, of, tally, with_interval
from stages.figures.numbers import (
    MISSING,
    MM,
    UNDISTURBED,
    condition_name,
    controller_name,
    given,
    number,
    span,
)
from stages.figures.results import Results, label
from stages.policy.outcome import Outcome

MEASURES = (
    ("dtw_mm", "DTW [mm]", 4),
    ("dtw_per_step_mm", "DTW/step [mm]", 3),
    ("sea_mm2", "area [mm²]", 3),
    ("sea_per_step_mm2", "DTWD (26) [mm²]", 3),
    ("steps", "steps", 4),
    ("duration_s", "duration [s]", 3),
    ("final_error_mm", "final error [mm]", 2),
    ("recovery_s", "recovery [s]", 2),
)
"""Column of metrics.parquet, its title, significant digits."""


def metrics(results: Results) -> Section:
    """Means by controller and condition; all roll-outs of a single experiment, the motions of a sweep."""
    unit = "point" if results.is_sweep else ""
    groups = group(results.rows, lambda row: tuple(row[name] for name in KEYS)).values()
    rows = tuple(
        (
            controller_name(label(members[0])),
            condition_name(members[0]["condition"]),
            tally(sum(row["outcome"] == Outcome.ARRIVED for row in members), len(members)),
            *(mean_cell(members, name, digits, unit=unit) for name, _, digits in MEASURES),
        )
        for members in groups
    )
    over, most = "roll-outs", max(map(len, groups))
    if results.is_sweep:
        over, most = results.points_word, len(results.points)
    summary = Table(
        caption="Means by controller and condition. Recovery: from the push until x moves again. "
        f"{brackets(over, most)}.",
        columns=("controller", "condition", "arrived", *(title for _, title, _ in MEASURES)),
        rows=rows,
    )
    blocks: list[Block] = [summary]
    if results.is_sweep:
        blocks += [
            _by_point(results, "dtw_mm", "Dynamic time warping by {}, mm", 4),
            _by_point(results, "sea_per_step_mm2", "DTWD, eq. (26), by {}, mm²", 3),
        ]
    else:
        blocks.append(_all_rows(results))
    return Section(id="metrics", title="Metrics", blocks=tuple(blocks))


def _all_rows(results: Results) -> Table:
    return Table(
        caption=f"All {len(results.rows)} roll-outs",
        columns=("roll-out", "outcome", *(title for _, title, _ in MEASURES)),
        rows=tuple(
            (
                row["rollout"],
                row["outcome"],
                *(number(row[name], digits) for name, _, digits in MEASURES),
            )
            for row in results.rows
        ),
        collapsed=True,
    )


def _by_point(results: Results, measure: str, caption: str, digits: int) -> Table:
    conditions = [c.name for c in results.conditions]
    rows = []
    for point in results.points:
        found = {
            key: mean(row[measure] for row in members)
            for key, members in group(point.rows, lambda r: (label(r), r["condition"])).items()
        }
        values = [number(found.get((name, c)), digits) for name in results.controllers for c in conditions]
        rows.append((point.name, str(point.model.mixture.components), *values))
    word = results.points_word[:-1]
    return Table(
        caption=caption.format(word) + " (mean over demonstrations, too few of each for an interval)",
        groups=(("", 2), *((controller_name(name), len(conditions)) for name in results.controllers)),
        columns=(word, "K", *(condition_name(c) for _ in results.controllers for c in conditions)),
        rows=tuple(rows),
        collapsed=True,
    )


def facts(results: Results) -> Section:
    """What can be counted: certificates, arrivals, gates, rises of V."""
    certified = sum("certificate" in p.fit for p in results.points)
    rows = [("Fits with a certificate of stability", of(certified, len(results.points)), "")]
    groups = by_condition(results.rows)
    rise = max(row["lyapunov_rise_max"] for row in results.rows)
    rows.append(
        (
            "Largest rise of V along x in one step",
            f"{number(rise * MM**2)} mm²",
            "It never rose by more than rounding explains." if rise == 0 else "Steps of disturbances are excepted.",
        )
    )
    rows += _energy(results)
    rows += _pace(results)
    rows += _gates(results)
    late = sum(r.displaced < 0 for p in results.points for r in p.rollouts if r.condition in _pushing(results))
    if late:
        rows.append(("Roll-outs that ended before their disturbance", str(late), ""))
    over, most = "demonstrations", len({row["demo"] for row in results.rows})
    if results.is_sweep:
        over, most = results.points_word, len(results.points)
    caption = f"Counted over all roll-outs. {brackets(over, most)}. A certificate is proved, and needs none"
    table = Table(caption=caption, columns=("fact", "found", "remark"), rows=tuple(rows))
    blocks: list[Block] = [table, _arrivals(results, groups)]
    missed = [row for row in results.rows if row["outcome"] != Outcome.ARRIVED]
    if missed:
        blocks.append(_missed(results, missed))
    return Section(id="facts", title="Counted facts", blocks=tuple(blocks))


def _energy(results: Results) -> list[tuple[str, str, str]]:
    """The largest rise of eq. (24), its coupling term included, of each coupled controller."""
    found = []
    for name in results.controllers:
        if name != "lpvds":
            rise = max(row["energy_rise_max"] for row in results.rows if label(row) == name)
            remark = (
                "It never rose by more than rounding explains, disturbances excepted."
                if rise == 0
                else ("x moves while the executed state trails within the gate's tolerance.")
            )
            named = f"Largest rise of V + |p\u0302 \u2212 x|^{{2}}, eq. (24), of {controller_name(name)} in one step"
            found.append((named, f"{number(rise * MM**2)} mm²", remark))
    return found


def _pushing(results: Results) -> set[str]:
    return {c.name for c in results.conditions if c.disturbances}


def _pace(results: Results) -> list[tuple[str, str, str]]:
    """Steps of each coupled controller against the plain one, undisturbed, in pairs of motions or demonstrations."""
    unit = "point" if results.is_sweep else "demo"
    steps: dict[str, dict[Any, float]] = {}
    undisturbed = [row for row in results.rows if row["condition"] == UNDISTURBED]
    for (name, own), members in group(undisturbed, lambda row: (label(row), row[unit])).items():
        steps.setdefault(name, {})[own] = mean(row["steps"] for row in members) or 0.0
    plain = steps.pop("lpvds", {})
    rows = []
    for name, found in steps.items():
        pairs = np.array([(plain[own], value) for own, value in found.items() if own in plain])
        if not pairs.size:
            continue
        before, after = pairs.T
        ends = None
        if after.shape[0] >= FEW:
            ends = [number(1.0 + end, 4) for end in change_interval(before, after, f"steps/{name}")]
        ratio = with_interval(number(float(after.mean() / before.mean()), 4), ends)
        rows.append((f"Steps of {controller_name(name)} to steps of plain LPV-DS, undisturbed", ratio, ""))
    return rows


def _gates(results: Results) -> list[tuple[str, str, str]]:
    """Pushed roll-outs of each coupled controller whose gate never closed, with the reason."""
    rows = []
    pushes = {c.name: said(c) for c in results.conditions if c.disturbances}
    for name in results.controllers:
        pushed = [r for p in results.points for r in p.rollouts if r.label == name and r.displaced >= 0]
        if name == "lpvds" or not pushed:
            continue
        never = [r for r in pushed if r.gate[r.displaced :].all()]
        remark = ""
        if never:
            counted = Counter(r.condition for r in never)
            where = ", ".join(f"{condition_name(c)} {pushes[c]}: {counted[c]}" for c in pushes if counted[c])
            farthest = max(float(np.linalg.norm(r.p_hat[r.displaced] - r.x[r.displaced])) for r in never)
            gates = [2 * p.resolved.couplings[name]["gate"] * MM for p in results.points]
            remark = (
                f"{where}. The push stayed within the gate's tolerance: it left the executed state at most "
                f"{number(farthest * MM)} mm from x, and the gate closes beyond {span(gates)} mm."
            )
        found = tally(len(never), len(pushed))
        rows.append((f"Pushed roll-outs of {controller_name(name)} whose gate never closed", found, remark))
    return rows


def _arrivals(results: Results, groups: Sequence[Mapping[str, Any]]) -> Table:
    conditions = [c.name for c in results.conditions]
    counted = {(label(g), g["condition"]): tally(g["arrived"], g["rollouts"]) for g in groups}
    distance = results.shown.rollout_parameters.stop_distance * MM
    return Table(
        caption=f"Roll-outs that reached the goal (executed state and x within {given(distance)} mm). {SHARES}",
        columns=("controller", *(condition_name(c) for c in conditions)),
        rows=tuple(
            (controller_name(name), *(counted.get((name, c), MISSING) for c in conditions))
            for name in results.controllers
        ),
    )


def _missed(results: Results, rows: Sequence[Mapping[str, Any]]) -> Table:
    names = {p.point.id: p.name for p in results.points}
    return Table(
        caption="Roll-outs that did not reach the goal",
        columns=("where", "roll-out", "outcome", "final error [mm]", "what helps"),
        rows=tuple(
            (
                names[row["point"]],
                row["rollout"],
                row["outcome"],
                number(row["final_error_mm"]),
                next((o.remedy for o in Outcome if o.value == row["outcome"]), ""),
            )
            for row in rows
        ),
    )
