"""Flowerpots in the way of a carried box: drawn until there is a way round that both arms can reach. Paper Fig. 6.

A scene is the same under all conditions that have the same pots. The way that is asked for is that of ROAS+, and it is
asked of the kinematics: every few millimetres both pads must be where eq. (13) puts them, within the joints' limits.
Not here: how an obstacle is avoided (`stages/policy/avoidance`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.parameters import Box, Obstacle, RoasPlusParameters, Sphere
from stages.policy.coupled import Coupling
from stages.rollout.arm_disturbances import SIDES
from stages.rollout.carry_way import plan
from stages.rollout.parameters import Flowerpot
from stages.trajectory import Array
from stages.world.boxes import pads_beside
from stages.world.bullet import World
from stages.world.following import Follower
from stages.world.parameters import Scene
from stages.world.pots import Pot

MOST_DRAWS = 200
"""Of scenes, until one is given up."""

APART = 0.01
"""Metres between places of the way at which it is asked whether an arm touches a pot."""

THIN = 1e-6
"""Metres: half the thickness of the rod about which a sphere is drawn out."""

MARGIN = 0.005
"""Metres beyond the safety spheres with which the way is planned."""

REACHED = 0.005
"""Metres by which a pad may miss its place on the way."""


@dataclass(frozen=True, kw_only=True)
class PotScene:
    """Pots of one box.

    Attributes:
        obstacles: the safety spheres, drawn out, as the policy takes them.
        radii: of the spheres, metres.
        pots: as the world takes them.
        refused: how many draws were refused before.
        why: what the last of them lacked; "": none was refused.
    """

    obstacles: tuple[Obstacle, ...] = ()
    radii: tuple[float, ...] = ()
    pots: tuple[Pot, ...] = ()
    refused: int = 0
    why: str = ""


NO_POTS = PotScene()


def draw_pots(asked: Sequence[Flowerpot], generator: np.random.Generator) -> tuple[Flowerpot, ...]:
    """Pots with centres and radii drawn uniformly within their spreads."""
    found = []
    for pot in asked:
        centre = np.array(pot.centre) + pot.spread * generator.uniform(-1.0, 1.0, 3)
        radius = pot.radius + pot.radius_spread * float(generator.uniform(-1.0, 1.0))
        found.append(replace(pot, centre=(float(centre[0]), float(centre[1]), float(centre[2])), radius=radius))
    return tuple(found)


def obstacles_of(pots: Sequence[Flowerpot]) -> tuple[Obstacle, ...]:
    """The safety spheres as the policy takes them: spheres, or, drawn out along y, rods with round ends."""
    found: list[Obstacle] = []
    for pot in pots:
        if pot.along > 0.0:
            core = (THIN, pot.along, THIN)
            found.append(Box(centre=pot.centre, half_extents=core, rounding=pot.radius, velocity=pot.velocity))
        else:
            found.append(Sphere(centre=pot.centre, radius=pot.radius, velocity=pot.velocity))
    return tuple(found)


def scene_of(
    asked: Sequence[Flowerpot],
    generator: np.random.Generator,
    box: Scene,
    model: LpvDs,
    coupling: Coupling,
    *,
    top_speed: float,
    dt: float,
    longest: float,
    location: str,
) -> PotScene:
    """Pots for one box, with a way round.

    Args:
        asked: as a person asks for them; none: nothing is in the way.
        generator: will be advanced.
        box: the scene of this box.
        model: the learned system.
        coupling: how p_hat follows x.
        top_speed: of the demonstrations, m/s.
        dt: seconds a cycle.
        longest: seconds that the way may take.
        location: dotted place of the pots.

    Raises:
        ParameterError: no draw leaves a way, or the only one does not.
    """
    if not asked:
        return NO_POTS
    why, drawn = "", any(pot.spread > 0.0 or pot.radius_spread > 0.0 for pot in asked)
    for refused in range(MOST_DRAWS if drawn else 1):
        pots = draw_pots(asked, generator)
        obstacles = obstacles_of(pots)
        bodies = tuple(Pot(centre=pot.centre, height=pot.height, width=pot.width) for pot in pots)
        lacking = missing(obstacles, bodies, box, model, coupling, top_speed=top_speed, dt=dt, longest=longest)
        if not lacking:
            radii = tuple(pot.radius for pot in pots)
            return PotScene(obstacles=obstacles, radii=radii, pots=bodies, refused=refused, why=why)
        why = lacking
    draws = f", the last of {MOST_DRAWS} draws" if drawn else ""
    raise ParameterError(location, f"leaves no way{draws}: {why}")


def missing(
    obstacles: Sequence[Obstacle],
    pots: Sequence[Pot],
    box: Scene,
    model: LpvDs,
    coupling: Coupling,
    *,
    top_speed: float,
    dt: float,
    longest: float,
) -> str:
    """What a scene lacks, a sentence; "": nothing. Arguments as of `scene_of`."""
    asks = RoasPlusParameters(margin=MARGIN)
    try:
        way = plan(
            model,
            np.array(box.start),
            coupling,
            top_speed=top_speed,
            dt=dt,
            longest=longest,
            obstacles=obstacles,
            avoidance=asks,
        )
    except DataError as error:
        return error.problem
    if np.linalg.norm(way[-1] - model.goal) > 0.005:
        return "the policy's way round does not end at the goal in time."
    return unreachable(box, way, dt, pots, obstacles)


def unreachable(box: Scene, way: Array, dt: float, pots: Sequence[Pot] = (), obstacles: Sequence[Obstacle] = ()) -> str:
    """Where along a way, shape (n, 3), metres, one place a cycle, an arm cannot go or would hit a pot; "": nowhere."""
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    looks = set(np.searchsorted(gone, np.arange(0.0, gone[-1], APART)).tolist()) if pots else set()
    centres = np.array([pot.centre for pot in pots]).reshape(-1, 3)
    velocities = np.array([one.velocity or (0.0, 0.0, 0.0) for one in obstacles]).reshape(-1, 3)
    with World(box, np.random.default_rng(0), pots=pots) as world:
        follower = Follower(world, world.put(pads_beside(way[0], box.box[1])), dt)
        follower.shun(centres, np.array([pot.reach for pot in pots]))
        before = way[0]
        for cycle, midpoint in enumerate(way):
            velocity = np.tile((midpoint - before) / dt, (2, 1))
            follower.follow(pads_beside(midpoint, box.box[1]), velocity, np.zeros(2))
            follower.advance()
            before = midpoint
            place = ", ".join(f"{value:.2f}" for value in midpoint)
            if follower.missing.max() > REACHED:
                side = SIDES[int(np.argmax(follower.missing))]
                return f"the {side} arm cannot follow the policy's way round at [{place}] m."
            if cycle in looks:
                world.pose(follower.q)
                world.pots.move(centres + cycle * dt * velocities)
                if world.pots.room()[1] <= 0.0:
                    return f"an arm would touch the pot on the policy's way round, at [{place}] m."
    return ""
