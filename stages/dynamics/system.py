"""What every learned dynamical system offers, whatever its Lyapunov function. The interface only.

f, V, grad V and a step that never raises V: the policy and its obstacle avoidance need nothing else of a model.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from stages.trajectory import Array


@runtime_checkable
class DynamicalSystem(Protocol):
    """A motion x' = f(x) with the one equilibrium f(goal) = 0, and a function V that falls along it."""

    @property
    def goal(self) -> Array:
        """x_g, shape (d,), metres."""
        ...

    @property
    def dimension(self) -> int:
        """d, the number of coordinates."""
        ...

    def velocity(self, x: Array) -> Array:
        """f, shape (n, d), m/s, at states x, shape (n, d), metres."""
        ...

    def lyapunov(self, x: Array) -> Array:
        """V, shape (n,), at states x, shape (n, d), metres; 0 at the goal only."""
        ...

    def lyapunov_gradient(self, x: Array) -> Array:
        """grad V, shape (n, d), at states x, shape (n, d), metres."""
        ...

    def step(self, x: Array, dt: float, gate: float = 1.0) -> Array:
        """States, shape (n, d), metres, `dt` seconds after x, shape (n, d), at `gate` x the speed; V never rises."""
        ...
