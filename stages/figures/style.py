"""How figures are drawn: one style, one colour a controller, SVG documents with equal bytes for equal arrays.

Colours are those of `pipeline.report.PALETTE`, so that the page can adapt them to light and dark. matplotlib is
imported when the first figure is made.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from pipeline.report import PALETTE, Key
from stages.figures.numbers import controller_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = 11.0
"""Width of the page, inches: panels in n columns are this divided by n, less the gap, so that text keeps its size."""

GAP = 0.15
POINT = 10.0
"""Size of text, points of the drawing."""

CONTROLLERS = {"lpvds": "series-1", "clpvds robust": "series-2", "clpvds paper": "series-3"}
OTHERS = ("series-4", "series-5")


def colour(name: str) -> str:
    """A colour of the palette as it is drawn."""
    return PALETTE[name][0]


def controller_colours(labels: Sequence[str]) -> dict[str, str]:
    """Name in the palette for each controller; those without one of their own take turns."""
    others = [label for label in labels if label not in CONTROLLERS]
    return {label: CONTROLLERS.get(label) or OTHERS[others.index(label) % len(OTHERS)] for label in labels}


def controller_keys(labels: Sequence[str], mark: Any = "line") -> tuple[Key, ...]:
    """Legend entries of controllers."""
    colours = controller_colours(labels)
    return tuple(Key(label=controller_name(label), colour=colours[label], mark=mark) for label in labels)


@contextmanager
def drawing(
    width: float, height: float, rows: int = 1, columns: int = 1, **options: Any
) -> Iterator[tuple[Figure, list[Axes]]]:
    """A figure of `width` x `height` inches with a grid of axes, row by row, in the report's style."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context():
        mpl.rcdefaults()  # what a user's own matplotlibrc says must not change the report
        settings: Any = _settings()
        mpl.rcParams.update(settings)
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False, **options)
        yield figure, list(axes.ravel())


def svg(figure: Figure) -> str:
    """The figure as an SVG document without a date; call it within `drawing`."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    return buffer.getvalue().decode()


def panel_width(columns: int) -> float:
    """Width of one of `columns` panels side by side, inches."""
    return (PAGE - GAP * (columns - 1)) / columns


def limits(points: Any, margin: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of x and y that hold all points, array, shape (n, 2), with a margin as a fraction of the larger range."""
    low, high = points.min(axis=0), points.max(axis=0)
    pad = margin * float((high - low).max() or 1.0)
    return (float(low[0] - pad), float(high[0] + pad)), (float(low[1] - pad), float(high[1] + pad))


def _settings() -> dict[str, Any]:
    ink, muted, rule = colour("ink"), colour("muted"), colour("rule")
    return {
        "svg.hashsalt": "clpv",
        "svg.fonttype": "none",
        "font.family": "DejaVu Sans",  # measures the text; the page sets it in its own font, which is no wider
        "font.size": POINT,
        "axes.titlesize": POINT,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.labelsize": POINT,
        "axes.labelcolor": muted,
        "axes.titlecolor": ink,
        "axes.edgecolor": colour("faint"),
        "axes.linewidth": 0.8,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.axisbelow": True,
        "xtick.color": colour("faint"),
        "ytick.color": colour("faint"),
        "xtick.labelcolor": muted,
        "ytick.labelcolor": muted,
        "xtick.labelsize": POINT - 1,
        "ytick.labelsize": POINT - 1,
        "grid.color": rule,
        "grid.linewidth": 0.8,
        "text.color": ink,
        "lines.linewidth": 1.6,
        "lines.solid_capstyle": "round",
        "path.simplify_threshold": 0.2,
    }
