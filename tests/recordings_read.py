"""Rerun recordings, read back for tests: entities, counts, times, values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader


@dataclass(frozen=True, kw_only=True)
class Read:
    """A recording as it was read back.

    Attributes:
        entities: paths, those of the viewer's own properties left out.
        timelines: names.
        chunks: all of them.
        application, recording: their names.
        blueprints: how many layouts come with it.
    """

    entities: set[str]
    timelines: set[str]
    chunks: list[Any]
    application: str
    recording: str
    blueprints: int

    def values(self, entity: str, component: str) -> list[Any]:
        """All rows of a component, e.g. ``Scalars:scalars``, in order; those that are static, too."""
        batches = [c.to_record_batch() for c in self.chunks if c.entity_path == entity]
        return [row for batch in batches if component in batch.schema.names for row in batch[component].to_pylist()]

    def times(self, entity: str) -> np.ndarray:
        """Times of an entity's rows that are not static, array, shape (n,), seconds."""
        found = [
            batch["time"].cast("int64").to_numpy()
            for batch in (c.to_record_batch() for c in self.chunks if c.entity_path == entity and not c.is_static)
        ]
        return np.concatenate(found) / 1e9 if found else np.zeros(0)

    def below(self, root: str) -> set[str]:
        """Entities below a path, without it."""
        return {entity.removeprefix(f"{root}/") for entity in self.entities if entity.startswith(f"{root}/")}


def read_back(path: Path) -> Read:
    reader = RrdReader(path)
    schema = reader.store().schema()
    (recording,) = reader.recordings()
    return Read(
        entities={entity for entity in schema.entity_paths() if not entity.startswith("/__")},
        timelines={column.name for column in schema.index_columns()},
        chunks=list(reader.stream()),
        application=recording.application_id,
        recording=recording.recording_id,
        blueprints=len(reader.blueprints()),
    )
