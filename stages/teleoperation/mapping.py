"""One master and two followers: the left pad copies the master's relative motion, the right one keeps beside it.

Paper eqs. (1)-(3). Both relative positions of eq. (1) count from the last clutch-in, so that a large motion is made of
small strokes. Beyond the print: a low-pass against tremor, a workspace that both pads stay in, and what happens when
the master falls silent. Arrays in, arrays out. Not here: where samples come from (`masters.py`), and the arms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.errors import DataError, ParameterError
from stages.teleoperation.parameters import MappingParameters
from stages.trajectory import Array, frozen

ROTATION_TOLERANCE = 1e-9
"""Largest deviation of R'R from I, and of a quaternion's square from 1: beyond it |dp_f| = alpha |dp_m| is not kept."""

HALF_POWER = math.sqrt(math.sqrt(2.0) - 1.0)
"""Frequency at which two equal first-order lags in a row halve the power, as a multiple of that of one of them."""

_SOURCE = "teleoperation"


class Clutch(Enum):
    """Whether the arms follow the master, and what to do about it."""

    RELEASED = "released: the arms stand still; press the clutch to move them"
    ENGAGED = "engaged: the arms follow the master; release the clutch to stop them"
    LOST = "lost: the master's samples were stale or not finite, the arms stand still; release the clutch and press it"


@dataclass(frozen=True, eq=False)
class MasterSample:
    """What a master says at one moment.

    Attributes:
        time: when it was so, seconds, on the clock of the ticks.
        position: array, shape (3,), metres, in the master's base frame.
        quaternion: array, shape (4,), x y z w; recorded, and not followed: the paper maps positions only.
        clutch: whether it is pressed.
    """

    time: float
    position: Array
    quaternion: Array
    clutch: bool

    def __post_init__(self) -> None:
        for name, shape in (("position", (3,)), ("quaternion", (4,))):
            value = frozen(getattr(self, name))
            if value.shape != shape:
                raise DataError(_SOURCE, f"the {name} of a master has shape {shape}, not {value.shape}.")
            object.__setattr__(self, name, value)

    @property
    def finite(self) -> bool:
        """Whether all of its numbers are."""
        numbers = math.isfinite(self.time) and np.isfinite(self.position).all() and np.isfinite(self.quaternion).all()
        return bool(numbers)


class Pads(NamedTuple):
    """Commanded centres of the pads, in the arms' base frame.

    Attributes:
        left, right: arrays, shape (3,), metres.
    """

    left: Array
    right: Array

    @property
    def midpoint(self) -> Array:
        """Array, shape (3,), metres. Paper eq. (4)."""
        return 0.5 * (self.left + self.right)


class LowPass:
    """A critically damped low-pass of second order, exact for an input that is constant between calls.

    Attributes:
        value: array, shape (d,), the output.
        slope: array, shape (d,), its rate of change, 1/s.
    """

    def __init__(self, frequency: float, start: Array) -> None:
        """Begin settled at `start`, array, shape (d,); the power is halved at `frequency`, Hz; inf: no filter."""
        self._rate = 2.0 * math.pi * frequency / HALF_POWER
        self.value, self.slope = start.copy(), np.zeros_like(start)

    def advance(self, to: Array, dt: float) -> Array:
        """Return the output after `dt` seconds of the input `to`, array, shape (d,); settles on it, never overshoots.

        From rest, that is: e = value - to obeys e'' + 2 w e' + w^2 e = 0.
        """
        decay = 0.0 if math.isinf(self._rate) else math.exp(-self._rate * dt)
        if decay == 0.0:
            self.value, self.slope = to.copy(), np.zeros_like(to)
            return self.value
        e = self.value - to
        ramp = self.slope + self._rate * e
        self.value = to + decay * (e + dt * ramp)
        self.slope = decay * (self.slope - self._rate * dt * ramp)
        return self.value


class SharedTeleoperation:
    """The paper's single-master, dual-follower mapping; one call a tick. Paper eqs. (1)-(3).

    Attributes:
        alpha: scale of eq. (2).
        R_mf: array, shape (3, 3), rotation of eq. (2), read-only.
        separation: L of eq. (3), metres.
        low, high: arrays, shape (3,), metres, read-only: where the left pad may be, so that both are in the workspace.
        status: whether the arms follow.
        limited: whether the workspace held the pads back in the last step.
    """

    def __init__(self, given: MappingParameters, left: ArrayLike, *, location: str = "teleoperation.mapping") -> None:
        """Begin, declutched, with the left pad at `left`, shape (3,), metres; the right one is beside it.

        `location` is the dotted place of the parameters. Raises ParameterError where one has no meaning, DataError
        where a pad would be outside the workspace.
        """
        for name in ("alpha", "separation", "low_pass", "stale"):
            value = getattr(given, name)
            if not value > 0.0 or (math.isinf(value) and name != "low_pass"):
                raise ParameterError(f"{location}.{name}", f"must be a positive number, not {value:g}.")
        self.alpha, self.separation = given.alpha, given.separation
        self.R_mf = rotation(given.R_mf, f"{location}.R_mf")
        self.low, self.high = _room(given, location)
        self.status, self.limited = Clutch.RELEASED, False
        self._left = point(left, "the left pad's start")
        self._apart = np.array([0.0, self.separation, 0.0])
        outside = (self._left < self.low) | (self._left > self.high)
        if outside.any():
            axis = int(np.argmax(outside))
            raise DataError(
                _SOURCE,
                f"the left pad starts at {'xyz'[axis]} = {self._left[axis]:.6g} m, where both pads are within "
                f"{location}.low and {location}.high only from {self.low[axis]:.6g} to {self.high[axis]:.6g} m: "
                "start there, or widen the workspace.",
            )
        self._low_pass, self._stale = given.low_pass, given.stale
        self._filter = LowPass(self._low_pass, np.zeros(3))
        self._master_anchor, self._follower_anchor = np.zeros(3), self._left.copy()
        self._time = -math.inf
        self._sample: MasterSample | None = None

    @property
    def pads(self) -> Pads:
        """Where both pads are commanded to be. Paper eq. (3)."""
        return Pads(self._left.copy(), self._left - self._apart)

    def step(self, time: float, sample: MasterSample | None) -> Pads:
        """Return the commanded pads at `time`, seconds, from the master's sample; none: nothing new has come.

        Raises DataError where `time` is not a number, or earlier than that of the step before.
        """
        if not (math.isfinite(time) and time >= self._time):
            raise DataError(_SOURCE, f"a tick at {time:g} s cannot follow one at {self._time:g} s.")
        dt = time - self._time
        self._time, self.limited = time, False
        self._sample = sample = self._sample if sample is None else sample
        if sample is None:
            return self.pads
        if not (sample.finite and abs(time - sample.time) <= self._stale):
            self.status = Clutch.LOST
        elif not sample.clutch:
            self.status = Clutch.RELEASED
        elif self.status is Clutch.RELEASED:
            self._engage(sample.position)
        elif self.status is Clutch.ENGAGED:
            self._follow(sample.position, dt)
        return self.pads

    def _engage(self, position: Array) -> None:
        """Count both relative positions from here: t_0 of eq. (1)."""
        self.status = Clutch.ENGAGED
        self._filter = LowPass(self._low_pass, position)
        self._anchor(position)

    def _anchor(self, position: Array) -> None:
        self._master_anchor, self._follower_anchor = position.copy(), self._left

    def _follow(self, position: Array, dt: float) -> None:
        """Move the left pad. Paper eqs. (1), (2)."""
        with np.errstate(over="ignore", invalid="ignore"):
            filtered = self._filter.advance(position, dt)
            wanted = self._follower_anchor + self.alpha * (self.R_mf @ (filtered - self._master_anchor))
        if not np.isfinite(wanted).all():  # finite numbers, too large to calculate with
            self.status = Clutch.LOST
            return
        self._left = np.clip(wanted, self.low, self.high)
        self.limited = bool((self._left != wanted).any())
        if self.limited:  # what lies beyond is forgotten, so that reversing moves at once
            self._anchor(filtered)


def rotation(numbers: tuple[float, ...], location: str) -> Array:
    """R_mf of eq. (2), array, shape (3, 3), read-only, from nine numbers, row by row, or a quaternion, x y z w.

    Raises ParameterError where it is not in SO(3): R'R = I to 1e-9 and det R = 1; `location` is its dotted place.
    """
    given = np.array(numbers, dtype=np.float64)
    if given.shape not in ((9,), (4,)) or not np.isfinite(given).all():
        raise ParameterError(
            location, f"must be nine finite numbers, row by row, or a unit quaternion, x y z w, not {list(numbers)}."
        )
    if given.size == 4:
        return _from_quaternion(given, location)
    R = given.reshape(3, 3)
    error, det = float(np.abs(R.T @ R - np.eye(3)).max()), float(np.linalg.det(R))
    if error > ROTATION_TOLERANCE or det < 0.0:
        U, _, Vt = np.linalg.svd(R)
        nearest = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        raise ParameterError(
            location,
            f"is no rotation: R'R differs from I by {error:.3g} (at most {ROTATION_TOLERANCE:g} is allowed) and det = "
            f"{det:.6g} (must be 1); the nearest rotation is [{_listed(nearest.ravel())}].",
        )
    return frozen(R)


def _from_quaternion(q: Array, location: str) -> Array:
    square = float(q @ q)
    if abs(square - 1.0) > ROTATION_TOLERANCE:
        remedy = f"; of length 1 it is [{_listed(q / math.sqrt(square))}]" if square > 0.0 else ""
        raise ParameterError(location, f"is a quaternion of length {math.sqrt(square):.9g}, which must be 1{remedy}.")
    x, y, z, w = q / math.sqrt(square)
    return frozen(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _listed(numbers: Array) -> str:
    return ", ".join(f"{number + 0.0:.12g}" for number in numbers.round(12))


def _room(given: MappingParameters, location: str) -> tuple[Array, Array]:
    """Lowest and highest position of the left pad, arrays, shape (3,), metres, with which both are in the workspace."""
    corners = {name: point(getattr(given, name), name, f"{location}.{name}") for name in ("low", "high")}
    low, high = corners["low"], corners["high"]
    if not (low < high).all():
        axis = "xyz"[int(np.argmin(low < high))]
        raise ParameterError(f"{location}.high", f"must be above {location}.low along {axis}; exchange the two.")
    floor, L = low.copy(), given.separation
    floor[1] += L
    if floor[1] - L < low[1]:  # by rounding
        floor[1] = np.nextafter(floor[1], np.inf)
    if not floor[1] <= high[1]:
        raise ParameterError(
            f"{location}.separation",
            f"{L:g} m do not fit into a workspace of {high[1] - low[1]:g} m along y: the pads must both be inside; "
            f"widen {location}.low and {location}.high.",
        )
    return frozen(floor), frozen(high)


def point(values: ArrayLike, name: str, location: str = "") -> Array:
    """Three finite numbers as an array of its own, shape (3,).

    Raises ParameterError at the dotted place `location`, where there is one, else DataError, which calls it `name`.
    """
    try:
        given = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.array(math.nan)
    if given.shape != (3,) or not np.isfinite(given).all():
        if location:
            raise ParameterError(location, f"must be three finite numbers, metres, not {values!r}.")
        raise DataError(_SOURCE, f"{name} must be three finite numbers, metres, not {values!r}.")
    return given
