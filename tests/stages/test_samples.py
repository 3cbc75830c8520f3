"""What a system is fitted to: the frame of the data, thinning, and guides beside the demonstrations by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motions import goal, hook, moved, rotation, trajectory

from stages.dynamics.samples import GUIDE_SAMPLES, Frame, frame_about, frame_of, guides, thinned


def straight(n: int = 21, d: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Along the first axis from -1 m to 1 m at 3 m/s."""
    position, velocity = np.zeros((n, d)), np.zeros((n, d))
    position[:, 0] = np.linspace(-1.0, 1.0, n)
    velocity[:, 0] = 3.0
    return position, velocity


def frame(d: int) -> Frame:
    return Frame(size=1.0, axes=np.eye(d))


def test_the_frame_by_hand() -> None:
    # Along (3, 4)/5 from 10 to 0, and 1 to either side on the way.
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    s, c = np.array([10.0, 5.0, 5.0, 0.0]), np.array([0.0, 1.0, -1.0, 0.0])
    found = frame_of([trajectory(goal(2) + s[:, None] * along + c[:, None] * across)], goal(2))
    assert found.size == pytest.approx(math.hypot(10.0, 2.0), rel=1e-12)
    np.testing.assert_allclose(np.abs(found.axes @ np.column_stack([along, across])), np.eye(2), atol=1e-14)
    np.testing.assert_allclose(found.axes @ found.axes.T, np.eye(2), atol=1e-15)
    with pytest.raises(ValueError, match="read-only"):
        found.axes[0, 0] = 0.0


@pytest.mark.parametrize("d", [2, 3, 5])
def test_the_frame_turns_and_scales_with_the_data(d: int) -> None:
    R, scale, demos = rotation(d), 1e3, hook(d)
    one, other = frame_of(demos, goal(d)), frame_of(moved(demos, R, scale), scale * R @ goal(d))
    assert other.size == pytest.approx(scale * one.size, rel=1e-12)
    turned = one.axes @ R.T
    np.testing.assert_allclose(np.abs((other.axes * turned).sum(axis=1)), 1.0, rtol=1e-10)


def test_the_size_is_that_of_all_demonstrations_together() -> None:
    position = np.column_stack([np.linspace(2.0, 0.0, 9), np.zeros(9)])
    whole = frame_of([trajectory(position), trajectory(2.0 * position)], np.zeros(2))
    assert whole.size == pytest.approx(4.0)
    assert frame_about(position).size == pytest.approx(2.0)


def test_thinning_is_even_and_keeps_both_ends() -> None:
    demonstration = trajectory(np.column_stack([np.arange(11.0), np.zeros(11)]))
    few = thinned(demonstration, 6)
    np.testing.assert_array_equal(few.position[:, 0], [0.0, 2.0, 4.0, 6.0, 8.0, 10.0])
    np.testing.assert_array_equal(few.velocity, demonstration.velocity[::2])
    for count in (None, 11, 500):
        np.testing.assert_array_equal(thinned(demonstration, count).position, demonstration.position)
    with pytest.raises(ValueError, match="read-only"):
        few.position[0, 0] = 1.0


def test_guides_of_a_straight_motion_by_hand() -> None:
    position, velocity = straight()
    found = guides(trajectory(position, velocity=velocity), frame(2), 0.1, 0.5)
    # The first axis is the direction of motion: its offsets vanish. The second one's are 0.1 sqrt(2) to either side.
    reach = 0.1 * math.sqrt(2.0)
    offsets = np.repeat([0.0, 0.0, -reach, reach], len(position))
    np.testing.assert_allclose(found.position, np.tile(position, (4, 1)) + offsets[:, None] * [0.0, 1.0], atol=1e-15)
    expected = np.tile(velocity, (4, 1)) - 3.0 / 0.5 * offsets[:, None] * [0.0, 1.0]
    np.testing.assert_allclose(found.velocity, expected, atol=1e-14)


def test_a_guide_leads_back_as_fast_as_it_says() -> None:
    # dw/dt = -|v| w/decay and ds/dt = |v|: dw/ds = -w/decay, and w = w_0 exp(-s/decay).
    position, velocity = straight(d=3)
    R = rotation(3)
    demonstration = trajectory(position @ R.T, velocity=velocity @ R.T)
    found = guides(demonstration, frame(3), 0.1, 0.25)
    across = found.position - np.tile(demonstration.position, (6, 1))
    along = demonstration.velocity[0] / 3.0
    np.testing.assert_allclose(across @ along, 0.0, atol=1e-15)
    np.testing.assert_allclose(found.velocity @ along, 3.0, rtol=1e-14)
    sideways = found.velocity - 3.0 * along
    np.testing.assert_allclose(sideways, -3.0 * across / 0.25, atol=1e-13)


@given(seed=st.integers(0, 100_000), d=st.sampled_from([2, 3, 5]), width=st.floats(1e-4, 1e2))
def test_the_rms_distance_of_guides_is_the_width(seed: int, d: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    position, velocity = rng.normal(size=(30, d)), rng.normal(size=(30, d))
    found = guides(trajectory(position, velocity=velocity), Frame(size=1.0, axes=rotation(d, seed)), width, 1.0)
    assert found.position.shape == found.velocity.shape == (2 * d * 30, d)
    across = found.position - np.tile(position, (2 * d, 1))
    np.testing.assert_allclose((across * np.tile(velocity, (2 * d, 1))).sum(axis=1), 0.0, atol=1e-12 * (1.0 + width))
    squared = (across**2).sum(axis=1).reshape(2 * d, 30).mean(axis=0)
    np.testing.assert_allclose(np.sqrt(squared), width, rtol=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_guides_turn_and_scale_with_the_data(d: int) -> None:
    R, scale, demos = rotation(d), 1e-3, hook(d)
    one = guides(demos[0], frame_of(demos, goal(d)), 0.01, 0.05)
    there = moved(demos, R, scale)
    other = guides(there[0], frame_of(there, scale * R @ goal(d)), scale * 0.01, scale * 0.05)
    # An axis has no sign: the guides of a pair may change places.
    for name in ("position", "velocity"):
        expected = (scale * getattr(one, name) @ R.T).reshape(d, 2, -1, d)
        found = getattr(other, name).reshape(d, 2, -1, d)
        for mine, theirs in zip(found, expected, strict=True):
            flipped = np.abs(mine - theirs).max() > np.abs(mine - theirs[::-1]).max()
            np.testing.assert_allclose(mine, theirs[::-1] if flipped else theirs, atol=1e-9 * scale)


def test_what_stands_still_has_no_guides() -> None:
    position, velocity = straight()
    velocity = velocity.copy()
    velocity[5:15] = 0.0
    found = guides(trajectory(position, velocity=velocity), frame(2), 0.1, 0.5)
    assert len(found.position) == 4 * 11
    assert not np.isin(found.position[:, 0], position[5:15, 0]).any()
    assert np.isfinite(found.velocity).all()
    nothing = guides(trajectory(position, velocity=np.zeros_like(position)), frame(2), 0.1, 0.5)
    assert nothing.position.shape == nothing.velocity.shape == (0, 2)


def test_guides_are_few() -> None:
    position, velocity = straight(5000)
    assert len(guides(trajectory(position, velocity=velocity), frame(2), 0.1, 0.5).position) == 4 * GUIDE_SAMPLES
