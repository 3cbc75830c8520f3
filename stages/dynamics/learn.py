"""One candidate system, learned: features, least squares with guides and a ridge, P, A_k. Paper eqs. (6)-(8).

A recipe says what a candidate is made of: a mixture, a warp, how much guides count. Every kind of dynamics that learns
its Lyapunov function is a list of recipes. Not here: which of them is taken (`choose.py`), or the program (`program/`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stages.compiled import compiled
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.program.regression import LeastSquares, combined, gather, with_ridge
from stages.dynamics.program.solve import Solution, solve
from stages.dynamics.samples import Frame, Samples
from stages.dynamics.search import Found, search
from stages.dynamics.warp import Warp
from stages.mixture.gaussian import GaussianMixture, responsibilities_at, whitening
from stages.trajectory import Array

# A guide where a direction is compressed to less than this would ask for a velocity that only the warp makes.
_COMPRESSED = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Recipe:
    """What distinguishes one candidate from another.

    Attributes:
        mixture: name of the mixture.
        gaussians: the mixture that gates the components, already smoothed, of metres.
        warp: psi.
        share: how far the warp straightens the mean demonstration, 0 to 1.
        guidance: weight of the guides, relative to that of the samples.
    """

    mixture: str
    gaussians: GaussianMixture
    warp: Warp
    share: float
    guidance: float


@dataclass(frozen=True, kw_only=True)
class Learning:
    """How a candidate is learned.

    Attributes:
        margin: A_k'P + P A_k <= -margin I, 1/s.
        condition: largest condition of P; 1: P = I.
        ridge: weight of |A_k + c_k I|^2, c_k the component's own rate, relative to its own Gram matrix.
        width, decay: of the guides, as fractions of the motion's size.
        speed_limit: of the system, m/s.
        tolerance: largest residual accepted of the solver.
    """

    margin: float
    condition: float
    ridge: float
    width: float
    decay: float
    speed_limit: float
    tolerance: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """The least squares of one demonstration, or of several pooled.

    Attributes:
        samples: number of samples behind `own`.
        own: of the samples.
        guides: of the guides; none: they do not count.
    """

    samples: int
    own: LeastSquares
    guides: LeastSquares | None


def smoothed(mixture: GaussianMixture, widening: float, blur: float) -> GaussianMixture:
    """Return a mixture with covariances `widening` Sigma_k + blur^2 I, so that its components hand over smoothly.

    `blur`: metres.
    """
    covariances = widening * mixture.covariances + blur**2 * np.eye(mixture.dimension)
    return replace(mixture, covariances=covariances)


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """Samples as a warp sees them; the same for every mixture.

    Attributes:
        samples: states and velocities.
        image: array, shape (n, d), psi, metres.
        inverse_jacobian: array, shape (n, d, d); none: the warp is the identity.
    """

    samples: Samples
    image: Array
    inverse_jacobian: Array | None


def place(warp: Warp, goal: Array, samples: Samples, *, guides: bool = False) -> Placed:
    """Place samples about the goal, shape (d,), metres; guides without those where a direction is compressed."""
    z = samples.position - goal
    if not warp.count or not len(z):
        return Placed(samples=samples, image=z, inverse_jacobian=None)
    image, jacobian = warp.apply(z)
    if guides:
        kept = np.linalg.svd(jacobian, compute_uv=False)[:, -1] >= _COMPRESSED
        samples = Samples(position=samples.position[kept], velocity=samples.velocity[kept])
        image, jacobian = image[kept], jacobian[kept]
    return Placed(samples=samples, image=image, inverse_jacobian=np.asarray(np.linalg.inv(jacobian)))


def data_of(recipe: Recipe, own: Placed, guides: Placed) -> Data:
    """Gather the least squares of a recipe from one demonstration, placed by its warp. Paper eq. (7)."""
    beside = recipe.guidance > 0.0 and len(guides.image) > 0
    return Data(
        samples=len(own.image),
        own=_gathered(recipe.gaussians, own),
        guides=_gathered(recipe.gaussians, guides) if beside else None,
    )


def pooled(parts: Sequence[Data]) -> Data:
    """Return the least squares of all parts together; every sample counts alike."""
    total = sum(part.samples for part in parts)
    weights = [part.samples / total for part in parts]
    beside = [(weight, part.guides) for weight, part in zip(weights, parts, strict=True) if part.guides is not None]
    return Data(
        samples=total,
        own=combined([(weight, part.own) for weight, part in zip(weights, parts, strict=True)]),
        guides=combined(beside) if beside else None,
    )


def regularised(recipe: Recipe, data: Data, learning: Learning) -> LeastSquares:
    """Return the problem that a recipe solves: samples, guides by their weight, and the ridge."""
    problem = data.own if data.guides is None else combined([(1.0, data.own), (recipe.guidance, data.guides)])
    return with_ridge(problem, learning.ridge) if learning.ridge > 0.0 else problem


def find(problem: LeastSquares, learning: Learning, frame: Frame, start: Array | None = None) -> Found:
    """Learn P and, loosely, A_k. Paper eqs. (7), (8). `start`: P, shape (d, d), to descend from."""
    return search(problem, learning.margin, frame.axes, learning.condition, start)


def refine(problem: LeastSquares, learning: Learning, lyapunov_matrix: Array, *, loose: bool = False) -> Solution:
    """Learn A_k for a given P, shape (d, d); `loose`: well enough to compare. Paper eqs. (7), (8)."""
    return solve(problem, learning.margin, lyapunov_matrix, tolerance=learning.tolerance, loose=loose)


def system(recipe: Recipe, goal: Array, matrices: Array, lyapunov_matrix: Array, learning: Learning) -> LpvDs:
    """Put a candidate together: A_k, shape (K, d, d), 1/s, and P, shape (d, d)."""
    return LpvDs(
        mixture=recipe.gaussians,
        matrices=matrices,
        goal=goal,
        lyapunov_matrix=lyapunov_matrix,
        warp=recipe.warp if recipe.warp.count else None,
        speed_limit=learning.speed_limit,
    )


def _gathered(mixture: GaussianMixture, placed: Placed) -> LeastSquares:
    n, d = placed.image.shape
    K = mixture.components
    phi = np.empty((n, K * d))
    write_features(placed.samples.position, placed.image, *whitening(mixture), np.empty(K), phi)
    return gather(phi, placed.samples.velocity, inverse_jacobian=placed.inverse_jacobian)


@compiled
def write_features(
    x: Array, image: Array, offsets: Array, means: Array, whiteners: Array, gamma: Array, phi: Array
) -> None:
    """Write gamma_k psi, shape (n, K d), metres, into `phi`. Paper eq. (6).

    `x`: states, shape (n, d), metres. `image`: psi there, shape (n, d), metres. `offsets`, `means`, `whiteners`: as of
    `stages.mixture.gaussian.Whitening`. `gamma`, shape (K,): scratch.
    """
    n, d = x.shape
    for t in range(n):
        responsibilities_at(x[t], offsets, means, whiteners, gamma)
        for k in range(gamma.shape[0]):
            for i in range(d):
                phi[t, k * d + i] = gamma[k] * image[t, i]
