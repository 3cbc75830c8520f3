"""The LPV-DS for one state in compiled code: f, V, grad V and a step that never raises V. Paper eqs. (6), (24).

These four functions are all that a policy knows of a model: every kind of dynamics is one of their arguments, and a new
kind needs no new kernel. x' = s(x) J(x)^-1 sum_k gamma_k(x) A_k psi(x) and V = psi'P psi; in the paper's case psi is
the identity about the goal (no translations) and s = 1 (no speed limit). s > 0 changes how fast V falls, not whether.
Nothing is allocated: a caller makes `workspace(model)` once and hands it in. Any dimension up to 7 or so: the linear
solve is a small elimination. Not here: the model's public face (`lpvds.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stages.compiled import compiled, lean
from stages.dynamics.warp import image_at, unwarp_at, warp_at
from stages.mixture.gaussian import responsibilities_at
from stages.trajectory import Array


class ModelArrays(NamedTuple):
    """A model in the form that compiled code takes it.

    Attributes:
        offsets, means, whiteners: shapes (K,), (K, d), (K, d, d), as of `stages.mixture.gaussian.Whitening`.
        matrices: shape (K, d, d), A_k, 1/s.
        goal: shape (d,), x_g, metres.
        lyapunov_matrix: shape (d, d), P.
        centres, translations, rates: shapes (M, d), (M, d), (M,), as of `stages.dynamics.warp.Warp`; M = 0: identity.
        origin: shape (d,), what the translations make of the goal, metres.
        speed_limit: m/s; inf: none.
    """

    offsets: Array
    means: Array
    whiteners: Array
    matrices: Array
    goal: Array
    lyapunov_matrix: Array
    centres: Array
    translations: Array
    rates: Array
    origin: Array
    speed_limit: float


class Workspace(NamedTuple):
    """Buffers of one evaluation; all will be modified by every kernel.

    Attributes:
        gamma: shape (K,), responsibilities of the last state.
        A: shape (d, d), the blended matrix of the last state, overwritten by a step.
        z: shape (d,), the last state relative to the goal.
        psi: shape (d,), its image.
        jacobian: shape (d, d), of psi there; overwritten by `velocity_at`.
        row: shape (d,).
    """

    gamma: Array
    A: Array
    z: Array
    psi: Array
    jacobian: Array
    row: Array


@compiled
def workspace(model: ModelArrays) -> Workspace:
    """Return the buffers that the kernels need for a model; one for each thread."""
    K, d = model.means.shape
    return Workspace(np.empty(K), np.empty((d, d)), np.empty(d), np.empty(d), np.empty((d, d)), np.empty(d))


@lean
def blend(x: Array, model: ModelArrays, work: Workspace) -> None:
    """Write A(x) = sum_k gamma_k(x) A_k, 1/s, into `work.A`, and gamma(x) into `work.gamma`. Paper eq. (6).

    `x`: shape (d,), metres.
    """
    gamma, A = work.gamma, work.A
    matrices = model.matrices
    K, d, _ = matrices.shape
    responsibilities_at(x, model.offsets, model.means, model.whiteners, gamma)
    for i in range(d):
        for j in range(d):
            total = 0.0
            for k in range(K):
                total += gamma[k] * matrices[k, i, j]
            A[i, j] = total


@lean
def image_and_jacobian(x: Array, model: ModelArrays, work: Workspace) -> None:
    """Write psi(x) into `work.psi` and its Jacobian into `work.jacobian`. `x`: shape (d,), metres."""
    for i in range(model.goal.shape[0]):
        work.z[i] = x[i] - model.goal[i]
    warp_at(work.z, model.centres, model.translations, model.rates, model.origin, work.psi, work.jacobian, work.row)


@lean
def image_only(x: Array, model: ModelArrays, work: Workspace) -> None:
    """Write psi(x) into `work.psi`. `x`: shape (d,), metres."""
    for i in range(model.goal.shape[0]):
        work.z[i] = x[i] - model.goal[i]
    image_at(work.z, model.centres, model.translations, model.rates, model.origin, work.psi)


@lean
def velocity_at(x: Array, model: ModelArrays, work: Workspace, out: Array) -> float:
    """Write f(x) = s J^-1 A(x) psi(x), m/s, into `out`, shape (d,); return s. Paper eq. (6). `x`: shape (d,), metres.

    s in (0, 1] keeps the speed within the limit; 1 where there is none.
    """
    image_and_jacobian(x, model, work)
    blend(x, model, work)
    for i in range(model.goal.shape[0]):
        total = 0.0
        for j in range(model.goal.shape[0]):
            total += work.A[i, j] * work.psi[j]
        out[i] = total
    if model.rates.shape[0]:
        solve_in_place(work.jacobian, out)
    if model.speed_limit == math.inf:
        return 1.0
    squared = 0.0
    for i in range(model.goal.shape[0]):
        squared += out[i] * out[i]
    speed = math.sqrt(squared)
    if speed <= model.speed_limit:
        return 1.0
    share = model.speed_limit / speed
    for i in range(model.goal.shape[0]):
        out[i] *= share
    return share


@lean
def lyapunov_at(x: Array, model: ModelArrays, work: Workspace) -> float:
    """Return V(x) = psi(x)'P psi(x), square metres. `x`: shape (d,), metres."""
    image_only(x, model, work)
    total = 0.0
    for i in range(model.goal.shape[0]):
        for j in range(model.goal.shape[0]):
            total += work.psi[i] * model.lyapunov_matrix[i, j] * work.psi[j]
    return total


