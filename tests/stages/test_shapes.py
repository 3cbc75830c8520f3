"""Distances from spheres, boxes and ellipsoids: by hand, against a minimisation, and what avoidance builds on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from motions import rotation
from scipy.optimize import minimize

from stages.policy.avoidance.shapes import (
    BOX,
    ELLIPSOID,
    RADIUS,
    REACH,
    SIZES,
    SPHERE,
    Shapes,
    distance_at,
    nearest_on_way,
    no_shapes,
    spheres,
)
from stages.trajectory import Array

KINDS = (SPHERE, BOX, ELLIPSOID)
seeds = st.integers(0, 2**32 - 1)
dimensions = st.sampled_from((2, 3))
kinds = st.sampled_from(KINDS)


def turn(angle: float) -> Array:
    """The matrix of a turn in the plane."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def shape(
    kind: int,
    sizes: tuple[float, ...],
    *,
    rounding: float = 0.0,
    centre: tuple[float, ...] | None = None,
    frame: Array | None = None,
) -> Shapes:
    """One box or ellipsoid, at the origin and along the coordinates unless it is said."""
    d = len(sizes)
    result = no_shapes(d, 1)
    result.kinds[0] = kind
    result.measures[0, SIZES:], result.measures[0, RADIUS] = sizes, rounding
    result.measures[0, REACH] = (math.hypot(*sizes) if kind == BOX else max(sizes)) + rounding
    if centre is not None:
        result.centres[0] = centre
    if frame is not None:
        result.frames[0] = frame
    return result


def random_shape(generator: np.random.Generator, kind: int, d: int) -> Shapes:
    """One shape of about a tenth, up to a hundred times as long as it is thin."""
    centre = 0.1 * generator.normal(size=d)
    if kind == SPHERE:
        return spheres(centre[None], np.array([0.1 * generator.uniform(0.1, 2.0)]))
    sizes = tuple((0.1 * 10.0 ** generator.uniform(-1.5, 0.5, size=d)).tolist())
    rounding = 0.05 * generator.uniform() if kind == BOX else 0.0
    frame = rotation(d, int(generator.integers(1 << 30)))
    return shape(kind, sizes, rounding=rounding, centre=tuple(centre.tolist()), frame=frame)


def about(generator: np.random.Generator, shapes: Shapes) -> Array:
    """A state that lies inside of a shape about as often as outside of it."""
    d = shapes.centres.shape[1]
    half = shapes.measures[0, SIZES:] + shapes.radii[0]
    return np.asarray(
        shapes.centres[0] + shapes.frames[0] @ (generator.normal(size=d) * half * generator.uniform(0.1, 2))
    )


def distance(shapes: Shapes, x: Array) -> tuple[float, Array]:
    """Distance and normal."""
    normal = np.full(x.shape[0], np.nan)
    return distance_at(shapes, 0, np.array(x, dtype=np.float64), normal), normal


def expect(shapes: Shapes, x: tuple[float, ...], away: float, normal: tuple[float, ...]) -> None:
    found, direction = distance(shapes, np.array(x))
    assert found == pytest.approx(away, rel=1e-14, abs=1e-15)
    assert direction == pytest.approx(normal, rel=1e-14, abs=1e-15)


def test_sphere_by_hand() -> None:
    disc = spheres(np.array([[1.0, 2.0]]), np.array([0.5]))
    expect(disc, (4.0, 6.0), 4.5, (0.6, 0.8))
    expect(disc, (1.0, 1.75), -0.25, (0.0, -1.0))
    expect(disc, (1.0, 2.0), -0.5, (1.0, 0.0))  # at the centre any direction leads out
    expect(spheres(np.zeros((1, 3)), np.array([1.0])), (2.0, -1.0, 2.0), 2.0, (2 / 3, -1 / 3, 2 / 3))


