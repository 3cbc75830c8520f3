"""Two arms that carry a box, for the viewer: links, box, pads, pots, ways, forces, deviation, phases. Figs. 5, 6.

Not here: how views are laid out (`arms_layout.py`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.report import PALETTE
from stages.artifacts.rollouts import SIDES, RecordedCarry, RecordedRollout, RecordedScene
from stages.evaluate.force import BAND
from stages.figures.numbers import MM
from stages.inspect.plane import GATE, GATES
from stages.inspect.shown import Shown
from stages.inspect.stream import Colour, Stream, rgb
from stages.policy.carrying import Phase
from stages.trajectory import Array
from stages.world.bullet import SUPPORT
from stages.world.description import both
from stages.world.links import frames, visuals
from stages.world.pots import Pot, lathe, triangles
from stages.world.robots import Arm

COLOURS: tuple[Colour, Colour] = (rgb("series-2", PALETTE), rgb("series-1", PALETTE))
"""Of the left and the right arm's lines."""

WAY, P_HAT, MIDPOINT = rgb("series-3", PALETTE), rgb("series-5", PALETTE), (150, 158, 168)
DESIRED, LIMIT, SAFETY = rgb("series-3", PALETTE), rgb("faint", PALETTE), rgb("series-4", PALETTE)

THRESHOLD = (214, 84, 84)

BOX, CLAY, STAND = (176, 132, 88), (150, 84, 58), (92, 96, 102)
PAD, SHELL = (60, 64, 70), (150, 156, 166)

DARK: tuple[Colour, Colour] = (rgb("series-2", PALETTE, dark=False), rgb("series-1", PALETTE, dark=False))
"""Of the left and the right arm in lanes, behind white words."""

PHASES: dict[str, Colour] = {
    str(phase): shade
    for phase, shade in (
        (Phase.APPROACH, (70, 74, 80)),
        (Phase.GRIP, (96, 84, 60)),
        (Phase.CARRY, (60, 90, 120)),
        (Phase.SET_DOWN, (96, 84, 60)),
        (Phase.RELEASE, (70, 74, 80)),
        (Phase.DONE, (44, 110, 90)),
        (Phase.MISSED, (150, 50, 50)),
        (Phase.LOST, (150, 50, 50)),
        (Phase.STOPPED, (150, 50, 50)),
    )
}

MESHED = 4
"""Carried boxes up to which arms are drawn as they are: each takes about 2 MB, or 17 of a panda."""

BONE = 0.03
"""Radius of the line that stands for an arm, metres."""

STILL = 1e-9
"""Metres, or of a quaternion, within which a link has not moved."""


def draw_carry(stream: Stream, root: str, one: Shown, *, meshes: bool) -> None:
    """Write one carried box below `root`: the scene, and what happened over time.

    `meshes`: arms are drawn as they are, which takes megabytes; else as thick lines.
    """
    rollout, carry = one.rollout, one.rollout.carry
    assert carry is not None  # `Shown.carries` has been asked
    parameters = one.point.point.parameters["rollout"]
    for side, (name, moved) in enumerate(zip(SIDES, both(parameters.scene.robot, "rollout.scene.robot"), strict=True)):
        draw = _links if meshes else _skeleton
        draw(stream, f"{root}/scene/{name}", rollout.time, carry.joints[:, side], moved)
    _things(stream, f"{root}/scene", rollout, carry, one.point.scenes.get(rollout.scene))
    asked = next((c for c in parameters.conditions if c.name == rollout.condition), None)
    following = parameters.following if asked is None or asked.following else None
    threshold = None if following is None else following.deviation_threshold
    _plots(stream, f"{root}/plot", one, carry, threshold)
    _lanes(stream, f"{root}/lane", rollout, carry)


def _links(stream: Stream, root: str, time: Array, q: Array, one: Arm) -> None:
    """An arm: each mesh or box once, and where it is at all times; what never moves without times."""
    rr = stream.rr
    places, turns = frames(one.chain, q)
    for visual in visuals(one):
        entity = f"{root}/{visual.link}"
        at = places[visual.joint] + turns[visual.joint] @ visual.place
        turned = Rotation.from_matrix(turns[visual.joint] @ visual.turn).as_quat()
        scale = None if visual.mesh is None or (visual.edges == 1.0).all() else visual.edges
        if visual.mesh is None:
            stream.still(entity, rr.Boxes3D(half_sizes=[0.5 * visual.edges], colors=[PAD], fill_mode="solid"))
        else:
            stream.still(entity, rr.Asset3D(path=visual.mesh, albedo_factor=SHELL))
        if max(np.ptp(at, axis=0).max(), np.ptp(turned, axis=0).max()) < STILL:
            stream.still(entity, rr.Transform3D(translation=at[0], quaternion=turned[0], scale=scale))
        else:
            scales = None if scale is None else np.tile(scale, (time.shape[0], 1))
            columns = rr.Transform3D.columns(translation=at, quaternion=turned, scale=scales)
            stream.columns(entity, time, columns)


def _skeleton(stream: Stream, root: str, time: Array, q: Array, one: Arm) -> None:
    """An arm as a thick line through its joints."""
    places = frames(one.chain, q)[0].swapaxes(0, 1)
    n = time.shape[0]
    columns = stream.rr.LineStrips3D.columns(strips=list(places), colors=[SHELL] * n, radii=[BONE] * n)
    stream.columns(root, time, columns)


