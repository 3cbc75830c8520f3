"""The arms of the simulated world: mirrored, within their limits, able to reach the default scene, free of a hand."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import ParameterError
from stages.trajectory import Array
from stages.world.boxes import pads_beside
from stages.world.bullet import World
from stages.world.chain import forward
from stages.world.parameters import Scene
from stages.world.robots import PAD, PAD_LINK, PAD_MASS, ROBOTS, Arm, arm

NAMES = sorted(ROBOTS)
PAIRS = {name: (arm(name, True, "robot"), arm(name, False, "robot")) for name in NAMES}
ACROSS = np.diag([1.0, -1.0, 1.0])

names = st.sampled_from(NAMES)
seeds = st.integers(0, 2**32 - 1)


def pose(one: Arm, q: Array) -> tuple[Array, Array, Array]:
    position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, q.shape[0]))
    forward(one.chain, q, position, rotation, jacobian)
    return position, rotation, jacobian


def test_every_robot_of_the_wheel_is_there() -> None:
    assert NAMES == ["iiwa", "panda"]


@given(name=names, seed=seeds)
def test_the_right_arm_is_the_left_ones_mirror_image(name: str, seed: int) -> None:
    left, right = PAIRS[name]
    q = np.random.default_rng(seed).uniform(left.low, left.high)
    here, turned, _ = pose(left, q)
    there, mirrored, _ = pose(right, q * ROBOTS[name].mirror)
    assert there == pytest.approx(ACROSS @ here, abs=1e-9)
    # A frame's mirror image is left-handed: its axis of the tool is what is compared.
    assert mirrored[:, 2] == pytest.approx(ACROSS @ turned[:, 2], abs=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_postures_are_mirrored_and_within_limits(name: str) -> None:
    left, right = PAIRS[name]
    assert right.posture.tolist() == (left.posture * ROBOTS[name].mirror).tolist()
    for one, towards in ((left, -1.0), (right, 1.0)):
        assert (one.posture >= one.low + 0.5).all()
        assert (one.posture <= one.high - 0.5).all()
        assert one.chain.place.tolist() == [0.0, -towards * ROBOTS[name].aside, 0.0]
        _, rotation, _ = pose(one, np.array(one.posture))
        assert rotation[:, 2] == pytest.approx([0.0, towards, 0.0], abs=0.1)  # the pad faces the box
        assert one.posture.shape == one.low.shape == one.high.shape == one.torque.shape == one.stiffness.shape == (7,)


@pytest.mark.parametrize(("name", "singular", "margin"), [("iiwa", 0.12, 0.1), ("panda", 0.15, 0.7)])
def test_start_and_goal_are_reached_with_margin(name: str, singular: float, margin: float) -> None:
    scene = Scene(robot=name)
    with World(scene, np.random.default_rng(0)) as world:
        for place, outside in ((scene.start, 0.05), (scene.start, 0.0), (scene.goal, 0.0), (scene.goal, 0.05)):
            pads = pads_beside(np.array(place), scene.box[1] + 2.0 * outside)
            for side, one in enumerate(world.arms):
                q = world.joints_at(side, pads[side])
                position, rotation, jacobian = pose(one, q)
                assert position == pytest.approx(pads[side], abs=1e-6)
                assert rotation == pytest.approx(world.turns[side], abs=1e-5)
                assert np.linalg.svd(jacobian, compute_uv=False)[-1] >= singular
                assert np.minimum(q - one.low, one.high - q).min() >= margin


@pytest.mark.parametrize("name", NAMES)
def test_pads_stand_upright(name: str) -> None:
    with World(Scene(robot=name), np.random.default_rng(0)) as world:
        for turn, towards in zip(world.turns, (-1.0, 1.0), strict=True):
            assert turn[:, 2].tolist() == [0.0, towards, 0.0]
            assert turn.T @ turn == pytest.approx(np.eye(3), abs=1e-12)
            assert np.linalg.det(turn) == pytest.approx(1.0)
            # Edges along x and z, within a degree.
            assert np.abs(turn[0, :2]).max() == pytest.approx(1.0, abs=2e-4)


@pytest.mark.parametrize("name", NAMES)
def test_the_description_ends_in_the_pad(name: str) -> None:
    root = ET.fromstring(PAIRS[name][0].description)
    links = [link.get("name") for link in root.iter("link")]
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    assert not [link for link in links if re.search("hand|finger|grasp|gripper", str(link))]
    assert links[-1] == PAD_LINK
    children = [child.get("link") for child in root.iter("child")]
    assert len(children) == len(set(children)) == len(links) - 1  # one row, without loose ends
    fixed = joints[PAD_LINK].find("parent")
    assert fixed is not None
    assert fixed.get("link") == ROBOTS[name].flange
    meshes = [str(mesh.get("filename")) for mesh in root.iter("mesh")]
    assert meshes
    assert all(Path(mesh).is_absolute() and Path(mesh).is_file() for mesh in meshes)


def test_the_pad_is_a_plate_by_hand() -> None:
    (pad,) = (link for link in ET.fromstring(PAIRS["iiwa"][0].description).iter("link") if link.get("name") == PAD_LINK)
    inertia, box = pad.find("inertial/inertia"), pad.find("collision/geometry/box")
    assert inertia is not None
    assert box is not None
    assert box.get("size") == "0.1 0.1 0.02"
    # m/12 (b^2 + c^2), 0.2 kg, 10 x 10 x 2 cm.
    wanted = [0.2 / 12.0 * 0.0104, 0.2 / 12.0 * 0.0104, 0.2 / 12.0 * 0.02]
    assert [float(str(inertia.get(name))) for name in ("ixx", "iyy", "izz")] == pytest.approx(wanted)
    assert (PAD, PAD_MASS) == ((0.10, 0.10, 0.02), 0.2)


def test_limits_of_the_panda_are_its_descriptions() -> None:
    one = PAIRS["panda"][0]
    assert one.torque.tolist() == [87.0] * 4 + [12.0] * 3
    assert (one.low[3], one.high[3]) == (-3.1416, 0.0)
    assert one.turning == (0, 1, 2, 3, 4, 5, 6)
    assert one.pad == 8  # a fixed joint lies between


def test_arms_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        PAIRS["iiwa"][0].posture[0] = 1.0


def test_baxter_is_refused_with_a_sentence() -> None:
    with pytest.raises(ParameterError) as refused:
        arm("baxter", True, "rollout.scene.robot")
    assert refused.value.location == "rollout.scene.robot"
    assert str(refused.value).endswith("choose iiwa or panda.")
