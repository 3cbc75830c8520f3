"""`clpv teleop`: what is recorded, what is refused and where it says so, and what is left behind when it fails."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from frame_trees import placed
from support import CHECKOUT, Invoke
from typer.testing import Result

from pipeline.errors import ParameterError
from stages import demonstrate
from stages.artifacts.carry_log import CLUTCH, MASTER, read_master
from stages.artifacts.channels import Channel, Flags, Poses, Words
from stages.artifacts.log import read_details, read_log, read_parameters, write_log
from stages.policy.carrying import Phase
from stages.teleoperation.parameters import KeyboardParameters, SimulatedOperatorParameters, TeleopParameters
from stages.teleoperation.record import Demonstrated

START, GOAL = [0.50, -0.03, 0.35], [0.52, 0.03, 0.35]
SHORT = [
    *("--set", f"scene.start={START}"),
    *("--set", f"scene.goal={GOAL}"),
    *("--set", "scene.variation.start=0.01"),
    *("--set", "lift=0.03"),
    *("--set", "stand_off=0.02"),
]
"""A way of 6 cm, on supports of one height."""


def files(root: Path) -> list[str]:
    return sorted(path.relative_to(root).as_posix() for path in root.rglob("*"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """A project with one demonstration, and what the command said, in a process of its own."""
    root = tmp_path_factory.mktemp("project")
    words = ["teleop", "short", "--count", "1", "--seed", "4", *SHORT, "--json"]
    done = subprocess.run(
        [sys.executable, "-c", "from stages.cli import app; app()", *words],
        env={**os.environ, "CLPV_ROOT": str(root), "PYTHONPATH": str(CHECKOUT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return root, done


def end(path: Path) -> float:
    """Metres between the box at the end of a recording and the goal."""
    box = read_log(path)["/box/pose"]
    assert isinstance(box, Poses)
    return float(np.linalg.norm(box.position[-1] - GOAL))


# --- what is recorded -----------------------------------------------------------------------------------------------


def test_one_demonstration_is_one_file(recorded: tuple[Path, Any]) -> None:
    root, _ = recorded
    assert files(root) == ["datasets", "datasets/short", "datasets/short/demo1.mcap"]
    path = root / "datasets/short/demo1.mcap"
    assert read_details(path) == {
        "what": "demonstration by shared teleoperation",
        "seed": 4,
        "number": 0,
        "robot": "iiwa",
    }
    assert read_parameters(path)["scene"]["robot"] == "iiwa"
    assert end(path) < 0.005
    log = read_log(path)
    words = log["/phase"]
    assert isinstance(words, Words)
    assert words.values == ("approach", "grip", "carry", "set-down", "release", "done")
    led, clutch, master = log["/recording"], log[CLUTCH], log[MASTER]
    assert isinstance(led, Flags)
    assert isinstance(clutch, Flags)
    assert isinstance(master, Poses)
    # What is learned from begins with the carrying and ends before the box is set down.
    begin, after = words.time[2], words.time[3]
    assert np.array_equal(led.values, (led.time >= begin) & (led.time < after))
    assert clutch.values.any()
    assert not clutch.values[clutch.time < begin].any()
    assert np.diff(led.time)[:-1] == pytest.approx(0.02)  # and the end, whenever it is


def test_the_recorded_frames_lead_to_the_pads(recorded: tuple[Path, Any]) -> None:
    log = read_log(recorded[0] / "datasets/short/demo1.mcap")
    trees = [log["/tf_static"], log["/tf"]]
    for k in (0, log["/tf"].time.size // 2):
        places = placed(trees, k)
        for side in ("left", "right"):
            pose = log[f"/{side}/pose"]
            assert isinstance(pose, Poses)
            assert places[f"{side}_pad"][:3, 3] == pytest.approx(pose.position[k], abs=1e-9)


def test_the_pads_copy_the_strokes_of_the_master(recorded: tuple[Path, Any]) -> None:
    """Eq. (2) with alpha 1 and no rotation: while the clutch is held both have come as far, but for tremor and lag."""
    log = read_log(recorded[0] / "datasets/short/demo1.mcap")
    left, right, master, clutch = (log[topic] for topic in ("/left/pose", "/right/pose", MASTER, CLUTCH))
    assert isinstance(left, Poses)
    assert isinstance(right, Poses)
    assert isinstance(master, Poses)
    assert isinstance(clutch, Flags)
    assert master.time.shape == left.time.shape
    held = clutch.values[:-1] & clutch.values[1:]
    came = np.diff(0.5 * (left.position + right.position), axis=0)[held].sum(axis=0)
    assert came == pytest.approx(np.diff(master.position, axis=0)[held].sum(axis=0), abs=0.005)
    assert np.linalg.norm(came[:2]) > 0.03
    # Eq. (3): the right pad keeps beside the left one, L apart, but for how deep both press.
    apart = left.position - right.position
    carried = clutch.values
    assert np.abs(apart[carried][:, [0, 2]]).max() < 0.003
    assert apart[carried][:, 1] == pytest.approx(0.30, abs=0.01)


def test_standard_output_is_one_json_document(recorded: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    _, done = recorded
    document = json.loads(done.stdout)
    assert document["dataset"] == "short"
    assert document["files"] == ["datasets/short/demo1.mcap"]
    words = document["ingest"].split()
    assert words[:4] == ["clpv", "ingest", "short", "datasets/short/demo1.mcap"]
    assert words[-2:] == ["--divide", "topic:/recording"]
    assert "mm from the goal" in done.stderr


def test_the_line_that_ingests_it_works(
    recorded: tuple[Path, Any], tmp_path: Path, clpv: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, done = recorded
    monkeypatch.chdir(tmp_path)
    (tmp_path / "datasets/short").mkdir(parents=True)
    (tmp_path / "datasets/short/demo1.mcap").write_bytes((root / "datasets/short/demo1.mcap").read_bytes())
    result = clpv(tmp_path, *json.loads(done.stdout)["ingest"].split()[1:])
    assert result.exit_code == 0, result.output
    assert "1 demonstrations" in result.stderr


def test_a_recorded_master_is_followed_again(recorded: tuple[Path, Any], clpv: Invoke) -> None:
    root, _ = recorded
    words = ["teleop", "again", "--count", "1", "--seed", "4", "--master", "replay:datasets/short/demo1.mcap"]
    result = clpv(root, *words, *SHORT)
    assert result.exit_code == 0, result.output
    assert "warning" not in result.stderr
    assert end(root / "datasets/again/demo1.mcap") < 0.005


def test_a_master_that_falls_silent_is_not_followed(recorded: tuple[Path, Any], tmp_path: Path, clpv: Invoke) -> None:
    """From a stroke on nothing comes for longer than `stale`: the arms stand still, and it is said."""
    root, _ = recorded
    time, position, quaternion, clutch = read_master(root / "datasets/short/demo1.mcap")
    first = int(np.argmax(clutch)) + 10
    assert clutch[first : first + 20].all()
    kept = np.ones(time.size, dtype=bool)
    kept[first : first + 20] = False
    channels: list[Channel] = [
        Poses(topic=MASTER, frame="m", time=time[kept], position=position[kept], quaternion=quaternion[kept]),
        Flags(topic=CLUTCH, time=time[kept], values=clutch[kept]),
    ]
    write_log(tmp_path / "gap.mcap", channels, {})
    words = ["teleop", "gap", "--count", "1", "--seed", "4", "--master", f"replay:{tmp_path / 'gap.mcap'}", "--quiet"]
    result = clpv(tmp_path, *words, *SHORT)
    assert result.exit_code == 0, result.output
    assert "s the master was not followed, its samples were stale or not finite" in result.stderr
    assert end(tmp_path / "datasets/gap/demo1.mcap") > 0.005


# --- keys -----------------------------------------------------------------------------------------------------------


def test_keys_lead_the_box_in_real_time(tmp_path: Path, clpv: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    """By events posted to pygame, in a window that nobody sees; the wall clock is one of our own."""
    pygame = pytest.importorskip("pygame")
    from stages.teleoperation import devices

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    clock = SimpleNamespace(now=100.0)

    def sleep(seconds: float) -> None:
        clock.now += seconds

    monkeypatch.setattr(demonstrate, "time", SimpleNamespace(monotonic=lambda: clock.now, sleep=sleep))
    # 0.1 m/s: 3 cm up, 2 cm forward, 6 cm to the left, 3 cm down.
    script = [(0.1, "space", 60.0)]
    at = 2.5
    for key, held in (("e", 0.3), ("w", 0.2), ("a", 0.6), ("q", 0.29)):
        script.append((at, key, held))
        at += held + 0.2
    script.append((at + 0.5, "escape", 60.0))
    posted = sorted(
        [(time, pygame.KEYDOWN, key) for time, key, _ in script]
        + [(time + held, pygame.KEYUP, key) for time, key, held in script]
    )
    original = devices.Window.get

    def get(window: Any) -> Sequence[Any]:
        while posted and posted[0][0] <= clock.now - 100.0 + 1e-9:
            _, kind, key = posted.pop(0)
            pygame.event.post(pygame.event.Event(kind, key=pygame.key.key_code(key)))
        return original(window)

    monkeypatch.setattr(devices.Window, "get", get)
    words = ["teleop", "keys", "--count", "1", "--master", "keyboard", *SHORT, "--set", "scene.variation.start=0"]
    result = clpv(tmp_path, *words)
    assert result.exit_code == 0, result.output
    path = tmp_path / "datasets/keys/demo1.mcap"
    assert end(path) < 0.005
    assert clock.now - 100.0 == pytest.approx(read_log(path)["/box/pose"].time[-1], abs=0.005)
    assert not pygame.get_init()


# --- refusals -------------------------------------------------------------------------------------------------------


def refused(root: Path, clpv: Invoke, *words: str) -> Result:
    """A call that records nothing, of one sentence; whatever was there is there as before."""
    before = files(root)
    result = clpv(root, "teleop", "mine", "--count", "1", *words)
    assert files(root) == before
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("error: ")
    return result


TURN = "R_mf=[1, 0, 0, 0, 1, 0, 0, 0"


@pytest.mark.parametrize(
    ("given", "location", "sentence"),
    [
        ("scene.mas=1", "scene.mas", "unknown parameter; did you mean 'mass'?"),
        ("scene.mass=-1", "scene.mass", "should be greater than 0, not -1."),
        ("scene.mass=4", "scene.mass", "4 kg slip out of two pads that press with 5 N"),
        ("scene.start=[0.1]", "scene.start", "must have 3 entries, not 1."),
        ("scene.start=[0.1, 0.2, 0.3, 0.4]", "scene.start", "must have 3 entries, not 4."),
        ("scene=3", "scene", "should be a table, not 3."),
        ("alpha=0", "alpha", "should be greater than 0, not 0."),
        ("alpha=-1", "alpha", "should be greater than 0, not -1."),
        ("alpha=nan", "alpha", "should be a finite number, not NaN."),
        (f"{TURN}, 2]", "R_mf", "is no rotation: R'R differs from I by 3"),
        (f"{TURN}, -1]", "R_mf", "is no rotation: R'R differs from I by 0 (at most 1e-09 is allowed) and det = -1"),
        ("R_mf=[0, 0, 0, 2]", "R_mf", "is a quaternion of length 2, which must be 1; of length 1 it is [0, 0, 0, 1]."),
        ("R_mf=[1, 0]", "R_mf", "must be nine finite numbers, row by row, or a unit quaternion"),
        ("stale=0", "stale", "should be greater than 0, not 0."),
        ("low=[0.3, -0.6]", "low", "must have 3 entries, not 2."),
        ("low=[0.3, 0.7, 0.1]", "high", "must be above low along y; exchange the two."),
        ("low=[0.5, -0.6, 0.1]", "scene.start", "the left pad starts at x = 0.45 m, where both pads are within low"),
        ("high=[0.6, 0.6, 0.9]", "scene.goal", "the way there leads the box to [0.65, 0.15, 0.57] m, where a pad"),
        ("lift=0.5", "scene.goal", "the way there leads the box to [0.55, 0, 1.07] m"),
        ("scene.box=[0.2, 2.0, 0.2]", "scene.box", "2 m do not fit into a workspace of 1.2 m along y"),
        ("dt=0.0035", "dt", "0.0035 s is no whole number of milliseconds."),
        ("dt=0.0001", "dt", "0.0001 s is no whole number of milliseconds."),
        ("master.tremor_band=[12.0, 8.0]", "master.tremor_band", "must be the lower frequency, then the higher one."),
        ("master.tremor=1.0", "master.tremor", "should be less than 0.001, not 1.0."),
        ("master.tremr=0.0", "master.tremr", "unknown parameter; did you mean 'tremor'?"),
        ("nonsense=1", "nonsense", "unknown parameter; "),
        ("scene.mass.kg=1", "scene.mass", "should be a valid number"),
    ],
)
def test_a_setting_is_refused_by_its_name_as_given(
    tmp_path: Path, clpv: Invoke, given: str, location: str, sentence: str
) -> None:
    result = refused(tmp_path, clpv, "--set", given)
    assert result.exit_code == 2
    assert result.stderr.startswith(f"error: {location}: {sentence}")
    assert "teleop" not in result.stderr.removeprefix(f"error: {location}: ").replace("teleoperation", "")


@pytest.mark.parametrize(
    ("master", "exit_code", "sentence"),
    [
        ("simualted", 2, "master.kind: there is no kind 'simualted'; did you mean 'simulated'? Valid: gamepad, "),
        ("", 2, "master.kind: there is no kind ''; Valid: gamepad, keyboard, replay, simulated."),
        ("replay", 2, "master.file: must be given."),
        ("simulated:file.mcap", 2, "master.file: unknown parameter; "),
        ("replay:nix.mcap", 1, "nix.mcap: does not exist."),
        ("replay:text.mcap", 1, "text.mcap: is no MCAP file, or is damaged"),
        ("replay:nan.mcap", 1, "nan.mcap: "),
    ],
)
def test_a_master_that_is_none_is_refused(
    tmp_path: Path, clpv: Invoke, master: str, exit_code: int, sentence: str
) -> None:
    (tmp_path / "text.mcap").write_text("nothing")
    time, turned = np.arange(3) / 50.0, np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    position = np.zeros((3, 3))
    position[1, 2] = np.nan
    channels: list[Channel] = [
        Poses(topic=MASTER, frame="m", time=time, position=position, quaternion=turned),
        Flags(topic=CLUTCH, time=time, values=np.ones(3, dtype=bool)),
    ]
    write_log(tmp_path / "nan.mcap", channels, {})
    result = refused(tmp_path, clpv, "--master", master)
    assert result.exit_code == exit_code
    assert result.stderr.startswith(f"error: {sentence}")


def test_a_seed_below_zero_is_refused(tmp_path: Path, clpv: Invoke) -> None:
    result = refused(tmp_path, clpv, "--seed", "-1")
    assert (result.exit_code, result.stderr) == (2, "error: seed: must be a whole number from 0, not -1.\n")


@pytest.mark.parametrize("text", ["nonsense", "=3"])
def test_a_setting_that_is_none_is_refused(tmp_path: Path, clpv: Invoke, text: str) -> None:
    assert refused(tmp_path, clpv, "--set", text).stderr.startswith(f"error: --set {text}: write it as name=value")


def test_a_value_has_no_parts() -> None:
    with pytest.raises(ParameterError, match="scene is a value and has no parts") as caught:
        demonstrate.parameters_of(["scene=3", "scene.mass=1"])
    assert caught.value.location == "scene.mass"


@pytest.mark.parametrize("name", ["", ".", "a/b", "../up", "-x y"])
def test_a_name_that_is_none_is_refused(tmp_path: Path, clpv: Invoke, name: str) -> None:
    result = clpv(tmp_path, "teleop", "--count", "1", "--", name)
    assert result.exit_code == 2
    assert "is no name for a dataset" in result.stderr
    assert files(tmp_path) == []


def test_keys_without_a_display_are_refused(tmp_path: Path, clpv: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "nix")
    result = refused(tmp_path, clpv, "--master", "keyboard")
    assert result.exit_code == 2
    assert "needs a window, and none can be opened" in result.stderr


# --- settings -------------------------------------------------------------------------------------------------------


def test_settings_lie_over_the_defaults() -> None:
    assert demonstrate.parameters_of([]) == TeleopParameters()
    found = demonstrate.parameters_of(["scene.mass=0.5", "scene.variation.bias=0.1", "alpha=2"])
    assert (found.scene.mass, found.scene.variation.bias, found.alpha) == (0.5, 0.1, 2.0)
    simulated = demonstrate.parameters_of(['master.kind="simulated"', "master.tremor=0.0"])
    assert simulated.master == SimulatedOperatorParameters(tremor=0.0)
    # The last one counts: --master comes first.
    keys = demonstrate.parameters_of(['master.kind="simulated"', "master.kind=keyboard", "master.up=r"])
    assert keys.master == KeyboardParameters(up="r")


# --- failures, with demonstrations that are made up -----------------------------------------------------------------


def made(ended: Phase = Phase.DONE, **changes: Any) -> Demonstrated:
    """A demonstration of three samples, the box at the goal."""
    still = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    done = Demonstrated(
        time=np.arange(3) / 50.0,
        phase=np.full(3, list(Phase).index(Phase.CARRY), dtype=np.int8),
        joints=np.zeros((3, 2, 7)),
        pads=np.zeros((3, 2, 3)),
        force=np.zeros((3, 2)),
        box=np.tile([0.65, 0.15, 0.47], (3, 1)),
        turn=still,
        master=np.zeros((3, 3)),
        handle=still,
        clutch=np.ones(3, dtype=bool),
        ended=ended,
    )
    return replace(done, **changes)


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Let demonstrations end so, one after the other, without simulating any."""

    def set_up(*demonstrations: Demonstrated) -> None:
        waiting = list(demonstrations)
        monkeypatch.setattr(demonstrate, "demonstrate", lambda *given, **options: waiting.pop(0))
        monkeypatch.setattr(demonstrate, "check_scene", lambda *given: None)

    return set_up


