"""mixture.parquet, assignments.parquet, sampler.parquet: the components, who belongs to them, how they were found."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.artifacts.parquet import Column, Schema, read, write
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Array

MIXTURE = Schema(
    name="mixture",
    version=1,
    columns=(
        Column(name="weight", unit="1"),
        Column(name="mean", type="vector", unit="m"),
        Column(name="covariance", type="vector", unit="m2"),
    ),
)
ASSIGNMENTS = Schema(
    name="assignments",
    version=1,
    columns=(
        Column(name="sample", type="int"),
        Column(name="component", type="int"),
        Column(name="responsibility", unit="1"),
        Column(name="sampled", type="bool"),
        Column(name="table", type="int"),
    ),
)
SAMPLER = Schema(
    name="sampler",
    version=1,
    columns=(Column(name="sweep", type="int"), Column(name="log_posterior"), Column(name="components", type="int")),
)


def write_mixture(path: Path, mixture: GaussianMixture, details: Mapping[str, Any]) -> None:
    """Write a mixture, one component a row, covariances row-major."""
    columns = {
        "weight": mixture.weights,
        "mean": mixture.means.tolist(),
        "covariance": mixture.covariances.reshape(mixture.components, -1).tolist(),
    }
    write(path, MIXTURE, columns, {"dimension": mixture.dimension, **details})


def read_mixture(path: Path) -> GaussianMixture:
    """The mixture of a file."""
    columns, _ = read(path, MIXTURE)
    means = np.stack(list(columns["mean"]))
    d = means.shape[1]
    return GaussianMixture(
        weights=columns["weight"], means=means, covariances=np.stack(list(columns["covariance"])).reshape(-1, d, d)
    )


def write_assignments(path: Path, gamma: Array, sampled: NDArray[np.int64], labels: NDArray[np.int64]) -> None:
    """Write who belongs where.

    Arguments:
        gamma: array, shape (n, K), responsibilities of all training samples, in the order of the demonstrations.
        sampled: array, shape (s,), indices of the samples that the sampler saw; labels: its component of each.
    """
    n = gamma.shape[0]
    component = gamma.argmax(axis=1)
    seen = np.zeros(n, dtype=bool)
    seen[sampled] = True
    table = np.full(n, -1, dtype=np.int64)
    table[sampled] = labels
    columns = {
        "sample": np.arange(n),
        "component": component,
        "responsibility": gamma[np.arange(n), component],
        "sampled": seen,
        "table": table,
    }
    write(path, ASSIGNMENTS, columns, {})


def read_assignments(path: Path) -> dict[str, NDArray[Any]]:
    """Columns of assignments.parquet."""
    return read(path, ASSIGNMENTS)[0]


def write_sampler(
    path: Path, log_posterior: Array, components: NDArray[np.int64], criterion: Mapping[int, float]
) -> None:
    """Write the log posterior and K by sweep, and the criterion by K where one chose."""
    columns = {"sweep": np.arange(log_posterior.shape[0]), "log_posterior": log_posterior, "components": components}
    write(path, SAMPLER, columns, {"criterion": {str(k): float(value) for k, value in criterion.items()}})


def read_sampler(path: Path) -> tuple[dict[str, NDArray[Any]], dict[int, float]]:
    """Columns of sampler.parquet, and the criterion by K."""
    columns, header = read(path, SAMPLER)
    return columns, {int(k): float(value) for k, value in header["criterion"].items()}
