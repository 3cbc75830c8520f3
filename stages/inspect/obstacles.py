"""Obstacles of a scene for the viewer: outlines in a plane, bodies in space, and traps on them. Paper Fig. 4."""

from __future__ import annotations

import numpy as np

from stages.artifacts.rollouts import RecordedScene
from stages.figures.flow import outline
from stages.inspect.stream import OBSTACLE, PLANAR, TRAP, Stream
from stages.policy.avoidance.shapes import BOX, RADIUS, REACH, SIZES
from stages.trajectory import Array
from stages.world.description import quaternions

MOMENTS = 150
"""Moments at which a moving obstacle is drawn, at most."""


def draw_obstacles(stream: Stream, root: str, scene: RecordedScene, time: Array) -> None:
    """Write obstacles below `root`, in the plane as outlines, in space as bodies; and traps on them.

    `time`: array, shape (n,), seconds; those that move are drawn at up to `MOMENTS` of these.
    """
    shapes, d = scene.shapes, scene.shapes.centres.shape[1]
    moments = time[np.unique(np.linspace(0, time.shape[0] - 1, MOMENTS).astype(int))]
    size = float(shapes.measures[:, REACH].max(initial=0.0))
    for index in range(shapes.number):
        entity, velocity = f"{root}/{index + 1}", shapes.velocities[index]
        if d == PLANAR:
            edge = outline(shapes, index, (0, 1))
            if velocity.any():
                moved = edge[None] + moments[:, None, None] * velocity
                columns = stream.rr.LineStrips2D.columns(
                    strips=list(moved), colors=[OBSTACLE] * len(moments), radii=[0.02 * size] * len(moments)
                )
                stream.columns(entity, moments, columns)
            else:
                stream.ways(entity, [edge], OBSTACLE, 0.04 * size)
        else:
            half = shapes.measures[index, SIZES:] + shapes.measures[index, RADIUS]  # of a sphere, the sizes are 0
            solid = stream.rr.Boxes3D if shapes.kinds[index] == BOX else stream.rr.Ellipsoids3D
            stream.still(entity, solid(half_sizes=[half], colors=[(*OBSTACLE, 90)], fill_mode="solid"))
            turn = quaternions(shapes.frames[index][None])
            where = shapes.centres[index] + moments[:, None] * velocity
            stream.columns(
                entity,
                moments,
                stream.rr.Transform3D.columns(translation=where, quaternion=np.repeat(turn, len(moments), axis=0)),
            )
    if scene.traps is not None and scene.traps.size:
        stream.spots(f"{root}/traps", scene.traps, TRAP, 0.1 * size, ["trap"] * len(scene.traps))
