"""Where pushes on an arm depart from the paper's print, and why: rows for `deviations.py`. Parameters in, text out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from stages.figures.deviation import Deviation, Resolved, Strayed
from stages.figures.intervals import of
from stages.figures.numbers import MINUS, MM, given, joined, number, span
from stages.policy.coupling import gate_for
from stages.rollout.carry_conditions import mode_of
from stages.rollout.parameters import ArmDisturbance, CarryParameters, Drag, Force

P_MAX, K_C = 10.0, 100.0
"""1/s and 1/m, for eq. (10), on the arms. Paper section III-B."""

P_HAT = "p\u0302"


def following(rollout: CarryParameters, resolved: Sequence[Resolved]) -> list[Deviation]:
    """Rows on eqs. (9)-(14) that apply where arms carry a box."""
    pushed = [condition for condition in rollout.conditions if condition.disturbances]
    if not pushed:
        return [
            _thresholds(rollout),
            Deviation(
                where="(14)",
                printed="An arm that is pushed aside is followed by the other one",
                here="On, with nothing to do.",
                why="No arm is pushed aside in these roll-outs.",
            ),
        ]
    modes = {mode_of(rollout, condition) for condition in pushed if condition.following}
    rows = [_coupling(resolved)] if any(mode_of(rollout, c) == "paper" for c in rollout.conditions) else []
    rows.append(_thresholds(rollout))
    if "paper" in modes:
        rows.append(_printed([one for r in resolved for one in r.strayed]))
    if "robust" in modes:
        rows += _robust(rollout)
    rows.append(_pushes([one for condition in pushed for one in condition.disturbances]))
    return rows


def _coupling(resolved: Sequence[Resolved]) -> Deviation:
    speeds = [r.top_speed for r in resolved]
    behind = [gate_for(P_MAX, K_C, speed) * MM for speed in speeds]
    return Deviation(
        where="(9), (10), on the arms",
        printed=f"p_{{max}} = {given(P_MAX)}, k_{{c}} = {given(K_C)}",
        here=f"{P_HAT} follows x as in the robust form, in the printed one, too.",
        why=f"At the demonstrations' top speed, {span([speed * MM for speed in speeds])} mm/s, the printed follower is "
        f"{span(behind)} mm behind x where nobody pushes: farther than any delta of (14) at which a box is kept.",
    )


def _thresholds(rollout: CarryParameters) -> Deviation:
    gate, delta = rollout.following.gate * MM, rollout.following.deviation_threshold * MM
    return Deviation(
        where="(12), (14), delta",
        printed=f"delta is the gate of (12) and the threshold of (14); x waits wherever x {MINUS} {P_HAT} is not 0",
        here=f"Two parameters. `gate`: x waits while an arm is more than {given(2.0 * gate)} mm away, and until it is "
        f"within {given(gate)} mm. `deviation_threshold`: eq. (14) from {given(delta)} mm.",
        why="Arms lag, sag and feel noise: they are never exactly where they are led. x has to wait before the arms "
        "follow each other, or it would go on while one is held.",
    )


def _printed(strayed: Sequence[Strayed]) -> Deviation:
    measured = ""
    if strayed:
        ended = Counter(one.outcome for one in strayed)
        measured = (
            f" Measured: the midpoint was {span([one.let_go * MM for one in strayed])} mm away when the arm was let "
            f"go, and {span([one.end * MM for one in strayed])} mm in the end; "
            f"{joined([f'{of(count, len(strayed))} {outcome}' for outcome, count in ended.items()])}."
        )
    return Deviation(
        where="(14), printed",
        printed="Both arms follow where the other one is",
        here="As printed; x waits meanwhile.",
        why="The midpoint is then nobody's: what a push has moved stays where it is, or drifts with the least error of "
        f"L, calibration or sag. (14) never switches back.{measured}",
    )


def _robust(rollout: CarryParameters) -> list[Deviation]:
    f = rollout.following
    return [
        Deviation(
            where="(14), robust",
            printed=f"Both arms follow where the other one is, while |x {MINUS} p| exceeds delta",
            here="The pushed arm is the one farther from where it would be, by its commands and the lag of its inner "
            f"loop, {given(f.lag)} 1/s, if nobody touched it; what it is off by anyhow is learned before. It is led "
            f"back to {P_HAT}, and the other one follows it where it is, with the offset of the force. {P_HAT} gives "
            f"way to who holds the arm, within {given(f.yielding)} s, stays {given(f.lead * MM)} mm ahead, and comes "
            f"back to x at {number(f.return_speed * MM)} mm/s at most, with {given(f.return_acceleration)} m/s^{{2}}.",
            why="One arm has to lead, or nothing brings the box back.",
        ),
        Deviation(
            where="(14), switches",
            printed="Places switch at once",
            here=f"What differs fades within {given(f.blend)} s. It is over when {P_HAT} has been at x, and the arms "
            f"within the gate, for as long.",
            why="A step of a few millimetres is a blow of several newtons.",
        ),
    ]


def _pushes(disturbances: Sequence[ArmDisturbance]) -> Deviation:
    texts = dict.fromkeys(_said(one) for one in disturbances)
    return Deviation(
        where="Fig. 5d",
        printed="The left arm is moved through teleoperation; how far, when and for how long is not printed",
        here=f"{'. '.join(text[0].upper() + text[1:] for text in texts)}.",
        why="Of a push that is drawn anew for every box, success can be counted. Boxes and pushes are the same under "
        "all conditions.",
    )


def _said(push: ArmDisturbance) -> str:
    """How an arm is pushed, in words."""
    if isinstance(push, Force):
        strength = ", ".join(given(value) for value in push.force)
        return f"a force of [{strength}] N on the {push.arm} arm for {given(push.duration)} s"
    if isinstance(push, Drag):
        far = ", ".join(given(value * MM) for value in push.offset)
        return (
            f"the {push.arm} arm is dragged by [{far}] mm within {given(push.rise)} s and held for {given(push.hold)} s"
        )
    return (
        f"either arm is dragged {given(push.nearest * MM)} to {given(push.farthest * MM)} mm in any direction within "
        f"{given(push.quickest)} to {given(push.slowest)} s, and let go after {given(push.shortest)} to "
        f"{given(push.longest)} s"
    )
