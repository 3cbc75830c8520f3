"""dynamics.parquet: a whole learned system, its certificate, the solver's report, and what else was tried.

Self-contained: the mixture that gates the components stands beside their matrices, as it may be another than the one
that was fitted (smoothed, or one of several candidates). P, the goal and the warp stand in the metadata.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stages.artifacts.parquet import Column, Schema, header, read, write
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.warp import Warp
from stages.mixture.gaussian import GaussianMixture

SCHEMA = Schema(
    name="dynamics",
    version=2,
    columns=(
        Column(name="weight", unit="1"),
        Column(name="mean", type="vector", unit="m"),
        Column(name="covariance", type="vector", unit="m2"),
        Column(name="A", type="vector", unit="1/s"),
        Column(name="b", type="vector", unit="m/s"),
        Column(name="largest_eigenvalue", unit="1/s"),
        Column(name="shift", unit="1/s"),
    ),
)


def write_dynamics(path: Path, model: LpvDs, largest_eigenvalues: Any, shift: Any, details: Mapping[str, Any]) -> None:
    """Write a model, one component a row, matrices row-major; b of a warped model, which has none, stays empty."""
    warp = model.warp if model.warp is not None and model.warp.count else None
    K = model.mixture.components
    columns = {
        "weight": model.mixture.weights,
        "mean": model.mixture.means.tolist(),
        "covariance": model.mixture.covariances.reshape(K, -1).tolist(),
        "A": model.matrices.reshape(K, -1).tolist(),
        "b": model.offsets.tolist() if warp is None else None,
        "largest_eigenvalue": largest_eigenvalues,
        "shift": shift,
    }
    limit = model.speed_limit if math.isfinite(model.speed_limit) else None
    metadata = {"goal": model.goal.tolist(), "P": model.lyapunov_matrix.tolist(), "speed_limit": limit, **details}
    if warp is not None:
        metadata["warp"] = {
            "centres": warp.centres.tolist(),
            "translations": warp.translations.tolist(),
            "rates": warp.rates.tolist(),
        }
    write(path, SCHEMA, columns, metadata)


def read_dynamics(path: Path) -> LpvDs:
    """The model of a file."""
    columns, metadata = read(path, SCHEMA)
    goal = np.array(metadata["goal"])
    d = goal.shape[0]
    mixture = GaussianMixture(
        weights=columns["weight"],
        means=np.stack(list(columns["mean"])),
        covariances=np.stack(list(columns["covariance"])).reshape(-1, d, d),
    )
    warp, limit = metadata.get("warp"), metadata["speed_limit"]
    return LpvDs(
        mixture=mixture,
        matrices=np.stack(list(columns["A"])).reshape(-1, d, d),
        goal=goal,
        lyapunov_matrix=np.array(metadata["P"]),
        warp=None if warp is None else Warp(**{name: np.array(values) for name, values in warp.items()}),
        speed_limit=math.inf if limit is None else limit,
    )


def read_details(path: Path) -> dict[str, Any]:
    """Kind, goal, P, warp, certificate, solver report, errors and candidates of a dynamics.parquet."""
    return header(path)


def read_components(path: Path) -> list[dict[str, Any]]:
    """One row a component: its eigenvalues' bound, the shift, A and b (none of a warped system) as lists."""
    columns, metadata = read(path, SCHEMA)
    warped = "warp" in metadata
    return [
        {
            "component": k,
            "weight": float(columns["weight"][k]),
            "largest_eigenvalue": float(columns["largest_eigenvalue"][k]),
            "shift": float(columns["shift"][k]),
            "A": columns["A"][k].tolist(),
            "b": None if warped else columns["b"][k].tolist(),
        }
        for k in range(columns["A"].shape[0])
    ]
