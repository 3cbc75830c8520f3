"""How messages about recordings list what would have been right: the nearest name and a few, never hundreds."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

SHOWN = 12
"""Names that a sentence lists at most; `clpv info` lists all."""


def nearest(wrong: str, valid: Iterable[str]) -> str:
    """End of a sentence: the nearest valid name, where there is one, and the first few of all."""
    names = sorted(set(valid))
    if not names:
        return "none is known."
    near = difflib.get_close_matches(wrong, names, n=1, cutoff=0.6)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{hint}Valid: {listed(names)}."


def listed(names: Sequence[str]) -> str:
    """The first few of some names, and how many more there are."""
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{', '.join(names[:SHOWN])}{more}"
