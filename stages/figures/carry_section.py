"""The report's section of two arms that carry a box: Figs. 5b, 5c and 5e of the paper, and its tables.

Results in, a section out. How it is drawn: `carry_panels.py`; the numbers: `carry_tables.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.report import Block, Figure, Key, Panel, Paragraph, Section
from stages.artifacts.rollouts import RecordedCarry, RecordedRollout
from stages.evaluate.force import BAND
from stages.evaluate.summary import group, mean
from stages.figures.carry_cases import COLOURS, LAWS, NO_LAW, Held, carry_parameters, held_groups
from stages.figures.carry_panels import (
    HIGHEST,
    MOST_LINES,
    VIEWS,
    Pressed,
    Way,
    force_panel,
    force_top,
    way_frame,
    way_panel,
)
from stages.figures.carry_tables import delivery_table, failures_table, force_table, rollouts_table
from stages.figures.numbers import MM, counted, given, joined, number, span
from stages.figures.results import Results
from stages.figures.teleoperation_figure import teleoperation_figure
from stages.policy.carrying import Phase
from stages.policy.outcome import Outcome
from stages.rollout.carry_guard import MISPLACED, TILTED

MOST_GROUPS = 4
"""Ways to hold a box that pictures show; tables show all."""

MOST_PATHS = 20
"""Ways of roll-outs in one picture."""

MARKED = (Phase.GRIP, Phase.CARRY, Phase.SET_DOWN, Phase.RELEASE, Phase.LOST, Phase.MISSED)
"""Phases whose beginning pictures mark."""


def carry_section(results: Results | None) -> Section | None:
    """Two arms carry a box; none where none does. `results`: of points in which arms carry a box."""
    if results is None:
        return None
    groups = held_groups(results)
    shown = chosen([held for held in groups if is_plain(held)])
    blocks: list[Block] = [*([_ways(results, shown)] if shown else []), delivery_table(groups)]
    failures = failures_table(groups)
    blocks += [failures] if failures is not None else []
    blocks += [*([_forces(shown)] if shown else []), force_table(groups), _settling(groups)]
    led = teleoperation_figure(results.shown)
    blocks += [led] if led is not None else []
    blocks += [_rise(results), rollouts_table(groups)]
    return Section(id="carry", title="Two arms carry a box (Fig. 5)", blocks=tuple(blocks))


def carry_sentence(results: Results | None) -> str:
    """How many boxes were delivered, and how hard they were pressed, by law, where nothing happened on the way.

    Empty where there are none.
    """
    every = [] if results is None else held_groups(results)
    groups = [held for held in every if is_plain(held)]
    if not groups:
        return ""
    laws = group([{"law": held.law, "held": held} for held in groups], lambda row: (row["law"],))
    said = []
    for (law,), members in laws.items():
        rows = [row for member in members for row in member["held"].rows]
        delivered = sum(row["delivered"] for row in rows)
        force = mean(row["force_mean_n"] for row in rows)
        name = {"robust": "with compliance", "paper": "with compliance as printed", NO_LAW: "without compliance"}[law]
        pressed = "never carried" if force is None else f"mean contact force {number(force)} N"
        said.append(f"{name} {delivered} of {len(rows)} ({pressed})")
    wanted = span([force for held in groups for force in held.desired])
    where = "Boxes" if len(groups) == len(every) else "Where nothing happened on the way, boxes"
    return f"{where} that two arms delivered: {joined(said)}; {wanted} N were wanted."


def is_plain(held: Held) -> bool:
    """Whether nobody was to be pushed and nothing was in the way."""
    return not (held.pushed or held.among_pots)


def chosen(groups: Sequence[Held]) -> list[Held]:
    """Those that pictures show: the first of each law, then further ones, in their order."""
    first = {held.law: index for index, held in reversed(list(enumerate(groups)))}
    order = sorted(range(len(groups)), key=lambda index: (index not in first.values(), index))
    return [groups[index] for index in sorted(order[:MOST_GROUPS])]


def _carries(held: Held) -> list[tuple[RecordedRollout, RecordedCarry]]:
    return [(r, r.carry) for r in held.rollouts if r.carry is not None]


def _ways(results: Results, groups: Sequence[Held]) -> Figure:
    """Fig. 5b. Rows: how the box was held. Columns: views."""
    point = results.shown
    scene = carry_parameters(point).scene
    way = Way(
        demonstrations=[t.position for t in point.midpoints.trajectories],
        box=np.array(scene.box),
        start=np.array(scene.start),
        goal=np.array(scene.goal),
    )
    cases = {held.title: held.rollouts[:MOST_PATHS] for held in groups}
    every = [r.executed for rollouts in cases.values() for r in rollouts]
    extents = {name: way_frame(way, every, view) for name, view in VIEWS.items()}
    panels = []
    for held in groups:
        rollouts = cases[held.title]
        short = [r.outcome != Outcome.ARRIVED for r in rollouts]
        delivered = sum(row["delivered"] for row in held.rows)
        for name, view in VIEWS.items():
            title = f"{held.title}, {name}"
            alt = f"{title}. Boxes delivered: {delivered} of {len(held.rows)}."
            drawn = way_panel(
                way, [r.executed for r in rollouts], short, title, COLOURS[held.law], extents[name], view, len(VIEWS)
            )
            panels.append(Panel(svg=drawn, alt=alt))
    crossed = any(r.outcome != Outcome.ARRIVED for rollouts in cases.values() for r in rollouts)
    keys = [
        *_law_keys(groups),
        Key(label="demonstrations", colour="ink"),
        Key(label="box at the start, dashed, and at the goal", colour="muted", mark="area"),
        *([Key(label="not delivered", colour="ink", mark="cross")] if crossed else []),
    ]
    most = max(len(held.rows) for held in groups)
    some = f" The first {MOST_PATHS} of {most} are drawn." if most > MOST_PATHS else ""
    return Figure(
        panels=tuple(panels),
        columns=len(VIEWS),
        legend=tuple(keys),
        caption=f"Fig. 5b. The midpoint of the pads, by how the box was held. Dots: starts; star: goal "
        f"of the box.{some}",
    )


def _forces(groups: Sequence[Held]) -> Figure:
    """Fig. 5c. Rows: how the box was held. Columns: left and right arm."""
    lifted = {held.title: [(carry, r.time - r.time[_lift(carry)]) for r, carry in _carries(held)] for held in groups}
    clocks = [time for found in lifted.values() for _, time in found]
    length = (min(float(time[0]) for time in clocks), max(float(time[-1]) for time in clocks))
    panels, cut = [], 0.0
    for held in groups:
        found = lifted[held.title]
        low, high = (share * held.given[0] for share in BAND)
        first = next((one for one in found if (one[0].phase == str(Phase.CARRY)).any()), found[0])
        for side, arm in enumerate(("left", "right")):
            pressed = [Pressed(time=time, force=carry.contact[:, side]) for carry, time in found]
            peak = max(float(one.force.max()) for one in pressed)
            if peak > force_top(held.given, (low, high)):
                cut = max(cut, peak)
            title = f"{held.title}: {arm} arm"
            carried = [carry.contact[carry.phase == str(Phase.CARRY), side] for carry, _ in found]
            forces = np.concatenate(carried)
            said = (
                f"while carried {number(float(forces.mean()))} N in the mean, nine in ten samples within "
                f"{number(float(np.percentile(forces, 5)))} to {number(float(np.percentile(forces, 95)))} N"
                if forces.size
                else "no box was carried"
            )
            svg = force_panel(pressed, _phases(*first), held.given, (low, high), title, COLOURS[held.law], length, 2)
            panels.append(
                Panel(svg=svg, alt=f"{title}, contact force over time, {counted(len(found), 'roll-out')}: {said}.")
            )
    force = groups[0].given[0]
    raised = max(f for held in groups for f in held.desired)
    band = f"{given(BAND[0] * force)} to {given(BAND[1] * force)} N"
    sentences = [
        "Fig. 5c. Contact forces as they truly were, not as the wrists measured them. 0 s: the box is lifted. Phases "
        "are those of the first roll-out that lifted it.",
        f"Of more than {MOST_LINES} roll-outs: the median, and between which forces nine in ten are."
        if any(len(found) > MOST_LINES for found in lifted.values())
        else "A line for each roll-out.",
        f"For boxes that turned out to be heavy F_{{d}} was raised, up to {number(raised)} N."
        if raised > max(f for held in groups for f in held.given)
        else "",
        f"Peaks of up to {number(cut)} N are cut off at {given(HIGHEST)} F_{{d}}." if cut else "",
    ]
    return Figure(
        panels=tuple(panels),
        columns=2,
        legend=(
            *_law_keys(groups),
            Key(
                label=f"desired force, {span([f for held in groups for f in held.given])} N",
                colour="ink",
                mark="dashed",
            ),
            Key(label=f"band, {band}", colour="series-3", mark="area"),
            Key(label="phase begins", colour="muted", mark="dotted"),
        ),
        caption=" ".join(filter(None, sentences)),
    )


def _lift(carry: RecordedCarry) -> int:
    """The sample at which the box is lifted; where it never is, the last."""
    carried = np.flatnonzero(carry.phase == str(Phase.CARRY))
    return int(carried[0]) if carried.size else carry.phase.shape[0] - 1


def _phases(carry: RecordedCarry, time: np.ndarray) -> dict[str, float]:
    """When phases began, seconds from the lift."""
    return {str(p): float(time[np.argmax(carry.phase == str(p))]) for p in MARKED if (carry.phase == str(p)).any()}


def _law_keys(groups: Sequence[Held]) -> tuple[Key, ...]:
    return tuple(Key(label=LAWS[law], colour=COLOURS[law]) for law in dict.fromkeys(held.law for held in groups))


def _settling(groups: Sequence[Held]) -> Paragraph:
    """Where each law settles, and where it did; why without compliance the force is what it happens to be."""
    sentences = []
    for law in dict.fromkeys(held.law for held in groups):
        of_law = [held for held in groups if held.law == law]
        found = mean(row["force_mean_n"] for held in of_law for row in held.rows)
        measured = "" if found is None else f"; the mean over roll-outs is {number(found, 4)} N"
        if law == NO_LAW:
            sentences.append(
                "Without compliance nothing controls the force: pads stay where eq. (13) puts them, beyond the faces "
                "by a squeeze, and an error of a millimetre in L presses the box too hard or loses it."
            )
            continue
        settles = span([force for held in of_law for force in held.settles], 4)
        if law == "paper":
            wanted = span([force for held in of_law for force in held.desired])
            sentences.append(
                f"Eq. (17) as printed settles where (k_{{p}} + 1)(F \u2212 F_{{d}}) + F_{{d}} = 0, at "
                f"F_{{d}} k_{{p}}/(k_{{p}} + 1) = {settles} N instead of {wanted} N{measured}."
            )
        else:
            sentences.append(
                f"Robust, without the F_{{d}} that eq. (17) adds, the force settles at {settles} N{measured}."
            )
    return Paragraph(text=" ".join(sentences))


def _rise(results: Results) -> Paragraph:
    """The check of V along x over all roll-outs."""
    risen = group([row for row in results.rows if row["lyapunov_rise_max"] > 0.0], lambda row: (row["condition"],))
    calm = len(results.rows) - sum(map(len, risen.values()))
    said = [
        f"never rose by more than rounding explains in one step of any of {counted(calm, 'roll-out')}" if calm else "",
        *(
            f"rose by up to {number(max(row['lyapunov_rise_max'] for row in rows) * MM**2)} mm² in "
            f"{counted(len(rows), 'roll-out')} under {condition}"
            for (condition,), rows in risen.items()
        ),
    ]
    return Paragraph(
        text=f"V along x {joined([part for part in said if part])}. A box counts as "
        f"delivered within {given(MISPLACED * MM)} mm of the goal and tilted by at most {given(TILTED)} degrees."
    )
