"""Kinematics of a serial arm: where its tip is, its Jacobian, and the joint motion that moves the tip. Compiled.

Not here: which arm (`robots.py`), and its dynamics, which the simulator knows (`bullet.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stages.compiled import compiled
from stages.dynamics.kernels import solve_in_place
from stages.trajectory import Array

DAMPING = 1e-5
"""Of damped least squares, squared: a singular value below 3 mm/rad is left alone."""


class Chain(NamedTuple):
    """n joints in a row, of which m turn; the tip last.

    Attributes:
        place: array, shape (3,), metres, of the base in the world.
        rotations: array, shape (n, 3, 3), of each joint's frame in the one before.
        offsets: array, shape (n, 3), metres, of each joint's frame in the one before.
        axes: array, shape (n, 3), unit vectors about which joints turn.
        turns: array of bool, shape (n,): it turns; else it is fixed.
        tip: array, shape (3,), metres, in the last frame.
    """

    place: Array
    rotations: Array
    offsets: Array
    axes: Array
    turns: NDArray[np.bool_]
    tip: Array


@compiled
def forward(chain: Chain, q: Array, position: Array, rotation: Array, jacobian: Array) -> None:
    """Write where the tip is, and how it moves.

    Args:
        chain: the arm.
        q: array, shape (m,), rad.
        position: array, shape (3,), metres. Will be modified.
        rotation: array, shape (3, 3). Will be modified.
        jacobian: array, shape (6, m): velocity, m/s, and angular velocity, rad/s, for joint velocities. Will be
            modified.
    """
    frame, at = np.eye(3), chain.place.copy()
    m, joint = q.shape[0], 0
    origins = np.empty((m, 3))
    for i in range(chain.rotations.shape[0]):
        at = at + frame @ chain.offsets[i]
        frame = frame @ chain.rotations[i]
        if chain.turns[i]:
            axis = chain.axes[i]
            origins[joint] = at
            jacobian[3:, joint] = frame @ axis
            frame = frame @ turned(axis, q[joint])
            joint += 1
    at = at + frame @ chain.tip
    position[:] = at
    rotation[:] = frame
    for k in range(m):
        arm, axis = at - origins[k], jacobian[3:, k].copy()
        jacobian[0, k] = axis[1] * arm[2] - axis[2] * arm[1]
        jacobian[1, k] = axis[2] * arm[0] - axis[0] * arm[2]
        jacobian[2, k] = axis[0] * arm[1] - axis[1] * arm[0]


@compiled
def turn_between(wanted: Array, actual: Array) -> Array:
    """The rotation vector, rad, for small angles, that turns `actual` to `wanted`, both shape (3, 3)."""
    result = np.zeros(3)
    for k in range(3):
        a, b = actual[:, k], wanted[:, k]
        result[0] += 0.5 * (a[1] * b[2] - a[2] * b[1])
        result[1] += 0.5 * (a[2] * b[0] - a[0] * b[2])
        result[2] += 0.5 * (a[0] * b[1] - a[1] * b[0])
    return result


@compiled
def joint_velocity(jacobian: Array, twist: Array, pull: Array) -> Array:
    """Joint velocities, rad/s, shape (m,), that move the tip by `twist` and otherwise follow `pull`.

    Damped least squares, and `pull` in the null space of what the tip does.

    Args:
        jacobian: array, shape (6, m).
        twist: array, shape (6,), m/s and rad/s.
        pull: array, shape (m,), rad/s.
    """
    gram = jacobian @ jacobian.T
    for i in range(6):
        gram[i, i] += DAMPING
    needed = twist - jacobian @ pull
    solve_in_place(gram, needed)
    return pull + jacobian.T @ needed


@compiled
def reach(chain: Chain, q: Array, position: Array, rotation: Array, steps: int, accuracy: float) -> float:
    """Move q, shape (m,), rad, so that the tip comes to a pose; return what is missing, metres or rad, the larger.

    `q`: will be modified. `position`: shape (3,), metres. `rotation`: shape (3, 3).
    """
    at, frame, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, q.shape[0]))
    pull, error = np.zeros(q.shape[0]), np.empty(6)
    missing = np.inf
    for _ in range(steps):
        forward(chain, q, at, frame, jacobian)
        error[:3] = position - at
        error[3:] = turn_between(rotation, frame)
        missing = np.abs(error).max()
        if missing <= accuracy:
            break
        q += joint_velocity(jacobian, error, pull)
    return missing


@compiled
def lean_away(chain: Chain, q: Array, centre: Array, radius: float, near: float, gain: float, pull: Array) -> None:
    """Add to `pull` what leads an arm's links away from a ball that is nearer than `near`. Khatib (1986), in joints.

    A link is the straight line between the origins of two joints that follow each other, the last one to the tip. Each
    is pushed at its point nearest to the ball.

    Args:
        chain: the arm.
        q: array, shape (m,), rad.
        centre: array, shape (3,), metres, of the ball.
        radius: of the ball, metres.
        near: metres from its surface at which pushing begins.
        gain: 1/s: a link at the surface is pushed at gain x near.
        pull: array, shape (m,), rad/s: J'v of the points that are pushed, v in m/s, for arms about 1 m long. Will be
            modified.
    """
    m = q.shape[0]
    places, axes = np.empty((m + 1, 3)), np.empty((m, 3))
    frame, at, joint = np.eye(3), chain.place.copy(), 0
    for i in range(chain.rotations.shape[0]):
        at = at + frame @ chain.offsets[i]
        frame = frame @ chain.rotations[i]
        if chain.turns[i]:
            places[joint], axes[joint] = at, frame @ chain.axes[i]
            frame = frame @ turned(chain.axes[i], q[joint])
            joint += 1
    places[m] = at + frame @ chain.tip
    for j in range(m):
        along = places[j + 1] - places[j]
        length = (along**2).sum()
        share = 0.0 if length == 0.0 else min(max(((centre - places[j]) @ along) / length, 0.0), 1.0)
        point = places[j] + share * along
        away = point - centre
        distance = math.sqrt((away**2).sum())
        room = distance - radius
        if room >= near or distance == 0.0:
            continue
        speed = gain * min(near - room, near)
        for k in range(j + 1):
            arm, axis = point - places[k], axes[k]
            pull[k] += (speed / distance) * (
                away[0] * (axis[1] * arm[2] - axis[2] * arm[1])
                + away[1] * (axis[2] * arm[0] - axis[0] * arm[2])
                + away[2] * (axis[0] * arm[1] - axis[1] * arm[0])
            )


@compiled
def turned(axis: Array, angle: float) -> Array:
    """The matrix, shape (3, 3), of a turn by `angle`, rad, about a unit vector, shape (3,). Rodrigues."""
    cosine, sine = math.cos(angle), math.sin(angle)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    matrix: Array = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    return matrix
