"""The report's figure of shared teleoperation: both arms in one demonstration over time. Paper Fig. 5e.

Results in, a figure out. What the arms did is all that artifacts hold: strokes of the master are in the recordings.
"""

from __future__ import annotations

import numpy as np

from pipeline.report import Figure, Key, Panel
from stages.artifacts.demonstrations import read_demonstrations
from stages.artifacts.parquet import header
from stages.figures.carry_panels import ARMS, Led, position_panel, strokes_panel
from stages.figures.numbers import MM, number
from stages.figures.results import PointResults
from stages.trajectory import ArmRecording, Array


def teleoperation_figure(point: PointResults) -> Figure | None:
    """Positions, speed, separation and forces of the first demonstration of two arms; none where there is none."""
    axis = "xyz".index(header(point.files["midpoints"]).get("clamp_axis", "y"))
    for demonstration in read_demonstrations(point.files["demonstrations"]):
        if {"left", "right"} <= set(demonstration.arms):
            led = led_by(demonstration.arms["left"], demonstration.arms["right"], axis)
            return None if led is None else _figure(led, demonstration.name, axis)
    return None


def led_by(left: ArmRecording, right: ArmRecording, clamp_axis: int) -> Led | None:
    """Both arms on the left one's clock, where they overlap; none: fewer than two samples, or not in space."""
    inside = (left.time >= right.time[0]) & (left.time <= right.time[-1])
    if inside.sum() < 2 or left.position.shape[1] != 3:
        return None
    time = left.time[inside]
    arms = np.stack([left.position[inside], _at(time, right.time, right.position)])
    force = None
    if left.force is not None and right.force is not None:
        pressed = np.linalg.norm(right.force, axis=1)
        force = np.stack([np.linalg.norm(left.force[inside], axis=1), np.interp(time, right.time, pressed)])
    return Led(time=time - time[0], arms=arms, force=force, clamp_axis=clamp_axis)


def _at(time: Array, known: Array, values: Array) -> Array:
    """Values, shape (m, d), known at some times, at others, shape (n, d)."""
    return np.column_stack([np.interp(time, known, column) for column in values.T])


def _figure(led: Led, name: str, axis: int) -> Figure:
    apart = led.separation * MM
    pressed = ""
    if led.force is not None:
        left, right = (number(float(force.mean())) for force in led.force)
        pressed = f", left {left} N and right {right} N in the mean"
    title = "Speed of the midpoint, separation" + (", forces" if led.force is not None else "")
    panels = (
        Panel(
            svg=position_panel(led, "Left arm, right arm and their midpoint", 2),
            alt=f"Coordinates over {number(float(led.time[-1]))} s: the arms are {number(float(apart.mean()))} mm "
            f"apart along {'xyz'[axis]}.",
        ),
        Panel(
            svg=strokes_panel(led, title, 2),
            alt=f"Speed up to {number(float(led.speed.max()) * MM)} mm/s; separation {number(float(apart.min()), 4)} "
            f"to {number(float(apart.max()), 4)} mm{pressed}.",
        ),
    )
    measured = "" if led.force is None else " Forces: as the wrists measured them."
    return Figure(
        panels=panels,
        columns=2,
        legend=tuple(
            Key(label=which, colour=series, mark="dashed")
            if which == "midpoint"
            else Key(label=f"{which} arm", colour=series)
            for which, series in ARMS.items()
        ),
        caption=f"Fig. 5e. {name}: one operator leads both arms, eqs. (1)-(3). Strokes of the master show as humps of "
        f"the speed; between them, its clutch released, the arms stand still.{measured}",
    )
