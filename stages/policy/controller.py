"""A policy as a robot's control loop steps it: measured state in, commanded state out, obstacles as they are seen.

The same compiled step as that of roll-outs (`policy.py`), one call a cycle. Not here: the robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipeline.errors import DataError, ParameterError
from stages.compiled import lean
from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.method import margin_of, resolve_avoidance
from stages.policy.avoidance.parameters import Avoidance, Obstacle, RoasPlusParameters
from stages.policy.avoidance.scene import covered, merged, refusal, shapes_of, to_be_covered
from stages.policy.avoidance.scratch import IGNORE
from stages.policy.avoidance.shapes import Shapes
from stages.policy.coupled import UNCOUPLED, Coupling, observe
from stages.policy.field import field_of
from stages.policy.outcome import Status
from stages.policy.policy import Desk, Rules, act, desk
from stages.trajectory import Array, frozen

STATUSES = tuple(Status)
_SOURCE = "controller"


class Controller:
    """A learned system with its coupling, among obstacles; one for each motion, stepped at a fixed rate.

    Attributes:
        model: the learned system.
        dt: seconds between steps.
    """

    def __init__(
        self,
        model: LpvDs,
        start: ArrayLike,
        *,
        dt: float,
        coupling: Coupling,
        top_speed: float,
        obstacles: Sequence[Obstacle] = (),
        avoidance: Avoidance | None = None,
    ) -> None:
        """Begin a motion at `start`, shape (d,), metres.

        `dt`: seconds. `coupling`: how the executed state follows. `top_speed`: of the demonstrations, m/s.
        `avoidance`: none: ROAS+.

        Raises ParameterError where a parameter has no meaning, DataError where the motion cannot begin.
        """
        self.model, self.dt = model, dt
        self._x = _numbers(start, (model.dimension,), "a state")
        if not (math.isfinite(dt) and dt > 0.0):
            raise ParameterError("dt", f"must be a positive number of seconds, not {dt:g}.")
        self._method = RoasPlusParameters() if avoidance is None else avoidance
        v_max = coupling.v_max if coupling.v_max > 0.0 else math.inf
        resolved = resolve_avoidance(self._method, top_speed, dt, v_max, "avoidance")
        self._rules = Rules(field_of(model, "cayley"), coupling, resolved if obstacles else IGNORE)
        self._seen: Shapes | None = None
        if obstacles:
            self._seen = self._look(obstacles)
        self._desk: Desk = desk(self._rules, self._seen, self._x)
        self._command = np.array(self._x)
        self._open, self._status = True, 0

    @property
    def x(self) -> Array:
        """The state of the learned system, shape (d,), metres."""
        return frozen(self._x)

    @property
    def coupled(self) -> bool:
        """Whether the executed state follows x; else it is x."""
        return self._rules.coupling.kind != UNCOUPLED

    @property
    def moving(self) -> bool:
        """Whether x moved in the last step: the gate of eq. (12)."""
        return self._open

    @property
    def status(self) -> Status:
        """What became of the last step."""
        return STATUSES[self._status]

    def step(self, measured: ArrayLike, *, return_speed: float | None = None) -> Array:
        """Return the next commanded state, shape (d,), metres, from the measured one, shape (d,), metres.

        `return_speed`: x waits in this step, wherever the measured state is, and the commanded one comes back to it at
        so many m/s; only of a coupled system.

        Raises DataError where the measured state is not d finite numbers: hold the robot.
        """
        self._command[:] = _numbers(measured, self._x.shape, "a state")
        rules, waits = self._rules, False
        if return_speed is not None and rules.coupling.kind != UNCOUPLED:
            waits, rules = True, rules._replace(coupling=rules.coupling._replace(v_max=float(return_speed)))
        self._open, self._status = _tick(
            rules, self._seen, self._x, self._command, self._open, waits, self.dt, self._desk
        )
        return self._command.copy()

    def see(self, centres: ArrayLike, velocities: ArrayLike | None = None) -> None:
        """Take in where the obstacles are now, centres, shape (m, d), metres, and how they move, shape (m, d), m/s.

        In the order in which the policy sees them: `seen`. Raises DataError where the shapes do not fit, or a number is
        not finite.
        """
        if self._seen is None:
            raise DataError(_SOURCE, "it was made without obstacles: make one that has them.")
        at = _numbers(centres, self._seen.centres.shape, "centres")
        moving = 0.0 if velocities is None else _numbers(velocities, at.shape, "velocities")
        self._seen.centres[:], self._seen.velocities[:] = at, moving

    @property
    def seen(self) -> Shapes | None:
        """The obstacles as the policy sees them: covered, and merged where they overlap; none: there are none."""
        return self._seen

    def _look(self, obstacles: Sequence[Obstacle]) -> Shapes:
        real = shapes_of(obstacles, self.model.dimension, "obstacles")
        seen, margin = covered(real, to_be_covered(obstacles)), margin_of(self._method)
        if isinstance(self._method, RoasPlusParameters) and self._method.merge:
            seen = merged(seen, margin)
        recover = bool(getattr(self._method, "recover", False))
        refused = refusal(real, seen, margin, self._x, self.model.goal, recover=recover)
        if refused is not None:
            raise DataError("obstacles", refused.remedy)
        return seen._replace(centres=seen.centres.copy(), velocities=seen.velocities.copy())


def _numbers(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """What a caller gives, as an array of its own; raises DataError where it is not finite numbers of this shape."""
    try:
        given = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.array(math.nan)
    if given.shape != shape or not np.isfinite(given).all():
        wanted = f"{shape[0]} finite numbers, metres" if len(shape) == 1 else f"finite numbers of shape {shape}"
        found = given.shape if given.ndim and given.shape != shape else values
        raise DataError(_SOURCE, f"{name} must be {wanted}, not {found}.")
    return given


@lean
def _tick(
    rules: Rules, shapes: Shapes | None, x: Array, executed: Array, was_open: bool, waits: bool, dt: float, on: Desk
) -> tuple[bool, int]:
    """Observe, then act; `executed`: measured in, commanded out. Will be modified, and so will `x`."""
    is_open = observe(rules.coupling, x, executed, was_open) and not waits
    return is_open, act(rules, shapes, x, executed, is_open, dt, on)
