"""Disturbances of the executed state: what they do, when they come, what they leave untouched, what is refused."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import linear

from pipeline.errors import ParameterError
from pipeline.validation import validate_as
from stages.dynamics.lpvds import LpvDs
from stages.evaluate.compare import largest_rise
from stages.mixture.gaussian import GaussianMixture
from stages.paths import arc_length
from stages.policy.avoidance.parameters import NoAvoidance, RoasPlusParameters, Sphere
from stages.policy.avoidance.shapes import spheres
from stages.policy.coupled import energy
from stages.policy.outcome import Outcome
from stages.rollout.cases import MOST_STEPS
from stages.rollout.disturbances import begin, merged_spans, pushes_of, samples, spans_of
from stages.rollout.notices import notices
from stages.rollout.parameters import (
    ClpvdsController,
    Condition,
    Controller,
    Displacement,
    Disturbance,
    Held,
    LpvdsController,
    Noise,
    Ramp,
    RolloutParameters,
)
from stages.rollout.simulate import Rollout, Simulated, draw_from, simulate
from stages.trajectory import Trajectory
from stages.world.disturbance import (
    CALM,
    DRAG,
    DRAGGED,
    MOVED,
    NEVER,
    NOISE,
    ONCE,
    Pushes,
    disturb,
    last_sample,
    no_pushes,
    unpushed,
)
from stages.world.kinematic import carry_out, clearance_at, clearance_on_way, place

PLAIN = LpvdsController()
ROBUST = ClpvdsController(mode="robust")
PAPER = ClpvdsController(mode="paper")
TOLERANT = ClpvdsController(mode="robust", tolerance=0.01)
UP = (0.0, 0.02)
TOP_SPEED = 0.2
"""Of the straight way from 0.1 m at 2 1/s, m/s; the follower's is five times that: 1 cm in a step of 10 ms."""

seeds = st.integers(0, 2**32 - 1)


def line_model(rate: float = 2.0) -> LpvDs:
    """xdot = -rate x: straight to the goal at the origin."""
    return linear(np.zeros(2), rate)


def random_model(generator: np.random.Generator, d: int) -> LpvDs:
    """A certified system about the size of a LASA motion: symmetric parts negative definite, any skew part."""
    K = int(generator.integers(1, 8))
    roots = 0.02 * generator.normal(size=(K, d, d))
    halves, skew = generator.normal(size=(2, K, d, d))
    return LpvDs(
        mixture=GaussianMixture(
            weights=generator.dirichlet(np.full(K, 5.0)),
            means=0.05 * generator.normal(size=(K, d)),
            covariances=roots @ roots.transpose(0, 2, 1) + 1e-4 * np.eye(d),
        ),
        matrices=-(halves @ halves.transpose(0, 2, 1)) / d - 0.5 * np.eye(d) + 3.0 * (skew - skew.transpose(0, 2, 1)),
        goal=0.02 * generator.normal(size=d),
        lyapunov_matrix=np.eye(d),
    )


def start_at(position: Sequence[float], demo: str = "4", duration: float = 4.0) -> Trajectory:
    """A demonstration of which only the start and the clock of 10 ms matter."""
    n = round(100 * duration) + 1
    path = np.linspace(position, np.zeros(len(position)), n)
    return Trajectory(
        dataset="made",
        demo=demo,
        split="test",
        time=np.linspace(0.0, duration, n),
        position=path,
        velocity=0.0 * path,
    )


START = start_at((0.1, 0.0))


def run(
    controller: Controller,
    *disturbances: Disturbance,
    model: LpvDs | None = None,
    start: Trajectory = START,
    top_speed: float = TOP_SPEED,
    seed: int = 0,
    name: str = "pushed",
    **more: object,
) -> Rollout:
    """One roll-out, disturbed."""
    parameters = RolloutParameters(
        controllers=(controller,),
        conditions=(Condition(name=name, disturbances=disturbances),),
        max_duration=10.0,
        **more,  # type: ignore[arg-type]
    )
    model = line_model() if model is None else model
    (rollout,) = simulate(model, [start], parameters, top_speed, draw=draw_from(seed)).rollouts
    return rollout


def one_push(kind: int, d: int = 2) -> Pushes:
    """One disturbance of a kind that begins at sample 3, displaced by (1, -2, ...)."""
    pushes = no_pushes(d, 1)
    pushes.kinds[0], pushes.samples[0] = kind, 3
    pushes.offsets[0, :2] = [1.0, -2.0]
    return pushes


def played(pushes: Pushes, n: int = 10, steps: Callable[[int], int] = int) -> tuple[np.ndarray, np.ndarray]:
    """What disturbances make of a state that is commanded to (i, 0, ...) in sample i; and when any acted.

    `steps`: made undisturbed, by sample.
    """
    pushed, states, acted = unpushed(pushes), [], []
    for i in range(n):
        executed = np.zeros(pushes.offsets.shape[1])
        executed[0] = i
        acted.append(disturb(pushes, pushed, i, steps(i), executed))
        states.append(executed)
    return np.array(states), np.flatnonzero(acted)


