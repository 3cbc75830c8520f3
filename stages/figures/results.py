"""What an experiment that has been run holds, read from the store: what the report's sections are made of.

Everything is read when it is first asked for. Not here: how anything is shown.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.experiment import FILE, Experiment, Point
from pipeline.project import Project
from stages.artifacts import dynamics as dynamics_table
from stages.artifacts import rollouts as rollouts_table
from stages.artifacts.metrics import read_metrics
from stages.artifacts.midpoints import Midpoints, read_midpoints
from stages.artifacts.mixture import read_sampler
from stages.artifacts.rollouts import RecordedRollout, RecordedScene, read_rollouts, read_scenes
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.stage import STAGE as DYNAMICS
from stages.figures.conditions import among_obstacles
from stages.figures.deviation import Resolved
from stages.figures.excursions import strayed
from stages.figures.numbers import KINDS
from stages.rollout.parameters import CarryParameters, Condition, RolloutParameters
from stages.trajectory import Array

KIND = "dynamics.kind"
"""Dotted name of the kind of dynamics."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointResults:
    """One point of a sweep, or the only one of an experiment.

    Attributes:
        point: its parameters.
        files: artifact name -> file.
        records: stage -> action record.
        among: whether the roll-outs and rows are those among obstacles, or those without; none: all.
    """

    point: Point
    files: Mapping[str, Path]
    records: Mapping[str, Mapping[str, Any]]
    among: bool | None = None

    @property
    def name(self) -> str:
        """What the point is called among those of its kind: its motion, or what sets it apart in the sweep."""
        ingest = self.point.parameters["ingest"]
        motion = getattr(ingest, "motion", None)
        if motion is None:
            return self.point.id if self.varied else str(ingest.dataset)
        depth = getattr(ingest, "depth", "")
        others = sorted(self.varied - {"ingest.motion", "ingest.depth"})
        apart = [f"{name.rpartition('.')[2]} {self.point.overrides[name]}" for name in others]
        return ", ".join([f"{motion}+{depth}" if depth else str(motion), *apart])

    @property
    def kind(self) -> str:
        """Its kind of dynamics."""
        return str(self.point.parameters["dynamics"].kind)

    @property
    def varied(self) -> frozenset[str]:
        """Dotted names of what the sweep sets, the kind of dynamics excepted: points of other kinds share it."""
        return frozenset(self.point.overrides) - {KIND}

    @property
    def partner(self) -> tuple[tuple[str, str], ...]:
        """What it has in common with its partners of other kinds: what the sweep sets, the kind excepted."""
        return tuple((name, repr(self.point.overrides[name])) for name in sorted(self.varied))

    @cached_property
    def midpoints(self) -> Midpoints:
        """Demonstrations and goal."""
        return read_midpoints(self.files["midpoints"])

    @cached_property
    def model(self) -> LpvDs:
        """The learned system."""
        return dynamics_table.read_dynamics(self.files["dynamics"])

    @cached_property
    def fit(self) -> dict[str, Any]:
        """Certificate, solver report and errors of the fit."""
        return dynamics_table.read_details(self.files["dynamics"])

    @cached_property
    def condition(self) -> float:
        """Condition of P: of its ellipses, the ratio of the axes squared."""
        return float(np.linalg.cond(np.array(self.fit["P"])))

    @cached_property
    def rollouts(self) -> tuple[RecordedRollout, ...]:
        """The cases, with their paths."""
        found = read_rollouts(self.files["rollouts"])[0]
        return tuple(r for r in found if self.among is None or bool(r.scene) == self.among)

    @cached_property
    def scenes(self) -> dict[str, RecordedScene]:
        """Scenes by name."""
        return read_scenes(self.files["rollouts"])

    @cached_property
    def resolved(self) -> Resolved:
        """What the motion made of its controllers' parameters."""
        details = rollouts_table.read_details(self.files["rollouts"])
        couplings = {label(c): c["coupling"] for c in details["controllers"] if c["kind"] != "lpvds"}
        stray = strayed(self.rollouts) if self.carries else ()
        return Resolved(top_speed=details["top_speed"], couplings=couplings, strayed=stray)

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of metrics.parquet, each with its point."""
        found = [{"point": self.point.id, **row} for row in read_metrics(self.files["metrics"])]
        return [row for row in found if self.among is None or bool(row["scene"]) == self.among]

    @cached_property
    def sampler(self) -> tuple[Array, NDArray[np.int64], dict[int, float]]:
        """Of the mixture that was taken: log posterior and K, shape (chains, sweeps), and the criterion by K."""
        columns, criteria = read_sampler(self.files["sampler"])
        name = self.fit["mixture"]
        own = columns["candidate"] == name
        chains = int(columns["chain"][own].max()) + 1
        log_posterior = columns["log_posterior"][own].reshape(chains, -1)
        return log_posterior, columns["components"][own].reshape(chains, -1), criteria.get(name, {})

    @property
    def carries(self) -> bool:
        """Whether two arms carry a box."""
        return isinstance(self.point.parameters["rollout"], CarryParameters)

    @property
    def rollout_parameters(self) -> RolloutParameters:
        """Of the rollout stage; where arms carry a box: `carry_cases.carry_parameters`."""
        parameters: RolloutParameters = self.point.parameters["rollout"]
        return parameters


@dataclass(frozen=True, kw_only=True, eq=False)
class Results:
    """An experiment and its points, or those of one kind of dynamics.

    Attributes:
        experiment: as it was resolved.
        points: in the order of the sweep.
        kind: of dynamics, the experiment's own; a sweep may have others beside it.
    """

    experiment: Experiment
    points: tuple[PointResults, ...]
    kind: str

    @cached_property
    def kinds(self) -> list[str]:
        """Kinds of dynamics of the points, those that are known first."""
        found = dict.fromkeys(point.kind for point in self.points)
        return [*(kind for kind in KINDS if kind in found), *(kind for kind in found if kind not in KINDS)]

    @cached_property
    def own(self) -> Results:
        """The points of the experiment's own kind."""
        return self.of_kind(self.kind)

    def of_kind(self, kind: str) -> Results:
        """The points of a kind of dynamics."""
        return replace(self, points=tuple(point for point in self.points if point.kind == kind), kind=kind)

    def part(self, *, among: bool) -> Results | None:
        """The roll-outs among obstacles, or those without; none: there are none."""
        points = tuple(replace(point, among=among) for point in self.points)
        return replace(self, points=points) if any(point.rows for point in points) else None

    def carrying(self, *, arms: bool) -> Results | None:
        """The points in which two arms carry a box, or the others; none: there are none."""
        points = tuple(point for point in self.points if point.carries == arms)
        return replace(self, points=points) if points else None

    @property
    def is_sweep(self) -> bool:
        """Whether there is more than one point."""
        return len(self.points) > 1

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of all points together."""
        return [row for point in self.points for row in point.rows]

    @property
    def points_word(self) -> str:
        """What the points are called together."""
        motions = all(hasattr(p.point.parameters["ingest"], "motion") for p in self.points)
        return "motions" if motions and all(p.varied <= {"ingest.motion"} for p in self.points) else "points"

    @cached_property
    def shown(self) -> PointResults:
        """The point that stands for all in the detailed figures: the motion of the paper's Fig. 2, or the first."""
        angle = [p for p in self.points if getattr(p.point.parameters["ingest"], "motion", None) == "Angle"]
        return (angle or list(self.points))[0]

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """Conditions of the shown point."""
        found, among = self.shown.rollout_parameters.conditions, self.shown.among
        return tuple(c for c in found if among is None or among_obstacles(c) == among)

    @property
    def controllers(self) -> list[str]:
        """Labels of the controllers, in the order of the roll-outs."""
        return list(dict.fromkeys(label(row) for row in self.rows))


