"""A selection that was found in a recording: what to read, and what becomes of the numbers that were read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import DataError, ParameterError
from stages.ingest.names import nearest
from stages.ingest.recording import Nanoseconds, Request, Samples, Topic
from stages.ingest.selections.extractors import JointPositions, Transforms
from stages.ingest.selections.kinematics import Chain, Robot
from stages.ingest.selections.layouts import Layout
from stages.trajectory import Array

Quantity = Literal["pose", "force", "number"]

NEEDED: dict[str, tuple[int, ...]] = {"pose": (3, 7), "force": (3,), "number": (1,)}
"""How many numbers a list of paths, a slice or a list of columns may give."""

MEANT = {
    "pose": "three numbers (x y z) or seven (x y z qx qy qz qw)",
    "force": "three numbers (fx fy fz)",
    "number": "one number",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """What a selection found in a recording, in the order in which it lies there.

    Attributes:
        log_time: array, shape (n,), nanoseconds. stamp: the same, of the messages' headers, or None.
        values: array, shape (n, 3), metres or newtons; (n, 1) of a number.
        quaternion: array, shape (n, 4), x y z w, as recorded, or None.
    """

    log_time: Nanoseconds
    stamp: Nanoseconds | None
    values: Array
    quaternion: Array | None = None

    @property
    def stamped(self) -> NDArray[np.bool_]:
        """Whether somebody set each header's stamp, array of bool, shape (n,).

        A stamp of 0 is none, unless the recording's own clock says 0, too: a simulation's begins there.
        """
        if self.stamp is None:
            return np.zeros(self.log_time.shape, dtype=np.bool_)
        return np.asarray((self.stamp != 0) | (self.log_time == 0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Resolved:
    """A selection that was found in a recording.

    Attributes:
        source: file name and expression, for messages.
        request: what a reader needs of it.
        layout: what its numbers are. chain: of joint positions.
    """

    source: str
    request: Request
    layout: Layout
    chain: Chain | None = None

    def track(self, samples: Samples, scale: float = 1.0) -> Track:
        """Positions in metres (lengths were recorded in units of `scale` metres; forward kinematics gives metres).

        Raises DataError, naming what there was instead, where nothing was found.
        """
        if samples.values.shape[0] == 0:
            raise DataError(self.source, self._nothing())
        values, quaternion = samples.values[:, :3], None
        if self.chain is not None:
            values, quaternion = self.chain.forward(samples.values)
            scale = 1.0
        elif self.layout == "quaternion":
            quaternion = samples.values[:, 3:7]
        elif self.layout == "euler":
            quaternion = from_euler(samples.values[:, 3:6])
        return Track(
            log_time=samples.log_time,
            stamp=samples.stamp,
            values=values if scale == 1.0 else values * scale,
            quaternion=quaternion,
        )

    def _nothing(self) -> str:
        extract = self.request.extract
        if isinstance(extract, Transforms):
            pairs = [f"{parent}->{child}" for parent, child in extract.seen]
            wanted = f"{extract.parent}->{extract.child}"
            return f"there is no transform of that pair of frames; {nearest(wanted, pairs)}"
        if isinstance(extract, JointPositions) and self.chain is not None:
            missing = [name for name in self.chain.drivers if name not in extract.seen]
            if extract.seen and missing:
                return f"no message has the joint {missing[0]!r}; {nearest(missing[0], extract.seen)}"
            return "no message has the positions of all joints on the way to the link."
        return "no message holds these numbers: the arrays are too short, or there are no messages."


def resolved(
    place: str,
    topic: Topic,
    extract: Any,
    width: int,
    layout: Layout,
    columns: Sequence[str] = (),
    chain: Chain | None = None,
) -> Resolved:
    """A selection that was found in `topic`; `place` is what messages call it."""
    request = Request(topic=topic.name, extract=extract, width=width, columns=tuple(dict.fromkeys(columns)))
    return Resolved(source=place, request=request, layout=layout, chain=chain)


def layout_of(width: int, place: str, quantity: Quantity) -> Layout:
    """What so many numbers are; raises DataError where they cannot be what is selected."""
    if width not in NEEDED[quantity]:
        raise DataError(place, f"gives {width} number(s), not {MEANT[quantity]}.")
    return "number" if quantity == "number" else "quaternion" if width == 7 else "position"


def chain_to(link: str, robot: Robot | None, place: str) -> Chain:
    """The chain to a link; raises ParameterError where there is no robot description, DataError where no such link."""
    if robot is None:
        raise ParameterError("ingest.urdf", f"must be given: forward kinematics needs a URDF ({place}).")
    return robot.chain(link)


def from_euler(angles: Array) -> Array:
    """Quaternions, array, shape (n, 4), x y z w, of roll, pitch, yaw about fixed axes, array, shape (n, 3), rad."""
    from scipy.spatial.transform import Rotation

    finite = np.isfinite(angles).all(axis=1)
    found = np.full((angles.shape[0], 4), np.nan)
    if finite.any():
        found[finite] = Rotation.from_euler("xyz", angles[finite]).as_quat()
    return found
