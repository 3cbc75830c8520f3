"""Obstacles as given, covered and merged; what cannot begin; methods completed; outcomes and what they tell."""

from __future__ import annotations

import dataclasses
import math
import pickle
import re
from collections.abc import Sequence

import clarabel
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import rotation as random_rotation
from scipy import sparse
from scipy.spatial.transform import Rotation

from pipeline.errors import ParameterError
from stages.policy.avoidance import scratch
from stages.policy.avoidance.method import PUSH, RATE, REACHED, SPEED_LIMIT, margin_of, resolve_avoidance
from stages.policy.avoidance.parameters import (
    ApfParameters,
    Avoidance,
    Box,
    CbfParameters,
    Ellipsoid,
    ModulationParameters,
    NoAvoidance,
    Obstacle,
    RoasParameters,
    RoasPlusParameters,
    Sphere,
)
from stages.policy.avoidance.scene import (
    covered,
    enclosing,
    inside,
    merged,
    refusal,
    rotation,
    shapes_of,
    to_be_covered,
)
from stages.policy.avoidance.shapes import (
    BOX,
    ELLIPSOID,
    RADIUS,
    REACH,
    SIZES,
    SPHERE,
    Shapes,
    distance_at,
    no_shapes,
    spheres,
)
from stages.policy.outcome import Outcome, Status
from stages.rollout.loop import OUTCOMES
from stages.rollout.parameters import CarryCondition, ClpvdsController, RolloutParameters
from stages.trajectory import Array

AT = "rollout.conditions.0.obstacles"
METHOD = "rollout.avoidances.1"
seeds = st.integers(0, 2**32 - 1)
dimensions = st.sampled_from((2, 3))

DISC = Sphere(centre=(0.1, 0.2), radius=0.05)
BRICK = Box(centre=(0.1, 0.2), half_extents=(0.3, 0.4))
EGG = Ellipsoid(centre=(0.1, 0.2), semi_axes=(0.3, 0.4))


def discs(*given: tuple[float, float, float]) -> Shapes:
    """Discs by x, y and radius."""
    values = np.array(given)
    return spheres(values[:, :2], values[:, 2])


def random_spheres(generator: np.random.Generator, n: int, d: int) -> Shapes:
    """Spheres that often overlap, of two velocities."""
    velocities = np.zeros((n, d))
    velocities[generator.uniform(size=n) < 0.3, 0] = 0.1
    return spheres(generator.normal(size=(n, d)), generator.uniform(0.05, 0.8, size=n), velocities)


def holds(outer: Shapes, k: int, inner: Shapes, i: int) -> bool:
    """Whether a sphere lies in another."""
    apart = float(np.linalg.norm(outer.centres[k] - inner.centres[i]))
    return bool(apart + inner.radii[i] <= outer.radii[k] * (1.0 + 1e-12) + 1e-15)


def test_obstacles_become_arrays() -> None:
    quarter = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    shapes = shapes_of(
        [
            Sphere(centre=(1.0, 2.0, 3.0), radius=0.5, velocity=(0.1, 0.0, -0.1)),
            Box(centre=(0.0, 1.0, 0.0), half_extents=(2.0, 3.0, 6.0), rounding=0.25, rotation=quarter),
            Ellipsoid(centre=(4.0, 4.0, 4.0), semi_axes=(0.1, 0.3, 0.2)),
        ],
        3,
        AT,
    )
    assert shapes.number == 3
    assert shapes.kinds.tolist() == [SPHERE, BOX, ELLIPSOID]
    assert shapes.centres.tolist() == [[1.0, 2.0, 3.0], [0.0, 1.0, 0.0], [4.0, 4.0, 4.0]]
    assert shapes.velocities.tolist() == [[0.1, 0.0, -0.1], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    assert shapes.measures[:, RADIUS].tolist() == [0.5, 0.25, 0.0]
    assert shapes.measures[:, REACH] == pytest.approx([0.5, 7.25, 0.3])
    assert shapes.measures[1:, SIZES:].tolist() == [[2.0, 3.0, 6.0], [0.1, 0.3, 0.2]]
    assert shapes.frames[1] == pytest.approx(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), abs=1e-15)
    assert (shapes.frames[[0, 2]] == np.eye(3)).all()


def test_no_obstacles_become_empty_arrays() -> None:
    shapes = shapes_of([], 2, AT)
    assert shapes.number == 0
    assert shapes.centres.shape == (0, 2)


