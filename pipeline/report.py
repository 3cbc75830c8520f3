"""Assembles one self-contained HTML page from the sections it is given: text, code, links, figures, tables.

The page needs no network, follows the reader's light or dark mode, and prints. Figures are SVG documents, put inline:
drawn in the light colours of `PALETTE`, they take the colours of the mode they are read in. Nothing here knows what the
sections are about, and nothing is read or written. How the page looks: `report_style.py`; how SVG documents are put
into it: `report_svg.py`; figures as files of their own: `pictures.py`.
"""

from __future__ import annotations

import html
import re
import struct
import unicodedata
from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pipeline.report_style import PALETTE as PALETTE
from pipeline.report_style import style_sheet
from pipeline.report_svg import SWATCH, inline_svg, swatch

MISSING = "\u2013"
"""What stands in a cell where there is nothing to say: it does not make a column of numbers one of words."""


@dataclass(frozen=True, kw_only=True)
class Paragraph:
    """Text; what stands between backticks is set as code, ``_{...}`` below the line, ``^{...}`` above it.

    Captions and the cells of tables are marked in the same way.
    """

    text: str


@dataclass(frozen=True, kw_only=True)
class Code:
    """Lines to be typed."""

    text: str


@dataclass(frozen=True, kw_only=True)
class Link:
    """A line that leads to another page; `target`: where it is, as seen from this one."""

    text: str
    target: str


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One picture of a figure.

    Attributes:
        svg: an SVG document.
        alt: what it shows, in words, for those who do not see it.
    """

    svg: str
    alt: str


@dataclass(frozen=True, kw_only=True)
class Key:
    """One entry of a figure's legend; `colour` is a name in `PALETTE`."""

    label: str
    colour: str
    mark: Literal["line", "dashed", "dotted", "area", "box", "dot", "arrow", "cross"] = "line"


