"""Two arms as one robot: the description is legal, names no file, and places all links where the arms' own one does."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pybullet
import pytest
from pytransform3d.urdf import UrdfTransformManager
from rerun.urdf import UrdfTree

from stages.world.description import (
    BALL,
    FACE,
    RADIUS,
    WORLD,
    both,
    description,
    faces,
    named,
    quaternions,
    tree,
    turning,
)
from stages.world.links import frames, link_names
from stages.world.robots import PAD, ROBOTS, Arm

SIDES = ("left", "right")
ANY = pytest.mark.parametrize("robot", ROBOTS)


def drawn(arms: tuple[Arm, Arm], n: int = 4) -> np.ndarray:
    """Joint positions within the limits, beyond which some readers do not go."""
    low, high = np.array([one.low for one in arms]), np.array([one.high for one in arms])
    return low + np.random.default_rng(0).uniform(size=(n, 2, 7)) * (high - low)


def test_names_bear_the_side_once() -> None:
    assert named("left", "link_0") == "left_link_0"
    assert named("left", "left_hand") == "left_hand"
    assert named("right", "left_hand") == "right_left_hand"


@ANY
def test_a_description_names_no_file_and_no_name_twice(robot: str) -> None:
    text = description(robot, both(robot, "robot"))
    assert not re.search(r"mesh|filename|package:|/(home|work|usr|tmp)|\.(obj|stl|dae|urdf)", text)
    root = ET.fromstring(text)
    assert root.get("name") == f"two_{robot}"
    links, joints = ([e.get("name") for e in root.findall(tag)] for tag in ("link", "joint"))
    assert len(set(links)) == len(links)
    assert len(set(joints)) == len(joints) == len(links) - 1
    assert links[0] == WORLD
    assert {name.partition("_")[0] for name in links[1:] + joints} == {"left", "right"}
    assert description(robot, both(robot, "robot")) == text


@ANY
def test_what_is_seen_are_links_joints_and_pads(robot: str) -> None:
    """A ball at each joint that turns, a cylinder from each joint to the next, and the pad as large as it is."""
    arms = both(robot, "robot")
    root = ET.fromstring(description(robot, arms))
    shapes = [geometry[0] for geometry in root.iter("geometry")]
    balls = [shape for shape in shapes if shape.tag == "sphere"]
    assert len(balls) == 14
    assert {float(shape.get("radius")) for shape in balls} == {BALL}
    cylinders = [shape for shape in shapes if shape.tag == "cylinder"]
    assert {float(shape.get("radius")) for shape in cylinders} == {RADIUS}
    lengths = np.linalg.norm(arms[0].chain.offsets, axis=1)
    wanted = sorted(2 * [length for length in lengths if length > 0.0])
    assert sorted(float(shape.get("length")) for shape in cylinders) == pytest.approx(wanted, abs=1e-15)
    boxes = [shape.get("size") for shape in shapes if shape.tag == "box"]
    assert [[float(edge) for edge in size.split()] for size in boxes] == [list(PAD), list(PAD)]
    assert len(shapes) == len(balls) + len(cylinders) + len(boxes)


@ANY
def test_three_readers_place_all_links_alike(robot: str, tmp_path: Path) -> None:
    arms = both(robot, "robot")
    q = drawn(arms)
    path = tmp_path / "two.urdf"
    path.write_text(description(robot, arms))
    names = turning(arms)
    assert len(names) == 14

    known = UrdfTransformManager()
    known.load_urdf(path.read_text())
    for name, angle in zip(names, q[1].ravel(), strict=True):
        known.set_joint(name, float(angle))

    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
    joints = [pybullet.getJointInfo(body, k, client) for k in range(pybullet.getNumJoints(body, client))]
    numbers = {info[1].decode(): info[0] for info in joints}
    links = {info[12].decode(): info[0] for info in joints}
    for name, angle in zip(names, q[1].ravel(), strict=True):
        pybullet.resetJointState(body, numbers[name], float(angle), physicsClientId=client)
    states = pybullet.getLinkStates(body, list(links.values()), computeForwardKinematics=True, physicsClientId=client)
    places = {name: state[4] for name, state in zip(links, states, strict=True)}
    for name in names:  # with the limits of the arm's own description
        assert joints[numbers[name]][2] == pybullet.JOINT_REVOLUTE
        assert joints[numbers[name]][8] < joints[numbers[name]][9]
    pybullet.disconnect(client)

    drawn_by_rerun = UrdfTree.from_file_path(path)
    assert drawn_by_rerun.root_link().name == WORLD
    assert {joint.name for joint in drawn_by_rerun.joints()} == set(numbers)

    for side, one, index in zip(SIDES, arms, (0, 1), strict=True):
        at, turns = frames(one.chain, q[:, index])
        for k, link in enumerate(link_names(one)):
            name = named(side, link)
            matrix = known.get_transform(name, WORLD)
            assert matrix[:3, 3] == pytest.approx(at[k, 1], abs=1e-12)
            assert matrix[:3, :3] == pytest.approx(turns[k, 1], abs=1e-12)
            assert places[name] == pytest.approx(at[k, 1], abs=1e-6)  # of single precision
    face = faces(arms, q)[0][1]
    for index, side in enumerate(SIDES):
        assert known.get_transform(named(side, FACE), WORLD)[:3, 3] == pytest.approx(face[index], abs=1e-12)


@ANY
def test_frames_that_move_and_frames_that_do_not(robot: str) -> None:
    arms = both(robot, "robot")
    fixed, moving = tree(arms, drawn(arms, 3))
    assert fixed.places.shape == (1, len(fixed.children), 3)
    assert moving.places.shape == (3, 14, 3)
    assert moving.turns.shape == (3, 14, 4)
    assert np.ptp(moving.places, axis=0).max() == 0.0  # joints turn
    assert set(fixed.children).isdisjoint(moving.children)
    place = fixed.places[0, fixed.children.index(named("left", link_names(arms[0])[0]))]
    assert place.tolist() == [0.0, ROBOTS[robot].aside, 0.0]
    assert fixed.places[0, fixed.children.index("right_pad")].tolist() == [0.0, 0.0, PAD[2]]
    assert np.linalg.norm(moving.turns, axis=2) == pytest.approx(1.0, abs=1e-12)


def test_quaternions_by_hand_and_without_jumps() -> None:
    """About z by 0, 2, 4 and 6 rad: beyond pi the sign of the one before is kept."""
    angles = np.arange(4) * 2.0
    turns = np.array([[[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]] for a in angles])
    wanted = np.column_stack([np.zeros((4, 2)), np.sin(angles / 2), np.cos(angles / 2)])
    assert quaternions(turns) == pytest.approx(wanted, abs=1e-12)
