"""What `clpv teleop NAME` does: recordings of demonstrations, and the line that ingests them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.console import Console
from pipeline.errors import DataError, ParameterError, UsageError
from pipeline.experiment import NAME, parse_override
from pipeline.project import Project
from pipeline.validation import validate_as
from pipeline.values import plain
from stages.artifacts.carry_log import read_master, write_demonstration
from stages.policy.admittance import admittance_of, check_stability
from stages.policy.carrying import Clamp, Phase
from stages.policy.outcome import Outcome
from stages.teleoperation.mapping import MasterSample, SharedTeleoperation
from stages.teleoperation.masters import Master, Replay, Seen
from stages.teleoperation.parameters import (
    GamepadParameters,
    KeyboardParameters,
    MappingParameters,
    ReplayParameters,
    SimulatedOperatorParameters,
    TeleopParameters,
)
from stages.teleoperation.record import Demonstrated, demonstrate
from stages.world.boxes import check_scene, pads_beside, varied
from stages.world.bullet import CONTACT_STIFFNESS, STEP, World
from stages.world.parameters import Scene

SETTLED = 0.001
"""Metres above the goal to which an operator leads the box: it is set down from there."""

MISPLACED = 0.020
"""Metres from the goal beyond which a box has not been delivered."""

FAILED = {Phase.MISSED: Outcome.NOT_GRIPPED.remedy, Phase.LOST: Outcome.LOST_BOX.remedy}
"""What to do about a demonstration that has no end."""

WHOLE = "teleop"
"""What the modules that check settings call all of them; --set leaves it out."""


def record_demonstrations(
    project: Project, console: Console, name: str, *, count: int, seed: int, sets: Sequence[str], anew: bool
) -> None:
    """Record `count` demonstrations into datasets/<name>, seeded; with `anew` over recordings of before.

    Raises UsageError for a name that is none or taken, ParameterError for settings without a meaning, DataError where
    a demonstration fails; what was recorded until then stays.
    """
    if not NAME.fullmatch(name):
        raise UsageError(f"{name!r} is no name for a dataset: use letters, digits, dash, dot and underscore.")
    if seed < 0:
        raise ParameterError("seed", f"must be a whole number from 0, not {seed}.")
    with _located():
        given = parameters_of(sets)
        _check(project, given)
        folder = project.root / "datasets" / name
        paths = [folder / f"demo{number + 1}.mcap" for number in range(count)]
        taken = [path for path in paths if path.exists()]
        if taken and not anew:
            raise UsageError(
                f"datasets/{name}/{taken[0].name} exists already: choose another name, or add --replace to record anew."
            )
        check_stability(given.admittance, given.dt, CONTACT_STIFFNESS, printed=False, location="admittance")
        check_scene(given.scene, given.admittance.force, given.stand_off, "scene")
        folder.mkdir(parents=True, exist_ok=True)
        try:
            for number, path in enumerate(paths):
                with _window(given) as window:
                    done = _record(project, given, path, seed, number, window)
                for sentence in _said(done, given):
                    console.warn(f"datasets/{name}/{path.name}: {sentence}")
                console.note(
                    f"datasets/{name}/{path.name}: {done.time[-1]:.1f} s, the box stands "
                    f"{1e3 * _away(done, given):.1f} mm from the goal"
                )
        finally:
            with suppress(OSError):  # there is something in it
                folder.rmdir()
                folder.parent.rmdir()
    files = " ".join(f"datasets/{name}/{path.name}" for path in paths)
    line = (
        f"clpv ingest {name} {files} --left /left/pose --right /right/pose --left-wrench /left/wrench "
        "--right-wrench /right/wrench --divide topic:/recording"
    )
    console.result(line)
    console.note(f"and then, to carry boxes: clpv run {name} --set 'rollout={{kind=\"bullet\"}}'")
    console.document({"dataset": name, "files": [f"datasets/{name}/{path.name}" for path in paths], "ingest": line})


def parameters_of(sets: Sequence[str]) -> TeleopParameters:
    """The settings: ``--set scene.mass=0.5`` and the like over the defaults. Raises ParameterError."""
    table: dict[str, Any] = {}
    for text in sets:
        location, value = parse_override(text)
        here, parts = table, location.split(".")
        for depth, part in enumerate(parts[:-1]):
            here = here.setdefault(part, {})
            if not isinstance(here, dict):
                raise ParameterError(location, f"{'.'.join(parts[: depth + 1])} is a value and has no parts.")
        here[parts[-1]] = value
    found: TeleopParameters = validate_as(TeleopParameters, WHOLE, table)
    return found


@contextmanager
def _located() -> Iterator[None]:
    """Settings are named as they are given with --set, without the name of the whole."""
    try:
        yield
    except ParameterError as error:
        prefix = f"{WHOLE}."
        raise ParameterError(error.location.removeprefix(prefix), error.problem.replace(prefix, "")) from None


def _check(project: Project, given: TeleopParameters) -> None:
    """Refuse what cannot work, before a window is opened or a file written. Raises ParameterError, DataError."""
    steps = given.dt / STEP
    if abs(steps - round(steps)) > 1e-9 or steps < 0.5:
        raise ParameterError("dt", f"{given.dt:g} s is no whole number of milliseconds.")
    mapping = _mapping(given, given.scene)
    if isinstance(given.master, ReplayParameters):
        _replay(project, given.master)
    elif isinstance(given.master, SimulatedOperatorParameters):
        _simulated(given, given.scene, given.master, mapping, np.random.default_rng(0))


def _window(given: TeleopParameters) -> Any:
    """A window to drive in, for the masters that need one."""
    if not isinstance(given.master, KeyboardParameters | GamepadParameters):
        return nullcontext()
    from stages.teleoperation.devices import open_window

    return open_window(given.master)


class _InRealTime:
    """A master that a hand moves: the simulation, which is faster, waits for the clock on the wall."""

    def __init__(self, master: Master) -> None:
        self._master = master
        self._begin = time.monotonic()

    @property
    def done(self) -> bool:
        return self._master.done

    def sample(self, time_: float, seen: Seen) -> MasterSample | None:
        time.sleep(max(self._begin + time_ - time.monotonic(), 0.0))
        return self._master.sample(time_, seen)


def _plain(given: TeleopParameters) -> dict[str, Any]:
    """Parameters as a recording keeps them; of a file that was replayed its name, not where it lay."""
    values: dict[str, Any] = plain(given)
    if "file" in values["master"]:
        values["master"]["file"] = Path(values["master"]["file"]).name
    return values


def _record(project: Project, given: TeleopParameters, path: Path, seed: int, number: int, window: Any) -> Demonstrated:
    """Record one demonstration into a file. Raises DataError, and writes nothing, where it did not come to its end."""
    generator = np.random.default_rng([seed, number])
    scene = varied(given.scene, generator)
    mapping = _mapping(given, scene)
    clamp = Clamp(
        length=mapping.separation,
        admittance=admittance_of(given.admittance, printed=False),
        squeeze=0.0,
        stand_off=given.stand_off,
        approach_speed=given.approach_speed,
        release_speed=given.approach_speed,
    )
    master = _master(project, given, scene, mapping, generator, window)
    with World(scene, generator, "scene") as world:
        done = demonstrate(
            world,
            mapping,
            master,
            clamp,
            force=given.admittance.force,
            dt=given.dt,
            record=given.record,
            longest=given.longest,
        )
    if done.ended is not Phase.DONE:
        why = FAILED.get(done.ended, "It was broken off: raise longest, or let the operator come to an end.")
        raise DataError(path.name, f"not kept, it ended in phase {done.ended} after {done.time[-1]:.1f} s. {why}")
    part = path.with_suffix(".part")
    try:
        write_demonstration(part, done, seed, number, scene.robot, _plain(given))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return done


def _away(done: Demonstrated, given: TeleopParameters) -> float:
    """Metres between where the box stands at last and the goal."""
    return float(np.linalg.norm(done.box[-1] - np.array(given.scene.goal)))


def _said(done: Demonstrated, given: TeleopParameters) -> Iterator[str]:
    """What a person should know of a demonstration that has been kept: a sentence each."""
    if done.lost > 0.0:
        yield (
            f"for {done.lost:.1f} s the master was not followed, its samples were stale or not finite and the arms "
            "stood still: release the clutch and press it, or raise stale."
        )
    if done.limited > 0.0:
        yield f"for {done.limited:.1f} s the pads were at the edge of their workspace: widen low and high."
    if _away(done, given) > MISPLACED:
        yield f"the box stands {1e3 * _away(done, given):.0f} mm from the goal: not one to learn from."


def _mapping(given: TeleopParameters, scene: Scene) -> SharedTeleoperation:
    """From the master to the pads, which begin beside the box. Raises ParameterError where they cannot."""
    length = scene.box[1] + scene.length_error
    chosen = MappingParameters(
        alpha=given.alpha,
        R_mf=given.R_mf,
        separation=length,
        low_pass=given.low_pass,
        stale=given.stale,
        low=given.low,
        high=given.high,
    )
    try:
        return SharedTeleoperation(chosen, pads_beside(np.array(scene.start), length)[0], location=WHOLE)
    except DataError as error:
        raise ParameterError("scene.start", error.problem) from None
    except ParameterError as error:
        place = error.location.replace(f"{WHOLE}.separation", "scene.box")  # of which it is made
        raise ParameterError(place, error.problem) from None


def _master(
    project: Project,
    given: TeleopParameters,
    scene: Scene,
    mapping: SharedTeleoperation,
    generator: np.random.Generator,
    window: Any,
) -> Master:
    """Who leads."""
    chosen = given.master
    if isinstance(chosen, ReplayParameters):
        return _replay(project, chosen)
    if isinstance(chosen, KeyboardParameters):
        from stages.teleoperation.devices import Keyboard

        return _InRealTime(Keyboard(chosen, window, location=f"{WHOLE}.master"))
    if isinstance(chosen, GamepadParameters):
        from stages.teleoperation.devices import Gamepad

        return _InRealTime(Gamepad(chosen, window, location=f"{WHOLE}.master"))
    return _simulated(given, scene, chosen, mapping, generator)


def _replay(project: Project, chosen: ReplayParameters) -> Replay:
    path = project.root / chosen.file
    return Replay(*read_master(path), source=path.name)


def _simulated(
    given: TeleopParameters,
    scene: Scene,
    chosen: SimulatedOperatorParameters,
    mapping: SharedTeleoperation,
    generator: np.random.Generator,
) -> Master:
    """An operator who lifts the box, leads it over the goal and down to it. Raises ParameterError."""
    from stages.teleoperation.simulated import SimulatedOperator

    start, goal, up = np.array(scene.start), np.array(scene.goal), np.array([0.0, 0.0, given.lift])
    over = max(start[2], goal[2]) + given.lift
    middle = np.array([*(0.5 * (start + goal))[:2], over + 0.2 * given.lift])
    via = np.array([start, start + up, middle, goal + up, goal + np.array([0.0, 0.0, SETTLED])])
    left = via + pads_beside(np.zeros(3), mapping.separation)[0]
    outside = ((left < mapping.low) | (left > mapping.high)).any(axis=1)
    if outside.any():
        place = ", ".join(f"{value:.3g}" for value in via[int(np.argmax(outside))])
        raise ParameterError(
            "scene.goal",
            f"the way there leads the box to [{place}] m, where a pad is outside of low and high: widen them.",
        )
    return SimulatedOperator(
        chosen,
        via,
        generator,
        alpha=mapping.alpha,
        R_mf=mapping.R_mf,
        leads_in=(str(Phase.CARRY),),
        location=f"{WHOLE}.master",
    )
