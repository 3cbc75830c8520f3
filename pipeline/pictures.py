"""Figures of a report as files of their own: one SVG document a figure, and the PNG file that is drawn from it.

A figure's panels stand in their columns below its legend, in the light colours of `PALETTE`, on a light page. Equal
figures give equal bytes on any machine: text is measured and drawn in the font that matplotlib carries.
"""

from __future__ import annotations

import html
import re
import unicodedata
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.errors import StoreError
from pipeline.report import PALETTE, Animation, Figure, Key, Section
from pipeline.report_svg import SWATCH, nested_svg, svg_size, swatch
from pipeline.store import write_atomically

DPI = 96
"""Pixels an inch of an SVG document, by the standard."""
ZOOM = 2
"""Pixels of a PNG file for each of its SVG document's."""

FONT = "DejaVu Sans"
SIZE = 10.0
"""Of the legend's text; this and what follows in points, as in the panels."""
LINE = 17.0
MARGIN = 12.0
GAP = 10.8
"""Between panels, as `stages.figures.style` leaves it between them."""
APART = 20.0
"""Between entries of a legend."""

PICTURE = re.compile(r"[a-z][a-z-]*-\d+\.(?:svg|png|gif)")

LIST = ".pictures"
"""File among the pictures that names those of the last call: the next one removes no others."""


def write_pictures(sections: Sequence[Section], folder: Path) -> list[Path]:
    """Write every figure of a report to `folder`, and remove those of an earlier call that are no more.

    The n-th picture of a section becomes ``<section>-<n>.svg`` and ``.png``, a moving one ``.gif``; in that order they
    are returned. Each file appears whole or not at all. Raises StoreError where one cannot be written.
    """
    before = _listed(folder)
    written = []
    for name, content in _files(sections):
        write_atomically(folder / name, content)
        written.append(folder / name)
    for name in sorted(before - {path.name for path in written}):
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise StoreError(f"{name} among the figures cannot be removed: {error.strerror}.") from None
    if written or before:
        write_atomically(folder / LIST, "".join(f"{path.name}\n" for path in written))
    return written


def _listed(folder: Path) -> set[str]:
    """Names of the pictures of the last call that can be such; nothing where there is no list."""
    try:
        names = (folder / LIST).read_text(encoding="utf-8").split("\n")
    except (OSError, UnicodeDecodeError):
        return set()
    return {name for name in names if PICTURE.fullmatch(name)}


def _files(sections: Sequence[Section]) -> Iterator[tuple[str, str | bytes]]:
    """Name and content of every picture's files."""
    for section in sections:
        pictures = [block for block in section.blocks if isinstance(block, Figure | Animation)]
        for number, picture in enumerate(pictures, 1):
            name = f"{section.id}-{number}"
            if isinstance(picture, Animation):
                yield f"{name}.gif", picture.gif
            else:
                document = compose(picture)
                yield f"{name}.svg", document
                yield f"{name}.png", rasterise(document)


def compose(figure: Figure) -> str:
    """A figure as one SVG document: its legend, below it its panels row by row; the caption is its description."""
    sizes = [svg_size(panel.svg) for panel in figure.panels]
    columns = min(figure.columns, len(sizes))
    wide = max(width for width, _ in sizes)
    inner = columns * wide + (columns - 1) * GAP
    drawn, y = _legend(figure.legend, inner)
    for first in range(0, len(sizes), columns):
        row = range(first, min(first + columns, len(sizes)))
        for column, index in enumerate(row):
            panel = figure.panels[index]
            drawn += nested_svg(panel.svg, f"p{index + 1}-", panel.alt, MARGIN + column * (wide + GAP), y) + "\n"
        y += max(sizes[index][1] for index in row) + GAP
    width, height = inner + 2.0 * MARGIN, y - GAP + MARGIN
    document = (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'width="{width:g}pt" height="{height:g}pt" viewBox="0 0 {width:g} {height:g}" '
        f'font-family="{FONT}, Verdana, sans-serif" stroke-linejoin="round">\n'
        f"<desc>{html.escape(plain_text(figure.caption))}</desc>\n"
        f'<rect width="100%" height="100%" fill="{PALETTE["surface"][0]}"/>\n{drawn}</svg>\n'
    )
    return unicodedata.normalize("NFC", document)


def rasterise(document: str) -> bytes:
    """An SVG document as a PNG file's bytes, without any font of the machine."""
    from matplotlib import get_data_path
    from resvg_py import svg_to_bytes

    fonts = [str(Path(get_data_path()) / "fonts" / "ttf" / f"DejaVuSans{cut}.ttf") for cut in ("", "-Bold", "-Oblique")]
    drawn: bytes = svg_to_bytes(
        svg_string=document,
        zoom=ZOOM,
        dpi=DPI,
        skip_system_fonts=True,
        font_files=fonts,
        font_family=FONT,
        sans_serif_family=FONT,
    )
    return drawn


def plain_text(text: str) -> str:
    """Text without the marks that `pipeline.report.Paragraph` tells of."""
    return re.sub(r"[_^]\{([^{}]*)\}", r"\1", text.replace("`", ""))


def _legend(keys: Sequence[Key], width: float) -> tuple[str, float]:
    """A legend's entries in lines of at most `width`, and where what is below it begins."""
    drawn, x, y = "", 0.0, MARGIN
    for key in keys:
        text = SWATCH[0] + 6.0 + _width(key.label)
        if x > 0.0 and x + text > width:
            x, y = 0.0, y + LINE
        mark = swatch(key.mark, PALETTE[key.colour][0])
        drawn += (
            f'<g transform="translate({MARGIN + x:.2f} {y:.2f})">{mark}'
            f'<text x="{SWATCH[0] + 6}" y="9.6" font-size="{SIZE:g}" fill="{PALETTE["ink"][0]}">'
            f"{html.escape(key.label)}</text></g>\n"
        )
        x += text + APART
    return drawn, y + (LINE + 4.0 if keys else 0.0)


def _width(text: str) -> float:
    """Width of a legend's text, points."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family=FONT, size=SIZE)
    return float(text_to_path.get_text_width_height_descent(text, font, ismath=False)[0])
