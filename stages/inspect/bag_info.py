"""`clpv info`: topics, clocks, what protects the content, and the line that ingests the recording.

Plain values only, so that they print as a table and as JSON. Nothing is written, and nothing is decided: the line is a
proposal by names and by what moves (`candidates.py`).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.errors import DataError
from stages.ingest.readers.formats import open_recording
from stages.ingest.recording import Nanoseconds, Topic
from stages.inspect.candidates import Candidate, Joints, best, find
from stages.inspect.clock_health import disorder, health, rate
from stages.inspect.own_files import Known, recognise

NANOSECONDS = 1e9

FAR = 20.0
"""Metres that no arm's hand moves: the unit may be millimetres."""

NOTHING: Mapping[str, Any] = {
    "messages": 0,
    "episodes": 0,
    "start": None,
    "duration": None,
    "protected": False,
    "integrity": "",
    "lost": "",
    "topics": [],
    "command": "",
    "reason": "",
    "notes": [],
}
"""Of what is no recording."""

MOST = 8
"""Candidates of a topic that are shown."""

RECORDING, BOOL = "/recording", "std_msgs/msg/Bool"
"""Topic that says what of a recording is a demonstration: that of `clpv teleop`, and of who does as it does."""

LATE = 0.2
"""Seconds between stamp and log that are worth a word."""


def describe(path: Path, recover: bool = False) -> dict[str, Any]:
    """What a recording holds: plain values.

    Keys: ``file``, ``format``, ``bytes``, ``written_by`` (``clpv``, ``rerun`` or empty), ``what`` (a sentence that says
    what it is, or empty), ``details`` (what a log of clpv says beside its messages), ``look`` (commands that show
    it), ``messages``, ``episodes``, ``start`` (ns), ``duration`` (s), ``protected``, ``integrity``, ``lost``,
    ``topics`` (a list, see `_topic`), ``command`` (the line to copy, or empty), ``reason`` (why that line, or why none)
    and ``notes`` (a list of sentences). Of what is known and no recording the latter are empty.

    Raises DataError where the recording cannot be opened or is damaged.
    """
    known = recognise(path)
    if known is not None and not known.recording:
        return {**_about(path, known.format, known), **NOTHING}
    with open_recording(path, recover=recover) as recording:
        topics = recording.topics()
        clocks = recording.clocks()
        episodes = len(recording.episodes())
        candidates, joints = find(recording, topics)
        integrity = recording.integrity()
        described = [_topic(topic, clocks[topic.name], candidates, episodes - 1) for topic in topics]
        command, reason = _command(path, topics, candidates, joints)
        if command and any(
            one.role == "pose" and (one.extent or 0.0) > FAR and one.text in command for one in candidates
        ):
            command += " --scale 0.001"
        spans = [(topic.first, topic.last) for topic in topics if topic.first is not None and topic.last is not None]
        start = min((first for first, _ in spans), default=None)
        end = max((last for _, last in spans), default=None)
        return {
            **_about(path, recording.format, known),
            "messages": sum(topic.count for topic in topics),
            "episodes": episodes,
            "start": start,
            "duration": None if start is None or end is None else (end - start) / NANOSECONDS,
            "protected": integrity.protected,
            "integrity": integrity.note,
            "lost": integrity.lost,
            "topics": described,
            "command": command,
            "reason": reason,
            "notes": _notes(described, candidates),
        }


def _about(path: Path, form: str, known: Known | None) -> dict[str, Any]:
    """What kind of file it is."""
    return {
        "file": path.name,
        "format": form,
        "bytes": size_of(path),
        "written_by": "" if known is None else known.writer,
        "what": "" if known is None else known.what,
        "details": {} if known is None else dict(known.details),
        "look": [] if known is None else list(known.look),
    }


