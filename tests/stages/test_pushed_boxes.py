"""Boxes carried in the simulated world while an arm is pushed, a pot is in the way, or something cannot go on.

Two ways. One climbs from its pedestal and comes down onto the shelf beside it: what is delivered. One leads straight
away into the air: what is not meant to arrive. Roll-outs last a few simulated seconds, and tests share them.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import linear

from pipeline.errors import DataError, ParameterError
from pipeline.stage import StageContext
from pipeline.values import plain
from stages.artifacts.carry_log import write_carry_log
from stages.artifacts.channels import Flags, Poses, Words
from stages.artifacts.log import read_details as log_details
from stages.artifacts.log import read_log
from stages.artifacts.rollouts import read_rollouts, read_scenes, write_rollouts
from stages.dynamics.lpvds import LpvDs
from stages.evaluate.force import grip
from stages.evaluate.pushed import pushed
from stages.mixture.gaussian import GaussianMixture
from stages.policy.avoidance.parameters import Avoidance, NoAvoidance
from stages.policy.carrying import HELD, Phase, tilt
from stages.policy.estimation import FIRM, GRAVITY, RAISE
from stages.policy.mutual import LEFT, NOBODY, RIGHT
from stages.policy.outcome import Outcome, Status
from stages.policy.parameters import FollowingParameters
from stages.rollout import carry as carrying_out
from stages.rollout import carry_guard, physics
from stages.rollout.carry import PHASES, STATUSES, Carried, CarryTask, carry
from stages.rollout.carry_conditions import coupling_of, task_of
from stages.rollout.carry_scenes import NO_POTS, PotScene, draw_pots, scene_of
from stages.rollout.parameters import ArmDisturbance, CarryCondition, CarryParameters, Drag, Flowerpot, Force
from stages.rollout.physics import CarryRollout, simulate
from stages.trajectory import Array, Trajectory
from stages.world.following import Follower
from stages.world.parameters import Scene

DT = 0.004
AWAY = 0.005
"""Metres beyond which the pads' midpoint is away from p_hat."""

START, GOAL = (0.50, -0.03, 0.35), (0.52, 0.03, 0.35)
ON_A_SHELF = Scene(mass=0.3, start=START, goal=GOAL)
IN_THE_AIR = Scene(mass=0.3, box=(0.12, 0.24, 0.12), start=(0.5, 0.0, 0.35), goal=(0.5, 0.3, 0.07))
"""Its shelf is beside the way: where boxes are led to there is nothing below."""
FAST = 0.3
"""m/s: of the demonstrations, at most."""

FOLLOWING = FollowingParameters()
AVERTED = (0.03, 0.02, 0.04)
"""Metres."""
RISE, HOLD = 0.3, 0.3

PLAIN = CarryCondition()
CARRY = PHASES.index(Phase.CARRY)


def climbing(rate: float = 2.0) -> LpvDs:
    """A way that begins at 45 degrees upwards and ends from above: z follows y."""
    matrix = -rate * np.eye(3)
    matrix[2, 1] = -rate
    mixture = GaussianMixture(weights=np.ones(1), means=np.zeros((1, 3)), covariances=np.eye(3)[None])
    return LpvDs(mixture=mixture, matrices=matrix[None], goal=np.array(GOAL), lyapunov_matrix=np.eye(3))


def parameters(scene: Scene = ON_A_SHELF, **changes: Any) -> CarryParameters:
    """Pads begin 5 mm beside the box; every cycle is recorded."""
    return CarryParameters(**({"scene": scene, "stand_off": 0.005, "max_duration": 12.0, "record": 250.0} | changes))


def drag(arm: str = "left", offset: tuple[float, float, float] = AVERTED, **changes: Any) -> Drag:
    return Drag(**({"arm": arm, "offset": offset, "rise": RISE, "hold": HOLD} | changes))


def condition(*disturbances: ArmDisturbance, **changes: Any) -> CarryCondition:
    return CarryCondition(disturbances=disturbances, **changes)


def rollout(
    how: CarryCondition = PLAIN,
    given: CarryParameters | None = None,
    model: LpvDs | None = None,
    pots: PotScene = NO_POTS,
    seed: int = 0,
) -> CarryRollout:
    """One box, carried; wherever the scene's own goal is, it is led to the model's."""
    given, model = given or parameters(), model or climbing()
    task = task_of(given, how, given.scene, model, FAST, np.random.default_rng(seed), pots)
    done = carry(task, np.random.default_rng(seed))
    return physics._rollout(how, 0, task, done, given, [demonstration()], pots.refused)


def demonstration(start: Sequence[float] = START, goal: Sequence[float] = GOAL, **changes: Any) -> Trajectory:
    time, way = np.arange(50) / 50.0, np.subtract(goal, start)
    return Trajectory(
        dataset="made",
        demo="1",
        split="train",
        time=time,
        position=np.array(start) + np.outer(time, way),
        velocity=np.tile(way, (50, 1)),
        **changes,
    )