def test_room_for_obstacles_and_spheres_by_hand() -> None:
    empty = no_shapes(3)
    assert empty.number == 0
    assert empty.centres.shape == (0, 3)
    two = spheres(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([0.5, 0.25]), np.array([[0.0, 1.0], [0.0, 0.0]]))
    assert two.number == 2
    assert two.kinds.tolist() == [SPHERE, SPHERE]
    assert two.radii.tolist() == [0.5, 0.25]
    assert two.measures[:, REACH].tolist() == [0.5, 0.25]
    assert two.velocities.tolist() == [[0.0, 1.0], [0.0, 0.0]]
    assert (two.frames == np.eye(2)).all()
    assert (spheres(np.ones((1, 2)), np.ones(1)).velocities == 0.0).all()


def test_the_index_says_which_obstacle() -> None:
    two = spheres(np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([1.0, 2.0]))
    normal = np.empty(2)
    assert distance_at(two, 1, np.array([7.0, 0.0]), normal) == 1.0
    assert normal.tolist() == [-1.0, 0.0]


@pytest.mark.parametrize(
    ("x", "away", "normal"),
    [
        ((5.0, 0.5), 2.75, (1.0, 0.0)),  # beyond a face
        ((-0.5, -4.0), 2.75, (0.0, -1.0)),
        ((5.0, 5.0), 4.75, (0.6, 0.8)),  # beyond a corner: 3 and 4 from it
        ((-5.0, -5.0), 4.75, (-0.6, -0.8)),
        ((2.03, 1.04), 0.05 - 0.25, (0.6, 0.8)),  # in the rounding of a corner
        ((2.1, 0.0), 0.1 - 0.25, (1.0, 0.0)),
        ((1.5, 0.0), -0.75, (1.0, 0.0)),  # inside, by the nearest face
        ((0.5, -0.8), -0.45, (0.0, -1.0)),
        ((0.0, 0.0), -1.25, (0.0, 1.0)),
        ((2.0, 0.5), -0.25, (1.0, 0.0)),  # on a face of what is rounded
    ],
)
def test_box_in_the_plane_by_hand(x: tuple[float, ...], away: float, normal: tuple[float, ...]) -> None:
    box = shape(BOX, (2.0, 1.0), rounding=0.25)
    expect(box, x, away, normal)
    # The same, turned by a third and moved.
    frame = turn(math.pi / 3)
    turned = shape(BOX, (2.0, 1.0), rounding=0.25, centre=(10.0, -20.0), frame=frame)
    found, direction = distance(turned, np.array([10.0, -20.0]) + frame @ x)
    assert found == pytest.approx(away, abs=1e-14)
    assert direction == pytest.approx(frame @ normal, abs=1e-13)


def test_a_box_turned_by_an_eighth_by_hand() -> None:
    # A square of half extent 1 that stands on its corner reaches sqrt 2 along the axes, 1 along the diagonals.
    box = shape(BOX, (1.0, 1.0), frame=turn(math.pi / 4))
    expect(box, (3.0, 0.0), 3.0 - math.sqrt(2.0), (1.0, 0.0))
    expect(box, (3.0, 3.0), 3.0 * math.sqrt(2.0) - 1.0, (math.sqrt(0.5), math.sqrt(0.5)))


@pytest.mark.parametrize(
    ("x", "away", "normal"),
    [
        ((3.0, 5.0, 9.0), 7.0, (2 / 7, 3 / 7, 6 / 7)),  # a corner
        ((4.0, -6.0, 1.0), 5.0, (0.6, -0.8, 0.0)),  # an edge
        ((0.5, 1.0, -4.0), 1.0, (0.0, 0.0, -1.0)),  # a face
        ((0.5, -1.75, 1.0), -0.25, (0.0, -1.0, 0.0)),  # inside
    ],
)
def test_box_in_space_by_hand(x: tuple[float, ...], away: float, normal: tuple[float, ...]) -> None:
    expect(shape(BOX, (1.0, 2.0, 3.0)), x, away, normal)
    expect(shape(BOX, (1.0, 2.0, 3.0), rounding=0.125), x, away - 0.125, normal)
    # A quarter turn about z: x comes to lie along y, y along -x.
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    expect(shape(BOX, (1.0, 2.0, 3.0), frame=quarter), (-x[1], x[0], x[2]), away, (-normal[1], normal[0], normal[2]))


