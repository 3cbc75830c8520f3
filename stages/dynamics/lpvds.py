"""The linear parameter-varying dynamical system, eq. (6), in the coordinates of a warp, with its Lyapunov function.

f(x) = J(x)^-1 sum_k gamma_k(x) A_k psi(x) and V(x) = psi(x)'P psi(x), where psi is a diffeomorphism with psi(x_g) = 0
and J its Jacobian. The paper's system is the one with psi(x) = x - x_g and P = I, f(x) = sum_k gamma_k(x) (A_k x +
b_k), b_k = -A_k x_g. Along f, dV/dt = psi'(A'P + PA) psi with A = sum_k gamma_k A_k: what proves the one proves the
other. Where a speed limit is given, f is scaled down to it, which changes how fast V falls and not whether.

Not here: how A_k, P and psi are learned (`qlf.py`, `pqlf.py`, `warped.py`) or proved (`certificate.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.errors import DataError
from stages.dynamics.kernels import (
    ModelArrays,
    lyapunov_gradients,
    lyapunovs,
    steps,
    velocities,
    workspace,
)
from stages.dynamics.warp import Warp
from stages.mixture.gaussian import GaussianMixture, whitening
from stages.trajectory import Array, Trajectory, frozen

_SOURCE = "dynamics"


@dataclass(frozen=True, kw_only=True, eq=False)
class LpvDs:
    """f(x) = J(x)^-1 sum_k gamma_k(x) A_k psi(x). Paper eq. (6). A `stages.dynamics.system.DynamicalSystem`.

    Attributes:
        mixture: gamma_k, of metres.
        matrices: array, shape (K, d, d), A_k, 1/s.
        goal: array, shape (d,), x_g, metres.
        lyapunov_matrix: array, shape (d, d), P, symmetric; eq. (8) has P = I.
        warp: psi, of x - x_g; none: the identity, as in eq. (6).
        speed_limit: |f| is scaled down to this, m/s, where it would be larger; inf: nowhere, as in eq. (6).

    Raises:
        DataError: shapes do not fit, a number is not finite, or the speed limit is not positive.
    """

    mixture: GaussianMixture
    matrices: Array
    goal: Array
    lyapunov_matrix: Array
    warp: Warp | None = None
    speed_limit: float = math.inf

    def __post_init__(self) -> None:
        K, d = self.mixture.components, self.mixture.dimension
        for name, shape in (("matrices", (K, d, d)), ("goal", (d,)), ("lyapunov_matrix", (d, d))):
            values = frozen(getattr(self, name))
            object.__setattr__(self, name, values)
            if values.shape != shape:
                raise DataError(_SOURCE, f"{name} must have shape {shape} to fit the mixture, not {values.shape}.")
            if not np.isfinite(values).all():
                raise DataError(_SOURCE, f"{name} must be finite.")
        if self.warp is not None and self.warp.centres.shape[1] != d:
            raise DataError(_SOURCE, f"the warp must be of {d} coordinates, not {self.warp.centres.shape[1]}.")
        if not self.speed_limit > 0.0:
            raise DataError(_SOURCE, f"the speed limit must be positive, not {self.speed_limit}.")

    @property
    def dimension(self) -> int:
        """d, the number of coordinates."""
        return self.mixture.dimension

    @property
    def offsets(self) -> Array:
        """b_k = -A_k x_g, shape (K, d), m/s. Paper eq. (8). Of a warped system, those of its image."""
        return frozen(-self.matrices @ self.goal)

    @cached_property
    def arrays(self) -> ModelArrays:
        """What the compiled kernels take; read-only arrays."""
        return arrays(self.mixture, self.matrices, self.goal, self.lyapunov_matrix, self.warp, self.speed_limit)

    def velocity(self, x: Array) -> Array:
        """Return f, shape (n, d), m/s, at states x, shape (n, d), metres. Paper eq. (6)."""
        x = self._states(x)
        out = np.empty_like(x)
        velocities(x, self.arrays, workspace(self.arrays), out)
        return out

    def lyapunov(self, x: Array) -> Array:
        """Return V = psi'P psi, shape (n,), square metres, at states x, shape (n, d), metres."""
        x = self._states(x)
        out = np.empty(x.shape[0])
        lyapunovs(x, self.arrays, workspace(self.arrays), out)
        return out

    def lyapunov_gradient(self, x: Array) -> Array:
        """Return grad V = 2 J'P psi, shape (n, d), metres, at states x, shape (n, d), metres."""
        x = self._states(x)
        out = np.empty_like(x)
        lyapunov_gradients(x, self.arrays, workspace(self.arrays), out)
        return out

    def step(self, x: Array, dt: float, gate: float = 1.0) -> Array:
        """Return the states after one Cayley step, shape (n, d), metres; V never rises, whatever the step.

        `x`: shape (n, d), metres. `dt`: seconds. `gate`: in [0, 1], scales the speed: the gate of eq. (11).
        """
        if not (0.0 <= gate <= 1.0 and dt >= 0.0):
            raise DataError(_SOURCE, f"a step needs dt >= 0 and a gate from 0 to 1, not {dt} s and {gate}.")
        x = self._states(x)
        out = np.empty_like(x)
        steps(x, self.arrays, dt * gate, workspace(self.arrays), out)
        return out

    def _states(self, x: Array) -> Array:
        x = np.ascontiguousarray(x, dtype=np.float64)
        if x.ndim != 2 or x.shape[1] != self.dimension:
            raise DataError(_SOURCE, f"states must have shape (n, {self.dimension}), not {x.shape}.")
        return x


def arrays(
    mixture: GaussianMixture,
    matrices: Array,
    goal: Array,
    lyapunov_matrix: Array,
    warp: Warp | None = None,
    speed_limit: float = math.inf,
) -> ModelArrays:
    """Gather what the kernels take: A_k (K, d, d) in 1/s, x_g (d,) in metres, P (d, d). The arrays are read-only."""
    warp = Warp.identity(mixture.dimension) if warp is None else warp
    return ModelArrays(
        *whitening(mixture),
        frozen(matrices),
        frozen(goal),
        frozen(lyapunov_matrix),
        warp.centres,
        warp.translations,
        warp.rates,
        warp.origin(),
        float(speed_limit),
    )


def velocity_error(model: LpvDs, demonstrations: Sequence[Trajectory]) -> float:
    """Return the root mean square velocity error over every sample of demonstrations, m/s."""
    errors = [((model.velocity(d.position) - d.velocity) ** 2).sum(axis=1) for d in demonstrations]
    return math.sqrt(float(np.concatenate(errors).mean()))
