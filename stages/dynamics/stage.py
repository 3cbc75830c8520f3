"""The dynamics stage: a stable, certified dynamical system. Paper eqs. (6)-(8)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.stage import Port, Stage, StageContext
from stages.dynamics.parameters import QlfParameters

IMPLEMENTATIONS = {"qlf": "stages.dynamics.qlf:fit_dynamics"}
"""Kind -> (position, velocity, mixture, goal, parameters) -> DynamicsFit."""


def run(context: StageContext) -> None:
    """Learn and certify the system."""
    from stages.artifacts.dynamics import write_dynamics
    from stages.artifacts.midpoints import read_midpoints, training_set
    from stages.artifacts.mixture import read_mixture

    midpoints = read_midpoints(context.inputs["midpoints"])
    position, velocity, _ = training_set(midpoints)
    mixture = read_mixture(context.inputs["mixture"])
    learn = STAGE.implementation(context.parameters.kind)
    fit = learn(position, velocity, mixture, midpoints.goal, context.parameters)
    shifted = int((fit.certificate.shift > 0).sum())
    if shifted:
        context.warn(f"{shifted} component(s) had to be shifted by rounding errors to be certified.")
    details = {
        "kind": context.parameters.kind,
        "certificate": {"margin": fit.certificate.margin, "shifted": shifted},
        "solver": {
            "name": "clarabel",
            "status": fit.solution.status,
            "iterations": fit.solution.iterations,
            "objective": fit.solution.objective,
            "residuals": fit.solution.residuals,
        },
        "rmse": fit.rmse,
        "relative_rmse": fit.relative_rmse,
    }
    certificate = fit.certificate
    write_dynamics(context.outputs["dynamics"], fit.model, certificate.largest_eigenvalues, certificate.shift, details)


def rows(outputs: Mapping[str, Path]) -> list[dict[str, Any]]:
    """One row a component."""
    from stages.artifacts.dynamics import read_components

    return read_components(outputs["dynamics"])


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """Fit and certificate in figures."""
    from stages.artifacts.dynamics import read_components, read_details

    details = read_details(outputs["dynamics"])
    return {
        "certified_margin_1_s": details["certificate"]["margin"],
        "largest_eigenvalue_1_s": max(row["largest_eigenvalue"] for row in read_components(outputs["dynamics"])),
        "rmse_m_s": details["rmse"],
        "relative_rmse": details["relative_rmse"],
    }


STAGE = Stage(
    name="dynamics",
    summary="stable dynamical system with a certificate: eqs. (6)-(8)",
    parameters=QlfParameters,
    inputs=("midpoints", "mixture"),
    outputs=(Port(name="dynamics", filename="dynamics.parquet"),),
    run=run,
    presets={"paper": {"kind": "qlf"}, "robust": {"kind": "qlf"}},
    implementations=IMPLEMENTATIONS,
    libraries=("numpy", "scipy", "numba", "clarabel", "pyarrow"),
    headline=headline,
    rows=rows,
    warm="stages.warm:dynamics",
)
