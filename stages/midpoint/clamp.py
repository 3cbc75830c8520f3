"""Along which axis the arms clamp what they carry, and how far apart they are along it: L of paper eq. (13).

The paper's arms stand at +y and -y and hold a box between them. Here the axis is given, or found as the one along which
the arms are apart most; a separation that varies means that the object slipped, was gripped anew or was never held.
Arrays in, arrays out. Restoring the arms from a midpoint, eq. (13), is the policy's affair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.trajectory import Array

AXES = "xyz"


@dataclass(frozen=True, kw_only=True)
class Clamp:
    """The separation of the arms along the clamp axis in one demonstration.

    Attributes:
        mean: L of eq. (13), metres; positive where the left arm is ahead along the axis.
        spread: standard deviation, metres.
        deviation: largest deviation from the mean, metres.
        tilt: angle between the mean separation and the axis, radians.
    """

    mean: float
    spread: float
    deviation: float
    tilt: float


def clamp_axis(differences: Sequence[Array], wanted: str) -> str:
    """``x``, ``y`` or ``z``: as `wanted`, or, where that is ``auto``, the axis along which the arms are apart most.

    Arguments:
        differences: left minus right of each demonstration, arrays, shape (n, d), metres; each counts alike.

    Raises ParameterError where the data have no such axis, DataError where the arms are never apart.
    """
    mean = np.mean([np.abs(difference.mean(axis=0)) for difference in differences], axis=0)
    if wanted != "auto":
        if AXES.index(wanted) >= mean.size:
            raise ParameterError("midpoint.clamp_axis", f"is {wanted!r}; the data have {mean.size} coordinates.")
        return wanted
    if not mean.max() > 0.0:
        raise DataError("demonstrations", "both arms are at one place: select another topic for one of them.")
    return AXES[int(np.argmax(mean))]


def clamp(difference: Array, axis: str) -> Clamp:
    """The separation along `axis` of arms that are `difference`, left minus right, array, shape (n, d), metres, apart.

    Paper eq. (13).
    """
    index = AXES.index(axis)
    along = difference[:, index]
    middle = difference.mean(axis=0)
    aside = float(np.linalg.norm(np.delete(middle, index)))
    mean = float(along.mean())
    return Clamp(
        mean=mean,
        spread=float(along.std()),
        deviation=float(np.abs(along - mean).max()),
        tilt=float(np.arctan2(aside, abs(mean))),
    )


def varies(found: Clamp, limit: float, axis: str, name: str) -> str:
    """A sentence about the demonstration `name` where its separation varies by more than `limit`, metres, or none."""
    if found.deviation <= limit:
        return ""
    return (
        f"{name}: the separation of the arms along {axis}, {found.mean:.4f} m on average, varies by up to "
        f"{1e3 * found.deviation:.0f} mm (midpoint.separation_limit allows {1e3 * limit:.0f} mm): the object may have "
        "slipped, or been held for part of the time only."
    )
