"""From what a person asks for to pushes on the arms, in cycles of the controller. Paper Fig. 5d."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stages.rollout.disturbances import begin
from stages.rollout.parameters import ArmDisturbance, Drag, Force, RandomDrag, Side
from stages.trajectory import Array
from stages.world.arm_pushes import ArmPush

SIDES: tuple[Side, Side] = ("left", "right")


def pushes_of(
    disturbances: Sequence[ArmDisturbance], undisturbed: Array, dt: float, generator: np.random.Generator
) -> list[ArmPush]:
    """Disturbances of a condition as the world takes them.

    Args:
        disturbances: in order.
        undisturbed: array, shape (n, 3), metres, one a cycle: the policy's way without them.
        dt: seconds a cycle.
        generator: of the random ones; will be advanced.
    """
    found = []
    for asked in disturbances:
        one = drawn(asked, generator) if isinstance(asked, RandomDrag) else asked
        cycle, steps = begin(one, undisturbed, dt)
        found.append(
            ArmPush(
                arm=SIDES.index(one.arm),
                cycle=cycle,
                steps=steps,
                offset=np.array(one.offset) if isinstance(one, Drag) else np.zeros(3),
                force=np.array(one.force) if isinstance(one, Force) else np.zeros(3),
                rise=one.rise if isinstance(one, Drag) else 0.0,
                hold=one.hold if isinstance(one, Drag) else one.duration,
            )
        )
    return found


def drawn(asked: RandomDrag, generator: np.random.Generator) -> Drag:
    """A random drag, drawn; all directions alike."""
    arm = SIDES[int(generator.integers(2))]
    direction = generator.normal(size=3)
    offset = generator.uniform(asked.nearest, asked.farthest) * direction / np.linalg.norm(direction)
    lasting = generator.uniform(asked.shortest, asked.longest)
    rise = min(generator.uniform(asked.quickest, asked.slowest), lasting)
    return Drag(
        arm=arm,
        offset=(float(offset[0]), float(offset[1]), float(offset[2])),
        rise=float(rise),
        hold=float(lasting - rise),
        at_fraction=float(generator.uniform(asked.earliest, asked.latest)),
    )
