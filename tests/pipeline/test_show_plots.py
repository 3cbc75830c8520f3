"""``show`` draws what a stage declares, of one point, where that helps; and no key depends on it."""

from __future__ import annotations

import io
import json
import subprocess

import pytest

from pipeline.console import Console
from pipeline.plots import Bar, Bars

DRAWN = '''
    """What is drawn of the toy."""

    from pipeline.plots import Bar, Bars


    def score(files):
        value = float(files["score"].read_text())
        names = ", ".join(sorted(files))
        return [
            Bars(title=f"Score, of {names}", bars=(Bar(name="score", value=value),)),
            Bars(title="Twice", bars=(Bar(name="twice", value=2 * value),)),
        ]
'''

SCORE = "Score, of model, numbers, score\nscore  ⣶"
TWICE = "Twice\ntwice  ⣶"


@pytest.fixture
def drawn(toy, monkeypatch):
    """The toy, whose last stage declares two plots."""
    for name in ("LC_ALL", "LC_CTYPE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("LANG", "C.UTF-8")
    toy.edit(
        "score", "            headline=headline,\n".lstrip(" "), "headline=headline,\n    plots='toy.drawn:score',\n"
    )
    toy.module("drawn", DRAWN)
    return toy


def test_a_stage_with_its_plots(drawn):
    drawn.run()
    found = drawn.cli("show", "try", "--stage", "score")
    assert found.exit_code == 0
    tables, plots = found.stdout.split("\n\nScore")
    assert tables.endswith("two      30        -")
    assert ("Score" + plots).startswith(SCORE)
    assert f"\n\n{TWICE}" in plots
    assert plots.endswith(" 60\n")
    assert max(map(len, plots.split("\n"))) <= 100
    assert "\033" not in found.stdout


def test_a_stage_without_plots(drawn):
    drawn.run()
    assert "⣶" not in drawn.cli("show", "try", "--stage", "fit").stdout


def test_the_whole_experiment_shows_the_first_plot_of_the_last_stage_that_has_any(drawn):
    drawn.run()
    found = drawn.cli("show", "try").stdout
    assert f"\n\n{SCORE}" in found
    assert "Twice" not in found
    assert "points (another" not in found


def test_an_experiment_that_is_not_up_to_date_is_shown_without(drawn):
    assert "Score" not in drawn.cli("show", "try").stdout
    drawn.run()
    assert "Score" not in drawn.cli("show", "try", "--set", "score.digits=3").stdout


@pytest.mark.parametrize("stage", [(), ("--stage", "score")])
def test_of_a_sweep_the_point_that_is_shown(drawn, stage):
    drawn.run("many")
    found = drawn.cli("show", "many", *stage).stdout
    assert f"\n\noffset=0.0, one of 3 points (another: --point):\n\n{SCORE}" in found
    assert found.count("Score") == 1
    other = drawn.cli("show", "many", *stage, "--point", "offset=2.0").stdout
    assert "\n\noffset=2.0, one of 3 points (another: --point):\n\nScore" in other
    assert " 50\n" in other.split("Score")[1]


@pytest.mark.parametrize("options", [("--quiet",), ("-q",)])
def test_tables_only(drawn, options):
    drawn.run()
    for stage in ((), ("--stage", "score")):
        whole, quiet = drawn.cli("show", "try", *stage).stdout, drawn.cli("show", "try", *stage, *options).stdout
        assert whole.startswith(quiet)
        assert "⣶" not in quiet


def test_documents_and_csv_are_as_they_were(drawn):
    drawn.run()
    document = json.loads(drawn.cli("show", "try", "--stage", "score", "--json").stdout)
    assert list(document) == [
        *("experiment", "stage", "parameters", "artifacts", "metrics", "rows", "tables", "warnings"),
    ]
    assert "plots" not in json.loads(drawn.cli("show", "try", "--json").stdout)
    assert drawn.cli("show", "try", "--stage", "score", "--csv").stdout == (
        "point,case,score,nothing\nmain,one,30.0,\nmain,two,30.0,\n"
    )


@pytest.mark.parametrize("columns", ["39", "40", "60", "200"])
def test_as_wide_as_the_terminal_within_bounds(drawn, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    drawn.run()
    _, *plots = drawn.cli("show", "try", "--stage", "score").stdout.split("\n\nScore")
    if columns == "39":
        assert plots == []
    else:
        assert max(map(len, plots[0].split("\n"))) == min(int(columns), 100)


@pytest.mark.parametrize(
    "environment",
    [{"PYTHONIOENCODING": "ascii"}, {"PYTHONIOENCODING": "latin-1"}, {"LC_ALL": "C"}, {"LANG": "C"}, {"LANG": "POSIX"}],
    ids=str,
)
def test_plain_characters_where_braille_cannot_be_shown(drawn, environment):
    drawn.run()
    done = subprocess.run(
        drawn.command("show", "try", "--stage", "score"),
        env={**drawn.environment(), **environment},
        capture_output=True,
        check=True,
    )
    assert b"\nscore  ####" in done.stdout
    assert done.stdout.isascii()
    assert done.stderr == b""


@pytest.mark.parametrize("environment", [{}, {"LC_CTYPE": "C.UTF-8"}, {"LC_ALL": "C.UTF-8"}], ids=str)
def test_braille_elsewhere(drawn, environment):
    drawn.run()
    done = subprocess.run(
        drawn.command("show", "try", "--stage", "score"),
        env={**drawn.environment(), **environment},
        capture_output=True,
        check=True,
    )
    assert SCORE in done.stdout.decode()


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(("variable", "value"), [("", ""), ("NO_COLOR", "1"), ("TERM", "dumb")])
def test_colours_on_a_terminal_only(monkeypatch, variable, value):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    if variable:
        monkeypatch.setenv(variable, value)
    for stream, coloured in ((Terminal(), not variable), (io.StringIO(), False)):
        monkeypatch.setattr("sys.stdout", stream)
        Console().plots([Bars(title="t", bars=(Bar(name="a", value=1.0),))], "Head")
        assert ("\033[36m⣶" in stream.getvalue()) is coloured
        assert stream.getvalue().startswith("\nHead\n\nt\na  ")


def test_nothing_is_printed_of_no_plots(capsys):
    Console().plots([], "Head")
    Console(quiet=True).plots([Bars(title="t", bars=(Bar(name="a", value=1.0),))])
    assert capsys.readouterr() == ("", "")


def test_what_cannot_be_drawn_is_a_warning(drawn):
    drawn.module(
        "drawn",
        """
        from pipeline.errors import DataError


        def score(files):
            raise DataError("score.txt", "is odd.")
        """,
    )
    drawn.run()
    found = drawn.cli("show", "try", "--stage", "score")
    assert found.exit_code == 0
    assert found.stdout.endswith("two      30        -\n")
    assert found.stderr == "warning: not drawn: score.txt: is odd.\n"


def test_no_key_depends_on_what_is_drawn(drawn):
    drawn.run()
    drawn.edit("drawn", "2 * value", "3 * value")
    assert drawn.computed(drawn.run()) == []
    assert " 90\n" in drawn.cli("show", "try", "--stage", "score").stdout
