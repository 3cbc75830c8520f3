"""The kinematic world: the executed state goes exactly where the policy commands, and can be pushed. Paper Fig. 3.

No robot, no mass, no contact; a disturbance is a displacement added to the executed state. Not a policy: what is
commanded is decided in `stages/policy`.
"""

from __future__ import annotations

from stages.compiled import compiled
from stages.trajectory import Array


@compiled
def displace(executed: Array, displacement: Array) -> None:
    """Push the executed state by `displacement`: arrays, shape (d,), metres; `executed` is modified."""
    for i in range(executed.shape[0]):
        executed[i] += displacement[i]


@compiled
def carry_out(executed: Array, commanded: Array) -> None:
    """Make the executed state what was commanded: arrays, shape (d,), metres; `executed` is modified."""
    for i in range(executed.shape[0]):
        executed[i] = commanded[i]
