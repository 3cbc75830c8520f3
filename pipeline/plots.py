"""Small plots for a terminal, as a stage declares them: curves and points over two axes, or bars.

Values only: arrays and text in, nothing drawn here (`drawing.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """Samples that belong together.

    Attributes:
        name: in the legend; "": it is not named there.
        x, y: arrays, shape (n,), in the units of the plot's labels; where one is nan, a line is interrupted.
        joined: by a line; else each sample is a dot of its own.
        mark: the sign that stands for it; "": the lines of a plot get letters if there are several.
        faint: what the others are seen against: dim, and without a letter.
    """

    name: str
    x: Array
    y: Array
    joined: bool = True
    mark: str = ""
    faint: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Plot:
    """Curves and points over two axes.

    Attributes:
        title: what is seen, in one line.
        x_label, y_label: of the axes, with units.
        series: drawn in order.
        same_scale: whether a unit is as long on both axes, as on a map; such plots stand side by side where they fit.
        x_limits, y_limits: what the axes show at least where others are to be compared; samples beyond are left out.
    """

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    same_scale: bool = False
    x_limits: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One bar: its name, its value (nan: there is none), and the value in words ("": as a number)."""

    name: str
    value: float
    text: str = ""


@dataclass(frozen=True, kw_only=True)
class Bars:
    """A horizontal bar chart.

    Attributes:
        title: what is seen, with the unit.
        bars: from top to bottom.
        full: value of the longest possible bar; none: the largest there is.
    """

    title: str
    bars: tuple[Bar, ...]
    full: float | None = None
