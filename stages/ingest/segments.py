"""Which stretches of a recording are demonstrations: where both arms are recorded, without gaps, divided and trimmed.

A recording is one demonstration, or is divided at pauses, at given times or by a topic; the rest at the ends of each is
cut off. Times are seconds from the first pose of either arm. No part of the paper: its demonstrations were cut by hand.
Arrays in, arrays out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.ingest.cleaning import DEAD, FEWEST
from stages.ingest.parameters import PauseDivision, RecordingParameters, TimeDivision, TopicDivision
from stages.ingest.recording import Report
from stages.trajectory import Array

REST_SHARE = 0.05
"""Rest is slower than this share of the motion's top speed; a minimum-jerk motion loses 0.4 % of its path to it."""

WINDOW = 0.2
"""s. Speeds are of the way made in this time: noise of 0.1 mm then looks like 0.7 mm/s, not like 14 mm/s at 100 Hz."""

Span = tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """An arm's way: time, array, shape (n,), seconds, increasing; position, array, shape (n, 3), metres."""

    time: Array
    position: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """What a topic says over time: time, array, shape (n,), s, increasing; value, shape (n,); whether it is a Bool."""

    time: Array
    value: Array
    boolean: bool


def split(
    arms: Mapping[str, Path], parameters: RecordingParameters, signal: Signal | None, source: str, report: Report
) -> list[Span]:
    """First and last time, seconds, of each demonstration in a recording, in order.

    Arguments:
        signal: of the topic that divides the recording, where one does.

    Adds to `report`. Raises DataError, naming `source`, where the arms have no time in common, where a demonstration
    that nothing divides has a gap, or where nothing is left.
    """
    division = parameters.division
    whole = overlap(arms, source, report)
    if isinstance(division, PauseDivision):
        spans = between_pauses(arms, whole, division.speed, division.duration)
    elif isinstance(division, TimeDivision):
        spans = at_times(whole, division.times, source)
    elif isinstance(division, TopicDivision) and signal is not None:
        spans = by_signal(whole, signal, source)
    else:
        spans = [whole]
    divided = division.kind != "none"
    if divided:
        spans = [part for span in spans for part in without_gaps(arms, span, parameters.longest_gap)]
    found, left = [], sum(int(inside(path.time, whole).sum()) for path in arms.values())
    for span in spans:
        kept = moving(arms, span, parameters.rest_speed) if parameters.trim else span
        samples = [int(inside(path.time, kept).sum()) for path in arms.values()]
        if divided and (min(samples) < FEWEST or not _moves(arms, kept)):
            report.count("pieces_dropped")
            continue
        if min(samples) < FEWEST:
            raise DataError(
                source,
                f"has {min(samples)} sample(s) of an arm where both are recorded and move; {FEWEST} at least are needed"
                ": record it again, or set ingest.trim to false.",
            )
        if not divided:
            _refuse_gap(arms, kept, parameters.longest_gap, source)
        left -= sum(samples)
        found.append(kept)
    if not found:
        raise DataError(source, f"division by {division.kind} leaves no demonstration in which an arm moves.")
    report.count("trimmed", max(left, 0))
    return found


def overlap(arms: Mapping[str, Path], source: str, report: Report) -> Span:
    """The time in which all arms are recorded; raises DataError where there is none."""
    start, end = max(p.time[0] for p in arms.values()), min(p.time[-1] for p in arms.values())
    if not start < end:
        spans = ", ".join(f"{name} {p.time[0]:.3f} to {p.time[-1]:.3f} s" for name, p in arms.items())
        raise DataError(
            source,
            f"the arms have no time in common ({spans}): give recordings of the same motion, or set ingest.clock.",
        )
    shortest = min(p.time[-1] - p.time[0] for p in arms.values())
    if end - start < 0.5 * shortest:
        report.notes.append(f"{source}: the arms have only {end - start:.2f} s of {shortest:.2f} s in common.")
    report.count("outside_overlap", sum(int((~inside(p.time, (start, end))).sum()) for p in arms.values()))
    return float(start), float(end)


def speed(path: Path, at: Array) -> Array:
    """Speed, array, shape (m,), m/s, at times `at`, shape (m,), s: of the way made in 0.2 s around each."""
    begin = np.clip(at - WINDOW / 2, path.time[0], path.time[-1])
    end = np.clip(at + WINDOW / 2, path.time[0], path.time[-1])
    way = np.column_stack(
        [np.interp(end, path.time, axis) - np.interp(begin, path.time, axis) for axis in path.position.T]
    )
    return np.asarray(np.linalg.norm(way, axis=1) / np.maximum(end - begin, 1e-9))


def fastest(arms: Mapping[str, Path], span: Span) -> tuple[Array, Array]:
    """All sample times in `span`, array, shape (m,), s, and the speed of the faster arm there, shape (m,), m/s."""
    times = np.unique(np.concatenate([p.time[inside(p.time, span)] for p in arms.values()]))
    return times, np.asarray(np.max([speed(path, times) for path in arms.values()], axis=0))


