"""The rivals of ROAS+: potential field, modulation, control barrier function, each by hand and in roll-outs."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import bent, linear
from scipy.optimize import brentq

from pipeline.errors import ParameterError
from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.apf import push_off
from stages.policy.avoidance.avoid import TOUCH
from stages.policy.avoidance.cbf import keep_clear
from stages.policy.avoidance.method import PUSH, RATE, REACHED, SPEED_LIMIT, resolve_avoidance
from stages.policy.avoidance.modulation import modulate, weight_of
from stages.policy.avoidance.parameters import (
    ApfParameters,
    CbfParameters,
    ModulationParameters,
    NoAvoidance,
    RoasParameters,
    RoasPlusParameters,
)
from stages.policy.avoidance.scratch import (
    ACTIVE,
    APF,
    CBF,
    FREE,
    INFEASIBLE,
    MODULATION,
    TOO_FAST,
    Avoidance,
    Scratch,
    scratch,
)
from stages.policy.avoidance.shapes import Shapes, distance_at, no_shapes, spheres
from stages.policy.coupled import PLAIN
from stages.policy.field import field_of
from stages.policy.outcome import Outcome
from stages.policy.policy import Rules
from stages.rollout.parameters import RandomScenes
from stages.rollout.run import Path, run_case
from stages.rollout.scenes import random_scene
from stages.world.disturbance import no_pushes

DT = 0.1
AHEAD, ABOVE = [2.0, 0.0], [0.0, 2.0]

Method = NoAvoidance | RoasParameters | ApfParameters | ModulationParameters | CbfParameters | RoasPlusParameters
Step = Callable[[Avoidance, Shapes, np.ndarray, np.ndarray, float, Scratch], int]
seeds = st.integers(0, 2**32 - 1)


def stepped(step: Step, avoidance: Avoidance, shapes: Shapes, f: list[float]) -> tuple[np.ndarray, int]:
    """The velocity that one step takes from the origin, where f is the learned system's, and what became of it."""
    x, x_next = np.zeros(len(f)), DT * np.array(f)
    status = step(avoidance, shapes, x, x_next, DT, scratch(shapes.number, len(f)))
    return x_next / DT, status


def ball(*centres: list[float], radius: float = 1.0, velocity: list[float] | None = None) -> Shapes:
    """Spheres of one radius; with a velocity, of one velocity."""
    moving = None if velocity is None else np.array([velocity] * len(centres))
    return spheres(np.array(centres), np.full(len(centres), radius), moving)


def box(centre: list[float], half_extents: list[float]) -> Shapes:
    """A box along the coordinates."""
    shapes = no_shapes(2, 1)
    shapes.kinds[0], shapes.centres[0] = 1, centre
    shapes.measures[0] = [0.0, math.hypot(*half_extents), *half_extents]
    return shapes


def roll_out(
    model: LpvDs, method: Method, start: np.ndarray, shapes: Shapes, dt: float = 0.01, top_speed: float = 1.0
) -> Path:
    avoidance = resolve_avoidance(method, top_speed, dt, math.inf, "avoidance")
    return run_case(
        Rules(field_of(model, "cayley"), PLAIN, avoidance),
        shapes,
        shapes,
        no_pushes(model.dimension),
        start,
        dt=dt,
        steps=round(20.0 / dt),
        stop_distance=0.0005,
    )


# Potential field.


def field(gain: float, reach: float = 0.0, speed_limit: float = math.inf) -> Avoidance:
    return Avoidance(APF, gain=gain, reach=reach, speed_limit=speed_limit)


def test_potential_field_by_hand() -> None:
    # h = 1, range 2: gain (2/1 - 1) (2/1)^2 = 4 gain, straight away.
    v, status = stepped(push_off, field(0.1, reach=2.0), ball(AHEAD), [1.0, 0.5])
    assert v == pytest.approx([0.6, 0.5], rel=1e-14)
    assert status == ACTIVE
    # h = 1, range 1.5: gain .5 2.25.
    v, _ = stepped(push_off, field(0.4, reach=1.5), ball(AHEAD), [1.0, 0.0])
    assert v == pytest.approx([0.55, 0.0], rel=1e-13)


def test_potential_field_has_by_default_the_range_of_the_radius() -> None:
    # h = .5, r = 1.5: gain 2 9 = 18 gain.
    v, _ = stepped(push_off, field(0.01), ball(AHEAD, radius=1.5), [1.0, 0.0])
    assert v == pytest.approx([0.82, 0.0], rel=1e-13)
    # At h = 1 = r it does not push: the step is as it was, to the bit.
    v, status = stepped(push_off, field(0.01), ball(AHEAD), [1.0, 0.3])
    assert status == FREE
    assert (v == DT * np.array([1.0, 0.3]) / DT).all()


