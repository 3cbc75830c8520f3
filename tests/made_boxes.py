"""Carried boxes that were never simulated, with their metrics, for tests of the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from pipeline.project import Project
from pipeline.report import Paragraph, Section, Table
from stages import STAGES
from stages.artifacts.metrics import write_metrics
from stages.artifacts.rollouts import read_rollouts, write_rollouts
from stages.evaluate.compare import recovery_time
from stages.evaluate.force import grip
from stages.evaluate.pushed import pushed
from stages.figures.results import PointResults, Results
from stages.policy.avoidance.shapes import spheres
from stages.policy.carrying import Phase
from stages.policy.outcome import Outcome
from stages.rollout.carry import PHASES
from stages.rollout.disturbances import spans_of
from stages.trajectory import frozen

EXPERIMENT = """
description = "A <box> & two arms"
[ingest]
motion = "Line"
depth = "Sine"
[midpoint]
samples = 60
[mixture]
kind = "em"
components = 2
[dynamics]
kind = "qlf"
[rollout]
kind = "bullet"
conditions = [{ name = "held" }, { name = "<stiff>", compliance = false, length_error = 0.001 }]
"""
START, GOAL = np.array([0.45, -0.15, 0.35]), np.array([0.65, 0.15, 0.47])
ORDER = (Phase.APPROACH, Phase.GRIP, Phase.CARRY, Phase.SET_DOWN, Phase.RELEASE, Phase.DONE)
SAMPLES, LIFT, DT = 60, 20, 0.02
SIDES = ("left", "right")
DRAG = (0.0, 0.03, 0.04)
"""Metres: 50 mm to the left and upwards."""

POT = {"centre": [0.55, 0.0, 0.40], "height": 0.22, "width": 0.1, "radius": 0.15}


def box(
    condition: str = "held",
    number: int = 0,
    *,
    force: tuple[float, float] = (5.0, 5.0),
    compliance: bool = True,
    mode: str = "robust",
    outcome: Outcome = Outcome.ARRIVED,
    ratio: float = 2.5,
    bias: float = 0.0,
    desired: float = 5.0,
    following: bool = True,
    coupling: bool = True,
    length_found: float = 0.3,
    mass_found: float | None = 0.41,
    push: str = "",
    named: str = "",
    drag: tuple[float, float, float] = DRAG,
    pressing: tuple[float, float, float] = (0.0, 0.0, 0.0),
    strays: float = 0.0,
    waits: bool = True,
    avoidance: str = "none",
    pots: Sequence[dict[str, Any]] = (),
    clearance: float = 0.004,
    room: tuple[float, float] = (0.03, 0.08),
    contacts: tuple[int, int] = (0, 0),
    refused: int = 0,
) -> SimpleNamespace:
    """A made-up roll-out of 60 samples: ten in each phase; the box goes straight, `force` of left and right.

    A push moves everything by `drag` in samples 22 to 25, and by half of it in the next two, while x waits; after that
    all is off by `strays` times it. `pressing`: of a force, instead of a drag. `named`: who is taken for pushed.
    """
    phases = ORDER
    if outcome in (Outcome.LOST_BOX, Outcome.DROPPED):
        phases = (Phase.APPROACH, Phase.GRIP, Phase.CARRY, Phase.CARRY, Phase.CARRY, Phase.LOST)
    if outcome in (Outcome.HELD, Outcome.OUT_OF_REACH):
        phases = (Phase.APPROACH, Phase.GRIP, Phase.CARRY, Phase.CARRY, Phase.CARRY, Phase.STOPPED)
    if outcome is Outcome.NOT_GRIPPED:
        phases = (Phase.APPROACH, Phase.APPROACH, Phase.APPROACH, Phase.GRIP, Phase.GRIP, Phase.MISSED)
    n, gate = SAMPLES, np.ones(SAMPLES, dtype=bool)
    acts = bool(push) and Phase.CARRY in phases
    if acts and waits:
        gate[22:28] = False
    moves = gate[LIFT : LIFT + 10].astype(float)
    gone = np.concatenate([np.zeros(LIFT + 1), np.cumsum(moves / moves.sum()), np.ones(n - LIFT - 11)])
    x = START + gone[:, None] * (GOAL - START)
    away = np.zeros(n)
    if acts:
        away[22:26], away[26:28], away[28:] = 1.0, 0.5, strays
    aside = away[:, None] * np.array(drag)
    way = x + aside
    end = np.array(way)
    if outcome in (Outcome.LOST_BOX, Outcome.DROPPED):
        end[45:, 2] = 0.1
    contact = np.where(np.arange(n)[:, None] < 10, 0.0, np.array(force))
    half = np.array([0.0, 0.15, 0.0])
    pads = np.stack([way + half, way - half], axis=1)
    acting = np.zeros((n, 2), dtype=bool)
    told = np.full(n, -1, dtype=np.int8)
    residual = np.zeros((n, 2))
    if acts:
        acting[22:26, SIDES.index(push)] = True
        residual[:, SIDES.index(push)] = away * float(np.linalg.norm(drag))
    if named:
        told[23:28] = SIDES.index(named)
    forced = any(pressing)
    carried = SimpleNamespace(
        phase=np.repeat([PHASES.index(p) for p in phases], 10).astype(np.int8),
        pads=pads,
        box=end,
        turn=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        force=contact,
        contact=contact,
        commanded=pads,
        q=np.zeros((n, 2, 7)),
        qdot=np.zeros((n, 2, 7)),
        desired=np.full(n, desired),
        residual=residual,
        named=told,
        acting=acting,
        box_room=np.full(n, room[0] if pots else math.nan),
        arm_room=np.full(n, room[1] if pots else math.nan),
    )
    facts = {
        "compliance": compliance,
        "following": following,
        "coupling": coupling,
        "length_found": length_found,
        "mass_found": mass_found,
        "pushes": [
            {
                "arm": push,
                "offset": [0.0, 0.0, 0.0] if forced else list(drag),
                "force": list(pressing),
                "rise": 0.0 if forced else 0.04,
                "hold": 0.08 if forced else 0.04,
            }
        ]
        if push
        else [],
        "pots": [dict(pot) for pot in pots],
        "refused": refused,
        "box_contacts": contacts[0],
        "arm_contacts": contacts[1],
        "force": 5.0,
        "mass": 0.4,
        "friction": 1.0,
        "centre_of_mass": [0.0, 0.0, 0.0],
        "start": START.tolist(),
        "goal": GOAL.tolist(),
        "box": [0.2, 0.3, 0.2],
        "bias": [bias, bias],
        "length_error": 0.001 * number,
        "grip_ratio": ratio,
    }
    kind = "clpvds" if coupling else "lpvds"
    clear = np.full(n, math.nan)
    if pots:
        clear[:] = clearance + 0.1
        clear[27] = clearance
    return SimpleNamespace(
        rollout=f"{kind}-{mode}/{condition}/{number}",
        controller=kind,
        mode=mode,
        avoidance=avoidance,
        condition=condition,
        dataset="Line",
        demo="1",
        split="train",
        outcome=outcome,
        scene=f"{condition}/{number}" if pots else "",
        disturbed=spans_of(acting.any(axis=1)),
        time=DT * np.arange(n),
        x=x,
        p_hat=x,
        gate=gate,
        lyapunov=np.zeros(n),
        clearance=clear,
        status=np.zeros(n, dtype=np.int8),
        carried=carried,
        scene_facts=facts,
    )


def learn(root: Path) -> Results:
    """A project with a learned system in space, whose roll-outs tests make up."""
    (root / "runs" / "box").mkdir(parents=True)
    (root / "runs" / "box" / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    project = Project.open(root, STAGES)
    experiment = project.experiment("box")
    project.bring_up(experiment, "dynamics", jobs=1)
    records, files = {}, {}
    for examined in project.plan(experiment, "dynamics"):
        assert examined.record is not None
        records[examined.stage.name] = examined.record
        files |= {k: project.store.path(a.digest) for k, a in project.store.outputs(examined.record).items()}
    point = PointResults(point=experiment.points[0], files=files, records=records)
    return Results(experiment=experiment, points=(point,), kind="qlf")


def with_boxes(
    learned: Results,
    folder: Path,
    boxes: Sequence[SimpleNamespace],
    name: str = "main",
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> PointResults:
    """The point with roll-outs and their metrics; `velocity`: of all pots, m/s."""
    (folder / name).mkdir()
    rollouts, metrics = folder / name / "rollouts.parquet", folder / name / "metrics.parquet"
    coupling = {"v_max": 0.75, "gate": 0.0, "p_max": 0.0, "k_c": 0.0}
    controllers = [{"kind": "clpvds", "mode": "robust", "coupling": coupling}]
    scenes = [scene(one, velocity) for one in boxes if one.scene]
    write_rollouts(rollouts, boxes, scenes, frozen(GOAL), {"top_speed": 0.15, "controllers": controllers})
    rows = []
    for found in read_rollouts(rollouts)[0]:
        assert found.carry is not None
        names = ("dataset", "controller", "mode", "avoidance", "condition", "demo", "split", "rollout", "outcome")
        case = {key: getattr(found, key) for key in names}
        clear = found.clearance[~np.isnan(found.clearance)]
        measured = {
            "dynamics": "qlf",
            "scene": found.scene or None,
            "lyapunov_rise_max": 0.0,
            "dtw_mm": 1234.0,
            "duration_s": float(found.time[-1]),
            "clearance_min_mm": 1e3 * float(clear.min()) if clear.size else None,
            "recovery_s": recovery_time(found.time, found.gate, found.disturbed),
        }
        held = asdict(grip(found.carry, found.outcome)) | asdict(pushed(found.carry, found.x, found.gate))
        rows.append({**case, **measured, **held})
    write_metrics(metrics, rows)
    point = learned.points[0]
    return replace(point, files={**point.files, "rollouts": rollouts, "metrics": metrics})


def scene(one: SimpleNamespace, velocity: Sequence[float]) -> SimpleNamespace:
    """The safety spheres of a roll-out's pots."""
    pots = one.scene_facts["pots"]
    centres, radii = np.array([pot["centre"] for pot in pots]), np.array([pot["radius"] for pot in pots])
    shapes = spheres(centres, radii, np.tile(velocity, (len(pots), 1)))
    return SimpleNamespace(name=one.scene, shapes=shapes, traps=None, complete=True)


def results_of(learned: Results, folder: Path, boxes: Sequence[SimpleNamespace], **options: Any) -> Results:
    return replace(learned, points=(with_boxes(learned, folder, boxes, **options),))


def tables(section: Section | None) -> list[Table]:
    assert section is not None
    return [block for block in section.blocks if isinstance(block, Table)]


def column(table: Table, *names: str) -> list[str]:
    """Cells of the column that bears the last of `names`; the one before it is the title of its group."""
    heads = [title for title, count in table.groups or (("", len(table.columns)),) for _ in range(count)]
    wanted = [i for i, (g, c) in enumerate(zip(heads, table.columns, strict=True)) if (g, c)[-len(names) :] == names]
    assert len(wanted) == 1, (names, table.columns)
    return [row[wanted[0]] for row in table.rows]


def said(section: Section | None) -> str:
    assert section is not None
    return " ".join(block.text for block in section.blocks if isinstance(block, Paragraph))
