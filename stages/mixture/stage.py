"""The mixture stage: a Gaussian mixture over the training positions. Paper eq. (5)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.stage import Port, Stage, StageContext
from stages.mixture.parameters import MixtureParameters

IMPLEMENTATIONS = {"pcgmm": "stages.mixture.pcgmm:fit_pcgmm", "em": "stages.mixture.em:fit_em"}
"""Kind -> (position, velocity, lengths, parameters, generator) -> MixtureFit."""


def run(context: StageContext) -> None:
    """Fit the mixture, and keep who belongs where and how it was found."""
    from stages.artifacts.midpoints import read_midpoints, training_set
    from stages.artifacts.mixture import write_assignments, write_mixture, write_sampler
    from stages.mixture.gaussian import responsibilities

    position, velocity, lengths = training_set(read_midpoints(context.inputs["midpoints"]))
    fit = STAGE.implementation(context.parameters.kind)
    found = fit(position, velocity, lengths, context.parameters, context.generator())
    write_mixture(context.outputs["mixture"], found.mixture, {"kind": context.parameters.kind})
    gamma = responsibilities(found.mixture, position)
    write_assignments(context.outputs["assignments"], gamma, found.sampled, found.labels)
    write_sampler(context.outputs["sampler"], found.log_posterior, found.components_by_sweep, found.criterion)


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """How many components there are."""
    from stages.artifacts.mixture import read_mixture

    return {"components": read_mixture(outputs["mixture"]).components}


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
    presets={"paper": {"kind": "pcgmm"}, "robust": {"kind": "pcgmm"}},
    implementations=IMPLEMENTATIONS,
    libraries=("numpy", "scipy", "numba", "pyarrow"),
    random=True,
    headline=headline,
    warm="stages.warm:mixture",
)
