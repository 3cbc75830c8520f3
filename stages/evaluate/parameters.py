"""Parameters of the evaluate stage."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge

from pipeline.stage import parameters


@parameters
class EvaluateParameters:
    """How executed paths are compared with demonstrations.

    Attributes:
        samples: samples of both paths, uniform in time, before they are compared; equal sampling for every case.
    """

    samples: Annotated[int, Ge(10)] = 1000
