"""The admissible point nearest to a wanted one: by hand, against an interior-point solver, and as a projection."""

from __future__ import annotations

import math
from collections.abc import Sequence

import clarabel
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import sparse

from stages.policy.avoidance.projection import SLACK, nearest
from stages.policy.avoidance.scratch import CENTRE, LIMIT, ROW, scratch
from stages.trajectory import Array

seeds = st.integers(0, 2**32 - 1)
dimensions = st.integers(2, 4)
numbers = st.integers(0, 6)


def project(
    target: Sequence[float] | Array,
    rows: Sequence[Sequence[float]] | Array = (),
    limits: Sequence[float] | Array = (),
    centre: Sequence[float] | Array | None = None,
    radius: float = math.inf,
) -> Array | None:
    """The answer, or none where there is no admissible point."""
    d, m = len(target), len(limits)
    room, out = scratch(m, d), np.full(d, np.nan)
    room.tables[ROW] = np.reshape(np.asarray(rows, dtype=np.float64), (m, d))
    room.columns[LIMIT] = limits
    room.vectors[CENTRE] = np.nan if centre is None else centre
    return out if nearest(np.array(target, dtype=np.float64), room, m, radius, out) else None


def peer(target: Array, rows: Array, limits: Array, centre: Array, radius: float) -> tuple[str, Array]:
    """Status and answer of an interior-point solver for the same program."""
    d, m = target.shape[0], limits.shape[0]
    A, b, cones = [rows], [limits], [clarabel.NonnegativeConeT(m)]
    if radius < math.inf:
        A += [np.zeros((1, d)), -np.eye(d)]
        b += [np.array([radius]), -centre]
        cones.append(clarabel.SecondOrderConeT(d + 1))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    found = clarabel.DefaultSolver(
        sparse.csc_matrix(np.eye(d)), -target, sparse.csc_matrix(np.vstack(A)), np.concatenate(b), cones, settings
    ).solve()
    return str(found.status), np.array(found.x)


def directions(generator: np.random.Generator, n: int, d: int) -> Array:
    result = generator.normal(size=(n, d))
    return np.asarray(result / np.linalg.norm(result, axis=1, keepdims=True))


def random_program(
    generator: np.random.Generator, d: int, m: int, ball: bool, empty: bool
) -> tuple[Array, Array, Array, Array, float]:
    """Target, rows, limits, centre and radius, of the size 1; where `empty`, perhaps nothing is admissible."""
    rows, centre = directions(generator, m, d), generator.normal(size=d)
    radius = float(generator.uniform(0.2, 2.0)) if ball else math.inf
    inner = centre + 0.7 * min(radius, 1.0) * generator.uniform() * directions(generator, 1, d)[0]
    limits = 0.7 * generator.normal(size=m) if empty else rows @ inner + 0.5 * generator.uniform(size=m)
    return 2.0 * generator.normal(size=d), rows, limits, centre, radius


def misses(y: Array, rows: Array, limits: Array, centre: Array, radius: float) -> float:
    """By how much a point misses what it misses most."""
    return float(max([*(rows @ y - limits), np.linalg.norm(y - centre) - radius]))


def test_nothing_is_in_the_way() -> None:
    for target in ([3.0, 4.0], [0.0, 0.0], [1.0, -2.0, 3.0]):
        assert project(target) == pytest.approx(target, abs=0.0)
    # To the bit within all rows and the ball, too.
    found = project([0.1, 0.2], [[1.0, 0.0], [0.0, -1.0]], [0.1, 7.0], [0.0, 0.0], 0.3)
    assert found is not None
    assert found.tolist() == [0.1, 0.2]


