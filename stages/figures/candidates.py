"""What a system was chosen from: the candidates of the dynamics stage, their scores, and which one was taken.

Not here: how they are scored (`stages/dynamics/choose.py`).
"""

from __future__ import annotations

from typing import Any

from pipeline.report import Block, Paragraph, Table
from stages.figures.numbers import MISSING, MM, given, joined, number
from stages.figures.results import Results

MOST = 8
"""Candidates that are listed in sight; more have to be opened."""

MADE_OF = {"mixture": "mixture", "components": "K", "share": "straightened", "guidance": "guides' weight"}
"""What sets candidates apart: entry -> title of its column."""

FOUND = {
    "condition": ("condition of P", 1.0),
    "velocity_error": ("velocity error", 1.0),
    "held_out_error": ("held out", 1.0),
    "deviation": ("deviation [mm]", MM),
    "held_out_deviation": ("held out [mm]", MM),
    "score": ("score [mm]", MM),
}
"""What was found of them: entry -> title of its column, factor."""


def candidates(results: Results) -> tuple[Block, ...] | None:
    """A paragraph and a table of the shown point's candidates; none where there was one only."""
    tried: list[dict[str, Any]] = results.shown.fit["tried"]
    if len(tried) < 2:
        return None
    apart = {name: title for name, title in MADE_OF.items() if len({entry[name] for entry in tried}) > 1}
    taken = next(entry for entry in tried if entry["chosen"])
    what = joined([f"{title} {_made_of(taken[name])}" for name, title in apart.items()])
    text = Paragraph(
        text=f"{len(tried)} candidate systems were learned and rolled out on training demonstrations alone; no test "
        "demonstration was looked at. Score: (deviation on the demonstrations learned from + deviation on those held "
        "out in turn) times (1 + relative velocity error on those held out) squared; the lowest whose roll-outs all "
        f"arrive, also from displaced starts, is taken: {what}."
    )
    table = Table(
        caption=f"{results.shown.name}: all {len(tried)} candidates",
        columns=(*apart.values(), *(title for title, _ in FOUND.values()), "arrives", "taken"),
        rows=tuple(
            (
                *(_made_of(entry[name]) for name in apart),
                *(MISSING if entry[name] is None else number(entry[name] * unit) for name, (_, unit) in FOUND.items()),
                MISSING if entry["arrives"] is None else ("yes" if entry["arrives"] else "no"),
                "yes" if entry["chosen"] else "",
            )
            for entry in tried
        ),
        collapsed=len(tried) > MOST,
    )
    return (text, table)


def _made_of(value: str | float) -> str:
    return f"`{value}`" if isinstance(value, str) else given(value)
