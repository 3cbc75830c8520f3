"""Round coordinates: y = L'psi(x), with P = L L', in which V = |y|^2 whatever V was learned.

Avoidance is thought out in them: V does not rise where y stays in a ball about the goal, and nothing else of V is used.
With V = |x - x_g|^2 they are the state relative to the goal; with a learned P they are linear; with a warp the velocity
is carried over by its Jacobian, and what the bend adds is checked after the step.
"""

from __future__ import annotations

from stages.compiled import lean
from stages.dynamics.kernels import ModelArrays, Workspace, image_and_jacobian
from stages.policy.avoidance.scratch import BACK, BOUND, FORWARD, LIMIT, NORMAL, ROW, SPARE, Scratch, Y
from stages.policy.avoidance.survey import norm
from stages.trajectory import Array


@lean
def round_about(goal: Array, x: Array, room: Scratch) -> None:
    """Take V = |x - goal|^2: coordinates relative to any goal. `goal`, `x`: shape (d,), metres."""
    for i in range(x.shape[0]):
        room.vectors[Y, i] = x[i] - goal[i]
        for j in range(x.shape[0]):
            room.matrices[FORWARD, i, j] = room.matrices[BACK, i, j] = 1.0 if i == j else 0.0


@lean
def round_of(model: ModelArrays, factor: Array, x: Array, kernels: Workspace, room: Scratch) -> None:
    """Take the model's own V. `factor`: L', shape (d, d). `x`: shape (d,), metres. `kernels`: of the model."""
    d, y, forward = x.shape[0], room.vectors[Y], room.matrices[FORWARD]
    image_and_jacobian(x, model, kernels)
    for i in range(d):
        y[i] = 0.0
        for j in range(d):
            y[i] += factor[i, j] * kernels.psi[j]
            forward[i, j] = 0.0
            for k in range(d):
                forward[i, j] += factor[i, k] * kernels.jacobian[k, j]
    invert(forward, room.matrices[BACK], kernels.jacobian)


@lean
def invert(matrix: Array, inverse: Array, room: Array) -> None:
    """Write the inverse of `matrix`, shape (d, d), into `inverse`, by elimination with pivoting; `room`: (d, d)."""
    d = matrix.shape[0]
    for i in range(d):
        for j in range(d):
            room[i, j] = matrix[i, j]
            inverse[i, j] = 1.0 if i == j else 0.0
    for c in range(d):
        pivot = c
        for i in range(c + 1, d):
            if abs(room[i, c]) > abs(room[pivot, c]):
                pivot = i
        if pivot != c:
            for j in range(d):
                room[c, j], room[pivot, j] = room[pivot, j], room[c, j]
                inverse[c, j], inverse[pivot, j] = inverse[pivot, j], inverse[c, j]
        scale = 1.0 / room[c, c]
        for j in range(d):
            room[c, j] *= scale
            inverse[c, j] *= scale
        for i in range(d):
            if i != c:
                factor = room[i, c]
                for j in range(d):
                    room[i, j] -= factor * room[c, j]
                    inverse[i, j] -= factor * inverse[c, j]


@lean
def apply(matrix: Array, vector: Array, out: Array) -> None:
    """Write matrix x vector into `out`: shapes (d, d), (d,), (d,)."""
    for i in range(vector.shape[0]):
        out[i] = 0.0
        for j in range(vector.shape[0]):
            out[i] += matrix[i, j] * vector[j]


@lean
def rows_in_y(room: Scratch) -> None:
    """Make the surveyed rows those of the program, for velocities in round coordinates, as unit vectors."""
    m, d = room.tables.shape[1:]
    back, normals = room.matrices[BACK], room.tables[NORMAL]
    for i in range(m):
        row = room.tables[ROW, i]
        for j in range(d):
            row[j] = 0.0
            for k in range(d):
                row[j] -= back[k, j] * normals[i, k]
        length = norm(row)
        for j in range(d):
            row[j] /= length
        room.columns[LIMIT, i] = room.columns[BOUND, i] / length


@lean
def length_in_x(vector: Array, room: Scratch) -> float:
    """Length in metres (or m/s) of a vector in round coordinates, shape (d,)."""
    apply(room.matrices[BACK], vector, room.vectors[SPARE])
    return norm(room.vectors[SPARE])
