"""Assembles one self-contained HTML page from the sections it is given: text, code, figures, tables.

The page needs no network, follows the reader's light or dark mode, and prints. Figures are SVG documents, put inline:
drawn in the light colours of `PALETTE`, they take the colours of the mode they are read in. Nothing here knows what the
sections are about, and nothing is read or written.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree

PALETTE = {
    "ink": ("#1b1f24", "#e3e7eb"),
    "muted": ("#59636e", "#9aa5b1"),
    "faint": ("#9fa9b4", "#66717d"),
    "rule": ("#d5dade", "#39414a"),
    "surface": ("#fdfdfe", "#14181d"),
    "shade": ("#eef1f4", "#20262d"),
    "link": ("#0b5cad", "#7fb8f0"),
    # Okabe and Ito's colours, told apart with any colour vision; lighter on dark.
    "series-1": ("#c94f00", "#ff9248"),
    "series-2": ("#0067a9", "#5db6f5"),
    "series-3": ("#00805e", "#35c99b"),
    "series-4": ("#a94d84", "#e39ac4"),
    "series-5": ("#8f7200", "#e0c341"),
}
"""Name -> colour on a light and on a dark page; each is the variable ``--name`` of the style sheet."""


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
class Table:
    """Rows of text; the first cell of a row is its head, columns of numbers are set flush right.

    Attributes:
        groups: a line above the heads: (title, number of columns) from left to right; empty: no such line.
        collapsed: whether a reader has to open it.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    groups: tuple[tuple[str, int], ...] = ()
    collapsed: bool = False


Block = Paragraph | Code | Figure | Table


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of the page; `id` is its anchor."""

    id: str
    title: str
    blocks: tuple[Block, ...]


def assemble(title: str, lead: Sequence[Block], sections: Sequence[Section]) -> str:
    """The page's HTML: a head with `lead`, links to the sections, the sections in order. Equal input, equal text."""
    numbers = iter(range(1, 10_000))
    entries = "".join(f'<li><a href="#{_text(s.id)}">{_text(s.title)}</a></li>\n' for s in sections)
    body = "".join(
        f'<section id="{_text(s.id)}" aria-labelledby="{_text(s.id)}-title">\n'
        f'<h2 id="{_text(s.id)}-title">{_text(s.title)}</h2>\n'
        f"{_blocks(s.blocks, numbers)}</section>\n"
        for s in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{_text(title)}</title>\n<style>\n{_style_sheet()}</style>\n</head>\n<body>\n"
        f"<header>\n<h1>{_text(title)}</h1>\n{_blocks(lead, numbers)}</header>\n"
        f'<nav aria-label="Sections">\n<ul>\n{entries}</ul>\n</nav>\n'
        f"<main>\n{body}</main>\n</body>\n</html>\n"
    )


def inline_svg(document: str, prefix: str, alt: str) -> str:
    """An SVG document as an element of an HTML page.

    Drops what only a file of its own needs, keeps the ids that it refers to, each with `prefix` in front (ids of a
    page must be unique), leaves the font to the page, and names colours of `PALETTE` instead of giving them.
    """
    root = ElementTree.fromstring(document)
    kept = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', document))
    root.attrib = {"viewBox": root.get("viewBox", ""), "role": "img", "aria-label": alt}
    return _svg(root, kept, prefix)


def _svg(element: ElementTree.Element, kept: set[str], prefix: str) -> str:
    """An element of an SVG document and what it holds, as `inline_svg` wants it."""
    tag = _local(element.tag)
    if tag in ("metadata", "style", "title"):
        return ""
    content = "".join(_svg(child, kept, prefix) + _written(child.tail) for child in element)
    content = _written(element.text) + content
    attributes = ""
    for qualified, value in element.attrib.items():
        name = _local(qualified)
        if name == "id":
            if value not in kept:
                continue
            value = prefix + value
        elif name == "href" and value.startswith("#"):
            value = f"#{prefix}{value[1:]}"
        elif name in _NUMERIC:
            value = _LONG_NUMBER.sub(_shortened, " ".join(value.split()))
        elif name == "style":
            value = _COLOUR.sub(lambda m: _VARIABLES.get(m[0].lower(), m[0]), _FONT_FAMILY.sub("", value))
        attributes += f' {name}="{html.escape(value.replace("url(#", f"url(#{prefix}"))}"'
    if tag == "g" and not attributes:
        return content  # groups nothing but its own drawing
    return f"<{tag}{attributes}>{content}</{tag}>" if content else f"<{tag}{attributes}/>\n"


