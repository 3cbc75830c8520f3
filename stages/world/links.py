"""Where every link of an arm is while its joints move, and what is seen of it: for pictures and recordings.

Arrays and a description in, arrays out; all samples at once. Not here: one pose in a control loop (`chain.py`).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stages.trajectory import Array
from stages.world.chain import Chain
from stages.world.robots import Arm, row
from stages.world.urdf import child, numbers, turned


@dataclass(frozen=True, kw_only=True, eq=False)
class Visual:
    """What is seen of a link.

    Attributes:
        link: its name.
        joint: number of the joint that leads to the link, counted from the base; 0: the link is the base itself.
        mesh: its file; none: it is a box.
        edges: array, shape (3,): of the box, metres; of a mesh the factors by which it is larger than its file says.
        place: array, shape (3,), metres, in the link's frame.
        turn: array, shape (3, 3), in the link's frame.
    """

    link: str
    joint: int
    mesh: Path | None
    edges: Array
    place: Array
    turn: Array


def visuals(one: Arm) -> list[Visual]:
    """What is seen of an arm, from its base to its pad."""
    root = ET.fromstring(one.description)
    links = {link.get("name", ""): link for link in root.iter("link")}
    found = []
    for number, name in enumerate(link_names(one)):
        for visual in links[name].findall("visual"):
            shape = child(visual, "geometry")
            mesh, box = shape.find("mesh"), shape.find("box")
            if mesh is None and box is None:
                continue
            origin = visual.find("origin")
            text = mesh.get("scale", "1 1 1") if mesh is not None else child(shape, "box").get("size", "0 0 0")
            found.append(
                Visual(
                    link=name,
                    joint=number,
                    mesh=None if mesh is None else Path(mesh.get("filename", "")),
                    edges=np.array([float(part) for part in text.split()]),
                    place=np.array(numbers(origin, "xyz")),
                    turn=turned(numbers(origin, "rpy")),
                )
            )
    return found


def link_names(one: Arm) -> list[str]:
    """Names of the base and of the link behind each joint, in order."""
    joints = row(ET.fromstring(one.description))
    return [child(joints[0], "parent").get("link", ""), *(child(joint, "child").get("link", "") for joint in joints)]


def joint_names(one: Arm) -> list[str]:
    """Names of all joints from the base to the pad, in order; `one.turning` are the numbers of those that turn."""
    return [joint.get("name", "") for joint in row(ET.fromstring(one.description))]


def steps(chain: Chain, q: Array) -> tuple[Array, Array]:
    """Each link's frame in that of the link before.

    Args:
        chain: the arm, k joints of which m turn.
        q: array, shape (n, m), rad.

    Returns:
        places, array, shape (k, 3), metres, and rotations, array, shape (k, n, 3, 3).
    """
    rotations = np.tile(chain.rotations[:, None], (1, q.shape[0], 1, 1))
    for joint, index in enumerate(np.flatnonzero(chain.turns)):
        rotations[index] = rotations[index] @ about(chain.axes[index], q[:, joint])
    return chain.offsets, rotations


def frames(chain: Chain, q: Array) -> tuple[Array, Array]:
    """Frames of the base and of the link behind each of k joints, in the world.

    Args:
        chain: the arm.
        q: array, shape (n, m), rad.

    Returns:
        places, array, shape (k + 1, n, 3), metres, and rotations, array, shape (k + 1, n, 3, 3).
    """
    n = q.shape[0]
    places, turns = [np.tile(chain.place, (n, 1))], [np.tile(np.eye(3), (n, 1, 1))]
    for offset, rotation in zip(*steps(chain, q), strict=True):
        places.append(places[-1] + turns[-1] @ offset)
        turns.append(turns[-1] @ rotation)
    return np.array(places), np.array(turns)


def about(axis: Array, angles: Array) -> Array:
    """Turns about a unit vector, shape (3,), by each of n angles, rad; shape (n, 3, 3). Rodrigues."""
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross))