def test_the_ball_by_hand() -> None:
    assert project([3.0, 4.0], centre=[0.0, 0.0], radius=1.0) == pytest.approx([0.6, 0.8], rel=1e-15)
    assert project([1.0, 5.0], centre=[1.0, 1.0], radius=2.0) == pytest.approx([1.0, 3.0], rel=1e-15)
    assert project([1.0, 3.0, 3.0], centre=[1.0, 1.0, 1.0], radius=math.sqrt(2.0)) == pytest.approx([1.0, 2.0, 2.0])
    assert project([3.0, 4.0], centre=[1.0, 1.0], radius=0.0) == pytest.approx([1.0, 1.0], abs=1e-15)


def test_one_row_by_hand() -> None:
    assert project([3.0, 2.0], [[1.0, 0.0]], [1.0]) == pytest.approx([1.0, 2.0], rel=1e-15)
    # 5 along (0.6, 0.8), 1 is allowed.
    assert project([3.0, 4.0], [[0.6, 0.8]], [1.0]) == pytest.approx([0.6, 0.8], rel=1e-15)
    # A negative limit asks for motion.
    assert project([0.0, 1.0], [[1.0, 0.0]], [-2.0]) == pytest.approx([-2.0, 1.0], rel=1e-15)


def test_two_rows_by_hand() -> None:
    axes = [[1.0, 0.0], [0.0, 1.0]]
    assert project([3.0, 5.0], axes, [1.0, 2.0]) == pytest.approx([1.0, 2.0], rel=1e-15)
    assert project([3.0, 0.0], axes, [1.0, 2.0]) == pytest.approx([1.0, 0.0], rel=1e-15)
    assert project([0.0, 5.0], axes, [1.0, 2.0]) == pytest.approx([0.0, 2.0], rel=1e-15)
    # (2, 2) misses both rows, and the nearest point of the second's line keeps the first: 0.6 y0 + 0.8 y1 = 1.
    rows = [[1.0, 0.0], [0.6, 0.8]]
    assert project([2.0, 2.0], rows, [1.5, 1.0]) == pytest.approx([0.92, 0.56], rel=1e-14)
    # From (1, 0.5) + 1 (1, 0) + 2 (0.6, 0.8) both are active.
    assert project([3.2, 2.1], rows, [1.0, 1.0]) == pytest.approx([1.0, 0.5], rel=1e-14)
    # The same row twice, or one that is wider.
    assert project([3.0, 5.0], [axes[0], axes[0], axes[1]], [1.0, 1.0, 2.0]) == pytest.approx([1.0, 2.0])
    assert project([3.0, 5.0], [axes[0], axes[0], axes[1]], [4.0, 1.0, 2.0]) == pytest.approx([1.0, 2.0])
    # Between two rows that leave a single line.
    assert project([3.0, 5.0], [[1.0, 0.0], [-1.0, 0.0]], [1.0, -1.0]) == pytest.approx([1.0, 5.0])


def test_a_row_and_the_ball_by_hand() -> None:
    centre = [0.0, 0.0]
    # The corner of both; the row alone; the ball alone.
    assert project([3.0, 4.0], [[1.0, 0.0]], [0.6], centre, 1.0) == pytest.approx([0.6, 0.8], rel=1e-15)
    assert project([2.0, 0.0], [[1.0, 0.0]], [0.6], centre, 1.0) == pytest.approx([0.6, 0.0], abs=1e-15)
    assert project([3.0, 4.0], [[1.0, 0.0]], [0.7], centre, 1.0) == pytest.approx([0.6, 0.8], rel=1e-15)
    # The target is in the ball, its projection onto the row is not: y1 = 1.6 meets the circle of radius 2 at 1.2.
    assert project([1.9, 0.5], [[0.0, -1.0]], [-1.6], centre, 2.0) == pytest.approx([1.2, 1.6], rel=1e-14)
    # The row touches the ball.
    assert project([3.0, 4.0], [[-1.0, 0.0]], [-1.0], centre, 1.0) == pytest.approx([1.0, 0.0], abs=1e-6)


