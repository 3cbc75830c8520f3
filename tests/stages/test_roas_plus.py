"""ROAS+: its step by hand, and what it promises: no collision, no rise of V, no stop short of the goal."""

from __future__ import annotations

import math

import motions as toy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import ROAS_PLUS, STOP, Tally, Task, linear, linear_task, rise, run, scene, task

from stages.dynamics import qlf, warped
from stages.dynamics.kernels import workspace
from stages.dynamics.parameters import QlfParameters, WarpedParameters
from stages.policy.avoidance.method import resolve_avoidance
from stages.policy.avoidance.parameters import Box, Ellipsoid, RoasPlusParameters
from stages.policy.avoidance.roas_plus import steer_about, steer_along
from stages.policy.avoidance.scene import shapes_of
from stages.policy.avoidance.scratch import ACTIVE, FREE, scratch
from stages.policy.avoidance.shapes import Shapes, spheres
from stages.policy.coupled import DEADBEAT, Coupling
from stages.policy.field import field_of
from stages.policy.outcome import Outcome
from stages.rollout.parameters import RandomScenes

ROUNDING = 1e-12
"""Relative rise of V that counts as none."""
TOUCH = 1e-9
"""Metres of penetration that count as none."""

dimensions = st.integers(2, 3)
seeds = st.integers(0, 2**32 - 1)
clocks = st.sampled_from([0.002, 0.005, 0.01, 0.02, 0.05, 0.1])


def stepped(shapes: Shapes, x: np.ndarray, x_next: np.ndarray, dt: float, rate: float) -> tuple[int, np.ndarray]:
    """One step of ROAS+ to the origin with V = |x|^2."""
    avoidance = resolve_avoidance(RoasPlusParameters(rate=rate), 1.0, dt, math.inf, "")
    room, out = scratch(shapes.number, x.shape[0]), x_next.copy()
    return steer_about(avoidance, shapes, np.zeros(x.shape[0]), x.copy(), out, dt, room), out


def test_a_step_that_keeps_every_row_is_left_as_it_is_to_the_bit() -> None:
    shapes = spheres(np.array([[0.5, 0.0]]), np.array([0.3]))
    x, free = np.array([1.0, 0.0]), np.array([0.983, 0.0071])
    status, x_next = stepped(shapes, x, free, 0.1, 1.0)  # h = 0.2: 0.02 of it may be taken, 0.017 is
    assert status == FREE
    assert (x_next == free).all()
    status, x_next = stepped(shapes, x, np.array([0.979, 0.0]), 0.1, 1.0)
    assert status == ACTIVE
    assert (x_next != np.array([0.979, 0.0])).any()


def test_head_on_by_hand() -> None:
    # f = (-1, 0), h = 0.2, so that at the rate 1/s the row is v_x >= -0.2: p = (-0.2, 0), and 0.8 of the speed is lost.
    # Nothing of f is across n, so f's own share of the wanted velocity is f, and 0.8 |f| goes into the steering, along
    # the fixed perpendicular. The row is v_x >= -0.2 again. V falls by 1 - 0.98^2 - 0.08^2 = 0.0332, more than a tenth
    # of 1 - 0.98^2.
    shapes = spheres(np.array([[0.5, 0.0]]), np.array([0.3]))
    status, x_next = stepped(shapes, np.array([1.0, 0.0]), np.array([0.9, 0.0]), 0.1, 1.0)
    assert status == ACTIVE
    assert x_next == pytest.approx([0.98, 0.08], rel=1e-12)


