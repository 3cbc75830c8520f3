"""Errors of several kinds of dynamics on the same motions: what the report compares kinds by. Results in, numbers out.

Not here: how they are shown (`kinds_section.py`, `kinds_tables.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stages.evaluate.summary import group, mean
from stages.figures.numbers import UNDISTURBED, condition_name, controller_name
from stages.figures.results import Results, label
from stages.trajectory import Array

MEASURES = (
    ("velocity_rmse_mm_s", "velocity error [mm/s]", "Velocity error", 3),
    ("sea_mm2", "swept area [mm²]", "Swept area", 3),
    ("dtw_mm", "dynamic time warping [mm]", "DTW", 4),
)
"""Column of metrics.parquet, title of the axis, title of the panel, significant digits."""

GAIN = "dtw_mm"
"""The measure by which motions are ordered, and the one that is drawn is chosen."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Which roll-outs are compared: those of one controller under one condition, from the starts of one split."""

    controller: str
    condition: str
    split: str

    def holds(self, row: Mapping[str, Any]) -> bool:
        """Whether a row of metrics.parquet is one of them."""
        return (label(row), row["condition"], row["split"]) == (self.controller, self.condition, self.split)

    @property
    def said(self) -> str:
        """The same in words."""
        split = {"train": "training"}.get(self.split, self.split)
        return f"{controller_name(self.controller)}, {condition_name(self.condition)}, {split} demonstrations"


@dataclass(frozen=True, kw_only=True)
class Unit:
    """What means are taken over: a motion of a sweep, or a demonstration where there is one motion.

    Attributes:
        name: of the motion or the demonstration.
        partner: the same of what belongs together under all kinds.
        errors: column of metrics.parquet -> mean over the demonstrations.
        arrived, rollouts: how many of how many reached the goal.
    """

    name: str
    partner: tuple[tuple[str, str], ...]
    errors: Mapping[str, float]
    arrived: int
    rollouts: int


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """All kinds on all units.

    Attributes:
        case: which roll-outs.
        units: kind -> units, in the same order under every kind where `paired`.
        word: what the units are called.
    """

    case: Case
    units: Mapping[str, Sequence[Unit]]
    word: str

    @property
    def kinds(self) -> list[str]:
        """Kinds of dynamics, in the order in which they are shown."""
        return list(self.units)

    @property
    def paired(self) -> bool:
        """Whether every kind has the same units."""
        partners = [[unit.partner for unit in found] for found in self.units.values()]
        return all(found == partners[0] for found in partners)

    def errors(self, kind: str, measure: str) -> Array:
        """One error of a kind on every unit, array, shape (n,)."""
        return np.array([unit.errors[measure] for unit in self.units[kind]])

    def order(self) -> list[int]:
        """Indices of the units by how much the last kind lowers the error of the first, in millimetres: most first."""
        gains = self.errors(self.kinds[0], GAIN) - self.errors(self.kinds[-1], GAIN)
        return [int(index) for index in np.argsort(-gains, kind="stable")]


def compare_kinds(results: Results) -> Comparison:
    """The plain controller, undisturbed, from the starts of test demonstrations; else the first of each."""
    conditions = [condition.name for condition in results.conditions]
    splits = list(dict.fromkeys(row["split"] for row in results.rows))
    case = Case(
        controller="lpvds" if "lpvds" in results.controllers else results.controllers[0],
        condition=UNDISTURBED if UNDISTURBED in conditions else conditions[0],
        split="test" if "test" in splits else splits[0],
    )
    of_kinds = {kind: results.of_kind(kind) for kind in results.kinds}
    several = any(own.is_sweep for own in of_kinds.values())
    return Comparison(
        case=case,
        units={kind: _units(own, case, several=several) for kind, own in of_kinds.items()},
        word=results.points_word if several else "demonstrations",
    )


def _units(results: Results, case: Case, *, several: bool) -> list[Unit]:
    units = []
    for point in results.points:
        rows = [row for row in point.rows if case.holds(row)]
        for (demo,), members in group(rows, lambda row: ("" if several else row["demo"],)).items():
            units.append(
                Unit(
                    name=f"demonstration {demo}" if demo else point.name,
                    partner=(*point.partner, ("demonstration", demo)),
                    errors={name: mean(row[name] for row in members) or 0.0 for name, *_ in MEASURES},
                    arrived=sum(row["outcome"] == "arrived" for row in members),
                    rollouts=len(members),
                )
            )
    return units