def test_three_rows_in_space_by_hand() -> None:
    assert project([4.0, 5.0, 6.0], np.eye(3), [1.0, 2.0, 3.0]) == pytest.approx([1.0, 2.0, 3.0], rel=1e-15)
    assert project([4.0, 0.0, 6.0], np.eye(3), [1.0, 2.0, 3.0]) == pytest.approx([1.0, 0.0, 3.0], rel=1e-15)
    # From (1, 1, 1) + 1 r1 + 2 r2 + 3 r3 all are active; with a fourth that is not in the way, too.
    rows = [[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.6, 0.8]]
    assert project([3.2, 4.4, 3.4], rows, [1.0, 1.4, 1.4]) == pytest.approx([1.0, 1.0, 1.0], rel=1e-14)
    spare = [[0.0, 0.0, -1.0], *rows]
    assert project([3.2, 4.4, 3.4], spare, [0.0, 1.0, 1.4, 1.4]) == pytest.approx([1.0, 1.0, 1.0], rel=1e-14)
    # From (2, 2, 1) + 1 (2, 2, 1) + 3 (1, 0, 0) + 5 (0, 1, 0) two rows and the sphere of radius 3 are.
    found = project([7.0, 9.0, 2.0], np.eye(3)[:2], [2.0, 2.0], [0.0, 0.0, 0.0], 3.0)
    assert found == pytest.approx([2.0, 2.0, 1.0], rel=1e-14)


@pytest.mark.parametrize(
    ("rows", "limits", "radius"),
    [
        ([[1.0, 0.0], [-1.0, 0.0]], [-1.0, 0.5], math.inf),  # left of -1 and right of -1/2
        ([[1.0, 0.0], [-1.0, 0.0]], [-1.0, 0.5], 10.0),
        ([[-1.0, 0.0]], [-2.0], 1.0),  # beyond the ball
        ([[-1.0, 0.0], [0.0, -1.0]], [-0.8, -0.8], 1.0),  # only their corner lies outside of it
        ([[-1.0, 0.0], [0.0, -1.0], [0.6, 0.8]], [-1.0, -1.0, 1.0], math.inf),  # three half planes
    ],
)
def test_no_admissible_point(rows: list[list[float]], limits: list[float], radius: float) -> None:
    for target in ([3.0, 4.0], [0.0, 0.1], [-5.0, 1.0]):
        assert project(target, rows, limits, [0.0, 0.0], radius) is None


def test_only_as_many_rows_count_as_are_said() -> None:
    room, out = scratch(2, 2), np.empty(2)
    room.tables[ROW], room.columns[LIMIT] = np.eye(2), 1.0
    target = np.array([3.0, 4.0])
    assert nearest(target, room, 1, math.inf, out)
    assert out == pytest.approx([1.0, 4.0])
    assert target.tolist() == [3.0, 4.0]
    assert room.tables[ROW].tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert room.columns[LIMIT].tolist() == [1.0, 1.0]


@settings(max_examples=300)
@given(seeds, dimensions, numbers, st.booleans(), st.booleans())
def test_it_agrees_with_an_interior_point_solver(seed: int, d: int, m: int, ball: bool, empty: bool) -> None:
    program = random_program(np.random.default_rng(seed), d, m, ball, empty)
    found, (status, there) = project(*program), peer(*program)
    if "Infeasible" in status:
        assert found is None
    else:
        assert found is not None
        # An interior-point answer is as near as its duality gap says, about 1e-8: its square root in the variables.
        assert found == pytest.approx(there, rel=1e-4, abs=3e-4)


@given(seeds, dimensions, numbers, st.booleans(), st.booleans())
def test_the_answer_is_admissible(seed: int, d: int, m: int, ball: bool, empty: bool) -> None:
    target, rows, limits, centre, radius = random_program(np.random.default_rng(seed), d, m, ball, empty)
    found = project(target, rows, limits, centre, radius)
    if found is None:
        assert empty
        return
    scale = max(float(np.abs([target, centre]).max()), 1.0, *np.abs(limits), 0.0 if math.isinf(radius) else radius)
    assert misses(found, rows, limits, centre, radius) <= 2.0 * SLACK * scale