def _things(
    stream: Stream, root: str, rollout: RecordedRollout, carry: RecordedCarry, scene: RecordedScene | None
) -> None:
    """Box, what it stands on, pots, ways, and the places on them."""
    rr, time, facts = stream.rr, rollout.time, carry.facts
    edges = np.array(facts["box"])
    stream.still(f"{root}/box", rr.Boxes3D(half_sizes=[0.5 * edges], colors=[BOX], fill_mode="solid"))
    stream.columns(f"{root}/box", time, rr.Transform3D.columns(translation=carry.box, quaternion=carry.turn))
    for name, place in (("pedestal", facts["start"]), ("shelf", facts["goal"])):
        high = place[2] - 0.5 * edges[2]
        half, centre = (0.5 * SUPPORT, 0.5 * SUPPORT, 0.5 * high), (place[0], place[1], 0.5 * high)
        stand = rr.Boxes3D(half_sizes=[half], centers=[centre], colors=[STAND], fill_mode="solid")
        stream.still(f"{root}/{name}", stand)
    for number, pot in enumerate(facts["pots"]):
        velocity = np.zeros(3) if scene is None else scene.shapes.velocities[number]
        _pot(stream, f"{root}/pots/{number + 1}", pot, time, carry.led(time)[:, None] * velocity)
    for name, points, colour in (
        ("x", rollout.x, WAY),
        ("p_hat", rollout.p_hat, P_HAT),
        ("midpoint", rollout.executed, MIDPOINT),
    ):
        stream.ways(f"{root}/{name}/way", [points], colour, 0.003)
        stream.place(f"{root}/{name}", time, points, colour, 0.008)
    for side, name in enumerate(SIDES):
        stream.place(f"{root}/{name}_pad", time, carry.pads[:, side], COLOURS[side], 0.006)


def _pot(stream: Stream, root: str, pot: Any, time: Array, moved: Array) -> None:
    """A pot and its safety sphere; `moved`: array, shape (n, 3), metres, by how much it has."""
    rr = stream.rr
    corners = lathe(Pot(centre=tuple(pot["centre"]), height=pot["height"], width=pot["width"]))
    body = rr.Mesh3D(vertex_positions=corners, triangle_indices=triangles(), albedo_factor=CLAY)
    if moved.any():
        stream.columns(root, time, rr.Transform3D.columns(translation=np.array(pot["centre"]) + moved))
    else:
        stream.still(root, rr.Transform3D(translation=pot["centre"]))
    stream.still(f"{root}/body", body)
    radii = [[pot["radius"]] * 3]
    stream.still(
        f"{root}/safety_sphere", rr.Ellipsoids3D(half_sizes=radii, colors=[SAFETY], fill_mode="majorwireframe")
    )


def _plots(stream: Stream, root: str, one: Shown, carry: RecordedCarry, threshold: float | None) -> None:
    """Forces with F_d and its band, deviations with their threshold, V, and room."""
    rollout, time = one.rollout, one.rollout.time
    led = carry.phase == str(Phase.CARRY)  # before, pads are on their way to the box, and nobody compares
    for side, name in enumerate(SIDES):
        stream.series(f"{root}/force/{name}", time, carry.contact[:, side], COLOURS[side], name)
        stream.series(f"{root}/measured/{name}", time, carry.force[:, side], COLOURS[side], name)
        deviation = np.where(led, MM * carry.residual[:, side], np.nan)
        stream.series(f"{root}/deviation/{name}", time, deviation, COLOURS[side], name)
    stream.series(f"{root}/force/desired", time, carry.desired, DESIRED, "F_d")
    for share, name in zip(BAND, ("least", "most"), strict=True):
        stream.series(f"{root}/force/{name}", time, share * carry.desired, LIMIT, f"{share:g} F_d", width=1.0)
    away = np.linalg.norm(rollout.executed - rollout.x, axis=1)
    stream.series(f"{root}/deviation/midpoint", time, np.where(led, MM * away, np.nan), MIDPOINT, "midpoint from x")
    if threshold is not None:
        stream.level(f"{root}/deviation/threshold", time, MM * threshold, THRESHOLD, f"threshold {MM * threshold:g} mm")
    stream.series(f"{root}/lyapunov/V", time, MM * MM * rollout.lyapunov, WAY, "V")
    if np.isfinite(rollout.clearance).any():
        stream.series(f"{root}/clearance/sphere", time, MM * rollout.clearance, SAFETY, "middle, safety sphere")
        stream.series(f"{root}/clearance/box", time, MM * carry.box_room, BOX, "box, pot")
        stream.series(f"{root}/clearance/arms", time, MM * carry.arm_room, COLOURS[0], "arms, pot")


def _lanes(stream: Stream, root: str, rollout: RecordedRollout, carry: RecordedCarry) -> None:
    """Phase, gate, who is pushed and who is taken for pushed."""
    sides = dict(zip(SIDES, DARK, strict=True))
    stream.states(f"{root}/phase", rollout.time, carry.phase, PHASES)
    gate = np.where(carry.phase == str(Phase.CARRY), np.where(rollout.gate, *GATE), "")  # only then x is to move
    stream.states(f"{root}/gate", rollout.time, gate, GATES)
    if carry.pushed.any():
        names = np.array(SIDES)
        pushed = np.array([" and ".join(names[row]) for row in carry.pushed], dtype=object)
        stream.states(f"{root}/pushed", rollout.time, pushed, sides)
    if carry.pushed.any() or (carry.named != "").any():
        stream.states(f"{root}/named", rollout.time, carry.named, sides)
