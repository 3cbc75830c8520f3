"""Swept error area and dynamic time warping on cases with known answers. Paper eq. (26)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import dblquad
from scipy.spatial.distance import cdist

from stages.evaluate.dtwd import quadrilateral_area, swept_error_area
from stages.paths import arc_length, dynamic_time_warping, resample_arc, resample_time

seeds = st.integers(0, 2**32 - 1)


def line(start: list[float], end: list[float], samples: int) -> np.ndarray:
    return np.linspace(start, end, samples)


def embed(path: np.ndarray, seed: int = 1) -> np.ndarray:
    """The plane, somewhere in space."""
    basis, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 2)))
    return path @ basis.T + [0.3, -2.0, 1.0]


def half_circle(radius: float, samples: int) -> np.ndarray:
    angle = np.linspace(0.0, math.pi, samples)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


UP = np.array([0.0, 7.0])
UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
BOW_TIE = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])


def test_area_of_known_quadrilaterals() -> None:
    assert quadrilateral_area(UNIT_SQUARE) == 1.0
    assert quadrilateral_area(BOW_TIE) == 0.5
    dart = np.array([[0.0, 0.0], [2.0, 0.0], [0.5, 0.5], [0.0, 2.0]])  # reflex corner: two triangles of area 1/2
    assert quadrilateral_area(dart) == pytest.approx(1.0, rel=1e-15)
    assert quadrilateral_area(np.zeros((4, 2))) == 0.0
    folded = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]])  # one corner on an edge: the triangle remains
    assert quadrilateral_area(folded) == 0.5


def test_area_of_crossed_quadrilateral_is_its_two_triangles_for_either_pair_of_edges() -> None:
    # Edges (0,0)-(3,0) and (2,1)-(2,-2) cross at (2, 0): triangles (2,0),(3,0),(2,1) and (2,0),(2,-2),(0,0).
    crossed = np.array([[0.0, 0.0], [3.0, 0.0], [2.0, 1.0], [2.0, -2.0]])
    assert quadrilateral_area(crossed) == pytest.approx(0.5 + 2.0, rel=1e-15)
    for shift in range(4):
        assert quadrilateral_area(np.roll(crossed, shift, axis=0)) == pytest.approx(2.5, rel=1e-15)
        assert quadrilateral_area(np.roll(crossed[::-1], shift, axis=0)) == pytest.approx(2.5, rel=1e-15)


@given(seeds)
def test_area_in_the_plane_is_the_area_of_the_even_odd_region(seed: int) -> None:
    vertices = np.random.default_rng(seed).uniform(size=(4, 2))
    # An independent count: the length inside along many horizontal lines.
    edges = np.roll(vertices, -1, axis=0)
    inside = 0.0
    levels = (np.arange(4000) + 0.5) / 4000
    with np.errstate(divide="ignore", invalid="ignore"):
        at = vertices[:, 0] + (levels[:, None] - vertices[:, 1]) / (edges[:, 1] - vertices[:, 1]) * (
            edges[:, 0] - vertices[:, 0]
        )
    hit = (vertices[:, 1] > levels[:, None]) != (edges[:, 1] > levels[:, None])
    for row, mask in zip(at, hit, strict=True):
        crossings = np.sort(row[mask])
        inside += (crossings[1::2] - crossings[::2]).sum()
    assert quadrilateral_area(vertices) == pytest.approx(inside / 4000, abs=2e-3)


def test_area_in_space_is_that_of_the_bilinear_patch() -> None:
    assert quadrilateral_area(embed(UNIT_SQUARE)) == pytest.approx(1.0, rel=1e-13)
    parallelogram = np.array([[0.0, 0.0], [2.0, 1.0], [2.5, 4.0], [0.5, 3.0]])
    assert quadrilateral_area(embed(parallelogram)) == pytest.approx(quadrilateral_area(parallelogram), rel=1e-13)
    trapezium = np.array([[0.0, 0.0], [4.0, 0.0], [3.0, 2.0], [1.0, 2.0]])
    assert quadrilateral_area(embed(trapezium)) == pytest.approx(6.0, rel=1e-13)
    assert quadrilateral_area(embed(BOW_TIE)) == pytest.approx(
        0.5, rel=2e-2
    )  # it folds: the quadrature is stated at 2 %
    # Edges along x at height 0 and along y at height 1: a quarter turn. S = (u, 0, 0)(1-v) + (0, u, 1)v.
    twisted = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])

    def element(v: float, u: float) -> float:
        along = np.array([1.0 - v, v, 0.0])
        across = np.array([-u, u, 1.0])
        return float(np.linalg.norm(np.cross(along, across)))

    exact, _ = dblquad(element, 0, 1, 0, 1, epsabs=1e-12)
    assert quadrilateral_area(twisted) == pytest.approx(exact, rel=1e-8)


def test_swept_error_area_of_known_paths() -> None:
    reference = line([0.0, 0.0], [100.0, 0.0], 51)
    assert swept_error_area(reference, reference) == 0.0
    assert swept_error_area(reference, reference + UP) == pytest.approx(700.0, rel=1e-12)
    for samples in (2, 3, 4, 50, 101):  # the crossing may fall on a sample or within a quadrilateral
        reference = line([0.0, 0.0], [100.0, 0.0], samples)
        crossing = line([0.0, -5.0], [100.0, 5.0], samples)
        assert swept_error_area(reference, crossing) == pytest.approx(250.0, rel=1e-12)
        fixed = np.tile([50.0, 5.0], (samples, 1))
        assert swept_error_area(reference, fixed) == pytest.approx(250.0, rel=1e-12)
    assert swept_error_area(half_circle(1.0, 4001), half_circle(2.0, 4001)) == pytest.approx(1.5 * math.pi, rel=1e-6)


def test_swept_error_area_of_planar_paths_is_the_same_in_space() -> None:
    reference, path = half_circle(1.0, 200), half_circle(2.0, 200)
    assert swept_error_area(embed(reference), embed(path)) == pytest.approx(
        swept_error_area(reference, path), rel=1e-12
    )
    reference = line([0.0, 0.0], [100.0, 0.0], 51)
    assert swept_error_area(embed(reference), embed(reference + UP)) == pytest.approx(700.0, rel=1e-12)


@given(seeds)
def test_swept_error_area_is_symmetric_and_scales_with_the_square(seed: int) -> None:
    generator = np.random.default_rng(seed)
    for d in (2, 3):
        a, b = generator.normal(size=(2, 20, d))
        area = swept_error_area(a, b)
        assert swept_error_area(b, a) == pytest.approx(area, rel=1e-12)
        assert swept_error_area(a[::-1], b[::-1]) == pytest.approx(area, rel=1e-12)
        assert swept_error_area(1e3 * a, 1e3 * b) == pytest.approx(1e6 * area, rel=1e-12)


def test_swept_error_area_refuses_paths_of_different_sampling() -> None:
    with pytest.raises(ValueError, match="one shape"):
        swept_error_area(np.zeros((5, 2)), np.zeros((6, 2)))
    with pytest.raises(ValueError, match="one shape"):
        swept_error_area(np.zeros((1, 2)), np.zeros((1, 2)))


def test_dynamic_time_warping_of_known_paths() -> None:
    a, b = np.array([[0.0], [1.0], [2.0]]), np.array([[0.0], [2.0]])
    assert dynamic_time_warping(a, b) == (1.0, 3)
    path = half_circle(1.0, 30)
    assert dynamic_time_warping(path, path) == (0.0, 30)
    assert dynamic_time_warping(path, np.repeat(path, 3, axis=0)) == (0.0, 90)
    reference = line([0.0, 0.0], [100.0, 0.0], 51)
    cost, pairs = dynamic_time_warping(reference, reference + UP)
    assert cost == pytest.approx(51 * 7.0, rel=1e-14)
    assert pairs == 51
    assert dynamic_time_warping(reference[:1], reference) == (pytest.approx(arc_length(reference).sum()), 51)


def naive(a: np.ndarray, b: np.ndarray) -> tuple[float, int]:
    """The textbook table, cell by cell; of equal costs the fewest pairs."""
    distance = cdist(a, b)
    table: dict[tuple[int, int], tuple[float, int]] = {(-1, -1): (0.0, 0)}
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            before = [table[at] for at in ((i - 1, j - 1), (i - 1, j), (i, j - 1)) if at in table]
            cost, pairs = min(before)
            table[i, j] = (cost + distance[i, j], pairs + 1)
    return table[a.shape[0] - 1, b.shape[0] - 1]


@given(seeds, st.integers(1, 12), st.integers(1, 12), st.integers(1, 3), st.booleans())
def test_dynamic_time_warping_is_the_textbook_table(seed: int, n: int, m: int, d: int, ties: bool) -> None:
    generator = np.random.default_rng(seed)
    a, b = generator.normal(size=(n, d)), generator.normal(size=(m, d))
    if ties:  # many equal costs: the tie rule decides the number of pairs
        a, b = np.zeros((n, d)), np.zeros((m, d))
        a[:, 0], b[:, 0] = generator.integers(0, 3, n), generator.integers(0, 3, m)
    cost, pairs = dynamic_time_warping(a, b)
    expected_cost, expected_pairs = naive(a, b)
    assert cost == pytest.approx(expected_cost, rel=1e-13)
    assert pairs == expected_pairs
    assert dynamic_time_warping(b, a) == (cost, pairs)


def test_dynamic_time_warping_refuses_what_has_no_distance() -> None:
    with pytest.raises(ValueError, match="one dimension"):
        dynamic_time_warping(np.zeros((4, 2)), np.zeros((4, 3)))
    with pytest.raises(ValueError, match="one dimension"):
        dynamic_time_warping(np.zeros((0, 2)), np.zeros((4, 2)))


def test_resampling_in_time_and_in_arc_length() -> None:
    time = np.array([0.0, 1.0, 3.0])
    path = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0]])
    assert resample_time(time, path, 4).tolist() == [[0, 0], [4, 0], [4, 1], [4, 2]]
    assert resample_arc(path, 4).tolist() == [[0, 0], [2, 0], [4, 0], [4, 2]]
    paused = path[[0, 0, 1, 1, 1, 2, 2]]
    assert resample_arc(paused, 4).tolist() == [[0, 0], [2, 0], [4, 0], [4, 2]]
    assert resample_arc(path[[1, 1, 1]], 3).tolist() == [[4, 0]] * 3
    assert resample_time(time[:1], path[:1], 3).tolist() == [[0, 0]] * 3
    with pytest.raises(ValueError, match="at least 2"):
        resample_time(time, path, 1)
    with pytest.raises(ValueError, match="empty"):
        resample_arc(np.zeros((0, 2)), 5)
