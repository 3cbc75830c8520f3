"""What clpv has written itself, and recordings of rerun: what a file is, in a sentence, and the command that opens it.

By what a file holds and not by its name. Not here: what is in a recording (`bag_info.py`).
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.errors import DataError

RRD, PARQUET, MCAP = b"RRF2", b"PAR1", b"\x89MCAP0\r\n"
"""How files begin."""

TABLES = {
    "demonstrations": ("demonstrations", "ingest"),
    "midpoints": ("midpoints of the demonstrations", "midpoint"),
    "mixture": ("Gaussians of the mixture", "mixture"),
    "assignments": ("samples by Gaussian", "mixture"),
    "dynamics": ("learned linear systems", "dynamics"),
    "rollouts": ("roll-outs", "rollout"),
    "metrics": ("metrics of roll-outs", "evaluate"),
}
"""What our parquet files are tables of, and the stages that write them, by the name of their schema."""

UNKNOWN = "A log of clpv that does not say what it is of."

SWITCHES = ("compliance", "following", "coupling")
"""Facts of a roll-out that are on or off."""


@dataclass(frozen=True, kw_only=True)
class Known:
    """A file that is known.

    Attributes:
        format: what it is, as a list of formats has it.
        writer: ``clpv`` or ``rerun``.
        what: a sentence that says what it is, and which command opens it where it is no recording.
        look: commands that show it; NAME stands for the experiment.
        details: what a log says beside its messages.
        recording: whether it holds messages, which can be ingested.
    """

    format: str
    writer: str
    what: str
    look: tuple[str, ...]
    details: Mapping[str, Any] = field(default_factory=dict)
    recording: bool = False


def recognise(path: Path) -> Known | None:
    """What a file is, where clpv or rerun has written it; none: something else, or it cannot be read."""
    try:
        with path.open("rb") as stream:
            head = stream.read(8)
    except OSError:
        return None
    if head.startswith(RRD):
        look = shlex.join(["clpv", "inspect", str(path)])
        what = f'{path.name} is a recording of rerun: "{look}" opens it.'
        return Known(format="rerun", writer="rerun", what=what, look=(look,))
    if head.startswith(PARQUET):
        return _table(path)
    return _log(path) if head.startswith(MCAP) else None


def _table(path: Path) -> Known | None:
    from stages.artifacts.parquet import header

    try:
        found = header(path)
    except Exception:  # no footer, no metadata, or not ours: `open_recording` says what is wrong
        return None
    if found.get("schema") not in TABLES:
        return None
    of, stage = TABLES[found["schema"]]
    look = f"clpv show NAME --stage {stage}"
    what = (
        f'{path.name} is a table of clpv, version {found.get("version")}: {of}; "{look}" shows it, of experiment NAME.'
    )
    return Known(format="parquet", writer="clpv", what=what, look=(look,))


def _log(path: Path) -> Known | None:
    from stages.artifacts.log import KEY, library, read_details

    if library(path) != KEY:
        return None
    try:
        details = read_details(path)
    except DataError:
        details = {}  # it is damaged or unfinished, which those who open it say
    look: tuple[str, ...] = (shlex.join(["clpv", "inspect", str(path)]),)
    try:
        what = _said(details)
        if "rollout" in details:
            look = (shlex.join(["clpv", "inspect", "NAME", "--rollout", details["rollout"]]), *look)
    except (AttributeError, KeyError, TypeError, ValueError):  # of another version
        what = UNKNOWN
    return Known(format="MCAP", writer="clpv", what=what, look=look, details=details, recording=True)


def _said(details: Mapping[str, Any]) -> str:
    """What a log is of, by what it says itself."""
    if "rollout" in details:
        facts = details.get("facts", {})
        arms = f"two {details['robot']} arms" if "robot" in details else "two arms"
        box = f"a box of {1e3 * facts['mass']:.0f} g" if "mass" in facts else "a box"
        how = [f"{name} {'on' if facts[name] else 'off'}" for name in SWITCHES if name in facts]
        for name, several in (("push", "pushes"), ("pot", "pots")):
            count = len(facts.get(several) or ())
            how += [f"{count} {name if count == 1 else several}"] if count else []
        told = f", {', '.join(how)}" if how else ""
        return f"A roll-out of clpv: {details['rollout']}, {arms} and {box}{told}. Outcome: {details['outcome']}."
    if "number" in details:
        return f"A demonstration by 'clpv teleop': number {details['number'] + 1} of seed {details['seed']}."
    return UNKNOWN
