"""The code digest: what counts as a change of the code, and what a stage reaches."""

from __future__ import annotations

import pytest

from pipeline import code
from pipeline.code import changes, code_digest


def reached(toy, *modules):
    """Definitions that the toy's modules reach, read anew."""
    toy.open()
    return code.reached(modules)


def fit_mean(toy):
    return reached(toy, "toy.fit", "toy.mean")


UNCHANGED = {
    "a comment": ("arithmetic", "        result += value  # one by one", "        result += value  # each"),
    "a comment line": ("arithmetic", "FACTOR = 1.0", "# a factor\nFACTOR = 1.0"),
    "a docstring": ("arithmetic", '"""Sum up."""', '"""Add."""'),
    "no docstring": ("arithmetic", '    """Sum up."""\n', ""),
    "a module's docstring": ("arithmetic", "Helpers that the kinds share", "Helpers"),
    "an attribute's docstring": ("arithmetic", "FACTOR = 1.0", 'FACTOR = 1.0\n"""What is multiplied."""'),
    "layout": ("arithmetic", "return result * FACTOR", "return (\n        result\n        * FACTOR\n    )"),
    "quotes": ("mean", "from toy.arithmetic import total", "from toy.arithmetic import (total)"),
    "a number's spelling": ("arithmetic", "result = 0.0", "result = 0.00"),
    "declarations": ("parameters", "rounds: Count = 1", "rounds: Count = 2"),
    "the package": ("__init__", '"""A toy package of stages."""', '"""A toy."""\nNAME = "toy"'),
    "another kind": ("median", "ordering.middle(values)", "ordering.middle(values) + 1"),
    "another kind's helper": ("ordering", "// 2", "// 3"),
}


@pytest.mark.parametrize("what", UNCHANGED)
def test_does_not_count(toy, what):
    before = fit_mean(toy)
    toy.edit(*UNCHANGED[what])
    after = fit_mean(toy)
    assert code_digest(after) == code_digest(before)
    assert changes(before, after) == []


CHANGED = {
    "a helper": ("arithmetic", "result += value", "result -= value", ["toy.arithmetic.total changed"]),
    "a constant": ("arithmetic", "FACTOR = 1.0", "FACTOR = 2.0", ["toy.arithmetic.FACTOR changed"]),
    "the implementation": ("mean", "+ parameters.offset", "- parameters.offset", ["toy.mean.estimate changed"]),
    "the stage": ("fit", "== 13.0", "== 14.0", ["toy.fit.run changed"]),
    "the contract": ("fit", "random=True,", "random=False,", ["toy.fit.STAGE changed"]),
    "an import": ("arithmetic", "FACTOR = 1.0", "import math\n\nFACTOR = 1.0", ["toy.arithmetic.imports changed"]),
    "a name": (
        "arithmetic",
        "def unused",
        "def unneeded",
        ["toy.arithmetic.unneeded changed", "toy.arithmetic.unused changed"],
    ),
    "a statement": (
        "arithmetic",
        "FACTOR = 1.0",
        "FACTOR = 1.0\nif FACTOR:\n    FACTOR = 2.0",
        ["toy.arithmetic.statements changed"],
    ),
    "a class": (
        "arithmetic",
        "FACTOR = 1.0",
        "FACTOR: float = 1.0\n\n\nclass Total:\n    def method(self):\n        return 1",
        ["toy.arithmetic.FACTOR changed", "toy.arithmetic.Total changed"],
    ),
    "several names": (
        "arithmetic",
        "FACTOR = 1.0",
        "FACTOR = OTHER = 1.0",
        ["toy.arithmetic.FACTOR changed", "toy.arithmetic.FACTOR=OTHER changed"],
    ),
    "a text that is returned": (
        "arithmetic",
        "return None",
        'return "documentation"',
        ["toy.arithmetic.unused changed"],
    ),
}


@pytest.mark.parametrize("what", CHANGED)
def test_counts_and_is_named(toy, what):
    module, old, new, named = CHANGED[what]
    before = fit_mean(toy)
    toy.edit(module, old, new)
    after = fit_mean(toy)
    assert code_digest(after) != code_digest(before)
    assert changes(before, after) == named


def test_a_nested_docstring_does_not_count_and_a_nested_change_does(toy):
    toy.module(
        "arithmetic", "class A:\n    def f(self):\n        def g():\n            '''One.'''\n            return 1\n"
    )
    before = reached(toy, "toy.arithmetic")
    toy.edit("arithmetic", "'''One.'''", "'''Two.'''")
    assert reached(toy, "toy.arithmetic") == before
    toy.edit("arithmetic", "return 1", "return 2")
    assert changes(before, reached(toy, "toy.arithmetic")) == ["toy.arithmetic.A changed"]


