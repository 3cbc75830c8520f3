"""What a row on a departure from the print is made of. Declarations only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

X_DOT = "x\u0307"


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """One row: where in the paper, what is printed, what runs here, why."""

    where: str
    printed: str
    here: str
    why: str


@dataclass(frozen=True, kw_only=True)
class Strayed:
    """How far the pads' midpoint was from where it would have been, after a push under eq. (14) as printed.

    Attributes:
        let_go: when the arm was let go, metres.
        end: when the box was carried no longer, metres.
        outcome: how the roll-out ended.
    """

    let_go: float
    end: float
    outcome: str


@dataclass(frozen=True, kw_only=True)
class Resolved:
    """What one motion made of the parameters of its controllers, and what came of what is printed.

    Attributes:
        top_speed: of the demonstrations, m/s.
        couplings: label of each coupled controller -> `p_max` (1/s), `k_c` (1/m), `gate` (m), `v_max` (m/s).
        strayed: one of each push under eq. (14) as printed.
    """

    top_speed: float
    couplings: Mapping[str, Mapping[str, float]]
    strayed: tuple[Strayed, ...] = ()