def steps(places: Array) -> Array:
    """How far places, shape (n, ..., 3), metres, are from those of the sample before, shape (n - 1, ...), metres."""
    return np.asarray(np.linalg.norm(np.diff(places, axis=0), axis=-1))


def strayed(done: Carried) -> Array:
    """How far the pads' midpoint is from p_hat, shape (n,), metres."""
    return np.asarray(np.linalg.norm(done.pads.mean(axis=1) - done.p_hat, axis=1))


# --- one arm is pushed ----------------------------------------------------------------------------------------------

PUSHES: dict[str, tuple[int, ArmDisturbance]] = {
    "left-dragged": (LEFT, drag()),
    "right-dragged": (RIGHT, drag("right", (-0.02, -0.03, 0.03))),
    "left-forced": (LEFT, Force(arm="left", force=(0.0, 15.0, 15.0), duration=0.5)),
    "right-forced": (RIGHT, Force(arm="right", force=(0.0, 0.0, 20.0), duration=0.5)),
}


@functools.cache
def pushed_by(name: str) -> CarryRollout:
    return rollout(condition(PUSHES[name][1], name=name))


@pytest.fixture(scope="module")
def undisturbed() -> Carried:
    return rollout().carried


def test_where_nobody_pushes_nobody_is_named_and_the_gate_stays_open(undisturbed: Carried) -> None:
    assert undisturbed.outcome is Outcome.ARRIVED
    assert set(undisturbed.named) == {NOBODY}
    assert undisturbed.gate.all()
    assert not undisturbed.acting.any()
    assert undisturbed.residual.max() < FOLLOWING.deviation_threshold
    assert (undisturbed.x == undisturbed.p_hat).all()
    assert {STATUSES[code] for code in undisturbed.status} == {Status.FREE}


@pytest.mark.parametrize("name", PUSHES)
def test_a_pushed_box_is_delivered_and_the_arm_that_is_pushed_is_named(name: str) -> None:
    arm, asked = PUSHES[name]
    one = pushed_by(name)
    done = one.carried
    assert done.outcome is Outcome.ARRIVED
    assert np.linalg.norm(done.box[-1] - GOAL) < 0.005
    assert float(tilt(done.turn).max()) < 3.0
    assert done.contact[done.phase == CARRY].min() > 1.0  # both pads, all the way
    # Who truly is pushed, for as long as asked.
    assert done.acting[:, arm].sum() * DT == pytest.approx(
        RISE + HOLD if isinstance(asked, Drag) else 0.5, abs=1.1 * DT
    )
    assert not done.acting[:, 1 - arm].any()
    # Who is taken for it: the same one, soon after it began, until it is back, and nobody before and after.
    named = done.named != NOBODY
    assert set(done.named[named]) == {arm}
    ((first, last),) = itertools.pairwise(np.flatnonzero(np.diff(named)) + 1)
    began, ended = np.flatnonzero(done.acting[:, arm])[[0, -1]]
    assert began < first < began + 0.15 / DT
    assert ended < last < ended + 1.5 / DT
    # A threshold is what it takes, and a millimetre that the arms are off by anyhow is not counted.
    assert done.residual[:first, arm].max() <= FOLLOWING.deviation_threshold
    assert done.residual[first, arm] > 0.5 * FOLLOWING.deviation_threshold


@pytest.mark.parametrize("name", PUSHES)
def test_x_waits_until_the_box_is_back(name: str) -> None:
    """Eq. (12): x does not move while the midpoint of the pads is away from p_hat, or p_hat from it."""
    done = pushed_by(name).carried
    away = (done.phase == CARRY) & ((strayed(done) > AWAY) | (np.linalg.norm(done.p_hat - done.x, axis=1) > 0.0))
    assert strayed(done)[done.phase == CARRY].max() > 2.0 * AWAY
    assert not done.gate[away].any()
    closed = np.flatnonzero(~done.gate)
    assert (np.diff(closed) == 1).all()  # once
    assert steps(done.x)[closed].max() == 0.0  # the gate of a sample is that of the step that follows
    assert done.named[closed].max() >= 0
    # When it goes on, the box is where it would be if nobody had pushed.
    begins = np.flatnonzero(done.phase == CARRY)[0]
    beside = done.box - done.x
    opened = closed[-1] + 1
    assert np.linalg.norm(beside[opened] - beside[begins]) < AWAY
    assert np.linalg.norm(done.p_hat[opened] - done.x[opened]) < 1e-3
    assert float(done.residual[opened].max()) <= FOLLOWING.gate + 0.0005


