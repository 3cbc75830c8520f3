"""The diffeomorphism of the state: by hand, both ways, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import DataError
from stages.dynamics.warp import STEEPEST, Warp, image_at, warp_at

DIMENSIONS = (2, 3, 5, 7)


def random_warp(rng: np.random.Generator, M: int, d: int, slopes: tuple[float, float]) -> Warp:
    """Translations of all widths about the origin, their steepest slopes within `slopes`."""
    rates = 10.0 ** rng.uniform(-1.0, 1.0, size=M)
    directions = rng.normal(size=(M, d))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths = rng.uniform(*slopes, size=M) / (rates * STEEPEST)
    return Warp(centres=rng.normal(size=(M, d)), translations=lengths[:, None] * directions, rates=rates)


def size_of(warp: Warp, z: np.ndarray) -> float:
    """Of the numbers that rounding is relative to."""
    return float(np.abs(z).max() + np.abs(warp.translations).max() + np.abs(warp.centres).max())


def test_one_translation_by_hand() -> None:
    v = np.array([0.5, 0.25])
    warp = Warp(centres=[[1.0, 0.0]], translations=[v], rates=[1.0])
    image, jacobian = warp.apply(np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 0.0]]))
    # The weight is 1 at the centre and 1/e at a distance of 1, where the origin is, too.
    e = math.e
    np.testing.assert_allclose(warp.origin(), v / e, rtol=1e-15)
    np.testing.assert_allclose(image, [[1.0 + 0.5 * (1 - 1 / e), 0.25 * (1 - 1 / e)], [1.0, 1.0], [0.0, 0.0]])
    # I - 2 rho^2 weight v (z - c)'.
    np.testing.assert_allclose(jacobian[0], np.eye(2))
    np.testing.assert_allclose(jacobian[1], [[1.0, -1.0 / e], [0.0, 1.0 - 0.5 / e]])
    np.testing.assert_allclose(jacobian[2], [[1.0 + 1.0 / e, 0.0], [0.5 / e, 1.0]])
    assert warp.bound == pytest.approx(math.sqrt(0.3125) * math.sqrt(2.0 / e), rel=1e-12)


def test_translations_are_applied_one_after_the_other() -> None:
    one = Warp(centres=[[0.3, 0.1]], translations=[[0.2, 0.1]], rates=[2.0])
    other = Warp(centres=[[0.5, -0.2]], translations=[[-0.1, 0.3]], rates=[1.5])
    chain = Warp(
        centres=np.concatenate([one.centres, other.centres]),
        translations=np.concatenate([one.translations, other.translations]),
        rates=np.concatenate([one.rates, other.rates]),
    )
    z = np.random.default_rng(0).normal(size=(20, 2))
    first = one.apply(z)[0] + one.origin()
    second = other.apply(first)[0] + other.origin()
    np.testing.assert_allclose(chain.apply(z)[0], second - chain.origin(), atol=1e-15)


def test_the_steepest_slope_of_the_gaussian_is_what_the_bound_takes() -> None:
    s = np.linspace(0.0, 5.0, 1_000_001)
    slopes = 2.0 * s * np.exp(-(s**2))
    assert slopes.max() == pytest.approx(STEEPEST, rel=1e-10)
    assert slopes.max() <= STEEPEST


@given(seed=st.integers(0, 100_000), d=st.sampled_from(DIMENSIONS), M=st.integers(1, 12), reach=st.floats(-3.0, 2.0))
def test_there_and_back_again(seed: int, d: int, M: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    warp = random_warp(rng, M, d, (0.0, 0.7))
    assert (warp.apply(np.zeros((1, d)))[0] == 0.0).all()
    z = 10.0**reach * rng.normal(size=(10, d))
    rounding = 1e-12 * size_of(warp, z)
    assert np.abs(warp.invert(warp.apply(z)[0]) - z).max() <= rounding
    assert np.abs(warp.apply(warp.invert(z))[0] - z).max() <= rounding
    assert (np.linalg.det(warp.apply(z)[1]) > 0.0).all()


@given(seed=st.integers(0, 100_000), d=st.sampled_from(DIMENSIONS))
def test_there_and_back_again_where_it_is_nearly_flat(seed: int, d: int) -> None:
    rng = np.random.default_rng(seed)
    warp = random_warp(rng, 1, d, (0.999, 0.999))
    assert warp.bound == pytest.approx(0.999, rel=1e-12)
    # Where the slope is steepest: along v, ahead of the centre by 1/(sqrt(2) rho).
    v = warp.translations[0]
    steepest = warp.centres[0] + v / np.linalg.norm(v) / (math.sqrt(2.0) * warp.rates[0])
    beside = steepest + 10.0 ** rng.uniform(-9.0, 0.0, size=(10, 1)) * rng.normal(size=(10, d)) / warp.rates[0]
    z = np.concatenate([steepest[None], beside, warp.centres])
    determinant = np.linalg.det(warp.apply(z)[1])
    assert determinant[0] == pytest.approx(1e-3, rel=1e-9)
    assert (determinant > 0.0).all()
    rounding = 1e-12 * size_of(warp, z)
    assert np.abs(warp.invert(warp.apply(z)[0]) - z).max() <= rounding
    assert np.abs(warp.apply(warp.invert(z))[0] - z).max() <= rounding


def test_images_of_neighbours_keep_their_order() -> None:
    # One-to-one along v: the image of a line along v never turns back, however flat.
    warp = Warp(centres=[[0.0, 0.0]], translations=[[0.999 / STEEPEST, 0.0]], rates=[1.0])
    line = np.column_stack([np.linspace(-3.0, 3.0, 5001), np.zeros(5001)])
    steps = np.diff(warp.apply(line)[0][:, 0])
    assert steps.min() > 0.0
    assert steps.min() == pytest.approx(1e-3 * 6.0 / 5000, rel=1e-2)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_jacobian_agrees_with_differences(d: int) -> None:
    rng = np.random.default_rng(d)
    warp = random_warp(rng, 8, d, (0.0, 0.9))
    z, h = rng.normal(size=(6, d)), 1e-6
    differences = [(warp.apply(z + h * e)[0] - warp.apply(z - h * e)[0]) / (2.0 * h) for e in np.eye(d)]
    np.testing.assert_allclose(warp.apply(z)[1], np.stack(differences, axis=2), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_with_and_without_the_jacobian_the_image_is_the_same_to_the_last_bit(d: int) -> None:
    rng = np.random.default_rng(d)
    warp = random_warp(rng, 20, d, (0.0, 0.9))
    fixed = (warp.centres, warp.translations, warp.rates, warp.origin())
    one, other, jacobian, row = np.empty(d), np.empty(d), np.empty((d, d)), np.empty(d)
    for z in 2.0 * rng.normal(size=(50, d)):
        warp_at(z, *fixed, one, jacobian, row)
        image_at(z, *fixed, other)
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one, warp.apply(z[None])[0][0])


def test_far_away_there_is_only_the_shift_that_keeps_the_goal() -> None:
    warp = random_warp(np.random.default_rng(0), 5, 3, (0.3, 0.9))
    z = np.array([[1e6, 0.0, 0.0], [0.0, -1e9, 1e3]])
    image, jacobian = warp.apply(z)
    np.testing.assert_array_equal(image, z - warp.origin())
    np.testing.assert_array_equal(jacobian, np.stack([np.eye(3)] * 2))
    np.testing.assert_allclose(warp.invert(image), z, rtol=1e-15)


@pytest.mark.parametrize("d", DIMENSIONS)
def test_no_translation_at_all_is_the_identity(d: int) -> None:
    warp = Warp.identity(d)
    assert (warp.count, warp.bound) == (0, 0.0)
    z = np.random.default_rng(d).normal(size=(4, d))
    image, jacobian = warp.apply(z)
    np.testing.assert_array_equal(image, z)
    np.testing.assert_array_equal(jacobian, np.stack([np.eye(d)] * 4))
    np.testing.assert_array_equal(warp.invert(z), z)


def test_a_translation_by_nothing_and_one_without_width_change_nothing() -> None:
    still = Warp(centres=[[1.0, 2.0]], translations=[[0.0, 0.0]], rates=[3.0])
    everywhere = Warp(centres=[[1.0, 2.0]], translations=[[0.5, 1.0]], rates=[0.0])
    z = np.random.default_rng(0).normal(size=(4, 2))
    for warp in (still, everywhere):
        np.testing.assert_allclose(warp.apply(z)[0], z, atol=1e-15)
        np.testing.assert_allclose(warp.invert(z), z, atol=1e-15)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rates": [1.0 / STEEPEST, 0.1]}, "must be one-to-one: its steepest slope is 1, not below 1"),
        ({"rates": [-3.0, 0.1]}, "must be one-to-one: its steepest slope is 2.57"),
        ({"rates": [(1.0 - 5e-14) / STEEPEST, 0.1]}, "must be one-to-one"),
        ({"rates": [np.nan, 0.1]}, "must be finite"),
        ({"centres": [[0.0, np.inf], [0.0, 0.0]]}, "must be finite"),
        ({"translations": [[np.nan, 0.0], [0.0, 0.0]]}, "must be finite"),
        ({"rates": [0.1]}, r"must have shapes \(M, d\), \(M, d\), \(M,\), not \(2, 2\), \(2, 2\), \(1,\)"),
        ({"translations": np.zeros((2, 3))}, r"not \(2, 2\), \(2, 3\), \(2,\)"),
        ({"centres": np.zeros(2)}, r"not \(2,\), \(2, 2\), \(2,\)"),
    ],
)
def test_refuses_what_is_no_diffeomorphism(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {
        "centres": np.zeros((2, 2)),
        "translations": [[1.0, 0.0], [0.0, 0.1]],
        "rates": [0.999 / STEEPEST, 0.1],
    }
    warp = Warp(**good)
    with pytest.raises(ValueError, match="read-only"):
        warp.rates[0] = 0.0
    with pytest.raises(DataError, match=message):
        Warp(**{**good, **change})