def test_potential_fields_are_summed() -> None:
    v, _ = stepped(push_off, field(0.1, reach=2.0), ball(AHEAD, ABOVE), [1.0, 0.5])
    assert v == pytest.approx([0.6, 0.1], rel=1e-13)
    # The second is out of range.
    v, _ = stepped(push_off, field(0.1, reach=2.0), ball(AHEAD, [0.0, 3.5]), [1.0, 0.5])
    assert v == pytest.approx([0.6, 0.5], rel=1e-13)


def test_potential_field_is_no_faster_than_its_limit_nor_slower_than_f_for_it() -> None:
    # Uncapped 1 - 4 = -3.
    v, _ = stepped(push_off, field(1.0, reach=2.0), ball(AHEAD), [1.0, 0.0])
    assert v == pytest.approx([-3.0, 0.0], rel=1e-13)
    v, _ = stepped(push_off, field(1.0, reach=2.0, speed_limit=1.5), ball(AHEAD), [1.0, 0.0])
    assert v == pytest.approx([-1.5, 0.0], rel=1e-13)
    # f itself is faster than the limit: then |f| is.
    v, _ = stepped(push_off, field(1.0, reach=2.0, speed_limit=0.5), ball(AHEAD), [1.0, 0.0])
    assert v == pytest.approx([-1.0, 0.0], rel=1e-13)
    # Direction stays: uncapped (-3, 4).
    v, _ = stepped(push_off, field(1.0, reach=2.0, speed_limit=1.0), ball(AHEAD), [1.0, 4.0])
    assert v == pytest.approx(math.sqrt(17.0) / 5.0 * np.array([-3.0, 4.0]), rel=1e-13)


def test_potential_field_stays_finite_on_and_inside_a_surface() -> None:
    for radius in (2.0, 2.5):
        v, _ = stepped(push_off, field(0.1, speed_limit=1.5), ball(AHEAD, radius=radius), [1.0, 0.0])
        assert v == pytest.approx([-1.5, 0.0], rel=1e-12)


def test_potential_field_knows_the_distance_from_a_box() -> None:
    # The face is 1 away, its corner farther; range 2: 4 gain.
    v, _ = stepped(push_off, field(0.1, reach=2.0), box([2.0, 0.0], [1.0, 3.0]), [1.0, 0.5])
    assert v == pytest.approx([0.6, 0.5], rel=1e-13)


def test_potential_field_misses_a_goal_in_the_range_of_an_obstacle() -> None:
    # On the axis x' = -x + gain (.1/h - 1) (.1/h)^2, h = x + .05: the state stands where this is 0.
    gain, start = 0.05, np.array([0.5, 0.0])
    stands = brentq(lambda x: -x + gain * (0.1 / (x + 0.05) - 1.0) * (0.1 / (x + 0.05)) ** 2, 0.0, 0.049)
    path = roll_out(linear(np.zeros(2)), ApfParameters(gain=gain), start, ball([-0.15, 0.0], radius=0.1))
    assert path.outcome is Outcome.TRAPPED
    assert stands > 0.02
    assert path.x[-1] == pytest.approx([stands, 0.0], abs=2e-4)
    # Other methods arrive there, and so does this one where the goal is out of range.
    for method in (CbfParameters(), ModulationParameters(), RoasPlusParameters()):
        other = roll_out(linear(np.zeros(2)), method, start, ball([-0.15, 0.0], radius=0.1))
        assert other.outcome is Outcome.ARRIVED
    near = roll_out(linear(np.zeros(2)), ApfParameters(gain=gain), start, ball([-0.2, 0.0], radius=0.1))
    assert near.outcome is Outcome.ARRIVED
    short = roll_out(linear(np.zeros(2)), ApfParameters(gain=gain, range=0.04), start, ball([-0.15, 0.0], radius=0.1))
    assert short.outcome is Outcome.ARRIVED


