"""Two arms as one robot: a description (URDF) and a tree of frames, for recordings that viewers draw by themselves.

The description names no file: what is seen are primitive shapes, the pads as large as they are. Links and joints bear
the names that the arms' own descriptions give them, with the side in front. Arrays and texts. Not here: what the arms
truly look like (`links.py`).
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stages.trajectory import Array
from stages.world.links import frames, joint_names, link_names, steps
from stages.world.robots import PAD, Arm, arm, row
from stages.world.urdf import child

WORLD = "world"
"""The frame in which both arms stand: x forward, y to the left, z up."""

SIDES = ("left", "right")

FACE = "pad"
"""Frame in the middle of a pad's face, z towards the box: where forces act, and what poses of the pads are poses of."""

RADIUS, BALL = 0.035, 0.045
"""Of links and of joints that turn, as they are drawn, metres."""

COLOURS = ("0.20 0.45 0.70 1", "0.85 0.45 0.15 1")


@dataclass(frozen=True, kw_only=True, eq=False)
class Tree:
    """Where k frames are in those that they hang on, at n times.

    Attributes:
        parents, children: their names, k each.
        places: array, shape (n, k, 3), metres.
        turns: array, shape (n, k, 4), quaternions x y z w.
    """

    parents: tuple[str, ...]
    children: tuple[str, ...]
    places: Array
    turns: Array


def both(robot: str, location: str) -> tuple[Arm, Arm]:
    """The left and the right arm. Raises ParameterError where its description is not to be had."""
    return arm(robot, True, location), arm(robot, False, location)


def named(side: str, name: str) -> str:
    """A link or a joint of one arm among those of both; where its name begins with the side it stays as it is."""
    return name if name.startswith(f"{side}_") else f"{side}_{name}"


def turning(arms: Sequence[Arm]) -> tuple[str, ...]:
    """Names of the joints that turn: the left arm's from its base, then the right one's."""
    return tuple(
        named(side, joint_names(one)[number]) for side, one in zip(SIDES, arms, strict=True) for number in one.turning
    )


def tree(arms: Sequence[Arm], q: Array) -> tuple[Tree, Tree]:
    """Frames of both arms that never move, at one time, and those of the links behind joints that turn, at n times.

    `q`: array, shape (n, 2, m), rad.
    """
    fixed: list[tuple[str, str, Array, Array]] = []
    moving: list[tuple[str, str, Array, Array]] = []
    for index, (side, one) in enumerate(zip(SIDES, arms, strict=True)):
        chain, links = one.chain, [named(side, name) for name in link_names(one)]
        fixed.append((WORLD, links[0], chain.place, np.eye(3)[None]))
        places, turns = steps(chain, q[:, index])
        for k, turns_ in enumerate(turns):
            kept, turn = (moving, turns_) if chain.turns[k] else (fixed, chain.rotations[k][None])
            kept.append((links[k], links[k + 1], places[k], turn))
        fixed.append((links[-1], named(side, FACE), chain.tip, np.eye(3)[None]))
    return _tree(fixed, 1), _tree(moving, q.shape[0])


def faces(arms: Sequence[Arm], q: Array) -> tuple[Array, Array]:
    """Middles of both pads' faces, shape (n, 2, 3), metres, and quaternions x y z w, shape (n, 2, 4), in the world.

    `q`: array, shape (n, 2, m), rad.
    """
    found = [frames(one.chain, q[:, index]) for index, one in enumerate(arms)]
    places = [at[-1] + turns[-1] @ one.chain.tip for one, (at, turns) in zip(arms, found, strict=True)]
    return np.stack(places, axis=1), np.stack([quaternions(turns[-1]) for _, turns in found], axis=1)


