"""Fixtures for all tests: compiled code is kept where the program keeps it, chains run once for the whole session."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from support import Invoke, make_project
from typer.testing import CliRunner, Result

from pipeline.compiled import use_cache_for

use_cache_for("stages")


@pytest.fixture
def clpv(monkeypatch: pytest.MonkeyPatch) -> Invoke:
    """Call the command line in this process, in a project's folder: ``clpv(root, "run", "quickstart", …)``."""

    def invoke(root: Path, *arguments: str) -> Result:
        from stages.cli import app

        monkeypatch.setenv("CLPV_ROOT", str(root))
        return CliRunner().invoke(app, list(arguments), catch_exceptions=False)

    return invoke


@pytest.fixture(scope="session")
def quickstart(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A project in which quickstart has been run once, and what ``run --json`` printed. Not to be modified."""
    from stages.cli import app

    root = make_project(tmp_path_factory.mktemp("project"), "quickstart")
    result = CliRunner(env={"CLPV_ROOT": str(root)}).invoke(app, ["run", "quickstart", "--json"])
    assert result.exit_code == 0, result.output
    return root, json.loads(result.stdout)


@pytest.fixture
def computed(quickstart: tuple[Path, dict[str, Any]], tmp_path: Path) -> Path:
    """A copy, to be modified, of a project in which quickstart has been run."""
    return Path(shutil.copytree(quickstart[0], tmp_path / "project"))
