"""Traps: places on an obstacle where V has a minimum, how they are noticed, and a way that leaves them for good.

A learned V can bend more than an obstacle does; then no admissible step brings V down, and a policy that must not raise
V stands for ever. A detour raises it for a while, and ends lower. The straight way to the goal in the image of the
warp, along which V falls, enters the obstacle where the state stands and leaves it somewhere: this point, a little
farther on, becomes the goal, with V the squared distance from IT, for which spheres have no traps (`roas_plus.py`). The
detour is over as soon as the learned V is clearly lower than in the trap. Between detours it does not rise: no trap is
met twice, and there are as many detours as traps at most.

Progress is noticed over windows: a state that avoids something, has moved by less than a twentieth of what the learned
system would have, and has brought V down by less than 1 % a second, is stuck.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stages.compiled import compiled, lean
from stages.dynamics.kernels import ModelArrays, Workspace, image_only, lyapunov_at
from stages.dynamics.warp import unwarp_at
from stages.policy.avoidance.scratch import DIRECT, SIDE, SPARE, WEIGHT, Scratch
from stages.policy.avoidance.shapes import REACH, Shapes, distance_at
from stages.policy.avoidance.survey import norm
from stages.trajectory import Array

PATIENCE = 1.0
"""Seconds without progress after which a state is trapped."""

HESITATION = 0.25
"""Seconds without progress after which a detour is begun."""

LEAST_WAY = 0.05
"""Progress: this share of the way that the learned system would have gone."""

LEAST_FALL = 0.01
"""Progress: this share of V a second."""

BEYOND = 0.1
"""A detour ends this far behind the obstacle, as a share of its radius."""

LEFT = 0.1
"""A detour is over where V has come down to this share of the way from its waypoint's V up to the trap's."""

_SAMPLES = 400


WAYPOINT, ANCHOR = 0, 1
"""Rows of `Memory.places`. WAYPOINT: where a detour ends. ANCHOR: where the present window began."""

DETOUR, PACE, LEVEL, SECONDS, WAY, FIRST = range(6)
"""Of `Memory.numbers`. DETOUR: 1 on a detour. PACE: its speed, m/s. LEVEL: V at which it is over. Of the window:
SECONDS since it began; WAY that the learned system would have gone, metres; FIRST: V where it began, -1 before the
first step."""


class Memory(NamedTuple):
    """What avoidance remembers from step to step. All will be modified.

    Attributes:
        places: array, shape (2, d), metres, by WAYPOINT, ANCHOR.
        numbers: array, shape (6,), by DETOUR, PACE, LEVEL, SECONDS, WAY, FIRST.
    """

    places: Array
    numbers: Array


@compiled
def memory(x: Array) -> Memory:
    """Return the memory of a policy that begins at x, shape (d,), metres."""
    recall = Memory(np.zeros((2, x.shape[0])), np.zeros(6))
    forget(recall, x)
    return recall


@lean
def forget(recall: Memory, x: Array) -> None:
    """Begin a new window at x, shape (d,), metres."""
    recall.numbers[SECONDS], recall.numbers[WAY], recall.numbers[FIRST] = 0.0, 0.0, -1.0
    for j in range(x.shape[0]):
        recall.places[ANCHOR, j] = x[j]


@lean
def without_progress(recall: Memory, x: Array, way: float, before: float, after: float, dt: float) -> float:
    """Take in a step of a state that avoids something; return for how many seconds it has made no progress.

    Args:
        recall: will be modified.
        x: array, shape (d,), metres, after the step.
        way: metres that the step would have gone without obstacles.
        before, after: V before and after it.
        dt: seconds.
    """
    numbers = recall.numbers
    if numbers[FIRST] < 0.0:
        numbers[FIRST] = before
    numbers[SECONDS] += dt
    numbers[WAY] += way
    gone = 0.0
    for j in range(x.shape[0]):
        gone += (x[j] - recall.places[ANCHOR, j]) ** 2
    moved = math.sqrt(gone) > LEAST_WAY * numbers[WAY]
    fell = numbers[FIRST] - after > LEAST_FALL * numbers[SECONDS] * numbers[FIRST]
    idle = 0.0 if moved or fell else numbers[SECONDS]
    if (moved or fell) and numbers[SECONDS] >= HESITATION:
        forget(recall, x)
    return idle


@lean
def begin_detour(
    shapes: Shapes,
    margin: float,
    model: ModelArrays,
    x: Array,
    pace: float,
    kernels: Workspace,
    recall: Memory,
    room: Scratch,
) -> bool:
    """Find the way round what is between x and the goal; False where nothing is.

    Args:
        shapes: obstacles, where they are now.
        margin: metres that are kept beyond them.
        model: the learned system.
        x: array, shape (d,), metres.
        pace: speed of the detour, m/s.
        kernels: of the model. Will be modified.
        recall: will be modified.
        room: will be modified.
    """
    d, m = x.shape[0], shapes.kinds.shape[0]
    image, at, spare = room.vectors[DIRECT], room.vectors[SIDE], room.vectors[SPARE]
    image_only(x, model, kernels)
    for j in range(d):
        image[j] = kernels.psi[j]
    for i in range(m):  # a goal that is nearer than that is reached, too
        from_goal = distance_at(shapes, i, model.goal, spare) - margin
        room.columns[WEIGHT, i] = min(BEYOND * shapes.measures[i, REACH], 0.5 * from_goal)
    entered = False
    for k in range(1, _SAMPLES + 1):  # the last is the goal
        for j in range(d):
            kernels.psi[j] = (1.0 - k / _SAMPLES) * image[j]
        unwarp_at(kernels.psi, model.centres, model.translations, model.rates, model.origin, at)
        for j in range(d):
            at[j] += model.goal[j]
        clear = True
        for i in range(m):
            distance = distance_at(shapes, i, at, spare) - margin
            entered = entered or distance < 0.0
            clear = clear and distance >= room.columns[WEIGHT, i]
        if entered and clear:
            for j in range(d):
                recall.places[WAYPOINT, j] = at[j]
            recall.numbers[DETOUR], recall.numbers[PACE] = 1.0, pace
            low, high = lyapunov_at(at, model, kernels), lyapunov_at(x, model, kernels)
            recall.numbers[LEVEL] = low + LEFT * (high - low)
            forget(recall, x)
            return True
    return False


@lean
def detour_step(
    shapes: Shapes,
    margin: float,
    model: ModelArrays,
    x: Array,
    dt: float,
    kernels: Workspace,
    recall: Memory,
    room: Scratch,
    x_next: Array,
) -> bool:
    """Write the step straight to the waypoint into `x_next`; False, and the detour is over, where V is low enough.

    It is over, too, where a moving obstacle has come over the waypoint. Arguments as of `begin_detour`; `x_next`: shape
    (d,), metres. Will be modified.
    """
    d, waypoint, side = x.shape[0], recall.places[WAYPOINT], room.vectors[SIDE]
    for j in range(d):
        side[j] = waypoint[j] - x[j]
    left, reach = norm(side), recall.numbers[PACE] * dt
    over = left == 0.0 or lyapunov_at(x, model, kernels) <= recall.numbers[LEVEL]
    for i in range(shapes.kinds.shape[0]):
        over = over or distance_at(shapes, i, waypoint, room.vectors[SPARE]) <= margin
    if over:
        recall.numbers[DETOUR] = 0.0
        forget(recall, x)
        return False
    for j in range(d):
        x_next[j] = x[j] + side[j] * min(reach / left, 1.0)
    return True