def test_potential_field_defaults_come_from_the_top_speed() -> None:
    resolved = resolve_avoidance(ApfParameters(), 0.2, 0.01, math.inf, "avoidance")
    assert resolved == Avoidance(APF, gain=PUSH * 0.2, reach=0.0, speed_limit=SPEED_LIMIT * 0.2)
    given = ApfParameters(range=0.3, gain=0.4, speed_limit=0.5)
    assert resolve_avoidance(given, 0.2, 0.01, math.inf, "avoidance") == Avoidance(
        APF, gain=0.4, reach=0.3, speed_limit=0.5
    )
    # No faster than the follower.
    assert resolve_avoidance(given, 0.2, 0.01, 0.1, "avoidance").speed_limit == REACHED * 0.1


# Modulation.


def bend(reactivity: float = 1.0, margin: float = 0.0) -> Avoidance:
    return Avoidance(MODULATION, gain=reactivity, margin=margin)


def test_modulation_of_one_sphere_by_hand() -> None:
    # G = 4: 3/4 along the normal, 5/4 across; with r = 2 half and one and a half.
    v, status = stepped(modulate, bend(), ball(AHEAD), [1.0, 1.0])
    assert v == pytest.approx([0.75, 1.25], rel=1e-14)
    assert status == ACTIVE
    v, _ = stepped(modulate, bend(reactivity=2.0), ball(AHEAD), [1.0, 1.0])
    assert v == pytest.approx([0.5, 1.5], rel=1e-14)
    # A state that recedes is slowed down as well.
    v, _ = stepped(modulate, bend(), ball(AHEAD), [-1.0, 1.0])
    assert v == pytest.approx([-0.75, 1.25], rel=1e-14)


def test_modulation_in_space_by_hand() -> None:
    # The normal is (-.6, 0, -.8): along it f has -1, across it (.4, 1, -.3).
    v, _ = stepped(modulate, bend(), ball([1.2, 0.0, 1.6]), [1.0, 1.0, 0.5])
    assert v == pytest.approx([0.75 * 0.6 + 1.25 * 0.4, 1.25, 0.75 * 0.8 - 1.25 * 0.3], rel=1e-13)


def test_modulation_with_a_margin_takes_a_larger_sphere() -> None:
    # R + margin = 2 = |x - c|: as on a surface.
    v, _ = stepped(modulate, bend(margin=1.0), ball(AHEAD), [1.0, 1.0])
    assert v == pytest.approx([0.0, 2.0], abs=1e-15)


def test_modulation_takes_the_bounding_sphere_of_a_box() -> None:
    # Half extents (.6, .8): R = 1.
    v, _ = stepped(modulate, bend(), box(AHEAD, [0.6, 0.8]), [1.0, 1.0])
    assert v == pytest.approx([0.75, 1.25], rel=1e-13)


def test_weights_of_several_spheres_by_hand() -> None:
    levels = np.array([2.0, 3.0])  # (G_2 - 1)/((G_1 - 1) + (G_2 - 1)) = 2/3
    assert [weight_of(i, levels) for i in range(2)] == pytest.approx([2.0 / 3.0, 1.0 / 3.0], rel=1e-15)
    # The nearer one counts for all where the state is on it.
    assert [weight_of(i, np.array([1.0, 3.0])) for i in range(2)] == [1.0, 0.0]
    assert [weight_of(i, np.array([1.0, 1.0])) for i in range(2)] == [0.5, 0.5]
    assert weight_of(0, np.array([7.0])) == 1.0
    # Of three: products, 2/3 3/4, 1/3 3/5, 1/4 2/5.
    levels = np.array([2.0, 3.0, 4.0])
    assert [weight_of(i, levels) for i in range(3)] == pytest.approx([0.5, 0.2, 0.1], rel=1e-15)


def test_modulation_of_two_spheres_by_hand() -> None:
    # G = 4 and weight 1/2 of both: 7/8 and 9/8, one after the other.
    v, _ = stepped(modulate, bend(), ball(AHEAD, ABOVE), [1.0, 1.0])
    assert v == pytest.approx([63.0 / 64.0, 63.0 / 64.0], rel=1e-14)
    # G = 4 and 9: weights 8/11 and 3/11, 1 -+ 2/11 and 1 -+ 1/33.
    v, _ = stepped(modulate, bend(), ball(AHEAD, [0.0, 3.0]), [1.0, 2.0])
    assert v == pytest.approx([9.0 / 11.0 * 34.0 / 33.0, 2.0 * 13.0 / 11.0 * 32.0 / 33.0], rel=1e-13)


