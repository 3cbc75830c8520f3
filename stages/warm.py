"""Compile what the stages need, once, before workers are started: each function runs its stage's mathematics on a toy.

Each is given the parameters of all points that are to be run. Only types matter to the compiler, so four points in the
plane are enough. Nothing here is part of a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from stages.dynamics.lpvds import LpvDs
    from stages.trajectory import Trajectory


@cache
def _toy() -> tuple[Trajectory, LpvDs]:
    """A short motion to the origin, and a system learned from it."""
    from stages.dynamics import qlf, warped
    from stages.dynamics.parameters import QlfParameters, WarpedParameters
    from stages.mixture.parameters import PcGmmParameters
    from stages.mixture.pcgmm import fit_pcgmm
    from stages.trajectory import Trajectory

    time = np.linspace(0.0, 1.0, 24)
    position = np.column_stack([1.0 - time, (1.0 - time) ** 2])
    velocity = np.column_stack([-np.ones_like(time), -2.0 * (1.0 - time)])
    parameters = PcGmmParameters(sweeps=2, points=16, polish=2)
    found = {"toy": fit_pcgmm(position, velocity, np.array([12, 12]), parameters, np.random.default_rng(0)).mixture}
    trajectory = Trajectory(dataset="toy", demo="1", split="train", time=time, position=position, velocity=velocity)
    qlf.fit([trajectory], found, np.zeros(2), QlfParameters())
    model = warped.fit(
        [trajectory], found, np.zeros(2), WarpedParameters(straightening=(0.0, 0.5), translations=2)
    ).model
    return trajectory, model


def mixture(chosen: Sequence[Any]) -> None:
    """Compile the sampler and the polishing."""
    _toy()


def dynamics(chosen: Sequence[Any]) -> None:
    """Compile the regression, the densities, the warp and the roll-outs that choose."""
    _toy()


def rollout(chosen: Sequence[Any]) -> None:
    """Compile the roll-out loop; with all that avoids obstacles only where there are any, as this takes a while.

    For the simulated world, what steps policy and arms there.
    """
    if any(parameters.kind == "bullet" for parameters in chosen):
        _arms()
    chosen = [parameters for parameters in chosen if parameters.kind == "kinematic"]
    if not chosen:
        return
    from stages.policy.avoidance.parameters import Sphere
    from stages.rollout.parameters import Condition, RolloutParameters
    from stages.rollout.simulate import simulate

    conditions = [Condition()]
    if any(c.obstacles or c.scenes for parameters in chosen for c in parameters.conditions):
        conditions.append(Condition(name="obstacle", obstacles=(Sphere(centre=(5.0, 5.0), radius=1.0),)))
    trajectory, model = _toy()
    simulate(model, [trajectory], RolloutParameters(starts="train", conditions=tuple(conditions)), 1.0)


def _arms() -> None:
    """One cycle of a policy, the admittance and the kinematics of an arm."""
    from stages.policy.admittance import Admittance, begin, comply, sense
    from stages.policy.controller import Controller
    from stages.policy.coupling import robust_coupling
    from stages.world.chain import reach
    from stages.world.following import track
    from stages.world.robots import arm

    trajectory, model = _toy()
    coupling = robust_coupling(v_max=1.0, top_speed=1.0, location="toy").compiled
    start = trajectory.position[0]
    Controller(model, start, dt=0.01, coupling=coupling, top_speed=1.0).step(start)
    admittance, state = Admittance(20.0, 2000.0, 25.0, 2.0, 5.0, False, 2.0, 10.0), np.zeros((2, 4))
    sense(admittance, np.zeros(2), 0.01, state)
    begin(admittance, state)
    comply(admittance, 0.01, state)
    one = arm("iiwa", True, "toy")
    q, at, turn = np.array(one.posture), np.array([0.5, 0.2, 0.5]), np.eye(3)
    reach(one.chain, q, at, turn, 1, 1.0)
    track(
        one.chain, q, q.copy(), at, at, turn, np.ones_like(q), np.zeros((0, 4)), 0.0, np.zeros_like(q), np.zeros_like(q)
    )


def evaluate(chosen: Sequence[Any]) -> None:
    """Compile the metrics."""
    from stages.evaluate.compare import compare

    trajectory, _ = _toy()
    n = trajectory.time.shape[0]
    compare(
        time=trajectory.time,
        x=trajectory.position,
        executed=trajectory.position,
        gate=np.ones(n, dtype=np.bool_),
        lyapunov=np.zeros(n),
        clearance=np.full(n, np.nan),
        status=np.full(n, "free", dtype=object),
        disturbed=(),
        outcome="arrived",
        reference=trajectory,
        goal=np.zeros(2),
        samples=16,
    )