def test_what_is_there_is_recorded_over_only_when_told(tmp_path: Path, clpv: Invoke, ends: Callable[..., None]) -> None:
    ends(made(), made(), made(force=np.ones((3, 2))))
    assert clpv(tmp_path, "teleop", "mine", "--count", "2", "--quiet").stderr == ""
    paths = [tmp_path / "datasets/mine" / f"demo{number}.mcap" for number in (1, 2)]
    before = [path.read_bytes() for path in paths]
    assert before[0] != before[1]  # each says its number
    result = refused(tmp_path, clpv)
    assert result.exit_code == 2
    assert "datasets/mine/demo1.mcap exists already: choose another name, or add --replace" in result.stderr
    assert [path.read_bytes() for path in paths] == before
    assert clpv(tmp_path, "teleop", "mine", "--count", "1", "--replace").exit_code == 0
    assert paths[0].read_bytes() != before[0]
    assert paths[1].read_bytes() == before[1]


@pytest.mark.parametrize(
    ("ended", "remedy"),
    [
        (Phase.MISSED, "The pads found no box"),
        (Phase.LOST, "A pad lost the box on the way"),
        (Phase.CARRY, "It was broken off: raise longest"),
    ],
)
def test_a_demonstration_without_an_end_is_not_kept(
    tmp_path: Path, clpv: Invoke, ends: Callable[..., None], ended: Phase, remedy: str
) -> None:
    ends(made(ended))
    result = refused(tmp_path, clpv)
    assert result.exit_code == 1
    assert f"demo1.mcap: not kept, it ended in phase {ended} after 0.0 s. {remedy}" in result.stderr


