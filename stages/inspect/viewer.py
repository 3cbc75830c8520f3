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
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.errors import DataError, UsageError
from stages.inspect.relay import relayed

HERE = "127.0.0.1"
"""The only address that the viewer's servers listen on."""

WEB, FEED = 9090, 9876
"""Ports at which a browser finds the viewer, and the viewer its recording, unless they are taken."""

SAVE = "add --save FILE.rrd and open the file where there is one, or --serve"


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


def check_display() -> None:
    """Raise UsageError where there is no screen to open a window on."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError(f"There is no display to open the viewer on: {SAVE}.")


def open_window(recording: Path) -> None:
    """Show a recording in a window, until it is closed. Raises DataError where the viewer cannot."""
    # A port that nobody uses, so that a viewer that is open already does not take the recording.
    code, said = _run(["--bind", HERE, "--port", "auto", str(recording)], timeout=None)
    if code != 0:
        reason = next((line for line in reversed(said) if line.strip()), f"exit code {code}").strip()
        raise DataError("the viewer", f"ended with an error ({reason[:200]}): {SAVE}.")


@contextlib.contextmanager
def served(recording: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve a recording to browsers of this machine; gives the address to open, and the server.

    Raises DataError where the server does not start.
    """
    web, feed, inner = free_port(WEB), free_port(FEED), free_port(0)
    options = ["--serve-web", "--bind", HERE, "--web-viewer-port", str(inner), "--port", str(feed), str(recording)]
    with _private() as environment:
        server = subprocess.Popen(
            [str(binary()), *options],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            _wait_for(server, inner)
            with relayed(HERE, web, f"http://{HERE}:{inner}", f"http://{HERE}:{feed}"):
                yield f"http://{HERE}:{web}/?theme=dark&url=rerun%2Bhttp%3A%2F%2F{HERE}%3A{feed}%2Fproxy", server
        finally:
            server.terminate()
            try:
                server.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                server.kill()
                server.wait()


def free_port(wanted: int) -> int:
    """`wanted`, or where it is taken another port of this machine."""
    for port in (wanted, 0):
        with socket.socket() as tried:
            # As servers do: a port whose last connections are still closing counts as free.
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                tried.bind((HERE, port))
            except OSError:
                continue
            return int(tried.getsockname()[1])
    raise DataError("the viewer", f"no port of {HERE} is free: close other servers.")


def _wait_for(server: subprocess.Popen[str], port: int, seconds: float = 30.0) -> None:
    """Return when the server answers. Raises DataError where it ends, or does not in time."""
    import time

    until = time.monotonic() + seconds
    while time.monotonic() < until and server.poll() is None:
        with contextlib.suppress(OSError), socket.create_connection((HERE, port), timeout=0.5):
            return
        time.sleep(0.05)
    raise DataError("the viewer", "its server did not start: write a file with --save FILE.rrd instead.")


def _run(options: Sequence[str], timeout: float | None) -> tuple[int, list[str]]:
    """Run the viewer to its end; its exit code, and the lines that it said on standard error."""
    with _private() as environment:
        done = subprocess.run(
            [str(binary()), *options], env=environment, stderr=subprocess.PIPE, text=True, timeout=timeout, check=False
        )
    return done.returncode, done.stderr.splitlines()


@contextlib.contextmanager
def _private() -> Iterator[dict[str, str]]:
    """An environment in which the viewer's analytics are off, whatever the user's own settings are."""
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder, "rerun", "analytics.json")
        settings.parent.mkdir()
        # All fields: the viewer takes a file that lacks one for none, and writes its own, with analytics on.
        off = {"analytics_enabled": False, "analytics_id": "", "metadata": {}}
        paths = {"config_file_path": str(settings), "data_dir_path": folder}
        settings.write_text(json.dumps({**off, **paths}), encoding="utf-8")
        yield {**os.environ, "XDG_CONFIG_HOME": folder, "TELEMETRY_ENABLED": "false"}
