"""The arms of the simulated world: mirrored, within their limits, able to reach the default scene, free of a hand."""

from __future__ import annotations

import re
import sys
import types
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import ParameterError
from stages.policy.carrying import ENDED, Carrier, Phase
from stages.rollout.carry_conditions import clamp_of
from stages.rollout.parameters import CarryCondition, CarryParameters
from stages.trajectory import Array
from stages.world.boxes import pads_beside
from stages.world.bullet import World
from stages.world.chain import forward
from stages.world.following import Follower
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
    assert fixed.get("link") == ROBOTS[name].flange[0]
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


# A robot with two arms whose description is downloaded.

JOINTS = (
    # Published kinematics of Baxter's arms: name, origin, roll pitch yaw, limits, torque, mass of the link.
    ("s0", "0.055695 0 0.011038", "0 0 0", (-1.7016, 1.7016), 50, 5.7),
    ("s1", "0.069 0 0.27035", "-1.570796 0 0", (-2.147, 1.047), 50, 3.2),
    ("e0", "0.102 0 0", "1.570796 0 1.570796", (-3.0541, 3.0541), 50, 4.3),
    ("e1", "0.069 0 0.26242", "-1.570796 -1.570796 0", (-0.05, 2.618), 50, 2.1),
    ("w0", "0.10359 0 0", "1.570796 0 1.570796", (-3.059, 3.059), 15, 2.2),
    ("w1", "0.01 0 0.2707", "-1.570796 -1.570796 0", (-1.5707, 2.094), 15, 1.6),
    ("w2", "0.115975 0 0", "1.570796 0 1.570796", (-3.059, 3.059), 15, 0.35),
)


def link(name: str, mass: float) -> str:
    inertia = 'ixx="{0}" ixy="0" ixz="0" iyy="{0}" iyz="0" izz="{0}"'.format(0.004 * mass)
    return f'<link name="{name}"><inertial><mass value="{mass}"/><inertia {inertia}/></inertial></link>'


def joint(name: str, kind: str, parent: str, child: str, xyz: str, rpy: str, more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>{more}</joint>'
    )


@pytest.fixture
def two_armed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for the downloaded description: Baxter's kinematics, about its masses, and a head."""
    parts = [link("torso", 20.0), link("head", 1.0), joint("head_pan", "revolute", "torso", "head", "0 0 0.7", "0 0 0")]
    for side, sign in (("left", 1), ("right", -1)):
        at, turned = f"0.024645 {sign * 0.219645} 0.118588", f"0 0 {sign * 0.785398}"
        parts += [link(f"{side}_mount", 0.5), joint(f"{side}_m", "fixed", "torso", f"{side}_mount", at, turned)]
        before = f"{side}_mount"
        for name, xyz, rpy, (low, high), torque, mass in JOINTS:
            limit = f'<limit lower="{low}" upper="{high}" effort="{torque}" velocity="4"/>'
            parts += [link(f"{side}_{name}_link", mass)]
            parts += [joint(f"{side}_{name}", "revolute", before, f"{side}_{name}_link", xyz, rpy, limit)]
            before = f"{side}_{name}_link"
        parts += [
            link(f"{side}_hand", 0.2),
            joint(f"{side}_h", "fixed", before, f"{side}_hand", "0 0 0.11355", "0 0 0"),
        ]
        parts += [
            link(f"{side}_gripper", 0.2),
            joint(f"{side}_g", "fixed", f"{side}_hand", f"{side}_gripper", "0 0 0.1", "0 0 0"),
        ]
    path = tmp_path / "baxter_description" / "urdf" / "baxter.urdf"
    path.parent.mkdir(parents=True)
    path.write_text(f'<robot name="baxter">{"".join(parts)}</robot>')
    module = types.ModuleType("robot_descriptions.baxter_description")
    module.URDF_PATH = str(path)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "robot_descriptions", types.ModuleType("robot_descriptions"))
    monkeypatch.setitem(sys.modules, "robot_descriptions.baxter_description", module)
    return path


