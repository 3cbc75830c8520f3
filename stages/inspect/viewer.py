"""The rerun viewer: opened in a window, or served to a browser of this machine; nothing is sent to anyone.

The viewer's server would listen on all addresses and its analytics are on by default: here it is bound to this machine,
and they are off; in a browser a policy sees to that (`relay.py`). Not here: what it shows (`recording.py`).
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from pipeline.errors import DataError, UsageError
from stages.inspect.relay import relayed

HERE = "127.0.0.1"
"""The only address that the viewer's servers listen on."""

WEB = 9090
"""Port at which a browser finds the viewer, unless it is taken."""

SOON = 1.0
"""Seconds after which a viewer that has not ended is there."""

ELSEWHERE = "add --serve, which shows it in a browser, or open the file where there is one"
SAVE = "add --save FILE.rrd and open the file where there is one, or --serve"
"""What helps where there is no display, for a file and for an experiment."""


def binary() -> Path:
    """The viewer's program. Raises DataError where it is not installed."""
    spec = importlib.util.find_spec("rerun_cli")
    beside = None if spec is None or spec.origin is None else Path(spec.origin).with_name("rerun")
    if beside is not None and beside.is_file():
        return beside
    found = shutil.which("rerun")
    if found is None:
        raise DataError(
            "the viewer", "rerun is not installed: 'pip install rerun-sdk', or write a file with --save FILE.rrd."
        )
    return Path(found)


def check_display(remedy: str = SAVE) -> None:
    """Raise UsageError, with what helps, where there is no screen to open a window on."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError(f"There is no display to open the viewer on: {remedy}.")


def open_window(recording: Path, opened: Callable[[], None]) -> None:
    """Show a recording in a window, until it is closed; `opened` is called when it is there.

    Raises DataError where the viewer cannot.
    """
    # A port that nobody uses, so that a viewer that is open already does not take the recording.
    with _started(["--bind", HERE, "--port", "auto", str(recording)]) as (viewer, said):
        with contextlib.suppress(subprocess.TimeoutExpired):
            viewer.wait(timeout=SOON)
        if viewer.poll() is None:
            opened()
        code = viewer.wait()
        if code != 0:
            raise DataError(
                "the viewer", f"ended with an error ({_reason(code, said)}): look at the display, or add --serve."
            )


@contextlib.contextmanager
def served(recording: Path) -> Iterator[tuple[str, Callable[[], None]]]:
    """Serve a recording to browsers of this machine; gives the address to open, and a function that waits.

    That raises DataError where the server ends by itself. Raises DataError where it does not start.
    """
    feed, inner = free_port(), free_port()
    options = ["--serve-web", "--bind", HERE, "--web-viewer-port", str(inner), "--port", str(feed), str(recording)]
    with _started(options) as (server, said):
        _wait_for(server, inner)

        def wait() -> None:
            code = server.wait()
            raise DataError("the viewer", f"its server ended by itself ({_reason(code, said)}): start it again.")

        with relayed(HERE, WEB, f"http://{HERE}:{inner}", f"http://{HERE}:{feed}") as web:
            yield f"http://{HERE}:{web}/?theme=dark&url=rerun%2Bhttp%3A%2F%2F{HERE}%3A{feed}%2Fproxy", wait


@contextlib.contextmanager
def _started(options: Sequence[str]) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """The viewer as a process of its own, and the file of what it says; it ends when it is left, however that is."""
    with _private() as (environment, folder), _signals():
        said = folder / "said"
        with said.open("wb") as stream:
            process = subprocess.Popen(
                [str(binary()), *options],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stream,
            )
            try:
                yield process, said
            finally:
                process.terminate()
                try:
                    process.wait(timeout=5.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


def _reason(code: int, said: Path) -> str:
    """Why the viewer ended, by its exit code and by what it said."""
    if code < 0:
        return f"signal {-code}"
    lines = [line for line in said.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
    return errors[0][:200] if errors else f"exit code {code}"


@contextlib.contextmanager
def _signals() -> Iterator[None]:
    """Let what ends this process (kill, a terminal that is closed) end it in order, so that nothing is left behind."""

    def end(number: int, frame: object) -> None:
        raise SystemExit(128 + number)

    before = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def free_port() -> int:
    """A port of this machine that nobody uses."""
    with socket.socket() as tried:
        tried.bind((HERE, 0))
        return int(tried.getsockname()[1])


def _wait_for(server: subprocess.Popen[bytes], port: int, seconds: float = 30.0) -> None:
    """Return when the server answers. Raises DataError where it ends, or does not in time."""
    until = time.monotonic() + seconds
    while time.monotonic() < until and server.poll() is None:
        with contextlib.suppress(OSError), socket.create_connection((HERE, port), timeout=0.5):
            return
        time.sleep(0.05)
    raise DataError("the viewer", "its server did not start: write a file with --save FILE.rrd instead.")


@contextlib.contextmanager
def _private() -> Iterator[tuple[dict[str, str], Path]]:
    """An environment in which the viewer's analytics are off, whatever the user's settings are, and its own folder.

    There it keeps what it writes on the way, too.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        settings = folder / "rerun" / "analytics.json"
        settings.parent.mkdir()
        # All fields: the viewer takes a file that lacks one for none, and writes its own, with analytics on.
        off = {"analytics_enabled": False, "analytics_id": "", "metadata": {}}
        paths = {"config_file_path": str(settings), "data_dir_path": name}
        settings.write_text(json.dumps({**off, **paths}), encoding="utf-8")
        own = {"XDG_CONFIG_HOME": name, "TMPDIR": name, "TELEMETRY_ENABLED": "false"}
        yield {**os.environ, **own, "RUST_LOG": "error", "NO_COLOR": "1"}, folder
