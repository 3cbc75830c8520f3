"""All LASA motions as the pipeline sees them, and the kinds of dynamics with the mixtures that they are used with.

Shared by benchmarks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stages.dynamics import pqlf, qlf, warped
from stages.dynamics.fit import DynamicsFit
from stages.dynamics.parameters import PqlfParameters, QlfParameters, WarpedParameters
from stages.ingest.lasa import ingest, installed_folder, read_lasa
from stages.ingest.parameters import LasaParameters
from stages.midpoint.midpoint import to_trajectories
from stages.midpoint.parameters import MidpointParameters
from stages.mixture.auto import fit_auto
from stages.mixture.gaussian import GaussianMixture
from stages.mixture.parameters import AutoParameters, PcGmmParameters
from stages.mixture.pcgmm import fit_pcgmm
from stages.trajectory import Array, Demonstration, Trajectory

CANDIDATES = (6, 8, 10, 12)
"""Sizes of the plain mixtures between which P-QLF chooses; the warped system takes the default."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """One motion: demonstrations 1 to 3 train, 4 to 7 test, as in the paper."""

    name: str
    train: tuple[Trajectory, ...]
    test: tuple[Trajectory, ...]
    goal: Array

    @property
    def single(self) -> bool:
        """Whether the demonstrations for training show all that there is; of Multi_Models they show one branch."""
        return not self.name.startswith("Multi_Models")


def motions() -> list[Motion]:
    """All 30, in the order of their names."""
    result = []
    for file in sorted(installed_folder().glob("*.mat"), key=lambda file: file.stem.lower()):
        result.append(_motion(file.stem, read_lasa(file, LasaParameters(motion=file.stem))))
    return result


def motions_in_space() -> list[Motion]:
    """All 30, each with the next one's first coordinate as its depth: three-dimensional motions, made."""
    files = sorted(installed_folder().glob("*.mat"), key=lambda file: file.stem.lower())
    result = []
    for file, other in zip(files, files[1:] + files[:1], strict=True):
        parameters = LasaParameters(motion=file.stem, depth=other.stem)
        demonstrations, _ = ingest({file.name: file, other.name: other}, parameters, print)
        result.append(_motion(f"{file.stem}+{other.stem}", demonstrations))
    return result


def _motion(name: str, demonstrations: Sequence[Demonstration]) -> Motion:
    found = to_trajectories(demonstrations, MidpointParameters())
    parts = {split: tuple(t for t in found.trajectories if t.split == split) for split in ("train", "test")}
    return Motion(name=name, train=parts["train"], test=parts["test"], goal=found.goal)


def samples(train: Sequence[Trajectory]) -> tuple[Array, Array, np.ndarray]:
    """Positions, velocities and lengths, as mixtures take them."""
    position = np.concatenate([t.position for t in train])
    velocity = np.concatenate([t.velocity for t in train])
    return position, velocity, np.array([t.time.shape[0] for t in train])


def one_mixture(train: Sequence[Trajectory], seed: int) -> Mapping[str, GaussianMixture]:
    """PC-GMM with its defaults."""
    return {"pcgmm": fit_pcgmm(*samples(train), PcGmmParameters(), np.random.default_rng(seed)).mixture}


def several(
    components: tuple[int, ...] | None = None,
) -> Callable[[Sequence[Trajectory], int], Mapping[str, GaussianMixture]]:
    """PC-GMM and plain mixtures."""
    parameters = AutoParameters() if components is None else AutoParameters(components=components)

    def fit(train: Sequence[Trajectory], seed: int) -> Mapping[str, GaussianMixture]:
        found = fit_auto(*samples(train), parameters, np.random.default_rng(seed))
        return {name: candidate.mixture for name, candidate in found.items()}

    return fit


def best_of(work: Callable[[], object], repetitions: int = 5) -> float:
    """Seconds of the fastest of several calls."""
    durations = []
    for _ in range(repetitions):
        started = time.perf_counter()
        work()
        durations.append(time.perf_counter() - started)
    return min(durations)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of dynamics with the mixtures that it is used with."""

    mixtures: Callable[[Sequence[Trajectory], int], Mapping[str, GaussianMixture]]
    learn: Callable[..., DynamicsFit]
    parameters: object

    def fit(self, train: Sequence[Trajectory], goal: Array, seed: int = 0) -> DynamicsFit:
        """From demonstrations to a certified system."""
        return self.learn(train, self.mixtures(train, seed), goal, self.parameters)


KINDS = {
    "qlf": Kind(mixtures=one_mixture, learn=qlf.fit, parameters=QlfParameters()),
    "pqlf": Kind(mixtures=several(CANDIDATES), learn=pqlf.fit, parameters=PqlfParameters()),
    "warped": Kind(mixtures=several(), learn=warped.fit, parameters=WarpedParameters()),
}
