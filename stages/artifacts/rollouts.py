"""rollouts.parquet: every case of a roll-out stage in one table. Written by rollout, read by evaluate and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.artifacts.parquet import Coded, Column, Schema, header, read, vectors, write
from stages.policy.avoidance.shapes import BOX, ELLIPSOID, RADIUS, REACH, SIZES, SPHERE, Shapes, no_shapes
from stages.policy.carrying import Phase
from stages.policy.outcome import Status
from stages.trajectory import Array, frozen

SIDES = ("left", "right")
NAMED = ("", *SIDES)
ROOMS = ("box", "arm")
JOINTS = (("q", "rad"), ("qdot", "rad/s"))

SCHEMA = Schema(
    name="rollouts",
    version=4,
    columns=(
        Column(name="rollout", type="label"),
        Column(name="step", type="int"),
        Column(name="t", unit="s"),
        *vectors("x_", "m"),
        *vectors("p_hat_", "m"),
        Column(name="gate", type="bool"),
        Column(name="lyapunov", unit="m2"),
        Column(name="clearance", unit="m"),
        Column(name="status", type="label"),
        # Of two arms with a box; null where there are none.
        Column(name="phase", type="label"),
        *(c for side in SIDES for c in vectors(f"{side}_", "m")),
        *vectors("box_", "m"),
        *vectors("box_q", "", "xyzw"),
        *(Column(name=f"{side}_{name}", unit="N") for name in ("force", "contact") for side in SIDES),
        *(Column(name=f"{side}_commanded", type="vector", unit="m") for side in SIDES),
        *(Column(name=f"{side}_{name}", type="vector", unit=unit) for name, unit in JOINTS for side in SIDES),
        Column(name="desired", unit="N"),
        *(Column(name=f"{side}_residual", unit="m") for side in SIDES),
        Column(name="named", type="label"),
        *(Column(name=f"{side}_pushed", type="bool") for side in SIDES),
        *(Column(name=f"{what}_room", unit="m") for what in ROOMS),
    ),
)

KINDS = {SPHERE: "sphere", BOX: "box", ELLIPSOID: "ellipsoid"}


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedScene:
    """Obstacles of one or more cases.

    Attributes:
        name: as roll-outs name it.
        shapes: the obstacles, at the start.
        traps: array, shape (n, d), metres: minima of V on them; none: not looked for.
        complete: whether these are all.
    """

    name: str
    shapes: Shapes
    traps: Array | None
    complete: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedCarry:
    """What arms and box did in a roll-out of n samples.

    Attributes:
        phase: array of text, shape (n,): what the arms were at.
        joints: array, shape (n, 2, m), rad: of the left and the right arm.
        pads: array, shape (n, 2, 3), metres: middles of the pads' faces, left and right.
        box, turn: arrays, shapes (n, 3), metres, and (n, 4): centre of the box and its quaternion x y z w.
        force, contact: arrays, shape (n, 2), newtons: pressing forces as measured and filtered, and as they truly were.
        desired: array, shape (n,), newtons: F_d.
        residual: array, shape (n, 2), metres: by how much each pad is elsewhere than if nobody touched it, as found.
        named: array of text, shape (n,): the arm that was taken for pushed; "": none.
        pushed: array of bool, shape (n, 2): the arms that truly were.
        box_room, arm_room: arrays, shape (n,), metres: how far box and arms were from the nearest pot; nan: there
            was none.
        facts: what this box was: mass, friction, goal, box, compliance and more.
    """

    phase: NDArray[Any]
    joints: Array
    pads: Array
    box: Array
    turn: Array
    force: Array
    contact: Array
    desired: Array
    residual: Array
    named: NDArray[Any]
    pushed: NDArray[np.bool_]
    box_room: Array
    arm_room: Array
    facts: Mapping[str, Any]

    def led(self, time: Array) -> Array:
        """For how long the box had been led on its way, which is when pots that move do so; arrays, shape (n,), s."""
        leading = self.phase[:-1] == str(Phase.CARRY)
        return np.concatenate([[0.0], np.cumsum(np.diff(time) * leading)])


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedRollout:
    """One case as recorded: what it was, and what happened.

    Attributes:
        rollout: unique name, e.g. ``clpvds-robust/cond1/4``.
        controller, mode, avoidance, condition: of the case.
        dataset, demo, split: of the demonstration from whose first point it starts.
        outcome: how it ended.
        scene: name of its scene; "": there are no obstacles.
        disturbed: first and last samples of spans in which disturbances acted.
        time: array, shape (n,), seconds.
        x: array, shape (n, d), metres: the state of the learned system.
        p_hat: array, shape (n, d), metres: the executed state.
        gate: array, shape (n,), whether x may move from this sample.
        lyapunov: array, shape (n,), V of x, m^2.
        clearance: array, shape (n,), metres: least distance from any obstacle since the sample before; nan: none.
        status: array of text, shape (n,): what became of the step that follows.
        carry: of two arms with a box; none: there are none.
    """

    rollout: str
    controller: str
    mode: str
    avoidance: str
    condition: str
    dataset: str
    demo: str
    split: str
    outcome: str
    scene: str
    disturbed: tuple[tuple[int, int], ...]
    time: Array
    x: Array
    p_hat: Array
    gate: NDArray[np.bool_]
    lyapunov: Array
    clearance: Array
    status: NDArray[Any]
    carry: RecordedCarry | None = None

    @property
    def executed(self) -> Array:
        """What was executed, shape (n, d), metres: the pads' midpoint where there are arms, else p_hat."""
        return self.p_hat if self.carry is None else frozen(self.carry.pads.mean(axis=1))

    @property
    def displaced(self) -> int:
        """First sample that a disturbance has moved; -1: there is none."""
        return self.disturbed[0][0] if self.disturbed else -1

    @property
    def label(self) -> str:
        """The controller as figures and tables call it: its kind, and its mode where it has one of its own."""
        return self.controller if self.controller == "lpvds" else f"{self.controller} {self.mode}"


