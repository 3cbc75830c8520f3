"""The page that pipeline/report.py assembles: valid, self-contained, escaped, for light and dark, the same bytes."""

from __future__ import annotations

import re
from base64 import b64decode
from html.parser import HTMLParser

import pytest
from pages import check_page

from pipeline.report import (
    MISSING,
    PALETTE,
    Animation,
    Block,
    Code,
    Figure,
    Key,
    Link,
    Panel,
    Paragraph,
    Section,
    Table,
    assemble,
    gif_size,
)
from pipeline.report_svg import inline_svg

VOID = {"meta", "link", "br", "img", "hr", "input", "source"}

SVG = """<?xml version="1.0" encoding="utf-8" standalone="no"?>
<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">
<svg xmlns:xlink="http://www.w3.org/1999/xlink" width="216pt" height="144pt" viewBox="0 0 216 144"
  xmlns="http://www.w3.org/2000/svg" version="1.1">
 <metadata><creator>Drawn with https://example.org/</creator></metadata>
 <defs><style type="text/css">*{stroke-linejoin: round}</style></defs>
 <g id="figure_1"><g id="axes_1">
  <defs><path id="m1" d="M 0 0
L 0.123456 3.5" style="stroke: #c94f00"/></defs>
  <use xlink:href="#m1" x="68.427273" y="128" style="fill: #C94F00; stroke: #123456"/>
  <path d="M 1 2 L 3.999999 1e-7" clip-path="url(#c1)" style="fill: url(#h1); stroke: #1b1f24"/>
  <text style="font-size: 10px; font-family: 'DejaVu Sans'; text-anchor: middle" x="1"
   y="2">a &lt; b <tspan>c</tspan> d</text>
 </g></g>
 <defs><clipPath id="c1"><rect x="0" y="0" width="1.23456" height="1"/></clipPath><pattern id="h1"/></defs>
</svg>"""


