"""One step of a whole policy: the learned system, round obstacles, and the executed state that follows it.

A policy does two things in a step: `observe` the executed state, which decides the gate (`coupled.py`), and `act`,
which moves x and commands the next executed state. Compiled, for any dimension; nothing is allocated. Roll-outs and the
Python face step through here. Not here: what the world makes of the command (`stages/world`), and
which controller an experiment asks for (`stages/rollout`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stages.compiled import compiled, lean
from stages.policy.avoidance.avoid import avoid, escort
from stages.policy.avoidance.detour import Memory, memory
from stages.policy.avoidance.scratch import Avoidance, Scratch, scratch
from stages.policy.avoidance.shapes import Shapes
from stages.policy.coupled import (
    DEADBEAT,
    PRINTED,
    Coupling,
    distance,
    follow_deadbeat,
    follow_printed,
    follow_printed_explicitly,
)
from stages.policy.field import EULER, Field, Work, advance, workspace
from stages.trajectory import Array

_ROUNDING = 1e-12
_MOST_TRIALS = 20


class Rules(NamedTuple):
    """What a policy is, as compiled code takes it.

    Attributes:
        field: the learned system and its integrator.
        coupling: how the executed state follows x.
        avoidance: how obstacles are avoided.
    """

    field: Field
    coupling: Coupling
    avoidance: Avoidance


class Desk(NamedTuple):
    """What a policy writes on; one for each roll-out.

    Attributes:
        work: of the field.
        room: of avoidance; none: there are no obstacles.
        recall: what avoidance remembers from step to step.
        next: array, shape (d,), the next x, or the next executed state.
    """

    work: Work
    room: Scratch | None
    recall: Memory
    next: Array


@compiled
def desk(rules: Rules, shapes: Shapes | None, start: Array) -> Desk:
    """Return what a policy writes on, for a roll-out from `start`, shape (d,), metres, among these obstacles."""
    d, room = start.shape[0], None
    if shapes is not None:
        room = scratch(shapes.kinds.shape[0], d)
    return Desk(workspace(rules.field), room, memory(start), np.empty(d))


@lean
def act(rules: Rules, shapes: Shapes | None, x: Array, p_hat: Array, is_open: bool, dt: float, on: Desk) -> int:
    """Move x by one step if the gate is open, then let p_hat follow it, both clear of obstacles. Eqs. (9)-(11), (22).

    x moves first and p_hat follows where it went, so that an undisturbed deadbeat follower loses no step.

    Args:
        rules: the policy.
        shapes: obstacles, where they are now; none: there are none, and no code for them is compiled.
        x: array, shape (d,), metres. Will be modified.
        p_hat: array, shape (d,), metres: the executed state in, the commanded one out. Will be modified.
        is_open: what `observe` answered.
        dt: seconds.
        on: will be modified.

    Returns:
        What became of the step, a code of `stages.policy.outcome.Status`.
    """
    status, coupling = 0, rules.coupling
    if is_open:
        _propose(rules, x, dt, on)
        if shapes is not None:
            status = avoid(rules.avoidance, shapes, rules.field, x, on.next, dt, on.work, on.room, on.recall)  # type: ignore[arg-type]
        for i in range(x.shape[0]):
            x[i] = on.next[i]
    if coupling.kind == DEADBEAT or coupling.kind == PRINTED:
        for i in range(x.shape[0]):
            on.next[i] = p_hat[i]
        if coupling.kind == DEADBEAT:
            follow_deadbeat(x, on.next, dt, coupling.v_max)
        elif rules.field.integrator == EULER:
            follow_printed_explicitly(x, on.next, dt, coupling.p_max, coupling.k_c)
        else:
            follow_printed(x, on.next, dt, coupling.p_max, coupling.k_c)
        if shapes is not None:
            status = max(status, escort(rules.avoidance, shapes, x, p_hat, on.next, dt, on.room))  # type: ignore[arg-type]
        for i in range(x.shape[0]):
            p_hat[i] = on.next[i]
    else:
        for i in range(x.shape[0]):
            p_hat[i] = x[i]
    return status


@lean
def _propose(rules: Rules, x: Array, dt: float, on: Desk) -> None:
    """Write the learned system's step from x into `on.next`; a deadbeat follower must be able to keep up with it.

    The step is shortened in time, not in space: V falls along it however short it is.
    """
    share = 1.0
    for _ in range(_MOST_TRIALS):
        for i in range(x.shape[0]):
            on.next[i] = x[i]
        advance(rules.field, on.next, share * dt, on.work)
        if rules.coupling.kind != DEADBEAT:
            return
        gone, reach = distance(x, on.next), rules.coupling.v_max * dt
        if not gone > reach:
            return
        share *= (1.0 - _ROUNDING) * reach / gone