# The world, by hand.


def test_once_displaces_one_sample() -> None:
    states, acted = played(one_push(ONCE))
    assert acted.tolist() == [3]
    expected = np.column_stack([np.arange(10.0), np.zeros(10)])
    expected[3] = [4.0, -2.0]
    assert (states == expected).all()
    assert last_sample(one_push(ONCE), 0, 3) == 3


def test_held_stays_where_it_was_displaced_whatever_is_commanded() -> None:
    pushes = one_push(DRAG)
    pushes.holds[0] = 4
    states, acted = played(pushes)
    assert acted.tolist() == [3, 4, 5, 6]
    assert (states[3:7] == [4.0, -2.0]).all()
    assert (states[7] == [7.0, 0.0]).all()
    assert last_sample(pushes, 0, 3) == 6


def test_a_ramp_drags_in_equal_steps_from_where_the_state_was() -> None:
    pushes = one_push(DRAG)
    pushes.rises[0], pushes.holds[0] = 4, 2
    states, acted = played(pushes)
    assert acted.tolist() == [3, 4, 5, 6, 7, 8]
    assert states[3:9].tolist() == [[3.0, 0.0], [3.25, -0.5], [3.5, -1.0], [3.75, -1.5], [4.0, -2.0], [4.0, -2.0]]
    assert (states[9] == [9.0, 0.0]).all()
    # Without a hold it is let go as soon as it has arrived there.
    pushes.holds[0] = 0
    assert played(pushes)[1].tolist() == [3, 4, 5, 6, 7]


def test_noise_displaces_every_sample_of_its_time_by_its_own() -> None:
    pushes = one_push(NOISE)
    pushes.holds[0] = 3
    pushes = pushes._replace(noise=np.array([[[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]]]))
    states, acted = played(pushes)
    assert acted.tolist() == [3, 4, 5]
    assert states[3:6] == pytest.approx(np.array([[3.1, 0.2], [4.3, 0.4], [5.5, 0.6]]), rel=1e-15)
    assert (states[6] == [6.0, 0.0]).all()


