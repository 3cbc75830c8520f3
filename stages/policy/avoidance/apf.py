"""Artificial potential field: every obstacle pushes within a range. Paper Fig. 4; Khatib, "Real-time obstacle avoidance
for manipulators and mobile robots" (Int. J. of Robotics Research, 1986).

v = f + sum_i gain (range/h_i - 1) (range/h_i)^2 grad h_i for h_i < range, in velocities instead of Khatib's forces.
Where a push balances f the state stands: the attractor is moved, if the goal lies within the range of an obstacle, and
there are others beside it.
"""

from __future__ import annotations

from stages.compiled import lean
from stages.policy.avoidance.scratch import ACTIVE, FREE, SIDE, VELOCITY, Avoidance, F, Scratch
from stages.policy.avoidance.shapes import REACH, Shapes, distance_at
from stages.policy.avoidance.survey import norm
from stages.trajectory import Array

LEAST_CLEAR = 1e-9
"""Metres: nearer, the push grows no more."""


@lean
def push_off(avoidance: Avoidance, shapes: Shapes, x: Array, x_next: Array, dt: float, room: Scratch) -> int:
    """Add every obstacle's push to the step from x to `x_next`, shape (d,), metres; no faster than the speed limit."""
    d, status = x.shape[0], FREE
    f, velocity, normal = room.vectors[F], room.vectors[VELOCITY], room.vectors[SIDE]
    for j in range(d):
        f[j] = (x_next[j] - x[j]) / dt
        velocity[j] = f[j]
    for i in range(shapes.kinds.shape[0]):
        clear = max(distance_at(shapes, i, x, normal), LEAST_CLEAR)
        reach = avoidance.reach if avoidance.reach > 0.0 else shapes.measures[i, REACH]
        if clear < reach:
            status = ACTIVE
            ratio = reach / clear
            for j in range(d):
                velocity[j] += avoidance.gain * (ratio - 1.0) * ratio * ratio * normal[j]
    if status == ACTIVE:
        speed, limit = norm(velocity), max(avoidance.speed_limit, norm(f))
        scale = min(1.0, limit / speed) if speed > 0.0 else 1.0
        for j in range(d):
            x_next[j] = x[j] + scale * velocity[j] * dt
    return status
