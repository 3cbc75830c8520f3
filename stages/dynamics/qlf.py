"""LPV-DS under the paper's quadratic Lyapunov function V = |x - x_g|^2: eqs. (6)-(8) from data to a certified model.

One mixture and one program; where the mixture stage hands on several candidates, training roll-outs choose between them
(`choose.py`). Not here: Lyapunov functions that are learned (`pqlf.py`, `warped.py`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from stages.dynamics.certificate import restore
from stages.dynamics.choose import Tried, choose
from stages.dynamics.fit import CERTIFIED, DynamicsFit, check, check_positive, measured
from stages.dynamics.learn import Learning, Recipe
from stages.dynamics.lpvds import LpvDs, arrays
from stages.dynamics.parameters import QlfParameters
from stages.dynamics.program.regression import least_squares
from stages.dynamics.program.solve import solve, solve_norm
from stages.dynamics.samples import frame_of
from stages.dynamics.warp import Warp
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Array, Trajectory


def fit(
    demonstrations: Sequence[Trajectory],
    mixtures: Mapping[str, GaussianMixture],
    goal: Array,
    parameters: QlfParameters,
) -> DynamicsFit:
    """Learn A_k under A_k + A_k' <= -margin I and prove the model stable. Paper eqs. (6)-(8).

    `goal`: x_g, shape (d,), metres.

    Raises DataError: see `fit.check`. ParameterError: a parameter is out of range. SolverError: the program was not
    solved accurately, or its answer could not be proved stable.
    """
    check_positive(parameters, "margin", "tolerance")
    goal = check(demonstrations, mixtures, goal)
    name, tried = (
        _chosen(demonstrations, mixtures, goal, parameters) if len(mixtures) > 1 else (next(iter(mixtures)), ())
    )
    mixture, P = mixtures[name], np.eye(goal.shape[0])
    position = np.concatenate([demonstration.position for demonstration in demonstrations])
    velocity = np.concatenate([demonstration.velocity for demonstration in demonstrations])
    untrained = arrays(mixture, np.zeros_like(mixture.covariances), goal, P)
    program = solve if parameters.loss == "squared" else solve_norm
    problem = least_squares(position, velocity, untrained)
    solution = program(problem, parameters.margin, tolerance=parameters.tolerance)
    matrices, certificate = restore(solution.matrices, P, CERTIFIED * parameters.margin)
    model = LpvDs(mixture=mixture, matrices=matrices, goal=goal, lyapunov_matrix=P)
    return measured(model, solution, certificate, demonstrations, name, tried)


def _chosen(
    demonstrations: Sequence[Trajectory],
    mixtures: Mapping[str, GaussianMixture],
    goal: Array,
    parameters: QlfParameters,
) -> tuple[str, tuple[Tried, ...]]:
    """The mixture whose system follows the demonstrations best, and what was tried."""
    recipes = [
        Recipe(mixture=name, gaussians=mixture, warp=Warp.identity(goal.shape[0]), share=0.0, guidance=0.0)
        for name, mixture in mixtures.items()
    ]
    learning = Learning(
        margin=parameters.margin,
        condition=1.0,
        ridge=0.0,
        width=1.0,
        decay=1.0,
        speed_limit=math.inf,
        tolerance=parameters.tolerance,
    )
    choice = choose(demonstrations, goal, frame_of(demonstrations, goal), recipes, learning)
    return choice.recipe.mixture, choice.tried