def test_a_number_of_steps_begins_where_they_were_made_and_stays_begun() -> None:
    pushes = one_push(ONCE)
    pushes.samples[0], pushes.steps[0] = -1, 3
    assert played(pushes, steps=lambda i: i // 2)[1].tolist() == [6]
    assert played(pushes, steps=lambda i: min(i, 2))[1].tolist() == []
    assert played(pushes, steps=lambda i: 3)[1].tolist() == [0]
    # A sample decides where there is one, however many steps were made.
    pushes.samples[0] = 4
    assert played(pushes, steps=lambda i: 0)[1].tolist() == [4]


def test_what_acts_is_told_apart() -> None:
    for kind, code in ((ONCE, MOVED), (NOISE, MOVED), (DRAG, DRAGGED)):
        pushes = one_push(kind)._replace(noise=np.zeros((1, 1, 2)))
        pushes.holds[0] = 1
        pushed, executed = unpushed(pushes), np.zeros(2)
        assert [disturb(pushes, pushed, i, i, executed) for i in (2, 3, 4)] == [CALM, code, CALM]


def test_disturbances_act_in_order() -> None:
    pushes = no_pushes(2, 2)
    pushes.kinds[:], pushes.samples[:], pushes.holds[:] = [DRAG, ONCE], [3, 4], [3, 0]
    pushes.offsets[:] = [[1.0, -2.0], [0.0, 10.0]]
    assert played(pushes)[0][3:7].tolist() == [[4.0, -2.0], [4.0, 8.0], [4.0, -2.0], [6.0, 0.0]]
    # The other way round the hold has the last word.
    other = pushes._replace(
        kinds=pushes.kinds[::-1].copy(),
        samples=pushes.samples[::-1].copy(),
        holds=pushes.holds[::-1].copy(),
        offsets=pushes.offsets[::-1].copy(),
    )
    assert played(other)[0][3:7].tolist() == [[4.0, -2.0], [4.0, -2.0], [4.0, -2.0], [6.0, 0.0]]


def test_room_for_disturbances_holds_none_that_come() -> None:
    assert played(no_pushes(3, 2))[1].tolist() == []
    assert played(no_pushes(2))[1].tolist() == []


def test_the_kinematic_world_does_what_is_commanded() -> None:
    executed, commanded = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    carry_out(executed, commanded)
    assert executed.tolist() == commanded.tolist() == [3.0, 4.0]
    executed[0] = 9.0
    assert commanded[0] == 3.0


def test_obstacles_move_from_where_they_were_at_the_start() -> None:
    centres = np.array([[0.5, 1.0], [2.0, -1.0]])
    shapes = spheres(centres, np.array([0.1, 0.2]), np.array([[1.0, -2.0], [0.0, 0.0]]))
    for time in (0.0, 0.25, 0.25, 3.0):  # not from where they were last
        place(shapes, centres, time)
        assert shapes.centres.tolist() == [[0.5 + time, 1.0 - 2.0 * time], [2.0, -1.0]]


def test_clearance_by_hand() -> None:
    shapes = spheres(np.array([[3.0, 4.0], [0.0, -2.0]]), np.array([1.0, 1.5]))
    scratch = np.empty(2)
    assert clearance_at(shapes, np.zeros(2), scratch) == pytest.approx(0.5, rel=1e-15)
    assert clearance_at(shapes, np.array([3.0, 3.5]), scratch) == pytest.approx(-0.5, rel=1e-15)
    assert clearance_at(spheres(np.empty((0, 2)), np.empty(0)), np.zeros(2), scratch) == math.inf


def test_clearance_on_the_way_by_hand() -> None:
    def least(shapes_: object, start: list[float], end: list[float], dt: float = 1.0) -> float:
        room = np.empty((3, 2))
        return float(clearance_on_way(shapes_, np.array(start), np.array(end), dt, *room))  # type: ignore[arg-type]

    # Passed in the middle of a step, far from both of its ends.
    standing = spheres(np.array([[0.0, 0.5]]), np.array([0.2]))
    assert least(standing, [-1.0, 0.0], [1.0, 0.0]) == pytest.approx(0.3, rel=1e-14)
    assert least(standing, [-1.0, 0.0], [-0.5, 0.0]) == pytest.approx(math.sqrt(0.5) - 0.2, rel=1e-14)
    # One that flies through a state that stands; in half of the time it does not get there.
    flying = spheres(np.array([[-1.0, 0.0]]), np.array([0.25]), np.array([[2.0, 0.0]]))
    assert least(flying, [0.0, 0.0], [0.0, 0.0]) == pytest.approx(-0.25, rel=1e-14)
    assert least(flying, [0.0, 0.0], [0.0, 0.0], 0.25) == pytest.approx(0.25, rel=1e-14)
    # Side by side at one speed: the distance stays.
    along = spheres(np.array([[0.0, 1.0]]), np.array([0.25]), np.array([[2.0, 0.0]]))
    assert least(along, [0.0, 0.0], [2.0, 0.0]) == pytest.approx(0.75, rel=1e-14)


# When they come.


def test_samples_of_a_duration_are_rounded_up() -> None:
    assert [samples(t, 0.01) for t in (0.0, 0.3, 0.295, 0.1 + 0.2, 1e-6)] == [0, 30, 30, 30, 1]
    assert samples(1e300, 0.01) == MOST_STEPS + 1


def test_where_a_disturbance_begins_by_hand() -> None:
    # Lengths 0, 1, 3, 6, 10.
    way = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0], [6.0, 0.0], [6.0, 4.0]])

    def at(**when: object) -> tuple[int, int]:
        return begin(Displacement(offset=UP, **when), way, 0.5)  # type: ignore[arg-type]

    assert at(at_time=1.2) == (3, 0)
    assert at(at_fraction=0.25) == (NEVER, 2)  # 2.5 of 10 are reached with the second step
    assert at(at_fraction=0.3) == (NEVER, 2)  # exactly there
    assert at() == (NEVER, 3)
    assert at(at_fraction=0.0) == (NEVER, 0)
    assert at(at_fraction=1.0) == (NEVER, 4)
    assert at(at_state=(3.2, -5.0)) == (NEVER, 2)


def test_disturbances_become_samples_and_steps_by_hand() -> None:
    way = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    listed: tuple[Disturbance, ...] = (
        Displacement(offset=(1.0, 2.0)),
        Held(offset=(3.0, 4.0), duration=0.7, at_time=1.0),
        Ramp(offset=(5.0, 6.0), rise=1.0, hold=0.5, at_time=0.0),
        Noise(std=0.1, duration=2.0, at_time=0.0),
        Noise(std=0.2, duration=100.0, at_time=0.0),
    )
    pushes = pushes_of(listed, way, 0.5, 6, lambda number: np.random.default_rng(int(number)))
    assert pushes.kinds.tolist() == [ONCE, DRAG, DRAG, NOISE, NOISE]
    assert pushes.samples.tolist() == [-1, 2, 0, 0, 0]
    assert pushes.steps[0] == 2  # 1.5 of 3
    assert pushes.offsets.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [0.0, 0.0], [0.0, 0.0]]
    assert pushes.rises.tolist() == [0, 0, 2, 0, 0]
    assert pushes.holds.tolist() == [0, 2, 1, 4, 7]  # noise lasts no longer than the roll-out: 6 steps, 7 samples
    assert (pushes.noise[3, :4] == 0.1 * np.random.default_rng(3).normal(size=(4, 2))).all()
    assert (pushes.noise[4] == 0.2 * np.random.default_rng(4).normal(size=(7, 2))).all()


