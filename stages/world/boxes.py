"""Boxes that vary, and scenes that cannot work, said before anything runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.errors import ParameterError
from stages.trajectory import Array
from stages.world.bullet import GRAVITY, PAD_FRICTION, World
from stages.world.parameters import Scene

SHORTEST = 0.02
"""Metres between start and goal: a box that is let go as far from its goal still counts as delivered."""


def pads_beside(midpoint: Array, apart: float) -> Array:
    """Both pads, shape (2, 3), metres, `apart` metres from each other about a midpoint. Paper eq. (13)."""
    aside = np.array([0.0, 0.5 * apart, 0.0])
    return np.array([midpoint + aside, midpoint - aside])


def grip_ratio(scene: Scene, force: float) -> float:
    """2 mu F_d/(m g): below 1 the box slips out."""
    return 2.0 * scene.friction * PAD_FRICTION * force / (scene.mass * GRAVITY)


def varied(scene: Scene, generator: np.random.Generator) -> Scene:
    """The scene of one box, drawn uniformly within the scene's variation."""
    v = scene.variation
    mass, friction = (scene.mass, scene.friction) + generator.uniform(-1.0, 1.0, 2) * (v.mass, v.friction)
    start = np.array(scene.start)
    start[:2] += v.start * generator.uniform(-1.0, 1.0, 2)
    centre = np.array(scene.centre_of_mass) + v.centre_of_mass * generator.uniform(-1.0, 1.0, 3)
    bias = np.array(scene.bias) + v.bias * generator.uniform(-1.0, 1.0, 2)
    return replace(
        scene,
        mass=float(mass),
        friction=float(friction),
        start=(float(start[0]), float(start[1]), float(start[2])),
        centre_of_mass=(float(centre[0]), float(centre[1]), float(centre[2])),
        bias=(float(bias[0]), float(bias[1])),
    )


def check_scene(scene: Scene, force: float, stand_off: float, location: str, length_error: float = 0.0) -> None:
    """Refuse a scene that cannot work.

    Args:
        scene: arms and box.
        force: F_d, newtons.
        stand_off: of the pads from the box, metres.
        location: dotted place of the scene.
        length_error: by how much at least the controller takes the box for longer than it is, beside the scene's own,
            metres.

    Raises:
        ParameterError: friction cannot hold the box, an arm cannot reach it, or something would begin or end inside of
            something else.
    """
    v = scene.variation
    for name, value, spread in (("mass", scene.mass, v.mass), ("friction", scene.friction, v.friction)):
        if spread >= value:
            raise ParameterError(
                f"{location}.variation.{name}", f"+-{spread:g} about {value:g} reaches 0: make it smaller."
            )
    for centre, spread, edge in zip(scene.centre_of_mass, [v.centre_of_mass] * 3, scene.box, strict=True):
        if abs(centre) + spread >= 0.5 * edge:
            raise ParameterError(f"{location}.centre_of_mass", "lies outside of the box, or may by its variation.")
    weakest = replace(scene, mass=scene.mass + v.mass, friction=scene.friction - v.friction)
    held = grip_ratio(scene, force)
    if held >= 1.0 > grip_ratio(weakest, force):
        raise ParameterError(
            f"{location}.variation",
            f"a box of {weakest.mass:g} kg at friction {weakest.friction:g} slips out of two pads that press with "
            f"{force:g} N: vary mass and friction by less, or press harder.",
        )
    if held < 1.0:
        weight = scene.mass * GRAVITY
        raise ParameterError(
            f"{location}.mass",
            f"{scene.mass:g} kg slip out of two pads that press with {force:g} N at friction {scene.friction:g} "
            f"(2 mu F_d = {held * weight:.3g} N < m g = {weight:.3g} N): at least "
            f"{weight / (2.0 * scene.friction * PAD_FRICTION):.3g} N are needed.",
        )
    believed = scene.length_error + length_error
    if 0.5 * believed + stand_off <= 0.0:
        raise ParameterError(
            f"{location}.length_error",
            f"{1e3 * believed:g} mm and a stand-off of {1e3 * stand_off:g} mm let the pads begin inside of the box.",
        )
    if float(np.linalg.norm(np.array(scene.goal) - np.array(scene.start))) < SHORTEST:
        raise ParameterError(f"{location}.goal", "is where the box begins: there is nothing to carry.")
    apart = scene.box[1] + believed + 2.0 * stand_off
    # What is to be let go at its goal is there as what begins there.
    ends = (("start", "begin", scene), ("goal", "end", replace(scene, start=scene.goal, goal=scene.start)))
    for name, does, turned in ends:
        with World(turned, np.random.default_rng(0), location) as world:
            world.put(pads_beside(np.array(turned.start), apart))
            if world.touching():
                raise ParameterError(
                    f"{location}.{name}", f"arms or box would {does} inside of something: set start and goal apart."
                )
    for x in (-v.start, v.start) if v.start else ():
        for y in (-v.start, v.start):
            moved = replace(scene, start=(scene.start[0] + x, scene.start[1] + y, scene.start[2]))
            with World(moved, np.random.default_rng(0), location) as world:
                try:
                    world.put(pads_beside(np.array(moved.start), apart))
                except ParameterError as error:
                    raise ParameterError(f"{location}.variation.start", error.problem) from None
                if world.touching():
                    raise ParameterError(
                        f"{location}.variation.start", "arms or box could begin inside of something: make it smaller."
                    )
