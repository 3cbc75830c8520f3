"""Moving obstacles: V is given up before clearance is, and no step is taken after which there is no way out.

Two things that standing obstacles never need. `give_way`: rows that ask the state to move off may contradict the ball
of V, or a speed limit; then V may rise (YIELDING); where nothing keeps all rows, the velocity that misses them least is
taken and said so (INFEASIBLE; TOO_FAST where only the speed limit is in the way). `keep_way_out`: spheres that close
in can leave no way out of where the state is about to go. So a step is taken only if, from its end, some simple plan
(stand, or flee in a fixed direction) keeps all rows until everything recedes or the horizon is reached; otherwise the
plan that lasts longest is followed. As the velocities are known this is a look ahead, not a guess.
"""

from __future__ import annotations

from stages.compiled import lean
from stages.policy.avoidance.projection import nearest
from stages.policy.avoidance.scratch import (
    BOUND,
    CENTRE,
    DIRECT,
    INFEASIBLE,
    LIMIT,
    NORMAL,
    PLAN,
    ROW,
    SIDE,
    SPARE,
    TOO_FAST,
    VELOCITY,
    WANTED,
    YIELDING,
    Avoidance,
    F,
    Scratch,
)
from stages.policy.avoidance.shapes import Shapes, distance_at
from stages.policy.avoidance.survey import norm, rows_in_x
from stages.trajectory import Array

HORIZON = 20
"""Steps of 1/rate seconds that a plan is followed ahead: 2 s at the default rate."""

CAUTION = 0.5
"""Share of the rate in a plan: a row that is kept with half the rate over 1/rate seconds, all at once, is kept with the
full rate at any moment of them."""

_HALVINGS = 30


@lean
def moves(shapes: Shapes) -> bool:
    """Whether any obstacle moves."""
    for i in range(shapes.kinds.shape[0]):
        for j in range(shapes.velocities.shape[1]):
            if shapes.velocities[i, j] != 0.0:
                return True
    return False


@lean
def top_speed(avoidance: Avoidance, room: Scratch) -> float:
    """The fastest that may be gone to give way, m/s."""
    return min(max(avoidance.swiftness * norm(room.vectors[F]), avoidance.speed_limit), avoidance.fastest)


@lean
def give_way(avoidance: Avoidance, x: Array, x_next: Array, dt: float, room: Scratch) -> int:
    """Write the step with the velocity nearest to that wanted, m/s, that keeps all surveyed rows, whatever V does."""
    m, d = room.tables.shape[1:]
    velocity, direct, limit = room.vectors[VELOCITY], room.vectors[DIRECT], top_speed(avoidance, room)
    rows_in_x(room)
    room.vectors[CENTRE] = 0.0
    status = YIELDING
    if not nearest(room.vectors[WANTED], room, m, limit, velocity):
        direct[:] = 0.0
        status = TOO_FAST if nearest(direct, room, m, float("inf"), velocity) else INFEASIBLE
        _miss_least(limit, room)
    for j in range(d):
        x_next[j] = x[j] + velocity[j] * dt
    return status


@lean
def _miss_least(limit: float, room: Scratch) -> None:
    """Write the velocity within the limit that misses the rows by least (VELOCITY), by bisection. DIRECT is 0."""
    m, bounds, limits = room.tables.shape[1], room.columns[BOUND], room.columns[LIMIT]
    velocity, direct = room.vectors[VELOCITY], room.vectors[DIRECT]
    low, high = 0.0, 0.0
    for i in range(m):
        high = max(high, -bounds[i])  # standing still misses no row by more
    for step in range(_HALVINGS + 1):
        middle = 0.5 * (low + high) if step < _HALVINGS else high
        for i in range(m):
            limits[i] = bounds[i] + middle
        if nearest(direct, room, m, limit, velocity):
            high = middle
        elif step < _HALVINGS:
            low = middle
        else:
            velocity[:] = 0.0


@lean
def keep_way_out(
    avoidance: Avoidance, shapes: Shapes, x: Array, x_next: Array, dt: float, room: Scratch, status: int
) -> int:
    """Take the step to `x_next` only if a plan lasts from there; otherwise follow the plan that lasts longest."""
    plans, good, limit = room.directions.shape[0] + 1, room.integers[PLAN], top_speed(avoidance, room)
    for k in range(plans):
        plan = (good + k) % plans
        if _lasts(avoidance, shapes, plan, x_next, dt, limit, room) == HORIZON:
            room.integers[PLAN] = plan
            return status
    longest, best = -1, 0
    for k in range(plans):
        plan = (good + k) % plans
        lasted = _lasts(avoidance, shapes, plan, x, 0.0, limit, room)
        if lasted > longest:
            longest, best = lasted, plan
        if lasted == HORIZON:
            break
    room.integers[PLAN] = best
    _aim(best, limit, room)
    for i in range(shapes.kinds.shape[0]):
        distance_at(shapes, i, x, room.tables[NORMAL, i])
    return max(give_way(avoidance, x, x_next, dt, room), status)


@lean
def _aim(plan: int, limit: float, room: Scratch) -> None:
    """Write what a plan wants, m/s: 0 stands, k flees along direction k - 1."""
    for j in range(room.vectors.shape[1]):
        room.vectors[WANTED, j] = limit * room.directions[plan - 1, j] if plan > 0 else 0.0


@lean
def _lasts(
    avoidance: Avoidance, shapes: Shapes, plan: int, start: Array, time: float, limit: float, room: Scratch
) -> int:
    """Return for how many steps a plan keeps clear from `start`, shape (d,), metres, `time` seconds from now."""
    m, d = room.tables.shape[1:]
    at, relative, velocity = room.vectors[DIRECT], room.vectors[SPARE], room.vectors[SIDE]
    step = 1.0 / avoidance.rate
    for j in range(d):
        at[j] = start[j]
    room.vectors[CENTRE] = 0.0
    for k in range(HORIZON):
        recedes = True
        for i in range(m):
            normal = room.tables[NORMAL, i]
            for j in range(d):
                relative[j] = at[j] - shapes.velocities[i, j] * time
            clear = distance_at(shapes, i, relative, normal) - avoidance.margin
            carried = 0.0
            for j in range(d):
                carried -= normal[j] * shapes.velocities[i, j]
                room.tables[ROW, i, j] = -normal[j]
            if clear < 0.0:
                return k
            room.columns[LIMIT, i] = CAUTION * avoidance.rate * clear + carried
            recedes = recedes and carried >= 0.0
        if recedes:
            return HORIZON
        _aim(plan, limit, room)
        if not nearest(room.vectors[WANTED], room, m, limit, velocity):
            return k
        for j in range(d):
            at[j] += step * velocity[j]
        time += step
    return HORIZON
