"""The mixture stage: a Gaussian mixture over the training positions. Paper eq. (5)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.stage import Port, Stage, StageContext
from stages.mixture.parameters import MixtureParameters

if TYPE_CHECKING:
    from stages.mixture.fit import MixtureFit

IMPLEMENTATIONS = {
    "pcgmm": "stages.mixture.pcgmm:fit_pcgmm",
    "em": "stages.mixture.em:fit_em",
    "auto": "stages.mixture.auto:fit_auto",
}
"""Kind -> (position, velocity, lengths, parameters, generator) -> MixtureFit, or several by name: candidates."""


def run(context: StageContext) -> None:
    """Fit the mixture, or several, and keep who belongs where and how it was found."""
    from stages.artifacts.midpoints import read_midpoints, training_set
    from stages.artifacts.mixture import write_assignments, write_mixture, write_sampler
    from stages.mixture.gaussian import responsibilities

    position, velocity, lengths = training_set(read_midpoints(context.inputs["midpoints"]))
    fit = STAGE.implementation(context.parameters.kind)
    found = fit(position, velocity, lengths, context.parameters, context.generator())
    fits = by_name(context.parameters.kind, found)
    mixtures = {name: candidate.mixture for name, candidate in fits.items()}
    write_mixture(context.outputs["mixture"], mixtures, {"kind": context.parameters.kind})
    gammas = {name: responsibilities(mixture, position) for name, mixture in mixtures.items()}
    write_assignments(context.outputs["assignments"], gammas, fits)
    write_sampler(context.outputs["sampler"], fits)


def by_name(kind: str, found: MixtureFit | dict[str, MixtureFit]) -> dict[str, MixtureFit]:
    """What a way of fitting found as candidates by name: a single mixture has the name of its kind."""
    return found if isinstance(found, dict) else {kind: found}


def rows(outputs: Mapping[str, Path]) -> list[dict[str, Any]]:
    """One row a component of each candidate."""
    from stages.artifacts.mixture import read_mixtures

    return [
        {"candidate": name, "component": k, "weight": weight, "mean": mean, "covariance": covariance}
        for name, mixture in read_mixtures(outputs["mixture"]).items()
        for k, (weight, mean, covariance) in enumerate(
            zip(mixture.weights.tolist(), mixture.means.tolist(), mixture.covariances.tolist(), strict=True)
        )
    ]


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """How many components there are, by candidate if there are several, and how far the sampler's chains agree."""
    from stages.artifacts.mixture import read_mixtures, read_sampler
    from stages.mixture.spread import chain_spread

    mixtures = read_mixtures(outputs["mixture"])
    sampler, _ = read_sampler(outputs["sampler"])
    if len(mixtures) == 1:
        found = {"components": float(next(iter(mixtures.values())).components)}
    else:
        found = {f"components_{name}": float(mixture.components) for name, mixture in mixtures.items()}
    if "pcgmm" in mixtures:
        own = sampler["candidate"] == "pcgmm"
        chains = int(sampler["chain"][own].max()) + 1
        log_posterior = sampler["log_posterior"][own].reshape(chains, -1)
        spread = chain_spread(log_posterior, sampler["components"][own].reshape(chains, -1))
        found |= {"burn_in_sweeps": float(spread.burn_in)}
        if chains > 1:
            best = spread.best
            found |= {
                "chains": float(chains),
                "log_posterior_spread": float(best.max() - best.min()),
                "components_spread": float(spread.components.max() - spread.components.min()),
                "r_hat": spread.r_hat,
            }
    return found


STAGE = Stage(
    name="mixture",
    summary="Gaussian mixture over position: eq. (5), ref. [32]",
    parameters=MixtureParameters,
    inputs=("midpoints",),
    outputs=(
        Port(name="mixture", filename="mixture.parquet"),
        Port(name="assignments", filename="assignments.parquet"),
        Port(name="sampler", filename="sampler.parquet"),
    ),
    run=run,
    presets={"paper": {"kind": "pcgmm"}, "robust": {"kind": "auto"}},
    implementations=IMPLEMENTATIONS,
    libraries=("numpy", "scipy", "numba", "pyarrow"),
    random=True,
    headline=headline,
    rows=rows,
    warm="stages.warm:mixture",
    plots="stages.figures.terminal:mixture",
)