@pytest.mark.parametrize("name", PUSHES)
def test_what_is_commanded_never_jumps(name: str) -> None:
    """Not when an arm is named, nor when it is not any more; with every cycle recorded.

    An arm goes at most as fast as the policy and its own admittance ask for, or as the arm that it follows, and at a
    switch as what is blended out: no more than the threshold, in `blend` seconds.
    """
    arm, asked = PUSHES[name]
    done = pushed_by(name).carried
    led = done.phase[1:] == CARRY
    commanded = steps(done.commanded)[led]
    undisturbed = DT * FAST  # faster than the way ever is
    blended = DT * FOLLOWING.deviation_threshold / FOLLOWING.blend
    followed = float(steps(done.pads)[led, arm].max())
    if isinstance(asked, Drag):
        # A minimum-jerk step is at most 1.875 times as fast as it is on average; the arm lags, and makes up for it.
        assert followed <= 1.2 * DT * 1.875 * float(np.linalg.norm(asked.offset)) / asked.rise
    assert commanded[:, arm].max() <= undisturbed
    assert commanded[:, 1 - arm].max() <= followed + blended
    assert commanded.max() < 0.004
    switches = np.flatnonzero(np.diff(done.named)) + 1
    assert switches.shape == (2,)
    for k in switches:
        # What is handed over at the switch itself, against the cycles beside it.
        assert steps(done.commanded)[k - 1].max() <= blended + float(steps(done.commanded)[[k - 2, k]].max())
    assert steps(done.p_hat).max() <= undisturbed


def test_the_other_arm_goes_along() -> None:
    """Eq. (14): both pads stay L apart, wherever the pushed one is led."""
    done = pushed_by("left-dragged").carried
    pushed_away = (done.named == LEFT) & done.acting[:, LEFT]
    apart = (done.pads[:, LEFT] - done.pads[:, RIGHT])[pushed_away]
    assert apart[:, 1] == pytest.approx(ON_A_SHELF.box[1], abs=0.005)
    assert np.linalg.norm(apart[-1][[0, 2]]) < 0.003  # when it is held
    began = np.flatnonzero(done.acting[:, LEFT])[0]
    moved = done.pads[pushed_away][-1] - done.pads[began]
    assert moved == pytest.approx(np.array([AVERTED, AVERTED]), abs=0.005)


def test_the_same_push_gives_the_same_bytes() -> None:
    one, two = pushed_by("left-dragged").carried, rollout(condition(PUSHES["left-dragged"][1])).carried
    for field in fields(Carried):
        here, there = getattr(one, field.name), getattr(two, field.name)
        assert here.tobytes() == there.tobytes() if isinstance(here, np.ndarray) else here == there, field.name


def test_metrics_of_a_push(tmp_path: Path) -> None:
    one = pushed_by("left-dragged")
    write_rollouts(tmp_path / "one.parquet", [one], [], np.array(GOAL), {})
    ((read,), _) = read_rollouts(tmp_path / "one.parquet")
    assert read.carry is not None
    found = pushed(read.carry, read.x, read.gate)
    assert (found.pushed, found.named) == ("left", "left")
    assert found.moved_while_away_mm is not None
    assert found.moved_while_away_mm < 0.1
    assert found.box_back_mm is not None
    assert found.box_back_mm < 5.0
    assert found.deviation_max_mm is not None
    ((first, last),) = read.disturbed
    assert (first, last) == tuple(np.flatnonzero(one.carried.acting[:, LEFT])[[0, -1]])
    # Away from where the way was when this began, as far as it was dragged, and the way had gone on until it waited.
    gone_on = float(np.linalg.norm(one.x[last] - one.x[first]))
    asked = float(np.linalg.norm(AVERTED))
    assert abs(found.deviation_max_mm - 1e3 * asked) <= 1e3 * gone_on + 2.0
    assert read.carry.facts["pushes"] == [
        {"arm": "left", "offset": list(AVERTED), "force": [0.0] * 3, "rise": RISE, "hold": HOLD}
    ]


# --- without what the paper adds ------------------------------------------------------------------------------------


def test_without_following_nobody_is_named_and_the_other_arm_stays() -> None:
    done = rollout(condition(drag(), following=False)).carried
    assert set(done.named) == {NOBODY}
    assert not done.gate[(done.phase == CARRY) & (strayed(done) > AWAY)].any()  # x waits all the same
    held = np.flatnonzero(done.acting[:, LEFT])[[0, -1]]
    moved = np.abs(done.pads[held[1], RIGHT] - done.pads[held[0], RIGHT])
    # Across the clamp axis it is where it was; along it, it goes where it presses.
    assert moved[[0, 2]].max() < 0.01
    there = pushed_by("left-dragged").carried
    assert tilt(done.turn).max() > 3.0 * tilt(there.turn).max()
    assert done.contact.max() > 1.5 * there.contact.max()


def test_without_coupling_x_is_where_p_hat_is() -> None:
    """The plain LPV-DS: pushed away, it goes on from there."""
    done = rollout(condition(drag(), coupling=False)).carried
    assert (done.x == done.p_hat).all()
    assert done.gate.all()
    assert done.outcome is Outcome.ARRIVED
    acting, coupled = done.acting[:, LEFT], pushed_by("left-dragged").carried
    ended = np.flatnonzero(acting)[-1]
    assert np.linalg.norm(done.x[ended] - done.x[np.flatnonzero(acting)[0]]) > 0.02
    # It never comes back to where it was: nearer to the goal, and sooner there.
    assert done.time[-1] < coupled.time[-1] - 0.5


PATIENCE = 2.0
"""Seconds for which x waits in roll-outs that wait in vain: they cost less than with ten."""


