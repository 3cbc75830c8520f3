"""The public face of clpv in Python: `load` a fitted policy, `fit` one from arrays, step it with a `controller`.

::

    import clpv

    policy = clpv.load("quickstart")
    velocity = policy.velocity([[-0.040, -0.003]])          # m -> m/s

    policy = clpv.fit([demonstration_a, demonstration_b], dt=0.01)
    next_state = policy.step([[0.1, 0.2]], dt=0.01)

    ball = {"kind": "sphere", "centre": [0.05, 0.1], "radius": 0.02}
    robot = clpv.controller(policy, [0.1, 0.2], dt=0.004, obstacles=[ball])
    command = robot.step(measured)                          # coupled, clear of obstacles; robot.status: what it did
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from stages.dynamics.lpvds import LpvDs
    from stages.policy.controller import Controller

__all__ = ["controller", "fit", "load"]

LONGEST = 100_000
"""Steps after which a policy's own way is no longer followed to learn its top speed."""


def load(name: str, *, point: str | None = None, root: str | Path | None = None) -> LpvDs:
    """The fitted dynamical system of an experiment that has been run.

    Arguments:
        name: of the experiment, a folder below ``runs``.
        point: of a sweep, e.g. ``motion=Angle``; not needed where there is only one.
        root: the project's folder; default: the nearest one upward from the current folder that holds ``runs``.

    Raises UsageError where there is no such experiment or point, StaleError where it has not been run.
    """
    from pipeline.cli import root_folder
    from pipeline.compiled import use_cache_for
    from pipeline.errors import UsageError, choices
    from pipeline.project import Project
    from stages import STAGES

    project = Project.open(root_folder() if root is None else Path(root), STAGES)
    experiment = project.experiment(name)
    dynamics = dict((p.id, files) for p, files in project.artifacts(experiment, "dynamics"))
    if point is None and len(dynamics) > 1:
        raise UsageError(f"{name} is a sweep: say which point. Valid: {', '.join(dynamics)}.")
    chosen = next(iter(dynamics)) if point is None else point
    if chosen not in dynamics:
        raise UsageError(f"{name} has no point {chosen!r}; {choices(chosen, dynamics)}")
    use_cache_for("stages")
    from stages.artifacts.dynamics import read_dynamics

    return read_dynamics(dynamics[chosen]["dynamics"])


def fit(
    demonstrations: Sequence[ArrayLike],
    *,
    dt: float | Sequence[float],
    seed: int = 0,
    **tables: Mapping[str, Any],
) -> LpvDs:
    """Fit a certified dynamical system to demonstrations of one point.

    Arguments:
        demonstrations: at least two arrays, shape (n_i, d), metres, d = 2 or 3, sampled uniformly in time.
        dt: sampling period, seconds; one for all or one each.
        seed: of the mixture's sampler.
        tables: ``midpoint``, ``mixture`` and ``dynamics``, each a dictionary as in an experiment file, e.g.
            ``midpoint={"goal": [0.0, 0.0]}``; the goal is the mean end point unless it is given.

    Raises ParameterError, DataError, SolverError.
    """
    import numpy as np

    from pipeline.compiled import use_cache_for
    from pipeline.errors import DataError, ParameterError, choices
    from pipeline.project import Project
    from pipeline.stage import StageContext
    from pipeline.validation import validate
    from stages import STAGES

    use_cache_for("stages")
    from stages.midpoint.midpoint import to_trajectories
    from stages.mixture.stage import by_name
    from stages.trajectory import ArmRecording, Demonstration

    stages = {stage.name: stage for stage in Project.open(Path(), STAGES).stages.values()}
    used = ("midpoint", "mixture", "dynamics")
    for name in tables:
        if name not in used:
            raise ParameterError(name, f"there is no such table; {choices(name, used)}")
    chosen = {
        name: validate(stages[name], {**stages[name].presets.get("robust", {}), **tables.get(name, {})})
        for name in used
    }
    given = np.asarray(dt, dtype=np.float64)
    periods = (np.full(len(demonstrations), given) if given.ndim == 0 else given).tolist()
    if len(periods) != len(demonstrations):
        raise ParameterError("dt", f"{len(periods)} periods were given for {len(demonstrations)} demonstrations.")
    recorded = []
    for number, (positions, period) in enumerate(zip(demonstrations, periods, strict=True), start=1):
        try:
            array = np.asarray(positions, dtype=np.float64)
        except (TypeError, ValueError):
            raise DataError(f"arrays, demonstration {number}", "must be numbers in the shape (n, d).") from None
        if array.ndim != 2:
            raise DataError(f"arrays, demonstration {number}", f"must have the shape (n, d), not {array.shape}.")
        recording = ArmRecording(time=np.arange(array.shape[0], dtype=np.float64) * period, position=array)
        recorded.append(Demonstration(dataset="arrays", demo=str(number), split="train", arms={"point": recording}))
    found = to_trajectories(recorded, chosen["midpoint"])
    position = np.concatenate([t.position for t in found.trajectories])
    velocity = np.concatenate([t.velocity for t in found.trajectories])
    lengths = np.array([t.time.shape[0] for t in found.trajectories])
    context = StageContext(stage="mixture", parameters=chosen["mixture"], inputs={}, sources={}, outputs={}, seed=seed)
    cluster = stages["mixture"].implementation(chosen["mixture"].kind)
    fits = by_name(chosen["mixture"].kind, cluster(position, velocity, lengths, chosen["mixture"], context.generator()))
    mixtures = {name: candidate.mixture for name, candidate in fits.items()}
    learn = stages["dynamics"].implementation(chosen["dynamics"].kind)
    model: LpvDs = learn(found.trajectories, mixtures, found.goal, chosen["dynamics"]).model
    return model


