"""The arms that the simulated world knows: description, posture, and the flat pad that is put on the flange.

Descriptions come with the pybullet wheel, or are downloaded by robot_descriptions, and are read in place, never copied;
the arm that is loaded is made of them in memory: only what leads to the flange is kept, and a pad is fixed there. Of a
robot with two arms each is loaded by itself. Not here: the simulation (`bullet.py`).
"""

from __future__ import annotations

import importlib
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import ParameterError
from stages.trajectory import Array, frozen
from stages.world.chain import Chain
from stages.world.urdf import child, leading, numbers, turned

PAD = (0.10, 0.10, 0.02)
"""Edges of a pad, metres; the third one along the tool's axis."""

PAD_MASS = 0.2
"""kg."""

PAD_LINK = "clpv_pad"


@dataclass(frozen=True, kw_only=True)
class Robot:
    """One arm, of which two are set beside each other; the right one mirrors the left one.

    Attributes:
        file: description, relative to the data of pybullet; or a module of robot_descriptions.
        flange: links on which the pads are put, of the left and the right arm.
        stem: metres from the flange's frame to the back of the pad, along its z axis.
        posture: of the left arm, rad, one a joint: elbow up, pad to the right.
        mirror: +1 or -1 a joint: the right arm's posture.
        aside: metres of each base from the middle.
        stiffness: 1/s^2, of each joint's acceleration for its error.
    """

    file: str
    flange: tuple[str, str]
    stem: float
    posture: tuple[float, ...]
    mirror: tuple[int, ...]
    aside: float
    stiffness: tuple[float, ...]


ROBOTS = {
    "iiwa": Robot(
        file="kuka_iiwa/model.urdf",
        flange=("lbr_iiwa_link_7", "lbr_iiwa_link_7"),
        stem=0.045,
        posture=(-0.25, 0.60, -0.07, -1.50, 1.44, -1.27, 0.55),
        mirror=(-1, 1, -1, 1, -1, 1, -1),
        aside=0.50,
        # The wrist's links are light, so the same torque needs a larger factor.
        stiffness=(400.0, 400.0, 400.0, 400.0, 1600.0, 3600.0, 6400.0),
    ),
    # Along the way of the box the smallest singular value stays above 0.15 and joints 0.76 rad from their limits;
    # bases as far apart as the iiwa's leave 0.08.
    "panda": Robot(
        file="franka_panda/panda.urdf",
        flange=("panda_link8", "panda_link8"),
        stem=0.0,
        posture=(0.0, 0.13, 0.0, -2.08, -1.57, 1.58, 0.64),
        mirror=(-1, 1, -1, 1, -1, 1, -1),
        aside=0.30,
        # Softer wrists let the pads turn by a degree: the upper edges of the pads carry less, and the box creeps.
        stiffness=(400.0, 400.0, 400.0, 400.0, 1600.0, 3600.0, 6400.0),
    ),
}


