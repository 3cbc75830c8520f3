"""Parameters of the dynamics stage, one class a kind of Lyapunov function."""

from __future__ import annotations

from typing import Literal

from pipeline.stage import Positive, parameters


@parameters
class QlfParameters:
    """LPV-DS under the paper's quadratic Lyapunov function, V = |x - x_g|^2: eqs. (6)-(8).

    Attributes:
        margin: A_k + A_k' <= -margin I, 1/s. 1e-3 costs no accuracy; 0 is not strict.
        tolerance: largest relative residual accepted of the solver.
    """

    kind: Literal["qlf"] = "qlf"
    margin: Positive = 1e-3
    tolerance: Positive = 1e-6
