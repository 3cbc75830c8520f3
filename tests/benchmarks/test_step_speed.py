"""How fast a policy steps: batches of roll-outs, and the single step of a robot's control loop. Run by `make bench`."""

from __future__ import annotations

import time

import motions as toy
import numpy as np
from lasa import best_of, motions, one_mixture
from scenes import Task, run, scene, task

from stages.dynamics import qlf, warped
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.parameters import QlfParameters, WarpedParameters
from stages.policy.avoidance.parameters import NoAvoidance, Sphere
from stages.policy.controller import Controller
from stages.policy.coupled import DEADBEAT, Coupling
from stages.rollout.parameters import RandomScenes

COUPLED, AVOIDING = 1e6, 150e3
"""Steps a second on one core, d = 2, K = 8; required: without an obstacle, and with ROAS+ and three."""
STEP = 50e-6
"""Seconds, 99th percentile of one step of a single roll-out, d = 3, K = 10, five obstacles; required."""
DT = 1e-4
"""Seconds: short, so that a roll-out is long."""
BATCH = 8
"""Roll-outs in a batch."""


def lasa_task() -> Task:
    """The first LASA motion of which the mixture has eight components."""
    for motion in motions():
        mixture = one_mixture(motion.train, 0)
        if mixture["pcgmm"].components == 8:
            model = qlf.fit(motion.train, mixture, motion.goal, QlfParameters()).model
            return task(model, motion.test[0].position[0])
    raise AssertionError("no motion has eight components")


def test_batches() -> None:
    one = lasa_task()
    coupling = Coupling(DEADBEAT, v_max=10.0 * one.top_speed)
    given = RandomScenes(fewest=3, most=3)
    scenes = [scene(one, given, np.random.default_rng([11, k])) for k in range(BATCH)]
    scenes = [shapes for shapes in scenes if shapes.number == 3]

    def free() -> int:
        return sum(run(one, None, NoAvoidance(), DT, coupling=coupling).x.shape[0] for _ in range(BATCH))

    def avoiding() -> int:
        return sum(run(one, shapes, dt=DT, coupling=coupling).x.shape[0] for shapes in scenes)

    steps, avoided = free(), avoiding()
    rate, slower = steps / best_of(free), avoided / best_of(avoiding)
    print(
        f"\ncoupled steps a second on one core, d = 2, K = 8: {rate:.3g} ({COUPLED:.0g} are required); with "
        f"ROAS+ and 3 obstacles {slower:.3g} ({AVOIDING:.3g})"
    )
    assert rate >= COUPLED
    assert slower >= AVOIDING


def seconds_of_steps(model: LpvDs, start: np.ndarray, speed: float) -> np.ndarray:
    """Seconds of every step of five motions among five obstacles, the first 500 steps left out."""
    dt = 0.004
    one = task(model, start, dt)
    given = RandomScenes(fewest=5, most=5, largest=0.1, speed=speed)
    shapes = scene(one, given, np.random.default_rng(3))
    assert shapes.number == 5
    obstacles = [
        Sphere(centre=tuple(c), radius=float(r), velocity=tuple(v))
        for c, r, v in zip(shapes.centres, shapes.radii, shapes.velocities, strict=True)
    ]
    seconds = []
    for _ in range(5):
        controller = Controller(
            model,
            start,
            dt=dt,
            coupling=Coupling(DEADBEAT, v_max=5.0 * one.top_speed),
            top_speed=one.top_speed,
            obstacles=obstacles,
        )
        measured = start
        for k in range(one.way.shape[0]):
            if speed:
                controller.see(shapes.centres + k * dt * shapes.velocities, shapes.velocities)
            begin = time.perf_counter()
            measured = controller.step(measured)
            seconds.append(time.perf_counter() - begin)
    return np.array(seconds[500:])


def test_single_step() -> None:
    demonstrations, goal = toy.hook(3), toy.goal(3)
    mixtures = {"toy": toy.gaussians(demonstrations, 10)}
    print()
    for name, fit in (
        ("P = I", qlf.fit(demonstrations, mixtures, goal, QlfParameters())),
        ("warp", warped.fit(demonstrations, mixtures, goal, WarpedParameters())),
    ):
        for speed in (0.0, 0.5):
            micro = 1e6 * seconds_of_steps(fit.model, demonstrations[0].position[0], speed)
            print(
                f"one step, d = 3, K = 10, five {'moving' if speed else 'standing'} obstacles, {name}: median "
                f"{np.median(micro):.1f} us, p99 {np.percentile(micro, 99):.1f} us (at most {1e6 * STEP:.0f})"
            )
            assert name != "P = I" or np.percentile(micro, 99) <= 1e6 * STEP