@given(seeds, dimensions, numbers, st.booleans())
def test_no_admissible_point_is_nearer(seed: int, d: int, m: int, ball: bool) -> None:
    generator = np.random.default_rng(seed)
    target, rows, limits, centre, radius = random_program(generator, d, m, ball, False)
    found = project(target, rows, limits, centre, radius)
    assert found is not None
    # Admissible points about the answer, and others on the borders: the projections of other targets.
    about = list(found + directions(generator, 200, d) * 10.0 ** generator.uniform(-6.0, 0.5, size=(200, 1)))
    borders = [project(3.0 * other, rows, limits, centre, radius) for other in generator.normal(size=(20, d))]
    others = [y for y in about + borders if y is not None and misses(y, rows, limits, centre, radius) <= 1e-10]
    assert len(others) >= len(borders)
    # From the answer, every admissible point lies away from the target: for a convex program this is optimality.
    for y in others:
        away = y - found
        assert (target - found) @ away <= 1e-9 * float(np.linalg.norm(away)) + 1e-9
        assert np.linalg.norm(y - target) >= np.linalg.norm(found - target) - 1e-9


@given(seeds, dimensions, numbers, st.booleans(), st.booleans())
def test_projecting_twice_changes_nothing(seed: int, d: int, m: int, ball: bool, empty: bool) -> None:
    target, rows, limits, centre, radius = random_program(np.random.default_rng(seed), d, m, ball, empty)
    found = project(target, rows, limits, centre, radius)
    if found is not None:
        assert project(found, rows, limits, centre, radius) == pytest.approx(found, abs=1e-9)


@given(seeds, dimensions, numbers, st.booleans(), st.booleans(), st.floats(-9.0, 9.0))
def test_the_unit_of_length_does_not_matter(seed: int, d: int, m: int, ball: bool, empty: bool, power: float) -> None:
    target, rows, limits, centre, radius = random_program(np.random.default_rng(seed), d, m, ball, empty)
    scale = 10.0**power
    found = project(target, rows, limits, centre, radius)
    scaled = project(scale * target, rows, scale * limits, scale * centre, scale * radius)
    if found is None:
        assert scaled is None
    else:
        assert scaled == pytest.approx(scale * found, rel=1e-9, abs=1e-9 * scale)


@given(seeds, dimensions, st.integers(1, 6), st.booleans(), st.booleans())
def test_the_order_of_the_rows_does_not_matter(seed: int, d: int, m: int, ball: bool, empty: bool) -> None:
    generator = np.random.default_rng(seed)
    target, rows, limits, centre, radius = random_program(generator, d, m, ball, empty)
    order = generator.permutation(m)
    found, other = (project(target, rows[at], limits[at], centre, radius) for at in (np.arange(m), order))
    if found is None:
        assert other is None
    else:
        assert other == pytest.approx(found, abs=1e-9)


@given(seeds, dimensions, numbers, st.booleans())
def test_standing_is_admissible_where_no_row_asks_for_motion(seed: int, d: int, m: int, ball: bool) -> None:
    target, rows, _, centre, _ = random_program(np.random.default_rng(seed), d, m, ball, False)
    found = project(target, rows, np.zeros(m), centre, float(np.linalg.norm(centre)) if ball else math.inf)
    assert found is not None
    assert np.linalg.norm(found - target) <= np.linalg.norm(target) * (1.0 + 1e-9)


@given(seeds, st.sampled_from((0.0, 1e-20, 1e-9)))
def test_rows_that_ask_for_far_more_than_the_target(seed: int, limit: float) -> None:
    # Two lines that are not parallel always have a corner.
    rows = directions(np.random.default_rng(seed), 2, 2)
    assume(abs(np.linalg.det(rows)) > 0.1)
    assert project([0.0, 0.0], rows, [-1.0, limit]) is not None
