"""mixture.parquet, assignments.parquet, sampler.parquet: the components, who belongs to them, how they were found.

Each holds one mixture or several candidates, told apart by the column ``candidate``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.artifacts.parquet import Column, Schema, read, runs, write
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Array

MIXTURE = Schema(
    name="mixture",
    version=2,
    columns=(
        Column(name="candidate", type="label"),
        Column(name="weight", unit="1"),
        Column(name="mean", type="vector", unit="m"),
        Column(name="covariance", type="vector", unit="m2"),
    ),
)
ASSIGNMENTS = Schema(
    name="assignments",
    version=2,
    columns=(
        Column(name="candidate", type="label"),
        Column(name="sample", type="int"),
        Column(name="component", type="int"),
        Column(name="responsibility", unit="1"),
        Column(name="sampled", type="bool"),
        Column(name="table", type="int"),
    ),
)
SAMPLER = Schema(
    name="sampler",
    version=2,
    columns=(
        Column(name="candidate", type="label"),
        Column(name="chain", type="int"),
        Column(name="sweep", type="int"),
        Column(name="log_posterior"),
        Column(name="components", type="int"),
    ),
)


def write_mixture(path: Path, mixtures: Mapping[str, GaussianMixture], details: Mapping[str, Any]) -> None:
    """Write mixtures by the name of the candidate, one component a row, covariances row-major."""
    found = list(mixtures.values())
    columns = {
        "candidate": [name for name, mixture in mixtures.items() for _ in range(mixture.components)],
        "weight": np.concatenate([mixture.weights for mixture in found]),
        "mean": [mean for mixture in found for mean in mixture.means.tolist()],
        "covariance": [c.ravel().tolist() for mixture in found for c in mixture.covariances],
    }
    write(path, MIXTURE, columns, {"dimension": found[0].dimension, **details})


def read_mixtures(path: Path) -> dict[str, GaussianMixture]:
    """The mixtures of a file by the name of the candidate, in the order in which they were written."""
    columns, _ = read(path, MIXTURE)
    means = np.stack(list(columns["mean"]))
    d = means.shape[1]
    covariances = np.stack(list(columns["covariance"])).reshape(-1, d, d)
    return {
        str(columns["candidate"][first]): GaussianMixture(
            weights=columns["weight"][first:last], means=means[first:last], covariances=covariances[first:last]
        )
        for first, last in runs(columns["candidate"].tolist())
    }


def write_assignments(path: Path, gammas: Mapping[str, Array], fits: Mapping[str, MixtureFit]) -> None:
    """Write who belongs where.

    Arguments:
        gammas: by candidate, array, shape (n, K), responsibilities of all training samples, in the order of the
            demonstrations.
        fits: by candidate, which samples its sampler saw, and the component that it gave each of them.
    """
    columns: dict[str, list[Any]] = {column.name: [] for column in ASSIGNMENTS.columns}
    for name, gamma in gammas.items():
        n = gamma.shape[0]
        component = gamma.argmax(axis=1)
        seen, table = np.zeros(n, dtype=bool), np.full(n, -1, dtype=np.int64)
        seen[fits[name].sampled] = True
        table[fits[name].sampled] = fits[name].labels
        columns["candidate"] += [name] * n
        columns["sample"].append(np.arange(n))
        columns["component"].append(component)
        columns["responsibility"].append(gamma[np.arange(n), component])
        columns["sampled"].append(seen)
        columns["table"].append(table)
    whole = {key: values if key == "candidate" else np.concatenate(values) for key, values in columns.items()}
    write(path, ASSIGNMENTS, whole, {})


def read_assignments(path: Path) -> dict[str, NDArray[Any]]:
    """Columns of assignments.parquet."""
    return read(path, ASSIGNMENTS)[0]


def write_sampler(path: Path, fits: Mapping[str, MixtureFit]) -> None:
    """Write the log posterior and K by chain and sweep of each candidate, and the criterion by K where one chose."""
    columns: dict[str, list[Any]] = {column.name: [] for column in SAMPLER.columns}
    for name, fit in fits.items():
        chains, sweeps = fit.log_posterior.shape
        columns["candidate"] += [name] * (chains * sweeps)
        columns["chain"].append(np.repeat(np.arange(chains), sweeps))
        columns["sweep"].append(np.tile(np.arange(sweeps), chains))
        columns["log_posterior"].append(fit.log_posterior.ravel())
        columns["components"].append(fit.components_by_sweep.ravel())
    whole = {key: values if key == "candidate" else np.concatenate(values) for key, values in columns.items()}
    criteria = {name: {str(k): float(v) for k, v in fit.criterion.items()} for name, fit in fits.items()}
    write(path, SAMPLER, whole, {"criterion": criteria})


def read_sampler(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, dict[int, float]]]:
    """Columns of sampler.parquet, and each candidate's criterion by K."""
    columns, header = read(path, SAMPLER)
    return columns, {name: {int(k): float(v) for k, v in by.items()} for name, by in header["criterion"].items()}
