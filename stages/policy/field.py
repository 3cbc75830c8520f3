"""The learned system as a policy steps it: one state, one step, nothing allocated. Paper eq. (6).

This is where a policy meets the dynamics, and the one place that changes when there is another kind of them. Not here:
the integrators themselves and why V cannot rise under one of them (`stages/dynamics/kernels.py`).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from stages.compiled import compiled
from stages.dynamics.kernels import ModelArrays, Workspace, blend, cayley_step, euler_step
from stages.dynamics.lpvds import LpvDs
from stages.trajectory import Array

CAYLEY, EULER = 0, 1


class Field(NamedTuple):
    """A learned system and its integrator, as compiled code takes them.

    Attributes:
        integrator: CAYLEY (V never rises) or EULER (explicit, for comparison).
        model: the system.
    """

    integrator: int
    model: ModelArrays


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
    return Field(CAYLEY if integrator == "cayley" else EULER, model.arrays)


@compiled
def workspace(field: Field) -> Work:
    """Scratch for this field: all that stepping it needs."""
    K, d = field.model.means.shape
    return Work(Workspace(np.empty(K), np.empty((d, d))), np.empty(d))


@compiled
def advance(field: Field, x: Array, dt: float, work: Work) -> None:
    """Move x by one step of the learned system. Paper eq. (6).

    Args:
        field: the learned system.
        x: array, shape (d,), metres. Will be modified.
        dt: seconds.
        work: from `workspace`. Will be modified.
    """
    blend(x, field.model, work.model)
    if field.integrator == CAYLEY:
        cayley_step(x, field.model.goal, work.model.A, dt, work.state)
    else:
        euler_step(x, field.model.goal, work.model.A, dt, work.state)
    for i in range(x.shape[0]):
        x[i] = work.state[i]
