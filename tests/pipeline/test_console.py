"""What is printed where: plain tables, one JSON document, quiet, progress, and drawing on a terminal."""

from __future__ import annotations

import io
import json
from enum import StrEnum

import pytest

from pipeline.console import Console, cell
from pipeline.runner import Event

NAN, INF = float("nan"), float("inf")


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"),
        (NAN, "-"),
        (INF, "inf"),
        (True, "yes"),
        (False, "no"),
        (3, "3"),
        (10**20, "1" + "0" * 20),
        (3.0, "3"),
        (0.1 + 0.2, "0.3"),
        (123456.7, "123457"),
        (-123456.7, "-123457"),
        (12345.67, "12346"),
        (1.5e-7, "1.5e-07"),
        ("text", "text"),
        ([1.0, None, "a"], "[1, -, a]"),
        ((), "[]"),
        ({"a": (1, 2)}, '{"a": [1, 2]}'),
    ],
)
def test_cell(value, text):
    assert cell(value) == text


def test_table(capsys):
    Console().table(
        [{"name": "a", "value": 1.0, "yes": True}, {"name": "longer", "value": None, "yes": False}], "Title"
    )
    assert capsys.readouterr().out == "Title\nname    value  yes\na           1  yes\nlonger      -   no\n"


def test_table_of_texts_and_missing_cells(capsys):
    Console().table([{"a": "x", "b": "1"}, {"a": "größe"}])
    assert capsys.readouterr().out == "a      b\nx      1\ngröße  -\n"


def test_table_of_nothing(capsys):
    Console().table([])
    assert capsys.readouterr().out == ""


def test_json_is_one_document_and_nothing_else(capsys):
    class State(StrEnum):
        CACHED = "cached"

    console = Console(json=True)
    console.result("text")
    console.table([{"a": 1}])
    console.document({"a": NAN, "b": [INF, -INF, 1.5], "c": {"d": (NAN,)}, "state": State.CACHED, "text": "ö"})
    console.note("a note")
    console.warn("a warning")
    found = capsys.readouterr()
    assert json.loads(found.out) == {
        "a": None,
        "b": [None, None, 1.5],
        "c": {"d": [None]},
        "state": "cached",
        "text": "ö",
    }
    assert found.err == "a note\nwarning: a warning\n"


def test_no_document_without_json(capsys):
    Console().document({"a": 1})
    assert capsys.readouterr().out == ""


def test_quiet_keeps_warnings_and_errors(capsys):
    console = Console(quiet=True)
    console.note("a note")
    console.warn("a warning")
    console.error("an error")
    console.result("a result")
    assert capsys.readouterr() == ("a result\n", "warning: a warning\nerror: an error\n")


def test_csv(capsys):
    console = Console()
    console.csv([{"a": 1, "b": 'x,"y"'}, {"a": None, "b": 0.1}])
    console.csv([])
    assert capsys.readouterr().out == 'a,b\n1,"x,""y"""\n,0.1\n\n'


EVENTS = [
    Event(kind="started", point="main", stage="fit"),
    Event(kind="warning", point="main", stage="fit", message="careful."),
    Event(kind="done", point="main", stage="fit", seconds=1.234),
    Event(kind="cached", point="main", stage="score"),
    Event(kind="failed", point="main", stage="score", message="said by the command."),
]


def listened(events, points, stages=2, **options):
    with Console(**options).progress(points, stages) as listen:
        for event in events:
            listen(event)


def test_progress_of_one_point(capsys):
    listened(EVENTS, 1)
    assert capsys.readouterr() == ("", "warning: fit: careful.\nfit       1.23 s\nscore     cached\n")


def test_progress_when_quiet(capsys):
    listened(EVENTS, 1, quiet=True)
    assert capsys.readouterr() == ("", "warning: fit: careful.\n")


SWEEP = [
    Event(kind="done", point="a=1", stage="fit", seconds=1.0),
    Event(kind="cached", point="a=2", stage="fit"),
    Event(kind="failed", point="a=3", stage="fit", message="stage fit at a=3: no."),
    Event(kind="done", point="a=1", stage="score", seconds=0.5),
    Event(kind="cached", point="a=2", stage="score"),
]


def test_progress_of_a_sweep(capsys):
    listened(SWEEP, 3)
    assert capsys.readouterr().err == "error: stage fit at a=3: no.\n[1/3] a=1  1.50 s\n[2/3] a=2  cached\n"


def test_progress_of_a_sweep_when_verbose(capsys):
    listened(SWEEP, 3, verbose=True)
    assert capsys.readouterr().err.splitlines() == [
        "a=1  fit       1.00 s",
        "a=2  fit       cached",
        "error: stage fit at a=3: no.",
        "a=1  score     0.50 s",
        "[1/3] a=1  1.50 s",
        "a=2  score     cached",
        "[2/3] a=2  cached",
    ]


def terminal(monkeypatch):
    """Both streams as a terminal, from now on: pytest exchanges them after its fixtures."""
    out, err = Terminal(), Terminal()
    monkeypatch.setattr("sys.stdout", out)
    monkeypatch.setattr("sys.stderr", err)
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "60")
    return out, err


def test_a_terminal_is_drawn_on(monkeypatch):
    streams = terminal(monkeypatch)
    console = Console()
    console.table([{"name": "[a]", "value": 1.0}])
    console.warn("a warning")
    listened(EVENTS, 1)
    out, err = (stream.getvalue() for stream in streams)
    assert "[a]" in out
    assert "─" in out
    assert "\033[33mwarning: \033[0ma warning\n" in err
    assert "careful." in err


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_a_terminal_that_is_not_to_be_drawn_on(monkeypatch, name, value):
    streams = terminal(monkeypatch)
    monkeypatch.setenv(name, value)
    Console().table([{"a": 1}])
    Console().warn("x")
    listened(EVENTS, 1)
    out, err = (stream.getvalue() for stream in streams)
    assert out == "a\n1\n"
    assert err == "warning: x\nwarning: fit: careful.\nfit       1.23 s\nscore     cached\n"
