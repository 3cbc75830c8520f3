"""The printed strategy against obstacles, eqs. (19)-(23): what it does, and every way in which it fails, by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scenes import linear

from stages.policy.avoidance.method import resolve_avoidance
from stages.policy.avoidance.parameters import NoAvoidance, RoasParameters, RoasPlusParameters
from stages.policy.avoidance.roas import lorentz, repel
from stages.policy.avoidance.scratch import ACTIVE, ROAS, Avoidance, scratch
from stages.policy.avoidance.shapes import Shapes, no_shapes, spheres
from stages.policy.coupled import PLAIN
from stages.policy.field import field_of
from stages.policy.outcome import Outcome
from stages.policy.policy import Rules
from stages.rollout.run import Path, run_case
from stages.trajectory import frozen
from stages.world.disturbance import no_pushes

DT = 0.1
AHEAD = np.array([0.6, 0.8])
"""Direction of an obstacle to the left of a motion along x, 53 degrees off."""

Method = RoasParameters | RoasPlusParameters | NoAvoidance
seeds = st.integers(0, 2**32 - 1)


def in_space(v: np.ndarray) -> np.ndarray:
    return np.concatenate([v, np.zeros(3 - len(v))])


def printed(x: np.ndarray, goal: np.ndarray, obstacle: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """f_o letter by letter, in space: (21), (20), (19). `rate`: the time derivative of d = x_o - x."""
    x, goal, obstacle, rate = (in_space(v) for v in (x, goal, obstacle, rate))
    d = obstacle - x
    c = rate - d / np.linalg.norm(d) * (d / np.linalg.norm(d) @ rate)
    B = np.cross(c, rate)
    return np.asarray(np.cross((goal - x) / np.linalg.norm(goal - x), B))


def force(n: np.ndarray, to: np.ndarray, v: np.ndarray) -> np.ndarray:
    """f_o of a state that moves at v past an obstacle that stands."""
    out = np.empty(len(n))
    lorentz(n, to, -v, out)
    return out


def random_place(seed: int, d: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to the goal and to an obstacle, and a velocity."""
    n, to, v = np.random.default_rng(seed).normal(size=(3, d))
    return n / np.linalg.norm(n), to / np.linalg.norm(to), v


def stepped(
    shapes: Shapes, *, f: np.ndarray, goal: np.ndarray | None = None, x: np.ndarray | None = None, unit: float = 1.0
) -> np.ndarray:
    """The velocity that one step takes from x, by default the origin, towards a goal on the x axis."""
    d = len(f)
    x = np.zeros(d) if x is None else x
    goal = 2.0 * np.eye(d)[0] if goal is None else goal
    x_next = x + f * DT
    room = scratch(shapes.number, d)
    assert repel(Avoidance(ROAS, gain=1.0 / unit), shapes, frozen(goal), x, x_next, DT, room) == ACTIVE
    return np.asarray((x_next - x) / DT)


def roll_out(method: Method, start: list[float], centre: list[float], radius: float, scale: float = 1.0) -> Path:
    """A roll-out past one sphere, all numbers of length multiplied by `scale`."""
    begin, shapes = scale * np.array(start), spheres(scale * np.array([centre]), np.array([scale * radius]))
    avoidance = resolve_avoidance(method, scale, 0.01, math.inf, "avoidance")
    return run_case(
        Rules(field_of(linear(np.zeros(len(start))), "cayley"), PLAIN, avoidance),
        shapes,
        shapes,
        no_pushes(len(start)),
        begin,
        dt=0.01,
        steps=2000,
        stop_distance=0.0005 * scale,
    )


def gap(a: Path, b: Path) -> float:
    """Largest distance of two roll-outs, as long as both last."""
    n = min(len(a.x), len(b.x))
    return float(np.linalg.norm(a.x[:n] - b.x[:n], axis=1).max())


# What the print says.