@pytest.mark.parametrize("rounding", [0.0, 0.1])
def test_the_reach_is_that_of_the_farthest_point(rounding: float) -> None:
    box = shapes_of([Box(centre=(0.0, 0.0), half_extents=(0.3, 0.4), rounding=rounding, rotation=(0.7,))], 2, AT)
    corner = box.frames[0] @ [0.3, 0.4]
    tip = corner * (0.5 + rounding) / 0.5
    assert np.linalg.norm(tip) == pytest.approx(box.measures[0, REACH])
    assert distance_at(box, 0, tip, np.empty(2)) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(
    ("obstacle", "name", "says"),
    [
        (dataclasses.replace(DISC, radius=-1.0), "radius", "positive number of metres, not -1"),
        (dataclasses.replace(DISC, radius=0.0), "radius", "positive"),
        (dataclasses.replace(DISC, radius=math.nan), "radius", "positive"),
        (dataclasses.replace(DISC, radius=math.inf), "radius", "positive"),
        (dataclasses.replace(DISC, centre=(0.1, 0.2, 0.3)), "centre", "3 coordinates, the motion has 2"),
        (dataclasses.replace(DISC, centre=(0.1, math.inf)), "centre", "finite"),
        (dataclasses.replace(DISC, velocity=(math.nan, 0.0)), "velocity", "finite"),
        (dataclasses.replace(DISC, velocity=(0.1, 0.0, 0.0)), "velocity", "3 coordinates"),
        (dataclasses.replace(BRICK, half_extents=(0.3, 0.0)), "half_extents", "positive"),
        (dataclasses.replace(BRICK, half_extents=(-0.3, 0.4)), "half_extents", "positive"),
        (dataclasses.replace(BRICK, half_extents=(math.nan, 0.4)), "half_extents", "finite"),
        (dataclasses.replace(BRICK, half_extents=(0.3, 0.4, 0.5)), "half_extents", "3 coordinates"),
        (dataclasses.replace(BRICK, rounding=-0.1), "rounding", "0 or more metres, not -0.1"),
        (dataclasses.replace(BRICK, rounding=math.nan), "rounding", "0 or more"),
        (dataclasses.replace(BRICK, rounding=math.inf), "rounding", "0 or more"),
        (dataclasses.replace(BRICK, centre=(0.1, 0.2, 0.3)), "centre", "3 coordinates"),
        (dataclasses.replace(BRICK, rotation=(0.0, 0.0, 0.0, 1.0)), "rotation", "one angle, rad"),
        (dataclasses.replace(BRICK, rotation=(math.nan,)), "rotation", "one angle, rad"),
        (dataclasses.replace(EGG, semi_axes=(0.3, 0.0)), "semi_axes", "positive"),
        (dataclasses.replace(EGG, semi_axes=(0.3, math.inf)), "semi_axes", "finite"),
        (dataclasses.replace(EGG, semi_axes=(0.3, 0.4, 0.5)), "semi_axes", "3 coordinates"),
        (dataclasses.replace(EGG, velocity=(0.0, math.inf)), "velocity", "finite"),
        (dataclasses.replace(EGG, rotation=()), "rotation", "one angle, rad"),
    ],
)
def test_obstacles_that_have_no_meaning_are_refused(obstacle: Obstacle, name: str, says: str) -> None:
    with pytest.raises(ParameterError, match=says) as error:
        shapes_of([DISC, BRICK, obstacle], 2, AT)
    assert error.value.location == f"{AT}.2.{name}"


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ((0.0, 0.0, 0.0, 2.0), "unit quaternion x y z w; its length is 2"),
        ((0.0, 0.0, 0.0, 0.0), "its length is 0"),
        ((0.0, 0.0, 0.0, 1.00001), "its length is 1.00001"),
        ((0.5,), "unit quaternion x y z w, not"),
        ((0.0, 0.0, 0.0, math.nan), "unit quaternion x y z w, not"),
    ],
)
def test_a_rotation_in_space_is_a_unit_quaternion(given: tuple[float, ...], says: str) -> None:
    brick = Box(centre=(0.0, 0.0, 0.0), half_extents=(1.0, 1.0, 1.0), rotation=given)
    with pytest.raises(ParameterError, match=says) as error:
        shapes_of([brick], 3, AT)
    assert error.value.location == f"{AT}.0.rotation"


