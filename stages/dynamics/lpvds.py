"""The linear parameter-varying dynamical system, eq. (6), with its quadratic Lyapunov function.

f(x) = sum_k gamma_k(x) (A_k x + b_k), b_k = -A_k x_g, and V(x) = (x - x_g)'P (x - x_g). Not here: how A_k is learned
(`solve.py`, `qlf.py`) or proved stable (`certificate.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.errors import DataError
from stages.dynamics.kernels import ModelArrays, Workspace, cayley_steps, velocities
from stages.mixture.gaussian import GaussianMixture, whitening
from stages.trajectory import Array, frozen

_SOURCE = "dynamics"


@dataclass(frozen=True, kw_only=True, eq=False)
class LpvDs:
    """f(x) = sum_k gamma_k(x) A_k (x - x_g). Paper eq. (6). A `stages.dynamics.system.DynamicalSystem`.

    Attributes:
        mixture: gamma_k, of metres.
        matrices: array, shape (K, d, d), A_k, 1/s.
        goal: array, shape (d,), x_g, metres.
        lyapunov_matrix: array, shape (d, d), P, symmetric; eq. (8) has P = I.

    Raises:
        DataError: shapes do not fit, or a number is not finite.
    """

    mixture: GaussianMixture
    matrices: Array
    goal: Array
    lyapunov_matrix: Array

    def __post_init__(self) -> None:
        K, d = self.mixture.components, self.mixture.dimension
        for name, shape in (("matrices", (K, d, d)), ("goal", (d,)), ("lyapunov_matrix", (d, d))):
            values = frozen(getattr(self, name))
            object.__setattr__(self, name, values)
            if values.shape != shape:
                raise DataError(_SOURCE, f"{name} must have shape {shape} to fit the mixture, not {values.shape}.")
            if not np.isfinite(values).all():
                raise DataError(_SOURCE, f"{name} must be finite.")

    @property
    def dimension(self) -> int:
        """d, the number of coordinates."""
        return self.mixture.dimension

    @property
    def offsets(self) -> Array:
        """b_k = -A_k x_g, shape (K, d), m/s. Paper eq. (8)."""
        return frozen(-self.matrices @ self.goal)

    @cached_property
    def arrays(self) -> ModelArrays:
        """What the compiled kernels take; read-only arrays."""
        return arrays(self.mixture, self.matrices, self.goal, self.lyapunov_matrix)

    def velocity(self, x: Array) -> Array:
        """Return f, shape (n, d), m/s, at states x, shape (n, d), metres. Paper eq. (6)."""
        x = self._states(x)
        out = np.empty_like(x)
        velocities(x, self.arrays, workspace(self.arrays), out)
        return out

    def lyapunov(self, x: Array) -> Array:
        """Return V = z'P z, shape (n,), square metres, at states x, shape (n, d), metres; z = x - x_g."""
        z = self._states(x) - self.goal
        return np.asarray(((z @ self.lyapunov_matrix) * z).sum(axis=1))

    def lyapunov_gradient(self, x: Array) -> Array:
        """Return grad V = 2 P z, shape (n, d), metres, at states x, shape (n, d), metres."""
        return np.asarray(2.0 * (self._states(x) - self.goal) @ self.lyapunov_matrix)

    def step(self, x: Array, dt: float, gate: float = 1.0) -> Array:
        """Return the states after one Cayley step, shape (n, d), metres; V never rises, whatever the step.

        `x`: shape (n, d), metres. `dt`: seconds. `gate`: in [0, 1], scales the speed: the gate of eq. (11).
        """
        x = self._states(x)
        out = np.empty_like(x)
        cayley_steps(x, self.arrays, dt * gate, workspace(self.arrays), out)
        return out

    def _states(self, x: Array) -> Array:
        x = np.ascontiguousarray(x, dtype=np.float64)
        if x.ndim != 2 or x.shape[1] != self.dimension:
            raise DataError(_SOURCE, f"states must have shape (n, {self.dimension}), not {x.shape}.")
        return x


def arrays(mixture: GaussianMixture, matrices: Array, goal: Array, lyapunov_matrix: Array) -> ModelArrays:
    """Gather what the kernels take: A_k (K, d, d) in 1/s, x_g (d,) in metres, P (d, d). The arrays are read-only."""
    return ModelArrays(*whitening(mixture), frozen(matrices), frozen(goal), frozen(lyapunov_matrix))


def workspace(model: ModelArrays) -> Workspace:
    """Return the buffers that the kernels need for a model; one for each thread."""
    K, d = model.means.shape
    return Workspace(gamma=np.empty(K), A=np.empty((d, d)))
