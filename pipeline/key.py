"""The stage key: the sha256 of everything that a stage's output may depend on, computed before it runs.

Contract version, stage, code, validated parameters, digests of inputs and external files, versions of the numerical
libraries that the stage declares, Python's minor version, and the seed where the stage draws random numbers.
"""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from pipeline import code
from pipeline.experiment import Point
from pipeline.stage import CONTRACT, Stage
from pipeline.values import digest, flatten, plain


@dataclass(frozen=True, kw_only=True)
class Key:
    """A stage key with its components in clear.

    Attributes:
        value: sha256, hexadecimal.
        components: what was digested; plain values.
        definitions: module -> name -> digest, of which ``components["code"]`` is the digest.
    """

    value: str
    components: Mapping[str, Any]
    definitions: Mapping[str, Mapping[str, str]]


def stage_key(stage: Stage, point: Point, inputs: Mapping[str, str], sources: Mapping[str, str]) -> Key:
    """The key of `stage` at `point`, given the digests of its inputs (by artifact) and external files (by label)."""
    chosen = point.parameters[stage.name]
    definitions = code.reached(stage.modules(chosen))
    components = {
        "contract": CONTRACT,
        "stage": stage.name,
        "code": code.code_digest(definitions),
        "parameters": plain(chosen),
        "inputs": dict(inputs),
        "sources": dict(sources),
        "libraries": {name: version(name) for name in stage.versioned(chosen)},
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "seed": point.seed if stage.random else None,
    }
    return Key(value=digest(components), components=components, definitions=definitions)


@cache
def version(distribution: str) -> str:
    """Installed version of a distribution, or ``absent``."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def differences(
    before: Mapping[str, Any], after: Key, before_code: Mapping[str, Mapping[str, str]] | None
) -> list[str]:
    """What changed between a recorded key's components and a new key, one short sentence each."""
    new = after.components
    found = []
    old_values, new_values = flatten(before.get("parameters", {})), flatten(new["parameters"])
    for name in {**old_values, **new_values}:
        old, now = (repr(values[name]) if name in values else "absent" for values in (old_values, new_values))
        if old != now:
            found.append(f"parameter {new['stage']}.{name}: {old} -> {now}")
    if before.get("code") != new["code"]:
        named = code.changes(before_code, after.definitions) if before_code is not None else []
        found.extend(f"code: {name}" for name in named or ["changed"])
    for part, word in (("libraries", "library"), ("inputs", "input"), ("sources", "source")):
        old_part, new_part = before.get(part, {}), new[part]
        for name in sorted({*old_part, *new_part}):
            if old_part.get(name) != new_part.get(name):
                shown = f": {old_part.get(name)} -> {new_part.get(name)}" if part == "libraries" else " changed"
                found.append(f"{word} {name}{shown}")
    for part in ("python", "seed", "contract"):
        if before.get(part) != new[part]:
            found.append(f"{part}: {before.get(part)} -> {new[part]}")
    return found
