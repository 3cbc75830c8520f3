"""Boxes carried in the simulated world along a linear system's way: outcomes, forces, the same numbers every time.

The system climbs as it starts and comes down onto the goal: xdot = -(x - goal), and z follows y. Few roll-outs are
simulated, and shared; what needs none is tested with a `carry` that carries nothing.
"""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_trees import placed
from pytransform3d.urdf import UrdfTransformManager
from support import CHECKOUT

from pipeline.errors import DataError, ParameterError
from pipeline.stage import StageContext
from pipeline.values import plain
from stages.artifacts.carry_log import write_carry_log
from stages.artifacts.channels import JointStates, Poses, Words
from stages.artifacts.log import read_log
from stages.artifacts.parquet import records
from stages.artifacts.rollouts import read_rollouts, write_rollouts
from stages.dynamics.lpvds import LpvDs
from stages.evaluate.force import grip
from stages.ingest.parameters import RecordingParameters, Source
from stages.ingest.recordings import read_recordings
from stages.mixture.gaussian import GaussianMixture
from stages.policy.admittance import settled_force
from stages.policy.carrying import Phase, tilt
from stages.policy.outcome import Outcome
from stages.rollout import carry_conditions, physics
from stages.rollout.carry import PHASES, Carried, CarryTask, carry
from stages.rollout.carry_conditions import check, clamp_of, task_of
from stages.rollout.parameters import CarryCondition, CarryParameters
from stages.rollout.physics import CarryRollout, notices, simulate
from stages.rollout.results import Simulated
from stages.trajectory import Array, Trajectory
from stages.world.boxes import grip_ratio
from stages.world.parameters import Scene, Variation

START, GOAL = (0.50, -0.03, 0.35), (0.52, 0.03, 0.35)
TOP_SPEED = 0.1
VARIED = Variation(mass=0.05, friction=0.1, start=0.01, centre_of_mass=0.005, bias=0.1)


def climbing(goal: tuple[float, ...] = GOAL) -> LpvDs:
    """A certified system whose way from START begins at 45 degrees upwards and ends from above."""
    d = len(goal)
    matrix = -np.eye(d)
    if d == 3:
        matrix[2, 1] = -1.0
    mixture = GaussianMixture(weights=np.ones(1), means=np.zeros((1, d)), covariances=np.eye(d)[None])
    return LpvDs(mixture=mixture, matrices=matrix[None], goal=np.array(goal), lyapunov_matrix=np.eye(d))


def demonstration(demo: str = "1", start: tuple[float, ...] = START, split: str = "train") -> Trajectory:
    time, way = np.arange(50) / 50.0, np.array(GOAL) - start
    return Trajectory(
        dataset="made",
        demo=demo,
        split=split,
        time=time,
        position=np.array(start) + np.outer(time, way),
        velocity=np.tile(way, (50, 1)),
    )


def parameters(scene: Mapping[str, Any] | None = None, **changes: Any) -> CarryParameters:
    """One box of 0.3 kg, pads that begin 2 cm beside it."""
    world = Scene(**({"mass": 0.3, "start": START, "goal": GOAL} | dict(scene or {})))
    return CarryParameters(**({"scene": world, "count": 1, "stand_off": 0.02} | changes))


def run(given: CarryParameters, seed: int = 0, **options: Any) -> Simulated:
    context = StageContext(stage="rollout", parameters=given, inputs={}, sources={}, outputs={}, seed=seed)
    return simulate(climbing(), [demonstration()], given, TOP_SPEED, context.generator, **options)


NOISY = parameters({"variation": VARIED})


@pytest.fixture(scope="module")
def held() -> CarryRollout:
    """A box that varies, forces with noise and bias."""
    (found,) = run(NOISY).rollouts
    assert isinstance(found, CarryRollout)
    return found


def carrying(one: CarryRollout) -> Any:
    """Samples in which the box is carried."""
    return one.carried.phase == PHASES.index(Phase.CARRY)


# --- one box --------------------------------------------------------------------------------------------------------


def test_a_box_is_delivered(held: CarryRollout) -> None:
    assert held.outcome is Outcome.ARRIVED
    assert np.linalg.norm(held.carried.box[-1] - GOAL) < 0.005
    assert float(tilt(held.carried.turn).max()) < 3.0
    # It left its pedestal, at least as far as the way leads: z of (t exp(-t)) 0.06 is at most 0.022 above the start.
    climb = held.carried.box[:, 2] - START[2]
    assert 0.015 < climb.max() < 0.025
    assert held.carried.phase[0] == PHASES.index(Phase.APPROACH)
    assert held.carried.phase[-1] == PHASES.index(Phase.DONE)
    assert (np.diff(held.carried.phase) >= 0).all()


