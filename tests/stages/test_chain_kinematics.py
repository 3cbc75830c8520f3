"""Kinematics of the simulated arms: against PyBullet's, finite differences, poses by hand; leaning away from balls."""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from stages.trajectory import Array
from stages.world.chain import DAMPING, Chain, forward, joint_velocity, lean_away, reach, turn_between, turned
from stages.world.engine import bullet
from stages.world.robots import PAD, PAD_LINK, ROBOTS, Arm, arm

SIDES = [(name, left) for name in ROBOTS for left in (True, False)]
ARMS = {side: arm(*side, "robot") for side in SIDES}

seeds = st.integers(0, 2**32 - 1)
sides = st.sampled_from(SIDES)

PLANAR = Chain(
    np.array([0.0, 1.0, 0.0]),
    np.array([np.eye(3)] * 3),
    np.array([[0.0, 0.0, 0.5], [0.3, 0.0, 0.0], [0.0, 0.0, 0.1]]),
    np.array([[0.0, 0.0, 1.0]] * 3),
    np.array([True, True, False]),
    np.array([0.2, 0.0, 0.0]),
)
"""Two links of 0.3 and 0.2 m that turn about vertical axes, and a fixed joint; its base is at y = 1."""


def pose(chain: Chain, q: Array) -> tuple[Array, Array, Array]:
    position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, q.shape[0]))
    forward(chain, q, position, rotation, jacobian)
    return position, rotation, jacobian


def angles(one: Arm, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(one.low, one.high)


def about(axis: list[float], angle: float) -> Array:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross)


@pytest.fixture(scope="module")
def engine() -> Iterator[tuple[Any, int, dict[tuple[str, bool], int]]]:
    """PyBullet, a client and each arm's body in it."""
    module = bullet()
    client = module.connect(module.DIRECT)
    bodies = {}
    with tempfile.TemporaryDirectory() as folder:
        for number, (side, one) in enumerate(ARMS.items()):
            path = Path(folder, f"{number}.urdf")
            path.write_text(one.description, encoding="utf-8")
            bodies[side] = module.loadURDF(
                str(path), one.chain.place.tolist(), useFixedBase=True, physicsClientId=client
            )
    yield module, client, bodies
    module.disconnect(client)


def test_two_links_by_hand() -> None:
    position, rotation, jacobian = pose(PLANAR, np.array([math.pi / 2.0, -math.pi / 2.0]))
    assert position == pytest.approx([0.2, 1.3, 0.6], abs=1e-15)  # up y by 0.3, then along x by 0.2
    assert rotation == pytest.approx(np.eye(3), abs=1e-15)
    # z x (tip - joint): of the first joint (0.2, 0.3), of the second one (0.2, 0).
    wanted = [[-0.3, 0.0], [0.2, 0.2], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [1.0, 1.0]]
    assert jacobian == pytest.approx(np.array(wanted), abs=1e-15)


@pytest.mark.parametrize("side", SIDES, ids=str)
def test_poses_are_pybullets(side: tuple[str, bool], engine: tuple[Any, int, dict[tuple[str, bool], int]]) -> None:
    module, client, bodies = engine
    one, body = ARMS[side], bodies[side]
    for seed in range(20):
        q = angles(one, seed)
        for joint, angle in zip(one.turning, q, strict=True):
            module.resetJointState(body, joint, angle, physicsClientId=client)
        link = module.getLinkState(body, one.pad, computeForwardKinematics=1, physicsClientId=client)
        frame = np.array(module.getMatrixFromQuaternion(link[5])).reshape(3, 3)
        position, rotation, _ = pose(one.chain, q)
        assert position == pytest.approx(np.array(link[4]) + frame @ [0.0, 0.0, PAD[2]], abs=1e-7)
        assert rotation == pytest.approx(frame, abs=1e-6)


@pytest.mark.parametrize("side", SIDES, ids=str)
def test_numbers_of_joints_are_pybullets(
    side: tuple[str, bool], engine: tuple[Any, int, dict[tuple[str, bool], int]]
) -> None:
    module, client, bodies = engine
    one, body = ARMS[side], bodies[side]
    infos = [
        module.getJointInfo(body, k, physicsClientId=client)
        for k in range(module.getNumJoints(body, physicsClientId=client))
    ]
    turning = [k for k, info in enumerate(infos) if info[2] == module.JOINT_REVOLUTE]
    assert list(one.turning) == turning
    assert [k for k, info in enumerate(infos) if info[1] == PAD_LINK.encode()] == [one.pad]
    assert [infos[k][8] for k in turning] == one.low.tolist()
    assert [infos[k][9] for k in turning] == one.high.tolist()
    assert [infos[k][10] for k in turning] == one.torque.tolist()


