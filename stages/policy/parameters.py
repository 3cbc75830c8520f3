"""What can be set about how two arms press on a box, and how they follow each other."""

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


@parameters
class FollowingParameters:
    """How two arms follow each other when one is pushed, eqs. (12)-(14). The paper gives no values.

    Attributes:
        deviation_threshold: delta of eq. (14), metres: an arm that is farther than this from where it would be if
            nobody touched it is pushed. As printed: of the midpoint.
        gate: x waits while an arm is farther off than twice this, and until it is within it again, metres: eq. (12) for
            arms that lag and sag.
        return_speed: at which a pushed arm is led back, m/s.
        return_acceleration: with which this begins and ends, m/s^2.
        lead: how far ahead of where it is a pushed arm stays commanded, metres: what pulls it back.
        yielding: seconds in which a pushed arm gives way to the rest: a push that lasts meets a damper.
        blend: seconds in which a switch of eq. (14) is blended out.
        lag: rate of the arms' inner loop, 1/s, taken for critically damped: what an arm trails behind its commands.
    """

    deviation_threshold: Positive = 0.006
    gate: Positive = 0.0015
    return_speed: Positive = 0.1
    return_acceleration: Positive = 0.3
    lead: Positive = 0.003
    yielding: Positive = 0.15
    blend: Positive = 0.05
    lag: Positive = 20.0
