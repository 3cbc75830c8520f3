"""The report's section of the mixture: how it was found, and what the system was chosen from. Paper eq. (5), ref. [32].

Results in, a section out. How it is drawn: `sampler.py`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.report import Figure, Panel, Section
from stages.evaluate.summary import mean
from stages.figures.candidates import candidates
from stages.figures.numbers import number, span
from stages.figures.results import Results
from stages.figures.sampler import sampler_panels
from stages.mixture.spread import chain_spread
from stages.trajectory import Array

MIXED = 1.1
"""R-hat above which chains have by custom not mixed (Gelman et al., Bayesian Data Analysis, 3rd ed., sec. 11.4)."""


def chains_text(log_posterior: Array, components: NDArray[np.int64]) -> str:
    """How long the sampler's chains took to settle, and how far they agree.

    `log_posterior`, `components`: arrays, shape (chains, sweeps), after each sweep.
    """
    spread = chain_spread(log_posterior, components)
    chains, sweeps = log_posterior.shape
    text = f"Burn-in: {spread.burn_in} of {sweeps} sweeps."
    if chains == 1:
        return text
    mixed = "" if spread.r_hat <= MIXED else f" (above {MIXED}: by custom not mixed)"
    text = f"{chains} chains. {text.removesuffix('.')} at most."
    if not math.isnan(spread.r_hat):
        text += f" R-hat of the log posterior: {number(spread.r_hat)}{mixed}."
    return (
        f"{text} Best log posterior of a chain: {span(spread.best.tolist(), 5)}; "
        f"components there: {span(spread.components.tolist())}."
    )


def sampler_section(results: Results) -> Section:
    """How the mixture of the shown point was found, and what its system was chosen from."""
    shown = results.shown
    name = shown.fit["mixture"]
    kind = "em" if name.startswith("em") else "pcgmm"
    drawn = sampler_panels(*shown.sampler, kind)
    words = ("what is maximised, step by step", "the number of components")
    panels = tuple(Panel(svg=svg, alt=f"Line: {what}.") for svg, what in zip(drawn, words, strict=False))
    caption = f"{shown.name}: {shown.model.mixture.components} components (`{name}`)."
    if results.is_sweep:
        counts = [point.model.mixture.components for point in results.points]
        caption += f" Over all {results.points_word}: {min(counts)} to {max(counts)}, mean {number(mean(counts))}."
    if kind == "pcgmm":
        caption += (
            f" The state of highest posterior is kept, then polished on all points. {chains_text(*shown.sampler[:2])}"
        )
    figure = Figure(panels=panels, caption=caption, columns=2)
    tried = candidates(results)
    return Section(
        id="sampler", title="How the mixture was found", blocks=(figure,) if tried is None else (figure, *tried)
    )