def impatiently(*given: Any) -> CarryRollout:
    """A roll-out in which x waits for `PATIENCE` at most; arguments as of `rollout`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(carry_guard, "PATIENCE", PATIENCE)
        return rollout(*given)


@functools.cache
def printed() -> CarryRollout:
    return impatiently(condition(drag(), mode="paper"), parameters(record=50.0))


def test_as_printed_nobody_leads_the_arms_back() -> None:
    """Eq. (14) as printed: each follows the other one; x waits for ever, until the arms stop."""
    done = printed().carried
    assert done.outcome is Outcome.HELD
    assert set(done.named) == {NOBODY}  # it does not ask
    released = np.flatnonzero(done.acting[:, LEFT])[-1]
    after = slice(released, None)
    assert strayed(done)[after].min() > 0.03
    assert not done.gate[after].any()
    assert (done.x[after] == done.x[released]).all()
    assert (done.p_hat[after] == done.p_hat[released]).all()
    # Each pad is commanded to where the other one is, L away along the clamp axis.
    apart = (done.pads[:, LEFT] - done.pads[:, RIGHT])[released + 10 :]
    assert np.abs(apart - [0.0, ON_A_SHELF.box[1], 0.0]).max() < 0.01
    waited = done.time[done.phase == PHASES.index(Phase.STOPPED)][0] - done.time[np.flatnonzero(done.gate)[-1]]
    assert waited == pytest.approx(PATIENCE, abs=0.05)


# --- what cannot go on ----------------------------------------------------------------------------------------------

AIR = parameters(IN_THE_AIR, record=50.0)
LENIENT = parameters(IN_THE_AIR, record=50.0, following=FollowingParameters(deviation_threshold=0.05, gate=0.03))
"""x does not wait before an arm is missed by 3 cm."""


def led_to(*goal: float, rate: float = 0.7) -> LpvDs:
    return linear(np.array(goal), rate)


STIFF = {"following": False, "compliance": False}
FAULTS: dict[str, tuple[Outcome, Phase, Any]] = {
    "lost": (Outcome.LOST_BOX, Phase.LOST, lambda: rollout(condition(drag(), **STIFF), parameters(record=50.0))),
    "dropped": (
        Outcome.DROPPED,
        Phase.LOST,
        lambda: rollout(condition(drag(offset=(0.0, 0.1, 0.0), at_fraction=0.8), **STIFF), AIR, led_to(0.65, 0.0, 0.5)),
    ),
    "slipped": (  # 2 mu F_d/(m g) = 0.92
        Outcome.DROPPED,
        Phase.LOST,
        lambda: rollout(PLAIN, replace(AIR, scene=replace(IN_THE_AIR, mass=1.0, friction=0.9)), led_to(0.65, 0.0, 0.5)),
    ),
    "joint-limit": (
        Outcome.JOINT_LIMIT,
        Phase.STOPPED,
        lambda: rollout(PLAIN, LENIENT, led_to(0.0, 0.0, 0.6, rate=0.4)),
    ),
    "singular": (Outcome.SINGULAR, Phase.STOPPED, lambda: rollout(PLAIN, LENIENT, led_to(0.5, 0.5, 0.5, rate=0.6))),
    "out-of-reach": (
        Outcome.OUT_OF_REACH,
        Phase.STOPPED,
        lambda: rollout(
            condition(drag(offset=(-0.3, 0.0, 0.1), rise=1.0, hold=3.0, at_time=0.8)), AIR, led_to(0.55, 0.0, 0.5)
        ),
    ),
    "held": (
        Outcome.HELD,
        Phase.STOPPED,
        lambda: impatiently(condition(drag(hold=4.0, at_time=0.3)), AIR, led_to(0.55, 0.0, 0.5)),
    ),
    "printed": (Outcome.HELD, Phase.STOPPED, printed),
}


@functools.cache
def fault(name: str) -> CarryRollout:
    found: CarryRollout = FAULTS[name][2]()
    return found


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_has_its_name_and_the_arms_stop(name: str) -> None:
    outcome, phase, _ = FAULTS[name]
    done = fault(name).carried
    assert done.outcome is outcome
    assert outcome.remedy
    assert PHASES[done.phase[-1]] is phase
    passed = list(dict.fromkeys(PHASES[code] for code in done.phase))
    assert passed == [Phase.APPROACH, Phase.GRIP, Phase.CARRY, phase]
    # It is recorded on for 0.8 s, in which the arms come to rest, and nothing more is commanded.
    stopped = np.flatnonzero(done.phase == PHASES.index(phase))
    assert done.time[-1] - done.time[stopped[0]] == pytest.approx(carrying_out.AFTER, abs=0.025)
    assert (done.commanded[stopped] == done.commanded[-1]).all()
    assert (done.x[stopped] == done.x[-1]).all()
    last = done.time >= done.time[-1] - 0.1
    assert np.abs(done.qdot[last]).max() < 0.01
    assert np.linalg.norm(done.pads[last] - done.pads[-1], axis=-1).max() < 5e-4


@pytest.mark.parametrize("name", ["dropped", "held"])
def test_nobody_is_said_to_push_arms_that_stand_still(name: str) -> None:
    """A push ends with the roll-out's last command: no arm is dragged on, and no force acts."""
    done = fault(name).carried
    stopped = np.flatnonzero(done.phase == PHASES.index(FAULTS[name][1]))
    assert not done.acting[stopped[2:]].any()