def test_ellipsoid_by_hand() -> None:
    ellipse = shape(ELLIPSOID, (2.0, 1.0))
    expect(ellipse, (5.0, 0.0), 3.0, (1.0, 0.0))
    expect(ellipse, (0.0, -4.0), 3.0, (0.0, -1.0))
    expect(ellipse, (2.0, 0.0), 0.0, (1.0, 0.0))
    # Level 1/4 inside: a bound of half the smaller semi-axis, where the truth is sqrt(2/3).
    expect(ellipse, (1.0, 0.0), -0.5, (1.0, 0.0))
    expect(ellipse, (0.0, 0.5), -0.5, (0.0, 1.0))
    expect(ellipse, (0.0, 0.0), -1.0, (1.0, 0.0))
    # The normal at (sqrt 2, sqrt 1/2) is (x/4, y), normed (1, 2)/sqrt 5: three metres along it.
    foot, normal = np.array([math.sqrt(2.0), math.sqrt(0.5)]), np.array([1.0, 2.0]) / math.sqrt(5.0)
    found, direction = distance(ellipse, foot + 3.0 * normal)
    assert found == pytest.approx(3.0, rel=1e-14)
    assert direction == pytest.approx(normal, rel=1e-14)
    expect(shape(ELLIPSOID, (3.0, 2.0, 1.0), centre=(1.0, 1.0, 1.0)), (1.0, 1.0, 5.0), 3.0, (0.0, 0.0, 1.0))
    expect(shape(ELLIPSOID, (2.0, 1.0), frame=turn(math.pi / 2)), (0.0, 5.0), 3.0, (0.0, 1.0))


def test_at_the_centre_of_an_ellipsoid_an_axis_leads_out() -> None:
    frame = rotation(3, 7)
    found, normal = distance(
        shape(ELLIPSOID, (3.0, 2.0, 1.0), centre=(1.0, 2.0, 3.0), frame=frame), np.arange(1.0, 4.0)
    )
    assert found == -1.0
    assert (normal == frame[:, 0]).all()


@given(seeds, dimensions, st.floats(-6, 1))
def test_an_ellipsoid_is_as_far_away_as_its_normal_is_long(seed: int, d: int, power: float) -> None:
    generator = np.random.default_rng(seed)
    ellipsoid, away = random_shape(generator, ELLIPSOID, d), 10.0**power
    sizes, frame = ellipsoid.measures[0, SIZES:], ellipsoid.frames[0]
    on_ball = generator.normal(size=d)
    on_ball[generator.uniform(size=d) < 0.3] = 0.0  # often in a plane of symmetry
    on_ball = on_ball / np.linalg.norm(on_ball) if on_ball.any() else np.eye(d)[0]
    normal = on_ball / sizes
    normal /= np.linalg.norm(normal)
    found, direction = distance(ellipsoid, ellipsoid.centres[0] + frame @ (sizes * on_ball + away * normal))
    assert found == pytest.approx(away, rel=1e-9, abs=1e-13)
    assert direction == pytest.approx(frame @ normal, abs=1e-9)


@settings(max_examples=40)
@given(seeds, dimensions)
def test_the_distance_from_an_ellipsoid_is_that_of_a_minimisation(seed: int, d: int) -> None:
    generator = np.random.default_rng(seed)
    ellipsoid = random_shape(generator, ELLIPSOID, d)
    sizes, at = ellipsoid.measures[0, SIZES:], 0.3 * generator.normal(size=d)
    assume(np.linalg.norm(at / sizes) > 1.0)
    found, _ = distance(ellipsoid, ellipsoid.centres[0] + ellipsoid.frames[0] @ at)
    # In the unit ball u, the point sizes * u that is nearest.
    nearest = minimize(
        lambda u: float(((sizes * u - at) ** 2).sum()),
        0.9 * at / sizes / np.linalg.norm(at / sizes),
        jac=lambda u: 2.0 * sizes * (sizes * u - at),
        constraints={"type": "ineq", "fun": lambda u: 1.0 - (u**2).sum(), "jac": lambda u: -2.0 * u},
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 500},
    )
    assert found == pytest.approx(math.sqrt(nearest.fun), abs=1e-6)


