"""Policies among obstacles as tests and benchmarks run them: linear and learned systems, random scenes, methods."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from stages.dynamics.lpvds import LpvDs
from stages.mixture.gaussian import GaussianMixture
from stages.policy.avoidance.method import margin_of, resolve_avoidance
from stages.policy.avoidance.parameters import (
    ApfParameters,
    Avoidance,
    CbfParameters,
    ModulationParameters,
    NoAvoidance,
    RoasParameters,
    RoasPlusParameters,
)
from stages.policy.avoidance.scene import merged
from stages.policy.avoidance.shapes import Shapes
from stages.policy.coupled import PLAIN, Coupling
from stages.policy.field import field_of
from stages.policy.outcome import Outcome, Status
from stages.policy.policy import Rules
from stages.rollout.parameters import RandomScenes
from stages.rollout.run import Path, run_case
from stages.rollout.scenes import random_scene
from stages.trajectory import Array
from stages.world.disturbance import Pushes, no_pushes

ROAS_PLUS = RoasPlusParameters()
METHODS: dict[str, Avoidance] = {
    "roas, metres": RoasParameters(),
    "roas, millimetres": RoasParameters(unit=0.001),
    "apf": ApfParameters(),
    "modulation": ModulationParameters(),
    "cbf": CbfParameters(),
    "roas+": ROAS_PLUS,
}

CODES = tuple(Status)
RISING = [CODES.index(s) for s in (Status.DETOURING, Status.YIELDING, Status.INFEASIBLE, Status.TOO_FAST)]
"""Steps in which V may rise, and which say so."""
FLAGGED = [CODES.index(s) for s in (Status.INFEASIBLE, Status.TOO_FAST)]
"""Steps that could not keep clear, and say so."""

STOP = 5e-4
"""Metres from the goal at which a roll-out has arrived."""


def linear(goal: Array, rate: float = 1.0, lyapunov_matrix: Array | None = None) -> LpvDs:
    """xdot = -rate (x - goal)."""
    d = goal.shape[0]
    mixture = GaussianMixture(weights=np.ones(1), means=np.zeros((1, d)), covariances=np.eye(d)[None])
    P = np.eye(d) if lyapunov_matrix is None else lyapunov_matrix
    return LpvDs(mixture=mixture, matrices=-rate * np.eye(d)[None], goal=goal, lyapunov_matrix=P)


def bent(generator: np.random.Generator, d: int, spread: float = 0.05) -> LpvDs:
    """A certified system whose ways bend: symmetric parts negative definite, any skew part. `spread`: of means, m."""
    K = int(generator.integers(1, 5))
    roots = 0.02 * generator.normal(size=(K, d, d))
    halves, skew = generator.normal(size=(2, K, d, d)) / math.sqrt(d)
    return LpvDs(
        mixture=GaussianMixture(
            weights=generator.dirichlet(np.full(K, 5.0)),
            means=spread * generator.normal(size=(K, d)),
            covariances=roots @ roots.transpose(0, 2, 1) + 1e-4 * np.eye(d),
        ),
        matrices=-(halves @ halves.transpose(0, 2, 1)) - 0.5 * np.eye(d) + 2.0 * (skew - skew.transpose(0, 2, 1)),
        goal=0.02 * generator.normal(size=d),
        lyapunov_matrix=np.eye(d),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A system and a start; what it does without obstacles.

    Attributes:
        model: the system.
        start: array, shape (d,), metres.
        way: array, shape (n, d), metres, its path without obstacles; `dt` seconds between samples.
        dt: seconds.
    """

    model: LpvDs
    start: Array
    way: Array
    dt: float

    @property
    def size(self) -> float:
        """Distance from the start to the goal, metres."""
        return float(np.linalg.norm(self.start - self.model.goal))

    @property
    def duration(self) -> float:
        """Of the path without obstacles, seconds."""
        return self.way.shape[0] * self.dt

    @property
    def top_speed(self) -> float:
        """Of the path without obstacles, m/s."""
        return float(np.linalg.norm(np.diff(self.way, axis=0), axis=1).max()) / self.dt


def task(model: LpvDs, start: Array, dt: float = 0.01, longest: float = 60.0) -> Task:
    """A system and a start, run without obstacles for at most `longest` seconds."""
    rules = Rules(field_of(model, "cayley"), PLAIN, resolve_avoidance(NoAvoidance(), 1.0, dt, math.inf, ""))
    path = run_case(
        rules, None, None, no_pushes(start.shape[0]), start, dt=dt, steps=math.ceil(longest / dt), stop_distance=STOP
    )
    return Task(model=model, start=start, way=np.array(path.x), dt=dt)


def linear_task(generator: np.random.Generator, d: int) -> Task:
    """A linear system with its goal anywhere, from a start at 0.1 to 1 m in any direction."""
    goal, towards = 0.3 * generator.normal(size=d), generator.normal(size=d)
    start = goal + generator.uniform(0.1, 1.0) * towards / np.linalg.norm(towards)
    return task(linear(goal), start)


