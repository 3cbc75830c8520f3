"""ROAS+: one explicit step that enters no obstacle, does not raise V, and does not stop short of the goal.

Everything is in round coordinates y, in which V = |y|^2 (`coordinates.py`); n is the unit vector to the goal, f the
mean velocity of the learned system's own step, h_i the distance of obstacle i.

1. Admissible is a velocity that keeps every row of `survey.py` and the ball |y + v dt| <= |y|, in which V does not
   rise. Where f is, it is taken.
2. Otherwise p is the admissible velocity nearest to f, and q = 1 - |p|/|f| the share of the speed that is lost.
3. Wanted: f's part along n, sped up by q of what f has across n; f's part across n, less q of it; and q k |f| times a
   mean of the directions s_i away from the obstacles across n. In this mean an obstacle counts as w_i/h_i, w_i saying
   how much f heads for it.
4. Taken: the admissible velocity nearest to that.
5. Strict descent: u is the admissible velocity nearest to that straight to the goal at the speed |f|. Where v brings V
   down by less than a tenth of what u does, a tenth of u is mixed in; V is convex, so this restores a tenth.
6. Speed: at most 1.5 |f|; v = 0 is admissible, so slowing down is.

So f is followed as nearly as can be while it makes way, as by a control barrier function, and left where it does not.

Why it converges, for V = |x - x_g|^2 and spheres that stand, are disjoint and do not hold the goal. u = 0 only where n
lies in the cone of the touching obstacles' directions, that is exactly head-on against one sphere: elsewhere V falls in
every step, by at least a tenth of |u|^2 dt^2. Near such a place either f slides off along the sphere, or its speed is
lost, and the steering of that sphere outweighs all others and leads away from its axis; so no path stays there. Exactly
on the axis a fixed perpendicular breaks the tie. What a learned V adds is in `traps.py` and `detour.py`, what moving
obstacles add in `yielding.py`.
"""

from __future__ import annotations

from stages.compiled import lean
from stages.dynamics.kernels import ModelArrays, Workspace, lyapunov_at
from stages.policy.avoidance.coordinates import apply, length_in_x, round_about, round_of, rows_in_y
from stages.policy.avoidance.projection import nearest
from stages.policy.avoidance.scratch import (
    ACTIVE,
    BACK,
    BOUND,
    CENTRE,
    CLEAR,
    DIRECT,
    FORWARD,
    FREE,
    ROW,
    SIDE,
    SPARE,
    TOWARD,
    VELOCITY,
    WANTED,
    WEIGHT,
    Avoidance,
    F,
    Scratch,
    Y,
)
from stages.policy.avoidance.shapes import Shapes
from stages.policy.avoidance.survey import norm, survey
from stages.policy.avoidance.yielding import give_way, keep_way_out, moves
from stages.trajectory import Array

DESCENT = 0.1
"""Share of the possible fall of V that every step keeps. Larger hugs obstacles and cuts corners, smaller is slower."""

HEAD_ON = 1e-3
"""Sine of the angle to an obstacle's axis below which the direction away from it is taken from f."""

LEAST_CLEAR = 1e-12
"""Metres; a distance counts as at least this when obstacles are weighed against each other."""

_MOST_TRIALS = 60


@lean
def steer_about(
    avoidance: Avoidance, shapes: Shapes, goal: Array, x: Array, x_next: Array, dt: float, room: Scratch
) -> int:
    """Lead a step from x towards `goal` round all obstacles, with V = |x - goal|^2.

    Args:
        avoidance: of ROAS+.
        shapes: obstacles, where they are now.
        goal, x: arrays, shape (d,), metres.
        x_next: array, shape (d,), metres: where the step leads without obstacles. Will be modified.
        dt: seconds.
        room: will be modified.

    Returns:
        FREE where `x_next` is as it was, to the bit; ACTIVE, YIELDING, INFEASIBLE or TOO_FAST.
    """
    status = FREE
    if not survey(avoidance, shapes, x, x_next, dt, room):
        round_about(goal, x, room)
        status = _admit(avoidance, x, x_next, dt, room)
    return keep_way_out(avoidance, shapes, x, x_next, dt, room, status) if moves(shapes) else status