def test_rotations_by_hand() -> None:
    half = math.sqrt(0.5)
    assert rotation([math.pi / 2], 2, AT) == pytest.approx(np.array([[0.0, -1.0], [1.0, 0.0]]), abs=1e-15)
    assert rotation([math.pi / 6], 2, AT) == pytest.approx(
        np.array([[math.sqrt(0.75), -0.5], [0.5, math.sqrt(0.75)]]), rel=1e-15
    )
    # Quarter turns about x, y and z take y to z, z to x and x to y.
    for axis in range(3):
        quarter = [0.0, 0.0, 0.0, half]
        quarter[axis] = half
        matrix = rotation(quarter, 3, AT)
        assert matrix[:, axis] == pytest.approx(np.eye(3)[axis], abs=1e-15)
        assert matrix[:, (axis + 1) % 3] == pytest.approx(np.eye(3)[(axis + 2) % 3], abs=1e-15)
    # A third of a turn about the diagonal moves each axis to the next.
    assert rotation([0.5, 0.5, 0.5, 0.5], 3, AT) == pytest.approx(np.eye(3)[[2, 0, 1]], abs=1e-15)


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: math.hypot(*q) > 0.1))
def test_quaternions_are_read_as_x_y_z_w(given: list[float]) -> None:
    unit = np.array(given) / math.hypot(*given)
    matrix = rotation(unit.tolist(), 3, AT)
    assert matrix == pytest.approx(Rotation.from_quat(unit).as_matrix(), abs=1e-14)
    # A length within the tolerance is no stretch; the opposite quaternion is the same rotation.
    assert rotation((unit * (1.0 + 9e-7)).tolist(), 3, AT) == pytest.approx(matrix, abs=1e-14)
    assert rotation((-unit).tolist(), 3, AT) == pytest.approx(matrix, abs=1e-15)


def test_a_cover_is_the_sphere_about_the_centre() -> None:
    obstacles: list[Obstacle] = [
        Box(centre=(1.0, 2.0), half_extents=(3.0, 4.0), rounding=1.0, velocity=(0.1, 0.0), cover=True),
        Box(centre=(1.0, 2.0), half_extents=(3.0, 4.0)),
        Ellipsoid(centre=(5.0, 6.0), semi_axes=(2.0, 5.0), rotation=(0.3,), cover=True),
        Ellipsoid(centre=(5.0, 6.0), semi_axes=(2.0, 5.0)),
        Sphere(centre=(7.0, 8.0), radius=0.5),
    ]
    cover = to_be_covered(obstacles)
    assert cover == [True, False, True, False, False]
    shapes = shapes_of(obstacles, 2, AT)
    before = shapes.measures.copy()
    seen = covered(shapes, cover)
    assert seen.kinds.tolist() == [SPHERE, BOX, SPHERE, ELLIPSOID, SPHERE]
    assert seen.radii.tolist() == [6.0, 0.0, 5.0, 0.0, 0.5]
    assert seen.measures[:, REACH].tolist() == [6.0, 5.0, 5.0, 5.0, 0.5]
    assert seen.measures[[1, 3], SIZES:].tolist() == [[3.0, 4.0], [2.0, 5.0]]
    assert (seen.centres == shapes.centres).all()
    assert seen.velocities[0].tolist() == [0.1, 0.0]
    assert (shapes.measures == before).all()
    assert shapes.kinds.tolist() == [BOX, BOX, ELLIPSOID, ELLIPSOID, SPHERE]


@given(seeds, dimensions, st.sampled_from((BOX, ELLIPSOID)))
def test_a_cover_holds_what_it_covers_and_touches_it(seed: int, d: int, kind: int) -> None:
    generator = np.random.default_rng(seed)
    sizes = tuple(generator.uniform(0.05, 0.5, size=d).tolist())
    turned = tuple(generator.uniform(-3.0, 3.0, size=1).tolist())
    if d == 3:
        turned = tuple(Rotation.from_matrix(random_rotation(3, seed)).as_quat().tolist())
    one: Obstacle = Ellipsoid(centre=(0.0,) * d, semi_axes=sizes, rotation=turned)
    if kind == BOX:
        one = Box(centre=(0.0,) * d, half_extents=sizes, rounding=0.05, rotation=turned)
    shapes = shapes_of([one], d, AT)
    sphere, normal = covered(shapes, [True]), np.empty(d)
    across = generator.normal(size=(300, d))
    across *= sphere.radii[0] / np.linalg.norm(across, axis=1, keepdims=True)
    # No point of the sphere's surface is inside; the tip is on both.
    assert min(distance_at(shapes, 0, x, normal) for x in across) >= -1e-15
    frame = shapes.frames[0]
    far = frame @ np.array(sizes) if kind == BOX else frame[:, int(np.argmax(sizes))]
    tip = far * sphere.radii[0] / np.linalg.norm(far)
    assert distance_at(shapes, 0, tip, normal) == pytest.approx(0.0, abs=1e-14)


