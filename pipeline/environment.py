"""What a result was computed with: Python, packages, BLAS, processor, revision. For action records, never artifacts."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.key import version


def capture(libraries: Iterable[str], root: Path) -> dict[str, Any]:
    """The environment now; `libraries` are the distributions whose versions matter, `root` the project's folder."""
    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "processor": processor(),
        "blas": blas(),
        "packages": {name: version(name) for name in sorted(libraries)},
        "revision": _revision(root),
    }


def tags(environment: Mapping[str, Any]) -> tuple[Any, ...]:
    """What two environments must share for their results to be equal to the bit."""
    # Which BLAS libraries are loaded depends on what ran before in the process; the kernels they choose do not.
    kernels = {str(name).rpartition(" ")[2] for name in environment.get("blas", ())}
    return (environment.get("python"), environment.get("processor"), tuple(sorted(kernels)))


@cache
def processor() -> str:
    """Model name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def blas() -> list[str]:
    """Loaded BLAS libraries with version and kernel, sorted; numpy's at least."""
    import numpy  # noqa: F401 - loads its library
    from threadpoolctl import threadpool_info

    return sorted(
        f"{entry.get('internal_api')} {entry.get('version')} {entry.get('architecture', '')}".strip()
        for entry in threadpool_info()
        if entry.get("user_api") == "blas"
    )


@cache
def _revision(root: Path) -> str:
    """The commit that is checked out, with ``+`` where files differ from it; empty outside a checkout."""
    try:
        commit = _git(root, "rev-parse", "HEAD")
        return commit + ("+" if _git(root, "status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return ""


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True, timeout=5)
    return done.stdout.strip()
