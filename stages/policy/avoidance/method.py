"""From what can be set about avoidance to what compiled code takes: completed and checked."""

from __future__ import annotations

import math

from pipeline.errors import ParameterError
from stages.policy.avoidance.parameters import (
    ApfParameters,
    CbfParameters,
    ModulationParameters,
    NoAvoidance,
    RoasParameters,
)
from stages.policy.avoidance.parameters import (
    Avoidance as Given,
)
from stages.policy.avoidance.scratch import APF, CBF, IGNORE, MODULATION, ROAS, ROAS_PLUS, Avoidance

RATE = 10.0
"""1/s. An obstacle is approached as exp(-10 t): near it within a second."""

SPEED_LIMIT = 1.5
"""Multiple of the demonstrations' top speed at which moving obstacles are given way to."""

PUSH = 0.1
"""Gain of a potential field, as a multiple of the demonstrations' top speed."""


LEAST = {"margin": 0.0, "swiftness": 1.0}
"""Of these parameters; all others are positive."""

REACHED = 1.0 - 1e-12
"""Share of the executed state's top speed that x may have: a step at all of it may round to more than it reaches."""


def resolve_avoidance(given: Given, top_speed: float, dt: float, v_max: float, location: str) -> Avoidance:
    """Complete a method's parameters.

    Args:
        given: as set.
        top_speed: of the demonstrations, m/s.
        dt: step, seconds.
        v_max: top speed of the executed state, m/s; inf: none.
        location: dotted place of the parameters, for messages.

    Raises:
        ParameterError: a number is out of range, or a row would let a step jump into an obstacle.
    """
    for name, value in vars(given).items():
        if isinstance(value, bool | str | None):
            continue
        least = LEAST.get(name)
        if not (math.isfinite(value) and (value > 0.0 if least is None else value >= least)):
            wanted = "positive number" if least is None else f"finite number, {least:g} or more"
            raise ParameterError(f"{location}.{name}", f"must be a {wanted}, not {value:g}.")
    if isinstance(given, NoAvoidance):
        return IGNORE
    if isinstance(given, RoasParameters):
        return Avoidance(ROAS, gain=1.0 / given.unit)
    if isinstance(given, ModulationParameters):
        return Avoidance(MODULATION, gain=given.reactivity, margin=given.margin)
    fastest = REACHED * v_max
    limit = min(SPEED_LIMIT * top_speed if given.speed_limit is None else given.speed_limit, fastest)
    if isinstance(given, ApfParameters):
        gain = PUSH * top_speed if given.gain is None else given.gain
        return Avoidance(APF, reach=given.range or 0.0, gain=gain, speed_limit=limit)
    rate = min(RATE, 1.0 / dt) if given.rate is None else given.rate
    if rate * dt > 1.0 + 1e-12:
        raise ParameterError(
            f"{location}.rate",
            f"{rate:g} 1/s with dt = {dt:g} s lets one step take more than the whole distance to an obstacle; at most "
            f"1/dt = {1.0 / dt:g} is safe.",
        )
    if isinstance(given, CbfParameters):
        return Avoidance(CBF, rate=rate, margin=given.margin, speed_limit=limit, fastest=fastest)
    return Avoidance(
        ROAS_PLUS,
        rate=rate,
        gain=given.gain,
        margin=given.margin,
        swiftness=given.swiftness,
        speed_limit=limit,
        fastest=fastest,
        detour=given.detour,
    )


def margin_of(given: Given) -> float:
    """The distance that a method keeps beyond every obstacle, metres."""
    return float(getattr(given, "margin", 0.0))
