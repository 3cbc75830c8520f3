"""How long the command line takes to answer. Run by `make bench`."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

from support import make_project

CLPV = "from stages.cli import app; app(prog_name='clpv')"
HELP_LIMIT = 2.5
"""Times a bare ``import typer``; required of ``clpv --help``."""
CACHED_LIMIT = 1.0
"""Seconds; required of ``clpv run quickstart`` where every stage is cached."""
TURNS = 9


def seconds(*command: str, root: Path) -> float:
    """Wall clock of a process that finds its modules as bytecode, as an installed program does."""
    environment = {**os.environ, "CLPV_ROOT": str(root), "PYTHONPYCACHEPREFIX": str(root / "bytecode")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    begin = time.perf_counter()
    subprocess.run([sys.executable, *command], check=True, capture_output=True, env=environment)
    return time.perf_counter() - begin


def test_help(tmp_path: Path) -> None:
    bare = min(seconds("-c", "import typer", root=tmp_path) for _ in range(TURNS))
    helped = min(seconds("-c", CLPV, "--help", root=tmp_path) for _ in range(TURNS))
    print(f"\nimport typer {bare:.3f} s, clpv --help {helped:.3f} s: {helped / bare:.2f} times")
    assert helped < HELP_LIMIT * bare


def test_a_cached_run(tmp_path: Path) -> None:
    root = make_project(tmp_path, "quickstart")
    first = seconds("-c", CLPV, "run", "quickstart", root=root)
    cached = min(seconds("-c", CLPV, "run", "quickstart", root=root) for _ in range(TURNS))
    print(f"\nclpv run quickstart: first {first:.1f} s, cached {cached:.3f} s")
    assert cached < CACHED_LIMIT
