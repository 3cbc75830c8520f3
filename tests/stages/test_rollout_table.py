"""rollouts.parquet and metrics.parquet: what goes in comes out, the same bytes for the same roll-outs; their means."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import DataError
from pipeline.stage import StageContext
from stages.artifacts.dynamics import write_dynamics
from stages.artifacts.metrics import SCHEMA as METRICS
from stages.artifacts.metrics import read_metrics
from stages.artifacts.midpoints import write_midpoints
from stages.artifacts.parquet import Coded, Column, Schema, header, read, write
from stages.artifacts.rollouts import (
    SCHEMA,
    RecordedRollout,
    RecordedScene,
    read_details,
    read_rollouts,
    read_scenes,
    write_rollouts,
)
from stages.dynamics.lpvds import LpvDs
from stages.evaluate.force import Grip
from stages.evaluate.parameters import EvaluateParameters
from stages.evaluate.pushed import Pushed
from stages.evaluate.stage import STAGE as EVALUATE
from stages.evaluate.stage import headline
from stages.evaluate.summary import by_condition
from stages.mixture.gaussian import GaussianMixture
from stages.policy.avoidance.parameters import Box, Ellipsoid, Sphere
from stages.policy.avoidance.scene import shapes_of
from stages.policy.carrying import Phase
from stages.policy.outcome import Outcome, Status
from stages.rollout.carry import Carried
from stages.rollout.physics import CarryRollout
from stages.rollout.stage import headline as rollout_headline
from stages.trajectory import Array, Trajectory

seeds = st.integers(0, 2**32 - 1)
CASE = ("rollout", "controller", "mode", "avoidance", "condition", "dataset", "demo", "split", "outcome", "scene")
TABLES = ("time", "x", "p_hat", "gate", "lyapunov")
CODES = {str(status): code for code, status in enumerate(Status)}
NUMBERS = ("pads", "box", "turn", "force", "contact", "desired", "residual", "box_room", "arm_room")
"""Arrays of `Carried` that come back under their own names."""


def rollout(n: int = 6, d: int = 2, **changes: Any) -> RecordedRollout:
    """A roll-out of the plain controller straight to the goal at the origin, without obstacles; its status as codes."""
    x = np.linspace([0.1] + [0.0] * (d - 1), [0.0] * d, n)
    case: dict[str, Any] = {
        "rollout": "lpvds/none/4",
        "controller": "lpvds",
        "mode": "robust",
        "avoidance": "none",
        "condition": "none",
        "dataset": "made",
        "demo": "4",
        "split": "test",
        "scene": "",
        "time": 0.1 * np.arange(n),
        "x": x,
        "p_hat": x,
        "gate": np.ones(n, dtype=bool),
        "lyapunov": (x**2).sum(axis=1),
        "clearance": np.full(n, np.inf),
        "status": np.zeros(n, dtype=np.int8),
        "disturbed": (),
        "outcome": Outcome.ARRIVED,
    }
    return RecordedRollout(**(case | changes))


def among(n: int = 7, **changes: Any) -> RecordedRollout:
    """A roll-out among obstacles: every status once, an obstacle entered in the end."""
    case: dict[str, Any] = {
        "rollout": "lpvds/roas+/two/4",
        "avoidance": "roas+",
        "condition": "two",
        "scene": "two/made/4/0",
        "clearance": np.array([0.05, 0.03, 0.02, 0.01, 0.004, 0.002, -0.001][:n]),
        "status": np.arange(n, dtype=np.int8),
        "outcome": Outcome.COLLIDED,
    }
    return rollout(n, **(case | changes))


def carried(n: int = 6, seed: int = 0, pots: bool = False, **changes: Any) -> CarryRollout:
    """A roll-out of two arms that carry a box; every number differs from every other one."""
    generator = np.random.default_rng(seed)
    draw = generator.normal
    room = draw(size=(2, n)) if pots else np.full((2, n), np.nan)
    arms = Carried(
        time=0.1 * np.arange(n),
        x=draw(size=(n, 3)),
        p_hat=draw(size=(n, 3)),
        gate=generator.uniform(size=n) < 0.5,
        phase=generator.integers(0, len(Phase), size=n).astype(np.int8),
        q=draw(size=(n, 2, 7)),
        qdot=draw(size=(n, 2, 7)),
        pads=draw(size=(n, 2, 3)),
        commanded=draw(size=(n, 2, 3)),
        box=draw(size=(n, 3)),
        turn=draw(size=(n, 4)),
        force=draw(size=(n, 2)),
        contact=draw(size=(n, 2)),
        desired=draw(size=n),
        residual=draw(size=(n, 2)),
        named=generator.integers(-1, 2, size=n).astype(np.int8),
        acting=generator.uniform(size=(n, 2)) < 0.5,
        clearance=draw(size=n) if pots else np.full(n, np.nan),
        box_room=room[0],
        arm_room=room[1],
        status=generator.integers(0, len(Status), size=n).astype(np.int8),
        box_contacts=2,
        arm_contacts=3,
        length=0.31,
        mass=0.4,
        outcome=Outcome.ARRIVED,
    )
    arms = dataclasses.replace(arms, **changes)
    case = {name: getattr(rollout(), name) for name in CASE} | {"rollout": f"clpvds-robust/pushed/{seed}"}
    case |= {name: getattr(arms, name) for name in ("time", "x", "p_hat", "gate", "clearance", "status", "outcome")}
    facts = {"mass": 0.5, "mass_found": 0.4, "length_found": 0.31, "pushes": [{"arm": "left", "rise": 0.5}], "pots": []}
    more = {"lyapunov": np.zeros(n), "disturbed": (), "missed": 0, "carried": arms, "scene_facts": facts}
    return CarryRollout(**(case | more))


def scene(name: str = "two/made/4/0", traps: Array | None = None, complete: bool = True, d: int = 2) -> RecordedScene:
    """A moving sphere, a turned box with rounded edges and a turned ellipsoid."""
    turned = (0.3,) if d == 2 else (0.0, 0.0, math.sin(0.15), math.cos(0.15))
    obstacles = (
        Sphere(centre=(0.05, 0.01, 0.02)[:d], radius=0.01, velocity=(0.0, -0.02, 0.1)[:d]),
        Box(centre=(0.0, 0.05, 0.0)[:d], half_extents=(0.01, 0.02, 0.03)[:d], rounding=0.002, rotation=turned),
        Ellipsoid(centre=(-0.1, 0.0, 0.1)[:d], semi_axes=(0.03, 0.01, 0.02)[:d], rotation=turned),
    )
    return RecordedScene(name=name, shapes=shapes_of(obstacles, d, "obstacles"), traps=traps, complete=complete)


def stored(
    path: Path,
    rollouts: Sequence[Any],
    scenes: Sequence[Any] = (),
    d: int = 2,
    details: Mapping[str, Any] | None = None,
) -> Path:
    write_rollouts(path, rollouts, scenes, np.zeros(d), details or {"top_speed": 0.2})
    return path


# --- rollouts.parquet -----------------------------------------------------------------------------------------------


def test_roll_outs_come_back_as_they_went_in(tmp_path: Path) -> None:
    written = [
        rollout(disturbed=((2, 3), (5, 5))),
        among(),
        among(1, rollout="lpvds/roas+/in/4", outcome=Outcome.GOAL_INSIDE, scene="in"),  # it never began
    ]
    path = stored(tmp_path / "rollouts.parquet", written, [scene(), scene("in")])
    found, goal = read_rollouts(path)
    assert goal.tolist() == [0.0, 0.0]
    assert len(found) == 3
    for one, two in zip(written, found, strict=True):
        for name in CASE:
            assert getattr(two, name) == str(getattr(one, name))
        for name in TABLES:
            assert np.array_equal(getattr(two, name), getattr(one, name))
        assert two.disturbed == one.disturbed
        assert two.displaced == one.displaced
    assert [found[0].displaced, found[1].displaced] == [2, -1]
    assert not found[1].x.flags.writeable
    assert not found[1].clearance.flags.writeable


def test_clearance_is_missing_where_there_is_no_obstacle(tmp_path: Path) -> None:
    path = stored(tmp_path / "rollouts.parquet", [rollout(), among()], [scene()])
    free, near = read_rollouts(path)[0]
    assert np.isnan(free.clearance).all()
    assert near.clearance.tolist() == among().clearance.tolist()
    column = pq.read_table(path)["clearance"]
    assert column.null_count == 6  # null, not a number that others would have to know
    assert column.to_pylist()[6] == 0.05


def test_status_is_stored_as_the_name_of_its_code(tmp_path: Path) -> None:
    path = stored(tmp_path / "rollouts.parquet", [rollout(2), among()], [scene()])
    free, near = read_rollouts(path)[0]
    assert free.status.tolist() == ["free", "free"]
    names = ["free", "active", "detouring", "yielding", "infeasible", "too-fast", "trapped"]
    assert near.status.tolist() == names == [str(status) for status in Status]


def test_labels_are_those_of_the_controllers(tmp_path: Path) -> None:
    written = [rollout(), rollout(rollout="clpvds-paper/none/4", controller="clpvds", mode="paper")]
    found = read_rollouts(stored(tmp_path / "rollouts.parquet", written))[0]
    assert [r.label for r in found] == ["lpvds", "clpvds paper"]


@given(seeds, st.integers(2, 3))
def test_every_number_comes_back_to_the_bit(tmp_path_factory: pytest.TempPathFactory, seed: int, d: int) -> None:
    generator = np.random.default_rng(seed)
    written = []
    for number in range(int(generator.integers(1, 4))):
        n = int(generator.integers(1, 20))
        clearance = generator.normal(size=n)
        clearance[generator.uniform(size=n) < 0.3] = np.inf
        written.append(
            rollout(
                n,
                d,
                rollout=f"lpvds/a/{number}",
                x=generator.normal(size=(n, d)),
                p_hat=generator.normal(size=(n, d)) * 10.0 ** generator.integers(-300, 300),
                gate=generator.uniform(size=n) < 0.5,
                lyapunov=generator.exponential(size=n),
                clearance=clearance,
                status=generator.integers(0, len(Status), size=n).astype(np.int8),
            )
        )
    path = stored(tmp_path_factory.mktemp("table") / "rollouts.parquet", written, d=d)
    found, goal = read_rollouts(path)
    assert goal.shape == (d,)
    for one, two in zip(written, found, strict=True):
        for name in TABLES:
            assert getattr(two, name).tobytes() == np.ascontiguousarray(getattr(one, name)).tobytes()
        seen = np.isfinite(one.clearance)
        assert np.array_equal(two.clearance[seen], one.clearance[seen])
        assert np.isnan(two.clearance[~seen]).all()
        assert [CODES[name] for name in two.status] == one.status.tolist()


@pytest.mark.parametrize("d", [2, 3])
def test_scenes_come_back_with_their_traps(tmp_path: Path, d: int) -> None:
    traps = np.arange(2.0 * d).reshape(2, d) / 7.0
    written = [
        scene("trapping", traps, d=d),
        scene("free", np.empty((0, d)), complete=False, d=d),
        scene("nobody asked", d=d),
    ]
    found = read_scenes(stored(tmp_path / "rollouts.parquet", [rollout(d=d)], written, d=d))
    assert list(found) == ["trapping", "free", "nobody asked"]
    for one in written:
        two = found[one.name]
        assert two.complete == one.complete
        for here, there in zip(one.shapes, two.shapes, strict=True):
            assert here.dtype == there.dtype
            assert np.array_equal(here, there)
        if one.traps is None:
            assert two.traps is None
        else:
            assert two.traps is not None
            assert two.traps.shape == one.traps.shape
            assert np.array_equal(two.traps, one.traps)


def test_a_table_without_obstacles_has_no_scenes(tmp_path: Path) -> None:
    path = stored(tmp_path / "rollouts.parquet", [rollout()], details={"top_speed": 0.2, "controllers": []})
    assert read_scenes(path) == {}
    details = read_details(path)
    assert (details["top_speed"], details["controllers"], details["scenes"]) == (0.2, [], [])
    assert details["cases"][0]["samples"] == 6
    assert details["cases"][0]["outcome"] == "arrived"


def test_equal_roll_outs_give_equal_bytes(tmp_path: Path) -> None:
    def bytes_of(name: str, transposed: bool = False) -> bytes:
        x = among().x
        laid_out = np.asfortranarray(x) if transposed else x
        rollouts = [rollout(disturbed=((2, 3),)), among(x=laid_out, p_hat=laid_out)]
        scenes = [scene(traps=np.array([[0.1, 0.2]])), scene("other")]
        return stored(tmp_path / name, rollouts, scenes).read_bytes()

    first = bytes_of("one.parquet")
    assert bytes_of("two.parquet") == first
    assert bytes_of("three.parquet", transposed=True) == first
    assert stored(tmp_path / "other.parquet", [rollout(), among()], [scene()]).read_bytes() != first


def test_the_table_says_what_it_is_and_in_which_units(tmp_path: Path) -> None:
    path = stored(tmp_path / "rollouts.parquet", [rollout()])
    found = header(path)
    assert (found["schema"], found["version"]) == ("rollouts", 4)
    schema = pq.read_schema(path)
    assert schema.names == [column.name for column in SCHEMA.columns]
    units = {field.name: (field.metadata or {}).get(b"unit") for field in schema}
    assert {name: units[name] for name in ("t", "p_hat_z", "lyapunov", "clearance", "status")} == {
        "t": b"s",
        "p_hat_z": b"m",
        "lyapunov": b"m2",
        "clearance": b"m",
        "status": None,
    }


def test_columns_of_arms_and_a_box_are_there_and_empty_without_them(tmp_path: Path) -> None:
    path = stored(tmp_path / "rollouts.parquet", [rollout(), among()])
    table = pq.read_table(path)
    names = ["phase", *(f"{part}_{axis}" for part in ("left", "right", "box") for axis in "xyz")]
    names += [f"box_q{axis}" for axis in "xyzw"]
    names += ["left_force", "right_force", "left_contact", "right_contact"]
    names += [f"{side}_{name}" for name in ("commanded", "q", "qdot") for side in ("left", "right")]
    names += ["desired", "left_residual", "right_residual", "named", "left_pushed", "right_pushed"]
    names += ["box_room", "arm_room"]
    assert table.column_names[-len(names) :] == names
    assert all(table[name].null_count == table.num_rows == 13 for name in names)
    found, _ = read_rollouts(path)
    assert [one.carry for one in found] == [None, None]
    assert all(np.array_equal(one.executed, one.p_hat) for one in found)
    units = {field.name: (field.metadata or {}).get(b"unit") for field in table.schema}
    assert (units["left_x"], units["box_z"], units["box_qw"], units["right_contact"]) == (b"m", b"m", None, b"N")
    assert (units["left_commanded"], units["left_q"], units["right_qdot"]) == (b"m", b"rad", b"rad/s")
    assert (units["desired"], units["left_residual"], units["right_residual"]) == (b"N", b"m", b"m")
    assert (units["named"], units["left_pushed"], units["right_pushed"]) == (None, None, None)
    assert (units["box_room"], units["arm_room"]) == (b"m", b"m")


def test_roll_outs_of_arms_come_back_as_they_went_in(tmp_path: Path) -> None:
    written = [carried(pots=True), carried(1, seed=1), carried(9, seed=2)]
    found, _ = read_rollouts(stored(tmp_path / "rollouts.parquet", written, d=3))
    assert len(found) == 3
    for one, two in zip(written, found, strict=True):
        arms, carry = one.carried, two.carry
        assert carry is not None
        for name in NUMBERS:
            there = getattr(carry, name)
            assert there.shape == getattr(arms, name).shape
            assert np.array_equal(there, getattr(arms, name), equal_nan=name.endswith("_room"))
            assert not there.flags.writeable
        assert carry.phase.tolist() == [str(tuple(Phase)[code]) for code in arms.phase]
        assert carry.named.tolist() == [("", "left", "right")[code + 1] for code in arms.named]
        assert carry.pushed.dtype == np.bool_
        assert np.array_equal(carry.pushed, arms.acting)
        assert carry.facts == one.scene_facts
        assert np.array_equal(two.clearance, one.clearance, equal_nan=True)
        assert [CODES[name] for name in two.status] == one.status.tolist()
        assert np.array_equal(two.executed, arms.pads.mean(axis=1))
        assert np.array_equal(two.carry.joints, arms.q)
    rooms = [one.carry.box_room for one in found if one.carry is not None]
    assert [bool(np.isnan(room).any()) for room in rooms] == [False, True, True]


def test_columns_of_pushes_hold_what_they_are_called(tmp_path: Path) -> None:
    one = carried(
        3,
        desired=np.array([5.0, 6.0, 7.0]),
        residual=np.array([[0.001, 0.002], [0.003, 0.004], [0.005, 0.006]]),
        named=np.array([-1, 0, 1], dtype=np.int8),
        acting=np.array([[False, False], [True, False], [True, True]]),
        box_room=np.array([0.1, 0.2, -0.01]),
        arm_room=np.array([0.3, 0.4, 0.5]),
    )
    table = pq.read_table(stored(tmp_path / "rollouts.parquet", [one], d=3))
    wanted = {
        "desired": [5.0, 6.0, 7.0],
        "left_residual": [0.001, 0.003, 0.005],
        "right_residual": [0.002, 0.004, 0.006],
        "named": ["", "left", "right"],
        "left_pushed": [False, True, True],
        "right_pushed": [False, False, True],
        "box_room": [0.1, 0.2, -0.01],
        "arm_room": [0.3, 0.4, 0.5],
    }
    assert {name: table[name].to_pylist() for name in wanted} == wanted
    for side, name in enumerate(("left", "right")):
        for column in ("commanded", "q", "qdot"):
            assert table[f"{name}_{column}"].to_pylist() == getattr(one.carried, column)[:, side].tolist()


def test_equal_roll_outs_of_arms_give_equal_bytes(tmp_path: Path) -> None:
    def bytes_of(name: str, **changes: Any) -> bytes:
        return stored(tmp_path / f"{name}.parquet", [carried(**changes), carried(4, seed=1)], d=3).read_bytes()

    first = bytes_of("one")
    residual, acting = carried().carried.residual, carried().carried.acting
    assert bytes_of("two") == first
    assert bytes_of("three", residual=np.asfortranarray(residual), acting=np.asfortranarray(acting)) == first
    assert bytes_of("other", acting=~acting) != first


def test_another_version_and_another_table_are_refused(tmp_path: Path) -> None:
    columns = {"step": np.arange(3)}
    for version in (1, 3):
        old = dataclasses.replace(SCHEMA, version=version)
        write(tmp_path / "old.parquet", old, columns, {"goal": [0.0], "cases": []})
        with pytest.raises(DataError, match=f"holds rollouts version {version}, not version 4"):
            read_rollouts(tmp_path / "old.parquet")
    write(tmp_path / "other.parquet", Schema(name="other", version=2, columns=SCHEMA.columns), columns, {})
    with pytest.raises(DataError, match="holds other version 2") as error:
        read_rollouts(tmp_path / "other.parquet")
    assert error.value.source == "rollouts.parquet"
    path = stored(tmp_path / "cut.parquet", [rollout()])
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(DataError, match="run the stage again"):
        read_rollouts(path)


def test_coded_labels_are_the_same_as_labels(tmp_path: Path) -> None:
    schema = Schema(name="labels", version=1, columns=(Column(name="word", type="label"),))
    coded = Coded(codes=np.array([2, 0, 2, 2], dtype=np.int8), names=["a", "unused", "c"])
    assert len(coded) == 4
    write(tmp_path / "coded.parquet", schema, {"word": coded}, {})
    write(tmp_path / "plain.parquet", schema, {"word": ["c", "a", "c", "c"]}, {})
    for name in ("coded", "plain"):
        assert read(tmp_path / f"{name}.parquet", schema)[0]["word"].tolist() == ["c", "a", "c", "c"]


def test_headline_of_roll_outs_counts_outcomes_and_scenes_with_traps(tmp_path: Path) -> None:
    written = [rollout(), among(), among(3, rollout="lpvds/cbf/two/4"), rollout(2, rollout="lpvds/none/5")]
    scenes = [scene("a", np.ones((2, 2))), scene("b", np.empty((0, 2))), scene("c")]
    path = stored(tmp_path / "rollouts.parquet", written, scenes)
    assert rollout_headline({"rollouts": path}) == {
        "rollouts": 4,
        "arrived": 2,
        "collided": 2,
        "steps": 5 + 6 + 2 + 1,
        "scenes": 3,
        "scenes with traps": 1,
    }
    free = rollout_headline({"rollouts": stored(tmp_path / "free.parquet", [rollout()])})
    assert free == {"rollouts": 1, "arrived": 1, "steps": 5}


# --- metrics.parquet ------------------------------------------------------------------------------------------------


def demonstration(d: int = 2) -> Trajectory:
    """The way of `rollout` at its own clock: 100 mm in 0.5 s."""
    time, position = np.linspace(0.0, 0.5, 11), np.linspace([0.1] + [0.0] * (d - 1), [0.0] * d, 11)
    velocity = np.tile([-0.2] + [0.0] * (d - 1), (11, 1))
    return Trajectory(dataset="made", demo="4", split="test", time=time, position=position, velocity=velocity)


def evaluated(
    folder: Path, rollouts: Sequence[Any], scenes: Sequence[RecordedScene], d: int = 2
) -> list[dict[str, Any]]:
    """Rows that the evaluate stage makes of roll-outs of xdot = -2 x."""
    mixture = GaussianMixture(weights=np.ones(1), means=np.zeros((1, d)), covariances=np.eye(d)[None])
    model = LpvDs(mixture=mixture, matrices=-2.0 * np.eye(d)[None], goal=np.zeros(d), lyapunov_matrix=np.eye(d))
    inputs = {name: folder / f"{name}.parquet" for name in ("midpoints", "dynamics", "rollouts")}
    write_midpoints(inputs["midpoints"], [demonstration(d)], np.zeros(d), [None], {})
    write_dynamics(inputs["dynamics"], model, [-4.0], [0.0], {"kind": "qlf"})
    stored(inputs["rollouts"], rollouts, scenes, d)
    outputs = {"metrics": folder / "metrics.parquet"}
    context = StageContext(
        stage="evaluate", parameters=EvaluateParameters(samples=50), inputs=inputs, sources={}, outputs=outputs
    )
    EVALUATE.run(context)
    assert EVALUATE.rows is not None
    rows = EVALUATE.rows(outputs)
    assert rows == read_metrics(outputs["metrics"])
    return rows


SCENES = [
    RecordedScene(name="two/made/4/0", shapes=scene().shapes, traps=np.ones((3, 2)), complete=True),
    RecordedScene(name="calm", shapes=scene().shapes, traps=np.empty((0, 2)), complete=True),
    RecordedScene(name="nobody asked", shapes=scene().shapes, traps=None, complete=True),
]


def test_metrics_of_a_roll_out_among_obstacles_by_hand(tmp_path: Path) -> None:
    (row,) = evaluated(tmp_path, [among()], SCENES)
    assert list(row) == [column.name for column in METRICS.columns]
    assert (row["avoidance"], row["condition"], row["outcome"]) == ("roas+", "two", "collided")
    assert (row["scene"], row["traps"], row["dynamics"]) == ("two/made/4/0", 3, "qlf")
    # The last status is of no step: six steps, of which all but the first were changed.
    assert (row["steps"], row["avoiding_steps"], row["detour_steps"]) == (6, 5, 1)
    assert (row["yielding_steps"], row["flagged_steps"]) == (1, 2)
    assert row["clearance_min_mm"] == pytest.approx(-1.0, rel=1e-12)
    assert row["displaced_step"] is None
    assert row["recovery_s"] is None
    # f - xdot = -2 x + 0.2 at x = 0, 0.01, ..., 0.1: 0.02 k, k = 0 .. 10.
    rms = 0.02 * math.sqrt(sum(k * k for k in range(11)) / 11)
    assert row["velocity_rmse_mm_s"] == pytest.approx(1e3 * rms, rel=1e-9)


def test_metrics_of_a_roll_out_without_obstacles_leave_out_what_is_not_there(tmp_path: Path) -> None:
    (row,) = evaluated(tmp_path, [rollout(disturbed=((2, 3),))], [])
    for name in ("scene", "traps", "clearance_min_mm", "recovery_s"):
        assert row[name] is None
    for name in ("avoiding_steps", "detour_steps", "yielding_steps", "flagged_steps", "gate_closed_steps"):
        assert row[name] == 0
    assert row["displaced_step"] == 2
    assert row["avoidance"] == "none"


def test_traps_are_counted_where_somebody_looked_for_them(tmp_path: Path) -> None:
    rollouts = [among(rollout=f"r{k}", scene=one.name) for k, one in enumerate(SCENES)]
    assert [row["traps"] for row in evaluated(tmp_path, rollouts, SCENES)] == [3, 0, None]


def test_energy_and_recovery_of_a_coupled_roll_out_by_hand(tmp_path: Path) -> None:
    # x waits at samples 2 to 4; pushed by 60 mm at sample 2, held there at 3.
    x = np.array([[0.1, 0.0], [0.08, 0.0], [0.06, 0.0], [0.06, 0.0], [0.06, 0.0], [0.03, 0.0], [0.0, 0.0]])

    def coupled(aside: Sequence[float], disturbed: tuple[tuple[int, int], ...]) -> RecordedRollout:
        return rollout(
            7,
            controller="clpvds",
            x=x,
            p_hat=x + np.outer(aside, [0.0, 1.0]),
            gate=np.array([True, True, False, False, False, True, True]),
            lyapunov=(x**2).sum(axis=1),
            disturbed=disturbed,
        )

    pushed = [0.0, 0.0, 0.06, 0.06, 0.02, 0.0, 0.0]
    (row,) = evaluated(tmp_path, [coupled(pushed, ((2, 3),))], [])
    assert (row["lyapunov_rise_max"], row["energy_rise_max"]) == (0.0, 0.0)
    assert row["gate_closed_steps"] == 3
    assert row["recovery_s"] == pytest.approx(0.2, rel=1e-12)  # from the end of the hold, sample 3, to sample 5
    # Without a disturbance to blame: from 0.08^2 to 0.06^2 + 0.06^2.
    (row,) = evaluated(tmp_path, [coupled(pushed, ())], [])
    assert row["lyapunov_rise_max"] == 0.0
    assert row["energy_rise_max"] == pytest.approx(8e-4, rel=1e-9)
    assert row["recovery_s"] is None
    # It goes farther away while x waits: from 0.06^2 to 0.07^2 at sample 4.
    (row,) = evaluated(tmp_path, [coupled([*pushed[:4], 0.07, 0.0, 0.0], ((2, 3),))], [])
    assert row["energy_rise_max"] == pytest.approx(13e-4, rel=1e-9)


PUSHED = {field.name for field in dataclasses.fields(Pushed)}


def test_every_figure_of_a_carried_box_has_a_column_with_its_unit() -> None:
    columns = {column.name: column for column in METRICS.columns}
    fields = [*dataclasses.fields(Pushed), *dataclasses.fields(Grip)]
    assert {field.name for field in fields} <= set(columns)
    assert len({field.name for field in fields}) == len(fields)  # neither hides one of the other's
    types = {"bool": "bool", "str": "text", "int": "int", "float": "float"}
    units = {"mm": "mm", "n": "N", "g": "g", "deg": "deg"}
    for field in fields:
        column = columns[field.name]
        assert column.type == types[str(field.type).removesuffix(" | None")]
        assert column.unit == units.get(field.name.rsplit("_", 1)[-1], "")


def test_pushes_and_pots_of_a_carried_box_by_hand(tmp_path: Path) -> None:
    x = np.linspace([0.1, 0.0, 0.0], [0.0, 0.0, 0.0], 6)
    aside = np.array([[0.0] * 3, [0.0] * 3, [0.0, 0.0, 0.02], [0.0, 0.0, 0.001], [0.0] * 3, [0.0] * 3])
    half = np.array([0.0, 0.15, 0.0])
    facts: dict[str, Any] = {
        **{"compliance": True, "following": True, "coupling": False, "force": 5.0, "grip_ratio": 2.5, "mass": 0.5},
        **{"bias": [0.0, 0.0], "start": [0.1, 0.0, 0.0], "goal": [0.0, 0.0, 0.0], "box": [0.2, 0.3, 0.2]},
        **{"length_found": 0.304, "mass_found": 0.48, "pots": [{"radius": 0.1}], "box_contacts": 2, "arm_contacts": 3},
    }
    one = carried(
        6,
        x=x,
        p_hat=x[::-1] + 0.1,
        gate=np.array([True, True, False, True, True, True]),
        phase=np.full(6, list(Phase).index(Phase.CARRY), dtype=np.int8),
        pads=np.stack([x + aside + half, x + aside - half], axis=1),
        box=x + aside,
        turn=np.tile([0.0, 0.0, 0.0, 1.0], (6, 1)),
        desired=np.linspace(5.0, 7.5, 6),
        named=np.array([-1, -1, 0, 0, -1, -1], dtype=np.int8),
        acting=np.array([[False, False], [False, True], [False, True], *[[False, False]] * 3]),
        box_room=np.array([0.3, 0.2, 0.1, -0.004, 0.2, 0.3]),
        arm_room=np.array([0.5, 0.4, 0.05, 0.06, 0.4, 0.5]),
    )
    one = dataclasses.replace(one, scene_facts=facts)
    bare = {**facts, "pots": [], "mass_found": None}
    still = dataclasses.replace(one.carried, named=np.full(6, -1, dtype=np.int8), acting=np.zeros((6, 2), dtype=bool))
    two = dataclasses.replace(one, rollout="two", scene_facts=bare, carried=still)
    row, calm = evaluated(tmp_path, [one, two], [], d=3)
    assert list(row) == [column.name for column in METRICS.columns]
    flags = {"following": True, "coupling": False}
    wanted = {
        **{"deviation_max_mm": 20.0, "moved_while_away_mm": 20.0, "box_back_mm": 1.0, "desired_force_n": 7.5},
        **{"length_error_mm": 4.0, "mass_error_g": -20.0, "box_room_min_mm": -4.0, "arm_room_min_mm": 50.0},
        **{"box_contacts": 2, "arm_contacts": 3},
    }
    assert {*flags, "pushed", "named", *wanted} == PUSHED
    assert {name: row[name] for name in wanted} == pytest.approx(wanted, rel=1e-9)
    assert {name: row[name] for name in flags} == {name: calm[name] for name in flags} == flags
    assert (row["pushed"], row["named"], calm["pushed"], calm["named"]) == ("right", "left", None, None)
    missing = {"mass_error_g", "box_room_min_mm", "arm_room_min_mm", "box_contacts", "arm_contacts"}
    assert {calm[name] for name in missing} == {None}
    assert {name: calm[name] for name in set(wanted) - missing} == {name: row[name] for name in set(wanted) - missing}


def test_a_roll_out_without_a_box_has_no_figures_of_pushes_and_pots(tmp_path: Path) -> None:
    (row,) = evaluated(tmp_path, [among()], SCENES)
    assert {row[name] for name in PUSHED} == {None}
    with pq.ParquetFile(tmp_path / "metrics.parquet") as file:
        assert b'"version":6' in file.schema_arrow.metadata[b"clpv"]


# --- means ----------------------------------------------------------------------------------------------------------


def test_summary_counts_how_roll_outs_end_by_method(tmp_path: Path) -> None:
    outcomes = ("arrived", "collided", "infeasible", "too-fast", "trapped", "timeout", "diverged", "goal-inside")
    clearances = [4.0, -2.0, -3.0, -1.0, 0.5, 7.0, 8.0, None]
    (base,) = evaluated(tmp_path, [rollout()], [])
    rows = [
        base | {"avoidance": "roas+", "condition": "two", "outcome": o, "clearance_min_mm": c, "energy_rise_max": e}
        for o, c, e in zip(outcomes, clearances, [0.0, 3.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0], strict=True)
    ]
    rows += [base | {"avoidance": "cbf", "condition": "two"}, base]
    groups = by_condition(rows)
    assert [(g["avoidance"], g["condition"]) for g in groups] == [("roas+", "two"), ("cbf", "two"), ("none", "none")]
    first = groups[0]
    assert (first["rollouts"], first["arrived"], first["collided"], first["trapped"]) == (8, 1, 3, 1)
    assert first["clearance_min_mm"] == -3.0
    assert first["energy_rise_max"] == 3.0
    assert groups[1]["clearance_min_mm"] is None
    assert (groups[1]["collided"], groups[1]["trapped"], groups[1]["arrived"]) == (0, 0, 1)
    assert groups[2]["gate_never_closed"] is None


def test_headline_names_the_method_where_there_are_obstacles(tmp_path: Path) -> None:
    rollouts = [
        rollout(),
        among(),
        among(6, rollout="lpvds/roas+/two/5", demo="4", outcome=Outcome.ARRIVED, scene="calm"),
    ]
    rows = evaluated(tmp_path, rollouts, SCENES)
    figures = headline({"metrics": tmp_path / "metrics.parquet"})
    case = "lpvds/robust/roas+/two"
    assert {name: figures[f"{name} {case}"] for name in ("steps", "arrived", "collided")} == {
        "steps": 5.5,
        "arrived": 1,
        "collided": 1,
    }
    assert figures[f"dtw_mm {case}"] == pytest.approx(0.5 * (rows[1]["dtw_mm"] + rows[2]["dtw_mm"]))
    assert figures["steps lpvds/robust/none"] == 5.0
    assert "collided lpvds/robust/none" not in figures
    assert f"sea_mm2 {case}" not in figures