def test_spans_that_overlap_or_touch_are_one() -> None:
    assert merged_spans([(3, 5), (0, 1), (6, 8), (20, 20)]) == ((0, 1), (3, 8), (20, 20))
    assert merged_spans([(0, 9), (2, 3), (9, 9), (11, 12)]) == ((0, 9), (11, 12))
    assert merged_spans([]) == ()


def test_spans_in_which_something_acts_by_hand() -> None:
    def spans(acting: str) -> tuple[tuple[int, int], ...]:
        return spans_of(np.array([one == "x" for one in acting], dtype=np.bool_))

    assert spans("..xxx.x..") == ((2, 4), (6, 6))
    assert spans("xx.....xx") == ((0, 1), (7, 8))  # from the first sample, and to the last
    assert spans("xxxx") == ((0, 3),)
    assert spans("x") == ((0, 0),)
    assert spans("....") == ()
    assert spans("") == ()


@given(st.lists(st.booleans(), max_size=40))
def test_spans_hold_what_acts_and_are_as_long_as_can_be(acting: list[bool]) -> None:
    spans = spans_of(np.array(acting, dtype=np.bool_))
    inside = [i for first, last in spans for i in range(first, last + 1)]
    assert inside == [i for i, acts in enumerate(acting) if acts]
    assert merged_spans(spans) == spans  # none touches the next


def test_spans_of_a_roll_out_are_merged() -> None:
    held = Held(offset=UP, duration=0.1, at_time=0.1)
    assert run(ROBUST, held, Displacement(offset=UP, at_time=0.15)).disturbed == ((10, 19),)
    assert run(ROBUST, held, Displacement(offset=UP, at_time=0.2)).disturbed == ((10, 20),)
    assert run(ROBUST, held, Displacement(offset=UP, at_time=0.21)).disturbed == ((10, 19), (21, 21))
    assert run(ROBUST).disturbed == ()


@pytest.mark.parametrize("controller", [PLAIN, ROBUST])
@pytest.mark.parametrize(
    "disturbance",
    [
        Displacement(offset=UP),
        Held(offset=UP, duration=0.1),
        Ramp(offset=UP, rise=0.1),
        Noise(std=0.001, duration=0.1),
    ],
    ids=lambda one: str(one.kind),
)
def test_when_each_kind_comes(controller: Controller, disturbance: Disturbance) -> None:
    free = run(controller)
    length = arc_length(np.asarray(free.p_hat))
    for when, expected in (
        ({}, int(np.argmax(length >= 0.5 * length[-1]))),
        ({"at_fraction": 0.25}, int(np.argmax(length >= 0.25 * length[-1]))),
        ({"at_fraction": 0.0}, 0),
        ({"at_fraction": 1.0}, len(length) - 1),
        ({"at_time": 0.3}, 30),
        ({"at_time": 0.295}, 30),
        ({"at_state": (0.03, -5.0)}, int(np.argmin(np.abs(free.p_hat[:, 0] - 0.03)))),
    ):
        rollout = run(controller, dataclasses.replace(disturbance, **when))
        assert rollout.displaced == expected
        assert (rollout.p_hat[:expected] == free.p_hat[:expected]).all()
        assert rollout.outcome is Outcome.ARRIVED


def test_among_obstacles_half_way_is_half_of_the_way_round_them() -> None:
    ball = Sphere(centre=(0.05, 0.002), radius=0.02)
    parameters = RolloutParameters(
        controllers=(ROBUST,),
        conditions=(
            Condition(name="free"),
            Condition(name="ball", obstacles=(ball,)),
            Condition(name="pushed", obstacles=(ball,), disturbances=(Displacement(offset=(0.0, -0.05)),)),
        ),
    )
    free, around, pushed = simulate(line_model(), [START], parameters, TOP_SPEED).rollouts
    length, straight = arc_length(np.asarray(around.p_hat)), arc_length(np.asarray(free.p_hat))
    assert pushed.displaced == int(np.argmax(length >= 0.5 * length[-1]))
    assert pushed.displaced != int(np.argmax(straight >= 0.5 * straight[-1]))
    assert (pushed.p_hat[: pushed.displaced] == around.p_hat[: pushed.displaced]).all()


LIST: tuple[Disturbance, ...] = (
    Displacement(offset=UP, at_fraction=0.2),
    Held(offset=(0.01, -0.03), duration=0.15, at_fraction=0.4),
    Noise(std=0.001, duration=0.2, at_fraction=0.6),
    Displacement(offset=(0.0, -0.04), at_fraction=0.8),
)


def test_several_in_a_row_come_where_each_would_on_the_undisturbed_path() -> None:
    free, rollout = run(ROBUST), run(ROBUST, *LIST)
    assert len(rollout.disturbed) == len(LIST)
    for one, (first, last) in zip(LIST, rollout.disturbed, strict=True):
        alone = run(ROBUST, one)
        assert (rollout.x[first] == free.x[alone.displaced]).all()
        assert last - first == alone.disturbed[0][1] - alone.disturbed[0][0]
    # In whatever order they are listed.
    backwards = run(ROBUST, *LIST[:2], LIST[3])
    assert (backwards.p_hat == run(ROBUST, LIST[3], LIST[1], LIST[0]).p_hat).all()


