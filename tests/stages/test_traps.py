"""Traps: where they are, by hand and by search; that a policy is caught in them; and how a detour leaves them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from motions import rotation

from stages.dynamics.kernels import workspace
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.warp import Warp
from stages.mixture.gaussian import GaussianMixture
from stages.policy.avoidance.detour import (
    ANCHOR,
    BEYOND,
    DETOUR,
    FIRST,
    HESITATION,
    LEAST_FALL,
    LEAST_WAY,
    LEFT,
    LEVEL,
    PACE,
    PATIENCE,
    SECONDS,
    WAY,
    WAYPOINT,
    Memory,
    begin_detour,
    detour_step,
    forget,
    memory,
    without_progress,
)
from stages.policy.avoidance.method import resolve_avoidance
from stages.policy.avoidance.parameters import Box, Ellipsoid, Obstacle, RoasPlusParameters
from stages.policy.avoidance.scene import covered, shapes_of
from stages.policy.avoidance.scratch import ACTIVE, DETOURING, FREE, TRAPPED, scratch
from stages.policy.avoidance.shapes import Shapes, spheres
from stages.policy.avoidance.traps import on_sphere, sampled, traps_of
from stages.policy.coupled import PLAIN
from stages.policy.field import field_of
from stages.policy.outcome import Outcome
from stages.policy.policy import Rules
from stages.rollout.run import Path, run_case
from stages.trajectory import Array
from stages.world.disturbance import no_pushes

seeds = st.integers(0, 2**32 - 1)
dimensions = st.sampled_from((2, 3))
DT = 0.01


def model_of(P: Array, goal: Array | None = None, warp: Warp | None = None) -> LpvDs:
    """psi' = -2 psi, with any P: straight to the goal, in the image of the warp."""
    d = P.shape[0]
    mixture = GaussianMixture(weights=np.ones(1), means=np.zeros((1, d)), covariances=np.eye(d)[None])
    goal = np.zeros(d) if goal is None else goal
    return LpvDs(mixture=mixture, matrices=-2.0 * np.eye(d)[None], goal=goal, lyapunov_matrix=P, warp=warp)


def one_sphere(radius: float, *centre: float) -> Shapes:
    return spheres(np.array([centre]), np.array([radius]))


def roll_out(
    model: LpvDs, shapes: Shapes, start: Array, *, detour: bool, margin: float = 0.0, steps: int = 3000
) -> Path:
    """An uncoupled roll-out with ROAS+."""
    given = RoasPlusParameters(detour=detour, margin=margin)
    avoidance = resolve_avoidance(given, 0.5, DT, math.inf, "rollout.avoidances.0")
    rules = Rules(field_of(model, "cayley"), PLAIN, avoidance)
    pushes = no_pushes(model.dimension)
    return run_case(rules, shapes, shapes, pushes, np.array(start), dt=DT, steps=steps, stop_distance=5e-4)


def detours_of(path: Path) -> list[tuple[int, int]]:
    """First and last sample of each detour."""
    on = np.flatnonzero(path.status == DETOURING)
    return [(int(run[0]), int(run[-1])) for run in np.split(on, np.flatnonzero(np.diff(on) > 1) + 1) if run.size]


def check_detours(model: LpvDs, path: Path) -> list[tuple[int, int]]:
    """It arrives; V rises on detours only, and is lower after each than it was in the trap. Returns the detours."""
    V, detours = model.lyapunov(path.x), detours_of(path)
    assert path.outcome is Outcome.ARRIVED
    assert path.clearance.min() >= -1e-9
    assert (np.diff(V)[path.status[:-1] != DETOURING] <= 0.0).all()
    for first, last in detours:
        assert V[last + 1] < V[first]
    return detours


def axis_condition(low: float, high: float, away: float, radius: float) -> bool:
    """Whether P = diag(low, high), low < high, has a trap on a sphere about (away, 0), behind it.

    (P - nu I) u = -P m with u = (r, 0), m = (M, 0): nu = low (1 + M/r); across, V curves up where high > nu.
    """
    return high > low * (1.0 + away / radius)


@given(seeds, dimensions, st.floats(0.01, 100.0), st.floats(1e-3, 0.999))
def test_a_round_v_has_no_traps_on_spheres_of_any_size(seed: int, d: int, scale: float, share: float) -> None:
    m = np.random.default_rng(seed).normal(size=d)
    assert on_sphere(scale * np.eye(d), m, share * float(np.linalg.norm(m))) == []


