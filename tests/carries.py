"""Boxes carried by two arms as benchmarks run them: many at once, each with its metrics."""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stages.dynamics.lpvds import LpvDs
from stages.evaluate.force import Grip, grip
from stages.evaluate.pushed import Pushed, pushed
from stages.policy.outcome import Outcome
from stages.rollout.carry import PHASES, Carried, carry
from stages.rollout.carry_conditions import believed, coupling_of, task_of
from stages.rollout.carry_scenes import NO_POTS, scene_of
from stages.rollout.parameters import CarryCondition, CarryParameters
from stages.rollout.physics import facts_of
from stages.world.parameters import Scene

SIDES = ("", "left", "right")


@dataclass(frozen=True, kw_only=True)
class Box:
    """One box to be carried.

    Attributes:
        model: the policy.
        parameters, condition: under which.
        scene: as it is for this box.
        top_speed: of the demonstrations, m/s: it bounds how fast p_hat follows.
        number: of the box: what is random follows from it, alike under all conditions.
    """

    model: LpvDs
    parameters: CarryParameters
    condition: CarryCondition
    scene: Scene
    top_speed: float
    number: int


@dataclass(frozen=True, kw_only=True)
class Held:
    """How it went.

    Attributes:
        outcome: how it ended.
        grip, pushed: its metrics.
        rate: times real time, one process.
        clearance_mm: least distance of the box's middle from a safety sphere, mm; nan: there is none.
        refused: draws of its pots before there was a way.
    """

    outcome: Outcome
    grip: Grip
    pushed: Pushed
    rate: float
    clearance_mm: float
    refused: int

    @property
    def delivered(self) -> bool:
        """Let go upright within 20 mm of the goal."""
        return self.grip.delivered

    @property
    def strict(self) -> bool:
        """Delivered, never tilted by 10 degrees or slipped by 10 mm."""
        tilt, slip = self.grip.tilt_max_deg, self.grip.slip_max_mm
        return self.delivered and tilt is not None and slip is not None and tilt < 10.0 and slip < 10.0

    @property
    def in_band(self) -> bool:
        """Both forces within 2 to 10 N for 95 % of the carried time."""
        return self.grip.band_fraction is not None and self.grip.band_fraction >= 0.95


class Record:
    """A roll-out as metrics see it."""

    def __init__(self, carried: Carried, facts: dict[str, object]) -> None:
        self.phase = np.array([str(PHASES[code]) for code in carried.phase], dtype=object)
        self.named = np.array([SIDES[code + 1] for code in carried.named], dtype=object)
        self.pads, self.box, self.turn, self.contact = carried.pads, carried.box, carried.turn, carried.contact
        self.desired, self.residual, self.pushed = carried.desired, carried.residual, carried.acting
        self.box_room, self.arm_room, self.facts = carried.box_room, carried.arm_room, facts


def carry_box(box: Box) -> Held:
    """Carry one box."""
    parameters, condition, number = box.parameters, box.condition, box.number
    scene = believed(condition, box.scene, (), np.random.default_rng([6, number]))
    pots = NO_POTS
    if condition.obstacles:
        pots = scene_of(
            condition.obstacles,
            np.random.default_rng([9, number]),
            box.scene,
            box.model,
            coupling_of(parameters, box.top_speed),
            top_speed=box.top_speed,
            dt=parameters.dt,
            longest=parameters.max_duration,
            location="pots",
        )
    task = task_of(parameters, condition, scene, box.model, box.top_speed, np.random.default_rng([8, number]), pots)
    begin = time.perf_counter()
    done = carry(task, np.random.default_rng([7, number]))
    seconds = time.perf_counter() - begin
    record = Record(done, facts_of(condition, task, done, pots.refused))
    return Held(
        outcome=done.outcome,
        grip=grip(record, str(done.outcome)),
        pushed=pushed(record, done.x, done.gate),
        rate=float(done.time[-1]) / seconds,
        clearance_mm=1e3 * float(done.clearance.min()) if pots.pots else math.nan,
        refused=pots.refused,
    )


def carry_all(
    model: LpvDs, parameters: CarryParameters, condition: CarryCondition, scenes: Sequence[Scene], top_speed: float
) -> list[Held]:
    """Carry boxes, one process a core."""
    boxes = [
        Box(
            model=model,
            parameters=parameters,
            condition=condition,
            scene=scene,
            top_speed=top_speed,
            number=number,
        )
        for number, scene in enumerate(scenes)
    ]
    with multiprocessing.get_context("fork").Pool(os.cpu_count()) as pool:
        return pool.map(carry_box, boxes, chunksize=1)
