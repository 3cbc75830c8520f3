"""LPV-DS under a learned quadratic Lyapunov function V = (x - x_g)'P (x - x_g): eqs. (6)-(8) with A_k'P + P A_k < 0.

Many motions pass by their goal before they approach it; ellipses let more of them do so than the paper's circles, and
remain one matrix. P is searched for (`search.py`); which mixture, and how much guides beside the demonstrations count,
is chosen by training roll-outs (`choose.py`). Not here: motions for which no quadratic V exists (`warped.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stages.dynamics.fit import DynamicsFit, check, fit_best, learning_of
from stages.dynamics.learn import Recipe, smoothed
from stages.dynamics.parameters import PqlfParameters
from stages.dynamics.samples import frame_of, in_motion
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

    Raises DataError: see `fit.check`. ParameterError: a parameter is out of range. SolverError: no candidate could be
    learned, or the answer could not be proved stable.
    """
    goal = check(demonstrations, mixtures, goal)
    moving = [in_motion(demonstration) for demonstration in demonstrations]
    learning = learning_of(parameters, moving, goal)
    frame = frame_of(moving, goal)
    gated = {
        name: smoothed(mixture, parameters.widening, parameters.blur * frame.size) for name, mixture in mixtures.items()
    }
    identity = Warp.identity(len(goal))
    recipes = [
        Recipe(mixture=name, gaussians=gaussians, warp=identity, share=0.0, guidance=guidance)
        for name, gaussians in gated.items()
        for guidance in parameters.guidance
    ]
    return fit_best(moving, goal, frame, recipes, learning, demonstrations)
