"""SVG documents put into others: into an HTML page, whose colours and font they take, or into a picture of its own.

Documents in, elements out, as text. What draws them is matplotlib, in the light colours of `PALETTE`.
"""

from __future__ import annotations

import html
import re
from xml.etree import ElementTree

from pipeline.report_style import PALETTE

SWATCH = (26, 12)
"""Width and height of a legend's mark, in the units of its drawing."""


def inline_svg(document: str, prefix: str, alt: str) -> str:
    """An SVG document as an element of an HTML page.

    Drops what only a file of its own needs, keeps the ids that it refers to, each with `prefix` in front (ids of a
    page must be unique), leaves the font to the page, and names colours of `PALETTE` instead of giving them.
    """
    root = ElementTree.fromstring(document)
    root.attrib = {"viewBox": root.get("viewBox", ""), "role": "img", "aria-label": alt}
    return _element(root, _referred(document), prefix, on_page=True)


def nested_svg(document: str, prefix: str, alt: str, x: float, y: float) -> str:
    """An SVG document as an element of another one, its upper left corner at (`x`, `y`), in its own size and colours.

    Ids are treated as in `inline_svg`; the font is left to the outer document.
    """
    root = ElementTree.fromstring(document)
    width, height = svg_size(document)
    place = {name: f"{value:g}" for name, value in (("x", x), ("y", y), ("width", width), ("height", height))}
    root.attrib = {**place, "viewBox": root.get("viewBox", ""), "role": "img", "aria-label": alt}
    return _element(root, _referred(document), prefix, on_page=False)


def svg_size(document: str) -> tuple[float, float]:
    """Width and height of an SVG document, in its own units."""
    width, height = ElementTree.fromstring(document).get("viewBox", "0 0 0 0").split()[2:]
    return float(width), float(height)


def swatch(mark: str, colour: str) -> str:
    """What a legend's entry looks like in the figure, as elements of `SWATCH` size; `mark`: of a legend's key."""
    dashes = {"dashed": "5 3", "dotted": "1.5 3"}.get(mark, "none")
    line = f'<path d="M1 6H25" style="fill: none; stroke: {colour}; stroke-width: 2; stroke-dasharray: {dashes}"/>'
    return {
        "box": f'<rect x="3" y="0" width="20" height="12" style="fill: {colour}"/>',
        "area": f'<rect x="3" y="1" width="20" height="10" style="fill: {colour}; opacity: .45"/>',
        "dot": f'<circle cx="13" cy="6" r="4" style="fill: {colour}"/>',
        "cross": f'<path d="M8 1L18 11M18 1L8 11" style="stroke: {colour}; stroke-width: 3"/>',
        "arrow": line + f'<path d="M26 6L18 2V10Z" style="fill: {colour}"/>',
    }.get(mark, line)


def _referred(document: str) -> set[str]:
    """Ids that a document refers to."""
    return set(re.findall(r'(?:url\(#|href="#)([^)"]+)', document))


def _element(element: ElementTree.Element, kept: set[str], prefix: str, *, on_page: bool) -> str:
    """An element of an SVG document and what it holds; `on_page`: with the page's colours, else with its own."""
    tag = _local(element.tag)
    if tag in ("metadata", "style", "title"):
        return ""
    content = "".join(_element(child, kept, prefix, on_page=on_page) + _written(child.tail) for child in element)
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
            # An HTML page knows no name spaces; programs that read SVG files do not all know the newer name.
            name = name if on_page else "xlink:href"
        elif name in _NUMERIC:
            value = _LONG_NUMBER.sub(_shortened, " ".join(value.split()))
        elif name == "style":
            value = _FONT_FAMILY.sub("", value)
            if on_page:
                value = _COLOUR.sub(lambda m: _VARIABLES.get(m[0].lower(), m[0]), value)
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