@pytest.mark.parametrize(
    ("controller", "first"),
    [
        pytest.param(
            ROBUST,
            Ramp(offset=UP, rise=0.2, hold=0.1, at_fraction=0.25),
            id="ramp",
        ),
        pytest.param(
            TOLERANT,
            Displacement(offset=UP, at_fraction=0.25),
            id="tolerance",
        ),
        pytest.param(
            TOLERANT,
            Noise(std=0.001, duration=0.2, at_fraction=0.25),
            id="noise with an open gate",
        ),
        pytest.param(
            PLAIN,
            Noise(std=0.001, duration=0.2, at_fraction=0.25),
            id="noise of the plain system",
        ),
    ],
)
def test_a_second_one_comes_where_it_would_on_the_undisturbed_path(controller: Controller, first: Disturbance) -> None:
    second = Displacement(offset=(0.0, -0.02), at_fraction=0.75)
    alone, rollout = run(controller, second), run(controller, first, second)
    assert len(rollout.disturbed) == 2
    at = rollout.disturbed[1][0]
    if controller is PLAIN:  # its x is shaken itself
        assert at == alone.displaced
    else:
        assert rollout.x[at, 0] == alone.x[alone.displaced, 0]


# What they do in a roll-out.


@pytest.mark.parametrize("controller", [PLAIN, ROBUST])
def test_a_held_state_by_hand(controller: Controller) -> None:
    free, rollout = run(controller), run(controller, Held(offset=UP, duration=0.25, at_time=0.2))
    assert rollout.disturbed == ((20, 44),)
    assert (rollout.p_hat[20:45] == free.p_hat[20] + UP).all()
    if controller is PLAIN:
        assert (rollout.x == rollout.p_hat).all()
        assert rollout.p_hat[45] == pytest.approx(0.99 / 1.01 * rollout.p_hat[44], rel=1e-12)
    else:
        # 2 cm at 1 cm a step: two steps, and x has waited from the first sample to the last of the way back.
        assert rollout.p_hat[45, 1] == pytest.approx(0.01, rel=1e-12)
        assert (rollout.x[20:47] == free.x[20]).all()
        assert rollout.gate[46]
        assert not rollout.gate[20:46].any()
        assert (rollout.x[46:] == free.x[20:]).all()
    assert rollout.outcome is Outcome.ARRIVED


def test_a_ramp_by_hand() -> None:
    free, rollout = run(ROBUST), run(ROBUST, Ramp(offset=UP, rise=0.04, hold=0.03, at_time=0.2))
    assert rollout.disturbed == ((20, 26),)
    share = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 1.0])
    assert rollout.p_hat[20:27] == pytest.approx(free.p_hat[20] + share[:, None] * UP, abs=1e-16)
    assert (rollout.x[21:29] == rollout.x[21]).all()
    assert rollout.gate[29]


def test_noise_is_drawn_by_name_and_the_same_for_all_controllers() -> None:
    noise = Noise(std=0.002, duration=0.3, at_time=0.2)
    drawn = 0.002 * draw_from(5)("noise", "pushed", START.name, "", "0").normal(size=(30, 2))
    coupled, plain = run(ROBUST, noise, seed=5), run(PLAIN, noise, seed=5)
    assert coupled.disturbed == plain.disturbed == ((20, 49),)
    # The follower comes back to x in every step: what is left is the noise of this sample.
    assert coupled.p_hat[20:50] - coupled.x[20:50] == pytest.approx(drawn, abs=1e-16)
    led = line_model().step(np.array(plain.p_hat[19:49]), 0.01)
    assert plain.p_hat[20:50] - led == pytest.approx(drawn, abs=1e-16)


def test_noise_is_reproducible_and_seeded() -> None:
    noise = Noise(std=0.002, duration=0.3, at_time=0.2)
    one = run(PLAIN, noise, seed=5)
    assert run(PLAIN, noise, seed=5).p_hat.tobytes() == one.p_hat.tobytes()
    others = [
        run(PLAIN, noise, seed=6),
        run(PLAIN, noise, seed=5, name="other"),
        run(PLAIN, noise, seed=5, start=start_at((0.1, 0.0), "5")),
    ]
    for other in others:
        assert (other.p_hat[:20] == one.p_hat[:20]).all()
        assert (other.p_hat[20:50] != one.p_hat[20:50]).any(axis=1).all()
    # Two of one condition are two.
    pair = run(ROBUST, noise, dataclasses.replace(noise, at_time=1.0), seed=5)
    shaken = pair.p_hat - pair.x
    assert (shaken[20:50] != shaken[100:130]).all()


