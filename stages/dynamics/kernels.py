"""The LPV-DS for one state in compiled code: eq. (6), the Cayley step and the explicit Euler step.

Roll-outs are built of these. Nothing is allocated: a caller makes `workspace(model)` once and hands it in. Any
dimension up to 7 or so: the linear solve is a small elimination. Not here: the model's public face (`lpvds.py`).
"""

from __future__ import annotations

from typing import NamedTuple

from stages.compiled import compiled
from stages.mixture.gaussian import responsibilities_at
from stages.trajectory import Array


class ModelArrays(NamedTuple):
    """A model in the form that compiled code takes it.

    Attributes:
        offsets, means, whiteners: shapes (K,), (K, d), (K, d, d), as of `stages.mixture.gaussian.Whitening`.
        matrices: shape (K, d, d), A_k, 1/s.
        goal: shape (d,), x_g, metres.
        lyapunov_matrix: shape (d, d), P.
    """

    offsets: Array
    means: Array
    whiteners: Array
    matrices: Array
    goal: Array
    lyapunov_matrix: Array


class Workspace(NamedTuple):
    """Buffers of one evaluation; both will be modified by every kernel.

    Attributes:
        gamma: shape (K,), responsibilities of the last state.
        A: shape (d, d), the blended matrix of the last state, overwritten by a step.
    """

    gamma: Array
    A: Array


@compiled
def blend(x: Array, model: ModelArrays, work: Workspace) -> None:
    """Write A(x) = sum_k gamma_k(x) A_k, 1/s, into `work.A`, and gamma(x) into `work.gamma`. Paper eq. (6).

    `x`: shape (d,), metres.
    """
    gamma, A = work
    matrices = model.matrices
    K, d, _ = matrices.shape
    responsibilities_at(x, model.offsets, model.means, model.whiteners, gamma)
    for i in range(d):
        for j in range(d):
            total = 0.0
            for k in range(K):
                total += gamma[k] * matrices[k, i, j]
            A[i, j] = total


@compiled
def velocity_at(x: Array, model: ModelArrays, work: Workspace, out: Array) -> None:
    """Write f(x) = A(x) (x - x_g), m/s, into `out`, shape (d,). Paper eq. (6). `x`: shape (d,), metres."""
    blend(x, model, work)
    goal = model.goal
    for i in range(goal.shape[0]):
        total = 0.0
        for j in range(goal.shape[0]):
            total += work.A[i, j] * (x[j] - goal[j])
        out[i] = total


@compiled
def lyapunov_at(x: Array, goal: Array, lyapunov_matrix: Array) -> float:
    """Return V(x) = (x - x_g)'P (x - x_g). `x`, `goal`: shape (d,), metres; `lyapunov_matrix`: shape (d, d)."""
    total = 0.0
    for i in range(goal.shape[0]):
        for j in range(goal.shape[0]):
            total += (x[i] - goal[i]) * lyapunov_matrix[i, j] * (x[j] - goal[j])
    return total


@compiled
def cayley_step(x: Array, goal: Array, A: Array, h: float, out: Array) -> None:
    """Write the state after a Cayley step into `out`, shape (d,), metres: (I - h A/2) z+ = (I + h A/2) z, z = x - x_g.

    With w = (z + z+)/2, (I - h A/2) w = z and x+ = x + 2 (w - z), so h = 0 returns x to the last bit. V(x+) <= V(x) for
    every h >= 0 if A'P + PA < 0, as V+ - V = h w'(A'P + PA) w.

    `x`, `goal`: shape (d,), metres. `A`: shape (d, d), 1/s, will be modified. `h`: seconds, the gate included. `out`
    must not be `x`. A matrix that is singular to working precision, which a certified A never gives, makes `out` not
    finite.
    """
    d = goal.shape[0]
    for i in range(d):
        out[i] = x[i] - goal[i]
        for j in range(d):
            A[i, j] *= -0.5 * h
        A[i, i] += 1.0
    for c in range(d):
        pivot = c
        for i in range(c + 1, d):
            if abs(A[i, c]) > abs(A[pivot, c]):
                pivot = i
        if pivot != c:
            for j in range(c, d):
                A[c, j], A[pivot, j] = A[pivot, j], A[c, j]
            out[c], out[pivot] = out[pivot], out[c]
        for i in range(c + 1, d):
            factor = A[i, c] / A[c, c]
            for j in range(c + 1, d):
                A[i, j] -= factor * A[c, j]
            out[i] -= factor * out[c]
    for i in range(d - 1, -1, -1):
        for j in range(i + 1, d):
            out[i] -= A[i, j] * out[j]
        out[i] /= A[i, i]
    for i in range(d):
        out[i] = x[i] + 2.0 * (out[i] - (x[i] - goal[i]))


@compiled
def euler_step(x: Array, goal: Array, A: Array, h: float, out: Array) -> None:
    """Write x + h A (x - x_g), the explicit Euler step, into `out`, shape (d,), metres; V may rise. For comparison.

    `x`, `goal`: shape (d,), metres. `A`: shape (d, d), 1/s. `h`: seconds, the gate included. `out` must not be `x`.
    """
    for i in range(goal.shape[0]):
        total = 0.0
        for j in range(goal.shape[0]):
            total += A[i, j] * (x[j] - goal[j])
        out[i] = x[i] + h * total


@compiled
def velocities(x: Array, model: ModelArrays, work: Workspace, out: Array) -> None:
    """Write f, m/s, at states x, shape (n, d), metres, into `out`, shape (n, d). Paper eq. (6)."""
    for t in range(x.shape[0]):
        velocity_at(x[t], model, work, out[t])


@compiled
def cayley_steps(x: Array, model: ModelArrays, h: float, work: Workspace, out: Array) -> None:
    """Write the states after a Cayley step of `h` seconds from x, shape (n, d), metres, into `out`, shape (n, d)."""
    for t in range(x.shape[0]):
        blend(x[t], model, work)
        cayley_step(x[t], model.goal, work.A, h, out[t])


@compiled
def normal_equations(
    x: Array, velocity: Array, model: ModelArrays, gamma: Array, gram: Array, cross: Array
) -> tuple[float, float]:
    """Sum Phi Phi' and xdot Phi' of eq. (7) over all samples in one pass; return sum |z|^2 and sum |xdot|^2.

    Phi = (gamma_1 z, ..., gamma_K z), z = x - x_g, so that f = [A_1 ... A_K] Phi. `x`, `velocity`: shape (n, d),
    metres and m/s. Only the mixture and the goal of `model` are read. `gamma`, shape (K,): scratch. Will be modified:
    `gram`, shape (K d, K d), square metres, and `cross`, shape (d, K d), m^2/s.
    """
    n, d = x.shape
    K = gamma.shape[0]
    goal = model.goal
    gram[:] = 0.0
    cross[:] = 0.0
    distance = 0.0
    speed = 0.0
    for t in range(n):
        responsibilities_at(x[t], model.offsets, model.means, model.whiteners, gamma)
        for i in range(d):
            distance += (x[t, i] - goal[i]) ** 2
            speed += velocity[t, i] ** 2
        for k in range(K):
            for j in range(d):
                column = gamma[k] * (x[t, j] - goal[j])
                if column == 0.0:
                    continue
                for i in range(d):
                    cross[i, k * d + j] += velocity[t, i] * column
                for other in range(k + 1):
                    for i in range(d):
                        gram[other * d + i, k * d + j] += gamma[other] * (x[t, i] - goal[i]) * column
    for row in range(K * d):
        for column_index in range(row):
            gram[row, column_index] = gram[column_index, row]
    return distance, speed
