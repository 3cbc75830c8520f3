"""Parameters of the mixture stage, one class a way of fitting."""

from __future__ import annotations

from typing import Literal

from pipeline.stage import Count, Positive, Whole, parameters


@parameters
class PcGmmParameters:
    """Physically consistent mixture, ref. [32]: links between similar points are sampled, and components follow.

    Attributes:
        alpha: weight of a self-link (concentration); larger: more components.
        length_scale: width of the similarity in position, as a fraction of the data's rms radius.
        kappa: prior strength of the mean, in points.
        sweeps: Gibbs sweeps over all sampled points; the one of highest posterior is kept.
        points: points that are sampled (spread evenly by arc length over all demonstrations); all points polish.
        polish: most EM iterations, on all points, after sampling.
        variance_floor: smallest variance in any direction, as a fraction of the squared rms radius.
    """

    kind: Literal["pcgmm"] = "pcgmm"
    alpha: Positive = 2.0
    length_scale: Positive = 0.15
    kappa: Positive = 1.0
    sweeps: Count = 40
    points: Count = 300
    polish: Whole = 20
    variance_floor: Positive = 1e-4


@parameters
class EmParameters:
    """Plain expectation maximisation, position only.

    Attributes:
        components: number of components; none: chosen by the Bayesian information criterion.
        max_components: the most that the criterion may choose.
        restarts: k-means starts for each number of components; the likeliest is kept.
        iterations: most EM iterations.
        points: points that are fitted (spread evenly by arc length); none: all, which makes the criterion, which takes
            them for independent, choose about 15 components.
        variance_floor: smallest variance in any direction, as a fraction of the squared rms radius.
    """

    kind: Literal["em"] = "em"
    components: Count | None = None
    max_components: Count = 15
    restarts: Count = 3
    iterations: Count = 100
    points: Count | None = 300
    variance_floor: Positive = 1e-4


MixtureParameters = PcGmmParameters | EmParameters
