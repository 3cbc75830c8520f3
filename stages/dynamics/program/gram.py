"""The sums over the samples that the regression of eq. (7) is made of, in compiled code, in one pass and one order.

`normal_equations` takes samples and a mixture; `sums` and `coupled_sums` take features that were computed before, as a
warped system needs them. The inner loops run along rows, not along samples: they run wide without reordering a sum,
which BLAS does differently on every machine. Not here: what the sums are used for (`regression.py`).
"""

from __future__ import annotations

from stages.compiled import compiled
from stages.dynamics.kernels import ModelArrays
from stages.mixture.gaussian import responsibilities_at
from stages.trajectory import Array


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


@compiled
def write_features(x: Array, model: ModelArrays, gamma: Array, out: Array) -> None:
    """Write Phi of every sample, (gamma_1 z, ..., gamma_K z), metres, into `out`, shape (n, K d). Paper eqs. (6), (7).

    `x`: shape (n, d), metres. Only the mixture and the goal of `model` are read. `gamma`, shape (K,): scratch.
    """
    n, d = x.shape
    for t in range(n):
        responsibilities_at(x[t], model.offsets, model.means, model.whiteners, gamma)
        for k in range(gamma.shape[0]):
            for j in range(d):
                out[t, k * d + j] = gamma[k] * (x[t, j] - model.goal[j])


@compiled
def sums(features: Array, velocity: Array, weights: Array, gram: Array, cross: Array) -> tuple[float, float]:
    """Sum w Phi Phi' and w xdot Phi' over all samples; return sum w |z|^2 and sum w |xdot|^2. Paper eq. (7).

    z = sum_k Phi_k, as the responsibilities sum to one. `features`: Phi, shape (n, K d), metres. `velocity`: shape
    (n, d), m/s. `weights`: w, shape (n,). Will be modified: `gram`, shape (K d, K d), square metres, and `cross`,
    shape (d, K d), m^2/s.
    """
    width = features.shape[1]
    gram[:] = 0.0
    cross[:] = 0.0
    for i in range(velocity.shape[1]):
        _add_samples(features, weights, velocity, i, 0, cross[i], 0)
    for row in range(width):
        _add_samples(features, weights, features, row, row, gram[row], 0)
    _reflect(gram)
    return _sizes(features, velocity, weights)


@compiled
def coupled_sums(
    features: Array,
    velocity: Array,
    inverse_jacobian: Array,
    weights: Array,
    scale: Array,
    pulled: Array,
    gram: Array,
    cross: Array,
) -> tuple[float, float]:
    """As `sums` for the residual W A Phi - xdot, W = J^-1, whose rows couple: the Gram matrix of all rows of A.

    `gram`, shape (d K d, d K d), becomes sum w (W'W)_ij Phi Phi' for each pair of rows i and j of A = [A_1 ... A_K];
    `cross`, shape (d, K d), becomes sum w (W'xdot) Phi'. `inverse_jacobian`: shape (n, d, d). `scale`, shape (n,), and
    `pulled`, shape (n, d): scratch. The rest as of `sums`.
    """
    n, width = features.shape
    d = velocity.shape[1]
    gram[:] = 0.0
    cross[:] = 0.0
    for t in range(n):
        for i in range(d):
            pulled[t, i] = 0.0
            for m in range(d):
                pulled[t, i] += inverse_jacobian[t, m, i] * velocity[t, m]
    for i in range(d):
        _add_samples(features, weights, pulled, i, 0, cross[i], 0)
        for j in range(i, d):
            for t in range(n):
                metric = 0.0
                for m in range(d):
                    metric += inverse_jacobian[t, m, i] * inverse_jacobian[t, m, j]
                scale[t] = weights[t] * metric
            for row in range(width):
                _add_samples(features, scale, features, row, row, gram[i * width + row], j * width)
            # Each block is symmetric, and so is the whole.
            for row in range(width):
                for column in range(row):
                    gram[i * width + row, j * width + column] = gram[i * width + column, j * width + row]
    _reflect(gram)
    return _sizes(features, velocity, weights)


@compiled
def _add_samples(
    features: Array, scale: Array, factors: Array, column: int, start: int, out: Array, shift: int
) -> None:
    """Add sum_t scale_t factors[t, column] features[t, start:] to `out`, which begins `shift` entries further on.

    Eight samples at a time, so that `out` is read and written an eighth as often; their sum has one fixed order.
    """
    n, width = features.shape
    whole = n - n % 8
    for t in range(0, whole, 8):
        a = scale[t] * factors[t, column]
        b = scale[t + 1] * factors[t + 1, column]
        c = scale[t + 2] * factors[t + 2, column]
        d = scale[t + 3] * factors[t + 3, column]
        e = scale[t + 4] * factors[t + 4, column]
        f = scale[t + 5] * factors[t + 5, column]
        g = scale[t + 6] * factors[t + 6, column]
        h = scale[t + 7] * factors[t + 7, column]
        for m in range(start, width):
            first = (a * features[t, m] + b * features[t + 1, m]) + (c * features[t + 2, m] + d * features[t + 3, m])
            second = (e * features[t + 4, m] + f * features[t + 5, m]) + (
                g * features[t + 6, m] + h * features[t + 7, m]
            )
            out[shift + m] += first + second
    for t in range(whole, n):
        a = scale[t] * factors[t, column]
        for m in range(start, width):
            out[shift + m] += a * features[t, m]


@compiled
def _reflect(matrix: Array) -> None:
    """Copy the upper half of a square matrix to its lower half."""
    for row in range(matrix.shape[0]):
        for column in range(row):
            matrix[row, column] = matrix[column, row]


@compiled
def _sizes(features: Array, velocity: Array, weights: Array) -> tuple[float, float]:
    """Return sum w |z|^2, z = sum_k Phi_k, in square metres, and sum w |xdot|^2 in (m/s)^2."""
    distance = 0.0
    speed = 0.0
    d = velocity.shape[1]
    for t in range(features.shape[0]):
        for i in range(d):
            component = 0.0
            for column in range(i, features.shape[1], d):
                component += features[t, column]
            distance += weights[t] * component * component
            speed += weights[t] * velocity[t, i] * velocity[t, i]
    return distance, speed