def test_it_is_pressed_with_five_newtons(held: CarryRollout) -> None:
    contact = held.carried.contact[carrying(held)]
    bias = float(np.mean(held.scene_facts["bias"]))
    assert contact.mean() == pytest.approx(5.0 - bias, abs=0.05)
    assert np.percentile(contact, [5, 95]) == pytest.approx([5.0, 5.0], abs=0.4)
    assert held.carried.force[carrying(held)].mean() == pytest.approx(5.0, abs=0.05)  # what the sensors say


def test_samples_are_on_a_clock_and_arrays_cannot_be_written(held: CarryRollout) -> None:
    arms, n = held.carried, held.time.shape[0]
    assert np.diff(held.time)[:-1] == pytest.approx(0.02)  # and the end, whenever it is
    shapes = {"x": (3,), "p_hat": (3,), "q": (2, 7), "qdot": (2, 7), "pads": (2, 3), "commanded": (2, 3)}
    shapes |= {"box": (3,), "turn": (4,), "force": (2,), "contact": (2,), "time": ()}
    shapes |= {"desired": (), "residual": (2,)}
    for name, shape in shapes.items():
        array = getattr(arms, name)
        assert array.shape == (n, *shape)
        assert np.isfinite(array).all()
        assert not array.flags.writeable
    assert np.linalg.norm(arms.turn, axis=1) == pytest.approx(1.0)


def test_pads_are_beside_p_hat(held: CarryRollout) -> None:
    """Eq. (13): across the clamp axis both are where p_hat is; along it they press from both sides."""
    arms, carried = held.carried, carrying(held)
    led = arms.phase <= list(Phase).index(Phase.CARRY)  # afterwards pads go on down, and p_hat is at the goal
    beside = np.stack([arms.p_hat[:, [0, 2]]] * 2, axis=1)
    assert arms.commanded[led][:, :, [0, 2]] == pytest.approx(beside[led], abs=1e-12)
    assert (arms.p_hat[~led] == arms.p_hat[-1]).all()
    assert (arms.commanded[~led][:, :, 2] <= beside[~led][:, :, 1] + 1e-12).all()
    assert np.linalg.norm(arms.pads[carried] - arms.commanded[carried], axis=2).max() < 0.01
    apart = arms.pads[carried, 0, 1] - arms.pads[carried, 1, 1]
    assert apart == pytest.approx(0.30, abs=0.005)
    # Nothing moves before the box is held.
    waiting = arms.phase < PHASES.index(Phase.CARRY)
    assert (arms.p_hat[waiting] == arms.p_hat[0]).all()


def test_the_lyapunov_function_of_the_way_never_rises(held: CarryRollout) -> None:
    """(x - goal)'(x - goal) of the recorded states."""
    assert held.lyapunov == pytest.approx(((held.x - GOAL) ** 2).sum(axis=1))
    assert np.diff(held.lyapunov).max() <= 0.0
    assert np.linalg.norm(held.p_hat[held.carried.phase == PHASES.index(Phase.CARRY)][-1] - GOAL) < 0.005


def test_it_says_what_it_was(held: CarryRollout) -> None:
    assert held.rollout == "clpvds-robust/compliant/0"
    assert (held.controller, held.mode, held.avoidance, held.condition) == ("clpvds", "robust", "none", "compliant")
    assert (held.dataset, held.demo, held.split, held.scene, held.disturbed) == ("made", "1", "train", "", ())
    for room in (held.clearance, held.carried.box_room, held.carried.arm_room):
        assert np.isinf(room).all()  # there is no pot
    facts = held.scene_facts
    assert (facts["compliance"], facts["following"], facts["coupling"]) == (True, True, True)
    assert (facts["pushes"], facts["pots"], facts["refused"]) == ([], [], 0)
    assert (facts["box_contacts"], facts["arm_contacts"]) == (0, 0)
    assert (facts["length_found"], facts["mass_found"]) == (held.carried.length, held.carried.mass)
    assert 0.25 <= facts["mass"] <= 0.35
    assert facts["mass"] != 0.3
    assert facts["start"][2] == START[2]
    assert facts["start"] == pytest.approx(held.carried.p_hat[0].tolist())
    assert facts["grip_ratio"] == pytest.approx(2 * facts["friction"] * 5.0 / (facts["mass"] * 9.81))


