"""Small made motions that several test files learn from, and what turns and scales them."""

from __future__ import annotations

import numpy as np

from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Trajectory

GOAL = (0.3, -0.2, 0.1, 0.05, -0.4, 0.2, 0.7)
"""Where the motions end, metres: as many coordinates as are needed."""


def trajectory(
    position: np.ndarray, *, velocity: np.ndarray | None = None, duration: float = 2.0, demo: str = "1"
) -> Trajectory:
    """A motion on a uniform clock, its velocity by differences unless it is given."""
    position = np.asarray(position, dtype=np.float64)
    time = np.linspace(0.0, duration, len(position))
    if velocity is None:
        velocity = np.gradient(position, time, axis=0)
    return Trajectory(dataset="made", demo=demo, split="train", time=time, position=position, velocity=velocity)


def goal(d: int) -> np.ndarray:
    return np.array(GOAL[:d])


def hook(d: int, count: int = 3, n: int = 120, turn: float = 1.5 * np.pi) -> list[Trajectory]:
    """Arcs of `turn` about a centre beside the goal, with a pitch in 3-D; beyond a half turn they first move away.

    A minimum-jerk motion: it starts and ends at rest. Demonstrations differ in size, by a few per cent.
    """
    rng = np.random.default_rng(d)
    tau = np.linspace(0.0, 1.0, n)
    left = turn * (1.0 - (10.0 * tau**3 - 15.0 * tau**4 + 6.0 * tau**5))
    columns = [np.sin(left), 1.2 * (1.0 - np.cos(left))]
    columns += [0.15 * left * (1.0 + 0.2 * np.sin((k + 1) * left)) for k in range(d - 2)]
    shape = 0.1 * np.column_stack(columns)
    demos = [goal(d) + shape * (1.0 + 0.05 * rng.normal(size=d)) for _ in range(count)]
    return [trajectory(demo, demo=str(m + 1)) for m, demo in enumerate(demos)]


def gaussians(demonstrations: list[Trajectory], components: int) -> GaussianMixture:
    """A mixture without a fit: one Gaussian for each of as many equal stretches of the demonstrations."""
    parts = [np.array_split(demonstration.position, components) for demonstration in demonstrations]
    stretches = [np.concatenate([part[k] for part in parts]) for k in range(components)]
    radius = np.sqrt(np.var(np.concatenate(stretches), axis=0).sum())
    covariances = np.stack([np.cov(points.T) for points in stretches])
    return GaussianMixture(
        weights=np.full(components, 1.0 / components),
        means=np.stack([points.mean(axis=0) for points in stretches]),
        covariances=covariances + (0.02 * radius) ** 2 * np.eye(covariances.shape[1]),
    )


def rotation(d: int, seed: int = 0) -> np.ndarray:
    Q, R = np.linalg.qr(np.random.default_rng([d, seed]).normal(size=(d, d)))
    Q = Q * np.sign(np.diag(R))
    Q[:, 0] *= np.linalg.det(Q)
    return Q


def moved(demonstrations: list[Trajectory], R: np.ndarray, scale: float = 1.0) -> list[Trajectory]:
    """The same motions in another frame and unit: x -> scale R x."""
    return [
        Trajectory(
            dataset=one.dataset,
            demo=one.demo,
            split=one.split,
            time=one.time,
            position=scale * one.position @ R.T,
            velocity=scale * one.velocity @ R.T,
        )
        for one in demonstrations
    ]


def moved_mixture(mixture: GaussianMixture, R: np.ndarray, scale: float = 1.0) -> GaussianMixture:
    covariances = scale**2 * R @ mixture.covariances @ R.T
    return GaussianMixture(
        weights=mixture.weights,
        means=scale * mixture.means @ R.T,
        covariances=0.5 * (covariances + covariances.transpose(0, 2, 1)),
    )
