"""What stands in an SVG document that matplotlib wrote, for tests of figures."""

from __future__ import annotations

from xml.etree import ElementTree

from stages.figures.style import colour

SVG = "{http://www.w3.org/2000/svg}"


def drawn(document: str, tag: str = "path") -> list[str]:
    """Styles of the elements of a picture that are drawn where they stand (not the shapes of markers)."""
    root = ElementTree.fromstring(document)
    shapes = {id(shape) for defs in root.iter(f"{SVG}defs") for shape in defs.iter(f"{SVG}{tag}")}
    return [e.get("style", "") for e in root.iter(f"{SVG}{tag}") if id(e) not in shapes]


def strokes(document: str, name: str) -> int:
    return sum(f"stroke: {colour(name)}" in style and "fill: none" in style for style in drawn(document))


def texts(document: str) -> list[str]:
    return ["".join(e.itertext()) for e in ElementTree.fromstring(document).iter(f"{SVG}text")]