def test_two_spheres_that_overlap_are_merged() -> None:
    # From -1 to 2.5 along x.
    seen = merged(discs((0.0, 0.0, 1.0), (1.5, 0.0, 1.0)), 0.0)
    assert seen.number == 1
    assert seen.kinds.tolist() == [SPHERE]
    assert seen.centres[0] == pytest.approx([0.75, 0.0], abs=1e-7)
    assert seen.radii[0] == pytest.approx(1.75, rel=1e-7)
    assert seen.measures[0, REACH] == seen.radii[0]
    # One that lies in another is lost in it.
    seen = merged(discs((0.0, 0.0, 3.0), (1.0, 1.0, 0.5)), 0.0)
    assert seen.number == 1
    assert seen.centres[0] == pytest.approx([0.0, 0.0], abs=1e-7)
    assert seen.radii[0] == pytest.approx(3.0, rel=1e-7)


def test_spheres_that_are_apart_are_left_as_they_are() -> None:
    shapes = discs((0.0, 0.0, 1.0), (2.5, 0.0, 1.0))
    assert merged(shapes, 0.0) is shapes
    # The gap is 0.5: with margins of 0.25 there is no room between them.
    assert merged(shapes, 0.24) is shapes
    (radius,) = merged(shapes, 0.25).radii
    assert radius == pytest.approx(2.25, rel=1e-7)  # the margin is not part of it


def test_a_sphere_that_has_grown_is_merged_with_what_it_overlaps() -> None:
    # The first two touch; the third reaches neither, but the disc of radius 2 about (1, 0) that holds them.
    pair, third = ((0.0, 0.0, 1.0), (2.0, 0.0, 1.0)), (1.0, 2.4, 0.5)
    alone = discs(pair[0], third), discs(pair[1], third)
    assert all(merged(shapes, 0.0) is shapes for shapes in alone)
    seen = merged(discs(*pair, third), 0.0)
    # From y = -2, the end of that disc, to 2.9.
    assert seen.number == 1
    assert seen.centres[0] == pytest.approx([1.0, 0.45], abs=1e-7)
    assert seen.radii[0] == pytest.approx(2.45, rel=1e-7)


def test_a_chain_is_merged_and_others_keep_their_order() -> None:
    # 0-1-2 touch in a row, from -1 to 5; 3 and 4 are far.
    seen = merged(
        discs((9.0, 9.0, 0.5), (0.0, 0.0, 1.0), (4.0, 0.0, 1.0), (-9.0, 9.0, 0.25), (2.0, 0.0, 1.0)),
        0.0,
    )
    assert seen.radii == pytest.approx([0.5, 3.0, 0.25], rel=1e-7)
    assert seen.centres == pytest.approx(np.array([[9.0, 9.0], [2.0, 0.0], [-9.0, 9.0]]), abs=1e-6)


def test_spheres_that_one_joins_are_merged_at_once() -> None:
    # The last touches the other two, which are apart. Two by two, the result would have the radius 2.6.
    seen = merged(discs((-1.5, 0.0, 1.0), (1.5, 0.0, 1.0), (0.0, 1.0, 1.0)), 0.0)
    assert seen.centres == pytest.approx(np.zeros((1, 2)), abs=1e-6)
    assert seen.radii == pytest.approx([2.5], rel=1e-7)


def test_only_spheres_of_one_velocity_are_merged() -> None:
    places, radii = np.array([[0.0, 0.0], [1.0, 0.0]]), np.ones(2)
    apart = spheres(places, radii, np.array([[0.1, 0.0], [0.0, 0.0]]))
    assert merged(apart, 0.0) is apart
    together = merged(spheres(places, radii, np.array([[0.1, 0.2], [0.1, 0.2]])), 0.0)
    assert together.velocities.tolist() == [[0.1, 0.2]]
    assert together.radii == pytest.approx([1.5], rel=1e-7)


