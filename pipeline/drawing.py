"""Plots as lines of text: pictures with axes and a legend, bar charts, and how they are laid out.

Braille where it can be shown, plain characters elsewhere. Series are told apart by letters and signs, never by colour
alone. No streams: the console knows the terminal, and prints.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.braille import ACROSS, DOWN, Frame, Sheet, Style, Text, canvas, finite, tinted
from pipeline.plots import Array, Bars, Plot, Series

NARROWEST, WIDEST = 40, 100
"""Columns: in fewer nothing is drawn, more are left free."""

HEIGHT = 12
"""Rows of a picture, without title, axis and legend; one whose axes share a scale may need fewer."""

LOWEST, SLIMMEST = 4, 24
"""Rows and columns of the smallest picture."""

GAP = 3
"""Columns between pictures that stand side by side, and between entries of a legend."""

COLOURS = ("36", "33", "35", "32", "34", "31")
"""ANSI codes of series in order: cyan, yellow, magenta, green, blue, red."""

FAINT = "2"

LETTERS = "abcdefghijklmnopqrstuvwxyz"

Block = list[Text]


def draw(plots: Sequence[Plot | Bars], style: Style) -> list[str]:
    """The lines that show plots below each other, those that fit side by side; none in fewer than 40 columns.

    A plot without a single finite value is left out.
    """
    if style.width < NARROWEST:
        return []
    width = min(style.width, WIDEST)
    rows: list[list[Block]] = []
    for plot in plots:
        block = _chart(plot, width, style) if isinstance(plot, Bars) else _picture(plot, width, style)
        if rows and block and sum(_columns(b) + GAP for b in rows[-1]) + _columns(block) <= width:
            rows[-1].append(block)
        elif block:
            rows.append([block])
    lines: list[str] = []
    for row in rows:
        lines += [*([""] if lines else []), *_beside(row)]
    return lines


def _columns(block: Block) -> int:
    return max(line.columns for line in block)


def _beside(blocks: Sequence[Block]) -> Iterator[str]:
    """Lines of pictures that stand side by side."""
    for k in range(max(map(len, blocks))):
        line, at, begin = "", 0, 0
        for block in blocks:
            if k < len(block):
                line += " " * (begin - at) + block[k].shown
                at = begin + block[k].columns
            begin += _columns(block) + GAP
        yield line.rstrip()


def _plain(text: str) -> Text:
    return Text(text, len(text))


def _short(text: str, width: int, style: Style) -> str:
    """A text cut to a width."""
    return text if len(text) <= width else text[: width - 1] + ("…" if style.braille else "~")


# --- pictures -------------------------------------------------------------------------------------------------------


def _picture(plot: Plot, width: int, style: Style) -> Block:
    there = [finite(s.x) & finite(s.y) for s in plot.series]
    if not any(one.any() for one in there):
        return []
    x = _limits(np.concatenate([s.x[one] for s, one in zip(plot.series, there, strict=True)]), plot.x_limits)
    y = _limits(np.concatenate([s.y[one] for s, one in zip(plot.series, there, strict=True)]), plot.y_limits)
    side = 0
    while True:  # a wider column of values leaves less room, which changes the values
        frame = _frame(x, y, width - side - 2, same_scale=plot.same_scale)
        needed = max(map(len, _ends(*frame.y)))
        if needed <= side:
            break
        side = needed
    marks = _marks(plot.series)
    sheet = Sheet(frame, style)
    for faint, one, (mark, colour) in _in_layers(plot.series, marks):
        dots = frame.dots(one.x, one.y)
        if one.joined or not mark:
            sign = mark or ("." if faint or not one.joined else "*")
            sheet.line(dots, sign, colour, joined=one.joined, letter=mark)
    for _, one, (mark, colour) in _in_layers(plot.series, marks):
        if mark and not one.joined:
            sheet.put(frame.dots(one.x, one.y), mark, colour)
    sheet.letters()
    whole = side + 2 + frame.width
    return [
        *map(_plain, textwrap.wrap(plot.title, whole)),
        *_axes(plot, frame, sheet.lines(), side, style),
        *_legend(plot.series, marks, whole, style),
    ]


def _in_layers(
    series: Sequence[Series], marks: Sequence[tuple[str, str]]
) -> Iterator[tuple[bool, Series, tuple[str, str]]]:
    """Series with their signs, those that are faint first."""
    for faint in (True, False):
        yield from ((faint, one, mark) for one, mark in zip(series, marks, strict=True) if one.faint is faint)


def _limits(values: Array, wanted: tuple[float, float] | None) -> tuple[float, float]:
    """First and last value of an axis; about a single value there is some room."""
    low, high = (float(values.min()), float(values.max())) if wanted is None else wanted
    room = 0.05 * max(abs(low), abs(high)) or 1.0
    return (low - room, high + room) if high - low <= 1e-9 * room else (low, high)


def _frame(x: tuple[float, float], y: tuple[float, float], width: int, *, same_scale: bool) -> Frame:
    """The frame of a picture of at most `width` columns; of one scale, an axis may show more than it has to."""
    if not same_scale:
        return Frame(width=width, height=HEIGHT, x=x, y=y)
    unit = max((x[1] - x[0]) / (width * ACROSS - 1), (y[1] - y[0]) / (HEIGHT * DOWN - 1))  # of a dot
    columns = min(width, max(SLIMMEST, math.ceil(((x[1] - x[0]) / unit + 1) / ACROSS - 1e-9)))
    rows = min(HEIGHT, max(LOWEST, math.ceil(((y[1] - y[0]) / unit + 1) / DOWN - 1e-9)))
    across, up = unit * (columns * ACROSS - 1), unit * (rows * DOWN - 1)
    return Frame(width=columns, height=rows, x=_about(x, across), y=_about(y, up))


def _about(limits: tuple[float, float], extent: float) -> tuple[float, float]:
    """Limits of the given extent about the same middle."""
    middle = 0.5 * (limits[0] + limits[1])
    return middle - 0.5 * extent, middle + 0.5 * extent


def _ends(low: float, high: float) -> tuple[str, str]:
    """Both ends of an axis in words, to a hundredth of what lies between."""
    digits = 2 - math.floor(math.log10(high - low))
    if digits > 6 or max(abs(low), abs(high)) >= 1e7:
        return f"{low:.4g}", f"{high:.4g}"
    texts = [f"{value + 0.0:z.{max(0, digits)}f}" for value in (low, high)]
    first, last = (text.rstrip("0").rstrip(".") if "." in text else text for text in texts)
    return first, last


def _marks(series: Sequence[Series]) -> list[tuple[str, str]]:
    """Sign and colour of each series; one whose sign is "" is drawn as dots alone."""
    letters = iter(LETTERS)
    several = sum(one.joined and not one.faint for one in series) > 1
    found = []
    for number, one in enumerate(series):
        lettered = several and one.joined and not one.faint and not one.mark
        found.append((next(letters, "") if lettered else one.mark, FAINT if one.faint else _colour(number)))
    return found


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _axes(plot: Plot, frame: Frame, rows: Sequence[Text], side: int, style: Style) -> Iterator[Text]:
    """A picture's rows with the axes about them."""
    tick, upright, corner, level = "┤│└─" if style.braille else "||+-"
    low, high = _ends(*frame.y)
    yield _plain(_short(plot.y_label, side + 2 + frame.width, style).rjust(side))
    for k, row in enumerate(rows):
        value = high if k == 0 else low if k == len(rows) - 1 else ""
        head = f"{value:>{side}} {tick if value else upright}"
        yield Text(head + row.shown, len(head) + row.columns)
    yield _plain(" " * (side + 1) + corner + level * frame.width)
    first, last = _ends(*frame.x)
    between = frame.width - len(first) - len(last)
    fits = len(plot.x_label) + 2 <= between
    yield _plain(" " * (side + 2) + first + (plot.x_label if fits else "").center(between) + last)
    if not fits:
        yield _plain(" " * (side + 2) + _short(plot.x_label, frame.width, style).center(frame.width).rstrip())