def read_results(project: Project, experiment: Experiment) -> Results:
    """All results of an experiment. Raises StaleError where it has not been run or is out of date."""
    project.artifacts(experiment, project.last.name)  # raises where anything is not up to date
    records: dict[str, dict[str, Mapping[str, Any]]] = {point.id: {} for point in experiment.points}
    files: dict[str, dict[str, Path]] = {point.id: {} for point in experiment.points}
    for examined in project.plan(experiment, project.last.name):
        if examined.record is not None:
            records[examined.point.id][examined.stage.name] = examined.record
            for name, artifact in project.store.outputs(examined.record).items():
                files[examined.point.id][name] = project.store.path(artifact.digest)
    points = tuple(PointResults(point=p, files=files[p.id], records=records[p.id]) for p in experiment.points)
    return Results(experiment=experiment, points=points, kind=_own_kind(experiment, [p.kind for p in points]))


def _own_kind(experiment: Experiment, kinds: list[str]) -> str:
    """The kind of dynamics that the experiment's file gives, or its preset; of a sweep without it, the last."""
    if len(set(kinds)) == 1:
        return kinds[0]
    given = tomllib.loads((experiment.folder / FILE).read_text(encoding="utf-8-sig")).get("dynamics", {})
    kind = given.get("kind", DYNAMICS.presets[experiment.preset]["kind"])
    return str(kind) if kind in kinds else kinds[-1]


def label(row: Mapping[str, Any]) -> str:
    """The controller of a row or of a resolved controller, as `RecordedRollout.label` names it."""
    kind = row.get("controller") or row["kind"]
    return str(kind) if kind == "lpvds" else f"{kind} {row['mode']}"