def test_reached_modules(toy):
    assert list(fit_mean(toy)) == ["toy.arithmetic", "toy.fit", "toy.mean"]
    assert list(reached(toy, "toy.fit", "toy.median")) == ["toy.fit", "toy.median", "toy.ordering"]
    assert list(reached(toy, "toy.fit")) == ["toy.fit"]


@pytest.mark.parametrize(
    "statement",
    [
        "from toy.deep.helper import f",
        "from toy.deep import helper",
        "import toy.deep.helper",
        "import toy.deep.helper as h",
        "from .deep.helper import f",
        "from .deep import helper",
        "from toy.deep.helper import *",
        "def late():\n    from toy.deep import helper",
        "class C:\n    def late(self):\n        from .deep.helper import f",
        "try:\n    import toy.deep.helper\nexcept ImportError:\n    pass",
        "if False:\n    import toy.deep.helper",
        "if True:\n    pass\nelse:\n    import toy.deep.helper",
        "try:\n    pass\nexcept ValueError:\n    import toy.deep.helper",
        "try:\n    pass\nfinally:\n    import toy.deep.helper",
        "with open('x'):\n    for x in []:\n        pass\n    else:\n        import toy.deep.helper",
        "while True:\n    import toy.deep.helper",
        "match 1:\n    case 1:\n        import toy.deep.helper",
        "async def late():\n    import toy.deep.helper",
    ],
)
def test_ways_to_import(toy, statement):
    (toy.source / "toy" / "deep").mkdir()
    toy.module("deep/__init__", "")
    toy.module("deep/helper", "def f(): return 1")
    toy.module("arithmetic", statement)
    assert list(reached(toy, "toy.arithmetic")) == ["toy.arithmetic", "toy.deep.helper"]


@pytest.mark.parametrize(
    "statement", ["from . import sibling", "from .. import arithmetic", "from ..arithmetic import f"]
)
def test_relative_imports_below(toy, statement):
    (toy.source / "toy" / "deep").mkdir()
    toy.module("deep/__init__", "")
    toy.module("deep/helper", statement)
    toy.module("deep/sibling", "")
    found = "toy.deep.sibling" if "sibling" in statement else "toy.arithmetic"
    assert list(reached(toy, "toy.deep.helper")) == sorted([found, "toy.deep.helper"])


def test_circular_imports_end(toy):
    toy.module("ordering", "from toy import median")
    assert list(reached(toy, "toy.median")) == ["toy.median", "toy.ordering"]


def test_other_packages_do_not_count(toy):
    toy.module("arithmetic", "import numpy\nimport pipeline.stage\nfrom pipeline import errors\n")
    assert list(reached(toy, "toy.arithmetic")) == ["toy.arithmetic"]


def test_modules_that_are_not_there_are_passed_over(toy):
    toy.module("arithmetic", "try:\n    from toy import absent\nexcept ImportError:\n    absent = None\n")
    assert list(reached(toy, "toy.arithmetic", "nowhere.at.all")) == ["toy.arithmetic"]


def test_a_module_of_its_own_does_not_reach_its_neighbours(toy):
    (toy.source / "lone.py").write_text("from lone import beside\n")
    (toy.source / "beside.py").write_text("")
    assert list(reached(toy, "lone")) == ["lone"]


def test_new_and_unused_modules_are_named(toy):
    before = fit_mean(toy)
    toy.edit("mean", "from toy.arithmetic import total", "from toy.ordering import middle as total")
    after = fit_mean(toy)
    assert changes(before, after) == [
        "toy.arithmetic is no longer used",
        "toy.mean.estimate changed",
        "toy.ordering is new",
    ]


def test_a_module_is_read_once_and_edits_are_noticed(toy):
    before = fit_mean(toy)
    files = code.files(before)
    assert list(files) == list(before)
    assert code.edited(files) == []
    toy.edit("arithmetic", "# one by one", "# each")
    assert code.reached(["toy.fit", "toy.mean"]) == before
    assert code.files(before) == files
    assert code.edited(files) == ["toy.arithmetic"]
    (toy.source / "toy" / "mean.py").unlink()
    assert code.edited(files) == ["toy.arithmetic", "toy.mean"]


def test_a_folder_with_spaces_and_links(toy, tmp_path, monkeypatch):
    before = fit_mean(toy)
    linked = tmp_path / "a link"
    linked.symlink_to(toy.source)
    monkeypatch.syspath_prepend(str(linked))
    assert fit_mean(toy) == before
