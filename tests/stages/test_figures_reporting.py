"""The verb report: one experiment's page, figures as files, the page of all; and what it says where it cannot."""

from __future__ import annotations

import html
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from pages import check_page
from support import Invoke, make_project

from pipeline.pictures import LIST
from pipeline.report import Code, Figure, Key, Panel, Paragraph, Section, Table
from stages.figures.index import COMMAND, Entry, Skipped, index_page

PICTURE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 5"><rect width="10" height="5"/></svg>'

# --- one experiment -------------------------------------------------------------------------------------------------


def test_figures_are_written_beside_the_report(computed: Path, clpv: Invoke) -> None:
    folder = computed / "runs" / "quickstart"
    (folder / "figures").mkdir()
    (folder / "figures" / "pushed-9.png").write_bytes(b"of an earlier call")
    (folder / "figures" / LIST).write_text("pushed-9.png\n../experiment.toml\n", encoding="utf-8")
    result = clpv(computed, "report", "quickstart", "--figures", "--json")
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    names = [f"{name}-1.{kind}" for name in ("rollouts", "accuracy", "recovery", "sampler") for kind in ("svg", "png")]
    assert document["figures"] == [f"runs/quickstart/figures/{name}" for name in names]
    assert document["file"] == "runs/quickstart/report.html"
    assert document["bytes"] == (folder / "report.html").stat().st_size
    assert sorted(path.name for path in (folder / "figures").iterdir()) == sorted([LIST, *names])
    assert (folder / "experiment.toml").is_file()  # whatever the list says, pictures alone are removed
    before = {name: (folder / "figures" / name).read_bytes() for name in names}
    result = clpv(computed, "report", "quickstart", "--figures")
    assert result.stdout == "report: runs/quickstart/report.html\nfigures: runs/quickstart/figures, 8 files\n"
    assert {name: (folder / "figures" / name).read_bytes() for name in names} == before


def test_figures_of_a_named_file_have_a_folder_of_its_name(computed: Path, clpv: Invoke, tmp_path: Path) -> None:
    target = tmp_path / "out" / "mine.html"
    result = clpv(computed, "report", "quickstart", "--figures", "-o", str(target))
    assert result.exit_code == 2
    assert (
        result.stderr
        == f"error: --output {target}: there is no folder {target.parent}; make it, or name another one.\n"
    )
    target.parent.mkdir()
    assert clpv(computed, "report", "quickstart", "--figures", "-o", str(target)).exit_code == 0
    assert sorted(path.name for path in target.parent.iterdir()) == ["mine-figures", "mine.html"]
    assert len(list((tmp_path / "out" / "mine-figures").glob("[!.]*"))) == 8
    assert not (computed / "runs" / "quickstart" / "report.html").exists()


@pytest.mark.parametrize("output", ["", ".", "/", "runs"])
def test_output_that_names_no_file_is_refused(
    computed: Path, clpv: Invoke, monkeypatch: pytest.MonkeyPatch, output: str
) -> None:
    monkeypatch.chdir(computed)
    result = clpv(computed, "report", "quickstart", "-o", output)
    assert result.exit_code == 2
    assert f"--output names no file but a folder, {output!r}: name a file in it, e.g. " in result.stderr
    assert result.stderr.count("\n") == 1


def test_output_below_a_file_is_refused(computed: Path, clpv: Invoke, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    result = clpv(computed, "report", "quickstart", "-o", str(tmp_path / "file" / "report.html"))
    assert result.exit_code == 2
    assert result.stderr.endswith(f"there is no folder {tmp_path / 'file'}; make it, or name another one.\n")


def test_the_page_repeats_the_options_that_changed_the_experiment(computed: Path, clpv: Invoke) -> None:
    options = ["--set", 'description="it\'s & one"', "--seed", "0"]
    assert clpv(computed, "run", "quickstart", *options, "--quiet").exit_code == 0
    assert clpv(computed, "report", "quickstart", *options).exit_code == 0
    page = (computed / "runs" / "quickstart" / "report.html").read_text(encoding="utf-8")
    found = re.search(r"<pre[^>]*><code>(.*?)</code>", page, re.DOTALL)
    assert found is not None
    lines = [shlex.split(line) for line in html.unescape(found[1]).splitlines()]
    assert lines == [
        ["clpv", "run", "quickstart", *options],
        ["clpv", "report", "quickstart", *options],
        ["clpv", "inspect", "quickstart", *options],
    ]
    assert "it&#x27;s &amp; one. Options of the command changed it for this report, see below." in page
    check_page(page)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "error: No experiment was named: add its name, as in 'clpv report quickstart', or --all.\n"),
        (["quickstart", "--all"], "error: --all writes every report to its own place: leave out NAME, "),
        (["--all", "-o", "x.html"], "error: --all writes every report to its own place: leave out NAME, "),
        (["--all", "--set", "seed=1"], "error: --all writes every report to its own place: leave out NAME, "),
        (["--all", "--seed", "0"], "error: --all writes every report to its own place: leave out NAME, "),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, clpv: Invoke, arguments: list[str], sentence: str) -> None:
    result = clpv(make_project(tmp_path, "quickstart"), "report", *arguments)
    assert result.exit_code == 2
    assert result.stderr.startswith(sentence)
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "runs" / "index.html").exists()


# --- all ------------------------------------------------------------------------------------------------------------


