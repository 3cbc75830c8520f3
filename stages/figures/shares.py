"""Counts as tables write them: so many of so many, with an interval. Counts in, text out."""

from __future__ import annotations

from stages.figures.clearance import wilson
from stages.figures.numbers import MISSING, NO_BREAK


def of(count: int, total: int) -> str:
    """As in ``6 of 7``."""
    return f"{count} of {total}".replace(" ", NO_BREAK)


def tally(count: int, total: int) -> str:
    """As in ``6 of 7 (49 to 97 %)``, with its 95 % interval; a dash where there is nothing to count."""
    if total == 0:
        return MISSING
    low, high = wilson(count, total)
    return f"{of(count, total)} ({100.0 * low:.0f} to {100.0 * high:.0f} %)".replace(" ", NO_BREAK)