def test_under_noise_an_exact_gate_waits_and_a_tolerance_lets_x_go_on() -> None:
    noise = Noise(std=0.001, duration=0.5, at_time=0.2)
    free, exact, tolerant = run(ROBUST), run(ROBUST, noise), run(TOLERANT, noise)
    assert not exact.gate[20:70].any()
    assert (exact.x[20:71] == free.x[20]).all()
    assert exact.gate[:20].all()
    assert exact.gate[70:].all()
    assert tolerant.gate.all()
    assert (tolerant.x == free.x).all()
    assert len(exact.time) == len(free.time) + 50
    # More than the tolerance closes the gate, with hysteresis, and it opens again.
    rough = run(TOLERANT, Noise(std=0.02, duration=0.5, at_time=0.2))
    gap = np.linalg.norm(rough.p_hat - rough.x, axis=1)
    was_open = np.concatenate([[True], rough.gate[:-1]])
    assert (rough.gate == np.where(was_open, gap <= 0.02, gap <= 0.01)).all()
    assert 0 < np.count_nonzero(~rough.gate) < 60
    assert rough.outcome is Outcome.ARRIVED


def test_a_small_obstacle_that_flies_through_between_two_samples_is_hit() -> None:
    # 2 m in each step: at every sample it is far away.
    ball = Sphere(centre=(0.08, -1.0), radius=0.02, velocity=(0.0, 200.0))
    parameters = RolloutParameters(
        controllers=(PLAIN,),
        conditions=(Condition(name="ball", obstacles=(ball,)),),
        avoidances=(NoAvoidance(),),
    )
    (rollout,) = simulate(line_model(), [START], parameters, TOP_SPEED).rollouts
    assert rollout.outcome is Outcome.COLLIDED
    assert len(rollout.time) == 2
    assert rollout.clearance[1] < 0.0


def test_a_displacement_may_jump_over_an_obstacle_and_not_into_it() -> None:
    ball = Sphere(centre=(0.05, 0.05), radius=0.02)

    def pushed(offset: tuple[float, float], *, recover: bool = False) -> Rollout:
        push = Displacement(offset=offset, at_state=(0.05, 0.0))
        parameters = RolloutParameters(
            controllers=(ROBUST,),
            conditions=(Condition(name="ball", obstacles=(ball,), disturbances=(push,)),),
            avoidances=(RoasPlusParameters(recover=recover),),
        )
        (rollout,) = simulate(line_model(), [START], parameters, TOP_SPEED).rollouts
        return rollout

    over = pushed((0.0, 0.09))
    assert over.outcome is Outcome.ARRIVED
    assert over.clearance.min() > 0.0
    into = pushed((0.0, 0.04))
    assert into.outcome is Outcome.COLLIDED
    assert len(into.time) == into.displaced + 1
    assert into.clearance[-1] == pytest.approx(-0.01, abs=1e-3)
    left = pushed((0.0, 0.04), recover=True)
    assert left.outcome is Outcome.ARRIVED
    # It gets no deeper, comes out, and stays out; the step that leads out begins inside.
    after = left.clearance[left.displaced :]
    outside = int(np.argmax(after >= 0.0))
    assert outside > 0
    assert (np.diff(after[: outside + 1]) >= 0.0).all()
    assert (after[outside:] >= -1e-9).all()


# What they leave untouched.


def some_disturbances(generator: np.random.Generator, d: int) -> tuple[Disturbance, ...]:
    """One to four of any kind, at any time."""

    def when() -> dict[str, object]:
        moments: list[dict[str, object]] = [
            {},
            {"at_fraction": float(generator.uniform())},
            {"at_time": float(generator.uniform(0.0, 2.0))},
            {"at_state": tuple(0.05 * generator.normal(size=d))},
        ]
        return moments[int(generator.integers(4))]

    chosen: list[Disturbance] = []
    for kind in generator.integers(4, size=int(generator.integers(1, 5))):
        offset = tuple(0.02 * generator.normal(size=d))
        short, long = (float(s) for s in generator.uniform(0.01, 0.5, size=2))
        if kind == 0:
            chosen.append(Displacement(offset=offset, **when()))  # type: ignore[arg-type]
        elif kind == 1:
            chosen.append(Held(offset=offset, duration=long, **when()))  # type: ignore[arg-type]
        elif kind == 2:
            chosen.append(Ramp(offset=offset, rise=short, hold=long, **when()))  # type: ignore[arg-type]
        else:
            chosen.append(Noise(std=0.1 * short, duration=long, **when()))  # type: ignore[arg-type]
    return tuple(chosen)


def random_case(seed: int, d: int) -> tuple[LpvDs, Trajectory, float, tuple[Disturbance, ...]]:
    """A system, a start, its own top speed, disturbances."""
    generator = np.random.default_rng(seed)
    model = random_model(generator, d)
    start = start_at(tuple(model.goal + 0.05 * generator.normal(size=d)))
    plain = run(PLAIN, model=model, start=start)
    speed = float(np.linalg.norm(np.diff(plain.x, axis=0), axis=1).max() / plain.time[1])
    return model, start, speed, some_disturbances(generator, d)