DOWNLOADED = {
    # Both arms on one torso. Along the way of the box the smallest singular value stays above 0.17 and joints 0.33 rad
    # from their limits, by the published kinematics.
    "baxter": Robot(
        file="baxter_description",
        flange=("left_hand", "right_hand"),
        stem=0.0,
        posture=(0.464, -0.285, -1.783, 1.844, -0.244, 0.931, 0.0),
        mirror=(-1, 1, -1, 1, -1, 1, -1),
        aside=0.0,
        stiffness=(400.0, 400.0, 400.0, 400.0, 1600.0, 3600.0, 6400.0),
    ),
}
"""Robots whose descriptions robot_descriptions (extra ``robots``) fetches when they are first asked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Arm:
    """One arm as it is loaded.

    Attributes:
        description: URDF with absolute paths.
        chain: its kinematics; the tip is the middle of the pad's face.
        posture: array, shape (m,), rad.
        low, high: arrays, shape (m,), rad: limits of the joints.
        torque: array, shape (m,), newton metres: the largest.
        speed: array, shape (m,), rad/s: the largest.
        stiffness: array, shape (m,), 1/s^2.
        turning: numbers that Bullet gives to the m joints that turn; fixed ones may lie between.
        pad: number of the pad's joint.
    """

    description: str
    chain: Chain
    posture: Array
    low: Array
    high: Array
    torque: Array
    speed: Array
    stiffness: Array
    turning: tuple[int, ...]
    pad: int


def arm(name: str, left: bool, location: str) -> Arm:
    """The left or the right arm of a robot.

    Raises ParameterError where the robot's description is not to be had; `location` is its dotted place.
    """
    robot = DOWNLOADED.get(name) or ROBOTS[name]
    path = _downloaded(name, robot, location) if name in DOWNLOADED else _in_the_wheel(robot)
    root = _with_pad(ET.parse(path).getroot(), robot, robot.flange[0 if left else 1], path.parent)
    joints = row(root)
    turning = [joint for joint in joints if joint.get("type") == "revolute"]
    limits = [child(joint, "limit").attrib for joint in turning]
    side = 1.0 if left else -1.0
    return Arm(
        description=ET.tostring(root, encoding="unicode"),
        chain=_chain(joints, np.array([0.0, side * robot.aside, 0.0])),
        posture=frozen(np.array(robot.posture) * (1.0 if left else np.array(robot.mirror))),
        low=frozen([float(limit["lower"]) for limit in limits]),
        high=frozen([float(limit["upper"]) for limit in limits]),
        torque=frozen([float(limit["effort"]) for limit in limits]),
        speed=frozen([float(limit["velocity"]) for limit in limits]),
        stiffness=frozen(robot.stiffness),
        # Bullet numbers the joints of a row from its base, in whatever order the description has them.
        turning=tuple(number for number, joint in enumerate(joints) if joint in turning),
        pad=len(joints) - 1,
    )


def _in_the_wheel(robot: Robot) -> Path:
    """The description of a robot that comes with pybullet."""
    import pybullet_data

    return Path(pybullet_data.getDataPath(), robot.file)


def _downloaded(name: str, robot: Robot, location: str) -> Path:
    """The description of a robot that is fetched when it is first asked for. Raises ParameterError where it is not."""
    try:
        found = importlib.import_module(f"robot_descriptions.{robot.file}")
    except ImportError:
        raise ParameterError(
            location,
            f"{name} needs robot_descriptions: pip install 'clpv[robots]', or choose {' or '.join(ROBOTS)}.",
        ) from None
    except Exception as error:  # git's own, or the file system's
        line = str(error).strip().splitlines()[-1][:200] if str(error).strip() else type(error).__name__
        raise ParameterError(
            location,
            f"the description of {name} could not be downloaded ({line}): try again with a connection, or choose "
            f"{' or '.join(ROBOTS)}.",
        ) from error
    return Path(found.URDF_PATH)


def _with_pad(root: ET.Element, robot: Robot, flange: str, folder: Path) -> ET.Element:
    """What leads to the flange, and the pad, with absolute paths."""
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "").removeprefix("package://")
        # A package's name stands for the folder above that of the description, or for none.
        places = [folder / name, *(parent / name for parent in folder.parents)]
        mesh.set("filename", str(next((place for place in places if place.exists()), places[0])))
    ways = leading(root)
    link, kept = flange, [flange]
    while link in ways:
        link = child(ways[link], "parent").get("link", "")
        kept.append(link)
    for element in list(root):
        part = child(element, "child").get("link") if element.tag == "joint" else element.get("name")
        if element.tag in ("transmission", "gazebo") or (element.tag in ("joint", "link") and part not in kept):
            root.remove(element)
    size = " ".join(map(str, PAD))
    inertia = [PAD_MASS / 12.0 * (sum(e * e for e in PAD) - PAD[axis] ** 2) for axis in range(3)]
    shape = f'<origin xyz="0 0 {PAD[2] / 2}"/><geometry><box size="{size}"/></geometry>'
    root.append(
        ET.fromstring(
            f'<link name="{PAD_LINK}"><inertial><origin xyz="0 0 {PAD[2] / 2}"/><mass value="{PAD_MASS}"/>'
            f'<inertia ixx="{inertia[0]}" ixy="0" ixz="0" iyy="{inertia[1]}" iyz="0" izz="{inertia[2]}"/></inertial>'
            f"<visual>{shape}</visual><collision>{shape}</collision></link>"
        )
    )
    root.append(
        ET.fromstring(
            f'<joint name="{PAD_LINK}" type="fixed"><parent link="{flange}"/><child link="{PAD_LINK}"/>'
            f'<origin xyz="0 0 {robot.stem}" rpy="0 0 0"/></joint>'
        )
    )
    return root


def row(root: ET.Element) -> list[ET.Element]:
    """The joints from the base to the pad, in order."""
    ways = leading(root)
    joints, link = [], PAD_LINK
    while link in ways:
        joints.append(ways[link])
        link = child(ways[link], "parent").get("link", "")
    return joints[::-1]


def _chain(joints: list[ET.Element], place: Array) -> Chain:
    origins = [joint.find("origin") for joint in joints]
    axes = [joint.find("axis") for joint in joints]
    return Chain(
        place,
        np.array([turned(numbers(origin, "rpy")) for origin in origins]),
        np.array([numbers(origin, "xyz") for origin in origins]),
        np.array([[0.0, 0.0, 1.0] if axis is None else numbers(axis, "xyz") for axis in axes]),
        np.array([joint.get("type") == "revolute" for joint in joints]),
        np.array([0.0, 0.0, PAD[2]]),
    )
