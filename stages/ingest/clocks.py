"""Which clock the samples of a recording's arms are placed on: the messages' own stamps, or when they were recorded.

One clock for all arms. Not here: what is done about samples that are late or doubled on it (`cleaning.py`). Arrays in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.errors import DataError
from stages.ingest.recording import Nanoseconds, Report
from stages.ingest.selections.resolved import Track

SECOND = 1_000_000_000
"""Nanoseconds in a second."""

LATE = SECOND // 10
"""A message that is earlier than one before it by no more than this, ns, came late; by more, the clock was set back."""

INCREASING = 0.9
"""Fraction of a header's steps that must be forward, for its clock to be believed."""

ZEROS = 0.01
"""Fraction of a header's stamps that may be 0 (a node that started before its clock)."""

RATES = (0.1, 10.0)
"""Span of the header's clock as a multiple of the log's, for it to be believed; simulations are slower or faster."""

SKEW = SECOND // 20
"""Arms whose stamps differ from the log by more than this, ns, between them were stamped by clocks that disagree."""


def choose_clock(tracks: Mapping[str, Track], clock: str, source: str, report: Report) -> str:
    """``header`` or ``log``: the clock of all arms. ``auto``: the header's where it is sane for every arm and
    the arms' headers have time in common.

    Raises DataError where the header's is asked for and an arm has none.
    """
    problems = {name: header_problem(track) for name, track in tracks.items()}
    if clock == "header":
        skew = clock_skew(tracks)
        if skew > SKEW:
            report.count("header_clocks_apart_ms", round(1e3 * skew / SECOND))
            report.notes.append(
                f"{source}: the header clocks of the arms disagree by {skew / SECOND:.3f} s, so their samples are "
                "paired wrongly unless the recorder was late by that: set ingest.clock to 'log'."
            )
        for name, track in tracks.items():
            if track.stamp is None:
                raise DataError(
                    arm_name(source, name), "its messages have no header stamps: set ingest.clock to 'log' or 'auto'."
                )
        return "header"
    if clock == "log":
        return "log"
    for name, problem in problems.items():
        if problem and tracks[name].stamp is not None:
            report.notes.append(
                f"{arm_name(source, name)}: {problem}; the times at which messages were recorded are used."
            )
    if any(problems.values()):
        return "log"
    stamps = [track.stamp[track.stamped] for track in tracks.values() if track.stamp is not None]
    if not _overlap(stamps) and _overlap([track.log_time for track in tracks.values()]):
        report.notes.append(
            f"{source}: the header stamps of the arms have no time in common; the times at which messages were "
            "recorded are used."
        )
        return "log"
    skew = clock_skew(tracks)
    if skew > SKEW:
        report.count("header_clocks_apart_ms", round(1e3 * skew / SECOND))
        report.notes.append(
            f"{source}: the header clocks of the arms disagree by {skew / SECOND:.3f} s; the times at which messages "
            "were recorded are used."
        )
        return "log"
    return "header"


def clock_skew(tracks: Mapping[str, Track]) -> int:
    """By how much, ns, the arms' stamps differ between them from when they were recorded, while all were recorded.

    The difference of the medians of log time minus stamp: one clock and the same transport give nearly none.
    """
    stamped = [(t.log_time, t.stamp, t.stamped) for t in tracks.values() if t.stamp is not None and t.stamped.any()]
    if len(stamped) < 2:
        return 0
    begin, end = max(log.min() for log, _, _ in stamped), min(log.max() for log, _, _ in stamped)
    delays = []
    for log, stamp, kept in stamped:
        common = (log >= begin) & (log <= end) & kept
        if not common.any():
            return 0
        delays.append(int(np.median((log - stamp)[common])))
    return max(delays) - min(delays)


def _overlap(times: Sequence[Nanoseconds]) -> bool:
    return bool(max(time.min() for time in times) < min(time.max() for time in times))


def header_problem(track: Track) -> str:
    """Why the clock of a track's headers cannot be believed, as a clause; empty where it can."""
    stamp = track.stamp
    if stamp is None:
        return "messages have no header stamps"
    zero = ~track.stamped
    if zero.mean() > ZEROS:
        return f"{int(zero.sum())} of {stamp.size} header stamps are zero"
    stamp, log = stamp[~zero], track.log_time[~zero]
    if stamp.size < 2:
        return ""
    steps = np.diff(stamp)
    if (steps > 0).mean() < INCREASING:
        return f"header stamps increase in only {int((steps > 0).sum())} of {steps.size} steps"
    late = lateness(stamp)
    if late.max() > LATE:
        return f"header stamps jump back by {late.max() / SECOND:.3g} s"
    span, recorded = int(stamp.max() - stamp.min()), int(log.max() - log.min())
    if recorded > 0 and not RATES[0] <= span / recorded <= RATES[1]:
        return f"header stamps span {span / SECOND:.3g} s where {recorded / SECOND:.3g} s were recorded"
    return ""


def lateness(time: Nanoseconds) -> Nanoseconds:
    """By how much each stamp is earlier than the latest before it, array, shape (n,), nanoseconds; 0 in order."""
    return np.asarray(np.maximum.accumulate(time) - time)


def arm_name(source: str, name: str) -> str:
    """What messages call an arm of a recording; a single point goes by the recording's name."""
    return source if name == "point" else f"{source}, {name} arm"
