"""Kinematics of the simulated arms: against PyBullet's own, finite differences and hand-computed poses."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stages.trajectory import Array
from stages.world.chain import DAMPING, Chain, forward, joint_velocity, reach, turn_between
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
