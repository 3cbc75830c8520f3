"""From the disturbances of a condition to samples and steps of one roll-out. Paper Figs. 2, 3 and 5d.

By default a disturbance begins where the arc length of the controller's OWN undisturbed executed path reaches half of
its total. Steps are counted that no disturbance holds up, so that of several disturbances in a row each comes where it
would on the undisturbed path. Not here: what they do to the executed state (`stages/world`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stages.paths import arc_length
from stages.rollout.cases import MOST_STEPS
from stages.rollout.parameters import Displacement, Disturbance, Held, Noise, Ramp
from stages.trajectory import Array
from stages.world.disturbance import DRAG, NEVER, NOISE, ONCE, Pushes, no_pushes


class Timed(Protocol):
    """A disturbance that says when it comes: by one of the three, or half way."""

    @property
    def at_fraction(self) -> float | None:
        """Fraction of the arc length of the undisturbed path."""

    @property
    def at_time(self) -> float | None:
        """Seconds."""

    @property
    def at_state(self) -> tuple[float, ...] | None:
        """A place, metres."""


HALF_WAY = 0.5
"""Where a disturbance begins if it does not say: a fraction of the arc length. Paper Fig. 3."""

ROUNDING = 1e-12
"""A length counts as reached if this share of it is missing: sums of steps round."""


def pushes_of(
    disturbances: Sequence[Disturbance],
    undisturbed: Array,
    dt: float,
    steps: int,
    draw: Callable[[str], np.random.Generator],
) -> Pushes:
    """Disturbances as compiled code takes them.

    Args:
        disturbances: of the condition.
        undisturbed: array, shape (n, d), metres: the executed path of the same case without them.
        dt: step, seconds.
        steps: the most that the roll-out makes.
        draw: number of a disturbance -> its random numbers.
    """
    n, d = len(disturbances), undisturbed.shape[1]
    pushes = no_pushes(d, n)
    lasting = [min(samples(one.duration, dt), steps + 1) if isinstance(one, Noise) else 0 for one in disturbances]
    longest = max(lasting, default=0)
    pushes = pushes._replace(noise=np.zeros((n, longest, d)))
    for k, one in enumerate(disturbances):
        pushes.samples[k], pushes.steps[k] = begin(one, undisturbed, dt)
        if isinstance(one, Noise):
            pushes.kinds[k], pushes.holds[k] = NOISE, lasting[k]
            pushes.noise[k, : lasting[k]] = one.std * draw(str(k)).normal(size=(lasting[k], d))
            continue
        pushes.kinds[k] = ONCE if isinstance(one, Displacement) else DRAG
        pushes.offsets[k] = one.offset
        if isinstance(one, Held):
            pushes.holds[k] = samples(one.duration, dt)
        elif isinstance(one, Ramp):
            pushes.rises[k], pushes.holds[k] = samples(one.rise, dt), samples(one.hold, dt)
    return pushes


def samples(duration: float, dt: float) -> int:
    """Number of steps of `dt` seconds in a duration, seconds, rounded up; no more than any roll-out makes."""
    return math.ceil(min(duration / dt, MOST_STEPS + 1) - 1e-9)


def begin(disturbance: Timed, undisturbed: Array, dt: float) -> tuple[int, int]:
    """Sample at which a disturbance begins, or -1, and the steps after which it does.

    Arguments as of `pushes_of`.
    """
    if disturbance.at_time is not None:
        return samples(disturbance.at_time, dt), 0
    if disturbance.at_state is not None:
        return NEVER, int(np.argmin(np.linalg.norm(undisturbed - np.array(disturbance.at_state), axis=1)))
    fraction = HALF_WAY if disturbance.at_fraction is None else disturbance.at_fraction
    length = arc_length(undisturbed)
    return NEVER, int(np.searchsorted(length, fraction * float(length[-1]) * (1.0 - ROUNDING)))


def spans_of(acting: NDArray[np.bool_]) -> tuple[tuple[int, int], ...]:
    """First and last samples of the spans in which something acts; `acting`: array of bool, shape (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], acting, [False]])))
    return tuple((int(first), int(last) - 1) for first, last in edges.reshape(-1, 2))


def merged_spans(spans: Sequence[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Spans of samples, first and last, in order, those that overlap or touch as one."""
    joined: list[tuple[int, int]] = []
    for first, last in sorted(spans):
        if joined and first <= joined[-1][1] + 1:
            joined[-1] = (joined[-1][0], max(joined[-1][1], last))
        else:
            joined.append((first, last))
    return tuple(joined)