@given(side=sides, seed=seeds)
def test_the_jacobian_is_that_of_finite_differences(side: tuple[str, bool], seed: int) -> None:
    one, h = ARMS[side], 1e-6
    q = angles(one, seed)
    _, rotation, jacobian = pose(one.chain, q)
    for joint in range(q.shape[0]):
        ahead, behind = q.copy(), q.copy()
        ahead[joint] += h
        behind[joint] -= h
        (after, turned, _), (before, unturned, _) = pose(one.chain, ahead), pose(one.chain, behind)
        assert jacobian[:3, joint] == pytest.approx((after - before) / (2.0 * h), abs=1e-8)
        spin = (turned - unturned) @ rotation.T / (2.0 * h)
        assert jacobian[3:, joint] == pytest.approx([spin[2, 1], spin[0, 2], spin[1, 0]], abs=1e-8)


@given(side=sides, seed=seeds)
def test_a_pose_is_a_rotation(side: tuple[str, bool], seed: int) -> None:
    _, rotation, _ = pose(ARMS[side].chain, angles(ARMS[side], seed))
    assert rotation.T @ rotation == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-12)


@given(angle=st.floats(-1.5, 1.5), seed=seeds)
def test_the_turn_between_two_frames_by_hand(angle: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    axis = generator.normal(size=3)
    axis /= np.linalg.norm(axis)
    actual = np.ascontiguousarray(np.linalg.qr(generator.normal(size=(3, 3)))[0])
    wanted = np.ascontiguousarray(about(axis.tolist(), angle) @ actual)
    assert turn_between(wanted, actual) == pytest.approx(math.sin(angle) * axis, abs=1e-12)
    assert turn_between(actual, wanted) == pytest.approx(-math.sin(angle) * axis, abs=1e-12)


@given(side=sides, seed=seeds)
@settings(max_examples=50, deadline=None)
def test_reach_comes_to_any_pose_near_by(side: tuple[str, bool], seed: int) -> None:
    one = ARMS[side]
    q = one.posture.copy()
    position, rotation, _ = pose(one.chain, one.posture + np.random.default_rng(seed).uniform(-0.4, 0.4, q.shape))
    missing = reach(one.chain, q, position, rotation, 500, 1e-6)
    assert missing <= 1e-6
    found, turned, _ = pose(one.chain, q)
    assert np.abs(found - position).max() <= 1e-6
    assert np.abs(turned - rotation).max() <= 2e-6


def test_reach_says_what_is_missing() -> None:
    one = ARMS[SIDES[0]]
    q = one.posture.copy()
    assert reach(one.chain, q, np.array([3.0, 0.0, 0.5]), np.eye(3), 100, 1e-6) > 1.0
    assert np.isfinite(q).all()
    position, rotation, _ = pose(one.chain, one.posture)
    still = one.posture.copy()
    assert reach(one.chain, still, position, rotation, 100, 1e-6) == 0.0
    assert (still == one.posture).all()


@given(side=sides, seed=seeds)
def test_the_tip_moves_as_told_and_not_with_the_pull(side: tuple[str, bool], seed: int) -> None:
    one, generator = ARMS[side], np.random.default_rng(seed)
    _, _, jacobian = pose(one.chain, one.posture + generator.uniform(-0.4, 0.4, one.posture.shape))
    twist, pull = generator.normal(size=6), generator.normal(size=one.posture.shape)
    _, singular, rows = np.linalg.svd(jacobian)
    # What damping keeps from the tip: a share of DAMPING/(sigma^2 + DAMPING) where sigma is smallest.
    share = DAMPING / (singular[-1] ** 2 + DAMPING)
    told = jacobian @ joint_velocity(jacobian, twist, np.zeros_like(pull))
    assert np.linalg.norm(told - twist) <= 1.001 * share * np.linalg.norm(twist) + 1e-12
    pulled = joint_velocity(jacobian, np.zeros(6), pull)
    assert np.linalg.norm(jacobian @ pulled) <= 1.001 * share * np.linalg.norm(jacobian @ pull) + 1e-12
    free = rows[6:]
    assert free @ pulled == pytest.approx(free @ pull, abs=1e-9)
    assert joint_velocity(jacobian, twist, pull) == pytest.approx(
        joint_velocity(jacobian, twist, np.zeros_like(pull)) + pulled, abs=1e-9
    )


# One turn.


@given(first=st.floats(-7.0, 7.0), second=st.floats(-7.0, 7.0), seed=seeds)
def test_a_turn_about_an_axis(first: float, second: float, seed: int) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    turn = turned(axis, first)
    assert turn == pytest.approx(about(axis.tolist(), first), abs=1e-15)
    assert turn @ axis == pytest.approx(axis, abs=1e-14)
    assert turn.T @ turn == pytest.approx(np.eye(3), abs=1e-13)
    assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-13)
    assert turn @ turned(axis, second) == pytest.approx(turned(axis, first + second), abs=1e-13)
    assert (turned(axis, 0.0) == np.eye(3)).all()


