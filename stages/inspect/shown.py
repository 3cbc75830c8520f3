"""Which roll-outs a recording shows, what they are called in it, and in which colours.

Results and patterns in, roll-outs out. Not here: how they are drawn (`plane.py`, `arms.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase

from pipeline.errors import UsageError, choices
from pipeline.experiment import Experiment
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

Kept = tuple[Results, PointResults, RecordedRollout]

MANY = 8
"""Roll-outs that a sentence names at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """One roll-out in a recording.

    Attributes:
        root: of its entities, parts of a path.
        model: of the entities of the learned system that it shares with others, parts of a path.
        experiment: whose it is.
        point: of its sweep, or the only one.
        rollout: what happened.
        name: what legends call it.
        colour: of its lines, where it is the only thing that tells it from others.
    """

    root: tuple[str, ...]
    model: tuple[str, ...]
    experiment: Experiment
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

    Raises UsageError where a pattern or a point names nothing, or nothing of an experiment is chosen.
    """
    found = [(results, point) for results in several for point in _points(results, points)]
    _known(points, [name for results in several for point in results.points for name in _names(point)], "point")
    known = list(dict.fromkeys(r.rollout for _, point in found for r in point.rollouts))
    _known(patterns, known, "roll-out")
    kept: list[Kept] = []
    for results, point in found:
        if patterns:
            some: Iterable[RecordedRollout] = (
                r for r in point.rollouts if any(_is(r.rollout, pattern) for pattern in patterns)
            )
        else:
            some = telling(point.rollouts, kept[0][2].rollout if kept else "")
        kept += [(results, point, rollout) for rollout in some]
    for results in several:
        if not any(one is results for one, _, _ in kept):
            raise UsageError(f"Nothing of {results.experiment.name} is chosen: leave it out, or choose otherwise.")
    return _named(kept)


def _points(results: Results, wanted: Sequence[str]) -> list[PointResults]:
    if wanted:
        return [point for point in results.points if any(_is(n, text) for n in _names(point) for text in wanted)]
    return [results.own.shown]


def _names(point: PointResults) -> tuple[str, str]:
    """What a point of a sweep may be called: its id, and its name without what all share."""
    return point.point.id, point.name


def _is(name: str, pattern: str) -> bool:
    """Whether a name is the one that is meant, or fits the wildcards."""
    return name == pattern or fnmatchcase(name, pattern)


def _known(patterns: Sequence[str], names: Sequence[str], what: str) -> None:
    """Raises UsageError for the first pattern that names nothing."""
    for pattern in patterns:
        if not any(_is(name, pattern) for name in names):
            near = names if len(names) <= MANY else get_close_matches(pattern, names, n=MANY, cutoff=0.0)
            more = "" if len(names) <= MANY else f" These {len(near)} of {len(names)} come nearest; * is a wildcard."
            raise UsageError(f"There is no {what} {pattern!r}; {choices(pattern, near)}{more}")


def _named(kept: Sequence[Kept]) -> list[Shown]:
    """With entity paths, names and colours; what all have in common is left out of the names."""
    titles = [_title(results, point, rollout) for results, point, rollout in kept]
    # Roll-outs of a point are shown apart by condition, and one start of each: this part of a title says the same.
    told = COARSE if kept and all(rollout.carry is None for _, _, rollout in kept) else len(titles[0]) if titles else 0
    apart = [index for index in range(told) if len({title[index] for title in titles}) > 1]
    colours = _colours(kept)
    made = []
    for (results, point, rollout), title, colour in zip(kept, titles, colours, strict=True):
        model = (results.experiment.name, *((point.point.id,) if results.is_sweep else ()))
        name = ", ".join(dict.fromkeys(title[index] for index in apart if title[index])) or title[2]
        made.append(
            Shown(
                root=(*model, *rollout.rollout.split("/")),
                model=(*model, "model"),
                experiment=results.experiment,
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


def _colours(kept: Sequence[Kept]) -> list[Colour]:
    """By controller where controllers differ, and methods and points do not; else by what is shown in turn."""
    rollouts = [rollout for _, _, rollout in kept]
    single = len({id(point) for _, point, _ in kept}) == 1
    if single and all(r.carry is None and r.avoidance == "none" for r in rollouts):
        return [rgb(CONTROLLERS.get(r.label, "series-4"), PALETTE) for r in rollouts]
    cases = [(id(point), case_of(rollout)) for _, point, rollout in kept]
    order = list(dict.fromkeys(cases))
    return [SERIES[order.index(case) % len(SERIES)] for case in cases]


def case_of(rollout: RecordedRollout) -> tuple[str, ...]:
    """What roll-outs that differ in start and scene only share; of carried boxes the condition tells, too."""
    condition = (rollout.condition,) if rollout.carry is not None else ()
    return (rollout.label, rollout.avoidance, *condition)


def undisturbed_first(conditions: Sequence[str]) -> list[str]:
    """Conditions in order, the undisturbed one last: what a person looks for comes first."""
    return [*(c for c in conditions if c != UNDISTURBED), *(c for c in conditions if c == UNDISTURBED)]