@settings(max_examples=40)
@given(seeds, dimensions, st.floats(0.0, 0.999))
def test_inside_an_ellipsoid_the_surface_is_no_nearer_than_the_bound(seed: int, d: int, share: float) -> None:
    generator = np.random.default_rng(seed)
    ellipsoid = random_shape(generator, ELLIPSOID, d)
    on_ball = generator.normal(size=(20_000, d))
    on_ball /= np.linalg.norm(on_ball, axis=1, keepdims=True)
    sizes = ellipsoid.measures[0, SIZES:]
    found, _ = distance(ellipsoid, ellipsoid.centres[0] + ellipsoid.frames[0] @ (share * sizes * on_ball[0]))
    nearest = float(np.linalg.norm(sizes * (on_ball - share * on_ball[0]), axis=1).min())
    assert -nearest <= found < 0.0
    # Along a ray from the centre the bound is linear, from the smallest semi-axis to nothing.
    assert found == pytest.approx((share - 1.0) * sizes.min(), rel=1e-9, abs=1e-14)


@given(seeds, dimensions, kinds, st.floats(-2, 2))
def test_the_normal_is_a_unit_vector_everywhere(seed: int, d: int, kind: int, power: float) -> None:
    generator = np.random.default_rng(seed)
    one = random_shape(generator, kind, d)
    _, normal = distance(one, one.centres[0] + 10.0**power * generator.normal(size=d))
    assert np.linalg.norm(normal) == pytest.approx(1.0, rel=1e-12)


def slopes_at(shapes: Shapes, x: Array, h: float) -> Array:
    """Gradient of the distance by central differences."""
    return np.array([distance(shapes, x + h * e)[0] - distance(shapes, x - h * e)[0] for e in np.eye(len(x))]) / (2 * h)


@given(seeds, dimensions, kinds)
def test_outside_the_normal_is_the_gradient(seed: int, d: int, kind: int) -> None:
    generator = np.random.default_rng(seed)
    one = random_shape(generator, kind, d)
    x = about(generator, one)
    away, normal = distance(one, x)
    assume(away > 0.001)
    assert slopes_at(one, x, 1e-3 * away) == pytest.approx(normal, abs=1e-5)


@given(seeds, dimensions)
def test_inside_a_box_the_normal_is_the_gradient(seed: int, d: int) -> None:
    generator = np.random.default_rng(seed)
    box = random_shape(generator, BOX, d)
    sizes = box.measures[0, SIZES:]
    at = generator.uniform(0.1, 0.9, size=d) * generator.choice([-1.0, 1.0], size=d) * sizes
    nearest = np.sort(sizes - np.abs(at))
    assume(nearest[1] - nearest[0] > 0.1 * sizes.min())  # not by a ridge, where there is none
    x = box.centres[0] + box.frames[0] @ at
    assert slopes_at(box, x, 0.01 * float(sizes.min())) == pytest.approx(distance(box, x)[1], abs=1e-9)


@given(seeds, dimensions)
def test_inside_an_ellipsoid_the_normal_leads_along_the_gradient_of_the_bound(seed: int, d: int) -> None:
    generator = np.random.default_rng(seed)
    ellipsoid = random_shape(generator, ELLIPSOID, d)
    sizes, at = ellipsoid.measures[0, SIZES:], generator.normal(size=d)
    at *= generator.uniform(0.1, 0.9) / np.linalg.norm(at)
    x = ellipsoid.centres[0] + ellipsoid.frames[0] @ (sizes * at)
    slopes = slopes_at(ellipsoid, x, 1e-4 * float(sizes.min()))
    assert np.linalg.norm(slopes) < 1.0 + 1e-6
    assert slopes / np.linalg.norm(slopes) == pytest.approx(distance(ellipsoid, x)[1], abs=1e-5)


@given(seeds, dimensions, kinds, st.floats(0.0, 1.0))
def test_the_signed_distance_is_convex(seed: int, d: int, kind: int, share: float) -> None:
    generator = np.random.default_rng(seed)
    one = random_shape(generator, kind, d)
    start, end = about(generator, one), about(generator, one)
    between = distance(one, (1.0 - share) * start + share * end)[0]
    assert between <= (1.0 - share) * distance(one, start)[0] + share * distance(one, end)[0] + 1e-14


