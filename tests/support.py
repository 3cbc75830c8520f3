"""Helpers that several test files share."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from typer.testing import Result

CHECKOUT = Path(__file__).resolve().parents[1]

Invoke = Callable[..., Result]


def make_project(root: Path, *names: str) -> Path:
    """A project folder with committed experiments of this checkout, manifests included, and nothing computed."""
    for name in names:
        folder = root / "runs" / name
        folder.mkdir(parents=True)
        for file in ("experiment.toml", "manifest.json"):
            shutil.copy(CHECKOUT / "runs" / name / file, folder / file)
    return root


def run_timed(root: Path, name: str, command: str = "run") -> tuple[dict[str, object], float]:
    """Run an experiment, or up to a stage, in a process of its own; its document and the wall-clock seconds."""
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", "from stages.cli import app; app()", command, name, "--json"],
        env={**os.environ, "CLPV_ROOT": str(root), "PYTHONPATH": str(CHECKOUT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout), time.perf_counter() - begin