def _written(text: str | None) -> str:
    """Text between elements, without what only lays out the file."""
    return html.escape(text) if text and text.strip() else ""


def _shortened(number: re.Match[str]) -> str:
    """A number of a drawing to a hundredth of a point."""
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


def _local(name: str) -> str:
    """A tag or attribute without its name space."""
    return name.rpartition("}")[2]


_NUMERIC = ("d", "transform", "x", "y", "width", "height", "points")
_LONG_NUMBER = re.compile(r"-?\d+(?:\.\d+)?e-?\d+|-?\d+\.\d{3,}")
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}\b")
_FONT_FAMILY = re.compile(r"font-family:[^;]*;?\s*")
_VARIABLES = {light: f"var(--{name})" for name, (light, _) in PALETTE.items()}


def _blocks(blocks: Iterable[Block], numbers: Iterator[int]) -> str:
    """Blocks in order; `numbers` gives every picture a number of its own. Will be advanced."""
    parts = []
    for block in blocks:
        match block:
            case Paragraph():
                parts.append(f"<p>{_marked(block.text)}</p>\n")
            case Code():
                parts.append(f'<pre tabindex="0"><code>{_text(block.text)}</code></pre>\n')
            case Figure():
                parts.append(_figure(block, numbers))
            case Table():
                parts.append(_table(block))
    return "".join(parts)


def _figure(figure: Figure, numbers: Iterator[int]) -> str:
    panels = "".join(
        f'<div class="panel">{inline_svg(panel.svg, f"f{number}-", panel.alt)}</div>\n'
        for panel, number in zip(figure.panels, numbers, strict=False)
    )
    keys = "".join(f"<li>{_swatch(key)}{_text(key.label)}</li>\n" for key in figure.legend)
    legend = f'<ul class="legend">\n{keys}</ul>\n' if keys else ""
    return (
        f'<figure>\n{legend}<div class="panels columns-{figure.columns}">\n{panels}</div>\n'
        f"<figcaption>{_marked(figure.caption)}</figcaption>\n</figure>\n"
    )


def _swatch(key: Key) -> str:
    """What a legend's entry looks like in the figure; its label says the rest."""
    colour = f"var(--{key.colour})"
    dashes = {"dashed": "5 3", "dotted": "1.5 3"}.get(key.mark, "none")
    line = f'<path d="M1 6H25" style="fill: none; stroke: {colour}; stroke-width: 2; stroke-dasharray: {dashes}"/>'
    drawing = {
        "box": f'<rect x="3" y="0" width="20" height="12" style="fill: {colour}"/>',
        "area": f'<rect x="3" y="1" width="20" height="10" style="fill: {colour}; opacity: .45"/>',
        "dot": f'<circle cx="13" cy="6" r="4" style="fill: {colour}"/>',
        "cross": f'<path d="M8 1L18 11M18 1L8 11" style="stroke: {colour}; stroke-width: 3"/>',
        "arrow": line + f'<path d="M26 6L18 2V10Z" style="fill: {colour}"/>',
    }.get(key.mark, line)
    return f'<svg viewBox="0 0 26 12" aria-hidden="true">{drawing}</svg>'


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
        + "".join(f"<td{c}>{_marked(cell)}</td>" for cell, c in zip(row[1:], classes[1:], strict=True))
        + "</tr>\n"
        for row in table.rows
    )
    head = (f"<tr>{groups}</tr>\n" if groups else "") + f"<tr>{heads}</tr>\n"
    # Where the table is opened by its caption, the caption is said once more for readers that skip to tables.
    hidden = ' class="hidden"' if table.collapsed else ""
    dense = ' class="dense"' if len(table.columns) > _MANY else ""
    drawn = (
        f'<div class="scroll" tabindex="0">\n<table{dense}>\n<caption{hidden}>{_marked(table.caption)}</caption>\n'
        f"<thead>\n{head}</thead>\n<tbody>\n{rows}</tbody>\n</table>\n</div>\n"
    )
    if not table.collapsed:
        return drawn
    return f"<details>\n<summary>{_marked(table.caption)}</summary>\n{drawn}</details>\n"


_MANY = 12
"""Columns of a table above which they are set closer."""

_SHORT = 28
"""Characters of a row's head that is kept on one line."""

_NUMBER = re.compile(r"[-+\u2212]?\d[\d.]*(?:·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?(?:\s%)?(?:\s\([^a-z]*(?:to[^a-z]*)?\))?")


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None


def _text(text: str) -> str:
    return html.escape(text)


