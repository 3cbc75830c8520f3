"""Tables of methods of avoidance: how roll-outs among obstacles end, by method and system. Rows in, tables out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.report import Table
from stages.evaluate.summary import COLLISIONS, group
from stages.figures.intervals import SHARES, brackets, mean_cell, share, spread_cell, tally
from stages.figures.numbers import MISSING, MM, given, kind_name, method_title, number
from stages.figures.results import PointResults, Results
from stages.policy.avoidance.parameters import ApfParameters, Avoidance
from stages.policy.avoidance.shapes import REACH, distance_at
from stages.policy.outcome import Outcome
from stages.rollout.cases import method_name

REFUSED = (Outcome.GOAL_INSIDE, Outcome.START_INSIDE, Outcome.SWALLOWED)
"""Outcomes of roll-outs that never began: they do not count."""

Rows = Sequence[Mapping[str, Any]]


def methods_table(results: Results, undisturbed: Results | None) -> Table:
    """How roll-outs end, by method: the paper's Fig. 4 in numbers."""
    plain, unit = _durations(undisturbed), "point" if results.is_sweep else ""
    rows = []
    conditions = [condition.name for condition in results.conditions]
    for condition in conditions if len(conditions) > 1 else [""]:
        for method in methods_of(results):
            found = [r for r in results.rows if r["avoidance"] == method and condition in ("", r["condition"])]
            if found:
                rows.append((*((condition,) if condition else ()), method_title(method), *_cells(found, plain, unit)))
    sizes = (results.points_word, len(results.points)) if unit else ("roll-outs", len(results.rows))
    return Table(
        caption="How roll-outs among obstacles end, by method. Shares are of the roll-outs that could begin. Time: "
        "against the same start without obstacles, of those that arrive, mean; so is DTW. Flagged: with steps on which "
        f"no velocity kept clear. {brackets(*sizes)}.",
        columns=(
            *(("condition",) if len(conditions) > 1 else ()),
            "method",
            "roll-outs",
            "collided",
            "converged without collision",
            "trapped",
            "out of time",
            "refused",
            "flagged",
            "largest rise of V [mm²]",
            "least clearance [mm]",
            "time [x]",
            "DTW [mm]",
        ),
        rows=tuple(rows),
    )


def _cells(rows: Rows, plain: Mapping[tuple[str, str, str], float], unit: str) -> tuple[str, ...]:
    """Cells of a method; `unit`: column by which roll-outs are resampled, "": each alone."""
    begun = [r for r in rows if r["outcome"] not in REFUSED]
    refused = len(rows) - len(begun)
    if not begun:
        return ("0", *([MISSING] * 4), number(refused), *([MISSING] * 5))
    arrived = [r for r in begun if r["outcome"] == Outcome.ARRIVED]
    timed = [r for r in arrived if (r["point"], r["dataset"], r["demo"]) in plain]
    ratios = [r["duration_s"] / plain[r["point"], r["dataset"], r["demo"]] for r in timed]
    clear = [r["clearance_min_mm"] for r in begun if r["clearance_min_mm"] is not None]
    return (
        number(len(begun)),
        share(sum(r["outcome"] in COLLISIONS for r in begun), len(begun)),
        share(len(arrived), len(begun)),
        number(sum(r["outcome"] == Outcome.TRAPPED for r in begun)),
        number(sum(r["outcome"] in (Outcome.TIMEOUT, Outcome.DIVERGED) for r in begun)),
        number(refused) if refused else MISSING,
        number(sum(r["flagged_steps"] > 0 for r in begun)),
        number(max(r["lyapunov_rise_max"] for r in begun) * MM**2),
        number(min(clear)) if clear else MISSING,
        spread_cell(ratios, [r[unit] for r in timed] if unit else range(len(timed)), "time"),
        mean_cell(arrived, "dtw_mm", 4, unit=unit),
    )


def _durations(undisturbed: Results | None) -> dict[tuple[str, str, str], float]:
    """Seconds of the undisturbed roll-outs without obstacles, by point and start."""
    if undisturbed is None:
        return {}
    found = group(
        (r for r in undisturbed.rows if r["displaced_step"] is None and r["outcome"] == Outcome.ARRIVED),
        lambda r: (r["point"], r["dataset"], r["demo"]),
    )
    return {(str(a), str(b), str(c)): float(members[0]["duration_s"]) for (a, b, c), members in found.items()}


def methods_of(results: Results) -> list[str]:
    """Names of the methods, in the order of the roll-outs."""
    return list(dict.fromkeys(row["avoidance"] for row in results.rows))


def declared(results: Results) -> dict[str, Avoidance]:
    """Methods by name, of the shown point."""
    return {method_name(method): method for method in results.shown.rollout_parameters.avoidances}