def test_a_quarter_turn_by_hand() -> None:
    quarter = turned(np.array([0.0, 0.0, 1.0]), math.pi / 2.0)
    assert quarter == pytest.approx(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), abs=1e-15)


# Links that lean away from a ball.

NEAR, GAIN = 0.15, 10.0
THROUGH = -0.95
"""Share of a ball's radius: a link that is deeper inside goes through its middle, where no direction is away."""


def joints_and_tip(chain: Chain, q: Array) -> Array:
    """Origins of the joints that turn, and the tip, shape (m + 1, 3), metres."""
    frame, at, joint, places = np.eye(3), chain.place.copy(), 0, []
    for i, turns in enumerate(chain.turns):
        at = at + frame @ chain.offsets[i]
        frame = frame @ chain.rotations[i]
        if turns:
            places.append(at)
            frame = frame @ about(chain.axes[i].tolist(), q[joint])
            joint += 1
    return np.array([*places, at + frame @ chain.tip])


def rooms(chain: Chain, q: Array, centre: Array, radius: float) -> Array:
    """How far each link is from the surface of a ball, shape (m,), metres."""
    found = []
    for a, b in itertools.pairwise(joints_and_tip(chain, q)):
        length = float((b - a) @ (b - a))
        share = 0.0 if length == 0.0 else float(np.clip((centre - a) @ (b - a) / length, 0.0, 1.0))
        found.append(float(np.linalg.norm(a + share * (b - a) - centre)) - radius)
    return np.array(found)


def potential(chain: Chain, q: Array, centre: Array, radius: float) -> float:
    """1/2 gain (near - room)^2 of each link, and from the surface inwards its tangent."""
    room = np.minimum(rooms(chain, q, centre, radius), NEAR)
    outside = 0.5 * (NEAR - np.maximum(room, 0.0)) ** 2
    return GAIN * float((outside - NEAR * np.minimum(room, 0.0)).sum())


def pull_of(chain: Chain, q: Array, centre: Array, radius: float) -> Array:
    pull = np.zeros(q.shape[0])
    lean_away(chain, q, centre, radius, NEAR, GAIN, pull)
    return pull


def ball_near(one: Arm, q: Array, generator: np.random.Generator) -> tuple[Array, float]:
    """Centre and radius of a ball whose surface is less than 0.2 m from a point of the arm; it may be touched."""
    places = joints_and_tip(one.chain, q)
    link = int(generator.integers(len(places) - 1))
    point = places[link] + generator.uniform() * (places[link + 1] - places[link])
    away, radius = generator.normal(size=3), float(generator.uniform(0.02, 0.2))
    return point + (radius + generator.uniform(-0.5 * radius, 0.2)) * away / np.linalg.norm(away), radius


def test_links_lean_away_by_hand() -> None:
    # Stretched out along x at y = 1: joints at x = 0 and 0.3 m, the tip at 0.5 m, and 0.1 m higher. A ball of 50 mm is
    # 50 mm beside the middle of the first link, which is pushed by 2 (0.1 - 0.05), 0.15 m from its joint; the second
    # one is 130 mm away.
    pull = np.array([1.0, 2.0])
    lean_away(PLANAR, np.zeros(2), np.array([0.15, 1.1, 0.5]), 0.05, 0.1, 2.0, pull)
    assert pull == pytest.approx([1.0 - 0.1 * 0.15, 2.0], abs=1e-15)
    # Touched, and deeper, by gain x near.
    for distance in (0.05, 0.02, 1e-6):
        pull = np.zeros(2)
        lean_away(PLANAR, np.zeros(2), np.array([0.15, 1.0 + distance, 0.5]), 0.05, 0.1, 2.0, pull)
        assert pull[0] == pytest.approx(-0.2 * 0.15, rel=1e-9)
    # Beside the tip, to +y: both joints turn it to -y, at 0.5 m and at 0.2 m.
    pull = np.zeros(2)
    lean_away(PLANAR, np.zeros(2), np.array([0.5, 1.1, 0.6]), 0.05, 0.1, 2.0, pull)
    assert pull == pytest.approx([-0.1 * 0.5, -0.1 * 0.2], abs=1e-15)


