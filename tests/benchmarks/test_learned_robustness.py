"""200 random resamplings, scalings and rotations of LASA motions, learned with P and with a warp: none fails.

The system that is learned turns and scales with the data: the same candidate is taken, and its velocities are those of
the unturned data, turned and scaled. A choice between candidates that are as good as each other may flip by rounding;
that is counted. Run by `make bench`.
"""

from __future__ import annotations

import numpy as np
from lasa import KINDS, motions

from pipeline.errors import ClpvError
from stages.dynamics.certificate import proofs
from stages.trajectory import Trajectory

CASES = 200
SAMPLES = (100, 1500)
"""Fewest and most of a resampled demonstration; LASA's have 1000."""
LARGEST_SCALE = 1e3
ALIKE = 1e-4
"""Of velocities at the samples, against the rms speed, where the same candidate was taken; required of 95 in 100."""


def resampled(demonstration: Trajectory, rng: np.random.Generator) -> Trajectory:
    """At as many uniform instants as chance wants."""
    time = np.linspace(demonstration.time[0], demonstration.time[-1], int(rng.integers(*SAMPLES)))
    columns = {
        name: np.stack([np.interp(time, demonstration.time, c) for c in getattr(demonstration, name).T], axis=1)
        for name in ("position", "velocity")
    }
    return Trajectory(dataset="resampled", demo=demonstration.demo, split="train", time=time, **columns)


def turned(demonstration: Trajectory, R: np.ndarray, scale: float) -> Trajectory:
    return Trajectory(
        dataset="turned",
        demo=demonstration.demo,
        split="train",
        time=demonstration.time,
        position=scale * demonstration.position @ R.T,
        velocity=scale * demonstration.velocity @ R.T,
    )


def test_resampling_scaling_and_rotation_of_learned_kinds() -> None:
    every = motions()
    print()
    for kind in ("pqlf", "warped"):
        failed, flipped, differences = [], 0, []
        for case in range(CASES):
            rng = np.random.default_rng([2026, case])
            motion = every[case % len(every)]
            train = [resampled(t, rng) for t in motion.train]
            scale, angle = LARGEST_SCALE ** rng.uniform(-1.0, 1.0), rng.uniform(0.0, 2.0 * np.pi)
            R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            try:
                one = KINDS[kind].fit(train, motion.goal, case)
                other = KINDS[kind].fit([turned(t, R, scale) for t in train], scale * R @ motion.goal, case)
            except ClpvError as error:
                failed.append(f"{case} {motion.name}: {error}")
                continue
            for found in (one, other):
                assert proofs(found.model.matrices, found.model.lyapunov_matrix, found.certificate.margin).all()
            if [entry.chosen for entry in one.tried] != [entry.chosen for entry in other.tried]:
                flipped += 1
                continue
            x = np.concatenate([t.position for t in train])
            v = one.model.velocity(x)
            w = other.model.velocity(scale * x @ R.T) @ R / scale
            differences.append(float(np.sqrt(((v - w) ** 2).mean() / (v**2).mean())))
        alike = sum(difference <= ALIKE for difference in differences)
        print(
            f"{kind}, {CASES} resamplings, scalings and rotations: {len(failed)} failures, {flipped} took another "
            f"candidate; velocities differ by {np.median(differences):.1e} (median), {max(differences):.1e} (largest), "
            f"{len(differences) - alike} beyond {ALIKE:g}"
        )
        assert not failed
        assert flipped <= CASES // 20
        assert alike >= 0.95 * len(differences)
