"""What can be set about how two arms press on a box."""

from __future__ import annotations

from pipeline.stage import NonNegative, Positive, parameters


@parameters
class AdmittanceParameters:
    """How hard the arms press, eqs. (15)-(18); the paper gives k_p, k_d and the force.

    Attributes:
        force: F_d, the desired contact force, newtons. Paper: 5.
        k_p: eq. (16). Paper: 25.
        k_d: eq. (16), seconds. Paper: 2.
        mass: M, virtual, kg.
        damping: D, virtual, N s/m.
        cutoff: of the low-pass on the measured force, Hz.
        leak: of the offset that both arms share, 1/s. Only in robust mode.
    """

    force: Positive = 5.0
    k_p: Positive = 25.0
    k_d: NonNegative = 2.0
    mass: Positive = 20.0
    damping: Positive = 2000.0
    cutoff: Positive = 10.0
    leak: NonNegative = 2.0
