"""Recompute an experiment into a scratch store and hold it against its manifest: bytes first, then figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.errors import UsageError
from pipeline.experiment import Experiment
from pipeline.key import Key, differences
from pipeline.manifest import Manifest, read_manifest
from pipeline.project import Project
from pipeline.runner import Event, Outcome
from pipeline.store import Store

RTOL = 1e-6
"""Relative tolerance on headline figures where the bytes differ, as on another processor."""

ATOL = 1e-12
"""Figures nearer than this agree: rounding errors about zero have no relative size."""


@dataclass(frozen=True, kw_only=True)
class Verification:
    """What a recomputation showed.

    Attributes:
        stages: number of (point, stage) pairs compared.
        bitwise: pairs whose outputs agree to the bit.
        within: pairs whose bytes differ, but whose figures agree within `RTOL`.
        mismatches: sentences, one a pair that does not agree.
        stale: what the manifest was made with that has changed since: code, parameters, libraries.
    """

    stages: int
    bitwise: int
    within: int
    mismatches: tuple[str, ...]
    stale: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether everything agrees."""
        return not self.mismatches


def verify(
    project: Project, experiment: Experiment, *, jobs: int | None, listener: Callable[[Event], None]
) -> Verification:
    """Recompute everything, trusting nothing of the store. Raises UsageError where there is no manifest."""
    manifest = read_manifest(experiment)
    if manifest is None:
        raise UsageError(
            f"runs/{experiment.name} has no manifest to verify against: make it with 'clpv run {experiment.name}'."
        )
    project.store.prepare()
    with project.store.scratch() as folder:
        store = Store(folder=folder)
        outcomes = project.bring_up(experiment, project.last.name, jobs=jobs, listener=listener, store=store)
    mismatches = [
        f"{point}: it is in the manifest and no longer in the experiment"
        for point in manifest.points
        if point not in {p.id for p in experiment.points}
    ]
    bitwise, within, stale = 0, 0, dict[str, None]()
    for outcome in outcomes:
        recorded = manifest.entry(outcome.point.id, outcome.stage)
        if recorded is None:
            mismatches.append(f"{outcome.point.id}, {outcome.stage}: it is not in the manifest")
            continue
        stale.update(dict.fromkeys(_changed(manifest, recorded, outcome)))
        if recorded["outputs"] == outcome.record["outputs"]:
            bitwise += 1
            continue
        wrong = disagreements(recorded["metrics"], outcome.record["metrics"])
        mismatches.extend(f"{outcome.point.id}, {outcome.stage}: {sentence}" for sentence in wrong)
        within += not wrong
    return Verification(
        stages=len(outcomes), bitwise=bitwise, within=within, mismatches=tuple(mismatches), stale=tuple(stale)
    )


def disagreements(recorded: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """Figures that are not within `RTOL` of each other, one sentence each; none recorded at all is a disagreement."""
    if not recorded:
        return ["its bytes differ, and the manifest holds no figures to compare"]
    wrong = []
    for name in sorted({*recorded, *found}):
        old, new = recorded.get(name), found.get(name)
        if not _close(old, new):
            wrong.append(f"{name} is {new}, the manifest says {old}")
    return wrong


def _close(a: Any, b: Any) -> bool:
    if isinstance(a, int | float) and isinstance(b, int | float):
        return math.isclose(a, b, rel_tol=RTOL, abs_tol=ATOL)
    return bool(a == b)


def _changed(manifest: Manifest, recorded: Mapping[str, Any], outcome: Outcome) -> list[str]:
    """What differs between the recorded key and the new one, inputs aside: they follow from earlier stages."""
    if manifest.key(outcome.point.id, outcome.stage) == outcome.record["key"]:
        return []
    key = Key(
        value=outcome.record["key"],
        components=outcome.record["components"],
        definitions=outcome.record["definitions"],
    )
    found = differences(recorded, key, manifest.code.get(str(recorded.get("code"))))
    return [sentence for sentence in found if not sentence.startswith("input ")]
