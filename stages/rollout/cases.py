"""From the parameters of a roll-out stage to what runs: checked, completed, refused where it has no meaning.

Whatever has no meaning is refused here, before anything runs. Not here: the roll-outs (`simulate.py`), and how a
coupling or a method of avoidance completes its own parameters (`stages/policy`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from pipeline.errors import DataError, ParameterError
from stages.policy.avoidance.parameters import Avoidance, NoAvoidance
from stages.policy.avoidance.scene import shapes_of
from stages.policy.coupled import PLAIN
from stages.policy.coupling import check_explicit, paper_coupling, robust_coupling
from stages.rollout.parameters import (
    Condition,
    Controller,
    Disturbance,
    LpvdsController,
    Noise,
    RandomScenes,
    RolloutParameters,
)
from stages.rollout.results import Runner
from stages.trajectory import Trajectory

MOST_STEPS = 10_000_000
"""Longer roll-outs are a mistake in the parameters: at d = 3 they would fill half a gigabyte."""

NAME = re.compile(r"[\w.+-]+")
"""Of a condition or a method."""


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


def resolve(parameters: RolloutParameters, top_speed: float, dt: float) -> list[Runner]:
    """Complete every controller's parameters from the demonstrations' top speed, m/s; `dt`: the longest step, seconds.

    Raises:
        ParameterError: a coupling cannot work, or two controllers are the same kind in the same mode.
    """
    runners: list[Runner] = []
    for number, controller in enumerate(parameters.controllers):
        location = f"rollout.controllers.{number}"
        runner = runner_of(controller, parameters, top_speed, dt, location)
        if (runner.kind, runner.mode) in [(other.kind, other.mode) for other in runners]:
            raise ParameterError(
                location, f"a second {runner.kind} in mode {runner.mode}; their rows could not be told apart."
            )
        runners.append(runner)
    return runners


def runner_of(
    controller: Controller, parameters: RolloutParameters, top_speed: float, dt: float, location: str
) -> Runner:
    """Complete one controller's parameters; `location`: their dotted place. Otherwise as `resolve`."""
    if isinstance(controller, LpvdsController):
        return Runner(kind=controller.kind, mode=parameters.mode, coupling=PLAIN)
    mode = controller.mode or parameters.mode
    if mode == "robust":
        robust = robust_coupling(
            v_max=controller.v_max, tolerance=controller.tolerance, top_speed=top_speed, location=location
        )
        return Runner(kind=controller.kind, mode=mode, coupling=robust.compiled)
    paper = paper_coupling(
        p_max=controller.p_max, k_c=controller.k_c, gate=controller.gate, top_speed=top_speed, location=location
    )
    if parameters.integrator == "euler":
        check_explicit(paper, dt, location)
    return Runner(kind=controller.kind, mode=mode, coupling=paper.compiled)


def method_name(method: Avoidance) -> str:
    """What tables call a method of avoidance."""
    return method.name or method.kind


def methods_of(condition: Condition, parameters: RolloutParameters) -> tuple[tuple[str, Avoidance], ...]:
    """Dotted place and method of avoidance that run under a condition: without obstacles, one that does nothing."""
    if not condition.obstacles and condition.scenes is None:
        return (("rollout.avoidances", NoAvoidance()),)
    return tuple((f"rollout.avoidances.{number}", method) for number, method in enumerate(parameters.avoidances))


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
    lists = (("controllers", parameters.controllers), ("conditions", parameters.conditions))
    for name, entries in (*lists, ("avoidances", parameters.avoidances)):
        if not entries:
            raise ParameterError(f"rollout.{name}", "at least one is needed.")
    _check_names("rollout.conditions", [condition.name for condition in parameters.conditions], "condition")
    _check_names("rollout.avoidances", [method_name(method) for method in parameters.avoidances], "method")
    for number, condition in enumerate(parameters.conditions):
        location = f"rollout.conditions.{number}"
        for index, disturbance in enumerate(condition.disturbances):
            _check_disturbance(disturbance, dimension, f"{location}.disturbances.{index}")
        shapes_of(condition.obstacles, dimension, f"{location}.obstacles")
        if condition.scenes is not None:
            if condition.obstacles:
                raise ParameterError(f"{location}.scenes", "give obstacles or random scenes, not both.")
            _check_scenes(condition.scenes, f"{location}.scenes")


def _check_names(location: str, names: Sequence[str], word: str) -> None:
    for number, name in enumerate(names):
        if not NAME.fullmatch(name):
            raise ParameterError(
                f"{location}.{number}.name", f"{name!r} must be letters, digits, '_', '.', '+' or '-'."
            )
        if name in names[:number]:
            raise ParameterError(f"{location}.{number}.name", f"{name!r} is the name of an earlier {word}.")


def _check_disturbance(disturbance: Disturbance, dimension: int, location: str) -> None:
    given = [name for name in ("at_fraction", "at_time", "at_state") if getattr(disturbance, name) is not None]
    if len(given) > 1:
        raise ParameterError(f"{location}.{given[1]}", f"give {given[0]} or {given[1]}, not both.")
    for name, value in vars(disturbance).items():
        if isinstance(value, float) and not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(f"{location}.{name}", f"must be a finite number, 0 or more, not {value:g}.")
    if disturbance.at_fraction is not None and disturbance.at_fraction > 1.0:
        raise ParameterError(f"{location}.at_fraction", f"must be at most 1, not {disturbance.at_fraction:g}.")
    vectors = ("at_state",) if isinstance(disturbance, Noise) else ("at_state", "offset")
    for name in vectors:
        vector = getattr(disturbance, name)
        if vector is None:
            continue
        if len(vector) != dimension:
            raise ParameterError(
                f"{location}.{name}", f"has {len(vector)} coordinates, the motion has {dimension}; metres."
            )
        if not all(map(math.isfinite, vector)):
            raise ParameterError(f"{location}.{name}", "must be finite; metres.")


def _check_scenes(scenes: RandomScenes, location: str) -> None:
    for name, value in vars(scenes).items():
        if not math.isfinite(value):
            raise ParameterError(f"{location}.{name}", f"must be finite, not {value:g}.")
    for low, high in (("fewest", "most"), ("smallest", "largest")):
        if getattr(scenes, low) > getattr(scenes, high):
            raise ParameterError(f"{location}.{low}", f"is more than {high}.")


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
