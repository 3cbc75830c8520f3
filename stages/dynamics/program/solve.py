"""The semidefinite program of the LPV-DS, eqs. (7) and (8): its answer, how good that is, and what is done if it fails.

In Gram form its size and time do not depend on the number of samples; where components overlap so much that the Gram
matrix has lost their difference, and where the Gram form fails, it is solved unsquared, by a QR factorisation of the
samples. Eq. (7) squared, as its text says, or as it is printed. The optimality of the answer is recomputed here. Not
here: the samples (`regression.py`), units (`scaling.py`), the solver (`conic.py`), the last digits (`sharpen.py`), the
proof that the answer is stable (`certificate.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.linalg import lapack

from pipeline.errors import SolverError
from stages.dynamics.program.conic import SOLVED, Answer, minimise_gram, minimise_unsquared, pull, slack, whole
from stages.dynamics.program.regression import LeastSquares, reweighted
from stages.dynamics.program.scaling import Scaled, scale, unsquared
from stages.dynamics.program.sharpen import sharpen
from stages.trajectory import Array, frozen

# Reciprocal condition of the scaled Gram matrix, below which its rounding, 1e-16, moves A_k by more than 1e-6.
_SMALLEST_CONDITION = 1e-10
# Of the rms speed: smaller residuals count quadratically, so that the un-squared loss has a gradient.
_FLOOR = 0.01
# Rounds of re-weighting end when one lowers the loss by less than this share, or at the most.
_CHANGE = 1e-5
_ROUNDS = 60

Form = Literal["gram", "qr"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """What the program returned.

    Attributes:
        matrices: array, shape (K, d, d), A_k, 1/s.
        multipliers: array, shape (K, d, d), Z_k, positive semidefinite: a change of P changes `value` by
            sum_k <Z_k, A_k'dP + dP A_k>.
        status: what the solver said; always ``Solved``.
        form: ``gram``, or ``qr``: the regression had to be solved unsquared.
        iterations: of the solver; of `solve_norm`, of all rounds together.
        refinements: Newton steps after them, `sharpen.py`; 0: a loose answer, or one known to about sqrt(1e-9) only.
        objective: without the ridge, mean |f - xdot|^2, (m/s)^2; of `solve_norm`, mean |f - xdot|, m/s. Paper eq. (7).
        value: what was minimised, the ridge included, in units of the mean squared speed, or of the rms speed.
        residuals: recomputed here, without units: ``feasibility`` (largest violation of eq. (8)), ``stationarity``,
            ``dual`` (of the multipliers' sign) and ``gap`` (complementarity).
        descent: of `solve_norm`: `value` before its first round and after each.
    """

    matrices: Array
    multipliers: Array
    status: str
    form: Form
    iterations: int
    refinements: int
    objective: float
    value: float
    residuals: dict[str, float]
    descent: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("matrices", "multipliers"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def solve(
    problem: LeastSquares,
    margin: float,
    lyapunov_matrix: Array | None = None,
    tolerance: float = 1e-6,
    *,
    loose: bool = False,
) -> Solution:
    """Minimise eq. (7), squared, subject to A_k'P + P A_k <= -margin I for every k. Paper eqs. (7), (8).

    Where `refinements` is positive, the answer is exact but for rounding, times the condition of the Gram matrix: so a
    turned program, or one in other units, has the same answer, turned or in those units. It is 0 where that condition
    is so bad, about 1e10 or worse, that rounding decides, and where Newton's method fails. The value, and the
    constraints, then still hold to the tolerance, but A_k itself is known no better than the data determine it.

    `margin`: 1/s times the unit of P. `lyapunov_matrix`: P, shape (d, d), symmetric positive definite; none: I, as in
    eq. (8). `tolerance`: largest of the recomputed residuals that is accepted. `loose`: an answer to compare candidates
    by, without its last digits; where it is not within the tolerance, it is solved to the end.

    Raises SolverError: the solver's status is not ``Solved``, or a residual is above the tolerance. The error keeps the
    program, for `stages.dynamics.program.saved.save_problem`.
    """
    P = np.eye(problem.dimension) if lyapunov_matrix is None else np.asarray(lyapunov_matrix, dtype=np.float64)
    scaled = scale(problem, margin, P)
    attempts: list[tuple[Form, bool]] = [("gram", True), ("gram", False)] if loose else [("gram", False)]
    if problem.rows is not None:
        attempts.insert(0 if _overlaps(scaled.gram) else len(attempts), ("qr", False))
    failures = []
    for form, loosely in attempts:
        try:
            return _attempt(problem, scaled, form, loosely, tolerance)
        except SolverError as error:
            failures.append(error)
    failures[0].program = _program(problem, margin, P, tolerance, loose)
    raise failures[0]


def solve_norm(
    problem: LeastSquares, margin: float, lyapunov_matrix: Array | None = None, tolerance: float = 1e-6
) -> Solution:
    """As `solve`, of eq. (7) as it is printed, un-squared: mean |f - xdot|, by weighting the squares anew each round.

    The weights are 1/max(|f - xdot|, 1 % of the rms speed), of the round before: every round minimises an upper bound
    that touches the loss where it is, so that the loss never rises (Weiszfeld; K. Lange, MM Optimization Algorithms,
    2016). A ridge keeps the weight that it has beside residuals as large as the rms speed. Rounds end when one lowers
    the loss by less than 1e-5 of it, at the latest after 60. `problem.rows` must be known.
    """
    rms = math.sqrt(problem.mean_square_speed)
    solution = solve(problem, margin, lyapunov_matrix, tolerance)
    iterations, refinements, descent = solution.iterations, solution.refinements, []
    while True:
        again, mean, bound = reweighted(problem, solution.matrices, _FLOOR * rms)
        ridge = 0.0
        if problem.ridge is not None:
            distances = ((solution.matrices - problem.ridge.centres) ** 2).sum(axis=(1, 2))
            ridge = float(problem.ridge.weights @ distances) / (2.0 * rms)
        descent.append((bound + ridge) / rms)
        if len(descent) > 1 and (descent[-2] - descent[-1] <= _CHANGE * descent[-1] or len(descent) > _ROUNDS):
            break
        solution = solve(again, margin, lyapunov_matrix, tolerance)
        iterations += solution.iterations
        refinements += solution.refinements
        # By how much a change of the weighted squares changes the loss, in the units of both.
        unit = again.mean_square_speed / (2.0 * rms**2)
    return replace(
        solution,
        multipliers=unit * solution.multipliers,
        iterations=iterations,
        refinements=refinements,
        objective=mean,
        value=descent[-1],
        descent=tuple(descent),
    )


def _overlaps(gram: Array) -> bool:
    """Whether a Gram matrix is so badly conditioned that what it says of the difference of components is rounding."""
    factor, failed = lapack.dpotrf(gram)
    if failed:
        return True
    condition, _ = lapack.dpocon(factor, float(np.abs(gram).sum(axis=0).max()))
    return bool(condition < _SMALLEST_CONDITION)


def _attempt(problem: LeastSquares, scaled: Scaled, form: Form, loose: bool, tolerance: float) -> Solution:
    """Solve the program in one form, and recompute how good the answer is. Raises SolverError as `solve` does."""
    d, K = problem.dimension, problem.components
    if form == "gram":
        answer = _minimised(scaled, loose)
        B = answer.x.reshape(d, K * d)
        image = (scaled.gram @ answer.x).reshape(d, K * d) if problem.coupled else B @ scaled.gram
        linear = -2.0 * scaled.cross.ravel()
        slope = (2.0 * image).ravel() + linear
        value = scaled.constant + float(answer.x @ linear) + float((image * B).sum())
    else:
        factor, target, rest = unsquared(problem, scaled)
        answer = sharpen(scaled.gram, scaled.cross, scaled.limits, minimise_unsquared(factor, target, scaled.limits))
        left = factor @ answer.x.reshape(target.T.shape).T - target
        linear = (-2.0 * target.T @ factor).ravel()
        slope = (2.0 * left.T @ factor).ravel()
        value = rest + float((left**2).sum())
    residuals = _residuals(scaled, answer, slope, linear)
    _accept(answer, residuals, tolerance)
    return Solution(
        matrices=scaled.rate * scaled.matrices(answer.x),
        multipliers=whole(answer.z * (scaled.share / (scaled.rate * scaled.stiffness))[:, None], d),
        status=answer.status,
        form=form,
        iterations=answer.iterations,
        refinements=answer.refinements,
        objective=max(0.0, value - scaled.excess(answer.x)) * problem.mean_square_speed,
        value=value,
        residuals=residuals,
    )


def _minimised(scaled: Scaled, loose: bool) -> Answer:
    """Return the answer in Gram form: a loose one, sharpened unless that will do; where it fails, the solver's best."""
    gram, cross, limits = scaled.gram, scaled.cross, scaled.limits
    answer = minimise_gram(gram, cross, limits, loose=True)
    if not loose:
        answer = sharpen(gram, cross, limits, answer)
        if not answer.refinements:
            answer = sharpen(gram, cross, limits, minimise_gram(gram, cross, limits, loose=False))
    return answer


def _residuals(scaled: Scaled, answer: Answer, slope: Array, linear: Array) -> dict[str, float]:
    """Return how far an answer is from optimal; `slope` is the gradient of what is minimised, `linear` that at 0."""
    K, d = len(scaled.share), scaled.limits.derivatives.shape[1]
    B = answer.x.reshape(d, K, d)
    left = slack(scaled.limits, B)
    stationarity = slope + pull(scaled.limits, answer.z).ravel()
    infeasible, negative = _shortfalls(np.stack([left / scaled.share[:, None], answer.z]), d)
    return {
        "feasibility": infeasible / max(1.0, float(np.abs(scaled.matrices(answer.x)).max())),
        "stationarity": float(np.abs(stationarity).max()) / max(1.0, float(np.abs(linear).max())),
        "dual": negative,
        "gap": abs(float((left * answer.z).sum())),
    }


def _shortfalls(halves: Array, d: int) -> list[float]:
    """Return by how much the smallest eigenvalue of each row of symmetric matrices is below 0; 0: by nothing."""
    if not np.isfinite(halves).all():
        return [math.inf] * len(halves)
    return [max(0.0, -float(values.min())) for values in np.linalg.eigvalsh(whole(halves, d))]


def _accept(answer: Answer, residuals: dict[str, float], tolerance: float) -> None:
    """Raise SolverError unless the solver says ``Solved`` and every residual is within the tolerance."""
    if answer.status != SOLVED:
        raise SolverError(
            f"The program of the LPV-DS was not solved: the solver says {answer.status} after {answer.iterations} "
            "iterations; a smaller dynamics.margin, fewer mixture components or smoother velocities may help.",
            answer.status,
            residuals,
        )
    for name, value in residuals.items():
        if not value <= tolerance:
            raise SolverError(
                f"The answer of the LPV-DS program is not accurate enough: its residual '{name}' is {value:.2g}, "
                f"more than dynamics.tolerance = {tolerance:g}.",
                answer.status,
                residuals,
            )


def _program(problem: LeastSquares, margin: float, P: Array, tolerance: float, loose: bool) -> dict[str, Any]:
    """Return all that `solve` was given, by name; the samples as their triangle."""
    program: dict[str, Any] = {
        "gram": problem.gram,
        "cross": problem.cross,
        "mean_square_distance": problem.mean_square_distance,
        "mean_square_speed": problem.mean_square_speed,
        "margin": margin,
        "lyapunov_matrix": P,
        "tolerance": tolerance,
        "loose": loose,
    }
    if problem.ridge is not None:
        program |= {"ridge_weights": problem.ridge.weights, "ridge_centres": problem.ridge.centres}
    if problem.triangle is not None:
        program |= dict(zip(("factor", "target", "rest"), problem.triangle, strict=True))
    return program
