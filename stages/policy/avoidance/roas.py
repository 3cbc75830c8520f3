"""The printed strategy: a force like Lorentz's on a charge that moves towards the goal. Paper eqs. (19)-(23).

With d^ the unit vector to the obstacle, v the velocity relative to it and n that to the goal, the printed products of
(19)-(21) are f_o = v_r ((n . d^) v_t - (n . v_t) d^), v = v_r d^ + v_t: orthogonal to n, so V = |x - x_g|^2 falls as it
did. As printed it is nothing head-on (v_t = 0), pulls towards the obstacle where n . v_t < 0, turns its sign where the
state recedes, is infinite at the radius and negative within, never fades far away, and is quadratic in speed: its
strength depends on the unit of length. The paper has xdot on both sides; here it is f(x) on the right. Several
obstacles: the sum. None of this is mended here: `roas_plus.py` is ours.
"""

from __future__ import annotations

from stages.compiled import lean
from stages.policy.avoidance.scratch import ACTIVE, DIRECT, SIDE, SPARE, TOWARD, Avoidance, F, Scratch
from stages.policy.avoidance.shapes import REACH, Shapes
from stages.policy.avoidance.survey import norm
from stages.trajectory import Array


@lean
def lorentz(n: Array, to: Array, rate: Array, out: Array) -> None:
    """Write f_o into `out`, m^2/s^2. Paper eqs. (19)-(21).

    n x (c x ddot) with c the part of ddot across d, by Lagrange's identity c (n . ddot) - ddot (n . c): the same in two
    coordinates, embedded in three.

    Args:
        n: array, shape (d,), unit vector to the goal.
        to: array, shape (d,), d^, unit vector to the obstacle.
        rate: array, shape (d,), ddot, m/s, the obstacle's velocity less the state's.
        out: array, shape (d,). Will be modified.
    """
    radial, along, across = 0.0, 0.0, 0.0
    for j in range(n.shape[0]):
        radial += to[j] * rate[j]
    for j in range(n.shape[0]):
        along += n[j] * rate[j]
        across += n[j] * (rate[j] - radial * to[j])
    for j in range(n.shape[0]):
        out[j] = (rate[j] - radial * to[j]) * along - rate[j] * across


@lean
def repel(avoidance: Avoidance, shapes: Shapes, goal: Array, x: Array, x_next: Array, dt: float, room: Scratch) -> int:
    """Add k_o f_o of every obstacle to the step from x to `x_next`, shape (d,), metres. Paper eqs. (22), (23)."""
    d = x.shape[0]
    f, toward, to = room.vectors[F], room.vectors[TOWARD], room.vectors[SIDE]
    rate, force = room.vectors[DIRECT], room.vectors[SPARE]
    for j in range(d):
        f[j] = (x_next[j] - x[j]) / dt
        toward[j] = goal[j] - x[j]
    left = norm(toward)
    if left == 0.0:
        return ACTIVE
    for j in range(d):
        toward[j] /= left
    for i in range(shapes.kinds.shape[0]):
        for j in range(d):
            to[j] = shapes.centres[i, j] - x[j]
            rate[j] = shapes.velocities[i, j] - f[j]
        away = norm(to)
        for j in range(d):
            to[j] /= away
        lorentz(toward, to, rate, force)
        strength = away / (away - shapes.measures[i, REACH]) * avoidance.gain
        for j in range(d):
            x_next[j] += strength * force[j] * dt
    return ACTIVE
