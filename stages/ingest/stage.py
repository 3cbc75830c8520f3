"""The ingest stage: recordings in, one table of demonstrations out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.stage import Port, Stage, StageContext, load
from stages.ingest.parameters import IngestParameters

IMPLEMENTATIONS = {"lasa": "stages.ingest.lasa:ingest", "recording": "stages.ingest.recordings:ingest"}
"""Kind -> (files by label, parameters, what warns) -> demonstrations and details."""

LOCATE = {"lasa": "stages.ingest.lasa:locate", "recording": "stages.ingest.sources:locate"}
"""Kind -> (parameters, project root) -> label -> file. Import strings: bags stay out of the key of LASA."""


def sources(parameters: IngestParameters, root: Path) -> Mapping[str, Path]:
    """The external files that are read, by label."""
    found: Mapping[str, Path] = load(LOCATE[parameters.kind])(parameters, root)
    return found


def about(parameters: IngestParameters, root: Path) -> Mapping[str, str]:
    """What the dataset's card says."""
    name = "lasa" if parameters.kind == "lasa" else parameters.dataset
    # By name, so that no key depends on how a card is read: no result does.
    facts: Mapping[str, str] = load("stages.ingest.card:read_card")(root, name)
    return facts


def run(context: StageContext) -> None:
    """Read the demonstrations and write them as one table."""
    from stages.artifacts.demonstrations import write_demonstrations

    read = STAGE.implementation(context.parameters.kind)
    demonstrations, details = read(context.sources, context.parameters, context.warn)
    write_demonstrations(context.outputs["demonstrations"], demonstrations, details)


def headline(outputs: Mapping[str, Path]) -> Mapping[str, float]:
    """What was counted while recordings became demonstrations; nothing for data that came clean."""
    from stages.artifacts.parquet import header

    counts: Mapping[str, float] = header(outputs["demonstrations"]).get("counts", {})
    return counts


STAGE = Stage(
    name="ingest",
    summary="reads recorded demonstrations",
    parameters=IngestParameters,
    inputs=(),
    outputs=(Port(name="demonstrations", filename="demonstrations.parquet"),),
    run=run,
    presets={"paper": {"kind": "lasa"}, "robust": {"kind": "lasa"}},
    implementations=IMPLEMENTATIONS,
    libraries=("numpy", "scipy", "pyarrow"),
    kind_libraries={"recording": ("rosbags", "mcap", "pytransform3d", "zstandard", "ruamel.yaml", "lz4")},
    sources=sources,
    about=about,
    headline=headline,
    plots="stages.figures.terminal:ingest",
)
