"""A rerun recording as this project writes it: by columns, on one time line, under names that a person reads.

rerun is imported by who opens a stream. Not here: what is shown (`plane.py`, `arms.py`), and files (`recording.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.trajectory import Array

TIMELINE = "time"
"""Seconds from when a roll-out began; roll-outs that are compared share it."""

Colour = tuple[int, int, int] | tuple[int, int, int, int]

PLANAR = 2
"""Coordinates of what is shown as a plane."""

OBSTACLE: Colour = (150, 158, 168)
TRAP: Colour = (255, 146, 72)


@dataclass(frozen=True, kw_only=True, eq=False)
class Stream:
    """A recording that is being written.

    Attributes:
        rr: the module rerun.
        to: its stream.
    """

    rr: Any
    to: Any

    def still(self, entity: str, *what: Any) -> None:
        """Log what does not change with time."""
        self.to.log(entity, *what, static=True)

    def columns(self, entity: str, time: Array, columns: Any) -> None:
        """Send all samples of an entity at once; `time`: array, shape (n,), seconds."""
        index = self.rr.TimeColumn(TIMELINE, duration=np.asarray(time))
        self.rr.send_columns(entity, indexes=[index], columns=columns, recording=self.to)

    def series(self, entity: str, time: Array, values: Array, colour: Colour, name: str, width: float = 1.5) -> None:
        """A curve of a plot, array, shape (n,); what is not finite is left out."""
        shown = np.isfinite(values)
        self.still(entity, self.rr.SeriesLines(colors=[colour], names=[name], widths=[width]))
        if shown.any():
            self.columns(entity, time[shown], self.rr.Scalars.columns(scalars=values[shown]))

    def level(self, entity: str, time: Array, value: float, colour: Colour, name: str) -> None:
        """A level of a plot, from the first to the last of times, array, shape (n,), seconds."""
        self.series(entity, time[[0, -1]], np.full(2, value), colour, name, width=1.0)

    def states(self, entity: str, time: Array, values: NDArray[Any], colours: Mapping[str, Colour]) -> None:
        """A lane of words that change, array of text, shape (n,); logged where they do. What is empty is a gap.

        `colours`: of some of the words; the viewer chooses those of the others.
        """
        words = [str(value) for value in values]
        changes = [k for k, word in enumerate(words) if k == 0 or word != words[k - 1]]
        known = [word for word in dict.fromkeys(words) if word in colours]
        if known:
            shades = [colours[word] for word in known]
            self.still(entity, self.rr.StateConfiguration(values=known, colors=shades))
        said = self.rr.StateChange.columns(state=[words[k] for k in changes])
        self.columns(entity, time[changes], said)

    def ways(self, entity: str, ways: Sequence[Array], colour: Colour, width: float) -> None:
        """Whole paths, arrays, shape (n, d), metres; `width`: metres."""
        kept = [way for way in ways if way.shape[0] > 1]
        if not kept:
            return
        strips = self.rr.LineStrips2D if kept[0].shape[1] == PLANAR else self.rr.LineStrips3D
        self.still(entity, strips(kept, colors=[colour], radii=[0.5 * width]))

    def place(self, entity: str, time: Array, points: Array, colour: Colour, size: float) -> None:
        """Where something is at each time, array, shape (n, d), metres; `size`: radius, metres."""
        kind = self.rr.Points2D if points.shape[1] == PLANAR else self.rr.Points3D
        self.still(entity, kind.from_fields(colors=[colour], radii=[size]))
        self.columns(entity, time, kind.columns(positions=points))

    def spots(self, entity: str, points: Array, colour: Colour, size: float, labels: Sequence[str] = ()) -> None:
        """Places that stay, array, shape (n, d), metres; `size`: radius, metres."""
        kind = self.rr.Points2D if points.shape[1] == PLANAR else self.rr.Points3D
        self.still(entity, kind(points, colors=[colour], radii=[size], labels=list(labels) or None))


def rgb(name: str, palette: Mapping[str, tuple[str, str]], *, dark: bool = True) -> tuple[int, int, int]:
    """A colour of a palette as it is on a dark page, or on a light one."""
    text = palette[name][dark].removeprefix("#")
    return int(text[:2], 16), int(text[2:4], 16), int(text[4:], 16)
