"""What a recording shows, in words (Markdown): beside the pictures, for whom opens the file later."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stages.figures.numbers import MM, given, number
from stages.inspect.shown import Shown
from stages.policy.outcome import Outcome

FACTS = (
    ("mass", "mass", "kg", 1.0),
    ("friction", "friction", "", 1.0),
    ("force", "F_d", "N", 1.0),
    ("grip_ratio", "2 mu F_d/(m g)", "", 1.0),
    ("mass_found", "mass as found", "kg", 1.0),
    ("length_found", "L as found", "mm", MM),
)
"""Of a carried box: name among the facts, in words, unit, and what makes it that unit of SI."""

REMEDIES = {str(outcome): outcome.remedy for outcome in Outcome}


def about(shown: Sequence[Shown]) -> str:
    """A heading, how to get the results again, and a line for each roll-out."""
    names = list(dict.fromkeys(one.model[0] for one in shown))
    commands = dict.fromkeys(f"    {one.experiment.command('run')}" for one in shown)
    lines = [f"# {', '.join(names)}", "", *commands, ""]
    lines += [_line(one) for one in shown]
    kinds = {one.carries for one in shown}
    if False in kinds:
        lines += [
            "",
            "Wide band and large dot: the state x of the learned system. Thin line: what was executed. "
            "Thin light and dark grey lines: demonstrations to learn from and to test on. Rings: components of the "
            "mixture, one and two standard deviations. Pins, heads ahead: the learned flow. Over time: one start of "
            "each case; a gap in a path is a push.",
        ]
    if True in kinds:
        lines += [
            "",
            "Green: the reference x; yellow: p_hat; grey: the pads' midpoint, which is what was executed. "
            "Orange cuboid: the box, between two pads; dark ones: pedestal and shelf; red: a flowerpot in its safety "
            "sphere. Forces are those of the contacts. Lanes: what the arms are at; whether x may move; who is truly "
            "pushed, and who is taken for it. Of more than four boxes the arms are lines.",
        ]
    return "\n".join(lines)


def _line(one: Shown) -> str:
    rollout = one.rollout
    words = [f"- **{'/'.join(one.root)}**: {rollout.outcome}"]
    if rollout.outcome != Outcome.ARRIVED and rollout.outcome in REMEDIES:
        words.append(REMEDIES[rollout.outcome])
    words.append(f"{number(float(rollout.time[-1]))} s")
    if rollout.carry is not None:
        words += _facts(rollout.carry.facts)
    return ". ".join(word.rstrip(".") for word in words) + "."


def _facts(facts: Mapping[str, Any]) -> list[str]:
    said = []
    for name, word, unit, factor in FACTS:
        value = facts.get(name)
        if value is not None:
            said.append(f"{word} {given(round(factor * float(value), 4))} {unit}".strip())
    for push in facts["pushes"]:
        offset = [given(round(MM * value)) for value in push["offset"]]
        force = [given(round(value, 1)) for value in push["force"]]
        what = f"[{', '.join(force)}] N" if any(push["force"]) else f"[{', '.join(offset)}] mm"
        said.append(f"{push['arm']} arm pushed by {what}")
    return [", ".join(said)] if said else []