def test_modulation_of_a_moving_sphere_by_hand() -> None:
    # f - v_o = (.5, 1) is bent to (.375, 1.25), then v_o is added.
    v, _ = stepped(modulate, bend(), ball(AHEAD, velocity=[0.5, 0.0]), [1.0, 1.0])
    assert v == pytest.approx([0.875, 1.25], rel=1e-14)
    # Two of them, of weight 1/2 each, at 7/8 and 9/8: weighted, they carry by all of their common velocity.
    v, _ = stepped(modulate, bend(), ball(AHEAD, ABOVE, velocity=[0.5, 0.0]), [1.0, 1.0])
    assert v == pytest.approx([0.5 * 63.0 / 64.0 + 0.5, 63.0 / 64.0], rel=1e-13)


@given(seeds, st.integers(2, 3), st.floats(0.2, 5.0))
def test_on_a_surface_modulation_leaves_nothing_along_the_normal(seed: int, d: int, reactivity: float) -> None:
    generator = np.random.default_rng(seed)
    centre, other = generator.normal(size=(2, d))
    radius = float(np.linalg.norm(centre))
    other *= 4.0 * radius / np.linalg.norm(other)
    f, velocity = generator.normal(size=(2, d))
    shapes = spheres(np.array([centre, other]), np.array([radius, radius]), np.array([velocity, np.zeros(d)]))
    v, _ = stepped(modulate, bend(reactivity), shapes, f.tolist())
    # It goes along with the sphere, and no nearer.
    assert (v - velocity) @ centre / radius == pytest.approx(0.0, abs=1e-12 * (1.0 + np.abs(f - velocity).max()))


def test_modulation_fades_with_distance() -> None:
    v, _ = stepped(modulate, bend(), ball([1e4, 0.0]), [1.0, 1.0])
    assert v == pytest.approx([1.0 - 1e-8, 1.0 + 1e-8], rel=1e-13)


def test_modulation_stands_head_on_and_passes_otherwise() -> None:
    shapes = ball([0.2, 0.0], radius=0.1)
    head_on = roll_out(linear(np.zeros(2)), ModulationParameters(), np.array([0.5, 0.0]), shapes)
    assert head_on.outcome is Outcome.TRAPPED
    assert head_on.x[-1] == pytest.approx([0.3, 0.0], abs=1e-5)
    beside = roll_out(linear(np.zeros(2)), ModulationParameters(), np.array([0.5, 0.01]), shapes)
    assert beside.outcome is Outcome.ARRIVED
    assert beside.clearance.min() > 0.0


def test_modulation_in_long_steps_enters_an_obstacle() -> None:
    # It bends the velocity at the start of a step, and nothing watches its end.
    shapes, start = ball([0.2, 0.0], radius=0.1), np.array([0.5, 0.001])
    assert roll_out(linear(np.zeros(2)), ModulationParameters(), start, shapes, dt=1.0).outcome is Outcome.COLLIDED
    assert roll_out(linear(np.zeros(2)), CbfParameters(), start, shapes, dt=1.0).clearance.min() >= -TOUCH


# Control barrier function.


def barrier(rate: float = 1.0, margin: float = 0.0, speed_limit: float = 10.0) -> Avoidance:
    return Avoidance(CBF, rate=rate, margin=margin, speed_limit=speed_limit)


def test_barrier_projects_onto_a_row_by_hand() -> None:
    # h = 1: v_x <= 1.
    v, status = stepped(keep_clear, barrier(), ball(AHEAD), [2.0, 1.0])
    assert v == pytest.approx([1.0, 1.0], rel=1e-14)
    assert status == ACTIVE
    # Slantwise: d^ = (.6, .8), d^ . f = 2, d^ . v <= 1: f less 1 of d^.
    v, _ = stepped(keep_clear, barrier(), ball([1.2, 1.6]), [2.0, 1.0])
    assert v == pytest.approx([1.4, 0.2], rel=1e-13)
    # With a margin of .25 and rate 2: v_x <= 1.5.
    v, _ = stepped(keep_clear, barrier(rate=2.0, margin=0.25), ball(AHEAD), [2.0, 1.0])
    assert v == pytest.approx([1.5, 1.0], rel=1e-14)


def test_barrier_leaves_a_step_that_keeps_its_rows_to_the_bit() -> None:
    # On the row, below it, and away from the obstacle.
    for f in ([1.0, 5.0], [0.9, 0.3], [-7.0, 1.0]):
        x, x_next = np.zeros(2), 0.125 * np.array(f)
        before = x_next.copy()
        assert keep_clear(barrier(), ball(AHEAD), x, x_next, 0.125, scratch(1, 2)) == FREE
        assert x_next.tobytes() == before.tobytes()


