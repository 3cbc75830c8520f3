"""The ingest stage: recordings in, one table of demonstrations out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.stage import Port, Stage, StageContext
from stages.ingest.parameters import LasaParameters

IMPLEMENTATIONS = {"lasa": "stages.ingest.lasa:read_lasa"}
"""Kind -> reader: (file, parameters) -> demonstrations."""


def sources(parameters: LasaParameters, root: Path) -> Mapping[str, Path]:
    """The motion's file, labelled by its name."""
    from stages.ingest.lasa import motion_file

    folder = None if parameters.folder is None else root / parameters.folder
    path = motion_file(parameters.motion, folder)
    return {path.name: path}


def run(context: StageContext) -> None:
    """Read the demonstrations and write them as one table."""
    from stages.artifacts.demonstrations import write_demonstrations

    (path,) = context.sources.values()
    read = STAGE.implementation(context.parameters.kind)
    write_demonstrations(context.outputs["demonstrations"], read(path, context.parameters))


STAGE = Stage(
    name="ingest",
    summary="reads recorded demonstrations",
    parameters=LasaParameters,
    inputs=(),
    outputs=(Port(name="demonstrations", filename="demonstrations.parquet"),),
    run=run,
    presets={"paper": {"kind": "lasa"}, "robust": {"kind": "lasa"}},
    implementations=IMPLEMENTATIONS,
    libraries=("numpy", "scipy", "pyarrow"),
    sources=sources,
)
