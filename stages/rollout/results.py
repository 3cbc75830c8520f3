"""What a roll-out stage has run: roll-outs with their names, and what else is recorded beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.policy.coupled import Coupling
from stages.policy.outcome import Outcome
from stages.rollout.parameters import Mode
from stages.trajectory import Array


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

    @property
    def v_max(self) -> float:
        """Top speed of its executed state, m/s; inf: none."""
        return self.coupling.v_max if self.coupling.v_max > 0.0 else math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Rollout:
    """One case, run; n samples, the first at the start.

    Attributes:
        rollout: unique name, e.g. ``clpvds-robust/cond1/4``; among obstacles ``lpvds/roas+/two/4``.
        controller: ``lpvds`` or ``clpvds``.
        mode: ``paper`` or ``robust``; of ``lpvds``, the run's own.
        avoidance: name of the method; ``none`` where there are no obstacles.
        condition: its name.
        dataset, demo, split: of the demonstration that it starts from.
        scene: name of its scene; "": there are no obstacles.
        time: array, shape (n,), seconds.
        x, p_hat, gate, clearance, status, disturbed, missed, outcome: as of `stages.rollout.run.Path`; p_hat of
            ``lpvds`` is x.
        lyapunov: array, shape (n,), V of x, square metres.
    """

    rollout: str
    controller: str
    mode: Mode
    avoidance: str
    condition: str
    dataset: str
    demo: str
    split: str
    scene: str
    time: Array
    x: Array
    p_hat: Array
    gate: NDArray[np.bool_]
    lyapunov: Array
    clearance: Array
    status: NDArray[np.int8]
    disturbed: tuple[tuple[int, int], ...]
    missed: int
    outcome: Outcome

    @property
    def displaced(self) -> int:
        """First sample that a disturbance has moved; -1: there is none."""
        return self.disturbed[0][0] if self.disturbed else -1


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulated:
    """All that a stage has run.

    Attributes:
        rollouts: in order; in the simulated world `stages.rollout.physics.CarryRollout`.
        scenes: that they ran in.
        runners: the controllers as they were completed.
        notices: what a person should know, a sentence each.
    """

    rollouts: tuple[Any, ...]
    scenes: tuple[Any, ...]
    runners: tuple[Runner, ...]
    notices: tuple[str, ...] = ()
