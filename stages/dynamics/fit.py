"""From recipes to a certified system, and what a fit is returned with, whichever kind of dynamics it is.

Choose, learn on every sample, prove, measure; a model is never returned without a certificate. Not here: what a kind
tries (`qlf.py`, `pqlf.py`, `warped.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import DataError, ParameterError
from stages.dynamics.certificate import Certificate, restore
from stages.dynamics.choose import Tried, choose
from stages.dynamics.learn import Learning, Recipe, data_of, place, pooled, refine, regularised, smoothed, system
from stages.dynamics.lpvds import LpvDs, velocity_error
from stages.dynamics.parameters import PqlfParameters, WarpedParameters
from stages.dynamics.program.solve import Solution
from stages.dynamics.samples import Frame, frame_of, guides, in_motion, thinned
from stages.dynamics.warp import Warp
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Array, Trajectory

CERTIFIED = 0.999
"""Share of the margin that is proved: an active constraint holds to rounding, which is not proved to be within it."""

_SOURCE = "training data"


@dataclass(frozen=True, kw_only=True, eq=False)
class DynamicsFit:
    """A learned and certified system, and how well it fits.

    Attributes:
        model: the system.
        solution: of the semidefinite program; its matrices are the model's before `certificate.shift`.
        certificate: the proof.
        rmse: root mean square velocity error over the training data, m/s.
        relative_rmse: `rmse` divided by the root mean square speed of the training data.
        mixture: name of the mixture that was taken.
        tried: the candidates between which training roll-outs chose; empty: there was one.
    """

    model: LpvDs
    solution: Solution
    certificate: Certificate
    rmse: float
    relative_rmse: float
    mixture: str
    tried: tuple[Tried, ...] = ()


def fit_learned(
    demonstrations: Sequence[Trajectory],
    mixtures: Mapping[str, GaussianMixture],
    goal: Array,
    parameters: PqlfParameters | WarpedParameters,
    warps: Callable[[Sequence[Trajectory], Array], Mapping[float, Warp]],
) -> DynamicsFit:
    """Learn P and A_k for every mixture, warp and weight of the guides, take the best on training data, and prove it.

    `goal`: x_g, shape (d,), metres. `warps`: demonstrations without their rests and the goal -> warps by how far they
    straighten the mean demonstration.

    Raises DataError: see `check`. ParameterError: a parameter is out of range. SolverError: no candidate could be
    learned, or the answer could not be proved stable.
    """
    goal = check(demonstrations, mixtures, goal)
    moving = [in_motion(demonstration) for demonstration in demonstrations]
    learning = learning_of(parameters, moving, goal)
    frame = frame_of(moving, goal)
    gated = {
        name: smoothed(mixture, parameters.widening, parameters.blur * frame.size) for name, mixture in mixtures.items()
    }
    tried = warps(moving, goal)
    recipes = [
        Recipe(mixture=name, gaussians=gaussians, warp=warp, share=share, guidance=guidance)
        for name, gaussians in gated.items()
        for share, warp in tried.items()
        for guidance in parameters.guidance
    ]
    return fit_best(moving, goal, frame, recipes, learning, demonstrations)


def fit_best(
    demonstrations: Sequence[Trajectory],
    goal: Array,
    frame: Frame,
    recipes: Sequence[Recipe],
    learning: Learning,
    whole: Sequence[Trajectory],
) -> DynamicsFit:
    """Choose between recipes on thinned demonstrations, learn the one that is taken on every sample, and prove it.

    `goal`: x_g, shape (d,), metres. `whole`: the demonstrations with their rests, on which errors are measured.

    Raises SolverError: no recipe could be learned, or the answer could not be proved stable.
    """
    choice = choose(demonstrations, goal, frame, recipes, learning)
    recipe, P = choice.recipe, choice.lyapunov_matrix
    width, decay = learning.width * frame.size, learning.decay * frame.size
    parts = [
        data_of(
            recipe,
            place(recipe.warp, goal, thinned(d, None)),
            place(recipe.warp, goal, guides(d, frame, width, decay), guides=True),
        )
        for d in demonstrations
    ]
    data = pooled(parts)
    solution = refine(regularised(recipe, data, learning), learning, P)
    matrices, certificate = restore(solution.matrices, P, CERTIFIED * learning.margin)
    return measured(
        system(recipe, goal, matrices, P, learning), solution, certificate, whole, recipe.mixture, choice.tried
    )


def learning_of(
    parameters: PqlfParameters | WarpedParameters, demonstrations: Sequence[Trajectory], goal: Array
) -> Learning:
    """How candidates are learned, from the parameters of the stage; raises ParameterError where one is out of range.

    The margin is in proportion to the motion's own rate, so that a slower clock makes a slower system and no other.
    """
    check_positive(parameters, "margin", "condition", "widening", "guide_width", "guide_decay", "tolerance")
    top = max(float(np.sqrt((d.velocity**2).sum(axis=1)).max()) for d in demonstrations)
    moved = np.concatenate([d.position - goal for d in demonstrations])
    driven = np.concatenate([d.velocity for d in demonstrations])
    rate = math.sqrt(float((driven**2).sum() / (moved**2).sum()))
    return Learning(
        margin=parameters.margin * rate,
        condition=parameters.condition,
        ridge=parameters.ridge,
        width=parameters.guide_width,
        decay=parameters.guide_decay,
        speed_limit=parameters.speed_limit * top if parameters.speed_limit > 0.0 else math.inf,
        tolerance=parameters.tolerance,
    )


def measured(
    model: LpvDs,
    solution: Solution,
    certificate: Certificate,
    demonstrations: Sequence[Trajectory],
    mixture: str,
    tried: tuple[Tried, ...],
) -> DynamicsFit:
    """Put a fit together, with its velocity error over every sample of the demonstrations."""
    rmse = velocity_error(model, demonstrations)
    speed = math.sqrt(float(np.concatenate([(d.velocity**2).sum(axis=1) for d in demonstrations]).mean()))
    return DynamicsFit(
        model=model,
        solution=solution,
        certificate=certificate,
        rmse=rmse,
        relative_rmse=rmse / speed,
        mixture=mixture,
        tried=tried,
    )


def check(demonstrations: Sequence[Trajectory], mixtures: Mapping[str, GaussianMixture], goal: Array) -> Array:
    """Return the goal as an array of the right type; raises DataError where nothing can be learned from the data."""
    goal = np.ascontiguousarray(goal, dtype=np.float64)
    if not demonstrations:
        raise DataError(_SOURCE, "there is no demonstration to learn from.")
    if not mixtures:
        raise DataError(_SOURCE, "there is no mixture to learn with.")
    d = demonstrations[0].dimension
    for demonstration in demonstrations:
        if demonstration.dimension != d:
            raise DataError(demonstration.name, f"has {demonstration.dimension} coordinates, the first one has {d}.")
        for name in ("position", "velocity"):
            if not np.isfinite(getattr(demonstration, name)).all():
                raise DataError(demonstration.name, f"{name} is not finite.")
        if (demonstration.position == demonstration.position[0]).all():
            raise DataError(demonstration.name, "all points are the same: a demonstration must move.")
        if not demonstration.velocity.any():
            raise DataError(demonstration.name, "every velocity is zero: a demonstration must move.")
    for name, mixture in mixtures.items():
        if mixture.dimension != d:
            raise DataError(_SOURCE, f"mixture {name} has {mixture.dimension} coordinates, demonstrations have {d}.")
    if goal.shape != (d,) or not np.isfinite(goal).all():
        raise DataError(_SOURCE, f"the goal must be {d} finite numbers, not {goal.tolist()}.")
    return goal


def check_positive(parameters: object, *names: str) -> None:
    """Raise ParameterError unless each named parameter of the dynamics is a positive, finite number."""
    for name in names:
        value = getattr(parameters, name)
        if not (value > 0.0 and math.isfinite(value)):
            raise ParameterError(f"dynamics.{name}", f"must be a positive number, not {value}.")
