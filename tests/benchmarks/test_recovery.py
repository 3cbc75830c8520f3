"""Every LASA motion from four starts, pushed twenty times at random: complete recovery, measured. Run by `make bench`.

A push displaces the executed state by up to a quarter of the way's size in any direction, once, held, or dragged, at
any fraction of the path; a fifth of the cases has two of them in a row. Robust and paper mode.
"""

from __future__ import annotations

import numpy as np
from lasa import KINDS, motions

from stages.evaluate.compare import largest_rise
from stages.policy.coupled import energy
from stages.policy.outcome import Outcome
from stages.rollout.parameters import (
    ClpvdsController,
    Condition,
    Displacement,
    Disturbance,
    Held,
    Ramp,
    RolloutParameters,
)
from stages.rollout.simulate import Rollout, simulate

PUSHES = 20
LARGEST = 0.25
"""Of a push, as a share of the distance between start and goal."""
COINCIDE = 1e-9
"""Metres; required of the path after recovery, robust mode."""
FINAL = 5e-4
"""Metres from the goal; required."""


def push(generator: np.random.Generator, size: float) -> Disturbance:
    """One disturbance of any kind, anywhere."""
    offset = generator.normal(size=2)
    offset *= LARGEST * size * generator.uniform() / np.linalg.norm(offset)
    fraction, kind = float(generator.uniform(0.02, 0.98)), int(generator.integers(3))
    given = (float(offset[0]), float(offset[1]))
    if kind == 0:
        return Displacement(offset=given, at_fraction=fraction)
    if kind == 1:
        return Held(offset=given, at_fraction=fraction, duration=float(generator.uniform(0.05, 1.0)))
    return Ramp(
        offset=given,
        at_fraction=fraction,
        rise=float(generator.uniform(0.05, 0.5)),
        hold=float(generator.uniform(0.0, 0.5)),
    )


def states(rollout: Rollout) -> np.ndarray:
    """x wherever it moved, without repetitions, shape (n, d)."""
    moved = np.append(True, (np.diff(rollout.x, axis=0) != 0.0).any(axis=1))
    return rollout.x[moved]


def test_recovery() -> None:
    print()
    for mode in ("robust", "paper"):
        cases, arrived, worst_x, worst_executed, worst_final, rise_v, rise_energy = 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for number, motion in enumerate(motions()):
            fit = KINDS["qlf"].fit(motion.train, motion.goal)
            starts = motion.test
            assert len(starts) == 4
            top = max(float(np.linalg.norm(t.velocity, axis=1).max()) for t in motion.train)
            size = max(float(np.linalg.norm(t.position[0] - motion.goal)) for t in starts)
            generator = np.random.default_rng([9, number])
            conditions = [Condition()]
            for k in range(PUSHES):
                several = [push(generator, size) for _ in range(2 if k % 5 == 0 else 1)]
                conditions.append(Condition(name=f"push{k}", disturbances=tuple(several)))
            parameters = RolloutParameters(
                controllers=(ClpvdsController(mode=mode),),
                conditions=tuple(conditions),
                max_duration=20.0,
            )
            done = simulate(fit.model, starts, parameters, top).rollouts
            undisturbed = {one.demo: states(one) for one in done if one.condition == "none"}
            for one in done:
                if one.condition == "none":
                    continue
                cases += 1
                arrived += one.outcome == Outcome.ARRIVED
                rise_v = max(rise_v, largest_rise(one.lyapunov, ()))
                coupled = energy(one.x, one.p_hat, fit.model.goal)
                rise_energy = max(rise_energy, largest_rise(coupled, one.disturbed))
                worst_final = max(worst_final, float(np.linalg.norm(one.p_hat[-1] - fit.model.goal)))
                # x waits, and goes on as if nothing had been: the same states in the same order.
                mine, theirs = states(one), undisturbed[one.demo]
                assert mode == "paper" or mine.shape == theirs.shape
                shared = min(len(mine), len(theirs))
                worst_x = max(worst_x, float(np.abs(mine[:shared] - theirs[:shared]).max()))
                # After recovery, which is where x moves again, the executed state is on that path.
                recovered = one.gate & (np.arange(one.x.shape[0]) > one.disturbed[-1][1])
                gap = float(np.abs(one.p_hat[recovered] - one.x[recovered]).max(initial=0.0))
                worst_executed = max(worst_executed, gap)
        print(
            f"{mode}: {cases} pushed roll-outs, {arrived} arrived; x within {worst_x:.1e} m of the undisturbed "
            f"path, the executed state after recovery within {worst_executed:.1e} m of x; final error at most "
            f"{1e3 * worst_final:.3f} mm; V of x rises by {rise_v:.1e} m^2, (24) between disturbances by "
            f"{rise_energy:.1e} m^2"
        )
        assert cases == 30 * 4 * PUSHES
        assert rise_v == 0.0
        if mode == "robust":
            assert arrived == cases
            assert worst_x <= COINCIDE
            assert worst_executed <= COINCIDE
            assert worst_final <= FINAL
            assert rise_energy == 0.0
