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
        log_posterior: array, shape (chains, n), after each sweep; of ``em``, one row, the log likelihood at each
            iteration.
        components: array, shape (chains, n), number of components after each sweep.
        criterion: number of components -> Bayesian information criterion; the lowest is chosen.
        kind: ``pcgmm`` or ``em``.
    """
    what, over = ("log likelihood", "iteration") if kind == "em" else ("log posterior", "sweep")
    steps = np.arange(1, log_posterior.shape[1] + 1)
    chain, best = np.unravel_index(int(np.argmax(log_posterior)), log_posterior.shape)
    kept = (int(chain), int(best))
    panels = [_lines(steps, log_posterior, what, over, kept)]
    if criterion:
        tried = np.array(sorted(criterion))
        values = np.array([criterion[int(k)] for k in tried])
        lowest = (0, int(np.argmin(values)))
        panels.append(_lines(tried, values[None], "Bayesian information criterion", "components K", lowest))
    elif kind != "em":
        panels.append(_lines(steps, components, "components K", over, kept))
    return panels


def _lines(
    x: NDArray[np.int64],
    y: NDArray[np.float64] | NDArray[np.int64],
    what: str,
    over: str,
    kept: tuple[int, int],
) -> str:
    """A line a row of `y`, the row and the value that were kept marked; the other rows are paler."""
    from matplotlib.ticker import MaxNLocator

    chain, best = kept
    style = "steps-mid" if y.dtype.kind == "i" else "default"
    with drawing(panel_width(2), 2.2) as (figure, (axes,)):
        for row, values in enumerate(y):
            opacity = 1.0 if row == chain else 0.35
            axes.plot(x, values, color=colour("muted"), lw=1.3, drawstyle=style, alpha=opacity)
        axes.plot(x[best], y[kept], "o", ms=6, color=colour("ink"))
        axes.annotate("kept", (x[best], y[kept]), xytext=(6, -3), textcoords="offset points", fontsize=9, va="top")
        axes.set_xlabel(over)
        axes.set_title(what)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if y.dtype.kind == "i":
            axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
            axes.set_ylim(0, y.max() + 1)
        axes.margins(x=0.03)
        axes.grid(axis="y")
        return svg(figure)
