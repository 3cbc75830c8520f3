"""A made operator: leads the pads' midpoint through via-points by strokes of a trembling hand in a small workspace.

A stroke is planned once, from what is seen, and carried out blindly: a minimum-jerk motion, through several via-points
where they fit into the workspace. After a reaction time the operator looks where the pads really are and makes the next
stroke from there. Where there is no room for one, the hand lets go and returns to the other side. Seeded: the same
seed and ticks give the same samples. Arrays in, arrays out.

The motion through via-points: T. Flash, N. Hogan, The coordination of arm movements, J. Neurosci. 5 (1985) 1688-1703.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_interp_spline
from scipy.special import betaincinv

from pipeline.errors import DataError, ParameterError
from stages.teleoperation.mapping import MasterSample, point
from stages.teleoperation.masters import Seen
from stages.teleoperation.parameters import SimulatedOperatorParameters
from stages.trajectory import Array, frozen

SHORTEST = 0.3
"""Shortest stroke, s: a correcting movement of a hand."""

ROOM = 0.5
"""A stroke that only leads towards a via-point is made where it has this share of the workspace's diameter."""

RESPONSE = 0.5
"""Where the pads have moved by less than this share of a stroke, the hand lets go and takes hold again."""

BLIND = 1.0
"""The hand passes a via-point without a stop where its aim errs by at most this multiple of the tolerance, per axis."""

EVEN = 0.25
"""... and where the shorter of the ways to it and from it is at least this share of the longer.

The motion of least jerk swings wide of two points close together.
"""

WAVES = 6
"""Sine waves of the tremor of a coordinate."""

SAMPLES = 48
"""Samples of a stroke at which its speed and its place in the workspace are looked at."""

UNTURNED = frozen([0.0, 0.0, 0.0, 1.0])


class Act(Enum):
    """What the hand does."""

    LOOK = auto()
    RETURN = auto()
    GRIP = auto()
    STROKE = auto()


@dataclass(frozen=True, eq=False)
class Stroke:
    """A motion of the hand.

    Attributes:
        path: array, shape (3,), metres, as a function of a share, 0 to 1, of its time.
        begins: seconds.
        duration: seconds.
        passes: through how many via-points it leads before its end.
        asked: how far the pads are to come, metres, in a straight line.
    """

    path: BSpline
    begins: float
    duration: float
    passes: int = 0
    asked: float = 0.0

    def at(self, time: float) -> Array:
        """Where the hand is, array, shape (3,), metres."""
        return np.asarray(self.path(min(max((time - self.begins) / self.duration, 0.0), 1.0)))


def minimum_jerk(points: ArrayLike) -> BSpline:
    """The motion of least mean square jerk from rest, through points, to rest; time runs from 0 to 1.

    A spline of degree five with four continuous derivatives. The points are passed when a single straight motion of the
    same length would have come as far: on a straight line it is that motion, 10 s^3 - 15 s^4 + 6 s^5.

    Args:
        points: array, shape (n, d), metres, n >= 2; no two neighbours equal, where there are more than two.

    Returns:
        array, shape (d,), as a function of time.
    """
    given = np.asarray(points, dtype=np.float64)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(given, axis=0), axis=1))])
    time = betaincinv(3.0, 3.0, length / length[-1]) if length.shape[0] > 2 else np.array([0.0, 1.0])
    rest = [(1, np.zeros(given.shape[1])), (2, np.zeros(given.shape[1]))]
    return make_interp_spline(time, given, k=5, bc_type=(rest, rest))


