"""Pictures of the simulated world without a display or a graphics card, by Bullet's TinyRenderer.

Not here: what moves (`bullet.py` makes the world, a recorded roll-out says where everything was), and files.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.trajectory import Array
from stages.world.bullet import World
from stages.world.engine import bullet
from stages.world.parameters import Scene
from stages.world.pots import ROD, Pot, lathe, triangles

Picture = NDArray[np.uint8]

FIELD = 40.0
"""Degrees that the camera sees from top to bottom."""

NEAR, FAR = 0.1, 5.0
"""Metres between which the camera sees."""

LIGHT = (1.0, -1.2, 2.4)
"""Where light comes from."""

ARM, BOX, STAND, CLAY, TRAIL = (
    (0.62, 0.65, 0.70, 1.0),
    (0.78, 0.60, 0.40, 1.0),
    (0.45, 0.48, 0.52, 1.0),
    (0.66, 0.36, 0.24, 1.0),
    (0.10, 0.62, 0.46, 1.0),
)
PAD = (0.20, 0.22, 0.25, 1.0)

FRONT, ABOVE, MIDDLE = (1.5, -0.9, 1.15), (0.95, -1.15, 1.45), (0.42, 0.0, 0.34)
"""Where one looks from, from where among pots (which a shelf would hide), and where to, metres."""

BEAD = 0.006
"""Radius of the beads that mark a way, metres."""


@dataclass(frozen=True, kw_only=True)
class View:
    """Where the camera stands.

    Attributes:
        eye, target: metres.
        width, height: of pictures, pixels.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    width: int
    height: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Moments:
    """n moments of a roll-out.

    Attributes:
        joints: array, shape (n, 2, m), rad.
        box, turn: arrays, shapes (n, 3), metres, and (n, 4), x y z w.
        pots: array, shape (n, k, 3), metres: middles of the pots.
    """

    joints: Array
    box: Array
    turn: Array
    pots: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Film:
    """What is filmed.

    Attributes:
        scene: of the world: robot, box, start, goal.
        pots: what is in the way.
        way: array, shape (k, 3), metres: marked by beads; may be empty.
        moments: where everything is.
        view: where the camera stands.
    """

    scene: Scene
    pots: Sequence[Pot]
    way: Array
    moments: Moments
    view: View

    def pictures(self) -> Iterator[Picture]:
        """Pictures, arrays, shape (height, width, 3), of the moments; equal arrays give equal pictures."""
        engine, moments, view = bullet(), self.moments, self.view
        with World(self.scene, np.random.default_rng(0)) as world:
            _paint(engine, world)
            bodies = [_pot(engine, world.client, pot) for pot in self.pots]
            for bead in self.way:
                _bead(engine, world.client, bead)
            looking = engine.computeViewMatrix(view.eye, view.target, (0.0, 0.0, 1.0))
            lens = engine.computeProjectionMatrixFOV(FIELD, view.width / view.height, NEAR, FAR)
            for k in range(moments.box.shape[0]):
                world.pose(moments.joints[k])
                world.put_box(moments.box[k], moments.turn[k])
                for (body, rod), pot, centre in zip(bodies, self.pots, moments.pots[k], strict=True):
                    _move(engine, world.client, body, centre)
                    _move(engine, world.client, rod, centre - np.array([0.0, 0.0, 0.5 * (pot.height + pot.foot)]))
                yield _taken(engine, world.client, view, looking, lens)


def _taken(engine: Any, client: int, view: View, looking: Any, lens: Any) -> Picture:
    _, _, pixels, _, _ = engine.getCameraImage(
        view.width,
        view.height,
        looking,
        lens,
        lightDirection=LIGHT,
        shadow=1,
        renderer=engine.ER_TINY_RENDERER,
        physicsClientId=client,
    )
    return np.ascontiguousarray(np.reshape(pixels, (view.height, view.width, 4))[..., :3], dtype=np.uint8)


def _paint(engine: Any, world: World) -> None:
    """Colours of arms, pads, box and supports."""
    for body, one in zip(world.bodies, world.arms, strict=True):
        for link in range(-1, one.pad + 1):
            colour = PAD if link == one.pad else ARM
            engine.changeVisualShape(body, link, rgbaColor=colour, physicsClientId=world.client)
    engine.changeVisualShape(world.box, -1, rgbaColor=BOX, physicsClientId=world.client)
    for support in world.supports:
        engine.changeVisualShape(support, -1, rgbaColor=STAND, physicsClientId=world.client)


def _pot(engine: Any, client: int, pot: Pot) -> tuple[int, int]:
    """A pot that is only seen, and its rod."""
    corners, faces = lathe(pot).tolist(), triangles().ravel().tolist()
    shape = engine.createVisualShape(
        engine.GEOM_MESH, vertices=corners, indices=faces, rgbaColor=CLAY, physicsClientId=client
    )
    rod = engine.createVisualShape(
        engine.GEOM_CYLINDER, radius=ROD, length=pot.foot, rgbaColor=STAND, physicsClientId=client
    )
    made = [engine.createMultiBody(0.0, -1, seen, pot.centre, physicsClientId=client) for seen in (shape, rod)]
    return int(made[0]), int(made[1])


def _bead(engine: Any, client: int, place: Array) -> None:
    seen = engine.createVisualShape(engine.GEOM_SPHERE, radius=BEAD, rgbaColor=TRAIL, physicsClientId=client)
    engine.createMultiBody(0.0, -1, seen, place.tolist(), physicsClientId=client)


def _move(engine: Any, client: int, body: int, place: Array) -> None:
    engine.resetBasePositionAndOrientation(body, place.tolist(), (0.0, 0.0, 0.0, 1.0), physicsClientId=client)