def test_what_was_recorded_before_a_failure_stays(tmp_path: Path, clpv: Invoke, ends: Callable[..., None]) -> None:
    ends(made(), made(Phase.LOST))
    result = clpv(tmp_path, "teleop", "mine", "--count", "3", "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout)["error"].startswith("demo2.mcap: not kept")
    assert files(tmp_path) == ["datasets", "datasets/mine", "datasets/mine/demo1.mcap"]


def test_a_file_that_cannot_be_written_leaves_the_one_before(
    tmp_path: Path, clpv: Invoke, ends: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    ends(made(), made())
    assert clpv(tmp_path, "teleop", "mine", "--count", "1").exit_code == 0
    before = (tmp_path / "datasets/mine/demo1.mcap").read_bytes()

    def half(path: Path, *given: Any) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(demonstrate, "write_demonstration", half)
    result = clpv(tmp_path, "teleop", "mine", "--count", "1", "--replace")
    assert result.exit_code == 1
    assert "No space left on device" in result.stderr
    assert files(tmp_path / "datasets/mine") == ["demo1.mcap"]
    assert (tmp_path / "datasets/mine/demo1.mcap").read_bytes() == before


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({}, ""),
        ({"lost": 0.5}, "for 0.5 s the master was not followed, its samples were stale or not finite"),
        ({"limited": 1.25}, "for 1.2 s the pads were at the edge of their workspace: widen low and high."),
        ({"box": np.tile([0.65, 0.15, 0.489], (3, 1))}, ""),
        ({"box": np.tile([0.65, 0.15, 0.5], (3, 1))}, "the box stands 30 mm from the goal: not one to learn from."),
    ],
)
def test_what_a_person_should_know_is_said(
    tmp_path: Path, clpv: Invoke, ends: Callable[..., None], changes: dict[str, Any], sentence: str
) -> None:
    ends(made(**changes))
    result = clpv(tmp_path, "teleop", "mine", "--count", "1", "--quiet")
    assert result.exit_code == 0
    assert sentence in result.stderr
    assert (result.stderr == "") is (sentence == "")
    assert files(tmp_path / "datasets/mine") == ["demo1.mcap"]
