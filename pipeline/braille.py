"""Characters that show dots: a sheet of cells, two by four dots each, on which series are laid over each other.

plotille sets the dots; where braille cannot be shown, a cell that has dots holds a sign instead. Not here: axes,
legends, bars (`drawing.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.plots import Array

ACROSS, DOWN = 2, 4
"""Dots of a braille character."""

BLANK = 0x2800
"""The braille character without dots; the others follow it, a bit a dot."""

LARGEST = 1e150
"""What is larger is taken for infinite: extents must not overflow."""


@dataclass(frozen=True, kw_only=True)
class Style:
    """How may be drawn: columns of the terminal, whether braille can be shown, whether colours are wanted."""

    width: int
    braille: bool = True
    colours: bool = False


@dataclass(frozen=True)
class Text:
    """A line of a picture: as it is printed, and the columns that it takes."""

    shown: str
    columns: int


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Where a picture lies: its size in characters, and the values at its first and last dots."""

    width: int
    height: int
    x: tuple[float, float]
    y: tuple[float, float]

    def dots(self, x: Array, y: Array) -> Array:
        """Whole dots of samples, shape (n, 2), from the lower left; nan where a sample is not finite or outside."""
        found = np.full((x.shape[0], 2), np.nan)
        sides = ((x, self.x, self.width * ACROSS), (y, self.y, self.height * DOWN))
        for axis, (values, (low, high), count) in enumerate(sides):
            inside = np.where(finite(values), values, np.nan)
            found[:, axis] = np.rint((inside - low) / (high - low) * (count - 1))
            found[~((found[:, axis] >= 0) & (found[:, axis] < count)), axis] = np.nan
        found[np.isnan(found).any(axis=1)] = np.nan
        return found


class Sheet:
    """The cells of a picture.

    Attributes:
        dots: array of int, shape (rows, columns): bits of the braille character; row 0 is the lowest.
        signs, colours: arrays of text, same shape; "": none.
    """

    def __init__(self, frame: Frame, style: Style) -> None:
        shape = (frame.height, frame.width)
        self.style = style
        self.dots = np.zeros(shape, dtype=np.int64)
        self.signs = np.full(shape, "", dtype=object)
        self.colours = np.full(shape, "", dtype=object)
        self._lettered: list[tuple[Array, str, str]] = []

    def line(self, dots: Array, sign: str, colour: str, *, joined: bool, letter: str = "") -> None:
        """Draw samples, array of dots, shape (n, 2), nan between stretches, over what is there.

        Arguments:
            sign: what stands in its cells where braille cannot be shown.
            joined: whether the samples of a stretch are.
            letter: is put on the line by `letters`.
        """
        paths = list(_stretches(dots))
        bits = _drawn(self.dots.shape, paths, joined=joined)
        self.dots |= bits
        self.colours[bits > 0] = colour
        if not self.style.braille:
            self.signs[bits > 0] = sign
        elif letter and paths:
            self._lettered.append((np.concatenate(paths), letter, colour))

    def put(self, dots: Array, sign: str, colour: str) -> None:
        """Put a sign at each sample, array of dots, shape (n, 2)."""
        for x, y in dots[~np.isnan(dots[:, 0])].astype(int).tolist():
            cell = (y // DOWN, x // ACROSS)
            self.signs[cell], self.colours[cell] = sign, colour

    def letters(self) -> None:
        """Put the letters on the lines drawn so far: each on a stretch of its own, where no other sign stands."""
        for k, (dots, letter, colour) in enumerate(self._lettered):
            wanted = int((k + 0.5) / len(self._lettered) * dots.shape[0])
            nearest = np.argsort(np.abs(np.arange(dots.shape[0]) - wanted), kind="stable")
            x, y = dots[nearest].astype(int).T
            free = np.flatnonzero(self.signs[y // DOWN, x // ACROSS] == "")
            if free.size:
                self.put(dots[nearest[free[:1]]], letter, colour)

    def lines(self) -> list[Text]:
        """Rows from the top."""
        found = []
        for signs, colours, bits in zip(self.signs[::-1], self.colours[::-1], self.dots[::-1].tolist(), strict=True):
            cells = [
                (colour, sign or (chr(BLANK + dot) if dot else " "))
                for sign, colour, dot in zip(signs, colours, bits, strict=True)
            ]
            alike = groupby(cells, key=itemgetter(0))
            shown = (tinted("".join(cell for _, cell in span), colour, self.style) for colour, span in alike)
            found.append(Text("".join(shown), len(cells)))
        return found


def finite(values: Array) -> NDArray[np.bool_]:
    """Which of the values can be drawn, same shape."""
    return np.asarray(np.abs(values) < LARGEST)


def canvas(width: int, height: int) -> Any:
    """A canvas of plotille's whose coordinates are its dots, from the lower left."""
    from plotille import Canvas

    return Canvas(width, height, 0, 0, width * ACROSS, height * DOWN)


def tinted(text: str, colour: str, style: Style) -> str:
    """A text in the colour of an ANSI code, where colours are wanted."""
    return f"\033[{colour}m{text}\033[0m" if style.colours and colour and text.strip() else text


def _stretches(dots: Array) -> Iterator[Array]:
    """Stretches of samples between those that are not there; a dot that is repeated, once."""
    there = ~np.isnan(dots[:, 0])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        stretch = dots[first:last]
        yield stretch[np.concatenate([[True], (np.diff(stretch, axis=0) != 0).any(axis=1)])]


def _drawn(shape: Sequence[int], paths: Sequence[Array], *, joined: bool) -> NDArray[np.int64]:
    """Bits of cells, array of the given shape, row 0 the lowest, of paths, each an array of dots, shape (n, 2)."""
    rows, columns = shape
    sheet = canvas(columns, rows)
    for path in paths:
        points = path.astype(int).tolist()
        ends = points[1:] if joined and len(points) > 1 else points
        for (x0, y0), (x1, y1) in zip(points, ends, strict=False):
            sheet.line(x0, y0, x1, y1)
    lines = sheet.plot(linesep="\n").split("\n")
    return np.array([[ord(character) - BLANK for character in line] for line in reversed(lines)])
