"""The public face of clpv in Python: `load` a fitted policy of an experiment, or `fit` one from arrays.

::

    import clpv

    policy = clpv.load("quickstart")
    velocity = policy.velocity([[-0.040, -0.003]])          # m -> m/s

    policy = clpv.fit([demonstration_a, demonstration_b], dt=0.01)
    next_state = policy.step([[0.1, 0.2]], dt=0.01)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from stages.dynamics.lpvds import LpvDs

__all__ = ["fit", "load"]


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
