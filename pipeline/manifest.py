"""The manifest of an experiment, runs/<name>/manifest.json: what every point led to, to be committed and verified.

It holds, for each point, its overrides and stage keys, and for each key, once, the key's components in clear, the
digests and sizes of the outputs and their headline figures. No path, time, processor or revision: those are in the
store's action records.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pipeline.errors import UsageError
from pipeline.experiment import Experiment
from pipeline.store import write_atomically

VERSION = 1


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """What a manifest file says.

    Attributes:
        points: id -> ``overrides`` and ``keys`` (stage -> key).
        keys: key -> its components, ``outputs`` (artifact -> digest, size) and ``metrics``.
        code: code digest -> module -> definition -> digest.
    """

    points: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    keys: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    code: Mapping[str, Mapping[str, Mapping[str, str]]] = field(default_factory=dict)

    def entry(self, point: str, stage: str) -> Mapping[str, Any] | None:
        """What was recorded for a stage at a point."""
        key = self.points.get(point, {}).get("keys", {}).get(stage)
        return self.keys.get(key) if key is not None else None

    def key(self, point: str, stage: str) -> str | None:
        """The key that was recorded for a stage at a point."""
        value = self.points.get(point, {}).get("keys", {}).get(stage)
        return None if value is None else str(value)

    def text(self, name: str) -> str:
        """The file's text: sorted, one entry a line."""
        document = {
            "version": VERSION,
            "experiment": name,
            "points": self.points,
            "keys": self.keys,
            "code": self.code,
        }
        return json.dumps(document, indent=1, sort_keys=True, allow_nan=False) + "\n"


def read_manifest(experiment: Experiment) -> Manifest | None:
    """The experiment's manifest, or none. Raises UsageError where the file is not one."""
    path = experiment.manifest_path
    if not path.exists():
        return None
    shown = f"runs/{experiment.name}/{path.name}"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["version"] != VERSION:
            raise UsageError(
                f"{shown} is of version {document['version']}, this clpv reads version {VERSION}: "
                f"delete it and run 'clpv run {experiment.name}'."
            )
        manifest = Manifest(points=document["points"], keys=document["keys"], code=document["code"])
        entries = [manifest.keys[key] for point in manifest.points.values() for key in point["keys"].values()]
        tables = [manifest.code, *(entry[part] for entry in entries for part in ("parameters", "outputs", "metrics"))]
        if not all(isinstance(table, dict) for table in tables):
            raise TypeError
        return manifest
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(
            f"{shown} cannot be read as a manifest: restore it, or delete it and run 'clpv run {experiment.name}'."
        ) from None


def write_manifest(experiment: Experiment, manifest: Manifest) -> None:
    """Write the manifest, whole or not at all. Raises StoreError."""
    write_atomically(experiment.manifest_path, manifest.text(experiment.name))


def compose(rows: Iterable[tuple[str, Mapping[str, Any], str, Mapping[str, Any]]]) -> Manifest:
    """A manifest of (point, overrides, stage, action record) rows."""
    points: dict[str, dict[str, Any]] = {}
    keys: dict[str, dict[str, Any]] = {}
    code: dict[str, Mapping[str, Mapping[str, str]]] = {}
    for point, overrides, stage, record in rows:
        entry = points.setdefault(point, {"overrides": dict(overrides), "keys": {}})
        entry["keys"][stage] = record["key"]
        keys[record["key"]] = {
            **record["components"],
            "outputs": record["outputs"],
            "metrics": record["metrics"],
        }
        code[record["components"]["code"]] = record["definitions"]
    return Manifest(points=points, keys=keys, code=code)


def same_keys(a: Manifest, b: Manifest) -> bool:
    """Whether two manifests have the same points with the same keys."""
    return {p: dict(e["keys"]) for p, e in a.points.items()} == {p: dict(e["keys"]) for p, e in b.points.items()}
