"""Elements of a robot description (URDF), read as numbers. No files, and no robot of its own (`robots.py`)."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from stages.trajectory import Array


def child(element: ET.Element, tag: str) -> ET.Element:
    """The first child of a name; an empty one where there is none."""
    found = element.find(tag)
    return ET.Element(tag) if found is None else found


def numbers(element: ET.Element | None, name: str) -> list[float]:
    """An attribute's three numbers; zeros where there is no such element or attribute."""
    text = None if element is None else element.get(name)
    return [0.0, 0.0, 0.0] if text is None else [float(part) for part in text.split()]


def turned(rpy: list[float]) -> Array:
    """The matrix of roll, pitch and yaw about fixed axes, rad, shape (3, 3)."""
    cr, cp, cy = (math.cos(angle) for angle in rpy)
    sr, sp, sy = (math.sin(angle) for angle in rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def leading(root: ET.Element) -> dict[str, ET.Element]:
    """Link -> the joint that leads to it."""
    return {child(joint, "child").get("link", ""): joint for joint in root.iter("joint")}