def test_each_arm_of_a_two_armed_robot_is_loaded_by_itself(two_armed: Path) -> None:
    left, right = arm("baxter", True, "robot"), arm("baxter", False, "robot")
    for one, side in ((left, "left"), (right, "right")):
        found = ET.fromstring(one.description)
        names = {element.get("name", "") for element in found}
        assert not any("head" in name or "gripper" in name for name in names)
        assert all(name.startswith(side) or name in ("torso", PAD_LINK) for name in names)
        assert one.chain.place.tolist() == [0.0, 0.0, 0.0]
        assert one.torque.tolist() == [50.0, 50.0, 50.0, 50.0, 15.0, 15.0, 15.0]
        assert one.turning == (1, 2, 3, 4, 5, 6, 7)
    q = np.array(left.posture)
    here, there = pose(left, q)[0], pose(right, np.array(right.posture))[0]
    assert there == pytest.approx(ACROSS @ here, abs=1e-5)


def test_a_two_armed_robot_reaches_the_default_scene(two_armed: Path) -> None:
    scene = Scene(robot="baxter")
    for place in (scene.start, scene.goal):
        with World(scene, np.random.default_rng(0)) as world:
            q = world.put(pads_beside(np.array(place), scene.box[1] + 0.1))
            for side, one in enumerate(world.arms):
                assert (q[side] >= one.low + 0.1).all()
                assert (q[side] <= one.high - 0.1).all()


def test_a_two_armed_robot_delivers_a_box(two_armed: Path) -> None:
    scene = Scene(robot="baxter")
    start, goal = np.array(scene.start), np.array(scene.goal)
    via = np.array(
        [
            start,
            start + np.array([0.0, 0.0, 0.12]),
            goal + np.array([0.0, 0.0, 0.1]),
            goal + np.array([0.0, 0.0, 0.001]),
        ]
    )
    clamp = clamp_of(CarryParameters(), CarryCondition(), scene)
    with World(scene, np.random.default_rng(0)) as world:
        carrier = Carrier(Straight(via, 0.004), start, clamp, 0.004, 5.0)
        follower = Follower(world, world.put(carrier.pads), 0.004)
        forces = []
        for _ in range(6000):
            hands = world.hands()
            carrier.step(hands.force)
            follower.follow(carrier.pads, carrier.velocities, hands.load)
            world.drive(follower.q, follower.qdot, follower.torque, 4)
            follower.advance()
            if carrier.phase is Phase.CARRY:
                forces.append(world.contact_forces())
            if carrier.phase in ENDED:
                break
        assert carrier.phase is Phase.DONE
        assert np.linalg.norm(world.box_pose()[0] - goal) < 0.02
        assert np.mean(forces) == pytest.approx(5.0, abs=0.1)


class Straight:
    """A way along straight lines at 0.1 m/s."""

    def __init__(self, via: Array, dt: float) -> None:
        self._via, self._dt, self._next = via, dt, 1

    def step(self, midpoint: Array, *, return_speed: float | None) -> Array:
        assert return_speed is None
        gap = self._via[self._next] - midpoint
        left = float(np.linalg.norm(gap))
        if left <= 0.1 * self._dt:
            self._next += 1
            return np.array(self._via[self._next - 1])
        return midpoint + gap * (0.1 * self._dt / left)

    @property
    def ended(self) -> bool:
        return self._next >= len(self._via)

    def gap(self, midpoint: Array) -> float:
        return 0.0


@pytest.mark.parametrize("failure", [ImportError("no module"), OSError("fatal: Could not resolve host: example.org")])
def test_a_description_that_is_not_to_be_had_is_a_sentence(failure: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> None:
        raise failure

    monkeypatch.setattr("stages.world.robots.importlib.import_module", fail)
    with pytest.raises(ParameterError) as error:
        arm("baxter", True, "rollout.scene.robot")
    assert error.value.location == "rollout.scene.robot"
    wanted = "clpv[robots]" if isinstance(failure, ImportError) else "could not be downloaded (fatal: Could not resolve"
    assert wanted in error.value.problem
    assert "choose iiwa or panda" in error.value.problem
