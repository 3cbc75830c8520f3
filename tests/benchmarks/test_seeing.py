"""How long it takes to see what happened, and how large it is: recordings for rerun, and the report of a sweep.

The limits are those that the README states. Each recording is written in a process of its own, so that what is imported
and compiled on the way counts.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader
from support import CHECKOUT, make_project, run_timed

MB = 1e6

PROGRAM = """
import sys, time
from pathlib import Path
from pipeline.compiled import use_cache_for
from pipeline.project import Project
from stages import STAGES
project = Project.open(Path(sys.argv[1]), STAGES)
use_cache_for(project.package)
from stages.figures.results import read_results
from stages.inspect.recording import rerun, write_recording
from stages.inspect.shown import choose
results = read_results(project, project.experiment(sys.argv[2], sys.argv[4:]))
shown = choose([results], (), ())
rerun()
begin = time.perf_counter()
size = write_recording(Path(sys.argv[3]), shown)
print(time.perf_counter() - begin, size)
"""


def call(root: Path, *words: str) -> float:
    """Run a command of the program; wall-clock seconds."""
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "CLPV_ROOT": str(root), "PYTHONPATH": str(CHECKOUT)},
        check=True,
        capture_output=True,
    )
    return time.perf_counter() - begin


def written(root: Path, name: str, *sets: str) -> dict[str, Any]:
    """A recording as it is shown without a choice: seconds to write and to read it, MB."""
    path = root / f"{name}.rrd"
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(root), name, str(path), *sets],
        env={**os.environ, "PYTHONPATH": str(CHECKOUT)},
        check=True,
        capture_output=True,
        text=True,
    )
    seconds, size = done.stdout.split()
    begin = time.perf_counter()
    chunks = sum(1 for _ in RrdReader(path).stream())
    reading = time.perf_counter() - begin
    return {"write_s": float(seconds), "MB": int(size) / MB, "read_s": reading, "chunks": chunks}


@pytest.mark.parametrize("name", ["box-moving", "box-disturbance", "box-obstacle"])
def test_a_carried_box(name: str, tmp_path: Path) -> None:
    root = make_project(tmp_path, name)
    for folder in (CHECKOUT / "datasets").iterdir():
        (root / "datasets").mkdir(exist_ok=True)
        (root / "datasets" / folder.name).symlink_to(folder)
    one = "rollout.count=1"
    call(root, "-c", "from stages.cli import app; app()", "run", name, "--set", one, "--quiet")
    found = written(root, name, one)
    whole = call(
        root, "-c", "from stages.cli import app; app()", "inspect", name, "--set", one, "--save", f"{root}/again.rrd"
    )
    print(f"\n{name}: {json.dumps(found)}, the whole command {whole:.1f} s")
    assert found["MB"] <= 3.0
    assert found["write_s"] <= 0.5
    assert found["read_s"] <= 1.0


def test_a_sweep(tmp_path: Path) -> None:
    root = make_project(tmp_path, "lasa-disturbance")
    run_timed(root, "lasa-disturbance")
    found = written(root, "lasa-disturbance")
    report = root / "runs" / "lasa-disturbance" / "report.html"
    cold = call(root, "-c", "from stages.cli import app; app()", "report", "lasa-disturbance")
    size = report.stat().st_size / MB
    print(f"\nlasa-disturbance: {json.dumps(found)}; report {cold:.1f} s, {size:.2f} MB")
    assert found["read_s"] <= 1.0
    assert size <= 5.0
    assert cold <= 20.0
