"""What is up to date and what is stale, and why: keys against the store, and against the manifest for the reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from pipeline.errors import DataError
from pipeline.experiment import Experiment, Point
from pipeline.key import Key, differences, stage_key
from pipeline.manifest import Manifest
from pipeline.stage import Stage
from pipeline.store import Artifact, Store, file_digest


class State(StrEnum):
    """State of a stage at a point."""

    CACHED = "cached"
    """The store holds the result of exactly this key."""
    NEW = "new"
    """The key agrees with the manifest, or there is no manifest; this store has not computed it."""
    DAMAGED = "damaged"
    """The store knew the key, but an object is missing or its bytes are not those of its digest."""
    STALE = "stale"
    """The key differs from the manifest's and this store has not computed it."""
    WAITING = "waiting"
    """An earlier stage has to run first; what it gives decides."""


@dataclass(frozen=True, kw_only=True)
class Examined:
    """A stage at a point, held against the store.

    Attributes:
        key: none while an earlier stage has to run first.
        record: the action record, where the state is cached.
        reasons: why it is not cached, or what differs from the manifest.
        sources: label -> external file.
    """

    point: Point
    stage: Stage
    state: State
    key: Key | None = None
    record: Mapping[str, Any] | None = None
    reasons: tuple[str, ...] = ()
    sources: Mapping[str, Path] = field(default_factory=dict)


class Examiner:
    """Holds stages against a store and a manifest; remembers the digests of external files for as long as it lives."""

    def __init__(self, root: Path, store: Store, manifest: Manifest | None) -> None:
        self.root = root
        self.store = store
        self.manifest = manifest
        self._digests: dict[Path, str] = {}

    def examine(self, stage: Stage, point: Point, artifacts: Mapping[str, Artifact]) -> Examined:
        """State of a stage whose inputs are known. Raises ClpvError where an external file is not there."""
        sources = stage.sources(point.parameters[stage.name], self.root)
        key = stage_key(
            stage,
            point,
            {name: artifacts[name].digest for name in stage.inputs},
            {label: self._digest(label, path) for label, path in sources.items()},
        )
        reasons = self._reasons(stage, point, key)
        record = self.store.action(key.value)
        if record is None:
            state = State.STALE if reasons else State.NEW
        elif all(self.store.holds(artifact) for artifact in self.store.outputs(record).values()):
            state = State.CACHED
        else:
            state, reasons = State.DAMAGED, ["an object in the store is missing or damaged", *reasons]
        return Examined(
            point=point,
            stage=stage,
            state=state,
            key=key,
            record=record if state is State.CACHED else None,
            reasons=tuple(reasons),
            sources=sources,
        )

    def _reasons(self, stage: Stage, point: Point, key: Key) -> list[str]:
        if self.manifest is None:
            return []
        recorded = self.manifest.entry(point.id, stage.name)
        if recorded is None or self.manifest.key(point.id, stage.name) == key.value:
            return []
        return differences(recorded, key, self.manifest.code.get(str(recorded.get("code"))))

    def _digest(self, label: str, path: Path) -> str:
        if path not in self._digests:
            try:
                self._digests[path] = file_digest(path)
            except OSError as error:
                raise DataError(label, f"cannot be read: {error.strerror}.") from None
        return self._digests[path]


def plan(
    experiment: Experiment, stages: Sequence[Stage], examiner: Examiner, force: frozenset[str] = frozenset()
) -> list[Examined]:
    """State of every stage at every point, in order; behind a stage that has to run, later ones that read it wait."""
    rows = []
    for point in experiment.points:
        artifacts: dict[str, Artifact] = {}
        for stage in stages:
            missing = [name for name in stage.inputs if name not in artifacts]
            if missing:
                reason = f"waits for {', '.join(missing)}"
                rows.append(Examined(point=point, stage=stage, state=State.WAITING, reasons=(reason,)))
                continue
            try:
                found = examiner.examine(stage, point, artifacts)
            except DataError as error:
                # A file that has gone makes the stage stale; nothing is asked of the file to say so.
                rows.append(Examined(point=point, stage=stage, state=State.STALE, reasons=(str(error),)))
                continue
            if stage.name in force:
                found = Examined(
                    point=point,
                    stage=stage,
                    state=State.STALE,
                    key=found.key,
                    reasons=("forced",),
                    sources=found.sources,
                )
            rows.append(found)
            if found.record is not None:
                artifacts.update(examiner.store.outputs(found.record))
    return rows