def lines(description: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Rows for a table of topics: ``topic``, ``type``, ``messages``, ``Hz``, ``seconds``, ``clock``, ``looks like``."""
    return [
        {
            "topic": topic["name"],
            "type": topic["type"],
            "messages": topic["count"],
            "Hz": None if topic["hz"] is None else round(topic["hz"], 1),
            "seconds": None if topic["duration"] is None else round(topic["duration"], 2),
            "clock": _clock_words(topic),
            "looks like": topic["problem"] or "; ".join(topic["looks_like"]),
        }
        for topic in description["topics"]
    ]


def size_of(path: Path) -> int:
    """Bytes of a file, or of all files of a folder."""
    if path.is_file():
        return path.stat().st_size
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def _topic(
    topic: Topic,
    clock: tuple[Nanoseconds, Nanoseconds | None],
    candidates: Sequence[Candidate],
    resets: int,
) -> dict[str, Any]:
    log, stamp = clock
    found = health(log, stamp, resets)
    span = (topic.first, topic.last)
    return {
        "name": topic.name,
        "type": topic.type,
        "count": topic.count,
        "hz": rate(log if stamp is None else stamp),
        "duration": None if None in span else (span[1] - span[0]) / NANOSECONDS,  # type: ignore[operator]
        "clock": {
            "of": "log" if stamp is None else "header",
            **vars(found),
            "log_backward": health(log, None, resets).backward,
            "opposite": disorder(log, stamp),
        },
        "fields": list(topic.fields),
        "looks_like": _looks([candidate for candidate in candidates if candidate.topic == topic.name]),
        "problem": topic.problem,
    }


def _looks(candidates: Sequence[Candidate]) -> list[str]:
    """What the numbers of a topic may be; of frames, those that move in their parents, and how many do not."""
    rigid = [one for one in candidates if "->" in one.text and not one.moves]
    words = [_words(one) for one in candidates if one not in rigid][:MOST]
    return [*words, f"{len(rigid)} frames that never move in their parents"] if rigid else words


def _words(candidate: Candidate) -> str:
    what = {"pose": "end effector" if candidate.side else "position", "wrench": "wrench"}[candidate.role]
    words = f"{candidate.side} {what}".strip()
    if candidate.text != candidate.topic:
        words += f" ({candidate.text.removeprefix(candidate.topic + ':')})"
    if candidate.role == "wrench" or candidate.extent is None:
        return words
    return f"{words}, moves {candidate.extent:.3g} m" if candidate.moves else f"{words}, never moves"


def _clock_words(topic: Mapping[str, Any]) -> str:
    clock = topic["clock"]
    if topic["count"] == 0:
        return ""
    words = [
        f"{clock[key]} {text}"
        for key, text in (
            ("zero", "zero"),
            ("backward", "back"),
            ("duplicate", "duplicate"),
            ("opposite", "against the log"),
        )
        if clock[key]
    ]
    if clock["log_backward"] and clock["of"] == "header":
        words.append(f"log {clock['log_backward']} back")
    if clock["gaps"]:
        words.append(f"{clock['gaps']} gaps, longest {clock['longest_gap']:.3g} s")
    if clock["offset"] is not None and abs(clock["offset"]) > LATE:
        words.append(f"log {clock['offset']:+.3g} s")
    return f"{clock['of']}: {', '.join(words) or 'sane'}"


def _command(
    path: Path, topics: Sequence[Topic], candidates: Sequence[Candidate], joints: Sequence[Joints]
) -> tuple[str, str]:
    """The line to copy and why it was chosen, or an empty line and why there is none."""
    if not any(topic.count for topic in topics):
        return "", "It holds no messages, so there is nothing to ingest; record it again."
    name = re.sub(r"[^a-z0-9]+", "-", path.stem.lower()).strip("-")[:40] or "recording"
    if not name[0].isalpha():
        name = f"bag-{name}"
    line = ["clpv", "ingest", name, str(path)]
    pair = best(candidates, "pose")
    if pair is not None and (pair[0].moves or pair[1].moves):
        line += ["--left", pair[0].text, "--right", pair[1].text]
        wrenches = best(candidates, "wrench")
        if wrenches is not None:
            line += ["--left-wrench", wrenches[0].text, "--right-wrench", wrenches[1].text]
        if any(topic.name == RECORDING and topic.type == BOOL for topic in topics):
            line += ["--divide", f"topic:{RECORDING}"]
        still = [one.side for one in pair if not one.moves]
        told = f", but the {still[0]} one never moves" if still else ""
        return shlex.join(line), f"By their names and by what moves{told}."
    movers = sorted(
        (one for one in candidates if one.role == "pose" and one.moves and not one.side),
        key=lambda one: one.rank,
        reverse=True,
    )
    if len(movers) == 2:
        first, second = sorted(movers, key=lambda one: one.text)
        line += ["--left", first.text, "--right", second.text]
        return shlex.join(line), "Two positions move; no name says which is left, so the two may have to be swapped."
    return _other_command(line, topics, pair, candidates, joints)


def _other_command(
    line: list[str],
    topics: Sequence[Topic],
    pair: tuple[Candidate, Candidate] | None,
    candidates: Sequence[Candidate],
    joints: Sequence[Joints],
) -> tuple[str, str]:
    """The line where there is no pair of poses that move: joints with a URDF, one point, or none."""
    moving = [joint for joint in joints if joint.moving or joint.topic == "table"]
    if moving:
        links = ("left_gripper", "right_gripper") if moving[0].topic == "table" else ("LEFT_LINK", "RIGHT_LINK")
        line += ["--urdf", "ROBOT.urdf"]
        for option, link in zip(("--left", "--right"), links, strict=True):
            line += [option, f"{moving[0].topic}:fk({link})"]
        return shlex.join(line), (
            "It holds joint positions, no poses: give the robot's URDF and its two links, and forward kinematics does "
            "the rest."
        )
    points = sorted((one for one in candidates if one.role == "pose" and one.moves), key=lambda one: one.rank)
    if points:
        point = points[-1]
        found = f"{len(points)} positions that move" if len(points) > 1 else f"one position that moves ({point.text})"
        line += ["--point", point.text]
        return shlex.join(line), (
            f"It holds {found}, and no pair of a left and a right one: the line learns the motion of one point; "
            "for two arms, select them with --left and --right, or name one file an arm."
        )
    if pair is not None or any(one.role == "pose" for one in candidates):
        return "", "It holds poses, but none of them moves: there is no motion to learn."
    if joints:
        others = f" (only {', '.join(joints[0].others[:3])} and the like)" if joints[0].others else ""
        return "", (
            f"It holds joint positions ({joints[0].topic}), but no joint of an arm moves{others}: there is no motion "
            "to learn."
        )
    undecodable = [topic for topic in topics if topic.count and topic.problem]
    if undecodable and len(undecodable) == sum(1 for topic in topics if topic.count):
        return "", f"None of its topics can be decoded: {undecodable[0].name}: {undecodable[0].problem}"
    kinds = sorted({topic.type for topic in topics if topic.count})
    told = ", ".join(kinds[:4]) + (", …" if len(kinds) > 4 else "")
    if any("Goal" in kind or "action" in kind.lower() for kind in kinds):
        return "", f"It holds what an action server was told ({told}), but no pose and no joint positions of an arm."
    lists = [name for topic in topics if topic.type == "rows" for name in topic.fields if name.endswith("]")]
    if lists:
        columns = list(dict.fromkeys(name.partition("[")[0] for name in lists))
        sided = {side: next((c for c in columns if side in c.lower()), None) for side in ("left", "right")}
        left = f"{sided['left'] or columns[0]}[0:3]"
        right = f"{sided['right']}[0:3]" if sided["left"] and sided["right"] else f"{columns[0]}[3:6]"
        return "", (
            "No names say which numbers are positions; look which they are and select them, such as "
            f"--left '{left}' --right '{right}'."
        )
    if any(topic.type == "rows" for topic in topics):
        return "", "No columns are named like x y z of a left and a right arm; select them, such as --left lx,ly,lz."
    return "", f"It holds no pose and no joint positions of an arm, only {told}."


def _notes(topics: Sequence[Mapping[str, Any]], candidates: Sequence[Candidate]) -> list[str]:
    notes = []
    for topic in topics:
        if topic["clock"]["opposite"]:
            notes.append(
                f"{topic['name']}: header stamps and log times disagree in their order {topic['clock']['opposite']} "
                "times: a clock was set while recording."
            )
    far = [one for one in candidates if one.role == "pose" and (one.extent or 0.0) > FAR]
    if far:
        notes.append(f"{far[0].text} moves {far[0].extent:.4g} m: if it is in millimetres, set the scale to 0.001.")
    return notes


def describe_or_refuse(path: Path, recover: bool = False) -> dict[str, Any]:
    """The description, or ``{"file": …, "error": …}`` where the recording is refused: for lists of files."""
    try:
        return describe(path, recover)
    except DataError as error:
        return {"file": path.name, "error": str(error)}
