"""The report's section of boxes that are carried round flowerpots: Fig. 6 of the paper, by method of avoidance.

Results in, a section out. How it is drawn: `pots_panels.py`, `clearance.py`; the numbers: `pots_tables.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.report import Block, Figure, Key, Panel, Section
from stages.figures.carry_cases import held_groups
from stages.figures.clearance import Line, clearance_panel, method_colour, method_keys, styles, whole_extent
from stages.figures.intervals import of
from stages.figures.numbers import MM, counted, method_title, number
from stages.figures.pots_cases import MOST_BOXES, Round, alike, case_title, method_of, rounds
from stages.figures.pots_panels import round_frame, round_panel
from stages.figures.pots_tables import methods_table, rounds_table, touched, went_round
from stages.figures.results import Results
from stages.policy.outcome import Outcome
from stages.trajectory import Array

COLUMNS = 3

MOST = 8
"""Ways to avoid a pot that pictures show; tables show all."""


def pots_section(results: Results | None) -> Section | None:
    """Pots are in the way; none where none was. `results`: of points in which arms carry a box."""
    groups = [] if results is None else [held for held in held_groups(results) if held.among_pots]
    if not groups:
        return None
    cases = rounds(groups)
    blocks: list[Block] = [_fig6(cases), methods_table(groups), _clearances(cases), rounds_table(groups)]
    return Section(id="pots", title="Round a flowerpot (Fig. 6)", blocks=tuple(blocks))


def pots_sentence(results: Results | None) -> str:
    """What methods of avoidance came to with a box between the arms; empty where nothing was in the way."""
    groups = [] if results is None else [held for held in held_groups(results) if held.among_pots]
    if not groups:
        return ""
    said = []
    for held in groups:
        inside = min(row["clearance_min_mm"] for row in held.rows)
        hit = sum(map(touched, held.rows))
        lost = sum(not row["delivered"] for row in held.rows)
        why = [
            f"up to {number(-inside)} mm inside of the sphere" if inside < 0.0 else "",
            f"{hit} touched the pot" if hit else "",
            f"{lost} not delivered" if lost else "",
        ]
        because = f" ({', '.join(filter(None, why))})" if any(why) else ""
        said.append(f"{case_title(held)} {of(sum(map(went_round, held.rows)), len(held.rows))}{because}")
    return f"Boxes carried round a pot, and delivered, without entering its safety sphere: {'; '.join(said)}."


def _fig6(cases: Sequence[Round]) -> Figure:
    """Fig. 6: a panel of two views for each method, of the same box."""
    shown = _first(cases)
    demonstrations = [t.position for t in cases[0].held.points[0].midpoints.trajectories]
    extent = round_frame(shown, demonstrations)
    panels = []
    for one in shown:
        kind = method_of(one.held)[1]
        title, short = case_title(one.held), one.rollout.outcome != Outcome.ARRIVED
        svg = round_panel(one, _free(cases, one), demonstrations, title, method_colour(kind), extent, COLUMNS, short)
        least = float(one.rollout.clearance[one.nearest]) * MM
        touching = [f"{what} touches the pot" for what in ("box", "arm") if one.carry.facts[f"{what}_contacts"]]
        alt = (
            f"{title}: the box's way seen from the right and from above. Its middle "
            + (f"comes within {number(least)} mm of" if least >= 0.0 else f"goes {number(-least)} mm into")
            + f" the safety sphere of {number(float(one.pots.radii.max()) * MM)} mm. "
            + "".join(f"The {text}. " for text in touching)
            + f"Outcome: {one.rollout.outcome}."
        )
        panels.append(Panel(svg=svg, alt=alt))
    caption = (
        f"Fig. 6. {counted(len(shown), 'roll-out')} with a pot in the way, box {shown[0].number} under each condition. "
        "Diamond: where the box's middle is nearest to the sphere, or deepest inside; about it the box, upright; "
        "spheres and pots as they are then. Star: goal. The sphere is for the middle of the box, and holds its size."
    )
    return Figure(panels=tuple(panels), columns=COLUMNS, legend=_keys(cases, shown), caption=caption)


def _keys(cases: Sequence[Round], shown: Sequence[Round]) -> tuple[Key, ...]:
    """What lines and areas are; only of what is there."""
    kinds = dict.fromkeys(method_of(one.held)[1] for one in shown)
    moving = any(one.pots.moving for one in shown)
    free = any(_free(cases, one) is not None for one in shown)
    drawn_out = any(one.pots.along.any() for one in shown)
    seen = Key(label="what the policy sees of it, for the hands' sake", colour="series-5", mark="dotted")
    keys = [
        *(Key(label=f"way of the box: {_named(kind, shown)}", colour=method_colour(kind)) for kind in kinds),
        *([Key(label="way with nothing avoided", colour="ink", mark="dashed")] if free else []),
        Key(label="demonstrations", colour="faint"),
        Key(label="safety sphere" + (", dashed: at the start" if moving else ""), colour="series-5", mark="area"),
        *([seen] if drawn_out else []),
        Key(label="pot", colour="ink"),
        Key(label="box at the start, dashed, and at the goal", colour="muted"),
        *([Key(label="not delivered", colour="ink", mark="cross")] if any(map(_short, shown)) else []),
    ]
    return tuple(keys)


def _named(kind: str, shown: Sequence[Round]) -> str:
    """Methods of a kind, as a legend names them."""
    names = dict.fromkeys(method_title(method_of(one.held)[0]) for one in shown if method_of(one.held)[1] == kind)
    return ", ".join(names)


def _short(one: Round) -> bool:
    return one.rollout.outcome != Outcome.ARRIVED


def _first(cases: Sequence[Round]) -> list[Round]:
    """Of each group the roll-out of the first box, or its first."""
    held = dict.fromkeys(one.held for one in cases)
    own = [[one for one in cases if one.held is group] for group in held]
    return [next((one for one in of if one.number == cases[0].number), of[0]) for of in own][:MOST]


def _free(cases: Sequence[Round], one: Round) -> Array | None:
    """The way of the same box where nothing avoids its pot, unless it is this roll-out."""
    for other in cases:
        same = (other.held.variant, other.held.kind, other.number) == (one.held.variant, one.held.kind, one.number)
        if same and method_of(other.held)[1] == "none":
            return None if other.held is one.held else other.way
    return None


def _clearances(cases: Sequence[Round]) -> Figure:
    """Clearance over time: a panel for each box and its pots, a line for each method."""
    sets = alike(cases)
    kinds: dict[str, str] = {}
    for members in sets:
        kinds |= {_label(one, members): method_of(one.held)[1] for one in members}
    marks = styles(kinds)
    drawn = [[_line(one, members) for one in members] for members in sets]
    extent = whole_extent([line for lines in drawn for line in lines])
    panels = []
    for members, lines in zip(sets, drawn, strict=True):
        pots = members[0].pots
        what = "moving" if pots.moving else "standing"
        title = f"box {members[0].number}, {what} pot, r = {number(float(pots.radii[0]) * MM)} mm"
        least = "; ".join(
            f"{method_title(line.method)} {number(float(np.nanmin(line.clearance)) * MM)} mm" for line in lines
        )
        svg = clearance_panel(lines, title, MOST_BOXES, marks=marks, extent=extent)
        panels.append(Panel(svg=svg, alt=f"{title}: least clearance over the roll-out: {least}."))
    return Figure(
        panels=tuple(panels),
        columns=MOST_BOXES,
        legend=method_keys(kinds),
        caption="Distance of the box's middle from the safety sphere over time. Shaded: inside. A cross: a roll-out "
        "that did not deliver its box.",
    )


def _line(one: Round, members: Sequence[Round]) -> Line:
    return Line(
        method=_label(one, members),
        kind=method_of(one.held)[1],
        time=one.rollout.time,
        clearance=one.rollout.clearance,
        stopped=_short(one),
    )


def _label(one: Round, members: Sequence[Round]) -> str:
    """What a legend calls a roll-out: its method, and its condition where others of the set share the method."""
    name = method_of(one.held)[0]
    return name if sum(method_of(other.held)[0] == name for other in members) == 1 else case_title(one.held)
