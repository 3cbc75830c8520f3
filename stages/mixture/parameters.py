"""Parameters of the mixture stage, one class a way of fitting."""

from __future__ import annotations

from typing import Literal

from pipeline.stage import Count, Positive, Whole, parameters


@parameters
class PcGmmParameters:
    """Physically consistent mixture, ref. [32]: links between similar points are sampled, and components follow.

    Attributes:
        alpha: weight of a self-link (concentration); larger: more components.
        length_scale: width of the similarity in position, as a fraction of the data's rms radius; 1e-6 to 1e6.
        kappa: prior strength of the mean, in points.
        sweeps: Gibbs sweeps of a chain over all sampled points; the one of highest posterior is kept.
        chains: independent chains, by turns from every point alone and from all points together; the most probable
            sweep of all is kept, and how far they agree is reported. The first is the same however many follow.
        points: points that are sampled (spread evenly by arc length over all demonstrations); all points polish.
        polish: most EM iterations, on all points, after sampling.
        variance_floor: smallest variance in any direction, as a fraction of the squared rms radius; at least 1e-10.
    """

    kind: Literal["pcgmm"] = "pcgmm"
    alpha: Positive = 2.0
    length_scale: Positive = 0.15
    kappa: Positive = 1.0
    sweeps: Count = 40
    chains: Count = 1
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
        variance_floor: smallest variance in any direction, as a fraction of the squared rms radius; at least 1e-10.
    """

    kind: Literal["em"] = "em"
    components: Count | None = None
    max_components: Count = 15
    restarts: Count = 3
    iterations: Count = 100
    points: Count | None = 300
    variance_floor: Positive = 1e-4


@parameters
class AutoParameters:
    """Several candidates, PC-GMM and plain EM, between which the dynamics stage chooses by training roll-outs.

    Attributes:
        components: numbers of components of the EM candidates.
        restarts: k-means starts of each EM candidate; the likeliest is kept.
        points: points that each is fitted to (spread evenly by arc length over all demonstrations).
        sweeps: Gibbs sweeps of PC-GMM.
    """

    kind: Literal["auto"] = "auto"
    components: tuple[Count, ...] = (10,)
    restarts: Count = 1
    points: Count = 180
    sweeps: Count = 40


MixtureParameters = PcGmmParameters | EmParameters | AutoParameters
