"""The doctor's checks, and their remedies."""

from __future__ import annotations

import pytest

from pipeline import doctor
from pipeline.doctor import examine
from pipeline.executors import ONE_THREAD


@pytest.fixture(autouse=True)
def _environment(monkeypatch):
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "1")


def findings(toy):
    return {check.name: check for check in examine(toy.open())}


NAMES = ["python", "libraries", "processor", "store", "compiled code", "workers", "linear algebra"]


def test_all_is_well(toy):
    found = findings(toy)
    assert list(found) == NAMES
    assert all(check.passed for check in found.values())
    assert found["libraries"].found.startswith("numpy ")
    assert found["workers"].found == "a worker process answered"


def test_a_store_that_cannot_be_written(toy, monkeypatch):
    monkeypatch.chdir(toy.root)
    (toy.root / "runs" / ".store").write_text("")
    monkeypatch.setattr(doctor, "_workers", lambda: (True, ""))
    found = findings(toy)
    assert [name for name in NAMES if not found[name].passed] == ["store"]
    assert found["store"].found.startswith("runs/.store cannot be written (")
    assert found["store"].remedy == "make the runs folder writable, with a gigabyte to spare."


def test_a_cache_that_cannot_be_written(toy, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CLPV_CACHE_DIR", str(tmp_path / "file" / "below"))
    monkeypatch.setattr(doctor, "_workers", lambda: (True, ""))
    assert not findings(toy)["compiled code"].passed


def test_workers_that_cannot_start(toy, monkeypatch):
    def refuse(jobs):
        raise PermissionError("no processes here")

    monkeypatch.setattr(doctor, "make_executor", refuse)
    check = findings(toy)["workers"]
    assert (check.passed, check.found) == (False, "no processes here")
    assert check.remedy.startswith("run with --jobs 1")


def test_a_library_that_is_absent(toy, monkeypatch):
    monkeypatch.setattr(doctor, "_workers", lambda: (True, ""))
    toy.edit("fit", 'libraries=("numpy",)', 'libraries=("numpy", "no-such-distribution")')
    check = findings(toy)["libraries"]
    assert not check.passed
    assert "no-such-distribution absent" in check.found