def test_it_goes_through_the_table_of_roll_outs_to_its_metrics(held: CarryRollout, tmp_path: Path) -> None:
    path = tmp_path / "rollouts.parquet"
    write_rollouts(path, [held, replace(held, rollout="clpvds-robust/compliant/1")], [], np.array(GOAL), {})
    (one, two), goal = read_rollouts(path)
    assert goal.tolist() == list(GOAL)
    assert two.rollout == "clpvds-robust/compliant/1"
    for read in (one, two):
        assert read.carry is not None
        for name in ("pads", "box", "turn", "force", "contact", "desired", "residual"):
            assert np.array_equal(getattr(read.carry, name), getattr(held.carried, name))
        assert read.carry.phase.tolist() == [str(PHASES[code]) for code in held.carried.phase]
        assert set(read.carry.named) == {""}
        assert not read.carry.pushed.any()
        assert np.isnan([read.carry.box_room, read.carry.arm_room]).all()
        assert read.carry.facts == held.scene_facts
        assert np.array_equal(read.executed, held.carried.pads.mean(axis=1))
        assert np.array_equal(read.p_hat, held.p_hat)
    assert one.carry is not None
    found = grip(one.carry, one.outcome)
    assert found.delivered
    assert not found.dropped
    assert found.band_fraction == 1.0
    assert found.slip_max_mm is not None
    assert found.slip_max_mm < 3.0


# --- the same numbers every time ------------------------------------------------------------------------------------