@lean
def steer_along(
    avoidance: Avoidance,
    shapes: Shapes,
    model: ModelArrays,
    factor: Array,
    x: Array,
    x_next: Array,
    dt: float,
    kernels: Workspace,
    room: Scratch,
) -> int:
    """As `steer_about`, with the goal and the V of a learned system; `factor`: L', shape (d, d), with P = L L'."""
    status = FREE
    if not survey(avoidance, shapes, x, x_next, dt, room):
        round_of(model, factor, x, kernels, room)
        status = _admit(avoidance, x, x_next, dt, room)
        if status == ACTIVE and model.rates.shape[0] > 0:
            _straighten(avoidance, model, x, x_next, dt, kernels, room)
    return keep_way_out(avoidance, shapes, x, x_next, dt, room, status) if moves(shapes) else status


@lean
def _admit(avoidance: Avoidance, x: Array, x_next: Array, dt: float, room: Scratch) -> int:
    """Steps 2 to 6, after the survey and with its coordinates."""
    m, d = room.tables.shape[1:]
    wanted, velocity, spare = room.vectors[WANTED], room.vectors[VELOCITY], room.vectors[SPARE]
    speed, away = norm(room.vectors[F]), norm(room.vectors[Y])
    rows_in_y(room)
    for j in range(d):
        room.vectors[TOWARD, j] = -room.vectors[Y, j] / away if away > 0.0 else 0.0
        room.vectors[CENTRE, j] = -room.vectors[Y, j] / dt
    stands = True
    for i in range(m):
        stands = stands and room.columns[BOUND, i] >= 0.0
    apply(room.matrices[FORWARD], room.vectors[F], wanted)
    admitted = nearest(wanted, room, m, away / dt, velocity)
    lost = 1.0 - length_in_x(velocity, room) / speed if admitted and speed > 0.0 else 0.0
    if lost > 0.0 and away > 0.0:
        _want(lost, room)
        _steer(avoidance, lost, speed, room)
        admitted = nearest(wanted, room, m, away / dt, velocity)
    if not admitted and stands:  # to rounding, at the tip of a cone: standing is admissible
        velocity[:] = 0.0
        admitted = True
    if admitted:
        _descend(away, speed, dt, room)
        apply(room.matrices[BACK], velocity, spare)
        reached, most = norm(spare), min(avoidance.swiftness * speed, avoidance.fastest)
        if stands or reached <= max(most, avoidance.speed_limit):
            scale = most / reached if stands and reached > most else 1.0
            for j in range(d):
                x_next[j] = x[j] + scale * spare[j] * dt
            return ACTIVE
    apply(room.matrices[BACK], wanted, spare)
    for j in range(d):
        wanted[j] = spare[j]
    return give_way(avoidance, x, x_next, dt, room)


@lean
def _want(lost: float, room: Scratch) -> None:
    """Turn f (WANTED) to the goal by the share that is lost; f across n stays in SIDE. Step 3."""
    toward, side, wanted = room.vectors[TOWARD], room.vectors[SIDE], room.vectors[WANTED]
    d, along = wanted.shape[0], 0.0
    for j in range(d):
        along += wanted[j] * toward[j]
    for j in range(d):
        side[j] = wanted[j] - along * toward[j]
    quicker = lost * length_in_x(side, room) / length_in_x(toward, room)
    for j in range(d):
        wanted[j] = (along + quicker) * toward[j] + (1.0 - lost) * side[j]


@lean
def _steer(avoidance: Avoidance, lost: float, speed: float, room: Scratch) -> None:
    """Add the steering away from obstacles to the wanted velocity. Step 3."""
    m, d = room.tables.shape[1:]
    clear, weights, direct = room.columns[CLEAR], room.columns[WEIGHT], room.vectors[DIRECT]
    total = 0.0
    for i in range(m):
        total += weights[i] / max(clear[i], LEAST_CLEAR)
    for i in range(m):
        if weights[i] > 0.0:
            _away_from(room.tables[ROW, i], room)
            share = weights[i] / max(clear[i], LEAST_CLEAR) / total
            pace = avoidance.gain * speed * lost * share / length_in_x(direct, room)
            for j in range(d):
                room.vectors[WANTED, j] += pace * direct[j]


