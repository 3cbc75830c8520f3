"""What a person should know of roll-outs that have run: one sentence each. Results in, text out."""

from __future__ import annotations

from collections.abc import Iterator

from stages.policy.avoidance.parameters import RoasPlusParameters
from stages.policy.outcome import Outcome
from stages.rollout.cases import method_name
from stages.rollout.parameters import RolloutParameters
from stages.rollout.results import Simulated

REFUSED = (Outcome.GOAL_INSIDE, Outcome.START_INSIDE, Outcome.SWALLOWED)
"""Outcomes of roll-outs that never began."""


def notices(done: Simulated, parameters: RolloutParameters) -> Iterator[str]:
    """Disturbances that never came, cases that could not begin, and traps that no detour leaves."""
    unpushed = [r.rollout for r in done.rollouts if r.missed]
    if unpushed:
        yield (
            f"{len(unpushed)} roll-outs ended before a disturbance of theirs, the first {unpushed[0]}: let it begin "
            "earlier (at_time, at_fraction)."
        )
    for outcome in REFUSED:
        refused = [r.rollout for r in done.rollouts if r.outcome is outcome]
        if refused:
            yield f"{len(refused)} roll-outs could not begin ({outcome}), the first {refused[0]}. {outcome.remedy}"
    trapping = [scene for scene in done.scenes if scene.traps is not None and scene.traps.shape[0]]
    staying = [m for m in parameters.avoidances if isinstance(m, RoasPlusParameters) and not m.detour]
    if trapping and staying:
        count = sum(scene.traps.shape[0] for scene in trapping if scene.traps is not None)
        yield (
            f"{len(trapping)} of {len(done.scenes)} scenes have traps, {count} in all, places on an obstacle where V "
            f"has a minimum, the first scene {trapping[0].name}; {method_name(staying[0])} stands still there: "
            "detour = true leaves them."
        )
