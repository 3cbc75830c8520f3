"""Where a run departs from the paper's print, and why: rows that follow from the experiment's parameters.

Only what applies is listed. Parameters in, text out; marked as `pipeline.report.Paragraph` says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stages.figures.avoidance_deviations import avoidance, pots
from stages.figures.carry_deviations import carrying
from stages.figures.conditions import when
from stages.figures.deviation import X_DOT, Deviation, Resolved
from stages.figures.following_deviations import following
from stages.figures.numbers import MINUS, MM, given, joined, span
from stages.policy.coupling import SPEED_ALLOWANCE, gate_for
from stages.rollout.parameters import CarryParameters, ClpvdsController, Displacement, RolloutParameters

PAPER_P_MAX = 10.0
"""1/s, for eq. (10). Paper section III-B."""

PAPER_K_C = 100.0
"""1/m, for eq. (10). Paper section III-B."""

PAPER_SPLIT = 3
"""Demonstrations for training, of seven. Paper section III-A: "divided in a 3:4 ratio"."""

P_HAT = "p\u0302"


def deviations(parameters: Mapping[str, Any], resolved: Sequence[Resolved]) -> list[Deviation]:
    """Rows that apply, in the order of the paper.

    Arguments:
        parameters: stage -> its validated parameters.
        resolved: one of each motion; ranges over them are given where they differ.
    """
    rollout, dynamics = parameters["rollout"], parameters["dynamics"]
    if isinstance(rollout, CarryParameters):
        found = [coupling for r in resolved for coupling in r.couplings.values()]
        cases = [
            *_integrator("cayley", dynamics),
            *_dynamics(dynamics),
            *_robust(found),
            *_proof(),
            *following(rollout, resolved),
            *carrying(rollout),
            *pots(rollout),
        ]
    else:
        cases = [
            *_integrator(rollout.integrator, dynamics),
            *_dynamics(dynamics),
            *_coupling(rollout, resolved),
            *_disturbances(rollout),
            *avoidance(rollout),
        ]
    return [
        *_mixture(parameters["mixture"]),
        *cases,
        *_data(parameters["ingest"]),
        *_metrics(parameters["evaluate"]),
    ]


def _mixture(mixture: Any) -> list[Deviation]:
    where = "(5), ref. [32]"
    if mixture.kind == "pcgmm":
        chains = f" in each of {mixture.chains} chains" if mixture.chains > 1 else ""
        return [
            Deviation(
                where=where,
                printed="PC-GMM; its sampler, prior and similarity are not printed",
                here=f"Collapsed Gibbs sampling of links: {mixture.sweeps} sweeps{chains} over at most "
                f"{mixture.points} points spread by arc length, the state of highest posterior, then at most "
                f"{mixture.polish} steps of expectation maximisation on all points. Similarity width: "
                f"{given(mixture.length_scale)} of the data's rms radius. Prior: the full covariance of the data.",
                why="A sweep costs the square of the number of points. Published codes disagree about the similarity, "
                "and depend on the unit and on the axes; this one does not.",
            )
        ]
    if mixture.kind == "auto":
        sizes = ", ".join(str(size) for size in mixture.components)
        return [
            Deviation(
                where=where,
                printed="PC-GMM, which finds K",
                here=f"Several candidates: PC-GMM and plain expectation maximisation with K = {sizes}. The system of "
                "eq. (6) is learned on each; the one whose roll-outs follow the training demonstrations best is taken.",
                why="No criterion of the mixture alone says which one makes the most accurate motion.",
            )
        ]
    how = "K by the Bayesian information criterion" if mixture.components is None else f"K = {mixture.components}"
    return [
        Deviation(
            where=where,
            printed="PC-GMM, which finds K",
            here=f"Plain expectation maximisation on positions, {how}.",
            why=f"`mixture.kind = {mixture.kind}` was set.",
        )
    ]


def _dynamics(dynamics: Any) -> list[Deviation]:
    rows = []
    if getattr(dynamics, "loss", "squared") == "squared":
        rows.append(
            Deviation(
                where="(7)",
                printed=f"Sum of |f(x) {MINUS} {X_DOT}|, not squared",
                here="Sum of the squares.",
                why="The text calls the program quadratic; squared, it needs one pass over the data.",
            )
        )
    margin = f"at most {MINUS}{given(dynamics.margin)} 1/s, proved by a Cholesky factorisation with a bound on its "
    if dynamics.kind == "qlf":
        rows.append(
            Deviation(
                where="(8)",
                printed="A_{k} + A_{k}^{T} negative definite",
                here=f"A_{{k}} + A_{{k}}^{{T}} {margin}rounding.",
                why="A solver cannot keep a strict inequality: asked for 0, it returns eigenvalues slightly above.",
            )
        )
        return rows
    learned = (
        f"P learned, trace P = d, condition at most {given(dynamics.condition)}, A_{{k}}^{{T}}P + P A_{{k}} {margin}"
        f"rounding: `dynamics.kind = {dynamics.kind}`."
    )
    if dynamics.kind == "pqlf":
        row = Deviation(
            where="(8)",
            printed=f"V = |x {MINUS} x_{{g}}|^{{2}}",
            here=f"V = (x {MINUS} x_{{g}})^{{T}}P(x {MINUS} x_{{g}}), {learned}",
            why="Circles let few motions pass by their goal before they approach it; ellipses let more of them.",
        )
    else:
        row = Deviation(
            where="(6), (8)",
            printed=f"f(x) = sum of gamma_{{k}} A_{{k}}(x {MINUS} x_{{g}}), V = |x {MINUS} x_{{g}}|^{{2}}",
            here="f(x) = J^{-1} sum of gamma_{k} A_{k} psi(x), V = psi^{T}P psi, psi a learned diffeomorphism with "
            f"Jacobian J and psi(x_{{g}}) = 0, {learned}",
            why="For many motions no system with a quadratic V comes near the demonstrations.",
        )
    return [*rows, row, *_learning(dynamics)]


def _learning(dynamics: Any) -> list[Deviation]:
    """What kinds that learn their V add to eqs. (5)-(7)."""
    rows = [
        Deviation(
            where="(5), (6), gates",
            printed="gamma_{k} of the fitted mixture",
            here=f"Its covariances times {given(dynamics.widening)}, and blurred by {given(dynamics.blur)} of the "
            "motion's size.",
            why="Components hand over smoothly, so that the flow beside the demonstrations is not left to one alone.",
        )
    ]
    terms = []
    if dynamics.ridge > 0.0:
        terms.append(f"a ridge of {given(dynamics.ridge)} that holds A_{{k}} near its component's own rate")
    if any(weight > 0.0 for weight in dynamics.guidance):
        weights = " or ".join(given(weight) for weight in dynamics.guidance)
        terms.append(
            f"guides {given(dynamics.guide_width)} of the motion's size beside the path that lead back to it, with "
            f"{weights} of the samples' weight"
        )
    if terms:
        rows.append(
            Deviation(
                where="(7), added",
                printed="The demonstrations' samples alone",
                here=f"And {joined(terms)}.",
                why="Samples say nothing of what to do beside the path. No error that is reported counts what is "
                "added.",
            )
        )
    if dynamics.speed_limit > 0.0:
        rows.append(
            Deviation(
                where="(6), speed",
                printed="Speed grows with the distance, without bound",
                here=f"f is scaled down to {given(dynamics.speed_limit)} times the training demonstrations' top speed "
                "where it would exceed that.",
                why="A linear system is twice as fast twice as far away. How fast V falls changes, not whether.",
            )
        )
    return rows


def _coupling(rollout: RolloutParameters, resolved: Sequence[Resolved]) -> list[Deviation]:
    rows = []
    for controller in rollout.controllers:
        if isinstance(controller, ClpvdsController):
            mode = controller.mode or rollout.mode
            found = [r.couplings[f"clpvds {mode}"] for r in resolved]
            speeds = [r.top_speed for r in resolved]
            rows.extend(_robust(found) if mode == "robust" else _paper(controller, found, speeds))
    return [*rows, *_proof()] if rows else []


def _proof() -> list[Deviation]:
    """How the stability of a coupled system is known."""
    return [
        Deviation(
            where="(24), (25)",
            printed="A proof of stability in continuous time",
            here="The certificate of (8), the step of (6), and V along x checked in every step of every roll-out.",
            why="The printed proof has a wrong sign in its second line, a strict inequality where equality occurs, and "
            "drops a term that vanishes only where the gate is exact.",
        )
    ]


def _robust(found: Sequence[Mapping[str, float]]) -> list[Deviation]:
    v_max = span([c["v_max"] * MM for c in found])
    return [
        Deviation(
            where="(9), (10), robust",
            printed=f"{P_HAT}\u0307 = C (x {MINUS} {P_HAT}), "
            f"C = p_{{max}} (1 {MINUS} exp({MINUS}k_{{c}} |{P_HAT} {MINUS} x|))",
            here=f"{P_HAT} moves towards x, at v_{{max}} = {v_max} mm/s at most, and onto x exactly where a step "
            "reaches it. In each step x moves first.",
            why=f"As printed, |{P_HAT} {MINUS} x| falls as 1/(p_{{max}} k_{{c}} t) and is never 0, so the exact gate "
            "of (12) would never open again. With this follower the gate is exactly that of (12).",
        )
    ]


def _paper(
    controller: ClpvdsController, found: Sequence[Mapping[str, float]], top_speeds: Sequence[float]
) -> list[Deviation]:
    gate, double = span([c["gate"] * MM for c in found]), span([2 * c["gate"] * MM for c in found])
    rows = [
        Deviation(
            where="(9), printed",
            printed="A differential equation",
            here="Carried on in sub-steps with C h at most 0.1.",
            why="Explicit Euler overshoots where C dt exceeds 1.",
        )
    ]
    if (controller.p_max, controller.k_c) != (PAPER_P_MAX, PAPER_K_C):
        needed = [gate_for(PAPER_P_MAX, PAPER_K_C, SPEED_ALLOWANCE * speed) * MM for speed in top_speeds]
        rows.append(
            Deviation(
                where="(10), printed",
                printed="p_{max} = 10, k_{c} = 100 on the robot; p_{max} is called a speed",
                here=f"p_{{max}} = {span([c['p_max'] for c in found])} 1/s, k_{{c}} = {given(controller.k_c)} 1/m. "
                "C is a rate, 1/s.",
                why=f"With the robot's values the gate would need a tolerance of {span(needed)} mm for {P_HAT} to keep "
                f"up with these motions, and would close only beyond {span([2 * value for value in needed])} mm.",
            )
        )
    rows.append(
        Deviation(
            where="(12), printed",
            printed=f"x moves only where x = {P_HAT}",
            here=f"x may start where |{P_HAT} {MINUS} x| is at most {gate} mm, and moves until it exceeds {double} mm.",
            why=f"With equality x could not move: its first step makes it differ from {P_HAT}, which never reaches it.",
        )
    )
    return rows


def _integrator(integrator: str, dynamics: Any) -> list[Deviation]:
    if integrator == "cayley":
        state = "z = psi(x), and x^{+} = psi^{-1}(z^{+})" if dynamics.kind == "warped" else f"z = x {MINUS} x_{{g}}"
        here = (
            f"Cayley step: (I {MINUS} h A/2) z^{{+}} = (I + h A/2) z, with A = sum of gamma_{{k}}(x) A_{{k}}, {state}."
        )
        why = "V cannot rise in it, whatever the step; with explicit Euler it can."
    else:
        here, why = "Explicit Euler.", "`rollout.integrator = euler` was set; V can rise in a step."
    printed = "Differential equations; no integrator is named"
    return [Deviation(where="(6), (11)", printed=printed, here=here, why=why)]


def _disturbances(rollout: RolloutParameters) -> list[Deviation]:
    disturbances = [one for condition in rollout.conditions for one in condition.disturbances]
    if not disturbances:
        return []
    once = all(isinstance(one, Displacement) for one in disturbances)
    how = "Added once to the executed state" if once else "The executed state is displaced, dragged or shaken"
    times = joined(list(dict.fromkeys(when(one) for one in disturbances)))
    return [
        Deviation(
            where="Figs 2, 3",
            printed="Disturbances at the midpoint of the path",
            here=f"{how}, {times}.",
            why="Which path, and where its middle is, is not printed.",
        )
    ]


def _data(ingest: Any) -> list[Deviation]:
    if ingest.kind != "lasa":
        return []
    train = ", ".join(str(index) for index in ingest.train)
    printed = len(ingest.train) == PAPER_SPLIT
    return [
        Deviation(
            where="III-A",
            printed="Training and test sets in a ratio of 3:4; which, is not printed",
            here=f"Demonstrations {train} train, the others test.",
            why="Always the same ones, so that runs can be compared." if printed else "`ingest.train` was set.",
        )
    ]


def _metrics(evaluate: Any) -> list[Deviation]:
    return [
        Deviation(
            where="(26), DTWD",
            printed="Named dynamic time warping distance; the formula is the swept area a step",
            here=f"Both, on paths of {evaluate.samples} samples: the formula, samples uniform in arc length, the two "
            "triangles where the sides of a quadrilateral cross; and dynamic time warping, samples uniform in time.",
            why="The formula warps nothing: uniform in time, a pause would count as an area. Its 1/T depends on the "
            "sampling. Measured is the executed state, its excursion included: x of a coupled system never leaves its "
            "path.",
        )
    ]
