"""`clpv inspect`: what it writes and opens, what it refuses, and that nothing is left behind or told to anyone."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest
from recordings_read import read_back
from support import CHECKOUT, Invoke, make_project

from pipeline.errors import DataError
from pipeline.project import Project
from stages import STAGES
from stages.figures.results import Results, read_results
from stages.inspect import viewer
from stages.inspect.command import left_out
from stages.inspect.recording import write_recording
from stages.inspect.relay import DIRECT
from stages.inspect.shown import choose


@pytest.fixture(scope="module")
def letters(quickstart: tuple[Path, dict[str, Any]]) -> Results:
    project = Project.open(quickstart[0], STAGES)
    return read_results(project, project.experiment("quickstart"))


def test_a_file_is_written_and_the_next_command_said(
    quickstart: tuple[Path, Any], tmp_path: Path, clpv: Invoke
) -> None:
    target = tmp_path / "some.rrd"
    result = clpv(quickstart[0], "inspect", "quickstart", "--rollout", "*/cond1/4", "--save", str(target))
    assert result.exit_code == 0, result.output
    assert f"'clpv inspect {target}' opens it." in result.output
    assert {entity.split("/")[2] for entity in read_back(target).entities if "/executed" in entity} == {
        "lpvds",
        "clpvds-robust",
    }


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("quickstart",), 2, "There is no display to open the viewer on: add --save FILE.rrd"),
        (("quickstart", "--save", "some.mcap"), 2, "some.mcap: a recording's name ends in .rrd, e.g. --save some.rrd."),
        (("quickstart", "--save", "a.rrd", "--serve"), 2, "choose one."),
        (("quickstart", "--save", "."), 2, ". is a folder: name a file in it, e.g. --save rollouts.rrd."),
        (("quickstart", "--save", "folder.rrd"), 2, "folder.rrd is a folder: name a file in it"),
        (("none.mcap",), 2, "There is neither a file nor an experiment 'none.mcap'; 'clpv list' names them."),
        (("text.bag",), 2, "text.bag is no recording that rerun opens; 'clpv info text.bag' looks at it."),
        (
            ("seen.rrd",),
            2,
            "There is no display to open the viewer on: add --serve, which shows it in a browser, or open",
        ),
        (("seen.rrd", "--save", "a.rrd"), 2, "seen.rrd is a file, and is shown as it is: leave out other names"),
        (("quickstart", "--save", "no/such/a.rrd"), 2, "--save no/such/a.rrd: there is no folder no/such; make it"),
        (("nothing", "--save", "a.rrd"), 2, "did you mean|There is no experiment"),
        (("lasa-disturbance", "--save", "a.rrd"), 3, "run 'clpv run lasa-disturbance' first"),
    ],
)
def test_what_cannot_be_shown_is_one_sentence(
    computed: Path,
    clpv: Invoke,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    code: int,
    message: str,
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    make_project(computed, "lasa-disturbance")
    (computed / "folder.rrd").mkdir()
    (computed / "text.bag").write_text("no bag")
    (computed / "seen.rrd").write_bytes(b"RRF2 and more")
    monkeypatch.chdir(computed)
    result = clpv(computed, "inspect", *words)
    assert result.exit_code == code, result.output
    assert len(result.stderr.strip().splitlines()) == 1
    assert any(part in result.stderr for part in message.split("|"))
    assert sorted(entry.name for entry in computed.glob("*.rrd")) == ["folder.rrd", "seen.rrd"]


def listening(process: int) -> set[str]:
    """Addresses at which a process listens, of IPv4 as hexadecimal text, of IPv6 as they stand in /proc."""
    inodes = set()
    for entry in Path(f"/proc/{process}/fd").iterdir():
        with contextlib.suppress(OSError):
            inodes.add(str(entry.readlink()).removeprefix("socket:[").removesuffix("]"))
    rows = [
        line.split()
        for name in ("tcp", "tcp6")
        for line in Path("/proc/net", name).read_text().splitlines()[1:]
        if Path("/proc/net", name).exists()
    ]
    return {row[1].partition(":")[0] for row in rows if row[3] == "0A" and row[9] in inodes}


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="looks at what Linux says of sockets")
def test_the_server_listens_on_this_machine_only(
    letters: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_recording(tmp_path / "one.rrd", choose([letters], ("lpvds/none/4",), ()))
    # A proxy is not asked for what is on this machine.
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:1")
    with viewer.served(tmp_path / "one.rrd") as (address, _):
        (server,) = [child for child in psutil.Process().children() if child.name() == "rerun"]
        with DIRECT.open(address.partition("?")[0], timeout=10.0) as answer:
            assert b"<html" in answer.read().lower()
            allowed = answer.headers["Content-Security-Policy"].split("; ")[0]
            feed = address.rpartition("%3A")[2].removesuffix("%2Fproxy")
            assert allowed == f"default-src 'self' http://127.0.0.1:{feed}"  # what the viewer in a browser may ask
        for path, code in (("no/such/file", "404"), ("a\x01b", "400")):
            with socket.create_connection(("127.0.0.1", int(address.split(":")[2].split("/")[0]))) as asked:
                asked.sendall(f"GET /{path} HTTP/1.0\r\n\r\n".encode())
                assert asked.recv(100).split()[1] == code.encode()
        assert listening(server.pid) == {"0100007F"}  # 127.0.0.1
        assert address.startswith("http://127.0.0.1:")
        with viewer.served(tmp_path / "one.rrd") as (other, _):  # at another port
            assert other.partition("?")[0] != address.partition("?")[0]
            assert other.startswith("http://127.0.0.1:")
    assert not server.is_running()


def test_a_server_that_ends_by_itself_is_an_error(letters: Results, tmp_path: Path) -> None:
    write_recording(tmp_path / "one.rrd", choose([letters], ("lpvds/none/4",), ()))
    with viewer.served(tmp_path / "one.rrd") as (_, wait):
        (server,) = [child for child in psutil.Process().children() if child.name() == "rerun"]
        server.kill()
        with pytest.raises(DataError, match=r"the viewer: its server ended by itself \(signal 9\): start it again\."):
            wait()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_whatever_ends_it_nothing_is_left_behind(
    quickstart: tuple[Path, Any], tmp_path: Path, number: signal.Signals
) -> None:
    (tmp_path / "made").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", "from stages.cli import app; app()", "inspect", "quickstart", "--serve"],
        env={
            **{name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"},
            "CLPV_ROOT": str(quickstart[0]),
            "PYTHONPATH": str(CHECKOUT),
            "TMPDIR": str(tmp_path / "made"),
        },
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith("Open http://127.0.0.1:")  # at once, also into a pipe
    (server,) = psutil.Process(process.pid).children()
    process.send_signal(number)
    assert process.wait(timeout=20.0) == (0 if number == signal.SIGINT else 128 + number)
    psutil.wait_procs([server], timeout=5.0)
    assert not server.is_running()
    assert list((tmp_path / "made").iterdir()) == []


def test_a_window_says_when_it_is_there_and_why_it_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program, told = tmp_path / "viewer", []
    monkeypatch.setattr(viewer, "binary", lambda: program)
    monkeypatch.setattr(viewer, "SOON", 0.2)
    for script, opens, reason in (
        ("sleep 0.5", True, ""),
        (
            "echo INFO loading >&2; echo 'Error: no display here' >&2; exit 1",
            False,
            r"\(no display here\): look at the display",
        ),
        ("echo something >&2; exit 3", False, r"\(exit code 3\): look at the display"),
        ("kill -9 $$", False, r"\(signal 9\): look at the display"),
    ):
        program.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
        program.chmod(0o755)
        told.clear()
        if reason:
            with pytest.raises(DataError, match=f"^the viewer: ended with an error {reason}"):
                viewer.open_window(tmp_path / "one.rrd", lambda: told.append(1))
        else:
            viewer.open_window(tmp_path / "one.rrd", lambda: told.append(1))
        assert bool(told) is opens


def test_analytics_are_off_whatever_the_user_has_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    subprocess.run([str(viewer.binary()), "analytics", "enable"], capture_output=True, check=True)
    with viewer._private() as (environment, _):
        done = subprocess.run(
            [str(viewer.binary()), "analytics", "config"], env=environment, capture_output=True, text=True, check=True
        )
    assert '"analytics_enabled": false' in done.stdout
    assert not Path(environment["XDG_CONFIG_HOME"]).exists()


def test_without_the_viewer_one_sentence(
    computed: Path, clpv: Invoke, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def missing() -> Path:
        raise DataError("the viewer", "rerun is not installed")

    monkeypatch.setattr(viewer, "binary", missing)
    for words in ((), ("--serve",)):
        result = clpv(computed, "inspect", "quickstart", *words)
        assert (result.exit_code, len(result.stderr.strip().splitlines())) == (1, 1)
    saved = clpv(computed, "inspect", "quickstart", "--save", str(tmp_path / "a.rrd"))  # which needs none
    assert saved.exit_code == 0


def test_a_run_says_how_to_see_what_came_out(computed: Path, clpv: Invoke) -> None:
    said = clpv(computed, "run", "quickstart").stderr.splitlines()
    assert said[-1] == "See it: 'clpv report quickstart', 'clpv inspect quickstart'."
    assert "See it" not in clpv(computed, "fit", "quickstart").stderr  # there is nothing to see yet
    assert "See it" not in clpv(computed, "run", "quickstart", "--quiet").stderr


def test_what_is_not_up_to_date_says_the_command_with_the_options_given(computed: Path, clpv: Invoke) -> None:
    words = ("--set", "dynamics.margin=0.002", "--seed", "3")
    for verb in (("inspect", "quickstart", "--save", "a.rrd"), ("report", "quickstart")):
        result = clpv(computed, *verb, *words)
        assert result.exit_code == 3
        assert "run 'clpv run quickstart --set dynamics.margin=0.002 --seed 3' first." in result.stderr


def test_what_is_left_out_is_said(letters: Results) -> None:
    point = letters.points[0]
    other = replace(point, point=replace(point.point, id="other"))
    sweep = replace(letters, points=(point, other))
    (first, *_) = choose([letters], ("lpvds/none/4",), ())
    (point_said, rollouts_said) = left_out([sweep], [first], (), ())
    assert point_said == "quickstart: main, one of 2 points; others with --point."
    assert rollouts_said == "quickstart: 1 of 32 roll-outs; others with --rollout, e.g. --rollout lpvds/none/5."
    assert list(left_out([letters], [first], ("lpvds/none/4",), ())) == []
    # Between them two points show every name, and yet not every roll-out.
    half = len(point.rollouts) // 2
    some = [replace(first, rollout=r) for r in point.rollouts[:half]]
    some += [replace(first, point=other, rollout=r) for r in point.rollouts[half:]]
    assert list(left_out([sweep], some, (), ("*",))) == [
        "quickstart: 32 of 64 roll-outs; others with --rollout, e.g. --rollout '*'."
    ]
