"""What people and machines see: the only module that prints.

Results go to standard output, everything else to standard error; with ``--json`` standard output holds one JSON
document and nothing more. On a terminal tables and progress are drawn with rich, elsewhere they are plain lines.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

from pipeline.runner import Event
from pipeline.values import plain

if TYPE_CHECKING:
    from pipeline.plots import Bars, Plot

COERCED = ("C.UTF-8", "C.utf8", "UTF-8")


class Console:
    """Prints for one command.

    Attributes:
        json: one JSON document on standard output, no tables.
        quiet: no progress and no notes; warnings and errors stay.
        verbose: one line for every stage of every point.
    """

    def __init__(self, *, json: bool = False, quiet: bool = False, verbose: bool = False) -> None:
        self.json = json
        self.quiet = quiet
        self.verbose = verbose

    def result(self, text: str) -> None:
        """A line of the result; not with --json."""
        if not self.json:
            print(text, flush=True)  # a caller may wait for it, as for the address of a server

    def document(self, value: Any) -> None:
        """The JSON document, where it is asked for; numbers that are not finite become null."""
        if self.json:
            print(json.dumps(_finite(plain(value)), indent=1, allow_nan=False), flush=True)

    def note(self, text: str) -> None:
        """Something good to know, on standard error; not with --quiet."""
        if not self.quiet:
            print(text, file=sys.stderr)

    def warn(self, text: str) -> None:
        """A warning, on standard error."""
        self._coloured("warning: ", "yellow", text)

    def error(self, text: str) -> None:
        """An error, on standard error."""
        self._coloured("error: ", "red", text)

    def table(self, rows: Sequence[Mapping[str, Any]], title: str = "") -> None:
        """Rows with the same columns; not with --json."""
        if self.json or not rows:
            return
        heads = list(rows[0])
        cells = [[cell(row.get(head)) for head in heads] for row in rows]
        numeric = [all(isinstance(row.get(head), int | float | None) for row in rows) for head in heads]
        if _colour(sys.stdout):
            self._rich_table(title, heads, cells, numeric)
            return
        if title:
            print(title)
        widths = [max(len(head), *(len(line[i]) for line in cells)) for i, head in enumerate(heads)]
        for line in [heads, *cells]:
            parts = [
                text.rjust(width) if right else text.ljust(width)
                for text, width, right in zip(line, widths, numeric, strict=True)
            ]
            print("  ".join(parts).rstrip())

    @property
    def draws(self) -> bool:
        """Whether plots are wanted: not with --json, not with --quiet."""
        return not self.json and not self.quiet

    def plots(self, plots: Sequence[Plot | Bars], head: str = "") -> None:
        """Plots below an empty line and a head, as wide as the terminal, where they are wanted and there is room."""
        if not self.draws:
            return
        from pipeline.braille import Style
        from pipeline.drawing import draw

        width = shutil.get_terminal_size().columns
        lines = draw(plots, Style(width=width, braille=_braille(sys.stdout), colours=_colour(sys.stdout)))
        for line in ["", *([head, ""] if head else []), *lines] if lines else []:
            print(line)

    def csv(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Rows as comma-separated values with a head line."""
        buffer = io.StringIO()
        writer = csv.DictWriter(buffer, fieldnames=list(rows[0]) if rows else [], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        print(buffer.getvalue(), end="")

    @contextmanager
    def progress(self, points: int, stages: int) -> Iterator[Callable[[Event], None]]:
        """A listener for `pipeline.runner.run` that shows how far it is."""
        if _colour(sys.stderr) and not self.quiet:
            with self._bar(points, stages) as listener:
                yield listener
        else:
            yield _Lines(self, points, stages)

    def progress_of(self, event: Event, points: int) -> None:
        """Warnings of a run, and the failures of a sweep; that of a single point is the command's own error."""
        if event.kind == "warning":
            self.warn(f"{_place(event)}: {event.message}")
        elif event.kind == "failed" and points > 1:
            self.error(event.message)

    @contextmanager
    def _bar(self, points: int, stages: int) -> Iterator[Callable[[Event], None]]:
        from rich.console import Console as RichConsole
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        rich = RichConsole(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with Progress(*columns, console=rich, transient=True) as bar:
            task = bar.add_task("starting", total=points * stages)

            def listen(event: Event) -> None:
                if event.kind == "started":
                    bar.update(task, description=_place(event))
                elif event.kind in ("done", "cached"):
                    bar.advance(task)
                self.progress_of(event, points)

            yield listen

    def _rich_table(self, title: str, heads: list[str], cells: list[list[str]], numeric: list[bool]) -> None:
        from rich import box
        from rich.console import Console as RichConsole
        from rich.table import Table
        from rich.text import Text

        table = Table(title=title or None, box=box.SIMPLE_HEAD, title_justify="left")
        for head, right in zip(heads, numeric, strict=True):
            table.add_column(Text(head), justify="right" if right else "left")
        for line in cells:
            table.add_row(*(Text(text) for text in line))
        RichConsole().print(table)

    def _coloured(self, head: str, colour: str, text: str) -> None:
        code = {"yellow": "33", "red": "31"}[colour]
        shown = f"\033[{code}m{head}\033[0m" if _colour(sys.stderr) else head
        print(f"{shown}{text}", file=sys.stderr)


class _Lines:
    """Progress as plain lines: a stage a line for one point or when verbose, else a point a line."""

    def __init__(self, console: Console, points: int, stages: int) -> None:
        self.console = console
        self.points = points
        self.stages = stages
        self.done: dict[str, int] = {}
        self.seconds: dict[str, float] = {}
        self.finished = 0

    def __call__(self, event: Event) -> None:
        self.console.progress_of(event, self.points)
        if event.kind not in ("done", "cached"):
            return
        self.done[event.point] = self.done.get(event.point, 0) + 1
        self.seconds[event.point] = self.seconds.get(event.point, 0.0) + event.seconds
        took = "cached" if event.kind == "cached" else f"{event.seconds:.2f} s"
        if self.points == 1:
            self.console.note(f"{event.stage:<9} {took}")
        elif self.console.verbose:
            self.console.note(f"{event.point}  {event.stage:<9} {took}")
        if self.done[event.point] == self.stages and self.points > 1:
            self.finished += 1
            total = self.seconds[event.point]
            shown = f"{total:.2f} s" if total else "cached"
            self.console.note(f"[{self.finished}/{self.points}] {event.point}  {shown}")


def cell(value: Any) -> str:
    """A value as a table shows it: five significant digits, a dash for nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.0f}" if 1e5 <= abs(value) < 1e9 else f"{value:.5g}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(cell(item) for item in value) + "]"
    if isinstance(value, dict):
        return json.dumps(plain(value))
    return str(value)


def _place(event: Event) -> str:
    return event.stage if event.point == "main" else f"{event.point}, {event.stage}"


def _colour(stream: TextIO) -> bool:
    """Whether a stream is a terminal that may be drawn on."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _braille(stream: TextIO) -> bool:
    """Whether braille may be printed: the encoding has it, and nobody asked for the locale C.

    Python writes UTF-8 in that locale, too, and sets LC_CTYPE to one of `COERCED` by itself (PEP 538).
    """
    try:
        "\u28ff".encode(stream.encoding or "utf-8")
    except (UnicodeEncodeError, LookupError):
        return False
    kind = os.environ.get("LC_CTYPE", "")
    asked = os.environ.get("LC_ALL") or ("" if kind in COERCED else kind) or os.environ.get("LANG")
    return asked not in ("C", "POSIX")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
