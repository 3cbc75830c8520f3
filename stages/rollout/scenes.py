"""The scenes of a stage: obstacles as given, or random spheres on the way which the learned system would take.

Every random sphere covers a point of the way: the state cannot go on as if it were not there. A moving one covers it at
the moment when the state would pass. Not here: how an obstacle is avoided (`stages/policy/avoidance`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import DataError
from stages.dynamics.lpvds import LpvDs
from stages.paths import arc_length
from stages.policy.avoidance.method import margin_of
from stages.policy.avoidance.parameters import Avoidance, RoasPlusParameters
from stages.policy.avoidance.scene import covered, merged, shapes_of, to_be_covered
from stages.policy.avoidance.scratch import IGNORE
from stages.policy.avoidance.shapes import Shapes, no_shapes, spheres
from stages.policy.avoidance.traps import traps_of
from stages.policy.coupled import PLAIN
from stages.policy.field import field_of
from stages.policy.policy import Rules
from stages.rollout.cases import step_limit
from stages.rollout.parameters import Condition, RandomScenes, RolloutParameters
from stages.rollout.run import run_case
from stages.trajectory import Array, Trajectory, frozen
from stages.world.disturbance import no_pushes

FIRST, LAST = 0.1, 0.95
"""Between these fractions of the way's length spheres are placed."""

OFF_CENTRE = 0.8
"""A sphere's centre is at most this share of its radius away from the way."""

_MOST_TRIALS = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Obstacles of one or more cases.

    Attributes:
        name: unique among the scenes of a stage, e.g. ``two/4/0``.
        shapes: as they are, at the start.
        cover: which of them a policy is to see as spheres.
        traps: array, shape (n, d), metres: minima of V on their surfaces, as ROAS+ sees them; none: no method asks.
        complete: whether these are all traps: of spheres and a quadratic V they are; else the surfaces were sampled.
    """

    name: str
    shapes: Shapes
    cover: tuple[bool, ...]
    traps: Array | None = None
    complete: bool = True

    def seen_by(self, method: Avoidance) -> Shapes:
        """The obstacles as a method sees them."""
        seen = covered(self.shapes, self.cover)
        if isinstance(method, RoasPlusParameters) and method.merge:
            return merged(seen, method.margin)
        return seen


class Scenes:
    """The scenes of a stage, made when they are first asked for; the same for all controllers and methods."""

    def __init__(
        self,
        model: LpvDs,
        starts: Sequence[Trajectory],
        parameters: RolloutParameters,
        draw: Callable[..., np.random.Generator],
    ) -> None:
        self._model, self._starts, self._parameters, self._draw = model, starts, parameters, draw
        self._rules = Rules(field_of(model, parameters.integrator), PLAIN, IGNORE)
        self._asks = next((m for m in parameters.avoidances if isinstance(m, RoasPlusParameters)), None)
        self._made: dict[str, Scene] = {}
        self._ways: dict[str, Array] = {}

    @property
    def used(self) -> list[Scene]:
        """All that were asked for, in order."""
        return list(self._made.values())

    def of(self, condition: Condition, start: Trajectory, number: int) -> Scene | None:
        """The scene of a case; none: there are no obstacles. `number`: of the random scenes of a start.

        Raises DataError: there is no room for a single random sphere.
        """
        if condition.scenes is None:
            if not condition.obstacles:
                return None
            name = condition.name
        elif condition.scenes.common:
            name = f"{condition.name}/{number}"
        else:
            name = f"{condition.name}/{start.dataset}/{start.demo}/{number}"
        if name not in self._made:
            self._made[name] = self._make(name, condition, start, number)
        return self._made[name]

    def _make(self, name: str, condition: Condition, start: Trajectory, number: int) -> Scene:
        if condition.scenes is None:
            shapes = shapes_of(condition.obstacles, self._model.dimension, "rollout.conditions")
            cover = tuple(to_be_covered(condition.obstacles))
        else:
            common = condition.scenes.common
            one = self._starts[0] if common else start
            starts = [s.position[0] for s in (self._starts if common else [start])]
            free = np.array([*starts, self._model.goal])
            generator = self._draw("scenes", condition.name, one.name, str(number))
            shapes = random_scene(self._way(one), self._dt(one), free, condition.scenes, generator)
            if not shapes.number:
                raise DataError(
                    f"condition {condition.name}, {one.name}",
                    "there is no room for a sphere: lower scenes.smallest, scenes.largest or scenes.free.",
                )
            cover = (False,) * shapes.number
        scene = Scene(name=name, shapes=shapes, cover=cover)
        if self._asks is None:
            return scene
        traps, complete = traps_of(self._model, scene.seen_by(self._asks), margin_of(self._asks))
        return Scene(name=name, shapes=shapes, cover=cover, traps=traps, complete=complete)

    def _dt(self, start: Trajectory) -> float:
        return start.step if self._parameters.dt is None else self._parameters.dt

    def _way(self, start: Trajectory) -> Array:
        """The learned system's own way from a start, without obstacles."""
        if start.name not in self._ways:
            dt = self._dt(start)
            path = run_case(
                self._rules,
                None,
                None,
                no_pushes(self._model.dimension),
                start.position[0],
                dt=dt,
                steps=step_limit(self._parameters.max_duration, start.duration, dt),
                stop_distance=self._parameters.stop_distance,
            )
            self._ways[start.name] = frozen(path.x)
        return self._ways[start.name]


def random_scene(way: Array, dt: float, free: Array, given: RandomScenes, generator: np.random.Generator) -> Shapes:
    """Spheres on a way.

    Args:
        way: array, shape (n, d), metres, from a start to the goal.
        dt: seconds between its samples.
        free: array, shape (m, d), metres: where no sphere may be, beside the way's end.
        given: how many, how large, how fast.
        generator: will be advanced.

    Returns:
        At most as many as were drawn: where there is no room for more after a thousand trials, fewer.
    """
    if way.shape[0] < 2:
        return no_shapes(way.shape[1])
    length, goal = arc_length(way), way[-1]
    size = float(np.linalg.norm(way[0] - goal))
    top = float(np.diff(length).max()) / dt
    free = np.vstack([free, goal])
    wanted = int(generator.integers(given.fewest, given.most + 1))
    centres, radii, velocities = np.empty((0, way.shape[1])), np.empty(0), np.empty((0, way.shape[1]))
    for _ in range(_MOST_TRIALS):
        if radii.shape[0] == wanted:
            break
        sample = int(np.searchsorted(length, generator.uniform(FIRST, LAST) * length[-1]))
        radius = size * generator.uniform(given.smallest, given.largest)
        aside = OFF_CENTRE * generator.uniform() * radius * _direction(generator, way.shape[1])
        velocity = given.speed * top * generator.uniform() * _direction(generator, way.shape[1])
        centre = way[sample] + aside - velocity * (sample * dt)
        if (np.linalg.norm(free - centre, axis=1) < radius + given.free * size).any():
            continue
        if (np.linalg.norm(centres - centre, axis=1) < radii + radius + given.apart * size).any():
            continue
        centres = np.vstack([centres, centre])
        radii, velocities = np.append(radii, radius), np.vstack([velocities, velocity])
    return spheres(centres, radii, velocities)


def _direction(generator: np.random.Generator, d: int) -> Array:
    """A unit vector, all directions alike."""
    vector = generator.normal(size=d)
    return np.asarray(vector / np.linalg.norm(vector))