def test_boxes_and_ellipsoids_are_not_merged_unless_they_are_covered() -> None:
    shapes = shapes_of([BRICK, EGG, DISC], 2, AT)
    assert merged(shapes, 0.1) is shapes
    seen = merged(covered(shapes, [True, False, False]), 0.1)
    assert seen.kinds.tolist() == [SPHERE, ELLIPSOID]
    assert seen.radii[0] == pytest.approx(0.5, rel=1e-7)
    assert seen.measures[1, SIZES:].tolist() == [0.3, 0.4]


@settings(max_examples=50)
@given(seeds, dimensions, st.integers(1, 7), st.floats(0.0, 0.2))
def test_merged_spheres_are_disjoint_and_hold_all(seed: int, d: int, n: int, margin: float) -> None:
    shapes = random_spheres(np.random.default_rng(seed), n, d)
    seen = merged(shapes, margin)
    for i in range(n):
        moving = (seen.velocities == shapes.velocities[i]).all(axis=1)
        assert any(holds(seen, int(k), shapes, i) for k in np.flatnonzero(moving))
    for k in range(seen.number):
        for i in range(k):
            apart = np.linalg.norm(seen.centres[k] - seen.centres[i])
            if (seen.velocities[k] == seen.velocities[i]).all():
                assert apart > seen.radii[k] + seen.radii[i] + 2.0 * margin
    assert merged(seen, margin) is seen


def test_enclosing_by_hand() -> None:
    centre, radius = enclosing(np.array([[1.0, 2.0, 3.0]]), np.array([0.5]))
    assert centre == pytest.approx([1.0, 2.0, 3.0], abs=1e-7)
    assert radius == pytest.approx(0.5, rel=1e-7)
    # Three of radius 1 at the corners of a triangle of sides 2 sqrt 3: the circle through the corners has radius 2.
    corners = 2.0 * np.array([[math.cos(a), math.sin(a)] for a in (0.1, 0.1 + 2 * math.pi / 3, 0.1 - 2 * math.pi / 3)])
    centre, radius = enclosing(corners + 5.0, np.ones(3))
    assert centre == pytest.approx([5.0, 5.0], abs=1e-6)
    assert radius == pytest.approx(3.0, rel=1e-7)
    # Unequal ones in a row, from -3 to 4; the middle one does not matter.
    centre, radius = enclosing(np.array([[0.0, 0.0], [1.0, 0.5], [3.5, 0.0]]), np.array([3.0, 0.1, 0.5]))
    assert centre == pytest.approx([0.5, 0.0], abs=1e-6)
    assert radius == pytest.approx(3.5, rel=1e-7)
    # Two points in space.
    centre, radius = enclosing(np.array([[0.0, 0.0, 0.0], [2.0, 4.0, 4.0]]), np.zeros(2))
    assert centre == pytest.approx([1.0, 2.0, 2.0], abs=1e-6)
    assert radius == pytest.approx(3.0, rel=1e-7)


def smallest(centres: Array, radii: Array) -> float:
    """The radius of the smallest sphere that holds spheres, by a cone program."""
    n, d = centres.shape
    A = np.zeros((n * (d + 1), d + 1))
    b = np.zeros(n * (d + 1))
    for i in range(n):  # |c - c_i| <= R - r_i
        at = i * (d + 1)
        A[at, d], b[at] = -1.0, -radii[i]
        A[at + 1 : at + 1 + d, :d], b[at + 1 : at + 1 + d] = -np.eye(d), -centres[i]
    quiet = clarabel.DefaultSettings()
    quiet.verbose = False
    found = clarabel.DefaultSolver(
        sparse.csc_matrix((d + 1, d + 1)),
        np.append(np.zeros(d), 1.0),
        sparse.csc_matrix(A),
        b,
        [clarabel.SecondOrderConeT(d + 1)] * n,
        quiet,
    ).solve()
    return float(found.x[-1])


@settings(max_examples=60)
@given(seeds, dimensions, st.integers(1, 7), st.floats(-4.0, 3.0), st.sampled_from((1e-3, 0.3, 3.0)))
def test_enclosing_holds_all_and_is_the_smallest(seed: int, d: int, n: int, power: float, size: float) -> None:
    generator = np.random.default_rng(seed)
    centres, radii = generator.normal(size=(n, d)), size * generator.uniform(size=n)
    scale = 10.0**power
    centre, radius = enclosing(scale * centres, scale * radii)
    assert (np.linalg.norm(scale * centres - centre, axis=1) + scale * radii <= radius).all()
    assert radius <= scale * smallest(centres, radii) * (1.0 + 1e-6) + 1e-9 * scale


