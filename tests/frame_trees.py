"""Where the frames of a log are in the world, worked out from what hangs on what, as viewers do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


def placed(transforms: Sequence[Any], k: int) -> dict[str, np.ndarray]:
    """Matrices, shape (4, 4), of all frames in the world by the k-th message (a channel of one message: the only)."""
    steps: dict[str, tuple[str, np.ndarray]] = {}
    for channel in transforms:
        at = min(k, channel.time.size - 1)
        for j, (parent, child) in enumerate(zip(channel.parents, channel.children, strict=True)):
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.from_quat(channel.quaternion[at, j]).as_matrix()
            matrix[:3, 3] = channel.position[at, j]
            assert child not in steps  # a frame hangs on one other
            steps[child] = (parent, matrix)
    found = {}
    for child in steps:
        name, matrix = child, np.eye(4)
        while name in steps:
            name, step = steps[name][0], steps[name][1]
            matrix = step @ matrix
        assert name == "world"
        found[child] = matrix
    return found