def moving(arms: Mapping[str, Path], span: Span, rest_speed: float) -> Span:
    """`span` without the rest at both ends: from when an arm first moves to when one last does.

    Rest is slower than `rest_speed`, m/s, and than a share of the motion's own speed (`REST_SHARE`), so that a slow
    demonstration does not lose its ends.
    """
    times, speeds = fastest(arms, span)
    moves = np.flatnonzero(speeds >= min(rest_speed, REST_SHARE * float(speeds.max())))
    return span if moves.size == 0 else (float(times[moves[0]]), float(times[moves[-1]]))


def between_pauses(arms: Mapping[str, Path], span: Span, limit: float, duration: float) -> list[Span]:
    """Stretches of `span` between pauses: times in which no arm is as fast as `limit`, m/s, for `duration`, s."""
    times, speeds = fastest(arms, span)
    slow = np.concatenate([[False], speeds < limit, [False]])
    edges = np.flatnonzero(slow[1:] != slow[:-1])
    pauses = [
        (float(times[first]), float(times[last - 1]))
        for first, last in zip(edges[::2], edges[1::2], strict=True)
        if times[last - 1] - times[first] >= duration
    ]
    starts = [span[0], *(end for _, end in pauses)]
    ends = [*(begin for begin, _ in pauses), span[1]]
    return [(start, end) for start, end in zip(starts, ends, strict=True) if end > start]


def at_times(span: Span, times: Sequence[float], source: str) -> list[Span]:
    """Stretches of `span` between given times; raises ParameterError where these do not increase, DataError outside."""
    if any(later <= earlier for earlier, later in pairwise(times)):
        raise ParameterError("ingest.division.times", "must increase.")
    for time in times:
        if not span[0] < time < span[1]:
            raise DataError(
                source,
                f"ingest.division.times has {time:g} s; both arms are recorded from {span[0]:.3f} to {span[1]:.3f} s.",
            )
    edges = [span[0], *times, span[1]]
    return list(pairwise(edges))


def by_signal(span: Span, signal: Signal, source: str) -> list[Span]:
    """Stretches of `span` that a topic marks: those in which a Bool is true, or those of each value of a number."""
    known = np.isfinite(signal.value)
    time, value = signal.time[known], signal.value[known]
    if time.size == 0:
        raise DataError(source, "the topic of ingest.division has no values.")
    edges = np.flatnonzero(np.diff(value) != 0.0) + 1
    starts = time[np.concatenate([[0], edges])]
    ends = np.concatenate([time[edges], [np.inf]])
    values = value[np.concatenate([[0], edges])]
    spans = [
        (max(float(start), span[0]), min(float(end), span[1]))
        for start, end, mark in zip(starts, ends, values, strict=True)
        if mark != 0.0 or not signal.boolean
    ]
    found = [(start, end) for start, end in spans if end > start]
    if not found:
        raise DataError(source, "the topic of ingest.division marks no time in which both arms are recorded.")
    return found


def gaps(time: Array, span: Span, longest: float) -> list[Span]:
    """Steps of a clock, array, shape (n,), s, within `span` that are longer than `longest`, s."""
    steps = np.flatnonzero(np.diff(time) > longest)
    return [
        (float(time[step]), float(time[step + 1]))
        for step in steps
        if time[step + 1] > span[0] and time[step] < span[1]
    ]


def without_gaps(arms: Mapping[str, Path], span: Span, longest: float) -> list[Span]:
    """The parts of `span` in which no arm has a gap."""
    found = [span]
    for path in arms.values():
        for begin, end in gaps(path.time, span, longest):
            found = [
                part
                for start, stop in found
                for part in ((start, min(stop, begin)), (max(start, end), stop))
                if part[1] > part[0]
            ]
    return sorted(found)


def inside(time: Array, span: Span) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which times, array, shape (n,), lie in `span`, its ends included."""
    return np.asarray((time >= span[0]) & (time <= span[1]))


def _moves(arms: Mapping[str, Path], span: Span) -> bool:
    parts = [p.position[inside(p.time, span)] for p in arms.values()]
    return any(float(np.linalg.norm(np.ptp(part, axis=0))) >= DEAD for part in parts if part.shape[0])


def _refuse_gap(arms: Mapping[str, Path], span: Span, longest: float, source: str) -> None:
    for name, path in arms.items():
        for begin, end in gaps(path.time, span, longest):
            arm = "" if name == "point" else f"the {name} arm has "
            raise DataError(
                source,
                f"{arm}no samples for {end - begin:.3f} s, from {begin:.3f} to {end:.3f} s: divide the recording there "
                f"(ingest.division), or raise ingest.longest_gap ({longest:g} s) if the arms rest meanwhile.",
            )