def test_beside_a_sphere_by_hand() -> None:
    # The sphere touches x at 45 degrees below the way: d = -(1, 1)/sqrt(2), f = (-1, 0), the row is d . v <= 0.
    # p = f - (d . f) d = (-1/2, 1/2), |p| = 1/sqrt(2), so q = 1 - 1/sqrt(2) is lost. Wanted: (-1, q), steering away
    # from the axis. Taken: (-1, q) - d (d . (-1, q)) = (-(1 + q)/2, (1 + q)/2).
    away = np.array([1.0, 1.0]) / math.sqrt(2.0)
    x = np.array([1.0, 0.0])
    shapes = spheres((x - 0.3 * away)[None], np.array([0.3]))
    status, x_next = stepped(shapes, x, np.array([0.9, 0.0]), 0.1, 1.0)
    q = 1.0 - 1.0 / math.sqrt(2.0)
    assert status == ACTIVE
    assert (x_next - x) / 0.1 == pytest.approx([-(1.0 + q) / 2.0, (1.0 + q) / 2.0], rel=1e-9)


def test_the_ball_keeps_v_from_rising_by_hand() -> None:
    # Touching head-on, in one long step: v_x >= 0, so (0, 1) is nearest in the rows, and leaves the ball |x + v dt| <=
    # |x|: standing still is all that is left, at the ball's tangent.
    shapes = spheres(np.array([[0.7, 0.0]]), np.array([0.3]))
    x = np.array([1.0, 0.0])
    _, x_next = stepped(shapes, x, np.array([0.0, 0.0]), 1.0, 1.0)
    assert np.linalg.norm(x_next) <= 1.0 + 1e-15
    assert np.linalg.norm(x_next - [0.7, 0.0]) >= 0.3 - 1e-12


def test_weights_of_two_spheres_by_hand() -> None:
    # Spheres above and below the way, alike: their steering cancels, and the state goes straight between them.
    shapes = spheres(np.array([[0.7, 0.3], [0.7, -0.3]]), np.array([0.25, 0.25]))
    status, x_next = stepped(shapes, np.array([0.9, 0.0]), np.array([0.4, 0.0]), 1.0, 0.1)
    assert status == ACTIVE
    assert x_next[1] == pytest.approx(0.0, abs=1e-12)
    assert x_next[0] < 0.9


def test_round_coordinates_make_a_learned_v_round() -> None:
    # The same step in stretched coordinates: with P = L L' and y = L' x, V is |y|^2.
    L = np.array([[1.5, 0.0], [0.4, 0.8]])
    model, x, dt = linear(np.zeros(2), lyapunov_matrix=L @ L.T), np.array([1.0, 0.3]), 0.05
    field = field_of(model, "cayley")
    rng = np.random.default_rng(0)
    for _ in range(200):
        centre = x - rng.uniform(0.3, 0.5) * (x / np.linalg.norm(x) + 0.3 * rng.normal(size=2))
        shapes = spheres(centre[None], np.array([0.25]))
        if np.linalg.norm(x - centre) < 0.25:
            continue
        x_next = 0.9 * x
        avoidance = resolve_avoidance(ROAS_PLUS, 1.0, dt, math.inf, "")
        steer_along(
            avoidance,
            shapes,
            field.model,
            field.factor,
            x.copy(),
            x_next,
            dt,
            workspace(field.model),
            scratch(1, 2),
        )
        assert (L.T @ x_next) @ (L.T @ x_next) <= (L.T @ x) @ (L.T @ x)
        assert np.linalg.norm(x_next - centre) >= 0.25 - TOUCH


def promised(one: Task, shapes: Shapes, dt: float, method: RoasPlusParameters = ROAS_PLUS) -> None:
    path = run(one, shapes, method, dt)
    assert path.outcome == Outcome.ARRIVED
    assert path.clearance.min() >= method.margin - TOUCH
    assert rise(one.model, path) <= ROUNDING


@settings(max_examples=100)
@given(seeds, dimensions, clocks)
def test_no_collision_no_rise_of_v_and_the_goal_in_random_scenes(seed: int, d: int, dt: float) -> None:
    generator = np.random.default_rng(seed)
    one = linear_task(generator, d)
    promised(one, scene(one, RandomScenes(), generator), dt)


