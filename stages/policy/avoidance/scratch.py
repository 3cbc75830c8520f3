"""What every method of avoidance is given in compiled code: its parameters, its answer, room to work in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stages.compiled import compiled
from stages.trajectory import Array

NONE, ROAS, ROAS_PLUS, APF, MODULATION, CBF = range(6)
"""Kinds of avoidance."""

FREE, ACTIVE, DETOURING, YIELDING, INFEASIBLE, TOO_FAST, TRAPPED = range(7)
"""What became of a step; the names are those of `stages.policy.outcome.Status`."""


class Avoidance(NamedTuple):
    """A method and its parameters; what its kind does not use is 0.

    Attributes:
        kind: NONE, ROAS, ROAS_PLUS, APF, MODULATION or CBF.
        rate: 1/s, of a row.
        reach: m, where repulsion begins; 0: the obstacle's own radius.
        gain: of steering; of repulsion, m/s; reactivity of modulation; of the printed force, 1/m.
        margin: m, beyond every obstacle.
        swiftness: top speed, as a multiple of the learned system's.
        speed_limit: m/s, of giving way.
        fastest: m/s, of any step: what the executed state can follow.
        detour: whether traps are left.
    """

    kind: int
    rate: float = 0.0
    reach: float = 0.0
    gain: float = 0.0
    margin: float = 0.0
    swiftness: float = 1.0
    speed_limit: float = 0.0
    fastest: float = np.inf
    detour: bool = False


IGNORE = Avoidance(NONE)
"""Obstacles are run into."""


F, Y, TOWARD, WANTED, VELOCITY, DIRECT, SIDE, SPARE, CENTRE, TRIAL, LENGTHS, SHIFTS = range(12)
"""Rows of `Scratch.vectors`. F: velocity without obstacles, m/s. Y: the state in round coordinates. TOWARD: unit vector
to the goal there. WANTED, VELOCITY, DIRECT: velocities wanted, taken, straight to the goal. SIDE, SPARE: whatever is
needed. CENTRE: of the ball of `projection.py`; TRIAL, LENGTHS, SHIFTS: its own."""

FORWARD, BACK, GRAM = range(3)
"""Of `Scratch.matrices`. FORWARD, BACK: from velocities to round coordinates, and from there. GRAM: of active rows."""

NORMAL, ROW = range(2)
"""Of `Scratch.tables`. NORMAL: gradients of the distances from obstacles. ROW: of the program, unit vectors."""

CLEAR, BOUND, WEIGHT, LIMIT = range(4)
"""Rows of `Scratch.columns`. CLEAR: distances less the margin, metres. BOUND: -normal . v may not be larger, m/s.
WEIGHT: how much f heads for an obstacle, from 0 to 1. LIMIT: of the program's rows."""

PLAN, CHOSEN = 0, 1
"""Of `Scratch.integers`. PLAN: the way out that was good last time, kept between steps. From CHOSEN: active rows."""


class Scratch(NamedTuple):
    """Room for one step among m obstacles in d coordinates; every call overwrites it.

    Few arrays, as every call in compiled code hands over each of them.

    Attributes:
        vectors: array, shape (12, d), by F, Y, TOWARD, ...
        matrices: array, shape (3, d, d), by FORWARD, BACK, GRAM.
        tables: array, shape (2, m, d), by NORMAL, ROW.
        columns: array, shape (4, m), by CLEAR, BOUND, WEIGHT, LIMIT.
        integers: array of int, shape (1 + d,), by PLAN, CHOSEN.
        directions: array, shape (n, d), unit vectors of ways out.
    """

    vectors: Array
    matrices: Array
    tables: Array
    columns: Array
    integers: NDArray[np.int64]
    directions: Array


@compiled
def scratch(m: int, d: int) -> Scratch:
    """Return room for a step among m obstacles in d coordinates."""
    return Scratch(
        np.zeros((12, d)),
        np.zeros((3, d, d)),
        np.zeros((2, m, d)),
        np.zeros((4, m)),
        np.zeros(1 + d, dtype=np.int64),
        compass(d),
    )


@compiled
def compass(d: int) -> Array:
    """Directions to try, unit vectors, shape (n, d): along the axes, and in 2-D and 3-D along the diagonals."""
    diagonals = 2**d if d <= 3 else 0
    result = np.zeros((2 * d + diagonals, d))
    for i in range(d):
        result[2 * i, i], result[2 * i + 1, i] = 1.0, -1.0
    for k in range(diagonals):
        for i in range(d):
            result[2 * d + k, i] = (1.0 if (k >> i) & 1 else -1.0) / np.sqrt(d)
    return result
