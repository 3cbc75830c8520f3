"""Fifty flowerpots in the way of a carried box, by every method of avoidance. Paper Fig. 6.

The policy is the one of `runs/box-obstacle`, from its committed recordings. Pots differ in place and radius; a scene is
drawn until start and goal are outside and both arms can follow a way round, and refused draws are counted. The same
scenes for every method. Run by `make bench`.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from carries import Held, carry_all
from support import CHECKOUT, make_project, run_timed

import clpv
from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.parameters import (
    ApfParameters,
    Avoidance,
    CbfParameters,
    ModulationParameters,
    NoAvoidance,
    RoasParameters,
    RoasPlusParameters,
)
from stages.rollout.parameters import CarryCondition, CarryParameters, Flowerpot
from stages.world.boxes import varied
from stages.world.parameters import Scene, Variation

SCENES, FEWER = 50, 16
"""Scenes of ROAS+, and those of them that each setting of the other methods runs in."""
SHELVING = Scene(
    box=(0.12, 0.24, 0.12),
    start=(0.42, 0.0, 0.26),
    goal=(0.70, 0.0, 0.58),
    variation=Variation(mass=0.1, friction=0.1, start=0.01, centre_of_mass=0.005, bias=0.1),
)
POT = Flowerpot(spread=0.015, radius_spread=0.01)
MARGIN = 0.005
TOP_SPEED = 0.3
"""m/s, about that of the demonstrations."""
PARAMETERS = CarryParameters(least_friction=0.7, max_duration=40.0)

OTHERS: dict[str, Avoidance] = {
    "nothing avoided": NoAvoidance(),
    "ROAS as printed, metres": RoasParameters(),
    "ROAS as printed, decimetres": RoasParameters(unit=0.1),
    "ROAS as printed, centimetres": RoasParameters(unit=0.01),
    **{
        f"APF, range {1e3 * range_:.0f} mm, gain {gain:g} m/s": ApfParameters(range=range_, gain=gain)
        for range_ in (0.02, 0.06, 0.18)
        for gain in (0.003, 0.03)
    },
    "CBF": CbfParameters(margin=MARGIN),
    "modulation": ModulationParameters(margin=MARGIN),
}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> LpvDs:
    project = make_project(Path(tmp_path_factory.mktemp("project")), "box-obstacle")
    shutil.copytree(CHECKOUT / "datasets" / "box-shelving", project / "datasets" / "box-shelving")
    run_timed(project, "box-obstacle", "fit")
    return clpv.load("box-obstacle", root=project)


def _tell(name: str, found: Sequence[Held]) -> None:
    ended = sorted({one.outcome for one in found})
    rooms = [one.pushed.box_room_min_mm for one in found if one.pushed.box_room_min_mm is not None]
    arms = [one.pushed.arm_room_min_mm for one in found if one.pushed.arm_room_min_mm is not None]
    boxes = sum(bool(one.pushed.box_contacts) for one in found)
    hands = sum(bool(one.pushed.arm_contacts) for one in found)
    print(
        f"{name}: {sum(one.delivered for one in found)} of {len(found)} delivered "
        f"({', '.join(f'{sum(one.outcome is outcome for one in found)} {outcome}' for outcome in ended)}); "
        f"{sum(one.clearance_mm < 0.0 for one in found)} enter the sphere (clearance at least "
        f"{min(one.clearance_mm for one in found):.1f} mm), {boxes} boxes and {hands} arms touch the pot (room at "
        f"least {min(rooms):.0f} and {min(arms):.0f} mm); refused draws {sum(one.refused for one in found)}"
    )


def test_fifty_pots(model: LpvDs) -> None:
    scenes = [varied(SHELVING, np.random.default_rng([15, number])) for number in range(SCENES)]

    def run(name: str, avoidance: Avoidance, chosen: Sequence[Scene]) -> list[Held]:
        condition = CarryCondition(name="pot", obstacles=(POT,), avoidance=avoidance)
        found = carry_all(model, PARAMETERS, condition, chosen, TOP_SPEED)
        _tell(name, found)
        return found

    print()
    found = run("ROAS+", RoasPlusParameters(margin=MARGIN), scenes)
    for name, avoidance in OTHERS.items():
        others = run(name, avoidance, scenes[:FEWER])
        if isinstance(avoidance, NoAvoidance):
            # The pots are in the way: without avoidance every box enters the sphere, and most touch the pot.
            assert all(one.clearance_mm < 0.0 for one in others)
            assert 2 * sum(bool(one.pushed.box_contacts) for one in others) >= FEWER

    assert all(one.clearance_mm >= 0.0 for one in found)
    assert all(one.pushed.box_contacts == 0 for one in found)
    assert all(one.delivered for one in found)