CARRIED = ("phase", "pads", "box", "turn", "force", "contact", "desired", "residual", "named", "acting")

CASE = ("rollout", "controller", "mode", "avoidance", "condition", "dataset", "demo", "split", "outcome", "scene")


def write_rollouts(
    path: Path, rollouts: Sequence[Any], scenes: Sequence[Any], goal: Array, details: Mapping[str, Any]
) -> None:
    """Write roll-outs in order; each has the attributes of `RecordedRollout`, its status as codes.

    Arguments:
        scenes: with the attributes of `RecordedScene`.
        goal: array, shape (d,), metres.
        details: plain values, kept beside the rows.
    """
    d, lengths = goal.shape[0], [r.time.shape[0] for r in rollouts]
    x = np.concatenate([r.x for r in rollouts])
    p_hat = np.concatenate([r.p_hat for r in rollouts])
    columns: dict[str, Any] = {
        "rollout": Coded(codes=np.repeat(np.arange(len(rollouts)), lengths), names=[r.rollout for r in rollouts]),
        "step": np.concatenate([np.arange(length) for length in lengths]),
        "t": np.concatenate([r.time for r in rollouts]),
        "gate": np.concatenate([r.gate for r in rollouts]),
        "lyapunov": np.concatenate([r.lyapunov for r in rollouts]),
        "clearance": np.concatenate([r.clearance for r in rollouts]),
        "status": Coded(codes=np.concatenate([r.status for r in rollouts]), names=[str(s) for s in Status]),
    }
    for index, axis in enumerate("xyz"[:d]):
        columns[f"x_{axis}"] = x[:, index]
        columns[f"p_hat_{axis}"] = p_hat[:, index]
    if rollouts and hasattr(rollouts[0], "carried"):
        columns |= _carry_columns(rollouts)
    cases = [
        {
            **{name: str(getattr(r, name)) for name in CASE},
            **({"facts": r.scene_facts} if hasattr(r, "scene_facts") else {}),
            "disturbed": [list(span) for span in r.disturbed],
            "samples": length,
        }
        for r, length in zip(rollouts, lengths, strict=True)
    ]
    metadata = {"goal": goal.tolist(), "cases": cases, "scenes": [_scene(scene) for scene in scenes], **details}
    write(path, SCHEMA, columns, metadata)


def read_rollouts(path: Path) -> tuple[list[RecordedRollout], Array]:
    """Roll-outs in order, and the goal, array, shape (d,), metres."""
    columns, details = read(path, SCHEMA)
    goal = frozen(details["goal"])
    axes = "xyz"[: goal.shape[0]]
    x = np.column_stack([columns[f"x_{axis}"] for axis in axes])
    p_hat = np.column_stack([columns[f"p_hat_{axis}"] for axis in axes])
    rollouts, first = [], 0
    for case in details["cases"]:
        part = slice(first, first + case["samples"])
        first = part.stop
        rollouts.append(
            RecordedRollout(
                **{name: case[name] for name in CASE},
                disturbed=tuple((int(begin), int(end)) for begin, end in case["disturbed"]),
                time=frozen(columns["t"][part]),
                x=frozen(x[part]),
                p_hat=frozen(p_hat[part]),
                gate=columns["gate"][part],
                lyapunov=frozen(columns["lyapunov"][part]),
                clearance=frozen(columns["clearance"][part]),
                status=columns["status"][part],
                carry=_carry(columns, part, case["facts"]) if "facts" in case else None,
            )
        )
    return rollouts, goal