def test_who_is_at_fault() -> None:
    """What outcomes mean, from what was recorded."""
    lost, dropped, slipped = (fault(name).carried for name in ("lost", "dropped", "slipped"))
    assert lost.box[-1, 2] > ON_A_SHELF.goal[2] - 0.05  # it stands where it was
    for done in (dropped, slipped):
        assert done.box[-1, 2] < IN_THE_AIR.goal[2] - 0.05
        assert not done.contact[-1].any()
    held, away = fault("held").carried, fault("out-of-reach").carried
    assert (held.named[-1], away.named[-1]) == (LEFT, LEFT)
    assert held.acting[held.phase == CARRY][-1].tolist() == [True, False]
    assert held.contact[-1].min() > 1.0  # and the box is still between the pads
    for name in ("joint-limit", "singular"):
        one = fault(name).carried
        assert not one.acting.any()
        missed = np.linalg.norm(one.commanded[-1] - one.pads[-1], axis=1)
        assert missed.max() > carry_guard.UNREACHED


@pytest.mark.parametrize(("name", "outcome"), [("joint-limit", Outcome.JOINT_LIMIT), ("singular", Outcome.SINGULAR)])
def test_a_way_that_an_arm_cannot_follow_is_named_with_the_usual_gate(name: str, outcome: Outcome) -> None:
    goal, rate = ((0.0, 0.0, 0.6), 0.4) if name == "joint-limit" else ((0.5, 0.5, 0.5), 0.6)
    assert impatiently(PLAIN, AIR, led_to(*goal, rate=rate)).outcome is outcome  # and not `held`: nobody holds it


def test_a_heavy_box_that_comes_to_stand_early_is_not_held_for_ever() -> None:
    """It creeps by some millimetres, comes down on its shelf before the way's end, and nobody has pushed."""
    given = parameters(replace(ON_A_SHELF, mass=0.9), record=50.0, least_friction=0.7)
    assert impatiently(PLAIN, given).outcome is Outcome.ARRIVED


def test_the_table_of_what_failed_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "rollouts.parquet"
    every = [replace(fault(name), rollout=name) for name in FAULTS]
    write_rollouts(path, every, [], np.array(GOAL), {})
    rows, _ = read_rollouts(path)
    assert [row.rollout for row in rows] == list(FAULTS)
    for row, one in zip(rows, every, strict=True):
        done = one.carried
        assert row.outcome == str(done.outcome)
        assert row.carry is not None
        for name in ("pads", "box", "turn", "force", "contact", "desired", "residual"):
            assert np.array_equal(getattr(row.carry, name), getattr(done, name))
        for name in ("time", "x", "p_hat", "gate"):
            assert np.array_equal(getattr(row, name), getattr(done, name))
        assert row.carry.phase.tolist() == [str(PHASES[code]) for code in done.phase]
        assert row.carry.named.tolist() == [("", "left", "right")[code + 1] for code in done.named]
        assert np.array_equal(row.carry.pushed, done.acting)
        assert row.carry.facts == one.scene_facts
        found = grip(row.carry, row.outcome)
        assert not found.delivered
        assert found.dropped or done.outcome is not Outcome.DROPPED
        assert pushed(row.carry, row.x, row.gate).moved_while_away_mm is not None


@pytest.mark.parametrize("name", FAULTS)
def test_the_log_of_what_failed_is_complete(name: str, tmp_path: Path) -> None:
    one, path = fault(name), tmp_path / "one.mcap"
    done = one.carried
    write_carry_log(path, one, "iiwa", plain(parameters()))
    log = read_log(path)
    for topic, kind, wanted in (
        ("/box/pose", Poses, done.box),
        ("/left/pose", Poses, done.pads[:, LEFT]),
        ("/right/commanded", Poses, done.commanded[:, RIGHT]),
        ("/policy/x", Poses, done.x),
    ):
        found: Any = log[topic]
        assert isinstance(found, kind)
        assert found.time == pytest.approx(done.time, abs=1e-9)
        assert found.position == pytest.approx(wanted, abs=1e-12)
    acting, phases = log["/truth/left_pushed"], log["/phase"]
    assert isinstance(acting, Flags)
    assert acting.values.tolist() == done.acting[:, LEFT].tolist()
    assert isinstance(phases, Words)
    assert phases.values[-1] == str(FAULTS[name][1])
    details = log_details(path)
    assert details["outcome"] == str(done.outcome)
    assert details["facts"] == one.scene_facts


# --- pots in the way ------------------------------------------------------------------------------------------------

