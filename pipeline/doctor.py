"""Checks of the machine that an experiment needs: one sentence each for what was found and for the remedy."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass

from pipeline.compiled import cache_root
from pipeline.environment import blas, processor
from pipeline.errors import ClpvError
from pipeline.executors import default_jobs, make_executor
from pipeline.key import version
from pipeline.project import Project

LEAST_FREE = 1e9
"""Free bytes below which the store is said to be short of room; the largest committed study needs about 0.2 GB."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One finding: what was checked, whether it is well, what was found, what to do where it is not."""

    name: str
    passed: bool
    found: str
    remedy: str


def examine(project: Project) -> list[Check]:
    """All checks, in order; none of them raises."""
    checks: list[tuple[str, Callable[[], tuple[bool, str]], str]] = [
        ("python", _python, "use CPython 3.11: 'make demo' builds an environment with it."),
        ("libraries", lambda: _libraries(project), "install the pinned requirements: 'make demo' does."),
        ("processor", lambda: (True, f"{processor()}, {default_jobs()} usable"), ""),
        ("store", lambda: _store(project), "make the runs folder writable, with a gigabyte to spare."),
        ("compiled code", _cache, "set CLPV_CACHE_DIR to a folder that can be written."),
        ("workers", _workers, "run with --jobs 1; a security policy may forbid new processes."),
        ("linear algebra", _blas, "reinstall numpy."),
    ]
    found = []
    for name, look, remedy in checks:
        try:
            passed, text = look()
        except (ClpvError, OSError, RuntimeError, ImportError) as error:
            passed, text = False, str(error)
        found.append(Check(name=name, passed=passed, found=text, remedy=remedy))
    return found


def _python() -> tuple[bool, str]:
    return sys.version_info[:2] >= (3, 11), sys.version.split()[0]


def _libraries(project: Project) -> tuple[bool, str]:
    names = sorted({name for stage in project.stages.values() for name in stage.libraries})
    versions = {name: version(name) for name in names}
    return "absent" not in versions.values(), ", ".join(f"{name} {v}" for name, v in versions.items())


def _store(project: Project) -> tuple[bool, str]:
    project.store.prepare()
    with project.store.scratch() as folder:
        (folder / "probe").write_bytes(b"probe")
    free = shutil.disk_usage(project.store.folder).free
    return free > LEAST_FREE, f"writable, {free / 1e9:.0f} GB free"


def _cache() -> tuple[bool, str]:
    folder = cache_root()
    folder.mkdir(parents=True, exist_ok=True)
    probe = folder / ".probe"
    probe.write_bytes(b"probe")
    probe.unlink()
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return True, f"cache writable, {size / 1e6:.1f} MB"


def _workers() -> tuple[bool, str]:
    with make_executor(2) as executor:
        worker = executor.submit(os.getpid).result(timeout=60)
    return worker != os.getpid(), "a worker process answered"


def _blas() -> tuple[bool, str]:
    return True, "; ".join(blas()) or "none found"