@dataclass(frozen=True, kw_only=True)
class Figure:
    """Pictures side by side, in `columns` columns where there is room, below a common legend."""

    panels: tuple[Panel, ...]
    caption: str
    columns: int = 1
    legend: tuple[Key, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Animation:
    """A moving picture. On paper, and for readers who want nothing to move, a still one stands in its place.

    Attributes:
        gif: a GIF file's bytes.
        still: a PNG file's, of the same width and height.
        alt: what it shows, in words, for those who do not see it.
        caption: below it.
    """

    gif: bytes
    still: bytes
    alt: str
    caption: str


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of text; the first cell of a row is its head, columns of numbers are set flush right.

    An interval at the end of a cell, as in ``5.02 (4.9 to 5.1)``, is set back, and may stand on a line of its own.

    Attributes:
        groups: a line above the heads: (title, number of columns) from left to right; empty: no such line.
        collapsed: whether a reader has to open it.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    groups: tuple[tuple[str, int], ...] = ()
    collapsed: bool = False


Block = Paragraph | Code | Link | Figure | Animation | Table


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of the page; `id` is its anchor."""

    id: str
    title: str
    blocks: tuple[Block, ...]


def assemble(title: str, lead: Sequence[Block], sections: Sequence[Section]) -> str:
    """The page's HTML: a head with `lead`, links to the sections, the sections in order. Equal input, equal text.

    Text is in Unicode's composed form, as HTML wants it.
    """
    numbers = iter(range(1, 10_000))
    entries = "".join(f'<li><a href="#{_text(s.id)}">{_text(s.title)}</a></li>\n' for s in sections)
    body = "".join(
        f'<section id="{_text(s.id)}" aria-labelledby="{_text(s.id)}:title">\n'
        f'<h2 id="{_text(s.id)}:title">{_text(s.title)}</h2>\n'
        f"{_blocks(s.blocks, numbers)}</section>\n"
        for s in sections
    )
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{_text(title)}</title>\n<style>\n{style_sheet()}</style>\n</head>\n<body>\n"
        f"<header>\n<h1>{_text(title)}</h1>\n{_blocks(lead, numbers)}</header>\n"
        f'<nav aria-label="Sections">\n<ul>\n{entries}</ul>\n</nav>\n'
        f"<main>\n{body}</main>\n</body>\n</html>\n"
    )
    return unicodedata.normalize("NFC", page)


def _blocks(blocks: Iterable[Block], numbers: Iterator[int]) -> str:
    """Blocks in order; `numbers` gives every picture a number of its own. Will be advanced."""
    parts = []
    for block in blocks:
        match block:
            case Paragraph():
                parts.append(f"<p>{_marked(block.text)}</p>\n")
            case Code():
                parts.append(f'<pre tabindex="0"><code>{_text(block.text)}</code></pre>\n')
            case Link():
                parts.append(f'<p><a href="{_text(block.target)}">{_text(block.text)}</a></p>\n')
            case Figure():
                parts.append(_figure(block, numbers))
            case Animation():
                parts.append(_animation(block))
            case Table():
                parts.append(_table(block))
    return "".join(parts)


def _figure(figure: Figure, numbers: Iterator[int]) -> str:
    panels = "".join(
        f'<div class="panel">{inline_svg(panel.svg, f"f{number}-", panel.alt)}</div>\n'
        for panel, number in zip(figure.panels, numbers, strict=False)
    )
    keys = "".join(f"<li>{_mark(key)}{_text(key.label)}</li>\n" for key in figure.legend)
    legend = f'<ul class="legend">\n{keys}</ul>\n' if keys else ""
    return (
        f'<figure>\n{legend}<div class="panels columns-{figure.columns}">\n{panels}</div>\n'
        f"<figcaption>{_marked(figure.caption)}</figcaption>\n</figure>\n"
    )


def _mark(key: Key) -> str:
    """What a legend's entry looks like in the figure; its label says the rest."""
    width, height = SWATCH
    return f'<svg viewBox="0 0 {width} {height}" aria-hidden="true">{swatch(key.mark, f"var(--{key.colour})")}</svg>'


def _animation(animation: Animation) -> str:
    moving, still = (
        f"data:image/{kind};base64,{b64encode(data).decode()}"
        for kind, data in (("gif", animation.gif), ("png", animation.still))
    )
    width, height = gif_size(animation.gif)
    return (
        f'<figure>\n<picture><source media="(prefers-reduced-motion: reduce), print" srcset="{still}">'
        f'<img alt="{_text(animation.alt)}" width="{width}" height="{height}" src="{moving}"></picture>\n'
        f"<figcaption>{_marked(animation.caption)}</figcaption>\n</figure>\n"
    )


def gif_size(gif: bytes) -> tuple[int, int]:
    """Width and height of a GIF file, pixels. Raises ValueError where it is none."""
    if gif[:6] not in (b"GIF87a", b"GIF89a"):
        raise ValueError("a moving picture has to be a GIF file")
    width, height = struct.unpack_from("<HH", gif, 6)
    return int(width), int(height)


def _table(table: Table) -> str:
    numeric = [
        any(_is_number(row[column]) for row in table.rows)
        and all(_is_number(row[column]) or row[column] in ("", MISSING) for row in table.rows)
        for column in range(len(table.columns))
    ]
    classes = [' class="n"' if flag else "" for flag in numeric]
    short = all(len(row[0]) <= _SHORT for row in table.rows)
    head_class = classes[0] or (' class="k"' if short else "")
    groups = "".join(f'<th scope="colgroup" colspan="{span}">{_text(title)}</th>' for title, span in table.groups)
    heads = "".join(f'<th scope="col"{c}>{_marked(h)}</th>' for h, c in zip(table.columns, classes, strict=True))
    rows = "".join(
        f'<tr><th scope="row"{head_class}>{_marked(row[0])}</th>'
        + "".join(f"<td{c}>{_cell(cell)}</td>" for cell, c in zip(row[1:], classes[1:], strict=True))
        + "</tr>\n"
        for row in table.rows
    )
    head = (f"<tr>{groups}</tr>\n" if groups else "") + f"<tr>{heads}</tr>\n"
    # Where the table is opened by its caption, the caption is said once more for readers that skip to tables.
    hidden = ' class="hidden"' if table.collapsed else ""
    looks = " ".join(["dense"] * (len(table.columns) > _MANY) + ["wide"] * _is_wide(table))
    look = f' class="{looks}"' if looks else ""
    drawn = (
        f'<div class="scroll" tabindex="0">\n<table{look}>\n<caption{hidden}>{_marked(table.caption)}</caption>\n'
        f"<thead>\n{head}</thead>\n<tbody>\n{rows}</tbody>\n</table>\n</div>\n"
    )
    if not table.collapsed:
        return drawn
    return f"<details>\n<summary>{_marked(table.caption)}</summary>\n{drawn}</details>\n"


_MANY = 9
"""Columns of a table above which they are set closer."""

_SHORT = 28
"""Characters of a row's head that is kept on one line."""

_NUMBER = re.compile(r"[-+\u2212]?\d[\d.]*(?:·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?(?:\s%)?(?:\s\([^a-z]*(?:to[^a-z]*)?\))?")

_PAGE, _PADDING = 150, 3
"""Width of the page and room between columns, in characters of a table."""

_NO_BREAK = "\u00a0"
_PERCENT = re.compile(r"(?<=\d) %")
_RANGE = re.compile(r"(?<=\d) to (?=[\d\u2212])")
_INTERVAL = re.compile(r" (\([^()a-z]*\bto\b[^()a-z]*\))$")


def _cell(text: str) -> str:
    """A cell of a table, an interval at its end set back; what else it ranges over stays on one line."""
    text = _INTERVAL.sub(r' <span class="i">\1</span>', _marked(text))
    return _RANGE.sub(f"{_NO_BREAK}to{_NO_BREAK}", text)


def _is_wide(table: Table) -> bool:
    """Whether the table is wider than the page, were each of its cells on one line."""
    longest = [max((len(row[column]) for row in table.rows), default=0) for column in range(len(table.columns))]
    return sum(longest) + _PADDING * len(longest) > _PAGE


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None


def _text(text: str) -> str:
    return html.escape(text)


def _marked(text: str) -> str:
    """Escaped text with what is marked in it, see `Paragraph`."""
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", _PERCENT.sub(f"{_NO_BREAK}%", _text(text)))
    return re.sub(r"\^\{([^{}]*)\}", r"<sup>\1</sup>", re.sub(r"_\{([^{}]*)\}", r"<sub>\1</sub>", text))