@given(seeds, dimensions, kinds)
def test_outside_the_tangent_lies_below_the_distance(seed: int, d: int, kind: int) -> None:
    generator = np.random.default_rng(seed)
    one = random_shape(generator, kind, d)
    x, y = about(generator, one), about(generator, one)
    away, normal = distance(one, x)
    assume(away >= 0.0)
    assert distance(one, y)[0] >= away + normal @ (y - x) - 1e-14


@given(seeds, dimensions, kinds)
def test_the_distance_moves_with_the_obstacle(seed: int, d: int, kind: int) -> None:
    generator = np.random.default_rng(seed)
    one = random_shape(generator, kind, d)
    x, shift, R = about(generator, one), generator.normal(size=d), rotation(d, seed)
    moved = one._replace(centres=one.centres @ R.T + shift, frames=np.ascontiguousarray(R @ one.frames[0])[None])
    away, normal = distance(one, x)
    away_moved, normal_moved = distance(moved, R @ x + shift)
    assert away_moved == pytest.approx(away, abs=1e-14)
    assert normal_moved == pytest.approx(R @ normal, abs=1e-9)


@given(seeds, dimensions, kinds)
def test_the_velocity_of_an_obstacle_is_not_part_of_its_distance(seed: int, d: int, kind: int) -> None:
    generator = np.random.default_rng(seed)
    one = random_shape(generator, kind, d)
    x = about(generator, one)
    assert distance(one._replace(velocities=generator.normal(size=(1, d))), x)[0] == distance(one, x)[0]


def least(shapes: Shapes, start: Array, end: Array) -> float:
    d = start.shape[0]
    return nearest_on_way(shapes, 0, np.array(start), np.array(end), np.empty(d), np.empty(d))


def test_nearest_on_a_way_by_hand() -> None:
    # Past, short of it, away from it, through it, and no way at all; a disc of radius 1/2, a square of half extent 1/2.
    disc, square = spheres(np.zeros((1, 2)), np.array([0.5])), shape(BOX, (0.5, 0.5))
    for start, end, of_disc, of_square in [
        ((-3.0, 1.0), (3.0, 1.0), 0.5, 0.5),
        ((-3.0, 0.0), (-2.0, 0.0), 1.5, 1.5),
        ((-2.0, 0.0), (-3.0, 0.0), 1.5, 1.5),
        ((-3.0, 0.0), (3.0, 0.0), -0.5, -0.5),
        ((0.0, 3.0), (3.0, 0.0), 1.5 * math.sqrt(2.0) - 0.5, math.sqrt(2.0)),
        ((0.0, 2.0), (0.0, 2.0), 1.5, 1.5),
    ]:
        assert least(disc, np.array(start), np.array(end)) == pytest.approx(of_disc, rel=1e-12)
        assert least(square, np.array(start), np.array(end)) == pytest.approx(of_square, rel=1e-9)


@settings(max_examples=60)
@given(seeds, dimensions, kinds)
def test_nearest_on_a_way_is_that_of_dense_samples(seed: int, d: int, kind: int) -> None:
    generator, n = np.random.default_rng(seed), 501
    one = random_shape(generator, kind, d)
    start, end = about(generator, one), about(generator, one)
    found = least(one, start, end)
    sampled = min(distance(one, start + share * (end - start))[0] for share in np.linspace(0.0, 1.0, n))
    # A distance changes by no more than the way: half of the space between samples.
    assert sampled - 0.5 * float(np.linalg.norm(end - start)) / (n - 1) <= found <= sampled + 1e-12


@given(seeds, dimensions, kinds, st.floats(0.0, 1.0))
def test_a_row_keeps_the_whole_step_clear(seed: int, d: int, kind: int, share: float) -> None:
    generator = np.random.default_rng(seed)
    one = random_shape(generator, kind, d)
    x = about(generator, one)
    step = about(generator, one) - x
    away, normal = distance(one, x)
    assume(away > 0.0)
    closing = -float(normal @ step)
    step += max(closing - share * away, 0.0) * normal  # now -normal . step <= share x distance
    assert least(one, x, x + step) >= (1.0 - share) * away - 1e-12
