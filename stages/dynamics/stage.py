"""The dynamics stage: a stable, certified dynamical system. Paper eqs. (6)-(8)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.stage import Port, Stage, StageContext
from stages.dynamics.parameters import DynamicsParameters

IMPLEMENTATIONS = {
    "qlf": "stages.dynamics.qlf:fit",
    "pqlf": "stages.dynamics.pqlf:fit",
    "warped": "stages.dynamics.warped:fit",
}
"""Kind -> (demonstrations, mixtures by name, goal, parameters) -> DynamicsFit."""


def run(context: StageContext) -> None:
    """Learn and certify the system; a program that cannot be solved is kept for study."""
    from dataclasses import asdict

    import numpy as np

    from pipeline.errors import SolverError
    from stages.artifacts.dynamics import write_dynamics
    from stages.artifacts.midpoints import read_midpoints, training_set
    from stages.artifacts.mixture import read_mixtures
    from stages.dynamics.lpvds import velocity_error
    from stages.dynamics.program.saved import save_problem
    from stages.dynamics.samples import resting

    midpoints = read_midpoints(context.inputs["midpoints"])
    training_set(midpoints)
    learn = STAGE.implementation(context.parameters.kind)
    mixtures = read_mixtures(context.inputs["mixture"])
    try:
        fit = learn(midpoints.of_split("train"), mixtures, midpoints.goal, context.parameters)
    except SolverError as error:
        if error.program is None:
            raise
        kept = context.keep("program.npz")
        save_problem(kept, error.program)
        place = "/".join(kept.parts[-5:])
        raise SolverError(f"{error.problem} The program is kept in {place}.", error.status, error.residuals) from error
    shifted = int((fit.certificate.shift > 0).sum())
    if shifted:
        context.warn(f"{shifted} component(s) had to be shifted by rounding errors to be certified.")
    still = float(np.mean(np.concatenate([resting(t) for t in midpoints.of_split("train")])))
    if still > 0.1:
        context.warn(
            f"Demonstrations are at rest for {100 * still:.0f} % of the time: a motion that depends on the state alone "
            "cannot pause; trim or divide the recordings (ingest) if that is not meant."
        )
    if fit.relative_rmse > 0.8:
        context.warn(
            f"The system's velocities are far from the demonstrations' (relative error {fit.relative_rmse:.2f}): a "
            "smaller dynamics.margin, or another dynamics.kind, may be what this motion needs."
        )
    if any(entry.chosen and not entry.arrives for entry in fit.tried):
        context.warn(
            "No candidate's training roll-outs all came to the goal in time: the system that was taken is stable, but "
            "slow somewhere; look at its roll-outs, or widen the choice (dynamics.guidance, mixture.components)."
        )
    test = midpoints.of_split("test")
    details = {
        "kind": context.parameters.kind,
        "mixture": fit.mixture,
        "certificate": {
            "margin": fit.certificate.margin,
            "shifted": shifted,
            "warp_slope": None if fit.model.warp is None else fit.model.warp.bound,
        },
        "solver": {
            "name": "clarabel",
            "form": fit.solution.form,
            "status": fit.solution.status,
            "iterations": fit.solution.iterations,
            "refinements": fit.solution.refinements,
            "objective": fit.solution.objective,
            "residuals": fit.solution.residuals,
        },
        "rmse": fit.rmse,
        "relative_rmse": fit.relative_rmse,
        "test_rmse": velocity_error(fit.model, test) if test else None,
        "tried": [asdict(entry) for entry in fit.tried],
    }
    certificate = fit.certificate
    write_dynamics(context.outputs["dynamics"], fit.model, certificate.largest_eigenvalues, certificate.shift, details)


def rows(outputs: Mapping[str, Path]) -> list[dict[str, Any]]:
    """One row a component."""
    from stages.artifacts.dynamics import read_components

    return read_components(outputs["dynamics"])


def tables(outputs: Mapping[str, Path]) -> Mapping[str, list[dict[str, Any]]]:
    """What the system was chosen from, where there were several candidates."""
    from stages.artifacts.dynamics import read_details

    names = (
        *("mixture", "components", "share", "guidance", "condition", "velocity_error", "held_out_error"),
        *("deviation", "held_out_deviation", "score", "arrives", "chosen"),
    )
    tried = [{name: entry[name] for name in names} for entry in read_details(outputs["dynamics"])["tried"]]
    return {"candidates, on training demonstrations alone": tried} if tried else {}


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """Fit and certificate in figures."""
    from stages.artifacts.dynamics import read_components, read_details

    details = read_details(outputs["dynamics"])
    components = read_components(outputs["dynamics"])
    found: dict[str, float] = {
        "components": len(components),
        "certified_margin_1_s": details["certificate"]["margin"],
        "largest_eigenvalue_1_s": max(row["largest_eigenvalue"] for row in components),
        "train_velocity_rmse_m_s": details["rmse"],
        "train_velocity_relative_rmse": details["relative_rmse"],
    }
    if details["test_rmse"] is not None:
        found["test_velocity_rmse_m_s"] = details["test_rmse"]
    if details["tried"]:
        found["candidates_tried"] = len(details["tried"])
    return found


STAGE = Stage(
    name="dynamics",
    summary="stable dynamical system with a certificate: eqs. (6)-(8)",
    parameters=DynamicsParameters,
    inputs=("midpoints", "mixture"),
    outputs=(Port(name="dynamics", filename="dynamics.parquet"),),
    run=run,
    presets={"paper": {"kind": "qlf"}, "robust": {"kind": "warped"}},
    implementations=IMPLEMENTATIONS,
    libraries=("numpy", "scipy", "numba", "clarabel", "pyarrow"),
    headline=headline,
    rows=rows,
    tables=tables,
    warm="stages.warm:dynamics",
    plots="stages.figures.terminal:dynamics",
)