def test_the_triple_product_by_hand() -> None:
    # v = (1, 0): c = (-.64, .48, 0), B = (0, 0, .48), n x B = (0, -.48, 0).
    v = np.array([1.0, 0.0])
    assert force(v, AHEAD, v) == pytest.approx([0.0, -0.48], abs=1e-15)
    assert printed(np.zeros(2), 2.0 * v, AHEAD, -v) == pytest.approx([0.0, -0.48, 0.0], abs=1e-15)


def test_the_triple_product_in_space_by_hand() -> None:
    # n = e_z, d^ = e_x, ddot = (-2, -3, -1): c = (0, -3, -1), B = c x ddot = (0, 2, -6), n x B = (-2, 0, 0).
    out = np.empty(3)
    lorentz(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([-2.0, -3.0, -1.0]), out)
    assert out == pytest.approx([-2.0, 0.0, 0.0], abs=1e-15)


@given(seeds, st.sampled_from([2, 3]))
def test_lorentz_is_the_printed_triple_product(seed: int, d: int) -> None:
    x, goal, obstacle, rate = np.random.default_rng(seed).normal(size=(4, d))
    n, to = (goal - x) / np.linalg.norm(goal - x), (obstacle - x) / np.linalg.norm(obstacle - x)
    out = np.empty(d)
    lorentz(n, to, rate, out)
    # In the plane the product stays in the plane.
    assert in_space(out) == pytest.approx(printed(x, goal, obstacle, rate), rel=1e-12, abs=1e-12 * (rate @ rate))


@given(seeds, st.integers(2, 5))
def test_lorentz_is_the_closed_form_of_the_module(seed: int, d: int) -> None:
    n, to, v = random_place(seed, d)
    v_r = v @ to
    v_t = v - v_r * to
    assert force(n, to, v) == pytest.approx(v_r * ((n @ to) * v_t - (n @ v_t) * to), rel=1e-12, abs=1e-12 * (v @ v))


@given(seeds, st.integers(2, 5))
def test_the_force_is_orthogonal_to_the_goal(seed: int, d: int) -> None:
    n, to, v = random_place(seed, d)
    assert abs(force(n, to, v) @ n) <= 1e-14 * (v @ v)


def test_one_step_by_hand() -> None:
    # |d| = 1, r = .5: k_o = 2, and f_o = (0, -.48).
    shapes = spheres(AHEAD[None], np.array([0.5]))
    assert stepped(shapes, f=np.array([1.0, 0.0])) == pytest.approx([1.0, -0.96], rel=1e-13)
    # Twice as far, r = 1: k_o is the same.
    shapes = spheres(2.0 * AHEAD[None], np.array([1.0]))
    assert stepped(shapes, f=np.array([1.0, 0.0])) == pytest.approx([1.0, -0.96], rel=1e-13)
    # Twice as fast: four times the force.
    assert stepped(shapes, f=np.array([2.0, 0.0])) == pytest.approx([2.0, -3.84], rel=1e-13)


def test_one_step_elsewhere_is_the_same_step() -> None:
    at = np.array([0.3, -0.7])
    shapes = spheres((at + AHEAD)[None], np.array([0.5]))
    moved = stepped(shapes, f=np.array([1.0, 0.0]), goal=at + 3.0 * np.eye(2)[0], x=at)
    assert moved == pytest.approx([1.0, -0.96], rel=1e-12)


def test_forces_of_several_obstacles_are_summed() -> None:
    # To the left k_o = 2; to the right |d| = 2, r = .5, k_o = 4/3, and the force is mirrored: -.96 + .64.
    right = AHEAD * [1.0, -1.0]
    shapes = spheres(np.array([AHEAD, 2.0 * right]), np.array([0.5, 0.5]))
    assert stepped(shapes, f=np.array([1.0, 0.0])) == pytest.approx([1.0, -0.32], rel=1e-12)
    swapped = spheres(np.array([2.0 * right, AHEAD]), np.array([0.5, 0.5]))
    assert stepped(swapped, f=np.array([1.0, 0.0])) == pytest.approx([1.0, -0.32], rel=1e-12)


