"""Which roll-outs a recording shows, what they are called in it, and in which colours.

Results and patterns in, roll-outs out. Not here: how they are drawn (`plane.py`, `arms.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase

from pipeline.errors import UsageError, choices
from pipeline.report import PALETTE
from stages.artifacts.rollouts import RecordedRollout
from stages.figures.numbers import UNDISTURBED, condition_name, controller_name, method_title
from stages.figures.results import PointResults, Results
from stages.figures.style import CONTROLLERS
from stages.figures.telling import telling
from stages.inspect.stream import Colour, rgb

COARSE = 4
"""Parts of a title before the condition: experiment, point, controller, method."""

SERIES: tuple[Colour, ...] = (
    *(rgb(f"series-{number}", PALETTE) for number in (2, 1, 3, 4, 5)),
    (168, 134, 255),
    (255, 116, 108),
    (190, 196, 204),
)
"""Colours that take turns where nothing else tells roll-outs apart: those of the report, and three more."""

MANY = 8
"""Roll-outs that a sentence names at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """One roll-out in a recording.

    Attributes:
        root: of its entities, parts of a path.
        model: of the entities of the learned system that it shares with others, parts of a path.
        point: whose it is.
        rollout: what happened.
        name: what legends call it.
        colour: of its lines, where it is the only thing that tells it from others.
    """

    root: tuple[str, ...]
    model: tuple[str, ...]
    point: PointResults
    rollout: RecordedRollout
    name: str
    colour: Colour

    @property
    def scene(self) -> tuple[str, ...]:
        """Of the entities of its obstacles, parts of a path; empty: there are none."""
        return (*self.model[:-1], "scene", *self.rollout.scene.split("/")) if self.rollout.scene else ()

    @property
    def carries(self) -> bool:
        """Whether two arms carry a box."""
        return self.rollout.carry is not None


def choose(several: Sequence[Results], patterns: Sequence[str], points: Sequence[str]) -> list[Shown]:
    """The roll-outs of one or more experiments that are shown together, in order.

    Arguments:
        several: the experiments.
        patterns: names of roll-outs, with ``*`` and ``?``; none: those that show the most.
        points: of sweeps, by their ids; none: the one that stands for all.

    Raises UsageError where a pattern or a point names nothing.
    """
    found = [(results, point) for results in several for point in _points(results, points)]
    _known(points, [point.point.id for results in several for point in results.points], "point")
    known = list(dict.fromkeys(r.rollout for _, point in found for r in point.rollouts))
    _known(patterns, known, "roll-out")
    kept: list[tuple[Results, PointResults, RecordedRollout]] = []
    for results, point in found:
        if patterns:
            some: Iterable[RecordedRollout] = (
                r for r in point.rollouts if any(fnmatchcase(r.rollout, pattern) for pattern in patterns)
            )
        else:
            some = telling(point.rollouts, kept[0][2].rollout if kept else "")
        kept += [(results, point, rollout) for rollout in some]
    return _named(kept)


def _points(results: Results, wanted: Sequence[str]) -> list[PointResults]:
    if wanted:
        return [point for point in results.points if any(fnmatchcase(point.point.id, text) for text in wanted)]
    return [results.own.shown]


def _known(patterns: Sequence[str], names: Sequence[str], what: str) -> None:
    """Raises UsageError for the first pattern that names nothing."""
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            near = names if len(names) <= MANY else get_close_matches(pattern, names, n=MANY, cutoff=0.0)
            more = "" if len(names) <= MANY else f" These {len(near)} of {len(names)} come nearest; * is a wildcard."
            raise UsageError(f"There is no {what} {pattern!r}; {choices(pattern, near)}{more}")


def _named(kept: Sequence[tuple[Results, PointResults, RecordedRollout]]) -> list[Shown]:
    """With entity paths, names and colours; what all have in common is left out of the names."""
    titles = [_title(results, point, rollout) for results, point, rollout in kept]
    # Roll-outs of a point are shown apart by condition, and one start of each: this part of a title says the same.
    told = COARSE if kept and all(rollout.carry is None for _, _, rollout in kept) else len(titles[0]) if titles else 0
    apart = [index for index in range(told) if len({title[index] for title in titles}) > 1]
    colours = _colours([rollout for _, _, rollout in kept])
    made = []
    for (results, point, rollout), title, colour in zip(kept, titles, colours, strict=True):
        model = (results.experiment.name, *((point.point.id,) if results.is_sweep else ()))
        name = ", ".join(dict.fromkeys(title[index] for index in apart if title[index])) or title[2]
        made.append(
            Shown(
                root=(*model, *rollout.rollout.split("/")),
                model=(*model, "model"),
                point=point,
                rollout=rollout,
                name=name,
                colour=colour,
            )
        )
    return made


def _title(results: Results, point: PointResults, rollout: RecordedRollout) -> tuple[str, ...]:
    """What can tell a roll-out from others, from the coarse to the fine."""
    number = rollout.rollout.rpartition("/")[2]
    method = method_title(rollout.avoidance) if rollout.avoidance != "none" else ""
    condition = condition_name(rollout.condition)
    return (
        results.experiment.name,
        point.point.id if results.is_sweep else "",
        controller_name(rollout.label),
        method,
        condition,
        number,
    )


def _colours(rollouts: Sequence[RecordedRollout]) -> list[Colour]:
    """By controller where controllers differ and methods do not; else by what is shown in turn."""
    if rollouts and all(r.carry is None and r.avoidance == "none" for r in rollouts):
        return [rgb(CONTROLLERS.get(r.label, "series-4"), PALETTE) for r in rollouts]
    cases = list(dict.fromkeys(case_of(r) for r in rollouts))
    return [SERIES[cases.index(case_of(r)) % len(SERIES)] for r in rollouts]


def case_of(rollout: RecordedRollout) -> tuple[str, ...]:
    """What roll-outs that differ in start and scene only share; of carried boxes the condition tells, too."""
    condition = (rollout.condition,) if rollout.carry is not None else ()
    return (rollout.label, rollout.avoidance, *condition)


def undisturbed_first(conditions: Sequence[str]) -> list[str]:
    """Conditions in order, the undisturbed one last: what a person looks for comes first."""
    return [*(c for c in conditions if c != UNDISTURBED), *(c for c in conditions if c == UNDISTURBED)]