class SimulatedOperator:
    """A `Master` that is no human. It does not give up: a via-point out of the pads' reach is tried for ever.

    Attributes:
        reached: how many via-points have been reached or passed.
    """

    def __init__(
        self,
        given: SimulatedOperatorParameters,
        via: ArrayLike,
        generator: np.random.Generator,
        *,
        alpha: float,
        R_mf: ArrayLike,
        leads_in: Collection[str] | None = None,
        location: str = "teleoperation.master",
    ) -> None:
        """Be about to lead the midpoint to `via`, shape (n, 3), metres, in the arms' base frame, in this order.

        Args:
            given: how.
            via: the last one is where the motion ends.
            generator: will be advanced.
            alpha: scale of eq. (2), as the operator has learned it.
            R_mf: array, shape (3, 3), rotation of eq. (2), as the operator has learned it.
            leads_in: phases in which the operator leads; in others the hand lets go and waits; none: in all.
            location: dotted place of the parameters.

        Raises:
            DataError: the via-points are not such an array of finite numbers.
            ParameterError: the band of the tremor is not a lower and a higher frequency.
        """
        self._given, self._random, self._leads_in = given, generator, leads_in
        self._via = _route(via)
        self._alpha, self._to_master = alpha, np.asarray(R_mf, dtype=np.float64).T / alpha
        self._radius = 0.5 * given.stroke
        low, high = given.tremor_band
        if not low <= high:
            raise ParameterError(f"{location}.tremor_band", "must be the lower frequency, then the higher one.")
        self._tremor = _Tremor(given.tremor, low, high, generator)
        self.reached = 0
        self._act, self._until = Act.LOOK, -math.inf
        self._began, self._clutch = False, False
        self._hand = np.zeros(3)
        self._stroke: Stroke | None = None
        self._saw = np.zeros(3)

    @property
    def done(self) -> bool:
        """Whether all via-points have been reached; the clutch is released then."""
        return self.reached >= len(self._via)

    def sample(self, time: float, seen: Seen) -> MasterSample:
        """Return where the hand is at `time`, seconds, and whether it leads. What it does next depends on what is seen.

        Raises DataError where the midpoint seen is not three finite numbers.
        """
        midpoint = point(seen.midpoint, "the midpoint that is seen")
        if not self._began:
            self._began = True
            self._wait(Act.LOOK, time, self._given.reaction)
        if self._leads_in is not None and seen.phase not in self._leads_in:
            self._stroke, self._clutch = None, False
            self._act, self._until = Act.LOOK, time + self._given.reaction
        elif time >= self._until and not self.done:
            self._go_on(time, midpoint)
        if self._stroke is not None:
            self._hand = self._stroke.at(time)
        return MasterSample(time, self._hand + self._tremor.at(time), UNTURNED, self._clutch)

    def _wait(self, act: Act, time: float, least: float) -> None:
        """Do `act` for at least so many seconds and a hesitation."""
        self._act = act
        self._until = time + least + self._given.pause * self._random.uniform(0.5, 1.5)

    def _go_on(self, time: float, midpoint: Array) -> None:
        """End what is being done, and begin what comes next."""
        if self._act is Act.RETURN:
            self._clutch = True
            self._wait(Act.GRIP, time, 0.0)
        elif self._act is Act.STROKE:
            self._wait(Act.LOOK, time, self._given.reaction)
        else:
            self._decide(time, midpoint)

    def _decide(self, time: float, midpoint: Array) -> None:
        """Look how far the pads have come, and make the next stroke, or take hold anew to have room for it."""
        followed = True
        if self._act is Act.LOOK and self._stroke is not None:
            followed = bool(np.linalg.norm(midpoint - self._saw) >= RESPONSE * self._stroke.asked)
            self.reached += self._stroke.passes if followed else 0
        while not self.done and np.linalg.norm(self._via[self.reached] - midpoint) <= self._given.tolerance:
            self.reached += 1
        if self.done:
            self._clutch = False
            return
        stroke = self._plan(time, midpoint) if self._clutch and followed else None
        self._act, self._clutch = (Act.RETURN, False) if stroke is None else (Act.STROKE, True)
        if stroke is None:
            stroke = self._motion(time, np.array([self._hand, self._best_start(midpoint)]))
        self._stroke, self._saw, self._until = stroke, midpoint, stroke.begins + stroke.duration

    def _ahead(self, midpoint: Array) -> Array:
        """The hand's way to the via-points that one stroke may lead through, from 0, shape (n + 1, 3), metres."""
        way, come, last = [np.zeros(3)], 0.0, 0.0
        blind = math.inf if self._given.aim == 0.0 else BLIND * self._given.tolerance / (self._given.aim * self._alpha)
        for via in self._via[self.reached :]:
            there = self._to_master @ (via - midpoint)
            step = float(np.linalg.norm(there - way[-1]))
            if len(way) > 1 and (
                self._given.stops
                or come > blind
                or min(step, last) < EVEN * max(step, last)
                or np.linalg.norm(there) > self._given.stroke
            ):
                break
            way.append(there)
            come, last = come + step, step
        return np.array(way)

    def _fits(self, points: Array) -> bool:
        """Whether a motion through points, shape (n, 3), metres, keeps to the workspace."""
        path = minimum_jerk(points)(np.linspace(0.0, 1.0, SAMPLES))
        return bool((np.linalg.norm(path, axis=1) <= self._radius * (1.0 + 1e-9)).all())

    def _best_start(self, midpoint: Array) -> Array:
        """Where to take hold so that a stroke leads through as many via-points as it can, array, shape (3,), metres."""
        way = self._ahead(midpoint)
        for n in range(way.shape[0], 1, -1):
            centred = way[:n] - 0.5 * (way[:n].min(axis=0) + way[:n].max(axis=0))
            if self._fits(centred):
                return np.asarray(centred[0])
        return np.asarray(-self._radius * way[1] / np.linalg.norm(way[1]))

    def _plan(self, time: float, midpoint: Array) -> Stroke | None:
        """A stroke from where the hand is; none: there is no room for it."""
        way = self._ahead(midpoint)
        for n in range(way.shape[0], 1, -1):
            if self._fits(self._hand + way[:n]):
                asked = self._alpha * float(np.linalg.norm(way[n - 1]))
                return self._motion(time, self._hand + way[:n], passes=n - 2, asked=asked)
        far = float(np.linalg.norm(way[1]))
        along = float(self._hand @ way[1]) / far
        room = math.sqrt(max(along**2 + self._radius**2 - float(self._hand @ self._hand), 0.0)) - along
        if room < ROOM * self._given.stroke:
            return None
        step = min(room, far)
        return self._motion(time, self._hand + np.outer([0.0, step / far], way[1]), asked=self._alpha * step)

    def _motion(self, time: float, points: Array, *, passes: int = 0, asked: float = 0.0) -> Stroke:
        """A motion of the hand through points, shape (n, 3), metres, that misses them by a share of the way to each."""
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        path = minimum_jerk(points + np.outer(way, self._given.aim * self._random.uniform(-1.0, 1.0, 3)))
        top = float(np.linalg.norm(path.derivative()(np.linspace(0.0, 1.0, SAMPLES)), axis=1).max())
        return Stroke(path, time, max(top / self._given.speed, SHORTEST), passes, asked)


class _Tremor:
    """Sine waves of random frequencies in a band, at random phases: three coordinates."""

    def __init__(self, size: float, low: float, high: float, generator: np.random.Generator) -> None:
        """Draw them, between `low` and `high`, Hz; `size`: root mean square of each coordinate over time, metres."""
        self._rates = 2.0 * math.pi * generator.uniform(low, high, size=(3, WAVES))
        self._phases = generator.uniform(0.0, 2.0 * math.pi, size=(3, WAVES))
        self._amplitude = size * math.sqrt(2.0 / WAVES)

    def at(self, time: float) -> Array:
        """How far from where it was meant to be the hand is, array, shape (3,), metres."""
        return np.asarray(self._amplitude * np.sin(self._rates * time + self._phases).sum(axis=1))


def _route(via: ArrayLike) -> Array:
    try:
        given = frozen(via)
    except (TypeError, ValueError):
        given = np.array(math.nan)
    if given.ndim != 2 or given.shape[0] < 1 or given.shape[1] != 3 or not np.isfinite(given).all():
        raise DataError("via-points", f"must be finite numbers of shape (n, 3), metres, not of shape {given.shape}.")
    return given