def test_a_moving_obstacle_counts_by_its_relative_velocity_by_hand() -> None:
    # x_o moves at (0, -1): ddot = (-1, -1), c = (-.16, .12), B = .28, f_o = (0, -.28), k_o = 2.
    shapes = spheres(AHEAD[None], np.array([0.5]), np.array([[0.0, -1.0]]))
    assert stepped(shapes, f=np.array([1.0, 0.0])) == pytest.approx([1.0, -0.56], rel=1e-13)
    # One that goes along with the state does nothing.
    shapes = spheres(AHEAD[None], np.array([0.5]), np.array([[1.0, 0.0]]))
    assert (stepped(shapes, f=np.array([1.0, 0.0])) == [1.0, 0.0]).all()


@given(seeds, st.sampled_from([2, 3]))
def test_a_moving_obstacle_is_a_standing_one_in_its_own_frame(seed: int, d: int) -> None:
    f, velocity, centre, goal = np.random.default_rng(seed).normal(size=(4, d))
    radius = 0.5 * float(np.linalg.norm(centre))  # k_o = 2
    moving = spheres(centre[None], np.array([radius]), velocity[None])
    standing = spheres(centre[None], np.array([radius]))
    added = stepped(moving, f=f, goal=goal) - f
    in_its_frame = stepped(standing, f=f - velocity, goal=goal) - (f - velocity)
    scale = 1.0 + np.abs(in_its_frame).max()
    assert added == pytest.approx(in_its_frame, rel=1e-9, abs=1e-12 * scale)
    assert added == pytest.approx(
        2.0 * printed(np.zeros(d), goal, centre, velocity - f)[:d], rel=1e-9, abs=1e-12 * scale
    )


def test_other_shapes_count_as_their_bounding_sphere() -> None:
    # A box of half extents (.3, .4): REACH = .5, k_o = 2.
    shapes = no_shapes(2, 1)
    shapes.kinds[0], shapes.centres[0], shapes.measures[0] = 1, AHEAD, [0.0, 0.5, 0.3, 0.4]
    assert stepped(shapes, f=np.array([1.0, 0.0])) == pytest.approx([1.0, -0.96], rel=1e-13)


def test_at_the_goal_there_is_no_direction_and_no_force() -> None:
    shapes = spheres(AHEAD[None], np.array([0.5]))
    assert (stepped(shapes, f=np.array([1.0, 0.0]), goal=np.zeros(2)) == [1.0, 0.0]).all()


# Where the print fails: why there is ROAS+.


@pytest.mark.parametrize("start", [[0.1, 0.0], [0.0, 0.06, 0.08]])
def test_head_on_the_print_collides_and_roas_plus_arrives(start: list[float]) -> None:
    # v has no part across d^, so f_o = 0: the print goes straight in, from any distance.
    half_way = (0.5 * np.array(start)).tolist()
    as_printed = roll_out(RoasParameters(), start, half_way, 0.02)
    ignored = roll_out(NoAvoidance(), start, half_way, 0.02)
    assert as_printed.outcome is Outcome.COLLIDED
    assert as_printed.clearance[-1] < 0.0
    assert as_printed.x == pytest.approx(ignored.x, abs=1e-15)
    ours = roll_out(RoasPlusParameters(), start, half_way, 0.02)
    assert ours.outcome is Outcome.ARRIVED
    assert ours.clearance.min() > 0.0


