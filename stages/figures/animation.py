"""A moving picture of two arms that carry a box, a GIF: rendered without a display, from a recorded roll-out. Fig. 5.

Results in, bytes out.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.report import Animation
from stages.artifacts.rollouts import SIDES, RecordedCarry, RecordedRollout
from stages.figures.carry_cases import carry_parameters
from stages.figures.numbers import condition_name, controller_name, method_title, number
from stages.figures.results import PointResults
from stages.figures.telling import telling
from stages.paths import arc_length
from stages.policy.carrying import Phase
from stages.policy.outcome import Outcome
from stages.trajectory import Array, frozen
from stages.world.camera import ABOVE, FRONT, MIDDLE, Film, Moments, Picture, View
from stages.world.pots import Pot

PICTURES = 48
"""Pictures of a roll-out."""

DELAY = 0.12
"""Seconds between them."""

WIDTH, HEIGHT = 480, 320

COLOURS = 128
"""Of the one palette of all pictures."""

SAMPLED = 6
"""Pictures, about, of whose colours the palette is made."""

BEADS = 0.02
"""Metres between the beads that mark the way of x."""


def carry_animation(point: PointResults) -> Animation:
    """The moving picture of the carried box that shows the most."""
    (rollout,) = telling(point.rollouts)
    carry = rollout.carry
    assert carry is not None  # a point in which arms carry boxes
    shown = np.unique(np.linspace(0, rollout.time.shape[0] - 1, PICTURES).round().astype(int))
    pictures = list(staged(point, rollout, carry, shown).pictures())
    gif, still = encoded(pictures, best_still(carry, shown))
    faster = float(rollout.time[-1]) / (DELAY * len(pictures))
    return Animation(gif=gif, still=still, alt=_alt(rollout, carry), caption=_caption(rollout, faster))


def staged(point: PointResults, rollout: RecordedRollout, carry: RecordedCarry, shown: NDArray[np.intp]) -> Film:
    """The world as it was at some samples, and where the camera stands; `shown`: array, shape (k,)."""
    facts = carry.facts
    scene = replace(
        carry_parameters(point).scene,
        start=tuple(facts["start"]),
        goal=tuple(facts["goal"]),
        box=tuple(facts["box"]),
        centre_of_mass=tuple(facts["centre_of_mass"]),
    )
    pots = [Pot(centre=tuple(p["centre"]), height=p["height"], width=p["width"]) for p in facts["pots"]]
    centres = np.array([pot.centre for pot in pots]).reshape(1, -1, 3)
    velocities = point.scenes[rollout.scene].shapes.velocities if pots else np.empty((0, 3))
    moved = carry.led(rollout.time)[shown, None, None] * velocities
    moments = Moments(
        joints=carry.joints[shown], box=carry.box[shown], turn=carry.turn[shown], pots=frozen(centres + moved)
    )
    view = View(eye=ABOVE if pots else FRONT, target=MIDDLE, width=WIDTH, height=HEIGHT)
    return Film(scene=scene, pots=pots, way=beads(rollout.x), moments=moments, view=view)


def beads(way: Array) -> Array:
    """Places on a path, arrays, shape (n, 3), metres, about `BEADS` apart."""
    length = arc_length(way)
    wanted = np.arange(0.0, length[-1] + BEADS, BEADS)
    return np.column_stack([np.interp(wanted, length, way[:, axis]) for axis in range(3)])


def best_still(carry: RecordedCarry, shown: NDArray[np.intp]) -> int:
    """Which of the pictures tells most by itself: in the middle of a push, or of the way."""
    pushed = np.flatnonzero(carry.pushed[shown].any(axis=1))
    led = np.flatnonzero(carry.phase[shown] == str(Phase.CARRY))
    some = pushed if pushed.size else led if led.size else np.arange(shown.size)
    return int(some[some.size // 2])


def _caption(rollout: RecordedRollout, faster: float) -> str:
    method = "" if rollout.avoidance == "none" else f", {method_title(rollout.avoidance)}"
    return (
        f"Roll-out `{rollout.rollout}`: {controller_name(rollout.label)}{method}, {condition_name(rollout.condition)}, "
        f"{number(faster, 2)} times as fast as it was. Beads: the way of x. "
        f"`clpv inspect` shows all roll-outs from all sides."
    )


def _alt(rollout: RecordedRollout, carry: RecordedCarry) -> str:
    facts = carry.facts
    pushed = [SIDES[side] for side in range(2) if carry.pushed[:, side].any()]
    words = ["Two arms take a box between their pads, lift it from a pedestal"]
    if facts["pots"]:
        words.append("lead it past a flowerpot")
    if pushed:
        words.append(f"are disturbed at the {' and the '.join(pushed)} one")
    words.append("and set it down on a shelf" if rollout.outcome == Outcome.ARRIVED else f"and end {rollout.outcome}")
    return ", ".join(words[:-1]) + " " + words[-1] + "."


def encoded(pictures: Sequence[Picture], still: int) -> tuple[bytes, bytes]:
    """Pictures, arrays, shape (height, width, 3), as a GIF that repeats, and the picture number `still` as a PNG.

    All pictures share one palette, so that what does not move does not flicker.
    """
    from PIL import Image

    images = [Image.fromarray(picture) for picture in pictures]
    some = Image.fromarray(np.concatenate(pictures[:: max(1, len(pictures) // SAMPLED)]))
    palette = some.quantize(COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    drawn = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    gif, png = io.BytesIO(), io.BytesIO()
    drawn[0].save(
        gif, format="GIF", save_all=True, append_images=drawn[1:], duration=round(1e3 * DELAY), loop=0, optimize=False
    )
    drawn[still].save(png, format="PNG", optimize=True)
    return gif.getvalue(), png.getvalue()