class Checker(HTMLParser):
    """Collects what a page is made of; fails on tags that do not balance."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for found, attributes in self.tags if found == tag]


def page(*blocks: Block) -> str:
    return assemble("Title", [Paragraph(text="lead")], [Section(id="one", title="One", blocks=blocks)])


def table(*rows: tuple[str, ...], columns: tuple[str, ...] = ("name", "value"), collapsed: bool = False) -> Table:
    return Table(caption="Caption", columns=columns, rows=rows, collapsed=collapsed)


FIGURE = Figure(
    panels=(Panel(svg=SVG, alt="First."), Panel(svg=SVG, alt='Second, "quoted".')),
    caption="Caption",
    columns=2,
    legend=(Key(label="line", colour="series-1"), Key(label="pushed", colour="ink", mark="arrow")),
)


GIF = b"GIF89a" + (320).to_bytes(2, "little") + (200).to_bytes(2, "little") + bytes(7)
MOVING = Animation(gif=GIF, still=b"\x89PNG still", alt='A box, "carried".', caption="Fig. 5a, F_{d}")


def test_page_of_all_blocks_is_valid() -> None:
    grouped = Table(
        caption="C", columns=("n", "v", "w"), rows=(("a", "1", "2"),), groups=(("", 1), ("both", 2)), collapsed=True
    )
    link = Link(text="There & back", target="there/report.html")
    check_page(page(Paragraph(text="a"), Code(text="b"), link, FIGURE, MOVING, table(("c", "1")), grouped))


def test_moving_picture_stands_still_where_motion_is_unwanted_and_on_paper() -> None:
    text = page(MOVING)
    found = Checker(text)
    (source,), (image,) = found.of("source"), found.of("img")
    assert source["media"] == "(prefers-reduced-motion: reduce), print"
    assert b64decode((source["srcset"] or "").removeprefix("data:image/png;base64,")) == MOVING.still
    assert b64decode((image["src"] or "").removeprefix("data:image/gif;base64,")) == GIF
    assert (image["alt"], image["width"], image["height"]) == ('A box, "carried".', "320", "200")
    assert "<figcaption>Fig. 5a, F<sub>d</sub></figcaption>" in text
    assert "figure img { display: block; max-width: 100%; height: auto; }" in text


def test_moving_picture_has_to_be_a_gif() -> None:
    assert gif_size(GIF) == (320, 200)
    with pytest.raises(ValueError, match="GIF"):
        page(Animation(gif=b"\x89PNG", still=b"", alt="a", caption="c"))


def test_link_leads_to_a_page_beside() -> None:
    text = page(Link(text="a <b>", target='x/"y".html'))
    assert '<p><a href="x/&quot;y&quot;.html">a &lt;b&gt;</a></p>' in text


def test_interval_is_set_back_and_may_stand_on_a_line_of_its_own() -> None:
    rows = (("a", "5.02 (4.9\u00a0to\u00a05.1)", "6\u00a0of\u00a07 (49\u00a0to\u00a097\u00a0%)", "x (or so)"),)
    text = page(Table(caption="C", columns=("n", "v", "w", "u"), rows=rows))
    assert '<td class="n">5.02 <span class="i">(4.9\u00a0to\u00a05.1)</span></td>' in text
    assert '<td>6\u00a0of\u00a07 <span class="i">(49\u00a0to\u00a097\u00a0%)</span></td>' in text
    assert "<td>x (or so)</td>" in text


def test_many_intervals_stand_below_what_they_are_of() -> None:
    cells = ("5.02 (4.9\u00a0to\u00a05.1)",)
    narrow = Table(caption="C", columns=tuple("abc"), rows=(("n", *cells * 2),))
    wide = Table(caption="C", columns=tuple("abcdefghi"), rows=(("n", *cells * 8),))
    assert "<table>" in page(narrow)
    assert '<table class="wide">' in page(wide)
    assert '<table class="dense wide">' in page(Table(caption="C", columns=("n",) * 14, rows=(("n", *cells * 13),)))
    assert ".wide .i { display: block; }" in page(wide)


def test_numbers_and_what_belongs_to_them_stay_on_one_line() -> None:
    text = page(Paragraph(text="95 % of it"), table(("a", "5 to 6.92")))
    assert "95\u00a0% of it" in text
    assert ">5\u00a0to\u00a06.92<" in text


def test_text_is_composed() -> None:
    text = page(Paragraph(text="x\u0307 and p\u0302"))
    assert "\u1e8b and p\u0302" in text


def test_page_is_balanced_with_unique_ids_and_working_anchors() -> None:
    text = page(
        Paragraph(text="a"), Code(text="b"), FIGURE, FIGURE, table(("c", "1")), table(("d", "2"), collapsed=True)
    )
    found = Checker(text)
    ids = [attributes["id"] for _, attributes in found.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    targets = re.findall(r'(?:href="#|url\(#)([^")]+)', text)
    assert targets
    assert set(targets) <= set(ids)
    for tag in ("header", "nav", "main", "section", "figure", "figcaption", "table", "caption", "details", "summary"):
        assert found.of(tag), tag
    assert [attributes.get("lang") for attributes in found.of("html")] == ["en"]


def test_page_needs_no_network() -> None:
    text = page(FIGURE)
    assert "http" not in text
    assert "@import" not in text
    assert not {"script", "link", "img", "iframe", "object"} & {tag for tag, _ in Checker(text).tags}


def test_all_text_is_escaped() -> None:
    nasty = '<script>alert("1")</script> & more'
    blocks: tuple[Block, ...] = (
        Paragraph(text=nasty),
        Code(text=nasty),
        Figure(panels=(Panel(svg=SVG, alt=nasty),), caption=nasty, legend=(Key(label=nasty, colour="ink"),)),
        Table(caption=nasty, columns=(nasty, nasty), rows=((nasty, nasty),), groups=((nasty, 2),), collapsed=True),
    )
    text = assemble(nasty, [Paragraph(text=nasty)], [Section(id="one", title=nasty, blocks=blocks)])
    assert "<script" not in text
    assert nasty in "".join(Checker(text).text)


def test_marked_text() -> None:
    text = page(Paragraph(text="`clpv run x` A_{k}^{T} JShape_2 a^b"))
    assert "<code>clpv run x</code> A<sub>k</sub><sup>T</sup> JShape_2 a^b" in text


def test_every_picture_has_words() -> None:
    found = Checker(page(FIGURE))
    pictures = [attributes for attributes in found.of("svg") if attributes.get("aria-hidden") != "true"]
    assert [attributes["aria-label"] for attributes in pictures] == ["First.", 'Second, "quoted".']
    assert all(attributes["role"] == "img" for attributes in pictures)


def test_inline_svg_keeps_only_what_the_page_needs() -> None:
    text = inline_svg(SVG, "f1-", "Words")
    assert "http" not in text
    assert "<style" not in text
    assert "metadata" not in text
    assert "font-family" not in text
    assert 'font-size: 10px; text-anchor: middle" x="1" y="2">a &lt; b <tspan>c</tspan> d</text>' in text
    assert 'id="figure_1"' not in text
    assert '<path id="f1-m1" d="M 0 0 L 0.12 3.5" style="stroke: var(--series-1)"/>' in text
    assert 'href="#f1-m1" x="68.43"' in text
    assert 'fill: var(--series-1); stroke: #123456"' in text
    assert 'd="M 1 2 L 4 0" clip-path="url(#f1-c1)" style="fill: url(#f1-h1); stroke: var(--ink)"' in text
    assert 'id="f1-c1"' in text
    assert 'id="f1-h1"' in text
    assert text.startswith('<svg viewBox="0 0 216 144" role="img" aria-label="Words">')


def test_same_picture_twice_has_two_sets_of_ids() -> None:
    text = page(FIGURE)
    assert 'id="f1-m1"' in text
    assert 'id="f2-m1"' in text


def test_every_colour_is_defined_for_light_and_dark() -> None:
    text = page(FIGURE)
    style = text[text.index("<style>") : text.index("</style>")]
    used = set(re.findall(r"var\(--([\w-]+)\)", text))
    assert used <= set(PALETTE)
    dark = style[style.index("prefers-color-scheme: dark") :]
    for name in used:
        assert f"--{name}: {PALETTE[name][0]};" in style
        assert f"--{name}: {PALETTE[name][1]};" in dark
    assert "@media print" in style


def luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("mode", [0, 1])
@pytest.mark.parametrize(
    ("name", "least"), [("ink", 7.0), ("muted", 4.5), ("link", 4.5), *((f"series-{i}", 3.0) for i in range(1, 6))]
)
def test_contrast_on_the_page(name: str, least: float, mode: int) -> None:
    a, b = sorted((luminance(PALETTE[name][mode]), luminance(PALETTE["surface"][mode])))
    assert (b + 0.05) / (a + 0.05) >= least


def test_table_has_heads_with_scope_and_numbers_flush_right() -> None:
    rows = (("a", "1.5", "x"), ("b", "\u22122·10⁻⁹", "2"), ("c", MISSING, "3"))
    drawn = Table(caption="C", columns=("n", "v", "w"), rows=rows, groups=(("", 1), ("both", 2)))
    found = Checker(page(drawn))
    scopes = [attributes["scope"] for attributes in found.of("th")]
    assert scopes == ["colgroup"] * 2 + ["col"] * 3 + ["row"] * 3
    assert [attributes.get("colspan") for attributes in found.of("th")[:2]] == ["1", "2"]
    cells = [attributes.get("class") for attributes in found.of("td")]
    assert cells == ["n", None] * 3
    assert "<caption>C</caption>" in page(drawn)


@pytest.mark.parametrize("cell", ["1", "-1.5", "+63\u00a0%", "+63\u00a0% (+31\u00a0% to +115\u00a0%)", "0.082"])
def test_what_counts_as_a_number(cell: str) -> None:
    assert Checker(page(table(("a", cell)))).of("td") == [{"class": "n"}]


@pytest.mark.parametrize("cell", ["", MISSING, "4 of 4", "1 mm", "[1, 2]", "1, 2", "Cond. 1"])
def test_what_does_not(cell: str) -> None:
    assert Checker(page(table(("a", cell)))).of("td") == [{}]


def test_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="zip"):
        page(table(("a", "1", "2")))


def test_equal_sections_give_equal_bytes() -> None:
    assert page(FIGURE, table(("a", "1"))) == page(FIGURE, table(("a", "1")))