POT = Flowerpot(centre=(0.57, 0.0, 0.36), radius=0.17, height=0.16, width=0.08)
"""Its sphere holds every place of the box's middle at which box and pot touch upright: 0.163 m."""
ROUND = Scene(mass=0.3, box=(0.12, 0.24, 0.12), start=(0.42, 0.0, 0.26), goal=(0.70, 0.0, 0.07))
BEHIND = (0.70, 0.0, 0.50)
AMONG = parameters(ROUND, record=50.0, max_duration=7.0)


def scene_with(*asked: Flowerpot, goal: Sequence[float] = BEHIND, longest: float = 7.0, seed: int = 0) -> PotScene:
    return scene_of(
        asked,
        np.random.default_rng(seed),
        ROUND,
        linear(np.array(goal), 0.7),
        coupling_of(AMONG, FAST),
        top_speed=FAST,
        dt=DT,
        longest=longest,
        location="rollout.conditions.0.obstacles",
    )


def among(pot: Flowerpot, avoidance: Avoidance | None = None) -> CarryRollout:
    how = CarryCondition(obstacles=(pot,), avoidance=avoidance)
    return rollout(how, AMONG, linear(np.array(BEHIND), 0.7), scene_with(pot))


MOVING = replace(POT, centre=(0.64, 0.0, 0.31), velocity=(-0.02, 0.0, 0.01))


@pytest.mark.parametrize("pot", [POT, MOVING], ids=["standing", "moving"])
def test_a_box_is_led_round_a_pot(pot: Flowerpot) -> None:
    one = among(pot)
    done = one.carried
    led = done.phase == CARRY
    assert np.linalg.norm(done.box[-1] - BEHIND) < 0.01
    # Its middle never enters the sphere, wherever that is by then, and it never touches the pot; nor do the arms.
    # A pot stands until the box is carried; when that was is known to a sample.
    since = np.maximum(done.time - done.time[led][0], 0.0)
    centres = np.array(pot.centre) + np.outer(since, pot.velocity or (0.0, 0.0, 0.0))
    middles = np.linalg.norm(done.box - centres, axis=1) - pot.radius
    assert middles.min() == pytest.approx(done.clearance.min(), abs=1e-3)
    assert 0.0 < done.clearance.min() < 0.01
    assert (done.box_contacts, done.arm_contacts) == (0, 0)
    assert min(done.box_room.min(), done.arm_room.min()) > 0.005
    # The sphere holds box and pot: the middle is farther out than they are apart, by no more than both are large.
    assert (done.box_room <= done.clearance + pot.radius).all()
    assert {STATUSES[code] for code in done.status[led]} == {Status.FREE, Status.ACTIVE}
    assert float(tilt(done.turn).max()) < 2.0
    assert one.scene_facts["pots"] == [
        {"centre": list(pot.centre), "height": pot.height, "width": pot.width, "radius": pot.radius}
    ]


@pytest.mark.parametrize("pot", [POT, MOVING], ids=["standing", "moving"])
def test_without_avoidance_a_box_runs_into_it(pot: Flowerpot) -> None:
    """Else nothing would have been in the way."""
    one = among(pot, NoAvoidance())
    done = one.carried
    assert one.avoidance == "none"
    assert done.clearance.min() < -0.05
    assert done.box_contacts > 10
    assert done.box_room.min() <= 0.0
    assert one.scene_facts["box_contacts"] == done.box_contacts


def test_safety_spheres_are_kept_beside_the_rows(tmp_path: Path) -> None:
    scene = scene_with(MOVING)
    kept = physics.safety_of("pots/0", scene)
    write_rollouts(tmp_path / "one.parquet", [pushed_by("left-dragged")], [kept], np.array(GOAL), {})
    (read,) = read_scenes(tmp_path / "one.parquet").values()
    assert read.shapes.centres.tolist() == [list(MOVING.centre)]
    assert read.shapes.velocities.tolist() == [list(MOVING.velocity or ())]
    assert scene.radii == (0.17,)