def test_inside_counts_the_margin() -> None:
    shapes = discs((0.0, 0.0, 1.0), (5.0, 0.0, 1.0))
    assert inside(shapes, 0.0, np.array([0.5, 0.0]))
    assert inside(shapes, 0.0, np.array([5.5, 0.0]))
    assert not inside(shapes, 0.0, np.array([1.0, 0.0]))
    assert not inside(shapes, 0.25, np.array([1.25, 0.0]))
    assert inside(shapes, 0.25, np.array([1.2, 0.0]))
    assert not inside(no_shapes(2), 1.0, np.zeros(2))


NEAR = discs((0.0, 0.0, 1.0), (1.8, 0.0, 1.0))
"""Merged: a disc of radius 1.9 about (0.9, 0), which holds (0.9, 1.5), where neither does."""


@pytest.mark.parametrize(
    ("start", "goal", "margin", "recover", "expected"),
    [
        ((9.0, 9.0), (-9.0, 0.0), 0.0, False, None),
        ((9.0, 9.0), (0.5, 0.0), 0.0, False, Outcome.GOAL_INSIDE),
        ((9.0, 9.0), (0.5, 0.0), 0.0, True, Outcome.GOAL_INSIDE),
        ((9.0, 9.0), (-1.2, 0.0), 0.25, False, Outcome.GOAL_INSIDE),  # within the margin
        ((9.0, 9.0), (-1.2, 0.0), 0.15, False, None),
        ((0.5, 0.0), (-9.0, 0.0), 0.0, False, Outcome.START_INSIDE),
        ((0.5, 0.0), (-9.0, 0.0), 0.0, True, None),
        ((-1.2, 0.0), (-9.0, 0.0), 0.25, False, Outcome.START_INSIDE),
        ((0.5, 0.0), (0.5, 0.1), 0.0, False, Outcome.GOAL_INSIDE),
        ((0.9, 1.5), (-9.0, 0.0), 0.0, False, Outcome.SWALLOWED),
        ((0.9, 1.5), (-9.0, 0.0), 0.0, True, None),
        ((9.0, 9.0), (0.9, 1.5), 0.0, False, Outcome.SWALLOWED),
        ((9.0, 9.0), (0.9, 1.5), 0.0, True, Outcome.SWALLOWED),
        ((0.5, 0.0), (0.9, 1.5), 0.0, True, Outcome.SWALLOWED),
        ((0.5, 0.0), (0.9, 1.5), 0.0, False, Outcome.START_INSIDE),
    ],
)
def test_what_cannot_begin_is_refused(
    start: tuple[float, float], goal: tuple[float, float], margin: float, recover: bool, expected: Outcome | None
) -> None:
    seen = merged(NEAR, margin)
    assert seen.number == 1
    assert refusal(NEAR, seen, margin, np.array(start), np.array(goal), recover=recover) is expected


def resolved(given: Avoidance, dt: float = 0.01, v_max: float = math.inf) -> scratch.Avoidance:
    """A method completed for demonstrations of at most 0.2 m/s."""
    return resolve_avoidance(given, 0.2, dt, v_max, METHOD)


def test_roas_plus_is_completed() -> None:
    assert resolved(RoasPlusParameters()) == scratch.Avoidance(
        scratch.ROAS_PLUS,
        rate=RATE,
        gain=1.0,
        margin=0.0,
        swiftness=1.5,
        speed_limit=SPEED_LIMIT * 0.2,
        fastest=math.inf,
        detour=True,
    )
    given = RoasPlusParameters(
        rate=7.0, gain=0.5, margin=0.01, swiftness=2.0, speed_limit=0.9, detour=False, recover=True, merge=False
    )
    assert resolved(given, v_max=0.7) == scratch.Avoidance(
        scratch.ROAS_PLUS,
        rate=7.0,
        gain=0.5,
        margin=0.01,
        swiftness=2.0,
        speed_limit=REACHED * 0.7,
        fastest=REACHED * 0.7,
        detour=False,
    )


