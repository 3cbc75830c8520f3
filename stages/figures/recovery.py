"""Why the coupled system recovers: the distance |p_hat - x| and the gate over time, and V along x. Paper eqs. (9)-(12).

Arrays in, SVG documents out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stages.figures.numbers import MM
from stages.figures.style import colour, controller_colours, drawing, panel_width, svg
from stages.trajectory import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One roll-out that was pushed aside.

    Attributes:
        label: of the controller.
        time: array, shape (n,), seconds.
        gap: array, shape (n,), |p_hat - x|, metres.
        gate: array of bool, shape (n,), whether x may move.
        lyapunov: array, shape (n,), V of x, square metres.
        tolerance: of the gate, metres; 0: exact.
    """

    label: str
    time: Array
    gap: Array
    gate: NDArray[np.bool_]
    lyapunov: Array
    tolerance: float


def recovery_panel(case: Case, plain: Case | None, title: str, top: float, columns: int) -> str:
    """Distance, gate and V over time; `plain` is the uncoupled system under the same push; `top` in millimetres."""
    line = colour(controller_colours([case.label])[case.label])
    with drawing(panel_width(columns), 4.0, 2, 1, sharex=True, height_ratios=(1, 1)) as (figure, (upper, lower)):
        for axes in (upper, lower):
            for begin, end in closed_spans(case.time, case.gate):
                axes.axvspan(begin, end, color=colour("faint"), alpha=0.35, lw=0)
            axes.grid(axis="y")
        upper.plot(case.time, case.gap * MM, color=line)
        if case.tolerance > 0:
            for multiple in (1, 2):
                upper.axhline(multiple * case.tolerance * MM, color=colour("muted"), lw=0.9, ls=(0, (2, 2)))
        upper.set(ylim=(-0.02 * top, top), title=title)
        upper.set_ylabel("|p̂ − x| [mm]")  # noqa: RUF001
        if plain is not None:
            colours = controller_colours([plain.label])
            lower.plot(plain.time, plain.lyapunov * MM**2, color=colour(colours[plain.label]), lw=1.2)
        lower.plot(case.time, case.lyapunov * MM**2, color=line)
        lower.set_ylabel("V(x) [mm²]")
        lower.set_ylim(bottom=0)
        lower.set_xlabel("time [s]")
        return svg(figure)


def closed_spans(time: Array, gate: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Spans of time, seconds, in which the gate is closed: from the first closed sample to the next open one."""
    closed = np.concatenate([[False], ~gate, [False]])
    begins = np.flatnonzero(closed[1:] & ~closed[:-1])
    ends = np.flatnonzero(~closed[1:] & closed[:-1])
    last = time.shape[0] - 1
    return [(float(time[b]), float(time[min(e, last)])) for b, e in zip(begins, ends, strict=True)]
