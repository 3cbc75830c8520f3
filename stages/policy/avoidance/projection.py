"""The admissible velocity nearest to a wanted one: a quadratic program so small that its active sets are enumerated.

min |y - target|^2 subject to m rows r_i . y <= b_i and a ball |y - centre| <= radius. The rows keep the state clear of
obstacles, the ball is where V does not rise. For a set of active rows the answer is in closed form: the target is
projected onto their intersection and, where that lies outside of the ball, onto the ball's section. The program is
convex, so the first set whose answer is feasible and whose multipliers are not negative is the solution. At most d rows
are active at once. Not here: what the rows and the ball are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stages.compiled import lean
from stages.dynamics.kernels import solve_in_place
from stages.policy.avoidance.scratch import CENTRE, CHOSEN, GRAM, LENGTHS, LIMIT, ROW, SHIFTS, TRIAL, Scratch
from stages.trajectory import Array

SLACK = 1e-12
"""A row counts as kept if it is missed by at most this, relative to the size of the numbers in it."""

_OPTIMAL = 1e-9
"""As `SLACK`, for the sign of a multiplier: it decides how near the answer is, not whether it is admissible."""


@lean
def nearest(target: Array, room: Scratch, m: int, radius: float, out: Array) -> bool:
    """Write the admissible point nearest to `target` into `out`, shape (d,); return whether there is one.

    Args:
        target: array, shape (d,).
        room: rows (ROW, LIMIT) and the ball's centre (CENTRE). The rest of it that is the program's will be modified.
        m: how many rows count.
        radius: of the ball; inf: there is none.
        out: array, shape (d,). Will be modified.
    """
    d, centre, chosen = target.shape[0], room.vectors[CENTRE], room.integers[CHOSEN:]
    scale = 0.0
    for i in range(d):
        scale = max(scale, abs(target[i]))
    if radius < np.inf:
        for i in range(d):
            scale = max(scale, abs(centre[i]))
        scale = max(scale, radius)
    for size in range(min(m, d) + 1):
        for i in range(size):
            chosen[i] = i
        while True:
            if _solve(target, room, size, m, radius, scale, out):
                return True
            if not _next_set(chosen, size, m):
                break
    return False


@lean
def _next_set(active: NDArray[np.int64], size: int, m: int) -> bool:
    """Advance to the next set of `size` of m numbers, in order; False after the last. `active`: will be modified."""
    for back in range(size):
        at = size - 1 - back
        if active[at] < m - 1 - back:
            active[at] += 1
            for i in range(at + 1, size):
                active[i] = active[i - 1] + 1
            return True
    return False


@lean
def _solve(target: Array, room: Scratch, size: int, m: int, radius: float, scale: float, out: Array) -> bool:
    """Write the optimum with just the active rows in force into `out`; return whether it solves the whole program."""
    d, rows, limits = target.shape[0], room.tables[ROW], room.columns[LIMIT]
    centre, trial, lengths, shifts = (
        room.vectors[CENTRE],
        room.vectors[TRIAL],
        room.vectors[LENGTHS],
        room.vectors[SHIFTS],
    )
    _onto(target, room, size, out, lengths)
    outside, section = 0.0, 0.0
    if radius < np.inf:
        squared = 0.0
        for i in range(d):
            squared += (out[i] - centre[i]) ** 2
        outside = squared - radius * radius
    if outside > SLACK * scale * scale:
        _onto(centre, room, size, trial, shifts)
        gap, reach = 0.0, radius * radius
        for i in range(d):
            gap += (out[i] - trial[i]) ** 2
            reach -= (trial[i] - centre[i]) ** 2
        if not (reach >= -SLACK * scale * scale and gap > 0.0):
            return False
        section = math.sqrt(max(reach, 0.0) / gap)
        for i in range(d):
            out[i] = trial[i] + section * (out[i] - trial[i])
        # The ball's multiplier is 1/section - 1 > 0; the rows' are those of the point between target and centre.
        for i in range(size):
            lengths[i] = section * lengths[i] + (1.0 - section) * shifts[i]
    # A corner of rows that ask for much may lie far away: its rounding is that of its own size.
    reach = scale
    for i in range(d):
        reach = max(reach, abs(out[i]))
    for i in range(size):
        reach = max(reach, abs(limits[room.integers[CHOSEN + i]]))
    for i in range(size):
        if not lengths[i] >= -_OPTIMAL * reach:
            return False
    for j in range(m):
        along = 0.0
        for i in range(d):
            along += rows[j, i] * out[i]
        if not along - limits[j] <= SLACK * max(reach, abs(limits[j])):
            return False
    return True


@lean
def _onto(point: Array, room: Scratch, size: int, out: Array, multipliers: Array) -> None:
    """Project `point` onto the intersection of the active rows' planes; not finite where two of these are parallel."""
    d, rows, limits, gram = point.shape[0], room.tables[ROW], room.columns[LIMIT], room.matrices[GRAM]
    chosen = room.integers[CHOSEN:]
    for a in range(size):
        row = chosen[a]
        total = -limits[row]
        for i in range(d):
            total += rows[row, i] * point[i]
        multipliers[a] = total
        for b in range(size):
            total = 0.0
            for i in range(d):
                total += rows[row, i] * rows[chosen[b], i]
            gram[a, b] = total
    if size > 1:
        solve_in_place(gram[:size, :size], multipliers[:size])
    for i in range(d):
        out[i] = point[i]
        for a in range(size):
            out[i] -= multipliers[a] * rows[chosen[a], i]
