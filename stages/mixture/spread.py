"""How far the sampler's chains agree: burn-in, the best state of each, and the potential scale reduction R-hat.

Diagnostics of PC-GMM, ref. [32], for reports; no result depends on them. Arrays in, numbers out. Not here: the sampler.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stages.trajectory import Array, frozen


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainSpread:
    """What the chains of one fit have in common.

    Attributes:
        burn_in: sweeps before the log posterior first is in the range that it has in the second half of its chain; of
            the chain that takes longest. Half of the sweeps: it may still be on its way.
        best: array, shape (chains,), highest log posterior of each chain.
        components: array, shape (chains,), number of tables in that state, before small ones are dissolved.
        r_hat: potential scale reduction of the log posterior over the second halves of the chains, each split in two,
            so that one chain has one too (Gelman & Rubin, Statistical Science 7, 1992; Gelman et al., Bayesian Data
            Analysis, 3rd ed., sec. 11.4): near 1 where they have mixed, above 1.1 by custom not; nan below 8 sweeps.
    """

    burn_in: int
    best: Array
    components: NDArray[np.int64]
    r_hat: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "best", frozen(self.best))
        components = np.array(self.components, dtype=np.int64)
        components.flags.writeable = False
        object.__setattr__(self, "components", components)


def chain_spread(log_posterior: Array, components: NDArray[np.int64]) -> ChainSpread:
    """Compare chains of equal length.

    `log_posterior`: shape (chains, sweeps), after each sweep. `components`: shape (chains, sweeps), number of tables.
    """
    best = log_posterior.argmax(axis=1)
    chains = np.arange(len(best))
    return ChainSpread(
        burn_in=max(_burn_in(chain) for chain in log_posterior),
        best=log_posterior[chains, best],
        components=components[chains, best],
        r_hat=r_hat(log_posterior[:, log_posterior.shape[1] // 2 :]),
    )


def _burn_in(chain: Array) -> int:
    """Return how many sweeps of one chain, shape (sweeps,), pass before it first is in the range of its second half."""
    half = chain[len(chain) // 2 :]
    return int(((half.min() <= chain) & (chain <= half.max())).argmax())


def r_hat(draws: Array) -> float:
    """Return the split potential scale reduction of draws, shape (chains, n), any unit; nan where n is below 4."""
    n = draws.shape[1] // 2
    if n < 2:
        return math.nan
    parts = np.concatenate((draws[:, :n], draws[:, -n:]))
    within = float(parts.var(axis=1, ddof=1).mean())
    between = float(parts.mean(axis=1).var(ddof=1))
    if within == 0.0:
        return 1.0 if between == 0.0 else math.inf
    return math.sqrt((n - 1) / n + between / within)