@settings(max_examples=40)
@given(seeds, dimensions, clocks, st.floats(0.0, 0.02))
def test_exactly_head_on(seed: int, d: int, dt: float, gap: float) -> None:
    generator = np.random.default_rng(seed)
    towards = generator.normal(size=d)
    towards /= np.linalg.norm(towards)
    one = task(linear(np.zeros(d)), 0.5 * towards)
    # centres exactly on the axis, one behind the other
    shapes = spheres(np.array([0.3 * towards, 0.08 * towards]), np.array([0.2 - gap, 0.05]))
    promised(one, shapes, dt)


@pytest.mark.parametrize("d", [2, 3])
def test_head_on_along_an_axis_where_every_number_is_exact(d: int) -> None:
    start = np.zeros(d)
    start[0] = 1.0
    promised(task(linear(np.zeros(d)), start), spheres(0.5 * start[None], np.array([0.25])), 0.01)


@settings(max_examples=40)
@given(seeds, dimensions, clocks)
def test_goal_five_millimetres_from_a_sphere(seed: int, d: int, dt: float) -> None:
    generator = np.random.default_rng(seed)
    one = linear_task(generator, d)
    towards = (one.start - one.model.goal) / one.size + 0.7 * generator.normal(size=d)
    radius = one.size * generator.uniform(0.05, 0.3)
    centre = one.model.goal + (radius + 0.005) * towards / np.linalg.norm(towards)
    if np.linalg.norm(one.start - centre) <= radius:
        return
    promised(one, spheres(centre[None], np.array([radius])), dt)


@settings(max_examples=40)
@given(seeds, dimensions, clocks)
def test_a_start_that_recedes_from_spheres_is_not_disturbed(seed: int, d: int, dt: float) -> None:
    generator = np.random.default_rng(seed)
    one = linear_task(generator, d)
    behind = (one.start - one.model.goal) / one.size
    shapes = spheres((one.start + (0.1 + 1e-9) * behind)[None], np.array([0.1]))
    path, free = run(one, shapes, dt=dt), run(one, None, dt=dt)
    assert path.outcome == Outcome.ARRIVED
    assert (path.status == FREE).all()
    assert (path.x == free.x).all()


@settings(max_examples=20)
@given(seeds, dimensions, clocks, st.floats(0.001, 0.02))
def test_the_margin_is_kept(seed: int, d: int, dt: float, margin: float) -> None:
    generator = np.random.default_rng(seed)
    one = linear_task(generator, d)
    shapes = scene(one, RandomScenes(most=3, apart=0.5, free=0.25), generator)
    if shapes.number:
        promised(one, shapes, dt, RoasPlusParameters(margin=margin))


@settings(max_examples=20)
@given(seeds, dimensions, clocks)
def test_overlapping_spheres_are_gone_round_as_one(seed: int, d: int, dt: float) -> None:
    generator = np.random.default_rng(seed)
    towards = generator.normal(size=d)
    towards /= np.linalg.norm(towards)
    one = task(linear(np.zeros(d)), towards)
    aside = generator.normal(size=d)
    aside -= (aside @ towards) * towards
    aside /= np.linalg.norm(aside)
    # a pocket that opens towards the state
    centres = np.array([0.5 * towards + 0.12 * aside, 0.5 * towards - 0.12 * aside, 0.45 * towards])
    promised(one, spheres(centres, np.array([0.15, 0.15, 0.08])), dt)


@settings(max_examples=15)
@given(seeds, dimensions)
def test_a_start_inside_is_left_and_then_the_goal_reached(seed: int, d: int) -> None:
    generator = np.random.default_rng(seed)
    one = linear_task(generator, d)
    inwards = generator.normal(size=d)
    centre = one.start + 0.05 * one.size * inwards / np.linalg.norm(inwards)
    path = run(one, spheres(centre[None], np.array([0.1 * one.size])), RoasPlusParameters(recover=True))
    assert path.outcome == Outcome.ARRIVED
    outside = path.clearance >= -TOUCH
    assert not outside[0]
    assert outside[int(np.argmax(outside)) :].all()  # and is never entered again


