"""The page that leads to the reports of all experiments: what each is about, what came out, its first figure.

Blocks in, the page's text out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.report import Block, Code, Figure, Link, Paragraph, Section, Table, assemble
from stages.figures.numbers import counted

COMMAND = "clpv report --all"

STATES = {"new": "not run", "stale": "stale", "damaged": "damaged", "waiting": "stale"}
"""What the page calls the state of an experiment's first stage that is not up to date."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An experiment with a report.

    Attributes:
        name: of the experiment.
        points: how many.
        target: its report, as seen from the page.
        lead: the head of its report.
        sections: of its report.
    """

    name: str
    points: int
    target: str
    lead: tuple[Block, ...]
    sections: tuple[Section, ...]


@dataclass(frozen=True, kw_only=True)
class Skipped:
    """An experiment without a report: it has not been run, or something has changed since.

    Attributes:
        name: of the experiment.
        description: in its own words.
        state: a value of `STATES`.
    """

    name: str
    description: str
    state: str

    @property
    def command(self) -> str:
        """What helps."""
        return f"clpv run {self.name}"


def index_page(entries: Sequence[Entry], skipped: Sequence[Skipped]) -> str:
    """The page's HTML. Equal input, equal text."""
    there = counted(len(entries), "experiment")
    text = f"{there} up to date, with a report." if entries else "No experiment is up to date: there is no report yet."
    if skipped:
        text += f" {counted(len(skipped), 'experiment')} to be run first, see below."
    if not entries and not skipped:
        text = "There is no experiment yet: make one with `clpv new NAME`."
    lead: list[Block] = [Paragraph(text=text), Code(text=COMMAND)]
    sections = [_section(entry) for entry in entries]
    if skipped:
        sections.append(_to_be_run(skipped))
    return assemble("Experiments", lead, sections)


def _section(entry: Entry) -> Section:
    paragraphs = [block for block in entry.lead if isinstance(block, Paragraph)]
    blocks: list[Block] = [
        *paragraphs,
        Paragraph(text=f"Up to date; {counted(entry.points, 'point')}."),
        Link(text=f"Report of {entry.name}", target=entry.target),
    ]
    blocks += [block for block in (_first_figure(entry), _first_table(entry)) if block is not None]
    return Section(id=f"experiment:{entry.name}", title=entry.name, blocks=tuple(blocks))


def _first_figure(entry: Entry) -> Figure | None:
    """The first row of the report's first figure."""
    figures = [block for section in entry.sections for block in section.blocks if isinstance(block, Figure)]
    if not figures:
        return None
    first = figures[0]
    rest = f"The first of {counted(len(figures), 'figure')} of the report"
    rest += "." if len(first.panels) <= first.columns else ", its first row."
    return replace(first, panels=first.panels[: first.columns], caption=rest)


def _first_table(entry: Entry) -> Table | None:
    """The report's first table, to be opened."""
    tables = [block for section in entry.sections for block in section.blocks if isinstance(block, Table)]
    return replace(tables[0], collapsed=True) if tables else None


def _to_be_run(skipped: Sequence[Skipped]) -> Section:
    table = Table(
        caption=f"Run them, then write this page anew with `{COMMAND}`",
        columns=("experiment", "about", "state", "next"),
        rows=tuple((one.name, one.description, one.state, f"`{one.command}`") for one in skipped),
    )
    return Section(id="to-be-run", title="Not up to date", blocks=(table,))
