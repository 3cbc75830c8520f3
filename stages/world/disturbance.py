"""Disturbances of the executed state: displaced once, dragged and held, shaken. Paper Figs. 2, 3 and 5d.

When one begins is a sample, or a number of steps that the policy has made undisturbed. Arrays in, arrays out. Not here:
what a person may ask for (`stages/rollout/parameters.py`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stages.compiled import compiled, lean
from stages.trajectory import Array

ONCE, DRAG, NOISE = 0, 1, 2

NEVER = -1
"""Sample of a disturbance that has not begun."""

CALM, MOVED, DRAGGED = 0, 1, 2
"""What disturbances do in a sample: nothing; they displace the executed state; they take it from the policy."""


class Pushes(NamedTuple):
    """n disturbances in d coordinates.

    Attributes:
        kinds: array of int, shape (n,): ONCE, DRAG or NOISE.
        samples: array of int, shape (n,): when it begins; -1: when `steps` says.
        steps: array of int, shape (n,): after how many steps that no disturbance has held up.
        offsets: array, shape (n, d), metres: of ONCE and DRAG.
        rises: array of int, shape (n,): samples until a dragged state is at its offset; 0: at once.
        holds: array of int, shape (n,): samples for which it is held there; of NOISE, how many samples it lasts.
        noise: array, shape (n, longest, d), metres: displacement of each sample of NOISE, in order; unused of others.
    """

    kinds: NDArray[np.int64]
    samples: NDArray[np.int64]
    steps: NDArray[np.int64]
    offsets: Array
    rises: NDArray[np.int64]
    holds: NDArray[np.int64]
    noise: Array


class Pushed(NamedTuple):
    """What has come of disturbances so far. All will be modified.

    Attributes:
        begun: array of int, shape (n,), the sample at which each has begun; -1: it has not.
        anchors: array, shape (n, d), metres, where the executed state was then.
    """

    begun: NDArray[np.int64]
    anchors: Array


def no_pushes(d: int, n: int = 0) -> Pushes:
    """Room for n disturbances in d coordinates, displacements by nothing that never come until they are filled in."""
    return Pushes(
        np.full(n, ONCE),
        np.full(n, NEVER),
        np.full(n, np.iinfo(np.int64).max),
        np.zeros((n, d)),
        np.zeros(n, dtype=np.int64),
        np.zeros(n, dtype=np.int64),
        np.zeros((n, 0, d)),
    )


@compiled
def unpushed(pushes: Pushes) -> Pushed:
    """Return the record of disturbances of which none has begun."""
    n, d = pushes.offsets.shape
    return Pushed(np.full(n, NEVER), np.zeros((n, d)))


@lean
def last_sample(pushes: Pushes, index: int, begun: int) -> int:
    """Return the last sample at which a disturbance acts that has begun at sample `begun`."""
    return begun + (0 if pushes.kinds[index] == ONCE else pushes.rises[index] + max(pushes.holds[index] - 1, 0))


@lean
def disturb(pushes: Pushes, pushed: Pushed, sample: int, steps: int, executed: Array) -> int:
    """Let all disturbances act that are due; return CALM, MOVED or DRAGGED.

    Args:
        pushes: disturbances.
        pushed: will be modified.
        sample: number of the present one.
        steps: how many the policy has made that no disturbance has held up.
        executed: array, shape (d,), metres. Will be modified.
    """
    acted = CALM
    for k in range(pushes.kinds.shape[0]):
        if pushed.begun[k] == NEVER:
            due = sample >= pushes.samples[k] if pushes.samples[k] >= 0 else steps >= pushes.steps[k]
            if not due:
                continue
            pushed.begun[k] = sample
            for j in range(executed.shape[0]):
                pushed.anchors[k, j] = executed[j]
        since = sample - pushed.begun[k]
        if sample > last_sample(pushes, k, pushed.begun[k]):
            continue
        acted = max(acted, DRAGGED if pushes.kinds[k] == DRAG else MOVED)
        for j in range(executed.shape[0]):
            if pushes.kinds[k] == ONCE:
                executed[j] += pushes.offsets[k, j]
            elif pushes.kinds[k] == NOISE:
                executed[j] += pushes.noise[k, since, j]
            else:
                share = min(since / pushes.rises[k], 1.0) if pushes.rises[k] > 0 else 1.0
                executed[j] = pushed.anchors[k, j] + share * pushes.offsets[k, j]
    return acted