@given(st.floats(1.1, 20.0), st.floats(0.02, 0.99), st.booleans())
def test_a_sphere_on_the_slow_axis_by_hand(ratio: float, radius: float, behind: bool) -> None:
    # The centre is at a distance of 1; the trap, if any, is the far end.
    assume(abs(ratio - (1.0 + 1.0 / radius)) > 1e-3 * ratio)
    side = -1.0 if behind else 1.0
    found = on_sphere(np.diag([0.5, 0.5 * ratio]), np.array([side, 0.0]), radius)
    if axis_condition(0.5, 0.5 * ratio, 1.0, radius):
        assert len(found) == 1
        assert found[0] == pytest.approx([side * radius, 0.0], abs=1e-9)
    else:
        assert found == []


@given(st.floats(1.1, 20.0), st.floats(0.02, 0.99))
def test_a_sphere_on_the_fast_axis_has_no_trap(ratio: float, radius: float) -> None:
    # At (0, r): nu = high (1 + M/r) > low, so V falls to both sides. Off the axis nu would have to be negative.
    assert on_sphere(np.diag([1.0, ratio]), np.array([0.0, 1.0]), radius) == []


def test_spheres_on_the_axes_of_a_form_in_space_by_hand() -> None:
    # Behind the sphere nu = 1 (1 + 1/0.5) = 3: both other eigenvalues must be larger.
    m = np.array([1.0, 0.0, 0.0])
    (trap,) = on_sphere(np.diag([1.0, 3.1, 9.0]), m, 0.5)
    assert trap == pytest.approx([0.5, 0.0, 0.0], abs=1e-9)
    (trap,) = on_sphere(np.diag([1.0, 4.0, 4.0]), m, 0.5)
    assert trap == pytest.approx([0.5, 0.0, 0.0], abs=1e-9)
    assert on_sphere(np.diag([1.0, 2.9, 9.0]), m, 0.5) == []
    # The two smallest are equal: V is round in a plane, in which a way leads round.
    assert on_sphere(np.diag([1.0, 1.0, 9.0]), m, 0.5) == []
    # On the axes of the other two.
    assert on_sphere(np.diag([1.0, 3.1, 9.0]), np.array([0.0, 1.0, 0.0]), 0.5) == []
    assert on_sphere(np.diag([1.0, 3.1, 9.0]), np.array([0.0, 0.0, 1.0]), 0.5) == []


def searched(P: Array, m: Array, radius: float) -> list[Array] | None:
    """Minima of V on a sphere at which it rises outwards, by descent from many starts; none: it did not converge.

    u <- r (a I - P) u - P m, normed, brings V down for a above all eigenvalues.
    """
    d, most = P.shape[0], 1.01 * float(np.linalg.eigvalsh(P)[-1])
    u = np.random.default_rng(0).normal(size=(100, d))
    for _ in range(2000):
        u *= radius / np.sqrt((u**2).sum(axis=1, keepdims=True))
        u = u @ (most * np.eye(d) - P) - P @ m
    u *= radius / np.linalg.norm(u, axis=1, keepdims=True)
    gradient, normal = 2.0 * (u + m) @ P, u / radius
    outwards = (gradient * normal).sum(axis=1)
    across = gradient - outwards[:, None] * normal
    if np.abs(across).max() > 1e-6 * most * radius:
        return None
    found: list[Array] = []
    for one in u[outwards > 0.0]:
        if all(np.linalg.norm(one - other) > 1e-3 * radius for other in found):
            found.append(one)
    return found


@settings(max_examples=60)
@given(seeds, dimensions, st.floats(0.0, 0.6))
def test_the_traps_of_a_sphere_are_those_that_descent_finds(seed: int, d: int, aside: float) -> None:
    # Near the slow axis, where there often are some.
    generator, R = np.random.default_rng(seed), rotation(d, seed)
    P = R @ np.diag(np.append(1.0, generator.uniform(1.5, 10.0, size=d - 1))) @ R.T
    m = R[:, 0] + aside * generator.normal(size=d)
    radius = float(generator.uniform(0.2, 0.98) * np.linalg.norm(m))
    expected, found = searched(0.5 * (P + P.T), m, radius), on_sphere(0.5 * (P + P.T), m, radius)
    assume(expected is not None)
    assert expected is not None
    assert len(found) == len(expected) <= 1
    for one, other in zip(found, expected, strict=True):
        assert one == pytest.approx(other, abs=1e-4 * radius)
        assert np.linalg.norm(one) == pytest.approx(radius, rel=1e-9)