@settings(max_examples=25)
@given(seeds, dimensions, clocks)
def test_boxes_and_ellipsoids_are_never_entered(seed: int, d: int, dt: float) -> None:
    generator = np.random.default_rng(seed)
    one = linear_task(generator, d)
    turn = generator.normal(size=4)
    rotation = (float(turn[0]),) if d == 2 else tuple(float(q) for q in turn / np.linalg.norm(turn))
    centre = tuple(one.model.goal + 0.5 * (one.start - one.model.goal) + 0.02 * generator.normal(size=d))
    sizes = tuple(float(s) for s in one.size * generator.uniform(0.04, 0.2, size=d))
    for cover in (False, True):
        for obstacle in (
            Box(centre=centre, half_extents=sizes, rounding=0.02 * one.size, rotation=rotation, cover=cover),
            Ellipsoid(centre=centre, semi_axes=sizes, rotation=rotation, cover=cover),
        ):
            path = run(one, shapes_of([obstacle], d, "obstacles"), dt=dt)
            assert path.outcome in (Outcome.ARRIVED, Outcome.TRAPPED)
            assert path.clearance.min() >= -TOUCH
            assert rise(one.model, path) <= ROUNDING


@settings(max_examples=15)
@given(seeds)
def test_the_unit_of_length_does_not_matter(seed: int) -> None:
    scale, generator = 1e3, np.random.default_rng(seed)
    one = linear_task(generator, 2)
    shapes = scene(one, RandomScenes(), generator)
    other = task(linear(scale * one.model.goal), scale * one.start)
    scaled = spheres(scale * shapes.centres, scale * shapes.radii)
    path, same = run(one, shapes), run(other, scaled)
    n = min(len(path.x), len(same.x))
    assert same.x[: n // 2] == pytest.approx(scale * path.x[: n // 2], rel=1e-6, abs=1e-6 * scale * one.size)


@pytest.fixture(scope="module")
def learned() -> list[Task]:
    """Systems that were learned from a hook, in the plane and in space: P = I, and a warp."""
    tasks = []
    for d in (2, 3):
        demonstrations, goal = toy.hook(d), toy.goal(d)
        mixtures = {"toy": toy.gaussians(demonstrations, 8)}
        round_v = qlf.fit(demonstrations, mixtures, goal, QlfParameters())
        bent_v = warped.fit(demonstrations, mixtures, goal, WarpedParameters(translations=8))
        tasks += [task(found.model, demonstrations[0].position[0]) for found in (round_v, bent_v)]
    return tasks


def test_learned_systems_among_random_scenes(learned: list[Task]) -> None:
    for number, one in enumerate(learned):
        tally = Tally()
        for case in range(25):
            generator = np.random.default_rng([number, case])
            shapes = scene(one, RandomScenes(), generator)
            for dt in (0.002, 0.02, 0.1):
                tally.add(one, run(one, shapes, dt=dt), dt)
        assert tally.collided == 0
        assert tally.clearance >= -TOUCH
        assert tally.rise <= ROUNDING
        assert tally.arrived == tally.count


def test_a_coupled_roll_out_is_the_plain_one_where_nobody_pushes(learned: list[Task]) -> None:
    for number, one in enumerate(learned):
        shapes = scene(one, RandomScenes(), np.random.default_rng([7, number]))
        plain = run(one, shapes)
        coupled = run(one, shapes, coupling=Coupling(DEADBEAT, v_max=10.0 * one.top_speed))
        assert coupled.outcome == plain.outcome == Outcome.ARRIVED
        assert coupled.gate.all()
        assert (coupled.x == plain.x).all()
        assert (coupled.p_hat == plain.x).all()
        assert np.linalg.norm(plain.x[-1] - one.model.goal) <= STOP