def scene(one: Task, given: RandomScenes, generator: np.random.Generator) -> Shapes:
    """Random spheres on the way."""
    return random_scene(one.way, one.dt, one.start[None], given, generator)


def run(
    one: Task,
    shapes: Shapes | None,
    method: Avoidance = ROAS_PLUS,
    dt: float = 0.01,
    *,
    coupling: Coupling = PLAIN,
    pushes: Pushes | None = None,
    times: float = 10.0,
) -> Path:
    """Run a task among obstacles, for at most `times` as long as it takes without them."""
    v_max = coupling.v_max if coupling.v_max > 0.0 else math.inf
    avoidance = resolve_avoidance(method, one.top_speed, dt, v_max, "")
    seen = shapes
    if shapes is not None and isinstance(method, RoasPlusParameters) and method.merge:
        seen = merged(shapes, margin_of(method))
    return run_case(
        Rules(field_of(one.model, "cayley"), coupling, avoidance),
        seen,
        shapes,
        no_pushes(one.start.shape[0]) if pushes is None else pushes,
        one.start,
        dt=dt,
        steps=math.ceil(times * one.duration / dt),
        stop_distance=STOP,
        recover=bool(getattr(method, "recover", False)),
    )


def rise(model: LpvDs, path: Path) -> float:
    """Largest rise of V in one step of x that does not say that V may rise, as a share of V; 0: it never rises."""
    V = model.lyapunov(path.x)
    before = V[:-1]
    rises = np.diff(V) / np.where(before > 0.0, before, 1.0)
    rises[np.isin(path.status[:-1], RISING)] = 0.0
    return float(rises.max(initial=0.0))


@dataclass
class Tally:
    """How many roll-outs ended how, and the worst of what they promise."""

    outcomes: Counter[str] = field(default_factory=Counter)
    rise: float = 0.0
    clearance: float = math.inf
    detours: int = 0
    yielding: int = 0
    flagged: int = 0
    steps: int = 0
    longer: list[float] = field(default_factory=list)

    def add(self, one: Task, path: Path, dt: float) -> None:
        """Count one more."""
        self.outcomes[str(path.outcome)] += 1
        self.rise = max(self.rise, rise(one.model, path))
        self.clearance = min(self.clearance, float(path.clearance.min()))
        self.detours += bool((path.status == CODES.index(Status.DETOURING)).any())
        self.yielding += bool((path.status == CODES.index(Status.YIELDING)).any())
        self.flagged += bool(np.isin(path.status, FLAGGED).any())
        self.steps += path.x.shape[0] - 1
        self.longer.append(path.x.shape[0] * dt / one.duration)

    @property
    def count(self) -> int:
        """All."""
        return self.outcomes.total()

    @property
    def arrived(self) -> int:
        """How many reached the goal."""
        return self.outcomes[Outcome.ARRIVED]

    @property
    def collided(self) -> int:
        """How many entered an obstacle, whether or not a step had said that it could not keep clear."""
        return sum(self.outcomes[o] for o in (Outcome.COLLIDED, Outcome.INFEASIBLE, Outcome.TOO_FAST))

    @property
    def unflagged(self) -> int:
        """How many entered an obstacle with no step that said so."""
        return self.outcomes[Outcome.COLLIDED]

    def row(self, *names: str) -> str:
        """A line of a table: collided and arrived in per cent."""
        others = {name: n for name, n in self.outcomes.items() if name not in (Outcome.ARRIVED, Outcome.COLLIDED)}
        rest = ", ".join(f"{name} {n}" for name, n in sorted(others.items()))
        return (
            f"| {' | '.join(names)} | {self.count} | {100 * self.collided / self.count:.2f} % | "
            f"{100 * self.arrived / self.count:.2f} % | {rest} | {self.rise:.1e} | {1e3 * self.clearance:.2g} mm | "
            f"{self.detours} | {self.flagged} | {np.mean(self.longer):.2f} ({max(self.longer):.3g}) |"
        )


def header(*names: str) -> str:
    """The head of such a table."""
    columns = (
        *names,
        "scenes",
        "collided",
        "arrived",
        "otherwise",
        "V rose by",
        "least clearance",
        "with a detour",
        "flagged",
        "time, of that without obstacles: mean (most)",
    )
    return f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}"


def all_of(tallies: Sequence[Tally]) -> Tally:
    """Several as one."""
    result = Tally()
    for one in tallies:
        result.outcomes.update(one.outcomes)
        result.rise, result.clearance = max(result.rise, one.rise), min(result.clearance, one.clearance)
        result.detours, result.yielding = result.detours + one.detours, result.yielding + one.yielding
        result.flagged, result.steps = result.flagged + one.flagged, result.steps + one.steps
        result.longer += one.longer
    return result
