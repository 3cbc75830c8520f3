"""Roll-outs in which arms carry a box, gathered by how the box was held: what a row or a picture of the report shows.

Results in, groups out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stages.artifacts.rollouts import RecordedCarry, RecordedRollout
from stages.evaluate.summary import group
from stages.figures.numbers import MISSING, cell, kind_name
from stages.figures.results import PointResults, Results
from stages.policy.admittance import settled_force
from stages.rollout.parameters import CarryCondition, CarryParameters

NO_LAW = "none"
LAWS = {"robust": "admittance, robust", "paper": "admittance as printed", NO_LAW: "no compliance"}
"""What tables call the laws by which arms press, by mode."""

COLOURS = {"robust": "series-2", "paper": "series-3", NO_LAW: "series-1"}
"""Name in the palette by law."""

POOLED = frozenset({"rollout.replicate", "rollout.mode", "dynamics.kind"})
"""What a sweep may set without that its roll-outs become another case: they are more of them, or told apart anyway."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """Roll-outs whose boxes were held in the same way.

    Attributes:
        variant: what a sweep sets apart, in words; "": nothing.
        kind: of dynamics; "": there is only one.
        law: a key of `LAWS`.
        condition: its name.
        rows: of metrics.parquet, each with its point.
        points: that have such roll-outs.
    """

    variant: str
    kind: str
    law: str
    condition: str
    rows: Sequence[dict[str, Any]]
    points: Sequence[PointResults]

    @property
    def title(self) -> str:
        """What pictures call it."""
        law = ", as printed" if self.law == "paper" and "printed" not in self.condition else ""
        return ", ".join([self.condition + law, *self._apart])

    @property
    def name(self) -> str:
        """What pictures call it that say elsewhere how the arms pressed."""
        return ", ".join([self.condition, *self._apart])

    @property
    def _apart(self) -> list[str]:
        return [part for part in (self.variant, self.kind and f"{kind_name(self.kind)} dynamics") if part]

    @property
    def asked(self) -> CarryCondition | None:
        """The condition as a person asked for it, of the first point; none: it has another name there."""
        return next((c for c in carry_parameters(self.points[0]).conditions if c.name == self.condition), None)

    @property
    def pushed(self) -> bool:
        """Whether arms were to be pushed."""
        return any(carry.facts["pushes"] for carry in self.carries)

    @property
    def among_pots(self) -> bool:
        """Whether something was in the way."""
        return any(carry.facts["pots"] for carry in self.carries)

    @property
    def carries(self) -> list[RecordedCarry]:
        """What arms and boxes did, in order."""
        return [r.carry for r in self.rollouts if r.carry is not None]

    @property
    def rollouts(self) -> list[RecordedRollout]:
        """With their paths, in order."""
        wanted = {(row["point"], row["rollout"]) for row in self.rows}
        return [r for point in self.points for r in point.rollouts if (point.point.id, r.rollout) in wanted]

    @property
    def settles(self) -> tuple[float, ...]:
        """Forces on which the law settles, newtons, one for each value of its parameters; empty without compliance."""
        if self.law == NO_LAW:
            return ()
        if self.law != "paper":
            return self.desired
        k_p = {point.point.id: carry_parameters(point).admittance.k_p for point in self.points}
        return tuple(dict.fromkeys(settled_force(row["desired_force_n"], k_p[row["point"]]) for row in self.rows))

    @property
    def desired(self) -> tuple[float, ...]:
        """F_d in the end, newtons, one for each value: it is raised for boxes that turn out to be heavy."""
        return tuple(dict.fromkeys(row["desired_force_n"] for row in self.rows))

    @property
    def given(self) -> tuple[float, ...]:
        """F_d as it was set, newtons, one for each value of the parameters."""
        return tuple(dict.fromkeys(carry_parameters(point).admittance.force for point in self.points))


def carry_parameters(point: PointResults) -> CarryParameters:
    """Of the rollout stage of a point in which arms carry a box."""
    found: CarryParameters = point.point.parameters["rollout"]
    return found


def held_groups(results: Results) -> list[Held]:
    """All roll-outs by sweep, dynamics, law and condition, in the order in which they appear.

    Without compliance modes do not differ: of a sweep over modes the same boxes would count twice, and those of the
    first mode are kept.
    """
    points = {point.point.id: point for point in results.points}
    several = len(results.kinds) > 1

    def key(row: Any) -> tuple[str, str, str, str]:
        point = points[row["point"]]
        return _variant(point), point.kind if several else "", law_of(row), str(row["condition"])

    found = []
    for (variant, kind, law, condition), rows in group(results.rows, key).items():
        kept = [dict(row) for row in rows if law != NO_LAW or row["mode"] == rows[0]["mode"]]
        own = [points[name] for name in dict.fromkeys(row["point"] for row in kept)]
        found.append(Held(variant=variant, kind=kind, law=law, condition=condition, rows=kept, points=own))
    return found


def law_of(row: Any) -> str:
    """The law by which arms pressed in a roll-out, from its row: a key of `LAWS`."""
    return str(row["mode"]) if row["compliance"] else NO_LAW


def difference(row: Any) -> str:
    """What a roll-out, from its row, does otherwise than the robust form, in words; a dash: nothing."""
    printed = [number for number, on in (("(14)", row["following"]), ("(17)", row["compliance"])) if on]
    parts = [
        f"{'eqs.' if len(printed) > 1 else 'eq.'} {', '.join(printed)} as printed"
        if row["mode"] == "paper" and printed
        else "",
        "" if row["following"] else "arms do not follow each other",
        "" if row["compliance"] else "no compliance",
        "" if row["coupling"] else "x does not wait",
    ]
    return ", ".join(filter(None, parts)) or MISSING


def asks(row: Any) -> bool:
    """Whether the arms of a roll-out, from its row, ask which of them is pushed: as printed, eq. (14) does not."""
    return bool(row["following"]) and row["mode"] != "paper"


def number_of(row: Any) -> str:
    """The number of a roll-out's box, from its row: the same box under all conditions."""
    return str(row["rollout"]).rpartition("/")[2]


def _variant(point: PointResults) -> str:
    """What a sweep sets at a point, beside what is pooled, as in ``mass 0.6``."""
    apart = sorted(frozenset(point.point.overrides) - POOLED - {"seed"})
    return ", ".join(f"{name.rpartition('.')[2]} {cell(point.point.overrides[name])}" for name in apart)