def _legend(series: Sequence[Series], marks: Sequence[tuple[str, str]], width: int, style: Style) -> Block:
    """What the signs stand for, in as many lines as it takes."""
    lines: Block = []
    for one, (mark, colour) in zip(series, marks, strict=True):
        if not one.name or not (finite(one.x) & finite(one.y)).any():
            continue
        dots = ("⠒⠒" if one.joined else "⠂⠂") if style.braille else "**" if one.joined and not one.faint else ".."
        sign, name = mark or dots, _short(one.name, width - 3, style)
        entry = Text(f"{tinted(sign, colour, style)} {name}", len(sign) + 1 + len(name))
        if lines and lines[-1].columns + GAP + entry.columns <= width:
            last = lines.pop()
            entry = Text(last.shown + " " * GAP + entry.shown, last.columns + GAP + entry.columns)
        lines.append(entry)
    return lines


# --- bars -----------------------------------------------------------------------------------------------------------


def _chart(chart: Bars, width: int, style: Style) -> Block:
    known = [bar.value for bar in chart.bars if math.isfinite(bar.value)]
    if not known:
        return []
    texts = [bar.text or (f"{bar.value:.4g}" if math.isfinite(bar.value) else "-") for bar in chart.bars]
    texts = [_short(text, width // 4, style) for text in texts]
    names = [_short(bar.name, width // 2, style) for bar in chart.bars]
    side = max(map(len, names))
    room = width - side - max(map(len, texts)) - 3
    full = max(known) if chart.full is None else chart.full
    lines = [*map(_plain, textwrap.wrap(chart.title, width))]
    for name, bar, text in zip(names, chart.bars, texts, strict=True):
        share = min(1.0, max(0.0, bar.value / full)) if full > 0.0 and math.isfinite(bar.value) else 0.0
        shown = _bar(share, room, style)
        head, tail = f"{name:<{side}}  ", f" {text}" if shown else text
        lines.append(Text(head + tinted(shown, _colour(0), style) + tail, len(head) + len(shown) + len(tail)))
    return lines


def _bar(share: float, room: int, style: Style) -> str:
    """A bar of a share of `room` columns; one that is more than nothing is seen."""
    dots = round(share * room * ACROSS) or int(share > 0.0)
    columns = math.ceil(dots / ACROSS)
    if not style.braille or not columns:
        return "#" * columns
    sheet = canvas(columns, 1)
    for row in range(DOWN - 1):  # the uppermost dots stay free: they keep bars apart
        sheet.line(0, row, dots - 1, row)
    return str(sheet.plot())