def test_all_writes_what_is_up_to_date_and_lists_the_rest(computed: Path, clpv: Invoke) -> None:
    (computed / "runs" / "other").mkdir()
    (computed / "runs" / "other" / "experiment.toml").write_text('[ingest]\nmotion = "Line"\n', encoding="utf-8")
    result = clpv(computed, "report", "--all")
    assert result.exit_code == 0
    assert result.stdout == (
        "report: runs/quickstart/report.html\n"
        "skipped: other is not run; next: 'clpv run other'\n"
        "index: runs/index.html, 1 written, 1 skipped\n"
    )
    assert re.search(r"^report +\d+\.\d\d s$", result.stderr, re.MULTILINE)
    page = (computed / "runs" / "index.html").read_text(encoding="utf-8")
    check_page(page)
    assert '<a href="quickstart/report.html">Report of quickstart</a>' in page
    assert (computed / "runs" / "quickstart" / "report.html").is_file()
    assert "32 of 32 roll-outs reached the goal." in page
    assert "<code>clpv run other</code>" in page
    assert "other/report.html" not in page
    assert str(computed) not in page
    result = clpv(computed, "report", "--all", "--figures", "--json", "--quiet")
    document = json.loads(result.stdout)
    assert result.stderr == ""
    assert document["index"] == "runs/index.html"
    assert document["bytes"] == len(page.encode())
    assert (computed / "runs" / "index.html").read_text(encoding="utf-8") == page
    assert [(one["experiment"], len(one["figures"])) for one in document["written"]] == [("quickstart", 8)]
    assert document["skipped"] == [{"experiment": "other", "state": "not run", "command": "clpv run other"}]


def test_an_experiment_that_was_edited_is_stale(computed: Path, clpv: Invoke) -> None:
    path = computed / "runs" / "quickstart" / "experiment.toml"
    path.write_text(path.read_text(encoding="utf-8") + "\n[midpoint]\nsamples = 77\n", encoding="utf-8")
    document = json.loads(clpv(computed, "report", "--all", "--json").stdout)
    assert document["written"] == []
    assert [one["state"] for one in document["skipped"]] == ["stale"]


def test_a_broken_experiment_is_named_before_anything_is_written(computed: Path, clpv: Invoke) -> None:
    (computed / "runs" / "broken").mkdir()
    (computed / "runs" / "broken" / "experiment.toml").write_text(
        '[ingest]\nmotion = "Line"\n[mixture]\nkinds = 1\n', encoding="utf-8"
    )
    result = clpv(computed, "report", "--all")
    assert result.exit_code == 2
    assert result.stderr.startswith("error: runs/broken/experiment.toml: mixture")
    assert not (computed / "runs" / "index.html").exists()


def test_all_of_nothing_says_how_to_begin(tmp_path: Path, clpv: Invoke) -> None:
    (tmp_path / "runs").mkdir()
    result = clpv(tmp_path, "report", "--all")
    assert result.exit_code == 0
    assert result.stdout == "index: runs/index.html, 0 written, 0 skipped\n"
    page = (tmp_path / "runs" / "index.html").read_text(encoding="utf-8")
    assert "make one with <code>clpv new NAME</code>" in page


# --- the page of all ------------------------------------------------------------------------------------------------


def entry(name: str, **changes: Any) -> Entry:
    panels = tuple(Panel(svg=PICTURE, alt=f"Panel {index}.") for index in range(4))
    figure = Figure(panels=panels, caption="Long.", columns=3, legend=(Key(label="<k>", colour="ink"),))
    table = Table(caption="First <table>", columns=("a", "b"), rows=(("x", "1"),))
    given: dict[str, Any] = {
        "name": name,
        "points": 2,
        "target": f"{name}/report.html",
        "lead": (Paragraph(text="About <it>"), Paragraph(text="It came out."), Code(text="clpv run")),
        "sections": (Section(id="s", title="S", blocks=(Paragraph(text="p"), figure, table, figure)),),
    }
    return Entry(**{**given, **changes})


def test_index_shows_of_each_what_it_is_about_and_its_first_figure() -> None:
    page = index_page([entry("one"), entry("one.title"), entry("f1-m1")], [])
    check_page(page)
    for name in ("one", "one.title", "f1-m1"):
        assert f'<a href="#experiment:{name}">{name}</a>' in page
        assert f'<a href="{name}/report.html">Report of {name}</a>' in page
    assert page.count("About &lt;it&gt;") == page.count("It came out.") == page.count("Up to date; 2 points.") == 3
    assert page.count('role="img"') == 3 * 3  # the first row
    assert page.count("The first of 2 figures of the report, its first row.") == 3
    assert page.count("<details>") == 3
    assert page.count(COMMAND) == 1
    assert "3 experiments up to date, with a report." in page
    assert "Not up to date" not in page


def test_index_of_an_experiment_without_figures_and_tables() -> None:
    page = index_page([entry("one", points=1, sections=())], [])
    check_page(page)
    assert "Up to date; 1 point." in page
    assert "<figure>" not in page


def test_index_lists_what_is_to_be_run() -> None:
    skipped = [Skipped(name="two", description="About & it", state="stale")]
    page = index_page([], skipped)
    check_page(page)
    assert "No experiment is up to date" in page
    assert "1 experiment to be run first" in page
    assert "About &amp; it" in page
    assert "<code>clpv run two</code>" in page
