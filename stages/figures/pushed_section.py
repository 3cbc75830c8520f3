"""The report's section of boxes with one arm pushed: Fig. 5d of the paper, and what each part of the strategy is for.

Results in, a section out. How it is drawn: `pushed_panels.py`; the numbers: `pushed_tables.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.report import Figure, Key, Panel, Paragraph, Section
from stages.figures.carry_cases import COLOURS, LAWS, Held, difference, held_groups
from stages.figures.carry_panels import ARMS
from stages.figures.intervals import of
from stages.figures.numbers import MISSING, MM, counted, given, joined, number, span
from stages.figures.pushed_cases import Shown, chosen, following_of, scales
from stages.figures.pushed_panels import Scales, series_panel, spans, ways_frame, ways_panel
from stages.figures.pushed_tables import (
    ablations_table,
    false_alarm,
    following_table,
    named_right,
    pushed_by,
    pushes_table,
)
from stages.figures.results import Results
from stages.policy.outcome import Outcome

COLUMNS = 3


def pushed_section(results: Results | None) -> Section | None:
    """Arms are pushed on the way; none where none was to be. `results`: of points in which arms carry a box."""
    groups = [] if results is None else [held for held in held_groups(results) if not held.among_pots]
    pushed = [held for held in groups if held.pushed]
    if not pushed:
        return None
    shown = chosen(pushed)
    drawn = [_series(shown, scales(shown)), _ways(shown, scales(shown))] if shown else []
    return Section(
        id="pushed",
        title="One arm is pushed (Fig. 5d)",
        blocks=(_pushes(pushed), *drawn, ablations_table(groups), following_table(groups), pushes_table(pushed)),
    )


def pushed_sentence(results: Results | None) -> str:
    """What pushes came to, by what was left out of the strategy; empty where there were none."""
    groups = [] if results is None else [held for held in held_groups(results) if not held.among_pots]
    rows = [row for held in groups if held.pushed for row in held.rows]
    if not rows:
        return ""
    ways = dict.fromkeys(difference(row) for row in rows)
    said = []
    for way in ways:
        own = [row for row in rows if difference(row) == way]
        said.append(f"{'robust' if way == MISSING else way}: {of(sum(bool(r['delivered']) for r in own), len(own))}")
    sentences = [f"With one arm pushed on the way, boxes delivered: {'; '.join(said)}."]
    robust = [row for row in rows if difference(row) == MISSING and row["pushed"] is not None]
    if robust:
        calm = [r for held in groups for r in held.rows if difference(r) == MISSING and r["pushed"] is None]
        away, moved = (max(row[name] for row in robust) for name in ("deviation_max_mm", "moved_while_away_mm"))
        back = [row["box_back_mm"] for row in robust if row["box_back_mm"] is not None]
        right, alarms = sum(map(named_right, robust)), sum(map(false_alarm, calm))
        sentences.append(
            f"Robust, both arms gave way by up to {number(away)} mm, x moved by {number(moved)} mm at most meanwhile"
            + (f", and the box was back within {number(max(back))} mm when x went on" if back else "")
            + f"; the pushed arm was told right in {of(right, len(robust))}"
            + (f", and one was suspected without a push in {of(alarms, len(calm))}." if calm else ".")
        )
    return " ".join(sentences)


def _pushes(groups: Sequence[Held]) -> Paragraph:
    """How arms were pushed."""
    how = [(held.name, pushed_by([p for carry in held.carries for p in carry.facts["pushes"]])) for held in groups]
    texts = dict.fromkeys(text for _, text in how)
    said = [f"{joined([name for name, text in how if text == wanted])}: {wanted}" for wanted in texts]
    return Paragraph(
        text=f"What one arm met on the way, unknown to the controller. {'. '.join(said)}. An arm that is dragged does "
        "not hear its own commands."
    )


def _series(shown: Sequence[Shown], axes: Scales) -> Figure:
    """Fig. 5d over time: a panel for each way to do it."""
    panels = []
    for one in shown:
        held, went = one.held, one.went
        title = _title(one)
        svg = series_panel(went, following_of(held), axes, title, COLUMNS)
        after = went.away[went.time >= went.time[went.acting][-1]]
        alt = (
            f"{title}, over time. The pads' midpoint is up to {number(float(went.away.max()) * MM)} mm from where it "
            f"would be, {number(float(after[0]) * MM)} mm when the push ends and {number(float(after[-1]) * MM)} mm in "
            f"the end. Forces {number(float(went.force.min()))} to {number(float(went.force.max()))} N. "
            f"Named: {_named(one)}. x waits for {number(_waited(one))} s. Outcome: {one.rollout.outcome}."
        )
        panels.append(Panel(svg=svg, alt=alt))
    follow = [following_of(one.held) for one in shown]
    delta, gate = (span([getattr(f, name) * MM for f in follow]) for name in ("deviation_threshold", "gate"))
    twice = span([2.0 * f.gate * MM for f in follow])
    stray = max(float(abs(one.went.along).max()) for one in shown)
    hardest = max(float(one.went.force.max()) for one in shown)
    cut = [
        f"displacements of up to {number(stray * MM)} mm" if stray > axes.reach else "",
        f"forces of up to {number(hardest)} N" if hardest > axes.force else "",
    ]
    sentences = [
        f"Fig. 5d. {_which(shown)} From the top: how far left pad, right pad and box are displaced in the direction of "
        "the push, beside x; how far the midpoint is from where it would be, |x \u2212 p|, and each pad from where it "
        "would be if nobody touched it, as the controller finds it; contact forces; who truly was pushed, who was "
        "taken for pushed, when x waited.",
        f"Cut off: {joined([part for part in cut if part])}." if any(cut) else "",
    ]
    return Figure(
        panels=tuple(panels),
        columns=COLUMNS,
        legend=(
            *(Key(label=f"{arm} arm", colour=ARMS[arm]) for arm in ("left", "right")),
            Key(label="box; desired force", colour="ink", mark="dashed"),
            Key(label="|x \u2212 p|; x waits", colour="ink"),
            Key(label=f"threshold delta, {delta} mm", colour="muted", mark="dashed"),
            Key(label=f"x waits beyond {twice} mm, until within {gate} mm", colour="muted", mark="dotted"),
            Key(label=f"band, {given(axes.band[0])} to {given(axes.band[1])} N", colour="series-3", mark="area"),
            Key(label="pushed", colour="muted", mark="area"),
        ),
        caption=" ".join(filter(None, sentences)),
    )


def _ways(shown: Sequence[Shown], axes: Scales) -> Figure:
    """Fig. 5d in space: a panel of two views for each way to do it."""
    demonstrations = [t.position for t in shown[0].held.points[0].midpoints.trajectories]
    extent = ways_frame([one.went for one in shown], demonstrations, axes)
    panels = []
    for one in shown:
        title, went = _title(one), one.went
        short = one.rollout.outcome != Outcome.ARRIVED
        svg = ways_panel(went, demonstrations, title, COLOURS[one.held.law], extent, COLUMNS, short)
        panels.append(
            Panel(
                svg=svg,
                alt=f"{title}: the ways of x, pads and box, seen from behind and from above. The midpoint goes up to "
                f"{number(float(went.away.max()) * MM)} mm away. Outcome: {one.rollout.outcome}.",
            )
        )
    laws = dict.fromkeys(one.held.law for one in shown)
    return Figure(
        panels=tuple(panels),
        columns=COLUMNS,
        legend=(
            Key(label="x", colour="ink", mark="area"),
            *(Key(label=f"pads' midpoint: {LAWS[law]}", colour=COLOURS[law]) for law in laws),
            Key(label="box", colour="ink", mark="dotted"),
            *(Key(label=f"while the {arm} arm is pushed", colour=ARMS[arm]) for arm in _arms(shown)),
            Key(label="demonstrations", colour="faint"),
            *([Key(label="not delivered", colour="ink", mark="cross")] if _short(shown) else []),
        ),
        caption="Fig. 5d, the same roll-outs in space, while the box was carried; what strays farther than pushes drag "
        "it is cut off.",
    )


def _title(one: Shown) -> str:
    return one.held.name


def _which(shown: Sequence[Shown]) -> str:
    """Which box pictures show."""
    numbers = [one.rollout.rollout.rpartition("/")[2] for one in shown]
    box = f"box {numbers[0]}" if len({*numbers}) == 1 else "the first box that was pushed"
    return f"{counted(len(shown), 'roll-out')} with one arm pushed, {box} under each condition, on the same axes."


def _named(one: Shown) -> str:
    sides = [arm for side, arm in enumerate(("left", "right")) if one.went.named[:, side].any()]
    return " and ".join(sides) or "nobody"


def _waited(one: Shown) -> float:
    """Seconds for which x waited while the box was carried."""
    return sum(length for _, length in spans(one.went.waits, one.went.time))


def _arms(shown: Sequence[Shown]) -> list[str]:
    return [arm for side, arm in enumerate(("left", "right")) if any(o.went.pushed[:, side].any() for o in shown)]


def _short(shown: Sequence[Shown]) -> bool:
    return any(one.rollout.outcome != Outcome.ARRIVED for one in shown)