def distinct(x: np.ndarray) -> np.ndarray:
    """States without repetitions of the one before."""
    moved = (np.diff(x, axis=0) != 0.0).any(axis=1)
    return np.asarray(x[np.concatenate([[True], moved])])


@settings(max_examples=60)
@given(seeds, st.integers(2, 4))
def test_disturbances_do_not_touch_x_of_the_robust_system(seed: int, d: int) -> None:
    model, start, speed, disturbances = random_case(seed, d)
    free = run(ROBUST, model=model, start=start, top_speed=speed)
    rollout = run(ROBUST, *disturbances, model=model, start=start, top_speed=speed, seed=seed)
    assert free.outcome is rollout.outcome is Outcome.ARRIVED
    states = distinct(free.x)
    assert distinct(rollout.x).tobytes() == states.tobytes()
    # Wherever x moves the executed state is there, too: after every recovery it is on the undisturbed path.
    assert (rollout.p_hat[rollout.gate] == rollout.x[rollout.gate]).all()
    if rollout.disturbed:
        after = np.arange(len(rollout.gate)) > rollout.disturbed[-1][1]
        path = rollout.p_hat[after & rollout.gate]
        assert path == pytest.approx(free.p_hat[len(free.p_hat) - len(path) :], abs=1e-9)


@settings(max_examples=80)
@given(
    seeds,
    st.integers(2, 4),
    st.sampled_from([PLAIN, ROBUST, TOLERANT, PAPER]),
    st.sampled_from([0.002, 0.01, 0.1, 1.0]),
)
def test_v_of_x_never_rises_whatever_disturbs(seed: int, d: int, controller: Controller, dt: float) -> None:
    model, start, speed, disturbances = random_case(seed, d)
    rollout = run(controller, *disturbances, model=model, start=start, top_speed=speed, seed=seed, dt=dt)
    assert largest_rise(rollout.lyapunov, rollout.disturbed if controller is PLAIN else ()) == 0.0
    assert rollout.outcome is not Outcome.DIVERGED


@settings(max_examples=60)
@given(seeds, st.integers(2, 4), st.sampled_from([ROBUST, TOLERANT]), st.sampled_from([0.002, 0.01, 0.1, 1.0]))
def test_the_energy_of_the_robust_system_rises_only_where_something_disturbs(
    seed: int, d: int, controller: Controller, dt: float
) -> None:
    # Paper eq. (24), in every step that does not end in a span of a disturbance.
    model, start, speed, disturbances = random_case(seed, d)
    rollout = run(controller, *disturbances, model=model, start=start, top_speed=speed, seed=seed, dt=dt)
    V = energy(rollout.x, rollout.p_hat, np.asarray(model.goal))
    assert largest_rise(V, rollout.disturbed) == 0.0


# What is refused, and what is said.


def refused(*disturbances: Disturbance) -> ParameterError:
    parameters = RolloutParameters(conditions=(Condition(), Condition(name="pushed", disturbances=disturbances)))
    with pytest.raises(ParameterError) as error:
        simulate(line_model(), [START], parameters, TOP_SPEED)
    return error.value


@pytest.mark.parametrize(
    ("disturbance", "name", "says"),
    [
        (Held(offset=UP, duration=1.0, at_time=1.0, at_state=(0.0, 0.0)), "at_state", "give at_time or at_state"),
        (Ramp(offset=UP, rise=1.0, at_time=1.0, at_fraction=0.5), "at_time", "give at_fraction or at_time"),
        (Noise(std=1.0, duration=1.0, at_fraction=0.5, at_state=(0.0, 0.0)), "at_state", "not both"),
        (Displacement(offset=UP, at_time=1.0, at_fraction=0.5, at_state=(0.0, 0.0)), "at_time", "not both"),
        (Displacement(offset=UP, at_fraction=1.001), "at_fraction", "at most 1, not 1.001"),
        (Noise(std=0.1, duration=1.0, at_fraction=-0.1), "at_fraction", "0 or more, not -0.1"),
        (Held(offset=UP, duration=1.0, at_time=math.inf), "at_time", "finite"),
        (Held(offset=(0.1, 0.2, 0.3), duration=1.0), "offset", "3 coordinates, the motion has 2; metres"),
        (Ramp(offset=(0.1,), rise=1.0), "offset", "1 coordinates, the motion has 2; metres"),
        (Ramp(offset=(0.1, math.nan), rise=1.0), "offset", "finite; metres"),
        (Held(offset=(-math.inf, 0.1), duration=1.0), "offset", "finite; metres"),
        (Noise(std=0.1, duration=1.0, at_state=(0.0, 0.0, 0.0)), "at_state", "3 coordinates"),
        (Noise(std=0.1, duration=1.0, at_state=(0.0, math.nan)), "at_state", "finite; metres"),
        (Held(offset=UP, duration=-1.0), "duration", "0 or more, not -1"),
        (Noise(std=0.1, duration=math.nan), "duration", "0 or more, not nan"),
        (Noise(std=-0.1, duration=1.0), "std", "0 or more, not -0.1"),
        (Noise(std=math.inf, duration=1.0), "std", "0 or more, not inf"),
        (Ramp(offset=UP, rise=-0.5), "rise", "0 or more, not -0.5"),
        (Ramp(offset=UP, rise=0.5, hold=math.nan), "hold", "0 or more, not nan"),
    ],
)
def test_a_disturbance_without_meaning_is_refused(disturbance: Disturbance, name: str, says: str) -> None:
    error = refused(Displacement(offset=UP), disturbance)
    assert error.location == f"rollout.conditions.1.disturbances.1.{name}"
    assert says in error.problem


