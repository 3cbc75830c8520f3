"""How the mixture was found: log posterior and number of components by sweep, or the criterion by their number.

Arrays in, SVG documents out. Paper eq. (5), ref. [32].
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stages.figures.style import colour, drawing, panel_width, svg
from stages.trajectory import Array


def sampler_panels(
    log_posterior: Array, components: NDArray[np.int64], criterion: Mapping[int, float], kind: str
) -> list[str]:
    """Two small pictures: what rose, and K, by sweep; with a criterion, its values by K instead of the second.

    Arguments:
        log_posterior: array, shape (n,), after each sweep; of ``em``, the log likelihood at each iteration.
        components: array, shape (n,), number of components after each sweep.
        criterion: number of components -> Bayesian information criterion; the lowest is chosen.
        kind: ``pcgmm`` or ``em``.
    """
    what, over = ("log likelihood", "iteration") if kind == "em" else ("log posterior", "sweep")
    steps = np.arange(1, len(log_posterior) + 1)
    best = int(np.argmax(log_posterior))
    panels = [_line(steps, log_posterior, what, over, best)]
    if criterion:
        tried = np.array(sorted(criterion))
        values = np.array([criterion[int(k)] for k in tried])
        panels.append(_line(tried, values, "Bayesian information criterion", "components K", int(np.argmin(values))))
    elif kind != "em":
        panels.append(_line(steps, components, "components K", over, best))
    return panels


def _line(x: NDArray[np.int64], y: NDArray[np.float64] | NDArray[np.int64], what: str, over: str, kept: int) -> str:
    """A line with the value that was kept marked."""
    from matplotlib.ticker import MaxNLocator

    with drawing(panel_width(2), 2.2) as (figure, (axes,)):
        axes.plot(x, y, color=colour("muted"), lw=1.3, drawstyle="steps-mid" if y.dtype.kind == "i" else "default")
        axes.plot(x[kept], y[kept], "o", ms=6, color=colour("ink"))
        axes.annotate("kept", (x[kept], y[kept]), xytext=(6, -3), textcoords="offset points", fontsize=9, va="top")
        axes.set_xlabel(over)
        axes.set_title(what)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if y.dtype.kind == "i":
            axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
            axes.set_ylim(0, y.max() + 1)
        axes.margins(x=0.03)
        axes.grid(axis="y")
        return svg(figure)
