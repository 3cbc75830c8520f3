"""LPV-DS under a learned quadratic Lyapunov function V = (x - x_g)'P (x - x_g): eqs. (6)-(8) with A_k'P + P A_k < 0.

Many motions pass by their goal before they approach it; ellipses let more of them do so than the paper's circles, and
remain one matrix. P is searched for (`search.py`); which mixture, and how much guides beside the demonstrations count,
is chosen by training roll-outs (`choose.py`). Not here: motions for which no quadratic V exists (`warped.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stages.dynamics.fit import DynamicsFit, fit_learned
from stages.dynamics.parameters import PqlfParameters
from stages.dynamics.warp import Warp
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Array, Trajectory


def fit(
    demonstrations: Sequence[Trajectory],
    mixtures: Mapping[str, GaussianMixture],
    goal: Array,
    parameters: PqlfParameters,
) -> DynamicsFit:
    """Learn P and A_k with every mixture and weight of the guides, take the best on training data, and prove it.

    `goal`: x_g, shape (d,), metres.

    Raises as `fit.fit_learned`.
    """
    return fit_learned(demonstrations, mixtures, goal, parameters, lambda moving, at: {0.0: Warp.identity(at.shape[0])})