def test_the_other_methods_are_completed() -> None:
    assert resolved(NoAvoidance()) == scratch.Avoidance(scratch.NONE)
    assert resolved(RoasParameters(unit=0.25)) == scratch.Avoidance(scratch.ROAS, gain=4.0)
    assert resolved(ModulationParameters(reactivity=2.0, margin=0.1)) == scratch.Avoidance(
        scratch.MODULATION, gain=2.0, margin=0.1
    )
    assert resolved(ApfParameters()) == scratch.Avoidance(
        scratch.APF, reach=0.0, gain=PUSH * 0.2, speed_limit=SPEED_LIMIT * 0.2
    )
    assert resolved(ApfParameters(range=0.3, gain=0.4, speed_limit=0.5)) == scratch.Avoidance(
        scratch.APF, reach=0.3, gain=0.4, speed_limit=0.5
    )
    assert resolved(CbfParameters(margin=0.1)) == scratch.Avoidance(
        scratch.CBF, rate=RATE, margin=0.1, speed_limit=SPEED_LIMIT * 0.2, fastest=math.inf
    )


@pytest.mark.parametrize("kind", [RoasPlusParameters, CbfParameters])
@pytest.mark.parametrize(("dt", "rate"), [(0.001, 10.0), (0.01, 10.0), (0.1, 10.0), (0.125, 8.0), (0.5, 2.0)])
def test_the_default_rate_is_ten_or_what_the_clock_allows(
    kind: type[RoasPlusParameters] | type[CbfParameters], dt: float, rate: float
) -> None:
    assert resolved(kind(), dt=dt).rate == pytest.approx(rate, rel=1e-15)


@pytest.mark.parametrize("kind", [RoasPlusParameters, CbfParameters])
def test_a_rate_that_would_jump_into_obstacles_is_refused(
    kind: type[RoasPlusParameters] | type[CbfParameters],
) -> None:
    assert resolved(kind(rate=100.0), dt=0.01).rate == 100.0  # the whole distance at most
    with pytest.raises(ParameterError, match="1/dt = 100 is safe") as error:
        resolved(kind(rate=101.0), dt=0.01)
    assert error.value.location == f"{METHOD}.rate"
    assert "101 1/s with dt = 0.01 s" in error.value.problem


@given(st.floats(1e-4, 10.0))
def test_the_rate_that_a_refusal_names_is_accepted(dt: float) -> None:
    assert resolved(RoasPlusParameters(rate=1.0 / dt), dt=dt).rate == 1.0 / dt
    with pytest.raises(ParameterError, match="safe"):
        resolved(RoasPlusParameters(rate=1.001 / dt), dt=dt)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -0.5])
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (RoasParameters, "unit"),
        (RoasPlusParameters, "rate"),
        (RoasPlusParameters, "gain"),
        (RoasPlusParameters, "margin"),
        (RoasPlusParameters, "swiftness"),
        (RoasPlusParameters, "speed_limit"),
        (ApfParameters, "range"),
        (ApfParameters, "gain"),
        (ApfParameters, "speed_limit"),
        (ModulationParameters, "reactivity"),
        (ModulationParameters, "margin"),
        (CbfParameters, "rate"),
        (CbfParameters, "margin"),
        (CbfParameters, "speed_limit"),
    ],
)
def test_numbers_of_a_method_that_have_no_meaning_are_refused(kind: type[Avoidance], name: str, wrong: float) -> None:
    with pytest.raises(ParameterError, match=r"(positive number|finite number, [01] or more), not") as error:
        resolved(kind(**{name: wrong}))  # type: ignore[arg-type]
    assert error.value.location == f"{METHOD}.{name}"


@pytest.mark.parametrize("kind", [RoasPlusParameters, CbfParameters])
def test_no_step_is_faster_than_the_executed_state(kind: type[RoasPlusParameters] | type[CbfParameters]) -> None:
    assert 0.999 < REACHED < 1.0  # rounding, no more
    slow = resolved(kind(), v_max=0.1)
    assert slow.speed_limit == REACHED * 0.1
    assert slow.fastest == REACHED * 0.1
    assert resolved(kind(speed_limit=0.05), v_max=0.1).speed_limit == 0.05
    assert resolved(kind(), v_max=0.7).speed_limit == pytest.approx(0.3)


