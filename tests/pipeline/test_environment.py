"""The environment of a result."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline import environment
from pipeline.environment import capture, tags


@pytest.fixture(autouse=True)
def _fresh():
    environment._revision.cache_clear()
    environment.processor.cache_clear()
    yield
    environment._revision.cache_clear()
    environment.processor.cache_clear()


def git(folder, *arguments):
    options = ("-c", "user.name=x", "-c", "user.email=x@x", "-c", "commit.gpgsign=false")
    subprocess.run(["git", *options, *arguments], cwd=folder, check=True, capture_output=True)


def test_capture_is_plain(tmp_path):
    found = capture(["numpy", "no-such-distribution"], tmp_path)
    assert json.loads(json.dumps(found)) == found
    assert found["python"] == sys.version.split()[0]
    assert list(found["packages"]) == ["no-such-distribution", "numpy"]
    assert found["packages"]["no-such-distribution"] == "absent"
    assert found["blas"]
    assert found["processor"]
    assert found["revision"] == ""


def test_revision(tmp_path):
    git(tmp_path, "init")
    (tmp_path / "file").write_text("1")
    git(tmp_path, "add", "file")
    git(tmp_path, "commit", "-m", "first")
    clean = environment._revision(tmp_path)
    assert len(clean) == 40
    environment._revision.cache_clear()
    (tmp_path / "other").write_text("not tracked")
    assert environment._revision(tmp_path) == clean
    environment._revision.cache_clear()
    (tmp_path / "file").write_text("2")
    assert environment._revision(tmp_path) == clean + "+"


@pytest.mark.parametrize("error", [FileNotFoundError, subprocess.CalledProcessError, subprocess.TimeoutExpired])
def test_no_revision(tmp_path, monkeypatch, error):
    def fail(*arguments, **options):
        raise FileNotFoundError if error is FileNotFoundError else error(1, "git")

    monkeypatch.setattr(environment.subprocess, "run", fail)
    assert environment._revision(tmp_path) == ""


def test_no_processor_name(monkeypatch):
    def refuse(self, **options):
        raise FileNotFoundError

    monkeypatch.setattr(Path, "read_text", refuse)
    assert environment.processor()


def test_tags_do_not_depend_on_what_else_is_loaded(tmp_path):
    one = {"python": "3.11.7", "processor": "x", "blas": ["openblas 0.3.27 Haswell"]}
    two = one | {"blas": ["openblas 0.3.27 Haswell", "openblas 0.3.28 Haswell"]}
    assert tags(one) == tags(two)
    assert tags(one) != tags(one | {"blas": ["openblas 0.3.27 SkylakeX"]})
    assert tags(one) != tags(one | {"processor": "y"})
    assert tags(one) != tags(one | {"python": "3.11.8"})
    assert tags({}) == tags({})
