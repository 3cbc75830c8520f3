"""What a fitted mixture is returned with, whichever way it was fitted. Data only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stages.mixture.gaussian import GaussianMixture
from stages.mixture.spread import ChainSpread, chain_spread
from stages.trajectory import Array, frozen

Indices = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class MixtureFit:
    """A fitted mixture of eq. (5), and how it came about.

    Attributes:
        mixture: in metres; components in the order in which the demonstrations first meet them.
        sampled: array, shape (s,), which samples of the training data were clustered.
        labels: array, shape (s,), the component of each of them: the sampler's, before polishing, or the likeliest.
        log_posterior: array, shape (chains, sweeps), of the sampler's state after each sweep; EM, in one row: the log
            likelihood of the points before each iteration and after the last.
        components_by_sweep: array, shape (chains, sweeps), number of components after each sweep; EM: constant.
        criterion: Bayesian information criterion by number of components, where it was used to choose; lowest is best.
    """

    mixture: GaussianMixture
    sampled: Indices
    labels: Indices
    log_posterior: Array
    components_by_sweep: Indices
    criterion: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "log_posterior", frozen(self.log_posterior))
        for name in ("sampled", "labels", "components_by_sweep"):
            values = np.array(getattr(self, name), dtype=np.int64)
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    @property
    def spread(self) -> ChainSpread:
        """How far the sampler's chains agree; of no meaning for EM, whose likelihood climbs by itself."""
        return chain_spread(self.log_posterior, self.components_by_sweep)
