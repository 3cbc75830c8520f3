"""Forward kinematics: from recorded joint positions to the pose of a link, with the robot's URDF.

pytransform3d reads the URDF; the chain from the root to the link is then a product of fixed transforms and turns or
slides about joint axes, computed for all samples at once. Not here: which joints a message holds (`selection.py`), and
closed chains, floating or planar joints, which have no pose that joint positions alone give. No part of the paper: its
arms publish their poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from pipeline.errors import DataError
from stages.ingest.names import nearest
from stages.trajectory import Array

BULK = ("visual", "collision", "inertial", "gazebo", "transmission", "sensor")
"""Parts of a URDF that say nothing about kinematics; left out, so that nothing in them can be wrong."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Joint:
    """A joint of a chain.

    Attributes:
        origin: array, shape (4, 4): pose of its child's frame in its parent's at position 0, metres.
        turn: array, shape (3,): unit axis of rotation in the child's frame; zero where it does not turn.
        slide: array, shape (3,): unit axis of translation; zero where it does not slide.
        driver: name of the joint whose recorded position moves it; "" for a fixed joint.
        multiplier, offset: its position is multiplier x driver's position + offset: 1 and 0, unless it mimics.
    """

    origin: Array
    turn: Array
    slide: Array
    driver: str = ""
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """The joints from a robot's root to one of its links.

    Attributes:
        link: its end. joints: from the root on.
        drivers: names of the joints whose positions it needs, each once.
    """

    link: str
    joints: tuple[Joint, ...]
    drivers: tuple[str, ...]

    def forward(self, positions: Array) -> tuple[Array, Array]:
        """The link's pose in the root's frame: position, array, shape (n, 3), metres, and quaternion, (n, 4), x y z w.

        Arguments:
            positions: array, shape (n, drivers), radians or metres, in the order of `drivers`.
        """
        count = positions.shape[0]
        turned = np.broadcast_to(np.eye(3), (count, 3, 3))
        moved = np.zeros((count, 3))
        for joint in self.joints:
            moved = moved + turned @ joint.origin[:3, 3]
            turned = turned @ joint.origin[:3, :3]
            if joint.driver:
                value = joint.multiplier * positions[:, self.drivers.index(joint.driver)] + joint.offset
                moved = moved + np.einsum("nij,nj->ni", turned, value[:, None] * joint.slide)
                turned = turned @ rotations(joint.turn, value)
        return moved, quaternions(turned)


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """A robot's kinematic tree.

    Attributes:
        source: file name of the URDF, for messages.
        joints: child link -> its parent link and the joint between them.
        links: names of all links.
    """

    source: str
    joints: Mapping[str, tuple[str, Joint]]
    links: tuple[str, ...]

    def chain(self, link: str) -> Chain:
        """The chain from the root to `link`.

        Raises DataError where there is no such link, where a loop leads to it, or where no joint on the way moves.
        """
        if link not in self.links:
            raise DataError(self.source, f"has no link {link!r}; {nearest(link, self.links)}")
        joints: list[Joint] = []
        here = link
        while here in self.joints:
            if len(joints) > len(self.joints):
                raise DataError(self.source, f"the chain to link {link!r} is a loop; a URDF must be a tree.")
            here, joint = self.joints[here]
            joints.append(joint)
        joints.reverse()
        drivers = tuple(dict.fromkeys(joint.driver for joint in joints if joint.driver))
        if not drivers:
            raise DataError(self.source, f"no joint moves link {link!r}: name a link further down an arm.")
        return Chain(link=link, joints=tuple(joints), drivers=drivers)


def read_robot(text: str, source: str) -> Robot:
    """A robot from the text of its URDF; `source` is what messages call it.

    Raises DataError where the text is no URDF that pytransform3d can read, or a mimicked joint does not exist.
    """
    from pytransform3d.urdf import UrdfException, parse_urdf

    try:
        tree = ElementTree.fromstring(text)
        _strip(tree)
        _, links, joints = parse_urdf(ElementTree.tostring(tree, encoding="unicode"))
    except ElementTree.ParseError as error:
        raise DataError(source, f"is not a URDF, or is damaged: it is not XML ({error}).") from None
    except (UrdfException, ValueError, TypeError, AttributeError, KeyError, IndexError) as error:
        problem = (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")
        raise DataError(source, f"is not a URDF that can be used: {problem}; expand xacro files first.") from None
    mimics = _mimics(tree)
    known = {str(joint.joint_name) for joint in joints}
    found: dict[str, tuple[str, Joint]] = {}
    for joint in joints:
        driver, multiplier, offset = _driver(str(joint.joint_name), mimics, known, source)
        turns, slides = joint.joint_type in ("revolute", "continuous"), joint.joint_type == "prismatic"
        axis = np.zeros(3) if joint.joint_axis is None else np.asarray(joint.joint_axis, dtype=np.float64)
        length = float(np.linalg.norm(axis))
        if (turns or slides) and not 0.0 < length < np.inf:
            raise DataError(source, f"joint {joint.joint_name!r} has no axis.")
        unit = axis / length if length else axis
        found[str(joint.child)] = (
            str(joint.parent),
            Joint(
                origin=np.asarray(joint.child2parent, dtype=np.float64),
                turn=unit if turns else np.zeros(3),
                slide=unit if slides else np.zeros(3),
                driver=driver if turns or slides else "",
                multiplier=multiplier,
                offset=offset,
            ),
        )
    return Robot(source=source, joints=found, links=tuple(str(link.name) for link in links))


def rotations(axis: Array, angles: Array) -> Array:
    """Rotation matrices, array, shape (n, 3, 3), by `angles`, shape (n,), rad, about a unit or zero axis, shape (3,).

    Rodrigues' formula; a zero axis gives identities.
    """
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angles)[:, None, None], (1.0 - np.cos(angles))[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def quaternions(matrices: Array) -> Array:
    """Quaternions, array, shape (n, 4), x y z w, of rotation matrices, array, shape (n, 3, 3)."""
    if matrices.shape[0] == 0:
        return np.zeros((0, 4))
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(matrices).as_quat())


def _strip(tree: ElementTree.Element) -> None:
    """Remove what is not kinematics. `tree` will be modified."""
    for parent in list(tree.iter()):
        for child in list(parent):
            if isinstance(child.tag, str) and child.tag.rpartition("}")[2] in BULK:
                parent.remove(child)


def _mimics(tree: ElementTree.Element) -> dict[str, tuple[str, float, float]]:
    """Joint -> the joint that it mimics, multiplier and offset; pytransform3d does not read them."""
    found = {}
    for joint in tree.iter("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            found[joint.get("name", "")] = (
                mimic.get("joint", ""),
                _number(mimic, "multiplier", 1.0),
                _number(mimic, "offset", 0.0),
            )
    return found


def _number(element: ElementTree.Element, name: str, default: float) -> float:
    try:
        return float(element.get(name, default))
    except ValueError:
        return default


def _driver(
    name: str, mimics: Mapping[str, tuple[str, float, float]], known: set[str], source: str
) -> tuple[str, float, float]:
    """The joint that moves a joint, through any chain of mimics, and the line that leads from one to the other."""
    multiplier, offset = 1.0, 0.0
    seen = [name]
    while name in mimics:
        other, factor, constant = mimics[name]
        if other not in known or other in seen:
            raise DataError(source, f"joint {seen[0]!r} mimics {other!r}, which does not exist or leads back to it.")
        multiplier, offset = multiplier * factor, multiplier * constant + offset
        name = other
        seen.append(name)
    return name, multiplier, offset