def controller(
    policy: LpvDs,
    start: ArrayLike,
    *,
    dt: float,
    obstacles: Sequence[Mapping[str, Any]] = (),
    avoidance: Mapping[str, Any] | None = None,
    coupling: Mapping[str, Any] | None = None,
    top_speed: float | None = None,
) -> Controller:
    """A policy for a robot's control loop: coupled, eqs. (9)-(12), and clear of obstacles.

    Arguments:
        policy: from `load` or `fit`.
        start: where the motion begins, shape (d,), metres.
        dt: period of the loop, seconds.
        obstacles: tables as in an experiment file, e.g. ``{"kind": "sphere", "centre": [0.1, 0.2], "radius": 0.05}``.
        avoidance: a table as in an experiment file; default: ``{"kind": "roas+"}``.
        coupling: a controller's table; default: ``{"kind": "clpvds", "mode": "robust"}``.
        top_speed: of the demonstrations, m/s; default: that of the policy's own way from `start`.

    Raises ParameterError where a parameter has no meaning, DataError where the motion cannot begin.
    """
    from pipeline.compiled import use_cache_for
    from pipeline.errors import ParameterError
    from pipeline.validation import validate_as

    use_cache_for("stages")
    import numpy as np

    from stages.policy.avoidance.parameters import Avoidance, Obstacle
    from stages.policy.controller import Controller
    from stages.rollout.cases import runner_of
    from stages.rollout.parameters import Controller as Declared
    from stages.rollout.parameters import RolloutParameters

    try:
        begin = np.array(start, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError("start", "must be numbers in the shape (d,), metres.") from None
    if isinstance(obstacles, Mapping):
        raise ParameterError("obstacles", "must be a list of tables, one an obstacle.")
    if top_speed is None:
        top_speed = _top_speed(policy, begin, dt)
    if not 0.0 < top_speed < float("inf"):
        raise ParameterError("top_speed", f"must be a positive number, m/s, not {top_speed:g}.")
    method = validate_as(Avoidance, "avoidance", _table(avoidance, "roas+"))
    declared = validate_as(Declared, "coupling", _table(coupling, "clpvds"))
    runner = runner_of(declared, RolloutParameters(), top_speed, dt, "coupling")
    return Controller(
        policy,
        begin,
        dt=dt,
        coupling=runner.coupling,
        top_speed=top_speed,
        obstacles=[validate_as(Obstacle, f"obstacles.{number}", one) for number, one in enumerate(obstacles)],
        avoidance=method,
    )


def _table(given: Any, kind: str) -> Any:
    """What a caller gives, of this kind unless it says another."""
    return {"kind": kind, **({} if given is None else given)} if given is None or isinstance(given, Mapping) else given


def _top_speed(policy: LpvDs, start: Any, dt: float) -> float:
    """The top speed of a policy's own way from `start`, shape (d,), metres, m/s."""
    import numpy as np

    from pipeline.errors import ParameterError

    if start.shape != (policy.dimension,) or not np.isfinite(start).all() or not 0.0 < dt < np.inf:
        return 1.0  # refused with a better sentence where the controller is made
    state, top = start[None], 0.0
    for _ in range(LONGEST):
        following = policy.step(state, dt)
        speed = float(np.linalg.norm(following - state)) / dt
        top, state = max(top, speed), following
        if speed <= 1e-3 * top:
            break
    if top == 0.0:
        raise ParameterError("top_speed", "the policy does not move from this start: give the demonstrations', m/s.")
    return top
