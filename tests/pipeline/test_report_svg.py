"""SVG documents put into a page or into another picture: ids apart, colours and fonts of where they stand."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from pipeline.report_svg import SWATCH, inline_svg, nested_svg, svg_size, swatch

SVG = """<?xml version="1.0" encoding="utf-8" standalone="no"?>
<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">
<svg xmlns:xlink="http://www.w3.org/1999/xlink" width="216pt" height="144.5pt" viewBox="0 0 216 144.5"
  xmlns="http://www.w3.org/2000/svg" version="1.1">
 <defs><path id="m1" d="M 0 0 L 0.123456 3.5" style="stroke: #c94f00"/></defs>
 <use xlink:href="#m1" x="68.427273" y="128" style="fill: #C94F00; stroke: #123456"/>
 <text style="font-size: 10px; font-family: 'DejaVu Sans'; fill: #1b1f24" x="1" y="2">a &lt; b</text>
</svg>"""


def test_size_is_that_of_the_view() -> None:
    assert svg_size(SVG) == (216.0, 144.5)


def test_nested_picture_keeps_its_size_and_its_light_colours() -> None:
    text = nested_svg(SVG, "p3-", 'Words & "more"', 12.0, 30.5)
    assert text.startswith(
        '<svg x="12" y="30.5" width="216" height="144.5" viewBox="0 0 216 144.5" role="img" '
        'aria-label="Words &amp; &quot;more&quot;">'
    )
    assert '<path id="p3-m1" d="M 0 0 L 0.12 3.5" style="stroke: #c94f00"/>' in text
    assert '<use xlink:href="#p3-m1" x="68.43" y="128" style="fill: #C94F00; stroke: #123456"/>' in text
    assert "var(" not in text
    assert "font-family" not in text


def test_the_same_document_on_a_page_takes_the_colours_of_the_page() -> None:
    text = inline_svg(SVG, "f1-", "Words")
    assert 'style="stroke: var(--series-1)"' in text
    assert '<use href="#f1-m1"' in text
    assert "xlink" not in text


@pytest.mark.parametrize("mark", ["line", "dashed", "dotted", "area", "box", "dot", "arrow", "cross"])
def test_every_mark_is_drawn_in_its_colour_and_no_two_are_alike(mark: str) -> None:
    drawn = swatch(mark, "#c94f00")
    assert "#c94f00" in drawn
    ElementTree.fromstring(f"<g>{drawn}</g>")
    others = {"line", "dashed", "dotted", "area", "box", "dot", "arrow", "cross"} - {mark}
    assert drawn not in {swatch(other, "#c94f00") for other in others}
    assert SWATCH == (26, 12)