@pytest.mark.parametrize(
    ("table", "place_", "says"),
    [
        ({"offset": [0.0, 0.1], "at_fraction": 1.5}, "at_fraction", "less than or equal to 1, not 1.5"),
        ({"offset": [0.0, 0.1], "at_time": -1.0}, "at_time", "greater than or equal to 0, not -1.0"),
        ({"offset": [0.1]}, "offset", "at least 2 entries, not 1"),
        ({"kind": "held", "offset": [0.0, 0.1]}, "duration", "must be given"),
        ({"kind": "held", "offset": [0.0, 0.1], "duration": -1.0}, "duration", "greater than 0, not -1.0"),
        ({"kind": "held", "offset": [0.0, 0.1], "duration": 0.0}, "duration", "greater than 0, not 0.0"),
        ({"kind": "held", "offset": [0.0, 0.1], "duration": math.nan}, "duration", "finite"),
        ({"kind": "ramp", "offset": [0.0, 0.1], "hold": 1.0}, "rise", "must be given"),
        ({"kind": "ramp", "offset": [0.0, 0.1], "rise": 1.0, "hold": -1.0}, "hold", "greater than or equal to 0"),
        ({"kind": "noise", "std": 0.1, "duration": 1.0, "offset": [0.0, 0.1]}, "offset", "unknown parameter"),
        ({"kind": "noise", "std": -0.1, "duration": 1.0}, "std", "greater than 0"),
        ({"kind": "push", "offset": [0.0, 0.1]}, "kind", "Valid: displacement, held, noise, ramp"),
    ],
)
def test_a_table_without_meaning_is_refused(table: dict[str, object], place_: str, says: str) -> None:
    given_ = {"conditions": [{"name": "pushed", "disturbances": [{"kind": "displacement", **table}]}]}
    with pytest.raises(ParameterError) as error:
        validate_as(RolloutParameters, "rollout", given_)
    assert error.value.location == f"rollout.conditions.0.disturbances.0.{place_}"
    assert says in error.value.problem


def test_a_displacement_beside_the_name_of_a_condition_is_refused_by_name() -> None:
    given_ = {"conditions": [{"name": "pushed", "displacement": [0.0, 0.02], "at_fraction": 0.5}]}
    with pytest.raises(ParameterError) as error:
        validate_as(RolloutParameters, "rollout", given_)
    assert error.value.location == "rollout.conditions.0.displacement"
    assert "disturbances" in error.value.problem


def pushed_at(*moments: float) -> tuple[Simulated, RolloutParameters]:
    """Roll-outs of both kinds of controller, one without and one with displacements at these times."""
    disturbances = tuple(Displacement(offset=UP, at_time=moment) for moment in moments)
    parameters = RolloutParameters(conditions=(Condition(), Condition(name="pushed", disturbances=disturbances)))
    return simulate(line_model(), [START], parameters, TOP_SPEED), parameters


def test_a_disturbance_that_never_comes_is_a_notice() -> None:
    assert list(notices(*pushed_at(0.3))) == []
    (sentence,) = notices(*pushed_at(1e300))
    assert "2 roll-outs ended before a disturbance of theirs, the first lpvds/pushed/4" in sentence
    assert "earlier (at_time, at_fraction)" in sentence


def test_the_second_of_two_that_never_comes_is_a_notice() -> None:
    assert len(list(notices(*pushed_at(0.3, 1e300)))) == 1


def test_a_case_that_could_not_begin_is_not_said_to_have_ended_before_its_disturbance() -> None:
    parameters = RolloutParameters(
        conditions=(
            Condition(
                name="pushed",
                obstacles=(Sphere(centre=(0.0, 0.01), radius=0.02),),
                disturbances=(Displacement(offset=UP),),
            ),
        )
    )
    done = simulate(line_model(), [START], parameters, TOP_SPEED)
    assert {rollout.outcome for rollout in done.rollouts} == {Outcome.GOAL_INSIDE}
    (sentence,) = notices(done, parameters)
    assert "2 roll-outs could not begin (goal-inside)" in sentence