def test_the_unit_of_length_decides_whether_the_print_collides() -> None:
    # Quadratic in speed: in millimetres the same force is a thousand times as strong.
    scene = ([0.1, 0.0], [0.05, 0.002], 0.02)
    in_metres, in_mm = roll_out(RoasParameters(), *scene), roll_out(RoasParameters(unit=0.001), *scene)
    assert in_metres.outcome is Outcome.COLLIDED
    assert in_mm.outcome is Outcome.ARRIVED
    # And it is thrown farther from the way than it ever was from the goal.
    assert np.linalg.norm(in_mm.x, axis=1).max() > 1.3 * np.linalg.norm(in_mm.x[0])


def test_a_unit_is_what_the_numbers_mean() -> None:
    # With unit = 1 mm, metres move as the same scene does whose numbers are millimetres.
    scene = ([0.1, 0.0], [0.05, 0.005], 0.02)
    in_mm, numbers = roll_out(RoasParameters(unit=0.001), *scene), roll_out(RoasParameters(), *scene, scale=1000.0)
    assert len(in_mm.x) == len(numbers.x)
    assert numbers.x / 1000.0 == pytest.approx(in_mm.x, rel=1e-9, abs=1e-12)


def test_roas_plus_does_not_depend_on_the_unit_of_length_and_the_print_does() -> None:
    scene = ([0.1, 0.0], [0.05, 0.005], 0.02)
    ours, scaled = roll_out(RoasPlusParameters(), *scene), roll_out(RoasPlusParameters(), *scene, scale=1000.0)
    assert ours.outcome is scaled.outcome is Outcome.ARRIVED
    assert len(ours.x) == len(scaled.x)
    assert scaled.x / 1000.0 == pytest.approx(ours.x, rel=1e-9, abs=1e-12)
    one, other = roll_out(RoasParameters(), *scene), roll_out(RoasParameters(), *scene, scale=1000.0)
    n = min(len(one.x), len(other.x))
    assert np.abs(other.x[:n] / 1000.0 - one.x[:n]).max() > 0.05


def test_in_millimetres_a_larger_scene_blows_up() -> None:
    scene = ([1.0, 0.0], [0.5, 0.1], 0.2)
    assert roll_out(RoasParameters(unit=0.001), *scene).outcome is Outcome.DIVERGED
    assert roll_out(RoasPlusParameters(), *scene).outcome is Outcome.ARRIVED


def test_inside_the_radius_the_sign_flips_and_the_print_pulls_in() -> None:
    # |d| = 1, r = 2: k_o = -1, and the force leads to the obstacle's side.
    shapes = spheres(AHEAD[None], np.array([2.0]))
    v = stepped(shapes, f=np.array([1.0, 0.0]))
    assert v == pytest.approx([1.0, 0.48], rel=1e-13)
    assert v @ AHEAD > np.array([1.0, 0.0]) @ AHEAD
    outside = stepped(spheres(AHEAD[None], np.array([0.5])), f=np.array([1.0, 0.0]))
    assert outside @ AHEAD < np.array([1.0, 0.0]) @ AHEAD


def test_at_the_radius_the_strength_is_infinite() -> None:
    centre = np.array([[3.0, 4.0]])  # |d| = 5 exactly
    assert not np.isfinite(stepped(spheres(centre, np.array([5.0])), f=np.array([1.0, 0.0]))).all()
    # Just outside it is finite and as large as you like: k_o = 5/(5 - r).
    for missing in (1e-3, 1e-6):
        v = stepped(spheres(centre, np.array([5.0 - missing])), f=np.array([1.0, 0.0]))
        assert v[1] == pytest.approx(-0.48 * 5.0 / missing, rel=1e-8)


def test_a_state_that_recedes_is_pulled_back() -> None:
    # The same way past the same obstacle: before it the force leads away from it, behind it the sign flips.
    v, behind = np.array([1.0, 0.0]), AHEAD * [-1.0, 1.0]
    assert force(v, AHEAD, v) == pytest.approx([0.0, -0.48], abs=1e-15)
    assert force(v, behind, v) == pytest.approx([0.0, 0.48], abs=1e-15)
    assert force(v, AHEAD, v) @ AHEAD == pytest.approx(-0.384, rel=1e-13)
    assert force(v, behind, v) @ behind == pytest.approx(0.384, rel=1e-13)


