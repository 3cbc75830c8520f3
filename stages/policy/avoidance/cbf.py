"""A control barrier function: the velocity nearest to the learned one that keeps clear of all obstacles.

min |v - f|^2 subject to the rows of `survey.py`. Ames, Xu, Grizzle and Tabuada, "Control barrier function based
quadratic programs for safety critical systems" (IEEE Trans. Automatic Control 62, 2017). It keeps clear, and knows
nothing of V: it stands where f points straight at an obstacle. Where no velocity within the speed limit keeps all rows
it takes the one that misses them least, as ROAS+ does; it does not look ahead.
"""

from __future__ import annotations

from stages.compiled import lean
from stages.policy.avoidance.scratch import ACTIVE, FREE, WANTED, YIELDING, Avoidance, F, Scratch
from stages.policy.avoidance.shapes import Shapes
from stages.policy.avoidance.survey import survey
from stages.policy.avoidance.yielding import give_way
from stages.trajectory import Array


@lean
def keep_clear(avoidance: Avoidance, shapes: Shapes, x: Array, x_next: Array, dt: float, room: Scratch) -> int:
    """Change the step from x to `x_next`, shape (d,), metres, by as little as keeps every row."""
    if survey(avoidance, shapes, x, x_next, dt, room):
        return FREE
    for j in range(x.shape[0]):
        room.vectors[WANTED, j] = room.vectors[F, j]
    status = give_way(avoidance, x, x_next, dt, room)
    return ACTIVE if status == YIELDING else status
