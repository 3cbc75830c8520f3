"""What has to hold for every HTML page that the program writes."""

from __future__ import annotations

import itertools
import re
from xml.etree.ElementTree import Element

from tinyhtml5.parser import HTMLParser

HTML, SVG = "{http://www.w3.org/1999/xhtml}", "{http://www.w3.org/2000/svg}"
LINKS = ("href", "src", "srcset", "{http://www.w3.org/1999/xlink}href")
HEADINGS = tuple(f"{HTML}h{level}" for level in range(1, 7))


def check_page(text: str) -> None:
    """Strictly parsed, without one error; unique ids; words for every picture; nothing from elsewhere; see below."""
    parser = HTMLParser()
    root = parser.parse(text)
    assert parser.errors == []
    every = [element for element in root.iter() if isinstance(element.tag, str)]
    ids = [element.get("id") for element in every if "id" in element.attrib]
    assert len(ids) == len(set(ids))
    _check_links(every, set(ids))
    _check_pictures(every)
    _check_headings(every)
    for table in of(every, f"{HTML}table"):
        _check_table(table)
    labelled = [element.get("aria-labelledby") for element in every if "aria-labelledby" in element.attrib]
    assert set(labelled) <= set(ids)
    assert "url(http" not in text
    assert "@import" not in text


def of(every: list[Element], tag: str) -> list[Element]:
    return [element for element in every if element.tag == tag]


def _check_links(every: list[Element], ids: set[str | None]) -> None:
    """Into the page itself, into its own data, or to a file beside it."""
    for element in every:
        for value in (element.get(name) for name in LINKS if name in element.attrib):
            assert value
            assert not re.match(r"[a-z]+://|//|/|(?!data:)[a-z]+:", value), value
            assert not value.startswith("#") or value[1:] in ids, value
    used = re.findall(r"url\(#([^)]+)\)", " ".join(value for e in every for value in e.attrib.values()))
    assert set(used) <= ids
    assert not {f"{HTML}{tag}" for tag in ("script", "link", "iframe", "object", "embed")} & {e.tag for e in every}


def _check_pictures(every: list[Element]) -> None:
    """Words for every picture that is not there for the eye alone."""
    for picture in of(every, f"{SVG}svg"):
        assert picture.get("aria-hidden") == "true" or (picture.get("role") == "img" and picture.get("aria-label"))
    for picture in of(every, f"{HTML}img"):
        assert picture.get("alt")
        assert picture.get("width")
        assert picture.get("height")
    for figure in of(every, f"{HTML}figure"):
        (caption,) = figure.iter(f"{HTML}figcaption")
        assert "".join(caption.itertext()).strip()


def _check_headings(every: list[Element]) -> None:
    """One of the first level, the first of all; none deeper by more than one than the one before."""
    levels = [HEADINGS.index(element.tag) + 1 for element in every if element.tag in HEADINGS]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    assert all("".join(e.itertext()).strip() for e in every if e.tag in HEADINGS)


def _check_table(table: Element) -> None:
    """A caption, a scope for every head, rows of one length."""
    (caption,) = table.iter(f"{HTML}caption")
    assert "".join(caption.itertext()).strip()
    assert all(head.get("scope") in ("row", "col", "rowgroup", "colgroup") for head in table.iter(f"{HTML}th"))
    lengths = {sum(int(cell.get("colspan", "1")) for cell in row) for row in table.iter(f"{HTML}tr")}
    assert len(lengths) == 1
    for row in table.iter(f"{HTML}tbody"):
        assert all(line[0].tag == f"{HTML}th" and line[0].get("scope") == "row" for line in row)
