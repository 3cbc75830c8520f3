"""The cache of compiled code: an edit in any module takes effect, which numba's own cache does not see to."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from pipeline import code
from pipeline.compiled import cache_root, compiled_modules, use_cache_for
from pipeline.errors import StoreError

HERE = Path(__file__).resolve().parents[2]

CALLER = '''
"""Calls a helper of another module."""
import numba
from jitted.deep.helper import double


@numba.njit(cache=True)
def caller(x):
    return double(x) + 1
'''
HELPER = '''
"""Helps."""
import numba
from jitted.parameters import Whatever


@numba.njit(cache=True)
def double(x):
    return x * 2  # twice
'''
PLAIN = '"""Not compiled."""\n\n\ndef plain():\n    return 1\n'

RUN = """
import sys
from pipeline.compiled import use_cache_for
if sys.argv[1] == "ours":
    use_cache_for("jitted")
from jitted.caller import caller
print(caller(3), sum(caller.stats.cache_hits.values()))
"""


@pytest.fixture
def jitted(tmp_path, monkeypatch):
    """A package with compiled functions in two modules; returns its folder."""
    folder = tmp_path / "jitted"
    (folder / "deep").mkdir(parents=True)
    (folder / "__init__.py").write_text('"""Compiled."""\n')
    (folder / "deep" / "__init__.py").write_text("")
    (folder / "parameters.py").write_text("class Whatever:\n    pass\n")
    (folder / "caller.py").write_text(CALLER)
    (folder / "deep" / "helper.py").write_text(HELPER)
    (folder / "plain.py").write_text(PLAIN)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("CLPV_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    monkeypatch.setattr(numba.config, "CACHE_DIR", numba.config.CACHE_DIR)  # put back at the end
    return folder


def called(folder, whose):
    """What the compiled caller gives in a process of its own, and how often compiled code was found."""
    paths = os.pathsep.join((str(folder.parent), str(HERE)))
    done = subprocess.run(
        [sys.executable, "-B", "-c", RUN, whose],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    )
    result, hits = done.stdout.split()
    return int(result), int(hits)


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def folder_of(package="jitted"):
    code._path.cache_clear()
    code._read.cache_clear()
    return use_cache_for(package)


def test_an_edited_helper_in_another_module_takes_effect(jitted):
    assert called(jitted, "ours") == (7, 0)
    edit(jitted / "deep" / "helper.py", "x * 2", "x * 5")
    assert called(jitted, "ours") == (16, 0)
    edit(jitted / "deep" / "helper.py", "x * 5", "x * 2")
    assert called(jitted, "ours") == (7, 1)  # what was compiled before is found again


def test_with_numbas_own_cache_it_would_not(jitted):
    """If this fails, numba has learned it, and pipeline/compiled.py can go."""
    assert called(jitted, "numba's") == (7, 0)
    edit(jitted / "deep" / "helper.py", "x * 2", "x * 5")
    assert called(jitted, "numba's") == (7, 1)


def test_the_folder_is_named_by_what_counts(jitted):
    folder = folder_of()
    assert folder.parent == cache_root() / "compiled"
    assert os.environ["NUMBA_CACHE_DIR"] == str(folder)
    edit(jitted / "deep" / "helper.py", "# twice", "# two times")
    edit(jitted / "plain.py", "return 1", "return 2")
    edit(jitted / "parameters.py", "pass", "x = 1")
    assert folder_of() == folder
    edit(jitted / "caller.py", "+ 1", "+ 2")
    assert folder_of() != folder


def test_numba_that_is_imported_already_is_told(jitted):
    assert str(folder_of()) == numba.config.CACHE_DIR


def test_compiled_modules(jitted):
    assert compiled_modules("jitted") == ["jitted.caller", "jitted.deep.helper"]
    assert compiled_modules("no_such_package") == []
    assert "stages.mixture.links" in compiled_modules("stages")


def test_what_only_speaks_of_numba_is_not_compiled(jitted):
    """A report that sets the cache up, or a stage that declares the library: editing them compiles nothing again."""
    before = folder_of()
    (jitted / "report.py").write_text(
        "from pipeline.compiled import use_cache_for\nlibraries = ('numba',)\nfrom jitted.compiled_figures import a\n"
    )
    assert compiled_modules("jitted") == ["jitted.caller", "jitted.deep.helper"]
    assert folder_of() == before
    (jitted / "own.py").write_text("if True:\n    from jitted.compiled import fast\n")
    assert "jitted.own" in compiled_modules("jitted")


def test_the_root_of_the_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("CLPV_CACHE_DIR", str(tmp_path / "own"))
    assert cache_root() == tmp_path / "own"
    monkeypatch.delenv("CLPV_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_root() == tmp_path / "xdg" / "clpv"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_root() == tmp_path / "home" / ".cache" / "clpv"


def test_a_folder_that_cannot_be_made(jitted, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CLPV_CACHE_DIR", str(tmp_path / "file"))
    with pytest.raises(StoreError, match=r"^The cache of compiled code cannot be written \(.* Not a directory: "):
        folder_of()


def test_a_folder_that_cannot_be_written(jitted, monkeypatch):
    monkeypatch.setattr("pipeline.compiled.os.access", lambda path, mode: False)
    with pytest.raises(StoreError, match=r"Permission denied: .*\): set CLPV_CACHE_DIR to a folder that can\.$"):
        folder_of()