def quaternions(turns: Array) -> Array:
    """Quaternions x y z w, shape (n, 4), of matrices, shape (n, 3, 3); their signs do not jump."""
    found = Rotation.from_matrix(turns).as_quat(canonical=True)
    signs = np.where((found[1:] * found[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    found[1:] *= np.cumprod(signs)[:, None]
    return np.asarray(found)


def description(robot: str, arms: Sequence[Arm]) -> str:
    """The URDF of both arms; its root is the world."""
    root = ET.Element("robot", name=f"two_{robot}")
    ET.SubElement(root, "link", name=WORLD)
    for side, colour, one in zip(SIDES, COLOURS, arms, strict=True):
        chain, joints, links = one.chain, row(ET.fromstring(one.description)), link_names(one)
        _fixed(root, WORLD, named(side, links[0]), chain.place)
        for number, name in enumerate(links):
            link = ET.SubElement(root, "link", name=named(side, name))
            if number == len(joints):
                size = _text(PAD)
                _visual(link, "box", {"size": size}, _text((0.0, 0.0, PAD[2] / 2.0)), "0 0 0", "0.35 0.35 0.35 1")
                continue
            if number and chain.turns[number - 1]:
                _visual(link, "sphere", {"radius": _text([BALL])}, "0 0 0", "0 0 0", colour)
            along = chain.offsets[number]
            length = float(np.linalg.norm(along))
            if length > 0.0:
                measures = {"radius": _text([RADIUS]), "length": _text([length])}
                _visual(link, "cylinder", measures, _text(0.5 * along), _upright(along / length), colour)
        for joint, axis in zip(joints, chain.axes, strict=True):
            _joint(root, side, joint, axis)
        _fixed(root, named(side, links[-1]), named(side, FACE), chain.tip)
        ET.SubElement(root, "link", name=named(side, FACE))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _tree(entries: Sequence[tuple[str, str, Array, Array]], n: int) -> Tree:
    """`entries`: parent, child, place, shape (3,), and matrices, shape (n, 3, 3)."""
    parents, children, places, turns = zip(*entries, strict=True)
    return Tree(
        parents=parents,
        children=children,
        places=np.tile(np.array(places), (n, 1, 1)),
        turns=np.stack([quaternions(turn) for turn in turns], axis=1),
    )


def _joint(root: ET.Element, side: str, joint: ET.Element, axis: Array) -> None:
    """Add a joint of an arm, with the numbers that its own description gives it, about `axis`, shape (3,)."""
    turns = joint.get("type") == "revolute"
    added = ET.SubElement(root, "joint", name=named(side, joint.get("name", "")), type="revolute" if turns else "fixed")
    for part in ("parent", "child"):
        ET.SubElement(added, part, link=named(side, child(joint, part).get("link", "")))
    ET.SubElement(added, "origin", child(joint, "origin").attrib)
    if turns:
        ET.SubElement(added, "axis", xyz=_text(axis))
        ET.SubElement(added, "limit", child(joint, "limit").attrib)


def _fixed(root: ET.Element, parent: str, name: str, place: Sequence[float] | Array) -> None:
    """Add a joint, called as what hangs on it, that never moves; `place`: three numbers, metres."""
    added = ET.SubElement(root, "joint", name=name, type="fixed")
    ET.SubElement(added, "parent", link=parent)
    ET.SubElement(added, "child", link=name)
    ET.SubElement(added, "origin", xyz=_text(place), rpy="0 0 0")


def _visual(link: ET.Element, shape: str, measures: dict[str, str], place: str, turn: str, colour: str) -> None:
    """Add what is seen of a link."""
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=place, rpy=turn)
    ET.SubElement(ET.SubElement(visual, "geometry"), shape, measures)
    ET.SubElement(ET.SubElement(visual, "material", name=colour.replace(" ", "_")), "color", rgba=colour)


def _upright(along: Array) -> str:
    """Roll, pitch and yaw that turn z to a unit vector, shape (3,)."""
    return _text((0.0, math.acos(min(max(float(along[2]), -1.0), 1.0)), math.atan2(along[1], along[0])))


def _text(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(value)) for value in values)
