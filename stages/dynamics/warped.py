"""The warped LPV-DS: eq. (6) in the image of a learned diffeomorphism, for motions that have no quadratic V.

f(x) = J(x)^-1 sum_k gamma_k(x) A_k psi(x), V = psi'P psi. psi straightens the mean demonstration part of the way
(`straighten.py`); in its image, which still bends, the LPV-DS and P are learned as ever. The guarantee is the paper's,
carried over by psi: V is positive, falls along f, and is 0 at the goal only. Which mixture, how straight, and how much
guides count is chosen by training roll-outs (`choose.py`). Not here: the warp itself (`warp.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stages.dynamics.fit import DynamicsFit, fit_learned
from stages.dynamics.parameters import WarpedParameters
from stages.dynamics.straighten import mean_demonstration, straighten
from stages.dynamics.warp import Warp
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Array, Trajectory


def fit(
    demonstrations: Sequence[Trajectory],
    mixtures: Mapping[str, GaussianMixture],
    goal: Array,
    parameters: WarpedParameters,
) -> DynamicsFit:
    """Learn psi, P and A_k for every mixture, straightening and weight of the guides; take the best, and prove it.

    `goal`: x_g, shape (d,), metres.

    Raises as `fit.fit_learned`.
    """

    def warps(moving: Sequence[Trajectory], at: Array) -> dict[float, Warp]:
        mean = mean_demonstration(moving, at)
        return {share: straighten(mean, share, parameters.translations) for share in parameters.straightening}

    return fit_learned(demonstrations, mixtures, goal, parameters, warps)