def test_barrier_keeps_two_rows_by_hand() -> None:
    v, _ = stepped(keep_clear, barrier(), ball(AHEAD, ABOVE), [3.0, 2.0])
    assert v == pytest.approx([1.0, 1.0], rel=1e-14)
    # Only one of them is in the way.
    v, _ = stepped(keep_clear, barrier(), ball(AHEAD, ABOVE), [3.0, -2.0])
    assert v == pytest.approx([1.0, -2.0], rel=1e-14)


def test_barrier_gives_way_to_a_moving_sphere_by_hand() -> None:
    # It comes at 1.5 m/s: v_x <= 1 - 1.5.
    v, status = stepped(keep_clear, barrier(), ball(AHEAD, velocity=[-1.5, 0.7]), [1.0, 1.0])
    assert v == pytest.approx([-0.5, 1.0], rel=1e-13)
    assert status == ACTIVE
    # It leaves at 1.5 m/s: v_x <= 2.5, which f keeps.
    assert stepped(keep_clear, barrier(), ball(AHEAD, velocity=[1.5, 0.0]), [2.0, 1.0])[1] == FREE


def test_barrier_that_may_not_be_fast_enough_misses_by_least_and_says_so() -> None:
    # v_x <= 1 - 3 = -2, at most at 1 m/s: straight away, and the row is missed by 1.
    v, status = stepped(keep_clear, barrier(speed_limit=1.0), ball(AHEAD, velocity=[-3.0, 0.0]), [0.5, 0.5])
    assert v == pytest.approx([-1.0, 0.0], abs=1e-4)
    assert status == TOO_FAST
    # f may be as fast as it is: sqrt(5) m/s, whatever the limit.
    v, status = stepped(keep_clear, barrier(speed_limit=1.0), ball(AHEAD, velocity=[-3.0, 0.0]), [2.0, 1.0])
    assert v == pytest.approx([-2.0, 1.0], rel=1e-9)
    assert status == ACTIVE


def test_barrier_between_two_spheres_that_close_in_is_infeasible() -> None:
    # v_x <= -2 and -v_x <= -2: standing misses both by 2, and nothing misses them by less.
    shapes = spheres(np.array([AHEAD, [-2.0, 0.0]]), np.ones(2), np.array([[-3.0, 0.0], [3.0, 0.0]]))
    v, status = stepped(keep_clear, barrier(), shapes, [1.0, 0.5])
    assert status == INFEASIBLE
    assert v[0] == pytest.approx(0.0, abs=1e-6)


@settings(max_examples=60)
@given(seeds, st.integers(2, 3), st.integers(1, 5))
def test_barrier_takes_the_admissible_velocity_nearest_to_f(seed: int, d: int, m: int) -> None:
    generator = np.random.default_rng(seed)
    centres = generator.normal(size=(m, d))
    radii = np.linalg.norm(centres, axis=1) * generator.uniform(0.3, 1.0, size=m)
    shapes, f = spheres(centres, radii), 2.0 * generator.normal(size=d)
    v, status = stepped(keep_clear, barrier(), shapes, f.tolist())
    normals, clear = np.empty((m, d)), np.empty(m)
    for i in range(m):
        clear[i] = distance_at(shapes, i, np.zeros(d), normals[i])
    assert (-normals @ v <= clear + 1e-9).all()
    assert status == (FREE if (-normals @ f <= clear).all() else ACTIVE)
    # A projection onto a convex set: no admissible velocity lies on f's side of it.
    others = (f + generator.normal(size=(4000, d))) * generator.uniform(size=(4000, 1)) ** 3
    others[0] = 0.0
    admissible = others[(-others @ normals.T <= clear).all(axis=1) & (np.linalg.norm(others, axis=1) <= 10.0)]
    assert (admissible[0] == 0.0).all()  # standing is admissible
    assert ((admissible - v) @ (f - v)).max() <= 1e-8


@pytest.mark.parametrize("d", [2, 3])
def test_barrier_stands_exactly_head_on(d: int) -> None:
    start, centre = 0.5 * np.eye(d)[0], 0.2 * np.eye(d)[0]
    shapes = ball(centre.tolist(), radius=0.1)
    head_on = roll_out(linear(np.zeros(d)), CbfParameters(), start, shapes)
    assert head_on.outcome is Outcome.TRAPPED
    assert head_on.x[-1] == pytest.approx(0.3 * np.eye(d)[0], abs=1e-6)
    # A second without progress, not before.
    waited = len(head_on.x) - int(np.argmax(np.abs(head_on.x[:, 0] - 0.3) < 1e-3))
    assert waited >= 100
    # Off the axis by 2 % it slides past; ROAS+ needs no such luck.
    beside = roll_out(linear(np.zeros(d)), CbfParameters(), start + 0.01 * np.eye(d)[1], shapes)
    assert beside.outcome is Outcome.ARRIVED
    assert roll_out(linear(np.zeros(d)), RoasPlusParameters(), start, shapes).outcome is Outcome.ARRIVED


