"""Helpers that several test files share."""

from __future__ import annotations

import shutil
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
