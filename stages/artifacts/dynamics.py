"""dynamics.parquet: the linear systems of an LPV-DS, its Lyapunov function, its certificate and the solver's report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stages.artifacts.mixture import read_mixture
from stages.artifacts.parquet import Column, Schema, read, write
from stages.dynamics.lpvds import LpvDs

SCHEMA = Schema(
    name="dynamics",
    version=1,
    columns=(
        Column(name="A", type="vector", unit="1/s"),
        Column(name="b", type="vector", unit="m/s"),
        Column(name="largest_eigenvalue", unit="1/s"),
        Column(name="shift", unit="1/s"),
    ),
)


def write_dynamics(path: Path, model: LpvDs, largest_eigenvalues: Any, shift: Any, details: Mapping[str, Any]) -> None:
    """Write a model, one component a row, matrices row-major; P and the goal stand in the metadata with `details`."""
    columns = {
        "A": model.matrices.reshape(model.matrices.shape[0], -1).tolist(),
        "b": model.offsets.tolist(),
        "largest_eigenvalue": largest_eigenvalues,
        "shift": shift,
    }
    metadata = {"goal": model.goal.tolist(), "P": model.lyapunov_matrix.tolist(), **details}
    write(path, SCHEMA, columns, metadata)


def read_dynamics(dynamics: Path, mixture: Path) -> LpvDs:
    """The model of dynamics.parquet and the mixture.parquet that it was learned on."""
    columns, header = read(dynamics, SCHEMA)
    goal = np.array(header["goal"])
    matrices = np.stack(list(columns["A"])).reshape(-1, goal.shape[0], goal.shape[0])
    return LpvDs(mixture=read_mixture(mixture), matrices=matrices, goal=goal, lyapunov_matrix=np.array(header["P"]))


def read_details(path: Path) -> dict[str, Any]:
    """Goal, P, certificate, solver report and fit of a dynamics.parquet."""
    return read(path, SCHEMA)[1]


def read_components(path: Path) -> list[dict[str, Any]]:
    """One row a component: its eigenvalues' bound, the shift, A and b as lists."""
    columns, _ = read(path, SCHEMA)
    return [
        {
            "component": k,
            "largest_eigenvalue": float(columns["largest_eigenvalue"][k]),
            "shift": float(columns["shift"][k]),
            "A": columns["A"][k].tolist(),
            "b": columns["b"][k].tolist(),
        }
        for k in range(columns["A"].shape[0])
    ]
