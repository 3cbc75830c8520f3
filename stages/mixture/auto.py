"""Several mixtures instead of one: PC-GMM and plain EM of a few sizes, for the dynamics stage to choose between.

No criterion of the mixture alone says which one makes the motion that follows its demonstrations best, and at equal K
neither way of fitting is always ahead. So all are handed on, each is learned on, and training roll-outs decide
(`stages/dynamics/choose.py`). Not here: the fits themselves (`pcgmm.py`, `em.py`).
"""

from __future__ import annotations

import numpy as np

from pipeline.errors import DataError
from stages.mixture.data import Indices
from stages.mixture.em import fit_em
from stages.mixture.fit import MixtureFit
from stages.mixture.parameters import AutoParameters, EmParameters, PcGmmParameters
from stages.mixture.pcgmm import fit_pcgmm
from stages.trajectory import Array


def fit_auto(
    position: Array, velocity: Array, lengths: Indices, parameters: AutoParameters, generator: np.random.Generator
) -> dict[str, MixtureFit]:
    """Fit all candidates; return them by name, ``pcgmm`` first, then ``em-<K>``. Paper eq. (5), ref. [32].

    `position`: shape (n, d), metres. `velocity`: shape (n, d), m/s. `lengths`: shape (m,), samples of each
    demonstration, in order. `generator`: will be advanced. An EM candidate that the data do not have enough different
    points for is left out.

    Raises DataError: see `fit_pcgmm`.
    """
    sampled = PcGmmParameters(points=parameters.points, sweeps=parameters.sweeps)
    found = {"pcgmm": fit_pcgmm(position, velocity, lengths, sampled, generator)}
    for components in parameters.components:
        plain = EmParameters(components=components, restarts=parameters.restarts, points=parameters.points)
        try:
            found[f"em-{components}"] = fit_em(position, velocity, lengths, plain, generator)
        except DataError:  # fewer different points than components: PC-GMM has accepted the same data
            continue
    return found
