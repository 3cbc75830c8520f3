"""Choose between candidates by the training demonstrations alone: each is learned, rolled out, and cross-validated.

A candidate's score is (deviation of its roll-outs from the demonstrations that it was learned from + deviation of the
roll-outs from demonstrations that were held out) x (1 + relative velocity error on those held out)^2. Held out are in
turn a third of the demonstrations; mixture, warp and P stay, A_k are learned again. The best candidate is taken whose
roll-outs all arrive, also those from starts that are displaced a little. Not here: what the candidates are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.errors import SolverError
from stages.dynamics.follow import deviation
from stages.dynamics.kernels import ModelArrays
from stages.dynamics.learn import (
    Data,
    Learning,
    Placed,
    Recipe,
    data_of,
    find,
    place,
    pooled,
    refine,
    regularised,
    system,
)
from stages.dynamics.samples import Frame, guides, thinned
from stages.dynamics.warp import Warp
from stages.trajectory import Array, Trajectory

SAMPLES = 200
"""Most samples of a demonstration that a candidate is learned from while choosing."""

FOLDS = 3
"""Most parts of the demonstrations that are held out in turn."""

DISPLACEMENT = 0.05
"""How far starts are displaced along each principal axis, to and fro, as a fraction of the motion's size."""

COMPRESSION = 0.01
"""A warp that compresses a direction to less than this at a sample is left out: its inverse would be too steep."""


@dataclass(frozen=True, kw_only=True)
class Tried:
    """What became of one candidate.

    Attributes:
        mixture, components, share, guidance: what it was made of, as in `Recipe`.
        condition: of its P; this and all that follows is none where it could not be learned.
        velocity_error: relative root mean square, on the samples it was learned from.
        held_out_error: the same on demonstrations that were held out.
        deviation: mean distance of its roll-outs from the demonstrations, metres.
        held_out_deviation: the same of demonstrations that were held out.
        score: the lowest is best; metres.
        arrives: whether all its roll-outs came to the goal, of the best ones also those from displaced starts.
        chosen: it was taken.
    """

    mixture: str
    components: int
    share: float
    guidance: float
    condition: float | None = None
    velocity_error: float | None = None
    held_out_error: float | None = None
    deviation: float | None = None
    held_out_deviation: float | None = None
    score: float | None = None
    arrives: bool | None = None
    chosen: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """The candidate that was taken.

    Attributes:
        recipe: what it is made of.
        lyapunov_matrix: array, shape (d, d), its P.
        tried: one entry a candidate, in the order in which they were given.
    """

    recipe: Recipe
    lyapunov_matrix: Array
    tried: tuple[Tried, ...]