REFUSED: dict[str, tuple[Flowerpot, dict[str, Any], str]] = {
    "on-the-start": (replace(POT, centre=(0.45, 0.0, 0.28)), {}, "The start lies inside of an obstacle"),
    "on-the-goal": (replace(POT, centre=(0.68, 0.0, 0.52)), {}, "The goal lies inside of an obstacle"),
    "out-of-reach": (
        POT,
        {"goal": (0.90, 0.0, 0.60), "longest": 12.0},
        "the right arm cannot follow the policy's way round at [0.7",
    ),
    "too-long": (POT, {"longest": 3.0}, "the policy's way round does not end at the goal in time."),
    "as-wide-as-the-arms": (
        replace(POT, width=0.4),
        {},
        "an arm would touch the pot on the policy's way round, at [0.4",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_pot_that_leaves_no_way_is_refused_with_the_reason(name: str) -> None:
    pot, changes, says = REFUSED[name]
    with pytest.raises(ParameterError) as refused:
        scene_with(pot, **changes)
    assert refused.value.location == "rollout.conditions.0.obstacles"
    assert refused.value.problem.startswith(f"leaves no way: {says}")


def test_pots_that_never_leave_a_way_are_given_up() -> None:
    with pytest.raises(ParameterError, match=r"leaves no way, the last of 200 draws: The start lies inside of"):
        scene_with(replace(POT, centre=(0.45, 0.0, 0.28), spread=0.01))


DRAWN = replace(POT, spread=0.06, radius_spread=0.01)


def test_draws_that_leave_no_way_are_counted() -> None:
    counts = []
    for seed in range(3):
        scene, generator = scene_with(DRAWN, seed=seed), np.random.default_rng(seed)
        draws = (draw_pots([DRAWN], generator)[0] for _ in range(scene.refused + 1))
        *refused, taken = (replace(pot, spread=0.0, radius_spread=0.0) for pot in draws)
        assert scene.pots[0].centre == taken.centre
        assert scene.radii == (taken.radius,)
        assert bool(scene.why) == bool(refused)
        for one in refused:
            with pytest.raises(ParameterError):
                scene_with(one)
        assert scene_with(taken).refused == 0
        counts.append(scene.refused)
    assert 0 in counts
    assert max(counts) > 0


@pytest.fixture
def nothing(monkeypatch: pytest.MonkeyPatch, undisturbed: Carried) -> list[CarryTask]:
    """Let every box be carried as `undisturbed`; what was asked for."""
    asked: list[CarryTask] = []

    def carry_nothing(task: CarryTask, generator: np.random.Generator) -> Carried:
        asked.append(task)
        return undisturbed

    monkeypatch.setattr(physics, "carry", carry_nothing)
    return asked


def simulated(given: CarryParameters, model: LpvDs, start: Trajectory, seed: int = 0) -> Any:
    context = StageContext(stage="rollout", parameters=given, inputs={}, sources={}, outputs={}, seed=seed)
    return simulate(model, [start], given, FAST, context.generator)


def with_pots(*conditions: CarryCondition, count: int = 1) -> Any:
    given = replace(AMONG, scene=replace(ROUND, goal=BEHIND), conditions=conditions, count=count)
    return simulated(given, linear(np.array(BEHIND), 0.7), demonstration(ROUND.start, BEHIND))


def test_pots_are_the_same_under_all_conditions_and_differ_between_boxes(nothing: list[CarryTask]) -> None:
    avoids = CarryCondition(name="avoids", obstacles=(DRAWN,))
    runs_in = CarryCondition(name="runs-in", obstacles=(DRAWN,), avoidance=NoAvoidance())
    free = CarryCondition(name="free")
    done = with_pots(avoids, free, runs_in, count=3)
    first, none, last = nothing[:3], nothing[3:6], nothing[6:]
    for here, there in zip(first, last, strict=True):
        assert (here.pots, here.radii, here.obstacles) == (there.pots, there.radii, there.obstacles)
    assert len({task.pots[0].centre for task in first}) == len({task.radii for task in first}) == 3
    assert [task.avoidance for task in last] == [NoAvoidance()] * 3
    assert not any(task.pots or task.obstacles or task.avoidance for task in none)
    # The same again for the same seed, whatever else there is.
    nothing.clear()
    with_pots(runs_in, count=2)
    assert [task.pots for task in nothing] == [task.pots for task in first[:2]]
    # And each roll-out says which, and how many draws were refused before.
    said = [one.scene_facts for one in done.rollouts]
    assert [one.scene for one in done.rollouts] == [f"avoids/{k}" for k in range(3)] + [""] * 3 + [
        f"runs-in/{k}" for k in range(3)
    ]
    assert [len(facts["pots"]) for facts in said] == [1, 1, 1, 0, 0, 0, 1, 1, 1]
    assert [facts["refused"] for facts in said[:3]] == [facts["refused"] for facts in said[6:]]
    assert [facts["refused"] for facts in said[3:6]] == [0, 0, 0]
    assert [scene.name for scene in done.scenes] == [one.scene for one in done.rollouts if one.scene]


ON_THE_START = CarryCondition(name="bad", obstacles=(replace(POT, centre=(0.45, 0.0, 0.28)),))


def test_a_pot_on_the_start_is_refused_before_anything_runs(nothing: list[CarryTask]) -> None:
    with pytest.raises(ParameterError, match="The start lies inside of an obstacle") as refused:
        with_pots(ON_THE_START)
    assert refused.value.location == "rollout.conditions.0.obstacles"
    assert not nothing


def test_pots_of_a_later_condition_are_refused_before_anything_runs(nothing: list[CarryTask]) -> None:
    with pytest.raises(ParameterError, match="The start lies inside of an obstacle") as refused:
        with_pots(CarryCondition(name="good"), ON_THE_START)
    assert refused.value.location == "rollout.conditions.1.obstacles"
    assert not nothing


# --- what is found out about the box --------------------------------------------------------------------------------


@pytest.mark.parametrize("compliance", [True, False])
@pytest.mark.parametrize("wrong", [-0.01, 0.01])
def test_a_wrong_length_is_found(wrong: float, compliance: bool) -> None:
    scene = replace(ON_A_SHELF, length_error=wrong)
    how = CarryCondition(compliance=compliance, finds_length=True)
    one = rollout(how, parameters(scene, stand_off=0.02, record=50.0))
    done = one.carried
    assert done.outcome is Outcome.ARRIVED
    assert done.length == pytest.approx(0.30, abs=0.002)
    assert one.scene_facts["length_found"] == done.length
    # Where it is taken over, nothing moves: pads stand where they pressed.
    grips = np.flatnonzero(done.phase == CARRY)[0]
    assert np.linalg.norm(done.commanded[grips] - done.commanded[grips - 1], axis=1).max() < 0.02 * FAST + 1e-3
    assert done.contact[done.phase == CARRY].min() > 1.0


def test_a_length_that_is_not_found_out_stays_wrong() -> None:
    scene = replace(ON_A_SHELF, length_error=0.01)
    done = rollout(CarryCondition(finds_length=False), parameters(scene, record=50.0, max_duration=2.0)).carried
    assert done.length == pytest.approx(0.31, abs=1e-12)


@functools.cache
def weighed(mass: float, least_friction: float | None = None) -> Carried:
    given = parameters(replace(ON_A_SHELF, mass=mass), record=50.0, least_friction=least_friction)
    return rollout(PLAIN, given, climbing(rate=1.0)).carried


@pytest.mark.parametrize(("mass", "least_friction"), [(0.3, 0.7), (0.7, 0.7), (0.8, None)])
def test_the_mass_is_found_and_a_heavy_box_is_pressed_harder(mass: float, least_friction: float | None) -> None:
    done = weighed(mass, least_friction)
    assert done.outcome is Outcome.ARRIVED
    assert done.mass == pytest.approx(mass, rel=0.05)
    force = FIRM * done.mass * GRAVITY / (2.0 * 0.7) if least_friction else 0.0
    assert done.desired[-1] == pytest.approx(max(force, 5.0), rel=1e-9)
    if force <= 5.0:
        assert (done.desired == 5.0).all()
        return
    # It rises slowly, and what is pressed follows.
    assert force == pytest.approx(8.3, abs=0.3)
    assert np.diff(done.desired).min() >= 0.0
    assert (np.diff(done.desired) <= RAISE * np.diff(done.time) * (1.0 + 1e-9)).all()
    late = (done.phase == CARRY) & (done.desired == done.desired[-1])
    assert done.contact[late].mean() == pytest.approx(force, rel=0.03)


@pytest.mark.parametrize(("error", "fed"), [(0.0, 0.5 * 0.3 * GRAVITY), (-0.3, 0.0), (0.2, 0.5 * 0.5 * GRAVITY)])
def test_without_finding_it_out_the_believed_mass_is_fed_forward(
    error: float, fed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[Array] = []

    class Listening(Follower):
        def follow(self, pads: Array, velocities: Array, load: Array) -> None:
            heard.append(np.array(load))
            super().follow(pads, velocities, load)

    monkeypatch.setattr(carrying_out, "Follower", Listening)
    how = CarryCondition(finds_mass=False, mass_error=error)
    done = rollout(how, parameters(max_duration=2.5)).carried
    held = np.isin(done.phase[1:], [PHASES.index(phase) for phase in HELD])
    loads = np.array(heard)[: held.size]
    assert held.sum() > 100
    assert loads[held] == pytest.approx(fed, rel=1e-12)
    assert not loads[~held].any()


def test_what_is_fed_forward_carries_the_box() -> None:
    """Pads sag by what the wrists are not told of: 0.3 kg by some millimetres."""

    def sagging(how: CarryCondition) -> float:
        done = rollout(how, parameters(record=50.0, max_duration=2.5)).carried
        return float((done.commanded - done.pads)[done.phase == CARRY][-1, :, 2].mean())

    told, felt, untold = (
        sagging(how)
        for how in (
            CarryCondition(finds_mass=False),
            CarryCondition(),
            CarryCondition(finds_mass=False, mass_error=-0.3),
        )
    )
    assert untold > max(told, felt) + 0.0005
    assert abs(told - felt) < 0.5 * (untold - felt)


def test_length_of_the_demonstrations(nothing: list[CarryTask]) -> None:
    """The mean distance of the arms in them, errors added."""
    apart = [demonstration(separation=0.29), demonstration(separation=0.30)]
    conditions = (
        CarryCondition(name="taken", length="demonstrations"),
        CarryCondition(name="wrong", length="demonstrations", length_error=0.002),
        CarryCondition(name="known"),
    )
    given = parameters(conditions=conditions, count=1)
    context = StageContext(stage="rollout", parameters=given, inputs={}, sources={}, outputs={}, seed=0)
    simulate(climbing(), apart, given, FAST, context.generator)
    assert [task.clamp.length for task in nothing] == pytest.approx([0.295, 0.297, 0.30], abs=1e-12)


def test_demonstrations_of_one_point_have_no_length(nothing: list[CarryTask]) -> None:
    given = parameters(conditions=(CarryCondition(length="demonstrations"),), count=1)
    with pytest.raises(DataError, match="the demonstrations are of one point") as refused:
        simulated(given, climbing(), demonstration())
    assert "two arms" in str(refused.value)
    assert not nothing
