"""What a system is fitted to: the demonstrations' samples, and guides beside them that lead back to them.

A demonstration says how to move on its path and nothing of what to do beside it, so that the least squares of eq. (7)
is free to move away there. A guide is a made sample beside a real one: its velocity is the real one's, turned so that
the distance decays along the path. Guides are few, count less than samples, and are no part of any error that is
reported. Not here: what is fitted (`learn.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stages.trajectory import Array, Trajectory, frozen

GUIDE_SAMPLES = 100
"""Most samples of a demonstration that have guides."""

REST = 0.01
"""Below this share of its top speed a demonstration is at rest."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """States and what their velocities should be.

    Attributes:
        position: array, shape (n, d), metres.
        velocity: array, shape (n, d), m/s.
    """

    position: Array
    velocity: Array

    def __post_init__(self) -> None:
        for name in ("position", "velocity"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """The size and the directions of the training data, in which lengths and offsets are measured.

    They turn and scale with the data, so that a unit or a rotation changes nothing that is learned.

    Attributes:
        size: diagonal of the data's extent along its own principal axes, metres.
        axes: array, shape (d, d), principal axes about the goal as rows, the longest first.
    """

    size: float
    axes: Array


def frame_of(demonstrations: Sequence[Trajectory], goal: Array) -> Frame:
    """Return the frame of demonstrations about the goal, shape (d,), metres."""
    return frame_about(np.concatenate([demonstration.position for demonstration in demonstrations]) - goal)


def frame_about(position: Array) -> Frame:
    """Return the frame of positions relative to the goal, shape (n, d), metres."""
    axes = np.linalg.eigh(position.T @ position)[1].T[::-1]
    along = position @ axes.T
    return Frame(size=float(np.linalg.norm(along.max(axis=0) - along.min(axis=0))), axes=frozen(axes))


def resting(demonstration: Trajectory) -> NDArray[np.bool_]:
    """Return where a demonstration is at rest, shape (n,): slower than `REST` of its top speed."""
    speed = np.sqrt((demonstration.velocity**2).sum(axis=1))
    return np.asarray(speed < REST * speed.max(), dtype=np.bool_)


def in_motion(demonstration: Trajectory) -> Trajectory:
    """Return a demonstration without its rests, on a clock that stands still meanwhile.

    A motion that depends on the state alone cannot pause, and trying would slow it down there.
    """
    moving = ~resting(demonstration)
    if moving.all():
        return demonstration
    return replace(
        demonstration,
        time=np.asarray(demonstration.step * np.arange(int(moving.sum()))),
        position=demonstration.position[moving],
        velocity=demonstration.velocity[moving],
    )


def thinned(demonstration: Trajectory, count: int | None) -> Samples:
    """Return at most `count` samples of a demonstration, evenly spaced in time; none: all of them."""
    n = demonstration.time.shape[0]
    chosen = np.linspace(0, n - 1, n if count is None else min(count, n)).round().astype(np.int64)
    return Samples(position=demonstration.position[chosen], velocity=demonstration.velocity[chosen])


def guides(demonstration: Trajectory, frame: Frame, width: float, decay: float) -> Samples:
    """Return guides beside a demonstration, two for each principal axis at at most `GUIDE_SAMPLES` of its samples.

    At x + w with w = +-c P e_i (P: onto the plane across the velocity v, e_i: a principal axis) the velocity is v - |v|
    w/decay, so that w decays as exp(-s/decay) along the path s. Taking the data's own axes makes the guides turn with
    the data; c makes the root mean square of |w| the width.

    `width`, `decay`: metres.
    """
    chosen = thinned(demonstration, GUIDE_SAMPLES)
    speed = np.sqrt((chosen.velocity**2).sum(axis=1))
    moving = speed > 0.0
    x, v, speed = chosen.position[moving], chosen.velocity[moving], speed[moving, None]
    tangent = v / speed
    d = x.shape[1]
    reach = width * np.sqrt(d / max(d - 1, 1))
    position, velocity = [], []
    for axis in frame.axes:
        across = axis - (tangent @ axis)[:, None] * tangent
        for side in (-reach, reach):
            position.append(x + side * across)
            velocity.append(v - speed * (side / decay) * across)
    return Samples(position=np.concatenate(position), velocity=np.concatenate(velocity))
