"""One step of whichever method keeps a step away from obstacles, and the state that a robot executes clear of them.

Not here: the methods themselves, each in a file of its own.
"""

from __future__ import annotations

import math

from stages.compiled import lean
from stages.dynamics.kernels import lyapunov_at
from stages.policy.avoidance.apf import push_off
from stages.policy.avoidance.cbf import keep_clear
from stages.policy.avoidance.detour import (
    DETOUR,
    HESITATION,
    PATIENCE,
    WAYPOINT,
    Memory,
    begin_detour,
    detour_step,
    forget,
    without_progress,
)
from stages.policy.avoidance.modulation import modulate
from stages.policy.avoidance.roas import repel
from stages.policy.avoidance.roas_plus import steer_about, steer_along
from stages.policy.avoidance.scratch import (
    APF,
    CBF,
    DETOURING,
    FREE,
    MODULATION,
    NONE,
    ROAS_PLUS,
    SIDE,
    SPARE,
    TRAPPED,
    Avoidance,
    Scratch,
)
from stages.policy.avoidance.shapes import Shapes, distance_at, nearest_on_way
from stages.policy.avoidance.yielding import moves
from stages.policy.field import Field, Work
from stages.trajectory import Array

TOUCH = 1e-9
"""Metres: a state counts as inside of an obstacle only if it is deeper, and a way as blocked."""

LEAST_PACE = 0.1
"""A detour is at least this fast, as a share of the speed limit: where a state is trapped, f may be almost nothing."""


@lean
def avoid(
    avoidance: Avoidance,
    shapes: Shapes,
    field: Field,
    x: Array,
    x_next: Array,
    dt: float,
    work: Work,
    room: Scratch,
    recall: Memory,
) -> int:
    """Lead a step of the state x of a learned system round all obstacles.

    Args:
        avoidance: the method.
        shapes: obstacles, where they are now.
        field: the learned system.
        x: array, shape (d,), metres.
        x_next: array, shape (d,), metres: where the step leads without obstacles. Will be modified.
        dt: seconds.
        work: of the field. Will be modified.
        room: will be modified.
        recall: what happened before. Will be modified.

    Returns:
        FREE where `x_next` is as it was, to the bit; ACTIVE where it was changed; DETOURING or YIELDING where V may
        rise; INFEASIBLE or TOO_FAST where a row is missed; TRAPPED where nothing has moved for a second.
    """
    if avoidance.kind == NONE or shapes.kinds.shape[0] == 0:
        return FREE
    model, kernels = field.model, work.model
    way = _gap(x, x_next)
    if recall.numbers[DETOUR] > 0.0 and detour_step(
        shapes, avoidance.margin, model, x, dt, kernels, recall, room, x_next
    ):
        return _on_detour(avoidance, shapes, x, x_next, dt, room, recall)
    if avoidance.kind == ROAS_PLUS:
        status = steer_along(avoidance, shapes, model, field.factor, x, x_next, dt, kernels, room)
    elif avoidance.kind == CBF:
        status = keep_clear(avoidance, shapes, x, x_next, dt, room)
    elif avoidance.kind == APF:
        status = push_off(avoidance, shapes, x, x_next, dt, room)
    elif avoidance.kind == MODULATION:
        status = modulate(avoidance, shapes, x, x_next, dt, room)
    else:
        status = repel(avoidance, shapes, model.goal, x, x_next, dt, room)
    if status == FREE:
        forget(recall, x_next)
        return FREE
    before, after = lyapunov_at(x, model, kernels), lyapunov_at(x_next, model, kernels)
    idle = without_progress(recall, x_next, way, before, after, dt)
    if idle >= HESITATION and avoidance.detour and recall.numbers[DETOUR] == 0.0:
        pace = max(way / dt, LEAST_PACE * avoidance.speed_limit)
        if begin_detour(shapes, avoidance.margin, model, x_next, pace, kernels, recall, room):
            return status
    return TRAPPED if idle >= PATIENCE and not moves(shapes) else status


@lean
def _on_detour(
    avoidance: Avoidance, shapes: Shapes, x: Array, x_next: Array, dt: float, room: Scratch, recall: Memory
) -> int:
    """A step towards the waypoint, whose V is the squared distance from it."""
    goal = recall.places[WAYPOINT]
    way, before = _gap(x, x_next), _gap(x, goal) ** 2
    status = steer_about(avoidance, shapes, goal, x, x_next, dt, room)
    if status == FREE:
        forget(recall, x_next)
        return DETOURING
    idle = without_progress(recall, x_next, way, before, _gap(x_next, goal) ** 2, dt)
    if idle >= PATIENCE and not moves(shapes):
        for j in range(x.shape[0]):  # the learned V could rise, and no detour would say so
            x_next[j] = x[j]
        return TRAPPED
    return max(status, DETOURING)


@lean
def escort(
    avoidance: Avoidance, shapes: Shapes, x: Array, p_hat: Array, p_next: Array, dt: float, room: Scratch
) -> int:
    """Keep the executed state clear of obstacles on its way to x, for the methods that can: ROAS+ and CBF.

    In sight of x it goes straight, as the follower wants, or as nearly as its rows allow; otherwise ROAS+ leads it
    round, with x as its goal: V = |p_hat - x|^2 has no traps on spheres.

    Args:
        avoidance: the method.
        shapes: obstacles, where they are now.
        x, p_hat: arrays, shape (d,), metres.
        p_next: array, shape (d,), metres: where the follower leads. Will be modified.
        dt: seconds.
        room: will be modified.

    Returns:
        As `avoid`; FREE where `p_next` is as it was, to the bit.
    """
    if avoidance.kind not in (ROAS_PLUS, CBF):
        return FREE
    kept, sight, way = True, True, _gap(p_hat, p_next)
    for i in range(shapes.kinds.shape[0]):
        clear = distance_at(shapes, i, p_hat, room.vectors[SIDE]) - avoidance.margin
        closing = 0.0
        for j in range(x.shape[0]):
            closing -= room.vectors[SIDE][j] * (p_next[j] - p_hat[j] - shapes.velocities[i, j] * dt)
        kept = kept and closing <= avoidance.rate * dt * clear + TOUCH * (way + dt)
        sight = (
            sight
            and nearest_on_way(shapes, i, p_hat, x, room.vectors[SPARE], room.vectors[SIDE]) >= avoidance.margin - TOUCH
        )
    if sight:
        return FREE if kept else keep_clear(avoidance, shapes, p_hat, p_next, dt, room)
    if avoidance.kind == CBF:
        return keep_clear(avoidance, shapes, p_hat, p_next, dt, room)
    return steer_about(avoidance, shapes, x, p_hat, p_next, dt, room)


@lean
def _gap(a: Array, b: Array) -> float:
    """Distance of two states, shape (d,), metres."""
    squared = 0.0
    for j in range(a.shape[0]):
        squared += (a[j] - b[j]) ** 2
    return math.sqrt(squared)