def test_the_search_finds_both_traps_and_none() -> None:
    # So that the test above compares something.
    trap = searched(np.diag([1.0, 4.0, 5.0]), np.array([1.0, 0.1, 0.0]), 0.8)
    assert trap is not None
    assert len(trap) == 1
    assert searched(np.diag([1.0, 2.0, 5.0]), np.array([1.0, 0.1, 0.0]), 0.8) == []


@given(seeds, dimensions, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_traps_do_not_depend_on_units(seed: int, d: int, of_length: float, of_energy: float) -> None:
    generator = np.random.default_rng(seed)
    P, m = np.diag(np.append(1.0, generator.uniform(3.0, 9.0, size=d - 1))), np.eye(d)[0]
    m = m + 0.1 * generator.normal(size=d)
    found = on_sphere(P, m, 0.8)
    scaled = on_sphere(10.0**of_energy * P, 10.0**of_length * m, 10.0**of_length * 0.8)
    assert len(found) == len(scaled)
    for one, other in zip(found, scaled, strict=True):
        assert other == pytest.approx(10.0**of_length * one, rel=1e-6, abs=1e-7 * 10.0**of_length)


LONG = np.diag([1.0, 4.0])
"""With this P a disc of radius 0.8 about (1, 0) has one trap, (1.8, 0): nu = 2.25 < 4."""


def test_traps_of_a_scene_by_hand() -> None:
    goal = np.array([5.0, -3.0])
    traps, exact = traps_of(model_of(LONG, goal), one_sphere(0.8, 6.0, -3.0), 0.0)
    assert exact
    assert traps == pytest.approx(np.array([[6.8, -3.0]]), abs=1e-9)
    assert not traps.flags.writeable
    # With a margin, beyond it; on either side of the goal; on none.
    traps, _ = traps_of(model_of(LONG), one_sphere(0.7, 1.0, 0.0), 0.1)
    assert traps == pytest.approx(np.array([[1.8, 0.0]]), abs=1e-9)
    both = spheres(np.array([[1.0, 0.0], [0.0, 3.0], [-1.0, 0.0]]), np.array([0.8, 1.0, 0.6]))
    traps, exact = traps_of(model_of(LONG), both, 0.0)
    assert exact
    assert traps == pytest.approx(np.array([[1.8, 0.0], [-1.6, 0.0]]), abs=1e-9)
    traps, exact = traps_of(model_of(np.eye(2)), both, 0.0)
    assert exact
    assert traps.shape == (0, 2)
    traps, exact = traps_of(model_of(np.eye(3)), spheres(np.empty((0, 3)), np.empty(0)), 0.0)
    assert exact
    assert traps.shape == (0, 3)


def test_a_moving_obstacle_has_no_trap() -> None:
    moving = spheres(np.array([[1.0, 0.0]]), np.array([0.8]), np.array([[0.0, 1e-9]]))
    traps, exact = traps_of(model_of(LONG), moving, 0.0)
    assert exact
    assert traps.shape == (0, 2)


def test_a_place_that_another_obstacle_covers_is_no_trap() -> None:
    def behind(radius: float, margin: float) -> Array:
        # The other disc is too small to have a trap itself, as nu = 1 + 2/r > 4, and moves nothing.
        shapes = spheres(np.array([[1.0, 0.0], [2.0, 0.0]]), np.array([0.8, radius]))
        return traps_of(model_of(LONG), shapes, margin)[0]

    assert behind(0.3, 0.0).shape == (0, 2)
    assert behind(0.15, 0.0) == pytest.approx(np.array([[1.8, 0.0]]), abs=1e-9)  # 0.05 are left
    assert behind(0.15, 0.02) == pytest.approx(np.array([[1.82, 0.0]]), abs=1e-9)  # 0.03, more than the margin
    assert behind(0.15, 0.03).shape == (0, 2)  # 0.02, less


@given(seeds, st.floats(-0.1, 0.1))
def test_sampling_finds_the_traps_of_spheres_that_are_known(seed: int, aside: float) -> None:
    generator = np.random.default_rng(seed)
    model, radius = model_of(np.diag([1.0, generator.uniform(5.0, 9.0)])), 0.8
    centre = np.array([1.0, aside])
    known = on_sphere(model.lyapunov_matrix, centre, radius)
    found = sampled(model.lyapunov, model.lyapunov_gradient, one_sphere(0.7, *centre), 0, 0.1)
    assert len(found) == len(known) == 1
    # The lowest of samples that are half a degree apart is next to the minimum, where V is nearly flat.
    assert np.linalg.norm(found[0] - centre - known[0]) <= 0.75 * math.radians(0.5) * radius


def traps_on(obstacle: Obstacle, margin: float = 0.0, P: Array | None = None) -> Array:
    d = len(obstacle.centre)
    traps, exact = traps_of(model_of(np.eye(d) if P is None else P), shapes_of([obstacle], d, "obstacles"), margin)
    assert not exact
    return traps


def test_the_far_face_of_a_box_is_a_trap() -> None:
    # V = |z|^2 has its minimum on the plane x = 1.3 at y = 0, which lies in the face.
    for rounding, margin in ((0.0, 0.0), (0.1, 0.0), (0.1, 0.05)):
        far = 1.3 + rounding + margin
        traps = traps_on(Box(centre=(1.0, 0.0), half_extents=(0.3, 0.2), rounding=rounding), margin)
        assert traps == pytest.approx(np.array([[far, 0.0]]), abs=1e-8)
        traps = traps_on(Box(centre=(0.0, -1.0), half_extents=(0.2, 0.3), rounding=rounding), margin)
        assert traps == pytest.approx(np.array([[0.0, -far]]), abs=1e-8)
    # A square on its corner: the goal's foot on the plane of a far face, (3.2, 3.2), lies beside the face.
    assert traps_on(Box(centre=(5.0, 0.0), half_extents=(1.0, 1.0), rotation=(math.pi / 4,))).shape == (0, 2)


def test_the_far_face_of_a_box_in_space_is_a_trap() -> None:
    traps = traps_on(Box(centre=(1.0, 0.0, 0.0), half_extents=(0.3, 0.2, 0.25)), 0.1)
    assert traps.shape == (1, 3)
    # Samples are about three degrees apart, seen from the centre.
    assert traps[0] == pytest.approx([1.4, 0.0, 0.0], abs=0.3 * math.radians(4.0))
    assert traps[0, 0] == pytest.approx(1.4, abs=1e-8)


@pytest.mark.parametrize("across", [0.2, 0.32, 0.34, 0.5])
@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_the_far_side_of_an_ellipse_is_a_trap_where_it_is_flatter_than_v(across: float, margin: float) -> None:
    # Radius of curvature b^2/a at the far end of semi-axes a, b, and M + a of the level line of V: for M = 1, a = 0.1
    # a trap where b^2 > 0.11, b > 0.3317; a margin adds the same to both.
    traps = traps_on(Ellipsoid(centre=(1.0, 0.0), semi_axes=(0.1, across)), margin)
    if across**2 > 0.11:
        assert traps == pytest.approx(np.array([[1.1 + margin, 0.0]]), abs=1e-8)
    else:
        assert traps.shape == (0, 2)
    # Turned and seen along its length, it is never.
    assert traps_on(Ellipsoid(centre=(1.0, 0.0), semi_axes=(0.1, across), rotation=(math.pi / 2,)), margin).size == 0


def test_the_far_side_of_an_ellipsoid_is_a_trap_where_it_is_flatter_than_v() -> None:
    traps = traps_on(Ellipsoid(centre=(1.0, 0.0, 0.0), semi_axes=(0.1, 0.5, 0.6)))
    assert traps.shape == (1, 3)
    # Normals are about three degrees apart; the surface there curves with radii of 2.5 and 3.6.
    assert traps[0] == pytest.approx([1.1, 0.0, 0.0], abs=3.6 * math.radians(4.0))
    # It must be flatter in both directions.
    assert traps_on(Ellipsoid(centre=(1.0, 0.0, 0.0), semi_axes=(0.1, 0.2, 0.6))).shape == (0, 3)


def test_covered_as_spheres_boxes_have_no_traps() -> None:
    box = shapes_of([Box(centre=(1.0, 0.0), half_extents=(0.3, 0.2))], 2, "obstacles")
    traps, exact = traps_of(model_of(np.eye(2)), covered(box, [True]), 0.0)
    assert exact
    assert traps.shape == (0, 2)


def dented(depth: float) -> LpvDs:
    """V = |psi|^2, of which one translation pulls (0.15, 0) towards the goal by `depth` metres."""
    return model_of(
        np.eye(2),
        warp=Warp(centres=np.array([[0.15, 0.0]]), translations=np.array([[-depth, 0.0]]), rates=np.array([12.0])),
    )


def dent_condition(depth: float, away: float, radius: float) -> bool:
    """Whether the far end (M + r, 0) of a sphere about (M, 0) is a trap of `dented`, M + r = 0.15.

    At the angle a, psi is (g - (r/2 - v (rho r)^2) a^2, r a) with g = M + r - v (1 - exp(-(rho (M + r))^2)), to second
    order: V curves up where g (1 - 2 v rho^2 r) < r.
    """
    g = away + radius - depth * (1.0 - math.exp(-((12.0 * (away + radius)) ** 2)))
    return g * (1.0 - 2.0 * depth * 144.0 * radius) < radius


@pytest.mark.parametrize("depth", [0.02, 0.04, 0.045, 0.05, 0.06, 0.07])
def test_a_warp_can_bend_v_more_than_a_sphere_does(depth: float) -> None:
    traps, exact = traps_of(dented(depth), one_sphere(0.05, 0.1, 0.0), 0.0)
    assert not exact
    if dent_condition(depth, 0.1, 0.05):
        assert traps == pytest.approx(np.array([[0.15, 0.0]]), abs=1e-9)
    else:
        assert traps.shape == (0, 2)


def test_a_warp_without_translations_is_none() -> None:
    traps, exact = traps_of(model_of(LONG, warp=Warp.identity(2)), one_sphere(0.8, 1.0, 0.0), 0.0)
    assert exact
    assert traps == pytest.approx(np.array([[1.8, 0.0]]), abs=1e-9)


class Caught(NamedTuple):
    """A model, a scene with one trap, and a start in its pocket."""

    model: LpvDs
    shapes: Shapes
    trap: Array
    start: Array


def caught(seed: int, d: int) -> Caught:
    """A long V, its slow axis anywhere, a sphere about on it; a start a few millimetres off the trap."""
    generator, R = np.random.default_rng(seed), rotation(d, seed)
    P = R @ np.diag(np.append(1.0, generator.uniform(4.0, 9.0, size=d - 1))) @ R.T
    model = model_of(0.5 * (P + P.T), goal=0.3 * generator.normal(size=d))
    m = 0.1 * R[:, 0] + 0.005 * generator.normal(size=d)
    shapes = spheres((model.goal + m)[None], np.array([generator.uniform(0.8, 0.92) * np.linalg.norm(m)]))
    (trap,), exact = traps_of(model, shapes, 0.0)
    assert exact
    normal = (trap - shapes.centres[0]) / shapes.radii[0]
    aside = generator.normal(size=d)
    return Caught(model, shapes, trap, trap + 0.005 * normal + 0.003 * (aside - (aside @ normal) * normal))


@settings(max_examples=30)
@given(seeds, dimensions)
def test_without_detours_a_state_is_caught_where_it_was_predicted(seed: int, d: int) -> None:
    model, shapes, trap, start = caught(seed, d)
    path = roll_out(model, shapes, start, detour=False)
    assert path.outcome is Outcome.TRAPPED
    assert np.linalg.norm(path.x[-1] - trap) <= 1e-3
    assert path.status[-2] == TRAPPED
    assert set(path.status[:-2]) <= {FREE, ACTIVE}
    assert (np.diff(model.lyapunov(path.x)) <= 0.0).all()
    # It has stood there for a second.
    assert path.x.shape[0] * DT > PATIENCE
    assert np.linalg.norm(path.x[-round(PATIENCE / DT) // 2 :] - trap, axis=1).max() <= 2e-3


@settings(max_examples=30)
@given(seeds, dimensions)
def test_a_detour_leaves_a_trap_and_ends_lower(seed: int, d: int) -> None:
    model, shapes, trap, start = caught(seed, d)
    path = roll_out(model, shapes, start, detour=True)
    ((first, _),) = check_detours(model, path)
    assert np.linalg.norm(path.x[first] - trap) <= 2e-3
    assert (np.diff(model.lyapunov(path.x)) > 0.0).any()  # there is no other way out
    assert first * DT >= HESITATION


def test_a_state_that_begins_in_a_trap_stands_for_a_second() -> None:
    path = roll_out(model_of(LONG), one_sphere(0.08, 0.1, 0.0), np.array([0.18, 0.0]), detour=False)
    assert path.outcome is Outcome.TRAPPED
    assert path.x.shape[0] - 1 == pytest.approx(PATIENCE / DT, abs=1)
    assert np.abs(path.x - [0.18, 0.0]).max() < 1e-9


def test_on_the_axis_behind_a_sphere_a_round_v_holds_nothing_up() -> None:
    model = model_of(np.eye(2))
    path = roll_out(model, one_sphere(0.08, 0.1, 0.0), np.array([0.25, 0.0]), detour=False)
    assert path.outcome is Outcome.ARRIVED
    assert (np.diff(model.lyapunov(path.x)) <= 0.0).all()


@settings(max_examples=40)
@given(seeds, dimensions, st.integers(1, 4))
def test_there_are_as_many_detours_as_traps_at_most(seed: int, d: int, most: int) -> None:
    generator, R = np.random.default_rng(seed), rotation(d, seed)
    P = R @ np.diag(np.append(1.0, generator.uniform(4.0, 30.0, size=d - 1))) @ R.T
    model = model_of(0.5 * (P + P.T))
    centres, radii = np.empty((0, d)), np.empty(0)
    while radii.size < most:
        centre, radius = generator.uniform(-0.3, 0.3, size=d), generator.uniform(0.03, 0.12)
        if np.linalg.norm(centre) < radius + 0.01:
            continue
        if (np.linalg.norm(centres - centre, axis=1) > radii + radius + 0.005).all():
            centres, radii = np.vstack([centres, centre]), np.append(radii, radius)
    shapes = spheres(centres, radii)
    traps, _ = traps_of(model, shapes, 0.0)
    # In a pocket, if there is one; else anywhere.
    start = 0.4 * rotation(d, seed + 1)[:, 0]
    if traps.size:
        near = centres[np.argmin(np.abs(np.linalg.norm(centres - traps[0], axis=1) - radii))]
        start = near + 1.05 * (traps[0] - near)
    assume((np.linalg.norm(centres - start, axis=1) > radii).all())
    detours = check_detours(model, roll_out(model, shapes, start, detour=True))
    assert len(detours) <= len(traps)


@pytest.mark.parametrize(
    ("obstacle", "far"),
    [
        (Box(centre=(0.1, 0.0), half_extents=(0.02, 0.05), rounding=0.01), 0.13),
        (Ellipsoid(centre=(0.1, 0.0), semi_axes=(0.02, 0.08)), 0.12),
    ],
)
@pytest.mark.parametrize("margin", [0.0, 0.01])
def test_a_flat_side_holds_up_and_a_cover_does_not(obstacle: Obstacle, far: float, margin: float) -> None:
    model, start = model_of(np.eye(2)), np.array([0.25, 0.01])
    flat = shapes_of([obstacle], 2, "obstacles")
    (trap,), _ = traps_of(model, flat, margin)
    assert trap == pytest.approx([far + margin, 0.0], abs=1e-9)
    # A detour does not help: from its waypoint, too, the flat side is a trap. The remedy is a cover.
    for detour in (False, True):
        path = roll_out(model, flat, start, detour=detour, margin=margin)
        assert path.outcome is Outcome.TRAPPED
        assert np.linalg.norm(path.x[-1] - trap) <= 1e-3
        assert (np.diff(model.lyapunov(path.x))[path.status[:-1] != DETOURING] <= 0.0).all()
    assert "cover = true" in path.outcome.remedy
    assert check_detours(model, roll_out(model, covered(flat, [True]), start, detour=False, margin=margin)) == []


def test_a_state_is_caught_in_the_dent_of_a_warp_and_goes_round() -> None:
    model, shapes = dented(0.07), one_sphere(0.05, 0.1, 0.0)
    start = np.array([0.16, 0.002])
    path = roll_out(model, shapes, start, detour=False)
    assert path.outcome is Outcome.TRAPPED
    assert path.x[-1] == pytest.approx([0.15, 0.0], abs=1e-3)
    assert (np.diff(model.lyapunov(path.x)) <= 0.0).all()
    assert len(check_detours(model, roll_out(model, shapes, start, detour=True))) == 1


def test_a_trap_on_an_obstacle_that_is_very_near_the_goal_is_left() -> None:
    # 0.3 mm from the goal; the trap is at 0.1997.
    model, shapes = model_of(LONG), one_sphere(0.0997, 0.1, 0.0)
    check_detours(model, roll_out(model, shapes, np.array([0.205, 0.0]), detour=True))


def test_a_memory_begins_where_the_state_is() -> None:
    recall = memory(np.array([1.0, 2.0]))
    assert recall.places[ANCHOR].tolist() == [1.0, 2.0]
    assert recall.numbers[[DETOUR, SECONDS, WAY]].tolist() == [0.0, 0.0, 0.0]
    assert recall.numbers[FIRST] == -1.0
    recall.numbers[:] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    forget(recall, np.array([3.0, 4.0]))
    assert recall.places[ANCHOR].tolist() == [3.0, 4.0]
    assert recall.numbers[[SECONDS, WAY, FIRST]].tolist() == [0.0, 0.0, -1.0]
    assert recall.numbers[[DETOUR, PACE, LEVEL]].tolist() == [1.0, 2.0, 3.0]  # a detour goes on


def idle_times(speed: float, fall: float, steps: int = 8) -> tuple[list[float], Memory]:
    """Seconds without progress, at 1/16 s a step, of a state that moves at `speed` where it would at 1 m/s.

    V begins at 4 and falls by `fall` of that a second.
    """
    dt, recall, x, idle = 0.0625, memory(np.zeros(2)), np.zeros(2), []
    for k in range(steps):
        x[0] += speed * dt
        before, after = (4.0 * (1.0 - fall * dt * (k + i)) for i in (0, 1))
        idle.append(without_progress(recall, x, dt, before, after, dt))
    return idle, recall


def test_time_without_progress_by_hand() -> None:
    waited = [0.0625 * (k + 1) for k in range(8)]
    assert idle_times(0.0, 0.0)[0] == waited
    # Slower than a twentieth, and V falls by less than a hundredth a second.
    idle, recall = idle_times(0.9 * LEAST_WAY, 0.9 * LEAST_FALL)
    assert idle == waited
    assert recall.numbers[[SECONDS, WAY, FIRST]].tolist() == [0.5, 0.5, 4.0]
    assert recall.places[ANCHOR].tolist() == [0.0, 0.0]
    # Either is progress.
    assert idle_times(1.1 * LEAST_WAY, 0.0)[0] == [0.0] * 8
    assert idle_times(0.0, 1.1 * LEAST_FALL)[0] == [0.0] * 8


def test_a_window_with_progress_ends_after_a_quarter_of_a_second() -> None:
    _, recall = idle_times(0.1, 0.0, steps=3)
    assert recall.numbers[SECONDS] == 0.1875
    assert recall.places[ANCHOR].tolist() == [0.0, 0.0]
    _, recall = idle_times(0.1, 0.0, steps=4)
    assert HESITATION == 0.25
    assert recall.numbers[[SECONDS, WAY, FIRST]].tolist() == [0.0, 0.0, -1.0]
    assert recall.places[ANCHOR] == pytest.approx([0.025, 0.0])


def detour_from(x: Array, shapes: Shapes, model: LpvDs, margin: float = 0.0) -> tuple[bool, Memory]:
    recall, room = memory(x), scratch(shapes.number, model.dimension)
    return begin_detour(shapes, margin, model.arrays, x, 0.25, workspace(model.arrays), recall, room), recall


@pytest.mark.parametrize(
    ("radius", "margin", "waypoint"),
    [
        # The way from (2.1, 0) is sampled 400 times; the last sample at least as far from the sphere about (1, 0) as
        (0.5, 0.0, 2.1 * 85 / 400),  # 0.05, a tenth of its radius: 0.44625, not beyond 0.45
        (0.5, 0.1, 2.1 * 66 / 400),  # 0.05 beyond the margin: 0.3465, not beyond 0.35
        (0.95, 0.0, 2.1 * 4 / 400),  # 0.025, half of what the goal is: 0.021, not beyond 0.025
    ],
)
def test_a_detour_ends_behind_the_obstacle(radius: float, margin: float, waypoint: float) -> None:
    model, x = model_of(np.eye(2)), np.array([2.1, 0.0])
    found, recall = detour_from(x, one_sphere(radius, 1.0, 0.0), model, margin)
    assert found
    assert (BEYOND, LEFT) == (0.1, 0.1)
    assert recall.places[WAYPOINT] == pytest.approx([waypoint, 0.0], rel=1e-12)
    assert recall.numbers[[DETOUR, PACE]].tolist() == [1.0, 0.25]
    assert recall.numbers[LEVEL] == pytest.approx(waypoint**2 + 0.1 * (2.1**2 - waypoint**2), rel=1e-12)
    assert recall.numbers[[SECONDS, FIRST]].tolist() == [0.0, -1.0]
    assert recall.places[ANCHOR].tolist() == x.tolist()


def test_a_detour_passes_obstacles_that_stand_one_behind_the_other() -> None:
    # Between them are 0.02, and a tenth of the radius is 0.03: the way ends behind the second.
    shapes = spheres(np.array([[1.5, 0.0], [0.88, 0.0]]), np.array([0.3, 0.3]))
    found, recall = detour_from(np.array([2.0, 0.0]), shapes, model_of(np.eye(2)))
    assert found
    assert recall.places[WAYPOINT] == pytest.approx([0.55, 0.0], abs=0.006)


def test_there_is_no_detour_where_nothing_is_in_the_way() -> None:
    found, recall = detour_from(np.array([2.1, 0.0]), one_sphere(0.5, 1.0, 0.6), model_of(np.eye(2)))
    assert not found
    assert recall.numbers[DETOUR] == 0.0


def test_the_way_of_a_detour_is_straight_in_the_image_of_a_warp() -> None:
    model, x = dented(0.06), np.array([0.16, 0.01])
    assert model.warp is not None
    found, recall = detour_from(x, one_sphere(0.05, 0.1, 0.0), model)
    assert found
    (start, end), _ = model.warp.apply(np.array([x, recall.places[WAYPOINT]]))
    share = float(end @ start / (start @ start))
    assert 0.0 < share < 1.0
    assert end == pytest.approx(share * start, abs=1e-12)
    # By a tenth of its radius behind the sphere, to a 400th of the way.
    assert np.linalg.norm(recall.places[WAYPOINT] - [0.1, 0.0]) == pytest.approx(0.055, abs=0.001)
    V = model.lyapunov(np.array([x, recall.places[WAYPOINT]]))
    assert recall.numbers[LEVEL] == pytest.approx(V[1] + 0.1 * (V[0] - V[1]), rel=1e-12)


def test_steps_of_a_detour_by_hand() -> None:
    model, shapes, margin = model_of(np.eye(2)), one_sphere(0.5, 5.0, 5.0), 0.1
    x, x_next = np.array([2.0, 1.0]), np.empty(2)
    recall, kernels, room = memory(x), workspace(model.arrays), scratch(1, 2)

    def step() -> bool:
        return detour_step(shapes, margin, model.arrays, x, 0.5, kernels, recall, room, x_next)

    recall.places[WAYPOINT] = [0.5, -1.0]
    recall.numbers[[DETOUR, PACE, LEVEL]] = [1.0, 0.5, 0.1]
    assert step()  # 0.25 of 2.5 along (-0.6, -0.8)
    assert x_next == pytest.approx([1.85, 0.8], rel=1e-14)
    recall.numbers[PACE] = 50.0
    assert step()  # no farther than the waypoint
    assert x_next == pytest.approx([0.5, -1.0], rel=1e-14)
    # It is over where V = 5 is low enough; and then it is forgotten.
    recall.numbers[[LEVEL, SECONDS]] = [5.0, 3.0]
    assert not step()
    assert recall.numbers[[DETOUR, SECONDS]].tolist() == [0.0, 0.0]
    assert recall.places[ANCHOR].tolist() == [2.0, 1.0]
    # And where an obstacle, with its margin, has come over the waypoint.
    recall.numbers[[DETOUR, LEVEL]] = [1.0, 0.1]
    shapes.centres[0] = [0.5, -1.61]
    assert step()
    shapes.centres[0] = [0.5, -1.59]
    assert not step()
    assert recall.numbers[DETOUR] == 0.0
    # And at the waypoint.
    shapes.centres[0] = [5.0, 5.0]
    recall.numbers[DETOUR] = 1.0
    x[:] = [0.5, -1.0]
    assert not step()