def test_the_print_pulls_in_where_the_motion_across_leads_away_from_the_goal() -> None:
    # Obstacle along x, goal along y, v = (1, -1): v_r = 1, v_t = (0, -1), n . v_t = -1, f_o = d^.
    n, to, v = np.array([0.0, 1.0]), np.array([1.0, 0.0]), np.array([1.0, -1.0])
    assert force(n, to, v) == pytest.approx([1.0, 0.0], abs=1e-15)
    # At |d| = 1, r = .5 the speed of approach is trebled.
    moved = stepped(spheres(to[None], np.array([0.5])), f=v, goal=n)
    assert moved == pytest.approx([3.0, -1.0], rel=1e-13)


@given(seeds, st.integers(2, 5))
def test_the_force_repels_only_where_both_signs_agree(seed: int, d: int) -> None:
    # f_o . d^ = -v_r (n . v_t): towards the obstacle as often as away from it.
    n, to, v = random_place(seed, d)
    v_r = v @ to
    n_v_t = n @ (v - v_r * to)
    assume(abs(v_r * n_v_t) > 1e-6 * (v @ v))
    assert force(n, to, v) @ to == pytest.approx(-v_r * n_v_t, rel=1e-6)


def test_far_away_the_strength_is_one_and_does_not_fade() -> None:
    # k_o = |d|/(|d| - r) falls to 1, not to 0.
    f = np.array([1.0, 0.0])
    for away in (10.0, 1e3, 1e6):
        v = stepped(spheres(away * AHEAD[None], np.array([0.5])), f=f)
        assert v[1] == pytest.approx(-0.48 * away / (away - 0.5), rel=1e-9)
    assert v[1] == pytest.approx(-0.48, rel=1e-6)
    # Neither does it where it is scaled by a unit: then it tends to this gain.
    assert stepped(spheres(1e6 * AHEAD[None], np.array([0.5])), f=f, unit=0.1)[1] == pytest.approx(-4.8, rel=1e-6)


def test_an_obstacle_far_off_the_way_bends_the_print_and_not_roas_plus() -> None:
    scene = ([1.0, 0.0], [50.0, 60.0], 0.2)
    ignored = roll_out(NoAvoidance(), *scene)
    assert gap(roll_out(RoasParameters(), *scene), ignored) > 0.1
    assert roll_out(RoasPlusParameters(), *scene).x.tobytes() == ignored.x.tobytes()


def test_in_a_finite_step_near_the_radius_v_rises() -> None:
    # Orthogonal to the goal is not enough: k_o = 100 makes a step of 4.8 across a distance of 2.
    v = stepped(spheres(AHEAD[None], np.array([0.99])), f=np.array([1.0, 0.0]))
    z = np.array([-2.0, 0.0])
    assert v == pytest.approx([1.0, -48.0], rel=1e-11)
    assert (z + DT * v) @ (z + DT * v) == pytest.approx(1.9**2 + 4.8**2, rel=1e-11)
    assert (z + DT * v) @ (z + DT * v) > z @ z


@settings(max_examples=25)
@given(seeds, st.sampled_from([2, 3]))
def test_head_on_scenes_all_collide(seed: int, d: int) -> None:
    generator = np.random.default_rng(seed)
    start = generator.normal(size=d)
    start *= generator.uniform(0.05, 0.5) / np.linalg.norm(start)
    centre, radius = generator.uniform(0.3, 0.7) * start, generator.uniform(0.05, 0.25) * float(np.linalg.norm(start))
    assert roll_out(RoasParameters(), start.tolist(), centre.tolist(), radius).outcome is Outcome.COLLIDED
    assert roll_out(RoasPlusParameters(), start.tolist(), centre.tolist(), radius).outcome is Outcome.ARRIVED
