"""What is wrong with a clock of a recording, counted. Arrays in, numbers out."""

from __future__ import annotations

import numpy as np

from stages.ingest.recording import ClockHealth, Nanoseconds

GAP = 5.0
"""Steps longer than this many median steps are gaps: dropped messages in a row, not jitter."""

BURSTS = 0.1
"""Where more than this part of the steps were gaps, messages come in bursts (tf), and the longer steps are the beat."""

NANOSECONDS = 1e9


def health(log: Nanoseconds, stamp: Nanoseconds | None, resets: int = 0) -> ClockHealth:
    """Counts of what is wrong with the header's clock, or with the log's where there are no stamps.

    Args:
        log, stamp: arrays, shape (n,), nanoseconds, in the recorded order.
        resets: steps back that are none: starts of further episodes.
    """
    clock = log if stamp is None else stamp
    steps = np.diff(clock)
    forward = steps[steps > 0]
    gaps = forward[forward > GAP * _beat(forward)]
    return ClockHealth(
        # Where the log itself begins at 0, a stamp of 0 is a time; elsewhere nobody has set it.
        zero=0 if stamp is None else int(np.count_nonzero((stamp == 0) & (log != 0))),
        backward=max(int(np.count_nonzero(steps < 0)) - resets, 0),
        duplicate=int(np.count_nonzero(steps == 0)),
        gaps=int(gaps.size),
        longest_gap=float(gaps.max() / NANOSECONDS) if gaps.size else 0.0,
        offset=None if stamp is None or not stamp.size else float(np.median(log - stamp) / NANOSECONDS),
    )


def _beat(forward: Nanoseconds) -> float:
    """The step that gaps are measured by: the median one, or between bursts."""
    if not forward.size:
        return 0.0
    median = float(np.median(forward))
    longer = forward[forward > GAP * median]
    return float(np.median(longer)) if longer.size > BURSTS * forward.size else median


def rate(clock: Nanoseconds) -> float | None:
    """Median rate, Hz, of a clock, array, shape (n,), nanoseconds; none for less than two distinct times."""
    steps = np.diff(clock)
    forward = steps[steps > 0]
    return float(NANOSECONDS / np.median(forward)) if forward.size else None


def disorder(log: Nanoseconds, stamp: Nanoseconds | None) -> int:
    """Steps at which the header's clock and the log's go opposite ways: one of the two was set while recording."""
    if stamp is None:
        return 0
    return int(np.count_nonzero(np.sign(np.diff(log)) * np.sign(np.diff(stamp)) < 0))
