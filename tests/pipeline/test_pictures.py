"""Figures as files: one document with legend and panels in their places, the same bytes, nothing left behind."""

from __future__ import annotations

import io
from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from pipeline.errors import StoreError
from pipeline.pictures import APART, GAP, LINE, MARGIN, ZOOM, compose, plain_text, rasterise, write_pictures
from pipeline.report import PALETTE, Animation, Figure, Key, Panel, Paragraph, Section

SPACE = "{http://www.w3.org/2000/svg}"


def panel(width: int = 100, height: int = 50, fill: str = "#c94f00", alt: str = "Words.") -> Panel:
    return Panel(
        svg=f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}pt" height="{height}pt" '
        f'viewBox="0 0 {width} {height}"><defs><path id="m" d="M0 0H1"/></defs>'
        f'<rect width="{width}" height="{height}" style="fill: {fill}"/><use href="#m"/></svg>',
        alt=alt,
    )


def figure(count: int = 3, columns: int = 2, legend: tuple[Key, ...] = ()) -> Figure:
    return Figure(
        panels=tuple(panel(alt=f"Panel {index}.") for index in range(count)),
        caption="F_{d} of `x` & y^{2}.",
        columns=columns,
        legend=legend,
    )


def places(document: str) -> list[tuple[float, float]]:
    root = ElementTree.fromstring(document)
    return [(float(e.get("x", "nan")), float(e.get("y", "nan"))) for e in root.iter(f"{SPACE}svg") if e.get("x")]


def section(*blocks: Figure | Animation | Paragraph, name: str = "one") -> Section:
    return Section(id=name, title="One", blocks=blocks)


def test_panels_stand_in_their_columns() -> None:
    document = compose(figure())
    root = ElementTree.fromstring(document)
    right, below = MARGIN + 100 + GAP, MARGIN + 50 + GAP
    assert places(document) == [(MARGIN, MARGIN), (right, MARGIN), (MARGIN, below)]
    assert root.get("viewBox") == f"0 0 {2 * 100 + GAP + 2 * MARGIN:g} {2 * 50 + GAP + 2 * MARGIN:g}"
    assert root.get("width", "").endswith("pt")
    ids = [element.get("id") for element in root.iter() if "id" in element.attrib]
    assert ids == ["p1-m", "p2-m", "p3-m"]
    assert [e.get("aria-label") for e in root.iter(f"{SPACE}svg")][1:] == ["Panel 0.", "Panel 1.", "Panel 2."]
    assert root.findtext(f"{SPACE}desc") == "Fd of x & y2."


def test_fewer_panels_than_columns_leave_no_empty_space() -> None:
    root = ElementTree.fromstring(compose(figure(count=1, columns=3)))
    assert root.get("viewBox") == f"0 0 {100 + 2 * MARGIN:g} {50 + 2 * MARGIN:g}"


def test_legend_stands_above_and_breaks_where_it_is_too_wide() -> None:
    keys = tuple(Key(label=f"a label <{index}>", colour="series-2") for index in range(3))
    document = compose(figure(legend=keys))
    texts = [e.text for e in ElementTree.fromstring(document).iter(f"{SPACE}text")]
    assert texts == [key.label for key in keys]
    lines = document.count(f'transform="translate({MARGIN:.2f} ')
    assert lines == 2  # 26 + 6 + about 56 points each, of 210.8: two on the first
    assert places(document)[0][1] == pytest.approx(MARGIN + lines * LINE + 4.0)
    short = compose(figure(legend=(Key(label="a", colour="ink"), Key(label="b", colour="ink"))))
    assert short.count(f" {MARGIN:.2f})") == 2  # side by side
    assert APART > 0.0


def test_page_is_light_whatever_the_reader_prefers() -> None:
    document = compose(figure(legend=(Key(label="a", colour="series-2"),)))
    assert f'fill="{PALETTE["surface"][0]}"' in document
    assert PALETTE["series-2"][0] in document
    assert "var(" not in document
    image = Image.open(io.BytesIO(rasterise(document))).convert("RGB")
    assert image.getpixel((2, 2)) == (0xFD, 0xFD, 0xFE)


def test_png_has_two_pixels_for_one_and_shows_panel_and_text() -> None:
    document = compose(figure(count=1, columns=1, legend=(Key(label="label", colour="series-2"),)))
    image = Image.open(io.BytesIO(rasterise(document))).convert("RGB")
    scale = ZOOM * 96 / 72
    assert image.width == pytest.approx((100 + 2 * MARGIN) * scale, abs=1)
    panel_at = (int((MARGIN + 50) * scale), int((MARGIN + LINE + 4 + 25) * scale))
    assert image.getpixel(panel_at) == (0xC9, 0x4F, 0x00)
    text = image.crop(tuple(int(v * scale) for v in (MARGIN + 30, MARGIN - 2, MARGIN + 60, MARGIN + LINE)))
    assert text.convert("L").getextrema()[0] < 80  # the font is there


def test_files_are_named_by_section_and_number_and_stale_ones_go(tmp_path: Path) -> None:
    folder = tmp_path / "figures"
    first = write_pictures(
        [section(Paragraph(text="x"), figure(), figure(count=1)), section(figure(), name="b")], folder
    )
    names = ["one-1.svg", "one-1.png", "one-2.svg", "one-2.png", "b-1.svg", "b-1.png"]
    assert [path.name for path in first] == names
    (folder / "notes.txt").write_text("mine", encoding="utf-8")
    (folder / "my-photo.png").write_bytes(b"mine")
    (folder / "holiday-1.png").write_bytes(b"mine")  # called as ours are, and not ours
    second = write_pictures([section(figure())], folder)
    assert sorted(path.name for path in folder.iterdir()) == [
        ".pictures",
        "holiday-1.png",
        "my-photo.png",
        "notes.txt",
        "one-1.png",
        "one-1.svg",
    ]
    assert [path.name for path in second] == names[:2]


def test_equal_figures_give_equal_bytes(tmp_path: Path) -> None:
    keys = (Key(label="a", colour="ink", mark="dashed"),)
    for name in ("a", "b"):
        write_pictures([section(figure(legend=keys))], tmp_path / name)
    for file in ("one-1.svg", "one-1.png"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_moving_picture_is_written_as_it_is(tmp_path: Path) -> None:
    moving = Animation(gif=b"GIF89a....", still=b"png", alt="a", caption="c")
    (written,) = write_pictures([section(moving)], tmp_path)
    assert (written.name, written.read_bytes()) == ("one-1.gif", b"GIF89a....")


def test_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(StoreError, match="cannot be written"):
        write_pictures([section(figure())], tmp_path / "file" / "figures")


def test_report_without_figures_makes_no_folder(tmp_path: Path) -> None:
    assert write_pictures([section(Paragraph(text="x"))], tmp_path / "figures") == []
    assert not (tmp_path / "figures").exists()


def test_plain_text_has_no_marks() -> None:
    assert plain_text("`a` b_{c}^{d} e_f") == "a bcd e_f"