def systems_tables(results: Results) -> tuple[Table, ...]:
    """Collided, and converged without collision, by dimension and system; none where all points are alike in these."""
    kinds = group(results.rows, lambda row: _system(results, row["point"]))
    if len(kinds) < 2:
        return ()
    methods = methods_of(results)
    tables = []
    for said, outcomes in (("converged without collision", (Outcome.ARRIVED,)), ("collided", COLLISIONS)):
        rows = []
        for (dimension, linear), members in sorted(kinds.items(), key=lambda item: (item[0][0], not item[0][1])):
            for condition in dict.fromkeys(row["condition"] for row in members):
                cells = []
                for method in methods:
                    own = [r for r in members if (r["avoidance"], r["condition"]) == (method, condition)]
                    begun = [r for r in own if r["outcome"] not in REFUSED]
                    cells.append(share(sum(r["outcome"] in outcomes for r in begun), len(begun)))
                rows.append((f"{dimension}-D", "linear, K = 1" if linear else "LPV-DS", condition, *cells))
        tables.append(
            Table(
                caption=f"By dimension and system: {said}, of the roll-outs that could begin. {SHARES}",
                columns=("dimension", "system", "condition", *(method_title(method) for method in methods)),
                rows=tuple(rows),
            )
        )
    return tuple(tables)


def _system(results: Results, point: str) -> tuple[int, bool]:
    """Dimension, and whether the system is linear."""
    found = next(p for p in results.points if p.point.id == point)
    return found.model.dimension, found.model.mixture.components == 1


def range_table(results: Results) -> Table | None:
    """When a potential field misses the goal: by its range, and whether an obstacle's range holds the goal."""
    fields = {name: method for name, method in declared(results).items() if isinstance(method, ApfParameters)}
    if not fields:
        return None
    rows = []
    for name, method in fields.items():
        cells = []
        inside = {True: [0, 0], False: [0, 0]}
        for point in results.points:
            for row in point.rows:
                if row["avoidance"] == name and row["outcome"] not in (*REFUSED, *COLLISIONS):
                    counted = inside[_holds_goal(point, row["scene"], method.range)]
                    counted[0] += 1
                    counted[1] += row["outcome"] != Outcome.ARRIVED
        for holds in (True, False):
            total, missed = inside[holds]
            cells += [number(total), share(missed, total)]
        reach = "the obstacle's radius" if method.range is None else f"{given(method.range * MM)} mm"
        rows.append((method_title(name), reach, *cells))
    return Table(
        caption=f"When the potential field misses the goal. Missed: neither arrived nor collided. {SHARES}",
        groups=(("", 2), ("goal within range of an obstacle", 2), ("goal out of range of all", 2)),
        columns=("method", "range", "roll-outs", "missed", "roll-outs", "missed"),
        rows=tuple(rows),
    )


def _holds_goal(point: PointResults, scene: str, reach: float | None) -> bool:
    """Whether the goal lies within the range of an obstacle that stands."""
    shapes, normal = point.scenes[scene].shapes, np.empty(point.model.dimension)
    return any(
        distance_at(shapes, k, point.model.goal, normal) < (shapes.measures[k, REACH] if reach is None else reach)
        for k in range(shapes.number)
        if not shapes.velocities[k].any()
    )


def traps_table(results: Results) -> Table | None:
    """By kind of dynamics: scenes with traps, roll-outs of ROAS+ that met one, and how they ended; none: no scenes."""
    names = [name for name, method in declared(results).items() if method.kind == "roas+"]
    if not names:
        return None
    rows = []
    for kind in results.kinds:
        of_kind = results.of_kind(kind)
        for name in names:
            begun = [r for r in of_kind.rows if r["avoidance"] == name and r["outcome"] not in REFUSED]
            if not begun:
                continue
            entered = {(r["point"], r["scene"]) for r in begun}
            scenes = [s for p in of_kind.points for s in p.scenes.values() if (p.point.id, s.name) in entered]
            traps = [scene.traps.shape[0] for scene in scenes if scene.traps is not None]
            complete = all(scene.complete for scene in scenes)
            rows.append(
                (
                    kind_name(kind),
                    method_title(name),
                    tally(sum(n > 0 for n in traps), len(traps)),
                    number(sum(traps)) + ("" if complete else " (sampled)"),
                    number(len(begun)),
                    number(sum(r["outcome"] == Outcome.TRAPPED for r in begun)),
                    number(sum(r["detour_steps"] > 0 for r in begun)),
                    share(sum(r["outcome"] == Outcome.ARRIVED for r in begun), len(begun)),
                    number(sum(r["outcome"] in COLLISIONS for r in begun)),
                )
            )
    return Table(
        caption="Traps: minima of V on an obstacle, from which no velocity brings V down. Found before the roll-outs: "
        "of spheres and a quadratic V all of them, else by sampling surfaces. A detour leaves a trap; V rises on its "
        f"way, and is lower at its end. {SHARES}",
        columns=(
            "dynamics",
            "method",
            "scenes with traps",
            "traps",
            "roll-outs",
            "trapped",
            "with a detour",
            "converged without collision",
            "collided",
        ),
        rows=tuple(rows),
    )