def log_digest(one: CarryRollout, path: Path) -> str:
    write_carry_log(path, one, NOISY.scene.robot, plain(NOISY))
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_log_places_the_pads_where_they_were(held: CarryRollout, tmp_path: Path) -> None:
    """By its own joints and description, by the chain of its frames, and as `clpv ingest` reads it."""
    path = tmp_path / "held.mcap"
    log_digest(held, path)
    log, arms = read_log(path), held.carried
    trees, joints = [log["/tf_static"], log["/tf"]], log["/joint_states"]
    assert isinstance(joints, JointStates)
    text = log["/robot_description"]
    assert isinstance(text, Words)
    known = UrdfTransformManager()
    known.load_urdf(text.values[0])
    for k in (0, held.time.size // 2, held.time.size - 1):
        for name, angle in zip(joints.names, joints.position[k], strict=True):
            known.set_joint(name, float(angle))
        places = placed(trees, k)
        for side, name in enumerate(("left", "right")):
            assert known.get_transform(f"{name}_pad", "world")[:3, 3] == pytest.approx(arms.pads[k, side], abs=1e-9)
            assert places[f"{name}_pad"][:3, 3] == pytest.approx(arms.pads[k, side], abs=1e-9)
    given = RecordingParameters(
        sources=(Source(files=("held.mcap",)),),
        left="/left/pose",
        right="/right/pose",
        left_wrench="/left/wrench",
        right_wrench="/right/wrench",
        trim=False,
    )
    (found,) = read_recordings([[path]], given)[0]
    for side, name in enumerate(("left", "right")):
        arm, pose = found.arms[name], log[f"/{name}/pose"]
        assert isinstance(pose, Poses)
        assert arm.time == pytest.approx(held.time, abs=1e-9)
        assert arm.position == pytest.approx(arms.pads[:, side], abs=1e-9)
        assert arm.quaternion == pytest.approx(pose.quaternion, abs=1e-9)
        assert arm.force is not None
        assert arm.force[:, 2] == pytest.approx(arms.force[:, side], abs=1e-9)


def test_the_same_seed_gives_the_same_log_in_two_processes(held: CarryRollout, tmp_path: Path) -> None:
    text = (
        "from pathlib import Path\nimport test_physics as t\n"
        f"print(t.log_digest(t.run(t.NOISY).rollouts[0], Path({str(tmp_path / 'theirs.mcap')!r})))"
    )
    paths = os.pathsep.join(map(str, (CHECKOUT, CHECKOUT / "tests", CHECKOUT / "tests" / "stages")))
    done = subprocess.run(
        [sys.executable, "-c", text],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == log_digest(held, tmp_path / "ours.mcap")


# --- how it can end -------------------------------------------------------------------------------------------------


def test_the_printed_law_settles_below(held: CarryRollout) -> None:
    """F_d k_p/(k_p + 1): 4.81 N for 5."""
    assert settled_force(5.0, 25.0) == pytest.approx(4.8077, abs=1e-4)
    (one,) = run(parameters({"noise": 0.0}, mode="paper")).rollouts
    assert one.rollout == "clpvds-paper/compliant/0"
    assert one.outcome is Outcome.ARRIVED
    # Well before the box comes down on the shelf.
    settled = one.carried.force[carrying(one)][-150:-50]
    assert settled == pytest.approx(settled_force(5.0, 25.0), abs=0.02)
    assert one.carried.contact[carrying(one)][-150:-50].mean() == pytest.approx(settled_force(5.0, 25.0), abs=0.05)


def carried_to(scene: Scene, given: CarryParameters, condition: CarryCondition) -> Carried:
    """`carry` itself, of a box that is taken to GOAL, wherever the scene's goal is."""
    task = task_of(given, condition, scene, climbing(), TOP_SPEED, np.random.default_rng(0))
    return carry(task, np.random.default_rng(0))


STIFF = CarryCondition(name="stiff", compliance=False)


def test_a_box_that_stands_elsewhere_is_misplaced() -> None:
    """And pads that do not comply press as deep as they are told: 2 mm."""
    scene = replace(parameters().scene, goal=(0.52, 0.06, 0.35))
    found = carried_to(scene, parameters(), STIFF)
    assert found.outcome is Outcome.MISPLACED
    assert np.linalg.norm(found.box[-1] - GOAL) < 0.005
    beside = 0.5 * (found.commanded[:, 0, 1] - found.commanded[:, 1, 1])[found.phase == PHASES.index(Phase.CARRY)]
    assert beside == pytest.approx(0.15 - 0.002, abs=3e-4)  # and at most the step of a cycle deeper


@pytest.mark.parametrize(
    ("error", "condition", "outcome", "ended"),
    [
        # Pads end 3 mm off the faces; the right one shoves the box.
        (0.01, replace(STIFF, finds_length=False), Outcome.LOST_BOX, Phase.LOST),
        (0.10, CarryCondition(), Outcome.NOT_GRIPPED, Phase.MISSED),  # they look 4 cm deep, no farther
    ],
)
def test_a_box_that_is_shorter_than_the_controller_thinks(
    error: float, condition: CarryCondition, outcome: Outcome, ended: Phase
) -> None:
    found = carried_to(replace(parameters().scene, length_error=error), parameters(), condition)
    assert found.outcome is outcome
    assert found.phase[-1] == PHASES.index(ended)
    assert not found.contact[:, 0].any()
    assert not found.contact[found.phase < PHASES.index(Phase.CARRY)].any()
    standing = found.box[found.phase < PHASES.index(Phase.CARRY)]
    assert standing == pytest.approx(np.tile(START, (standing.shape[0], 1)), abs=1e-3)


def test_time_that_is_over() -> None:
    found = carried_to(parameters().scene, parameters(max_duration=0.2), CarryCondition())
    assert found.outcome is Outcome.TIMEOUT
    assert found.time[-1] == pytest.approx(0.2)
    assert set(found.phase) == {PHASES.index(Phase.APPROACH)}
    # 5 cm/s from 2 cm beside the faces.
    beside = found.commanded[:, 0, 1] - found.p_hat[:, 1]
    assert beside == pytest.approx(0.17 - 0.05 * found.time, abs=1e-12)


@pytest.mark.parametrize(("axis", "degrees"), [("x", 25.0), ("y", -40.0), ("z", 90.0)])
def test_tilt_by_hand(axis: str, degrees: float) -> None:
    half = math.radians(degrees) / 2.0
    turn = np.array([math.sin(half) * (axis == name) for name in "xyz"] + [math.cos(half)])
    assert float(tilt(turn)) == pytest.approx(0.0 if axis == "z" else abs(degrees), abs=1e-5)


# --- cases, carried by nothing --------------------------------------------------------------------------------------


@pytest.fixture
def nothing(monkeypatch: pytest.MonkeyPatch, held: CarryRollout) -> list[tuple[Scene, Any, Array]]:
    """Let every box be carried as `held`; what was asked for: scene, clamp, the first of the sensors' noise."""
    asked: list[tuple[Scene, Any, Array]] = []

    def carry_nothing(task: CarryTask, generator: np.random.Generator) -> Carried:
        asked.append((task.scene, task.clamp, generator.normal(size=3)))
        return held.carried

    monkeypatch.setattr(physics, "carry", carry_nothing)
    monkeypatch.setattr(carry_conditions, "check_scene", lambda *given: None)
    return asked


CONDITIONS = (CarryCondition(), STIFF, CarryCondition(name="unsure", length_error=-0.002, length_spread=0.004))


def same(a: Scene, b: Scene) -> bool:
    """Whether two boxes differ by their length errors at most."""
    return replace(a, length_error=0.0) == replace(b, length_error=0.0)


def test_conditions_share_their_boxes(nothing: list[Any]) -> None:
    told: list[tuple[int, int]] = []
    given = parameters({"variation": VARIED}, count=3, conditions=CONDITIONS)
    done = run(given, progress=lambda *numbers: told.append(numbers))
    names = [f"clpvds-robust/{c}/{k}" for c in ("compliant", "stiff", "unsure") for k in range(3)]
    assert [r.rollout for r in done.rollouts] == names
    assert told == [(k, 9) for k in range(1, 10)]
    scenes = [scene for scene, _, _ in nothing]
    for number in range(3):
        assert same(scenes[number], scenes[3 + number])
        assert same(scenes[number], scenes[6 + number])
    assert len({scene.mass for scene in scenes}) == 3
    errors = [scene.length_error for scene in scenes]
    assert errors[:6] == [0.0] * 6
    assert len(set(errors[6:])) == 3
    assert all(-0.006 <= error <= 0.002 for error in errors[6:])
    # Each roll-out has noise of its own.
    assert len({float(noise[0]) for _, _, noise in nothing}) == 9


def test_a_box_depends_on_the_seed_and_its_number_only(nothing: list[Any]) -> None:
    def boxes(seed: int = 0, **changes: Any) -> list[Scene]:
        nothing.clear()
        run(parameters({"variation": VARIED}, **changes), seed)
        return [scene for scene, _, _ in nothing]

    first = boxes(count=3)
    assert boxes(count=3) == first
    assert boxes(count=2) == first[:2]
    assert boxes(count=3, conditions=CONDITIONS[1:2]) == first
    assert boxes(count=3, mode="paper") == first
    for other in (boxes(count=3, replicate=1), boxes(1, count=3)):
        assert all(not same(a, b) for a, b in zip(first, other, strict=True))


def test_how_a_box_is_held(nothing: list[Any]) -> None:
    run(parameters({"length_error": 0.001}, conditions=CONDITIONS[:2], squeeze=0.003, approach_speed=0.04))
    (_, soft, _), (_, hard, _) = nothing
    assert soft.length == hard.length == pytest.approx(0.301)
    assert (soft.squeeze, soft.stand_off, soft.approach_speed, soft.release_speed) == (0.003, 0.02, 0.04, 0.04)
    assert hard.admittance is None
    assert (soft.admittance.force, soft.admittance.k_p, soft.admittance.printed) == (5.0, 25.0, False)
    assert soft.admittance.leak == 2.0
    printed = clamp_of(parameters(mode="paper"), CarryCondition(), parameters().scene).admittance
    assert printed is not None
    assert (printed.printed, printed.leak) == (True, 0.0)


def test_a_roll_out_is_compared_with_the_demonstration_that_starts_nearest(nothing: list[Any]) -> None:
    starts = [demonstration("far", (0.4, -0.2, 0.35)), demonstration("near", (0.5, -0.04, 0.35), "test")]
    context = StageContext(stage="rollout", parameters=parameters(), inputs={}, sources={}, outputs={}, seed=0)
    (one,) = simulate(climbing(), starts, parameters(), TOP_SPEED, context.generator).rollouts
    assert (one.demo, one.split) == ("near", "test")


# --- what is said ---------------------------------------------------------------------------------------------------


def weak(one: CarryRollout, ratio: float) -> CarryRollout:
    return replace(one, scene_facts=one.scene_facts | {"grip_ratio": ratio})


def test_a_weak_grip_and_failures_are_said_once_each(held: CarryRollout) -> None:
    assert list(notices([weak(held, 1.7)])) == []
    lost = replace(held, rollout="b", outcome=Outcome.LOST_BOX)
    found = list(notices([held, weak(replace(held, rollout="a"), 1.69), lost, replace(lost, rollout="c")]))
    assert found == [
        "1 roll-outs have a box with 2 mu F_d/(m g) below 1.7, the first a: it may creep; raise admittance.force.",
        f"2 roll-outs ended lost-box, the first b. {Outcome.LOST_BOX.remedy}",
    ]


def test_notices_come_with_the_roll_outs(nothing: list[Any]) -> None:
    done = run(parameters({"mass": 0.8}))
    assert grip_ratio(parameters({"mass": 0.8}).scene, 5.0) == pytest.approx(1.274, abs=1e-3)
    (sentence,) = done.notices
    assert sentence.startswith("1 roll-outs have a box with 2 mu F_d/(m g) below 1.7, the first clpvds-robust/")
    assert run(parameters({"mass": 0.5})).notices == ()


# --- what is refused before anything runs ---------------------------------------------------------------------------


def named(*names: str) -> tuple[CarryCondition, ...]:
    return tuple(CarryCondition(name=name) for name in names)


@pytest.mark.parametrize(
    ("given", "location", "sentence"),
    [
        (parameters(dt=0.0035), "rollout.dt", "0.0035 s is no whole number of milliseconds."),
        (parameters(dt=0.0001), "rollout.dt", "0.0001 s is no whole number of milliseconds."),
        (
            parameters({"goal": (0.52, 0.06, 0.35)}),
            "rollout.scene.goal",
            "the demonstrations end 30 mm away from it, at [0.520, 0.030, 0.350] m.",
        ),
        (
            parameters(conditions=named("a", "b", "a")),
            "rollout.conditions.2.name",
            "'a' is the name of an earlier condition.",
        ),
        (
            parameters(conditions=named("a", "a/b")),
            "rollout.conditions.1.name",
            "'a/b' must be letters, digits, '_', '.', '+' or '-'.",
        ),
        (parameters(conditions=named("")), "rollout.conditions.0.name", "'' must be letters"),
        (parameters(conditions=()), "rollout.conditions", "must be at least one."),
        (
            parameters({"friction": 0.25}),
            "rollout.scene.mass",
            "0.3 kg slip out of two pads that press with 5 N at friction 0.25 (2 mu F_d = 2.5 N < m g = 2.94 N): at "
            "least 5.89 N are needed.",
        ),
        (parameters({"mass": 3.0}), "rollout.scene.mass", "3 kg slip out of two pads"),
        (parameters({"start": (0.5, -0.03, 0.1)}), "rollout.scene.start", "[0.5, -0.03, 0.1] puts the box into the"),
        (parameters({"start": (1.5, -0.03, 0.35)}), "rollout.scene", "the left arm cannot bring its pad to [1.5, "),
    ],
)
def test_what_cannot_work_is_refused(given: CarryParameters, location: str, sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        check(given, climbing(), [demonstration()])
    assert caught.value.location == location
    assert caught.value.problem.startswith(sentence)


def test_what_can_work_is_not_refused() -> None:
    near = parameters({"goal": (0.52, 0.034, 0.35)}, dt=0.001, conditions=CONDITIONS)
    check(near, climbing(), [demonstration()])


def test_a_motion_in_the_plane_carries_no_box() -> None:
    with pytest.raises(DataError, match=r"^dynamics: a box is carried in space; the learned system has 2 coordinates"):
        check(parameters(), climbing(GOAL[:2]), [demonstration()])


def test_no_demonstrations() -> None:
    with pytest.raises(DataError, match="there is no demonstration to compare with"):
        check(parameters(), climbing(), [])


def test_joints_and_what_was_commanded_are_in_the_table(held: CarryRollout, tmp_path: Path) -> None:
    path = tmp_path / "rollouts.parquet"
    write_rollouts(path, [held], [], np.array(GOAL), {})
    rows = records(path)
    assert len(rows) == held.time.shape[0]
    for row, q, qdot, commanded in zip(rows, held.carried.q, held.carried.qdot, held.carried.commanded, strict=True):
        assert (row["left_q"], row["right_q"]) == (q[0].tolist(), q[1].tolist())
        assert (row["left_qdot"], row["right_qdot"]) == (qdot[0].tolist(), qdot[1].tolist())
        assert (row["left_commanded"], row["right_commanded"]) == (commanded[0].tolist(), commanded[1].tolist())