def test_the_margin_of_a_method() -> None:
    assert margin_of(RoasPlusParameters(margin=0.1)) == 0.1
    assert margin_of(CbfParameters(margin=0.2)) == 0.2
    assert margin_of(ModulationParameters(margin=0.3)) == 0.3
    for method in (NoAvoidance(), RoasParameters(), ApfParameters(), RoasPlusParameters()):
        assert margin_of(method) == 0.0


def test_outcomes_are_their_names() -> None:
    assert [str(outcome) for outcome in Outcome] == [
        "arrived",
        "timeout",
        "diverged",
        "collided",
        "infeasible",
        "too-fast",
        "trapped",
        "goal-inside",
        "start-inside",
        "not-gripped",
        "lost-box",
        "dropped",
        "held",
        "out-of-reach",
        "joint-limit",
        "singular",
        "misplaced",
        "swallowed",
    ]
    for outcome in Outcome:
        assert Outcome(str(outcome)) is outcome  # type: ignore[call-arg]
        assert pickle.loads(pickle.dumps(outcome)) is outcome
    # Those that a roll-out can end with; of the others some are refusals, some are of a box.
    refusals = {Outcome.GOAL_INSIDE, Outcome.START_INSIDE, Outcome.SWALLOWED}
    of_a_box = {Outcome.NOT_GRIPPED, Outcome.LOST_BOX, Outcome.DROPPED, Outcome.MISPLACED}
    of_arms = {Outcome.HELD, Outcome.OUT_OF_REACH, Outcome.JOINT_LIMIT, Outcome.SINGULAR}
    assert set(Outcome) - set(OUTCOMES) == refusals | of_a_box | of_arms


@pytest.mark.parametrize(
    ("outcome", "remedies"),
    [
        (Outcome.ARRIVED, ["nothing to do"]),
        (Outcome.TIMEOUT, ["rollout.max_duration", "rollout.stop_distance", "p_max", "gate", "v_max"]),
        (Outcome.DIVERGED, ["rollout.integrator = cayley", "rollout.dt"]),
        (Outcome.COLLIDED, ["kind roas+", "recover = true"]),
        (Outcome.INFEASIBLE, ["margin", "slow the obstacles down"]),
        (Outcome.TOO_FAST, ["speed_limit"]),
        (Outcome.TRAPPED, ["kind roas+", "detour = true", "cover = true"]),
        (Outcome.GOAL_INSIDE, ["move the obstacle", "radius", "margin"]),
        (Outcome.START_INSIDE, ["move the obstacle", "recover = true"]),
        (Outcome.NOT_GRIPPED, ["scene.start", "scene.box", "length_error", "squeeze"]),
        (Outcome.LOST_BOX, ["compliance = true", "force", "length_error"]),
        (Outcome.MISPLACED, ["force", "speed"]),
        (Outcome.SWALLOWED, ["set them apart", "merge = false"]),
    ],
)
def test_a_remedy_names_what_can_be_set(outcome: Outcome, remedies: Sequence[str]) -> None:
    assert outcome.remedy.endswith(".")
    for remedy in remedies:
        assert remedy in outcome.remedy
    # Whatever it sets is a parameter, of that type.
    settable = (RolloutParameters(), CarryCondition(), ClpvdsController(), RoasPlusParameters(), BRICK, DISC)
    for name, value in re.findall(r"([a-z_]+) = (\w+)", outcome.remedy):
        types = {type(getattr(one, name)) for one in settable if hasattr(one, name)}
        assert types == {bool if value in ("true", "false") else str}
    for name in re.findall(r"rollout\.([a-z_]+)", outcome.remedy):
        assert hasattr(RolloutParameters(), name)


def test_a_status_is_found_by_its_code() -> None:
    names = ("FREE", "ACTIVE", "DETOURING", "YIELDING", "INFEASIBLE", "TOO_FAST", "TRAPPED")
    assert [status.name for status in Status] == list(names)
    for name in names:
        assert list(Status)[getattr(scratch, name)] is Status[name]
    assert [str(status) for status in Status] == [
        "free",
        "active",
        "detouring",
        "yielding",
        "infeasible",
        "too-fast",
        "trapped",
    ]
    assert len({status.meaning for status in Status}) == len(Status)
    for status in Status:
        assert pickle.loads(pickle.dumps(status)) is status
        # Where V may rise, the meaning says so.
        may_rise = status in (Status.DETOURING, Status.YIELDING)
        assert ("V may rise" in status.meaning) is may_rise
