"""From recordings to demonstrations: open, select, clean, divide; the table to read of what `ingest` does with bags.

Formats, selections, cleaning and division have modules of their own; here is their order. No part of the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.ingest import segments
from stages.ingest.cleaning import CleanArm, clean
from stages.ingest.clocks import SECOND, arm_name, choose_clock, header_problem
from stages.ingest.parameters import RecordingParameters, Source, TopicDivision
from stages.ingest.recording import Nanoseconds, Recording, Report
from stages.ingest.selections.extractors import Flag
from stages.ingest.selections.kinematics import Robot, read_robot
from stages.ingest.selections.resolved import Quantity, Resolved, Track
from stages.ingest.selections.selection import Selection, parse
from stages.ingest.sources import check_digests, check_parameters, regroup
from stages.trajectory import ArmRecording, Array, Demonstration

ARMS = ("left", "right", "point")

Wanted = tuple[str, Selection, Quantity]
"""Name (of an arm, a wrench or ``division``), selection, and what it selects."""


def ingest(
    files: Mapping[str, Path], parameters: RecordingParameters, warn: Callable[[str], None]
) -> tuple[list[Demonstration], dict[str, Any]]:
    """Demonstrations of labelled files, and what was counted on the way; sentences for the user go to `warn`."""
    groups, urdf = regroup(parameters, files)
    demonstrations, report = read_recordings(groups, parameters, urdf)
    for note in report.notes:
        warn(note)
    return demonstrations, {"counts": report.counts, "sources": report.sources}


def read_recordings(
    groups: Sequence[Sequence[Path]], parameters: RecordingParameters, urdf: Path | None = None
) -> tuple[list[Demonstration], Report]:
    """Clean demonstrations of all sources, in order, and what was found and done to make them.

    Arguments:
        groups: files or folders of each of `parameters.sources`.
        urdf: robot description, where a selection needs one.

    Raises DataError, naming the file and the place, where a recording cannot be used; ParameterError where a parameter
    is wrong or two demonstrations have one name.
    """
    check_parameters(parameters)
    report = Report()
    robot = None if urdf is None else read_robot(_text(urdf), urdf.name)
    demonstrations: list[Demonstration] = []
    for index, (paths, source) in enumerate(zip(groups, parameters.sources, strict=True)):
        check_digests(paths, source.sha256)
        of_source = Report()
        found = _read_source(index, paths, source, parameters, robot, of_source)
        of_source.count("demonstrations", len(found))
        report.add(" and ".join(source.files), of_source)
        demonstrations += found
    names = [demonstration.demo for demonstration in demonstrations]
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(
                "ingest.sources", f"two demonstrations are called {name!r}: name them with demo = '…'."
            )
    return demonstrations, report


def _read_source(
    index: int,
    paths: Sequence[Path],
    source: Source,
    parameters: RecordingParameters,
    robot: Robot | None,
    report: Report,
) -> list[Demonstration]:
    """The demonstrations of one recording, or of two of one arm each."""
    from stages.ingest.readers.formats import open_recording

    name = " and ".join(path.name for path in paths)
    with ExitStack() as stack:
        recordings = [stack.enter_context(open_recording(path, recover=parameters.recover)) for path in paths]
        for recording in recordings:
            if recording.integrity().lost:
                report.notes.append(f"{recording.path.name}: {recording.integrity().lost}")
        episodes = recordings[0].episodes()
        if any(recording.episodes() != episodes for recording in recordings[1:]):
            raise DataError(name, "the recordings of the two arms do not hold the same episodes.")
        demonstrations = []
        base = source.demo or str(index + 1)
        for episode in episodes:
            place = f"{name}, episode {episode}" if episode else name
            tracks, resolved = _tracks(recordings, parameters, robot, episode)
            pieces = _demonstrations(tracks, resolved, parameters, place, report)
            label = f"{base}-{episode}" if len(episodes) > 1 else base
            divided = parameters.division.kind != "none"
            for number, arms in enumerate(pieces, start=1):
                demo = f"{label}-{number}" if divided else label
                demonstrations.append(
                    Demonstration(dataset=parameters.dataset, demo=demo, split=source.split, arms=arms)
                )
    return demonstrations


def _wanted(parameters: RecordingParameters) -> list[Wanted]:
    """All selections of an experiment."""
    found: list[Wanted] = []
    for name in ARMS:
        text = getattr(parameters, name)
        if text is not None:
            found.append((name, parse(text, f"ingest.{name}"), "pose"))
    for name in ("left_wrench", "right_wrench"):
        text = getattr(parameters, name)
        if text is not None:
            found.append((name, parse(text, f"ingest.{name}"), "force"))
    if isinstance(parameters.division, TopicDivision):
        found.append(("division", parse(parameters.division.topic, "ingest.division.topic"), "number"))
    return found


def _tracks(
    recordings: Sequence[Recording], parameters: RecordingParameters, robot: Robot | None, episode: str
) -> tuple[dict[str, Track], dict[str, Resolved]]:
    """What every selection finds in its recording; each recording is read once."""
    topics = [recording.topics() for recording in recordings]
    chosen: list[dict[str, Resolved]] = [{} for _ in recordings]
    for name, selection, quantity in _wanted(parameters):
        # Of two recordings the first is the left arm's where both would do.
        order = sorted(range(len(recordings)), reverse=name.startswith("right"))
        which = next((number for number in order if selection.fits(topics[number], quantity)), order[0])
        chosen[which][name] = selection.resolve(topics[which], recordings[which].path.name, robot, quantity)
    tracks: dict[str, Track] = {}
    for recording, selected in zip(recordings, chosen, strict=True):
        if not selected:
            raise DataError(
                recording.path.name, "none of the selections is of this recording: give it alone, or leave it out."
            )
        found = recording.read([resolved.request for resolved in selected.values()], episode)
        for (name, resolved), samples in zip(selected.items(), found, strict=True):
            tracks[name] = resolved.track(samples, parameters.scale if name in ARMS else 1.0)
    return tracks, {name: resolved for selected in chosen for name, resolved in selected.items()}


def _demonstrations(
    tracks: Mapping[str, Track],
    resolved: Mapping[str, Resolved],
    parameters: RecordingParameters,
    place: str,
    report: Report,
) -> list[dict[str, ArmRecording]]:
    """The arms of each demonstration in one recording, cleaned, on a clock that starts at 0."""
    arm_tracks = {name: tracks[name] for name in ARMS if name in tracks}
    clock = choose_clock(arm_tracks, parameters.clock, place, report)
    arms = {name: clean(track, clock, arm_name(place, name), parameters, report) for name, track in arm_tracks.items()}
    origin = min(int(arm.time[0]) for arm in arms.values())
    paths = {name: segments.Path(time=_seconds(arm.time, origin), position=arm.position) for name, arm in arms.items()}
    reference = next(iter(arm_tracks.values()))
    signal = None
    if "division" in tracks:
        time, value = _aside(tracks["division"], clock, reference, origin)
        flag = resolved["division"].request.extract
        signal = segments.Signal(time=time, value=value[:, 0], boolean=isinstance(flag, Flag) and flag.boolean)
    forces = {}
    for name in arms:
        if f"{name}_wrench" in tracks:
            time, force = _aside(tracks[f"{name}_wrench"], clock, reference, origin)
            forces[name] = on_clock(paths[name].time, time, force, parameters.longest_gap)
            unknown = int(np.isnan(forces[name]).any(axis=1).sum())
            report.count("forces_missing", unknown)
            if unknown == forces[name].shape[0]:
                raise DataError(
                    f"{place}, {name} wrench", "has no force while the arm is recorded: select another topic."
                )
    spans = segments.split(paths, parameters, signal, place, report)
    found = []
    for span in spans:
        kept = {name: segments.inside(path.time, span) for name, path in paths.items()}
        report.count("samples", sum(int(rows.sum()) for rows in kept.values()))
        found.append(
            {
                name: _recording(arms[name], paths[name].time, forces.get(name), rows, span[0])
                for name, rows in kept.items()
            }
        )
    return found


def on_clock(time: Array, recorded: Array, values: Array, longest_gap: float) -> Array:
    """Values, array, shape (m, d), recorded at `recorded`, shape (m,), s, at `time`, shape (n,), s: between neighbours.

    nan outside, and where the neighbours are more than `longest_gap`, s, apart.
    """
    if recorded.size == 0:
        return np.full((time.size, values.shape[1]), np.nan)
    found = np.column_stack([np.interp(time, recorded, axis, left=np.nan, right=np.nan) for axis in values.T])
    after = np.clip(np.searchsorted(recorded, time), 1, max(recorded.size - 1, 1))
    if recorded.size > 1:
        found[(recorded[after] - recorded[after - 1] > longest_gap) & ~np.isin(time, recorded)] = np.nan
    return np.asarray(found)


def _recording(arm: CleanArm, time: Array, force: Array | None, rows: Any, start: float) -> ArmRecording:
    return ArmRecording(
        time=time[rows] - start,
        position=arm.position[rows],
        quaternion=None if arm.quaternion is None else arm.quaternion[rows],
        force=None if force is None else force[rows],
    )


def _aside(track: Track, clock: str, reference: Track, origin: int) -> tuple[Array, Array]:
    """What is not an arm (a wrench, a signal) on the arms' clock: times, array, shape (n,), s, increasing, and values.

    Where it has no sane stamps of its own but the arms' clock is the headers', its log times are read off between the
    reference's log times and stamps.
    """
    if clock == "log" or reference.stamp is None:
        seconds = _seconds(track.log_time, origin)
    elif track.stamp is not None and not header_problem(track):
        seconds = _seconds(track.stamp, origin)
    else:
        kept = reference.stamped
        log, stamp = reference.log_time[kept], reference.stamp[kept]
        order = np.argsort(log, kind="stable")
        begin = int(log[order[0]])
        nearest = np.interp(_seconds(track.log_time, begin), _seconds(log[order], begin), np.arange(order.size))
        index = np.clip(np.round(nearest).astype(np.intp), 0, order.size - 1)
        seconds = _seconds(track.log_time - log[order][index] + stamp[order][index], origin)
    usable = np.isfinite(track.values).all(axis=1)
    seconds, values = seconds[usable], track.values[usable]
    order = np.argsort(seconds, kind="stable")
    fresh = np.ones(order.size, dtype=np.bool_)
    fresh[1:] = np.diff(seconds[order]) > 0
    return seconds[order][fresh], values[order][fresh]


def _seconds(time: Nanoseconds, origin: int) -> Array:
    return np.asarray((time - origin) / SECOND)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise DataError(path.name, f"cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise DataError(path.name, "is not a URDF, or is damaged: it is not text.") from None
