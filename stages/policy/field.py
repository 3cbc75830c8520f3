"""The learned system as a policy steps it: one state, one step, nothing allocated. Paper eq. (6).

This is where a policy meets the dynamics, of whatever kind: it uses the kernels' step and nothing else of a model. Not
here: the integrators themselves and why V cannot rise under one of them (`stages/dynamics/kernels.py`).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from stages.compiled import compiled, lean
from stages.dynamics import kernels
from stages.dynamics.kernels import ModelArrays, Workspace, euler_step_at, step_at
from stages.dynamics.lpvds import LpvDs
from stages.trajectory import Array, frozen

CAYLEY, EULER = 0, 1


class Field(NamedTuple):
    """A learned system and its integrator, as compiled code takes them.

    Attributes:
        integrator: CAYLEY (V never rises) or EULER (explicit, for comparison).
        model: the system.
        factor: array, shape (d, d), L' with P = L L': |L'psi|^2 is V.
    """

    integrator: int
    model: ModelArrays
    factor: Array


class Work(NamedTuple):
    """Scratch of `advance`, which every call overwrites.

    Attributes:
        model: of the kernels.
        state: array, shape (d,).
    """

    model: Workspace
    state: Array


def field_of(model: LpvDs, integrator: Literal["cayley", "euler"]) -> Field:
    """The learned system for `advance`."""
    factor = frozen(np.linalg.cholesky(model.lyapunov_matrix).T)
    return Field(CAYLEY if integrator == "cayley" else EULER, model.arrays, factor)


@compiled
def workspace(field: Field) -> Work:
    """Scratch for this field: all that stepping it needs."""
    return Work(kernels.workspace(field.model), np.empty(field.model.goal.shape[0]))


@lean
def advance(field: Field, x: Array, dt: float, work: Work) -> None:
    """Move x by one step of the learned system. Paper eq. (6).

    Args:
        field: the learned system.
        x: array, shape (d,), metres. Will be modified.
        dt: seconds.
        work: from `workspace`. Will be modified.
    """
    if field.integrator == CAYLEY:
        step_at(x, field.model, dt, work.model, work.state)
    else:
        euler_step_at(x, field.model, dt, work.model, work.state)
    for i in range(x.shape[0]):
        x[i] = work.state[i]