def _marked(text: str) -> str:
    """Escaped text with what is marked in it, see `Paragraph`."""
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", _text(text))
    return re.sub(r"\^\{([^{}]*)\}", r"<sup>\1</sup>", re.sub(r"_\{([^{}]*)\}", r"<sub>\1</sub>", text))


def _style_sheet() -> str:
    light = " ".join(f"--{name}: {colours[0]};" for name, colours in PALETTE.items())
    dark = " ".join(f"--{name}: {colours[1]};" for name, colours in PALETTE.items())
    return f":root {{ {light} }}\n@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n{_RULES}"


_RULES = """\
html { color-scheme: light dark; background: var(--surface); color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", "Noto Sans", "Liberation Sans", Arial, sans-serif; }
body { max-width: 72rem; margin: 0 auto; padding: 0 1.25rem 4rem; overflow-wrap: break-word; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 2rem 0 .5rem; }
h2 { font-size: 1.3rem; line-height: 1.3; margin: 3rem 0 .75rem; padding-top: .5rem;
  border-top: 1px solid var(--rule); }
sub, sup { line-height: 0; }
p, figcaption, summary { max-width: 48rem; }
caption { max-width: min(48rem, 100vw - 2.5rem); }
header > p:first-of-type { color: var(--muted); }
header > p:nth-of-type(2) { font-size: 1.15rem; }
a { color: var(--link); }
code, pre { font-family: ui-monospace, "SF Mono", Menlo, Consolas, "Liberation Mono", monospace; font-size: .875em; }
pre { background: var(--shade); padding: .75rem 1rem; border-radius: 6px; overflow-x: auto; }
nav ul { display: flex; flex-wrap: wrap; gap: .25rem 1.25rem; margin: 1.5rem 0 0; padding: 0; list-style: none; }
section { scroll-margin-top: 1rem; }
figure { margin: 1.25rem 0 2rem; }
figcaption, caption, summary { font-size: .925rem; color: var(--muted); text-align: left; }
figcaption { margin-top: .5rem; }
.panels { display: grid; gap: 1rem; }
.columns-2 { grid-template-columns: repeat(2, minmax(0, 1fr)); }
.columns-3 { grid-template-columns: repeat(3, minmax(0, 1fr)); }
.columns-6 { grid-template-columns: repeat(6, minmax(0, 1fr)); gap: .25rem; }
.panel { min-width: 0; }
.panel svg { display: block; width: 100%; height: auto; font-family: inherit; }
.panel svg * { stroke-linejoin: round; }
.legend { display: flex; flex-wrap: wrap; gap: .1rem 1.25rem; margin: 0 0 .5rem; padding: 0; list-style: none;
  font-size: .9rem; }
.legend svg { width: 26px; height: 12px; margin-right: .45rem; vertical-align: -1px; }
.scroll { overflow-x: auto; margin: 1rem 0 1.75rem; }
table { border-collapse: collapse; font-size: .9rem; }
.dense { font-size: .8rem; }
.dense th, .dense td { padding: .2rem .4rem; }
caption { padding-bottom: .4rem; }
th, td { padding: .25rem .7rem; text-align: left; vertical-align: top; border-bottom: 1px solid var(--rule); }
th:first-child, td:first-child { padding-left: 0; }
thead th { border-bottom: 1.5px solid var(--faint); vertical-align: bottom; font-weight: 600; }
th[scope=colgroup] { border-bottom: 1px solid var(--rule); text-align: center; }
tbody th { font-weight: 500; }
.n { text-align: right; font-variant-numeric: tabular-nums; }
td.n, .k { white-space: nowrap; }
summary { cursor: pointer; margin: .5rem 0; }
.hidden { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); white-space: nowrap; }
@media screen and (max-width: 48rem) {
  .columns-2, .columns-3 { grid-template-columns: minmax(0, 1fr); }
  .columns-6 { grid-template-columns: repeat(3, minmax(0, 1fr)); }
}
@media print {
  @page { margin: 14mm; }
  html { font-size: 10pt; color-scheme: light; background: none; }
  body { max-width: none; padding: 0; }
  nav { display: none; }
  h2 { break-after: avoid; margin-top: 1.5rem; }
  .panel, .legend, tr { break-inside: avoid; }
  .legend { break-after: avoid; }
  figcaption { break-before: avoid; }
  .scroll { overflow: visible; }
  table { font-size: 8pt; }
  th, td { padding: .15rem .4rem; }
  details::details-content { content-visibility: visible; block-size: auto; }
}
"""