@given(side=sides, seed=seeds)
def test_a_pull_is_the_slope_of_a_potential(side: tuple[str, bool], seed: int) -> None:
    one, generator, h = ARMS[side], np.random.default_rng(seed), 1e-6
    q = generator.uniform(one.low, one.high)
    centre, radius = ball_near(one, q, generator)
    assume((rooms(one.chain, q, centre, radius) > THROUGH * radius).all())
    pull = pull_of(one.chain, q, centre, radius)
    for joint in range(q.shape[0]):
        ahead, behind = q.copy(), q.copy()
        ahead[joint] += h
        behind[joint] -= h
        rise = potential(one.chain, ahead, centre, radius) - potential(one.chain, behind, centre, radius)
        assert pull[joint] == pytest.approx(-rise / (2.0 * h), abs=1e-4)


@given(side=sides, seed=seeds)
def test_to_follow_a_pull_makes_room(side: tuple[str, bool], seed: int) -> None:
    one, generator, h = ARMS[side], np.random.default_rng(seed), 1e-5
    q = generator.uniform(one.low, one.high)
    centre, radius = ball_near(one, q, generator)
    before = rooms(one.chain, q, centre, radius)
    assume((before > THROUGH * radius).all())
    pull = pull_of(one.chain, q, centre, radius)
    assume(np.linalg.norm(pull) > 1e-2)
    then = q + h * pull
    assert potential(one.chain, then, centre, radius) < potential(one.chain, q, centre, radius)
    near = np.flatnonzero(before < NEAR)
    if len(near) == 1:
        assert rooms(one.chain, then, centre, radius)[near[0]] > before[near[0]]


@given(side=sides, seed=seeds)
def test_a_ball_that_is_not_near_does_not_pull(side: tuple[str, bool], seed: int) -> None:
    one, generator = ARMS[side], np.random.default_rng(seed)
    q = generator.uniform(one.low, one.high)
    centre = joints_and_tip(one.chain, q)[-1] + generator.normal(size=3)
    most = float(rooms(one.chain, q, centre, 0.0).min()) - NEAR  # as large as it may be
    pull = generator.normal(size=q.shape[0])
    kept = pull.copy()
    lean_away(one.chain, q, centre, most - 1e-9, NEAR, GAIN, pull)
    assert (pull == kept).all()


@given(side=sides, seed=seeds, aside=st.sampled_from([0.0, 1e-300, 1e-12, 0.01]))
def test_a_pull_is_bounded_even_where_a_link_goes_through_the_middle(
    side: tuple[str, bool], seed: int, aside: float
) -> None:
    one, generator = ARMS[side], np.random.default_rng(seed)
    q = generator.uniform(one.low, one.high)
    places = joints_and_tip(one.chain, q)
    centre = places[int(generator.integers(len(places)))] + np.array([0.0, 0.0, aside])
    pull = pull_of(one.chain, q, centre, 0.1)
    # Of each link by gain x near, at no more than the arm's length.
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    assert np.isfinite(pull).all()
    assert np.abs(pull).max() <= q.shape[0] * GAIN * NEAR * length


@given(side=sides, seed=seeds)
def test_the_pad_stays_while_links_lean_away(side: tuple[str, bool], seed: int) -> None:
    one, generator, h = ARMS[side], np.random.default_rng(seed), 1e-5
    q = one.posture + generator.uniform(-0.4, 0.4, one.posture.shape)
    centre, radius = ball_near(one, q, generator)
    assume((rooms(one.chain, q, centre, radius) > THROUGH * radius).all())
    pull = pull_of(one.chain, q, centre, radius)
    position, rotation, jacobian = pose(one.chain, q)
    _, singular, _ = np.linalg.svd(jacobian)
    qdot = joint_velocity(jacobian, np.zeros(6), pull)
    then, after, _ = pose(one.chain, q + h * qdot)
    # To first order: but for what damping leaves of it, see above, and for the square of the joints' turns.
    left = 1.001 * h * DAMPING / (singular[-1] ** 2 + DAMPING) * float(np.linalg.norm(jacobian @ pull))
    second = 2.0 * (h * float(np.abs(qdot).sum())) ** 2
    assert np.linalg.norm(then - position) <= left + second + 1e-14
    assert np.linalg.norm(after - rotation) <= math.sqrt(2.0) * left + second + 1e-14
    # What is left of the pull still makes room, or takes none.
    assert qdot @ pull >= -1e-12
    if qdot @ pull > 1e-2:
        there = potential(one.chain, q + h * qdot, centre, radius)
        assert there < potential(one.chain, q, centre, radius)