def _carry_columns(rollouts: Sequence[Any]) -> dict[str, Any]:
    """Columns of roll-outs of two arms; each has `carried`, its phase as codes."""
    lists = ("commanded", *(name for name, _ in JOINTS))
    joined = {name: np.concatenate([getattr(r.carried, name) for r in rollouts]) for name in (*CARRIED, *lists)}
    columns: dict[str, Any] = {"phase": Coded(codes=joined["phase"], names=[str(phase) for phase in Phase])}
    for axis, name in enumerate("xyz"):
        columns[f"box_{name}"] = joined["box"][:, axis]
        for side, word in enumerate(SIDES):
            columns[f"{word}_{name}"] = joined["pads"][:, side, axis]
    for axis, name in enumerate("xyzw"):
        columns[f"box_q{name}"] = joined["turn"][:, axis]
    for side, word in enumerate(SIDES):
        columns[f"{word}_force"], columns[f"{word}_contact"] = joined["force"][:, side], joined["contact"][:, side]
        columns[f"{word}_residual"], columns[f"{word}_pushed"] = joined["residual"][:, side], joined["acting"][:, side]
        columns |= {f"{word}_{name}": list(joined[name][:, side]) for name in lists}
    columns["desired"] = joined["desired"]
    columns["named"] = Coded(codes=joined["named"] + 1, names=list(NAMED))
    for what in ROOMS:
        columns[f"{what}_room"] = np.concatenate([getattr(r.carried, f"{what}_room") for r in rollouts])
    return columns


def _carry(columns: Mapping[str, Any], part: slice, facts: Mapping[str, Any]) -> RecordedCarry:
    def stacked(*names: str) -> Array:
        return frozen(np.column_stack([columns[name][part] for name in names]))

    pads = [stacked(*(f"{side}_{axis}" for axis in "xyz")) for side in SIDES]
    return RecordedCarry(
        phase=columns["phase"][part],
        joints=frozen(np.stack([np.stack(columns[f"{side}_q"][part]) for side in SIDES], axis=1)),
        pads=frozen(np.stack(pads, axis=1)),
        box=stacked(*(f"box_{axis}" for axis in "xyz")),
        turn=stacked(*(f"box_q{axis}" for axis in "xyzw")),
        force=stacked(*(f"{side}_force" for side in SIDES)),
        contact=stacked(*(f"{side}_contact" for side in SIDES)),
        desired=frozen(columns["desired"][part]),
        residual=stacked(*(f"{side}_residual" for side in SIDES)),
        named=columns["named"][part],
        pushed=np.column_stack([columns[f"{side}_pushed"][part] for side in SIDES]).astype(np.bool_),
        box_room=frozen(columns["box_room"][part]),
        arm_room=frozen(columns["arm_room"][part]),
        facts=facts,
    )


def read_scenes(path: Path) -> dict[str, RecordedScene]:
    """Scenes by name, in order."""
    details = header(path)
    d = len(details["goal"])
    return {
        scene["name"]: RecordedScene(
            name=scene["name"],
            shapes=_shapes(scene["obstacles"], d),
            traps=None if scene["traps"] is None else frozen(np.array(scene["traps"]).reshape(-1, d)),
            complete=scene["complete"],
        )
        for scene in details["scenes"]
    }


def read_details(path: Path) -> dict[str, Any]:
    """What a roll-out table says beside its rows: goal, cases, scenes, resolved controllers."""
    return header(path)


def _scene(scene: Any) -> dict[str, Any]:
    shapes: Shapes = scene.shapes
    obstacles = [
        {
            "kind": KINDS[int(shapes.kinds[k])],
            "centre": shapes.centres[k].tolist(),
            "velocity": shapes.velocities[k].tolist(),
            "radius": float(shapes.measures[k, RADIUS]),
            "reach": float(shapes.measures[k, REACH]),
            "sizes": shapes.measures[k, SIZES:].tolist(),
            "frame": shapes.frames[k].tolist(),
        }
        for k in range(shapes.number)
    ]
    traps = None if scene.traps is None else scene.traps.tolist()
    return {"name": scene.name, "obstacles": obstacles, "traps": traps, "complete": bool(scene.complete)}


def _shapes(obstacles: Sequence[Mapping[str, Any]], d: int) -> Shapes:
    kinds = {name: kind for kind, name in KINDS.items()}
    shapes = no_shapes(d, len(obstacles))
    for k, obstacle in enumerate(obstacles):
        shapes.kinds[k] = kinds[obstacle["kind"]]
        shapes.centres[k], shapes.velocities[k] = obstacle["centre"], obstacle["velocity"]
        shapes.measures[k] = [obstacle["radius"], obstacle["reach"], *obstacle["sizes"]]
        shapes.frames[k] = obstacle["frame"]
    return shapes
