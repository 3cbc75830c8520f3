"""The translations that straighten a demonstration: by hand, how far they carry it, and in any frame and unit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from motions import goal, hook, moved, rotation, trajectory

from stages.dynamics.straighten import NARROWEST, SLOPE, STRIDE, match, mean_demonstration, straighten
from stages.dynamics.warp import STEEPEST, Warp

ACCURACY = 0.07
"""Of the way to the chord: how well 30 translations match; the ends, which meet it at right angles, are worst."""


def half_circle(n: int = 60) -> np.ndarray:
    """From (2, 0) to the origin, radius 1 m."""
    angle = np.linspace(0.0, math.pi, n)
    path = np.column_stack([1.0 + np.cos(angle), np.sin(angle)])
    return path - path[-1]


def chord(path: np.ndarray) -> np.ndarray:
    return np.linspace(1.0, 0.0, len(path))[:, None] * path[0]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).sum(axis=1).mean()))


def test_one_translation_by_hand() -> None:
    # The middle point is the only one that is off, by 1 m: it is moved half of that, as narrowly as is allowed.
    source = np.array([[2.0, 0.0], [1.0, 1.0], [0.0, 0.0]])
    target = np.array([[2.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    for narrowest, rate in ((0.1, SLOPE / (0.5 * STEEPEST)), (0.5, 1.0 / (math.sqrt(2.0) * 0.5))):
        image, centres, shifts, rates = source.copy(), np.empty((1, 2)), np.empty((1, 2)), np.empty(1)
        assert match(image, target, narrowest, centres, shifts, rates) == 1
        np.testing.assert_array_equal(centres, [[1.0, 1.0]])
        np.testing.assert_array_equal(shifts, [[0.0, -STRIDE]])
        assert rates[0] == pytest.approx(rate, rel=1e-12)
        beside = -STRIDE * math.exp(-2.0 * rate**2)
        np.testing.assert_allclose(image, [[2.0, beside], [1.0, 0.5], [0.0, beside]], atol=1e-15)


def test_as_wide_as_makes_the_error_smallest() -> None:
    # All points are off by the same, so that the widest translation is best.
    source = np.column_stack([np.linspace(0.0, 1.0, 11), np.zeros(11)])
    image, centres, shifts, rates = source.copy(), np.empty((1, 2)), np.empty((1, 2)), np.empty(1)
    match(image, source + np.array([0.0, 0.1]), 0.1, centres, shifts, rates)
    assert rates[0] == pytest.approx(0.88**39 / (math.sqrt(2.0) * 0.1), rel=1e-12)
    np.testing.assert_allclose(image[:, 1], 0.05, atol=2e-4)


def test_the_mean_demonstration_by_hand() -> None:
    time = np.linspace(1.0, 0.0, 9)[:, None]
    demos = [
        trajectory(goal(2) + time**2 * [1.0, 0.0]),  # at any speed
        trajectory(goal(2) + time * [0.0, 2.0] + [0.1, 0.3]),  # and wherever it ends
    ]
    mean = mean_demonstration(demos, goal(2), 5)
    np.testing.assert_allclose(mean, np.linspace(1.0, 0.0, 5)[:, None] * [0.5, 1.0], atol=1e-15)
    assert (mean[-1] == 0.0).all()


def test_not_at_all_is_the_identity() -> None:
    assert straighten(half_circle(), 0.0, 30).count == 0
    assert straighten(np.zeros((60, 3)), 0.5, 30).count == 0


@pytest.mark.parametrize("d", [2, 3, 5])
def test_a_straight_motion_needs_no_warp(d: int) -> None:
    way = np.linspace(1.0, 0.0, 80)[:, None] ** 3
    direction = np.random.default_rng(d).normal(size=d)
    mean = mean_demonstration([trajectory(goal(d) + size * way * direction) for size in (0.9, 1.0, 1.2)], goal(d))
    warp = straighten(mean, 0.75, 30)
    np.testing.assert_allclose(warp.apply(mean)[0], mean, atol=1e-6)
    assert np.abs(warp.translations).max(initial=0.0) < 1e-6


@pytest.mark.parametrize("share", [0.45, 0.6, 0.75, 0.85])
def test_a_half_circle_is_carried_its_share_of_the_way_to_the_chord(share: float) -> None:
    path = half_circle()
    bend = rms(path - chord(path))
    image = straighten(path, share, 30).apply(path)[0]
    assert rms(image - ((1.0 - share) * path + share * chord(path))) < ACCURACY * bend
    assert rms(image - chord(path)) == pytest.approx((1.0 - share) * bend, abs=ACCURACY * bend)


@pytest.mark.parametrize("d", [2, 3])
def test_a_motion_that_first_moves_away_hardly_does_so_in_its_image(d: int) -> None:
    mean = mean_demonstration(hook(d), goal(d))
    away = np.linalg.norm(mean, axis=1)
    straight = np.linalg.norm(straighten(mean, 0.75, 30).apply(mean)[0], axis=1)
    rise = away.max() / away[0] - 1.0
    assert rise > 0.4
    assert straight.max() / straight[0] - 1.0 < 0.2 * rise


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("share", [0.45, 0.85])
def test_every_translation_is_one_to_one_and_not_too_narrow(d: int, share: float) -> None:
    mean = mean_demonstration(hook(d), goal(d))
    warp = straighten(mean, share, 30)
    assert 0 < warp.count <= 30
    slopes = np.linalg.norm(warp.translations, axis=1) * warp.rates * STEEPEST
    assert slopes.max() <= SLOPE * (1.0 + 1e-12)
    assert warp.bound < 1.0
    axes = np.linalg.svd(mean, full_matrices=False)[2]
    size = np.linalg.norm(np.ptp(mean @ axes.T, axis=0))
    assert (1.0 / (math.sqrt(2.0) * warp.rates)).min() >= NARROWEST * size * (1.0 - 1e-12)


def test_more_translations_go_on_where_fewer_ended() -> None:
    mean = mean_demonstration(hook(2), goal(2))
    few, many = straighten(mean, 0.6, 5), straighten(mean, 0.6, 12)
    for name in ("centres", "translations", "rates"):
        np.testing.assert_array_equal(getattr(many, name)[:5], getattr(few, name))


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("seed", range(3))
def test_the_warp_turns_and_scales_with_the_data(d: int, seed: int) -> None:
    R, scale = rotation(d, seed), 10.0 ** (3 - 3 * seed)
    demos = hook(d)
    one = straighten(mean_demonstration(demos, goal(d)), 0.75, 20)
    other = straighten(mean_demonstration(moved(demos, R, scale), scale * R @ goal(d)), 0.75, 20)
    assert other.count == one.count
    expected = Warp(
        centres=scale * one.centres @ R.T, translations=scale * one.translations @ R.T, rates=one.rates / scale
    )
    for name in ("centres", "translations", "rates"):
        size = np.abs(getattr(expected, name)).max()
        np.testing.assert_allclose(getattr(other, name), getattr(expected, name), atol=1e-9 * size)
