"""From the parameters of a roll-out stage to what runs: checked, completed, and told when a displacement comes.

Whatever has no meaning is refused here, before anything runs. Not here: the roll-outs (`simulate.py`), and how a
coupling completes its own parameters (`stages/policy/coupled.py`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.policy.coupled import PLAIN, Coupling, paper_coupling, robust_coupling
from stages.rollout.parameters import Condition, Controller, LpvdsController, Mode, RolloutParameters
from stages.trajectory import Array, Trajectory

HALF_WAY = 0.5
"""Where a displacement is added if its condition does not say: a fraction of the arc length. Paper Fig. 3."""

MOST_STEPS = 10_000_000
"""Longer roll-outs are a mistake in the parameters: at d = 3 they would fill half a gigabyte."""


@dataclass(frozen=True, kw_only=True)
class Runner:
    """A controller with its parameters resolved.

    Attributes:
        kind: ``lpvds`` or ``clpvds``.
        mode: ``paper`` or ``robust``; of ``lpvds``, the run's own.
        coupling: how its executed state follows x.
    """

    kind: str
    mode: Mode
    coupling: Coupling

    @property
    def label(self) -> str:
        """What the names of its roll-outs begin with."""
        return self.kind if self.kind == "lpvds" else f"{self.kind}-{self.mode}"


def displacement_sample(condition: Condition, undisturbed: Array, dt: float) -> int:
    """First sample that holds the displacement of a condition that has one.

    Args:
        condition: by `at_time`, seconds, or by `at_fraction` of the arc length; by neither: half of it.
        undisturbed: array, shape (n, d), metres: the executed path of the same controller without the displacement.
        dt: step, seconds.
    """
    if condition.at_time is not None:
        return math.ceil(condition.at_time / dt - 1e-9)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(undisturbed, axis=0), axis=1))])
    fraction = HALF_WAY if condition.at_fraction is None else condition.at_fraction
    return int(np.searchsorted(length, fraction * length[-1]))


def step_limit(max_duration: float, duration: float, dt: float) -> int:
    """Number of steps of `dt` seconds in `max_duration` times `duration` seconds, rounded up.

    Raises:
        ParameterError: they are more than `MOST_STEPS`.
    """
    steps = max_duration * duration / dt
    if not steps <= MOST_STEPS:
        raise ParameterError(
            "rollout.dt", f"{dt:g} s makes {steps:.3g} steps a roll-out; at most {MOST_STEPS:g} are run."
        )
    return math.ceil(steps - 1e-9)


def resolve(parameters: RolloutParameters, top_speed: float) -> list[Runner]:
    """Complete every controller's parameters from the demonstrations' top speed, m/s.

    Raises:
        ParameterError: a coupling cannot work, or two controllers are the same kind in the same mode.
    """
    runners: list[Runner] = []
    for number, controller in enumerate(parameters.controllers):
        location = f"rollout.controllers.{number}"
        runner = _runner(controller, parameters.mode, top_speed, location)
        if (runner.kind, runner.mode) in [(other.kind, other.mode) for other in runners]:
            raise ParameterError(
                location, f"a second {runner.kind} in mode {runner.mode}; their rows could not be told apart."
            )
        runners.append(runner)
    return runners


def _runner(controller: Controller, mode: Mode, top_speed: float, location: str) -> Runner:
    if isinstance(controller, LpvdsController):
        return Runner(kind=controller.kind, mode=mode, coupling=PLAIN)
    mode = controller.mode or mode
    if mode == "robust":
        robust = robust_coupling(v_max=controller.v_max, top_speed=top_speed, location=location)
        return Runner(kind=controller.kind, mode=mode, coupling=robust.compiled)
    paper = paper_coupling(
        p_max=controller.p_max, k_c=controller.k_c, gate=controller.gate, top_speed=top_speed, location=location
    )
    return Runner(kind=controller.kind, mode=mode, coupling=paper.compiled)


def check(parameters: RolloutParameters, dimension: int) -> None:
    """Refuse what has no meaning for a system of this dimension, before anything runs.

    Raises:
        ParameterError: with the dotted location of the parameter.
    """
    for name, value in (
        ("dt", parameters.dt),
        ("stop_distance", parameters.stop_distance),
        ("max_duration", parameters.max_duration),
    ):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise ParameterError(f"rollout.{name}", f"must be a positive number, not {value:g}.")
    for name, entries in (("controllers", parameters.controllers), ("conditions", parameters.conditions)):
        if not entries:
            raise ParameterError(f"rollout.{name}", "at least one is needed.")
    names: set[str] = set()
    for number, condition in enumerate(parameters.conditions):
        location = f"rollout.conditions.{number}"
        if not re.fullmatch(r"[\w.+-]+", condition.name):
            raise ParameterError(
                f"{location}.name", f"{condition.name!r} must be letters, digits, '_', '.', '+' or '-'."
            )
        if condition.name in names:
            raise ParameterError(f"{location}.name", f"{condition.name!r} is the name of an earlier condition.")
        names.add(condition.name)
        _check_condition(condition, dimension, location)


def _check_condition(condition: Condition, dimension: int, location: str) -> None:
    fraction, time, displacement = condition.at_fraction, condition.at_time, condition.displacement
    if fraction is not None and time is not None:
        raise ParameterError(f"{location}.at_time", "give at_fraction or at_time, not both.")
    if fraction is not None and not 0.0 <= fraction <= 1.0:
        raise ParameterError(f"{location}.at_fraction", f"must lie between 0 and 1, not {fraction:g}.")
    if time is not None and not (math.isfinite(time) and time >= 0.0):
        raise ParameterError(f"{location}.at_time", f"must be a number of seconds from the start, not {time:g}.")
    if displacement is None:
        if fraction is not None or time is not None:
            raise ParameterError(f"{location}.displacement", "is missing, but the condition says when it happens.")
        return
    if len(displacement) != dimension:
        raise ParameterError(
            f"{location}.displacement", f"has {len(displacement)} coordinates, the motion has {dimension}; metres."
        )
    if not all(map(math.isfinite, displacement)):
        raise ParameterError(f"{location}.displacement", "must be finite; metres.")


def check_starts(starts: Sequence[Trajectory], dimension: int, top_speed: float) -> None:
    """Refuse demonstrations that a system of this dimension cannot start from, or that never move (top speed in m/s).

    Raises:
        DataError: naming the demonstration.
    """
    if not (math.isfinite(top_speed) and top_speed > 0.0):
        raise DataError("demonstrations", f"their top speed is {top_speed:g} m/s: nothing moves.")
    seen: set[str] = set()
    for start in starts:
        if start.dimension != dimension:
            raise DataError(start.name, f"has {start.dimension} coordinates, the learned system has {dimension}.")
        if start.name in seen:
            raise DataError(start.name, "two starts have this name.")
        seen.add(start.name)