_Placed = list[tuple[Placed, Placed]]
"""Samples and guides of each demonstration."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Learned:
    recipe: Recipe
    P: Array
    model: ModelArrays
    score: float
    tried: Tried


def choose(
    demonstrations: Sequence[Trajectory],
    goal: Array,
    frame: Frame,
    recipes: Sequence[Recipe],
    learning: Learning,
) -> Choice:
    """Learn every recipe and take the best by training demonstrations alone.

    `goal`: x_g, shape (d,), metres.

    A recipe that cannot be learned is passed over. Raises SolverError: none could be.
    """
    tried: list[Tried] = []
    learned: list[tuple[float, int, _Learned]] = []
    failure: SolverError | None = None
    starts: dict[tuple[str, float], Array] = {}
    placed: dict[int, _Placed | None] = {}
    for number, recipe in enumerate(recipes):
        # Guides hardly move P: the search goes on from that of the same mixture and warp.
        family = (recipe.mixture, recipe.share)
        entry, found = _entry(recipe), None
        warp = id(recipe.warp)
        if warp not in placed:
            placed[warp] = _place(demonstrations, goal, frame, recipe.warp, learning)
        try:
            found = _learn(demonstrations, goal, frame, recipe, learning, placed[warp], starts.get(family))
        except SolverError as error:
            failure = error
        if found is not None:
            starts.setdefault(family, found.P)
            learned.append((found.score, number, found))
            entry = found.tried
        tried.append(entry)
    if not learned:
        raise failure or SolverError(
            "Every candidate's warp compresses too much to be learned from: lower dynamics.straightening.", "none", {}
        )
    learned.sort(key=lambda item: item[:2])
    best = learned[0]
    for score, number, found in learned:
        arrives = bool(tried[number].arrives) and _arrives(demonstrations, frame, found.model)
        tried[number] = replace(tried[number], arrives=arrives)
        if arrives:
            best = (score, number, found)
            break
    tried[best[1]] = replace(tried[best[1]], chosen=True)
    return Choice(recipe=best[2].recipe, lyapunov_matrix=best[2].P, tried=tuple(tried))


def _entry(recipe: Recipe) -> Tried:
    return Tried(
        mixture=recipe.mixture,
        components=recipe.gaussians.components,
        share=recipe.share,
        guidance=recipe.guidance,
    )


def _place(
    demonstrations: Sequence[Trajectory], goal: Array, frame: Frame, warp: Warp, learning: Learning
) -> _Placed | None:
    """Samples and guides of each demonstration as a warp sees them; none: it compresses a sample too much."""
    width, decay = learning.width * frame.size, learning.decay * frame.size
    placed = []
    for demonstration in demonstrations:
        samples = thinned(demonstration, SAMPLES)
        if warp.count:
            jacobian = warp.apply(samples.position - goal)[1]
            if np.linalg.svd(jacobian, compute_uv=False)[:, -1].min() < COMPRESSION:
                return None
        own = place(warp, goal, samples)
        placed.append((own, place(warp, goal, guides(demonstration, frame, width, decay), guides=True)))
    return placed


def _learn(
    demonstrations: Sequence[Trajectory],
    goal: Array,
    frame: Frame,
    recipe: Recipe,
    learning: Learning,
    placed: _Placed | None,
    start: Array | None,
) -> _Learned | None:
    """Learn one recipe and score it; none: its warp compresses too much."""
    if placed is None:
        return None
    parts = [data_of(recipe, own, beside) for own, beside in placed]
    everything = pooled(parts)
    found = find(regularised(recipe, everything, learning), learning, frame, start)
    model = system(recipe, goal, found.solution.matrices, found.lyapunov_matrix, learning).arrays
    ways = [deviation(model, demonstration, demonstration.position[0], frame.size) for demonstration in demonstrations]
    own_deviation = float(np.mean([way for way, _ in ways]))
    held_out_deviation, held_out_error = _held_out(
        demonstrations, goal, frame, recipe, learning, parts, found.lyapunov_matrix
    )
    error = math.sqrt(everything.own.error(found.solution.matrices) / everything.own.mean_square_speed)
    score = (own_deviation + held_out_deviation) * (1.0 + held_out_error) ** 2
    return _Learned(
        recipe=recipe,
        P=found.lyapunov_matrix,
        model=model,
        score=score,
        tried=replace(
            _entry(recipe),
            condition=float(np.linalg.cond(found.lyapunov_matrix)),
            velocity_error=error,
            held_out_error=held_out_error,
            deviation=own_deviation,
            held_out_deviation=held_out_deviation,
            score=score,
            arrives=all(arrived for _, arrived in ways),
        ),
    )


def _held_out(
    demonstrations: Sequence[Trajectory],
    goal: Array,
    frame: Frame,
    recipe: Recipe,
    learning: Learning,
    parts: Sequence[Data],
    P: Array,
) -> tuple[float, float]:
    """Mean deviation, metres, and relative velocity error on demonstrations that A_k were not learned from."""
    count = len(demonstrations)
    if count < 2:
        return 0.0, 0.0
    deviations: list[float] = []
    square_errors: list[float] = []
    for fold in range(min(FOLDS, count)):
        held = range(fold, count, min(FOLDS, count))
        rest = pooled([parts[n] for n in range(count) if n not in held])
        solution = refine(regularised(recipe, rest, learning), learning, P, loose=True)
        model = system(recipe, goal, solution.matrices, P, learning).arrays
        for n in held:
            deviations.append(deviation(model, demonstrations[n], demonstrations[n].position[0], frame.size)[0])
            own = parts[n].own
            square_errors.append(own.error(solution.matrices) / own.mean_square_speed)
    return float(np.mean(deviations)), math.sqrt(float(np.mean(square_errors)))


def _arrives(demonstrations: Sequence[Trajectory], frame: Frame, model: ModelArrays) -> bool:
    """Whether roll-outs from displaced starts arrive: to and fro along each principal axis."""
    for demonstration in demonstrations:
        for axis in frame.axes:
            for side in (-DISPLACEMENT, DISPLACEMENT):
                start = demonstration.position[0] + side * frame.size * axis
                if not deviation(model, demonstration, start, frame.size)[1]:
                    return False
    return True