@lean
def lyapunov_gradient_at(x: Array, model: ModelArrays, work: Workspace, out: Array) -> None:
    """Write grad V(x) = 2 J'P psi(x), metres, into `out`, shape (d,). `x`: shape (d,), metres."""
    d = model.goal.shape[0]
    image_and_jacobian(x, model, work)
    for i in range(d):
        work.row[i] = 0.0
        for j in range(d):
            work.row[i] += 2.0 * model.lyapunov_matrix[i, j] * work.psi[j]
    for i in range(d):
        out[i] = 0.0
        for j in range(d):
            out[i] += work.jacobian[j, i] * work.row[j]


@lean
def step_at(x: Array, model: ModelArrays, h: float, work: Workspace, out: Array) -> None:
    """Write the state `h` seconds after x, shape (d,), metres, into `out`, shape (d,); V never rises, whatever `h`.

    A Cayley step of the image, psi+ = psi + 2 (w - psi) with (I - s h A(x)/2) w = psi, and the inverse warp of it. `h`,
    seconds, the gate included; 0 returns x to the last bit. `out` must not be `x`.
    """
    d = model.goal.shape[0]
    if model.speed_limit < math.inf:
        h *= velocity_at(x, model, work, out)
    else:
        blend(x, model, work)
    if model.rates.shape[0] == 0:
        cayley_step(x, model.goal, work.A, h, out)
    elif h == 0.0:
        for i in range(d):
            out[i] = x[i]
    else:
        if model.speed_limit == math.inf:
            image_only(x, model, work)
        at_goal = True
        for i in range(d):
            at_goal &= work.psi[i] == 0.0
        if at_goal:
            for i in range(d):
                out[i] = x[i]
            return
        work.z[:] = 0.0
        cayley_step(work.psi, work.z, work.A, h, out)
        unwarp_at(out, model.centres, model.translations, model.rates, model.origin, work.z)
        for i in range(d):
            out[i] = work.z[i] + model.goal[i]


@lean
def euler_step_at(x: Array, model: ModelArrays, h: float, work: Workspace, out: Array) -> None:
    """Write x + h f(x), the explicit Euler step, into `out`, shape (d,), metres; V may rise. For comparison.

    `x`: shape (d,), metres. `h`: seconds, the gate included. `out` must not be `x`.
    """
    velocity_at(x, model, work, out)
    for i in range(model.goal.shape[0]):
        out[i] = x[i] + h * out[i]


@lean
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
    solve_in_place(A, out)
    for i in range(d):
        out[i] = x[i] + 2.0 * (out[i] - (x[i] - goal[i]))


@lean
def solve_in_place(A: Array, b: Array) -> None:
    """Overwrite b, shape (d,), by the solution of A y = b, by elimination with pivoting. `A`, (d, d): overwritten."""
    d = b.shape[0]
    for c in range(d):
        pivot = c
        for i in range(c + 1, d):
            if abs(A[i, c]) > abs(A[pivot, c]):
                pivot = i
        if pivot != c:
            for j in range(c, d):
                A[c, j], A[pivot, j] = A[pivot, j], A[c, j]
            b[c], b[pivot] = b[pivot], b[c]
        for i in range(c + 1, d):
            factor = A[i, c] / A[c, c]
            for j in range(c + 1, d):
                A[i, j] -= factor * A[c, j]
            b[i] -= factor * b[c]
    for i in range(d - 1, -1, -1):
        for j in range(i + 1, d):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]


@lean
def velocities(x: Array, model: ModelArrays, work: Workspace, out: Array) -> None:
    """Write f, m/s, at states x, shape (n, d), metres, into `out`, shape (n, d). Paper eq. (6)."""
    for t in range(x.shape[0]):
        velocity_at(x[t], model, work, out[t])


@lean
def lyapunovs(x: Array, model: ModelArrays, work: Workspace, out: Array) -> None:
    """Write V, square metres, at states x, shape (n, d), metres, into `out`, shape (n,)."""
    for t in range(x.shape[0]):
        out[t] = lyapunov_at(x[t], model, work)


@lean
def lyapunov_gradients(x: Array, model: ModelArrays, work: Workspace, out: Array) -> None:
    """Write grad V, metres, at states x, shape (n, d), metres, into `out`, shape (n, d)."""
    for t in range(x.shape[0]):
        lyapunov_gradient_at(x[t], model, work, out[t])


@lean
def steps(x: Array, model: ModelArrays, h: float, work: Workspace, out: Array) -> None:
    """Write the states after a step of `h` seconds from x, shape (n, d), metres, into `out`, shape (n, d)."""
    for t in range(x.shape[0]):
        step_at(x[t], model, h, work, out[t])