def test_barrier_before_an_obstacle_that_moves_waits_to_the_end_of_time() -> None:
    # It drives the state before it: what moves may leave yet, so this is no trap.
    shapes = ball([0.2, 0.0], radius=0.1, velocity=[0.01, 0.0])
    path = roll_out(linear(np.zeros(2)), CbfParameters(), np.array([0.5, 0.0]), shapes)
    assert path.outcome is Outcome.TIMEOUT
    assert path.x[-1, 0] == pytest.approx(0.3 + 0.01 * 20.0, abs=1e-6)
    assert path.clearance.min() >= -TOUCH


@settings(max_examples=50)
@given(seeds, st.integers(2, 3), st.floats(0.002, 0.1))
def test_barrier_never_collides_with_standing_spheres(seed: int, d: int, dt: float) -> None:
    generator = np.random.default_rng(seed)
    model = bent(generator, d, spread=0.1)
    start = np.asarray(model.goal + generator.normal(size=d) * 0.2)
    way = roll_out(model, NoAvoidance(), start, no_shapes(d), dt).x
    shapes = random_scene(way, dt, start[None], RandomScenes(apart=-0.05), generator)
    path = roll_out(model, CbfParameters(), start, shapes, dt)
    assert (path.status == ACTIVE).any()  # every sphere is on the way
    assert path.outcome in (Outcome.ARRIVED, Outcome.TRAPPED, Outcome.TIMEOUT)
    # Between samples, too, from the path itself: the nearest point of each step to each sphere.
    a, b = path.x[:-1, None], path.x[1:, None]
    length = np.maximum(((b - a) ** 2).sum(axis=2), 1e-300)
    share = np.clip(((shapes.centres - a) * (b - a)).sum(axis=2) / length, 0.0, 1.0)
    away = np.linalg.norm(a + share[..., None] * (b - a) - shapes.centres, axis=2) - shapes.radii
    assert away.min() >= -1e-12
    assert path.clearance.min() == pytest.approx(away.min(), abs=1e-12)


def test_barrier_defaults_and_refusals() -> None:
    resolved = resolve_avoidance(CbfParameters(margin=0.01), 0.2, 0.01, 0.9, "rollout.avoidances.0")
    assert resolved == Avoidance(CBF, rate=RATE, margin=0.01, speed_limit=SPEED_LIMIT * 0.2, fastest=REACHED * 0.9)
    assert resolve_avoidance(CbfParameters(), 0.2, 0.25, math.inf, "a").rate == 4.0  # 1/dt is less
    with pytest.raises(ParameterError, match="at most 1/dt = 50 is safe") as error:
        resolve_avoidance(CbfParameters(rate=60.0), 0.2, 0.02, math.inf, "rollout.avoidances.0")
    assert error.value.location == "rollout.avoidances.0.rate"
    resolve_avoidance(CbfParameters(rate=50.0), 0.2, 0.02, math.inf, "rollout.avoidances.0")


@pytest.mark.parametrize(
    ("method", "name"),
    [
        (ApfParameters(gain=-1.0), "gain"),
        (ApfParameters(range=math.nan), "range"),
        (ApfParameters(speed_limit=math.inf), "speed_limit"),
        (ModulationParameters(reactivity=math.inf), "reactivity"),
        (ModulationParameters(margin=-0.01), "margin"),
        (CbfParameters(margin=math.nan), "margin"),
        (CbfParameters(rate=-1.0), "rate"),
        (CbfParameters(rate=0.0), "rate"),
        (RoasParameters(unit=0.0), "unit"),
        (RoasPlusParameters(swiftness=0.5), "swiftness"),
        (RoasPlusParameters(margin=-1), "margin"),
    ],
)
def test_numbers_out_of_range_are_refused_by_name(method: Method, name: str) -> None:
    with pytest.raises(ParameterError, match=r"(positive number|finite number, [01] or more), not") as error:
        resolve_avoidance(method, 0.2, 0.01, math.inf, "rollout.avoidances.2")
    assert error.value.location == f"rollout.avoidances.2.{name}"