@lean
def _away_from(row: Array, room: Scratch) -> None:
    """Write the unit vector across n that leads away from an obstacle's axis (DIRECT). `row`: towards it."""
    toward, direct, spare = room.vectors[TOWARD], room.vectors[DIRECT], room.vectors[SPARE]
    d, along = row.shape[0], 0.0
    for j in range(d):
        along += row[j] * toward[j]
    for j in range(d):
        direct[j] = along * toward[j] - row[j]
    length = norm(direct)
    if length < HEAD_ON:
        for j in range(d):
            direct[j] = room.vectors[SIDE, j]
        length = norm(direct)
        apply(room.matrices[FORWARD], room.vectors[F], spare)
        if length <= HEAD_ON * norm(spare):
            axis = 0
            for j in range(d):
                if abs(toward[j]) < abs(toward[axis]):
                    axis = j
            for j in range(d):
                direct[j] = (1.0 if j == axis else 0.0) - toward[axis] * toward[j]
            length = norm(direct)
    for j in range(d):
        direct[j] /= length


@lean
def _descend(away: float, speed: float, dt: float, room: Scratch) -> None:
    """Mix the velocity straight to the goal in where V would fall by too little. Step 4."""
    if away == 0.0:
        return
    velocity, direct, most = room.vectors[VELOCITY], room.vectors[DIRECT], _aim_straight(away, speed, dt, room)
    fall = _fall(away, velocity, dt, room)
    if fall >= DESCENT * most * (2.0 * away - most):
        return
    if not nearest(room.vectors[SIDE], room, room.tables.shape[1], away / dt, direct):
        return
    if fall < DESCENT * _fall(away, direct, dt, room):
        for j in range(velocity.shape[0]):
            velocity[j] = (1.0 - DESCENT) * velocity[j] + DESCENT * direct[j]


@lean
def _aim_straight(away: float, speed: float, dt: float, room: Scratch) -> float:
    """Write the velocity straight to the goal at `speed`, m/s, no farther than it (SIDE); return its way, metres."""
    toward = room.vectors[TOWARD]
    most = min(speed / length_in_x(toward, room) * dt, away)
    for j in range(toward.shape[0]):
        room.vectors[SIDE, j] = toward[j] * most / dt
    return most


@lean
def _fall(away: float, velocity: Array, dt: float, room: Scratch) -> float:
    """By how much a step brings V = |y|^2 down, square metres."""
    left = 0.0
    for j in range(velocity.shape[0]):
        left += (room.vectors[Y, j] + dt * velocity[j]) ** 2
    return away * away - left


@lean
def _straighten(
    avoidance: Avoidance, model: ModelArrays, x: Array, x_next: Array, dt: float, kernels: Workspace, room: Scratch
) -> None:
    """Where the bend of a warp lets V rise, turn the step to the straight way to the goal, then shorten it."""
    before = lyapunov_at(x, model, kernels)
    if lyapunov_at(x_next, model, kernels) <= before:
        return
    d, away, speed = x.shape[0], norm(room.vectors[Y]), norm(room.vectors[F])
    velocity, direct, spare = room.vectors[VELOCITY], room.vectors[DIRECT], room.vectors[SPARE]
    for j in range(d):
        velocity[j] = (x_next[j] - x[j]) / dt
    _aim_straight(away, speed, dt, room)
    if not nearest(room.vectors[SIDE], room, room.tables.shape[1], away / dt, direct):
        direct[:] = 0.0
    apply(room.matrices[BACK], direct, spare)
    reached, most, scale = norm(spare), min(avoidance.swiftness * speed, avoidance.fastest), 1.0
    if reached > most:
        for j in range(d):
            spare[j] *= most / reached
    for k in range(1, _MOST_TRIALS):
        share = min(0.25 * k, 1.0)
        scale = 1.0 if k <= 4 else 0.7 * scale
        for j in range(d):
            x_next[j] = x[j] + scale * ((1.0 - share) * velocity[j] + share * spare[j]) * dt
        if lyapunov_at(x_next, model, kernels) <= before:
            return
    for j in range(d):
        x_next[j] = x[j]
