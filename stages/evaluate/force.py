"""How a box was held: contact force, tilt, slip, and whether it was delivered. Paper Figs. 5b, 5c.

Forces are the true contact forces, not what the controller was told. Not here: paths (`compare.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stages.policy.carrying import Phase, tilt
from stages.policy.outcome import Outcome
from stages.trajectory import Array

MM = 1e3
BAND = (0.4, 2.0)
"""Of the force that was asked for, whatever it was raised to for a heavy box: 2 to 10 N where it is 5; below, a box
slips, above, it is crushed."""

FALLEN = 0.05
"""Metres below the pads, or below its goal's and start's height, at which a box has been dropped."""


@dataclass(frozen=True, kw_only=True)
class Grip:
    """Columns of `metrics.parquet` that a carried box fills.

    Attributes:
        compliance: whether the arms pressed by admittance.
        delivered: let go upright within 20 mm of the goal.
        dropped: fell.
        delivery_error_mm: distance of the box from the goal at the end, mm.
        tilt_max_deg: largest angle of the box's vertical axis from the vertical while carried, degrees.
        slip_left_mm, slip_right_mm: farthest that the box moved on each pad while carried, mm.
        slip_max_mm: the larger one.
        force_mean_n, force_std_n, force_p5_n, force_p95_n: contact force while carried, both arms pooled, newtons:
            mean, standard deviation, percentiles.
        band_fraction: share of the carried time in which both forces were within `BAND`.
        grip_ratio: 2 mu F_d/(m g).
        bias_n: mean bias of the force sensors, newtons: the force is off by as much, downwards.
    """

    compliance: bool
    delivered: bool
    dropped: bool
    delivery_error_mm: float
    tilt_max_deg: float | None
    slip_left_mm: float | None
    slip_right_mm: float | None
    slip_max_mm: float | None
    force_mean_n: float | None
    force_std_n: float | None
    force_p5_n: float | None
    force_p95_n: float | None
    band_fraction: float | None
    grip_ratio: float
    bias_n: float


def grip(carry: Any, outcome: str) -> Grip:
    """Measure how one box was held. `carry`: with the attributes of `stages.artifacts.rollouts.RecordedCarry`."""
    facts = carry.facts
    goal, lowest = np.array(facts["goal"]), min(facts["goal"][2], facts["start"][2]) - FALLEN
    carried = carry.phase == str(Phase.CARRY)
    hangs = [str(phase) for phase in (Phase.LOST, Phase.STOPPED)]
    held, sunk = carried | np.isin(carry.phase, hangs), carry.pads[:, :, 2].mean(axis=1) - carry.box[:, 2]
    figures: dict[str, float | None] = dict.fromkeys(
        (
            "tilt_max_deg",
            "slip_left_mm",
            "slip_right_mm",
            "slip_max_mm",
            "force_mean_n",
            "force_std_n",
            "force_p5_n",
            "force_p95_n",
            "band_fraction",
        )
    )
    if carried.any():
        contact, desired = carry.contact[carried], float(facts["force"])
        low, high = (share * desired for share in BAND)
        slipped = slips(carry, carried).max(axis=0)
        figures = {
            "tilt_max_deg": float(tilt(carry.turn[carried]).max()),
            "slip_left_mm": float(slipped[0]) * MM,
            "slip_right_mm": float(slipped[1]) * MM,
            "slip_max_mm": float(slipped.max()) * MM,
            "force_mean_n": float(contact.mean()),
            "force_std_n": float(contact.std()),
            "force_p5_n": float(np.percentile(contact, 5)),
            "force_p95_n": float(np.percentile(contact, 95)),
            "band_fraction": float(((contact >= low) & (contact <= high)).all(axis=1).mean()),
        }
    return Grip(
        compliance=bool(facts["compliance"]),
        delivered=outcome == Outcome.ARRIVED,
        dropped=outcome != Outcome.ARRIVED and bool((sunk[held] > FALLEN).any() or (carry.box[:, 2] < lowest).any()),
        delivery_error_mm=float(np.linalg.norm(carry.box[-1] - goal)) * MM,
        grip_ratio=float(facts["grip_ratio"]),
        bias_n=float(np.mean(facts["bias"])),
        **figures,
    )


def way_error(carry: Any, executed: Array, goal: Array) -> float:
    """Distance of what was executed, shape (n, 3), metres, from the goal, shape (3,), where the way was at its end."""
    led = np.flatnonzero(carry.phase == str(Phase.CARRY))
    return float(np.linalg.norm(executed[led[-1] if led.size else -1] - goal))


def slips(carry: Any, carried: NDArray[np.bool_]) -> Array:
    """How far the middles of the box's faces have moved across the pads since it was lifted, metres, shape (n, 2)."""
    half = 0.5 * float(carry.facts["box"][1])
    turn, moved = carry.turn[carried], np.empty((int(carried.sum()), 2))
    x, y, z, w = turn.T
    along = np.column_stack(
        [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)]
    )  # of the y axis
    for side, sign in enumerate((1.0, -1.0)):
        gap = carry.box[carried] + sign * half * along - carry.pads[carried, side]
        across = (gap - gap[0])[:, [0, 2]]
        moved[:, side] = np.hypot(across[:, 0], across[:, 1])
    return moved
