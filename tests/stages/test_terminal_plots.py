"""What ``clpv show`` draws of every stage: small made artifacts in, plots that hold their numbers out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_boxes import GOAL, POT, box, scene

from pipeline import code
from pipeline.braille import Style
from pipeline.drawing import draw
from pipeline.plots import Bars, Plot, Series
from pipeline.stage import load
from stages import STAGES
from stages.artifacts.demonstrations import write_demonstrations
from stages.artifacts.dynamics import write_dynamics
from stages.artifacts.metrics import write_metrics
from stages.artifacts.midpoints import write_midpoints
from stages.artifacts.mixture import write_sampler
from stages.artifacts.rollouts import write_rollouts
from stages.dynamics.lpvds import LpvDs
from stages.figures import terminal
from stages.figures.terminal_rollouts import rollout as rollout_plots
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import GaussianMixture
from stages.policy.avoidance.shapes import spheres
from stages.policy.outcome import Outcome
from stages.trajectory import ArmRecording, Array, Demonstration, Trajectory, frozen

N = 30
TIME = 0.1 * np.arange(N)


def path(d: int = 2, offset: float = 0.01) -> Array:
    """From (-50 mm, 0, …) to the origin; with an arc of `offset`, metres, in the last coordinate."""
    found = np.zeros((N, d))
    found[:, 0] = np.linspace(-0.05, 0.0, N)
    found[:, -1] += offset * np.sin(np.linspace(0.0, np.pi, N))
    return found


def midpoints(folder: Path, d: int = 2, splits: Sequence[str] = ("train", "train", "test")) -> Path:
    trajectories = [
        Trajectory(
            dataset="made",
            demo=str(k + 1),
            split=split,
            time=TIME,
            position=path(d, 0.01 * (k + 1)),
            velocity=np.gradient(path(d, 0.01 * (k + 1)), TIME, axis=0),
        )
        for k, split in enumerate(splits)
    ]
    file = folder / "midpoints.parquet"
    write_midpoints(file, trajectories, frozen(np.zeros(d)), [None] * len(splits), {})
    return file


def mixture_of(d: int = 2) -> GaussianMixture:
    means = np.stack([path(d)[5], path(d)[25]])
    return GaussianMixture(weights=np.array([0.5, 0.5]), means=means, covariances=np.tile(1e-4 * np.eye(d), (2, 1, 1)))


def one(controller: str = "lpvds", condition: str = "none", demo: str = "3", **changes: Any) -> SimpleNamespace:
    """A roll-out of a point straight to the goal."""
    case = {
        "rollout": f"{controller}/{condition}/{demo}",
        "controller": controller,
        "mode": "robust",
        "avoidance": "none",
        "condition": condition,
        "dataset": "made",
        "demo": demo,
        "split": "test",
        "outcome": Outcome.ARRIVED,
        "scene": "",
        "disturbed": (),
        "time": TIME,
        "x": path(),
        "p_hat": path(),
        "gate": np.ones(N, dtype=bool),
        "lyapunov": np.zeros(N),
        "clearance": np.full(N, np.nan),
        "status": np.zeros(N, dtype=np.int8),
    }
    return SimpleNamespace(**case | changes)


def of_rollouts(folder: Path, rollouts: Sequence[Any], scenes: Sequence[Any] = (), d: int = 2) -> list[Any]:
    """What is drawn of roll-outs."""
    file = folder / "rollouts.parquet"
    goal = np.zeros(d) if d == 2 else GOAL
    write_rollouts(file, rollouts, scenes, frozen(goal), {})
    return drawable(rollout_plots({"rollouts": file, "midpoints": midpoints(folder, d)}))


def drawable(plots: Sequence[Plot | Bars]) -> list[Any]:
    """The plots, of which each gives a picture in braille and in plain characters, in narrow and wide terminals."""
    for width in (40, 80, 100):
        for braille in (True, False):
            for plot in plots:
                lines = draw([plot], Style(width=width, braille=braille))
                assert lines
                assert max(map(len, lines)) <= width
    return list(plots)


def named(plot: Plot) -> dict[str, Series]:
    return {series.name: series for series in plot.series}


def metrics(folder: Path, rows: Sequence[dict[str, Any]]) -> list[Any]:
    file = folder / "metrics.parquet"
    case = {"controller": "lpvds", "mode": "robust", "avoidance": "none", "condition": "none", "outcome": "arrived"}
    write_metrics(file, [case | row for row in rows])
    return drawable(terminal.evaluate({"metrics": file}))


def bars(chart: Bars) -> dict[str, tuple[float, str]]:
    return {bar.name: (bar.value, bar.text) for bar in chart.bars}


# --- demonstrations, mixture, system ----------------------------------------------------------------------------------


def test_demonstrations_of_a_point(tmp_path: Path) -> None:
    demos = [
        Demonstration(
            dataset="made", demo=str(k), split="train", arms={"point": ArmRecording(time=TIME, position=path())}
        )
        for k in (1, 2)
    ]
    write_demonstrations(tmp_path / "d.parquet", demos, {})
    (plot,) = drawable(terminal.ingest({"demonstrations": tmp_path / "d.parquet"}))
    assert (plot.title, plot.x_label, plot.y_label) == ("Demonstrations as recorded: 2", "x [mm]", "y [mm]")
    (lines,) = plot.series
    assert lines.name == ""
    assert np.isnan(lines.x).sum() == 2  # one after each path
    assert lines.x[0] == pytest.approx(-50.0)


def test_demonstrations_of_two_arms_in_the_plane_in_which_they_reach_farthest(tmp_path: Path) -> None:
    left, right = path(3, 0.2), path(3, 0.2)
    left[:, 1], right[:, 1] = 0.5, -0.5
    left[3] = np.nan
    arms = {side: ArmRecording(time=TIME, position=way) for side, way in (("left", left), ("right", right))}
    write_demonstrations(
        tmp_path / "d.parquet", [Demonstration(dataset="made", demo="1", split="train", arms=arms)], {}
    )
    (plot,) = drawable(terminal.ingest({"demonstrations": tmp_path / "d.parquet"}))
    assert (plot.x_label, plot.y_label) == ("y [mm]", "z [mm]")
    assert {name: series.mark for name, series in named(plot).items()} == {"left": "L", "right": "R"}
    assert np.nanmax(named(plot)["left"].x) == pytest.approx(500.0)


def test_midpoints_by_split_on_one_scale(tmp_path: Path) -> None:
    train, test = drawable(terminal.midpoint({"midpoints": midpoints(tmp_path)}))
    assert (train.title, test.title) == ("Demonstrations, training: 2", "Demonstrations, test: 1")
    assert train.y_limits == test.y_limits == pytest.approx((0.0, 30.0), abs=0.1)
    assert named(train)["goal"].mark == "G"
    (only,) = drawable(terminal.midpoint({"midpoints": midpoints(tmp_path, 3, ("train",))}))
    assert (only.x_label, only.y_label) == ("x [mm]", "z [mm]")


def fit_of(course: Array, criterion: dict[int, float] | None = None) -> MixtureFit:
    return MixtureFit(
        mixture=mixture_of(),
        sampled=np.arange(3),
        labels=np.zeros(3, dtype=np.int64),
        log_posterior=course,
        components_by_sweep=np.full(course.shape, 2),
        criterion=criterion or {},
    )


def test_the_course_of_sampler_and_em(tmp_path: Path) -> None:
    chains = np.array([[0.0, 1.0, 2.0], [0.0, 3.0, 4.0]])
    fits = {
        "pcgmm": fit_of(chains),
        "em-2": fit_of(np.array([[5.0, 6.0]])),
        "em": fit_of(np.ones((1, 1)), {2: 9.0, 3: 7.0}),
    }
    write_sampler(tmp_path / "s.parquet", fits)
    posterior, likelihood, criterion = drawable(terminal.mixture({"sampler": tmp_path / "s.parquet"}))
    assert (posterior.title, posterior.x_label) == ("Log posterior of PC-GMM's chains", "sweep")
    assert [s.y.tolist() for s in posterior.series] == chains.tolist()
    assert [s.name for s in posterior.series] == ["chain 0", "chain 1"]
    assert {name: s.y.tolist() for name, s in named(likelihood).items()} == {"em-2": [5.0, 6.0], "em": [1.0]}
    assert bars(criterion) == {"2 components": (2.0, ""), "3 components": (0.0, "")}


def dynamics(folder: Path, tried: Sequence[dict[str, Any]], d: int = 2) -> list[Any]:
    model = LpvDs(
        mixture=mixture_of(d), matrices=np.tile(-np.eye(d), (2, 1, 1)), goal=np.zeros(d), lyapunov_matrix=np.eye(d)
    )
    write_dynamics(folder / "dynamics.parquet", model, [-1.0, -1.0], [0.0, 0.0], {"tried": list(tried)})
    return drawable(terminal.dynamics({"dynamics": folder / "dynamics.parquet", "midpoints": midpoints(folder, d)}))


@pytest.mark.parametrize("d", [2, 3])
def test_components_of_the_system(tmp_path: Path, d: int) -> None:
    (plot,) = dynamics(tmp_path, [], d)
    assert plot.title == "The system's 2 components"
    assert named(plot)["means of components"].x.tolist() == pytest.approx((1e3 * path()[[5, 25], 0]).tolist())


def test_scores_of_candidates(tmp_path: Path) -> None:
    recipe = {"mixture": "em-8", "share": 0.6, "guidance": 0.5}
    tried = [
        recipe | {"score": 0.0123, "chosen": True},
        recipe | {"guidance": 1.0, "score": 0.02, "chosen": False},
        recipe | {"mixture": "pcgmm", "score": None, "chosen": False},
    ]
    _, chart = dynamics(tmp_path, tried)
    found = bars(chart)
    assert found["em-8, share 0.6, guidance 0.5"] == (pytest.approx(12.3), "12.3, chosen")
    assert found["em-8, share 0.6, guidance 1"] == (pytest.approx(20.0), "")
    assert np.isnan(found["pcgmm, share 0.6, guidance 0.5"][0])


# --- roll-outs --------------------------------------------------------------------------------------------------------


def test_paths_of_the_first_condition_in_which_something_happens(tmp_path: Path) -> None:
    pushed = path()
    pushed[10:, 1] -= 0.02
    rollouts = [
        one(controller, condition, demo, p_hat=path() if condition == "none" else pushed, disturbed=disturbed)
        for controller in ("lpvds", "clpvds")
        for condition, disturbed in (("none", ()), ("cond1", ((10, 10),)), ("cond2", ((10, 10),)))
        for demo in ("3", "4")
    ]
    plain, coupled, distance = of_rollouts(tmp_path, rollouts)
    assert [plain.title, coupled.title] == ["lpvds, cond1: 2 paths", "clpvds robust, cond1: 2 paths"]
    assert (plain.x_limits, plain.y_limits) == (coupled.x_limits, coupled.y_limits)
    assert np.nanmin(named(plain)["executed"].y) == pytest.approx(-20.0)
    assert distance.title == "Distance from the goal, demonstration 3"
    assert [s.name for s in distance.series] == ["lpvds, cond1", "clpvds robust, cond1"]
    assert distance.series[0].y[[0, -1]] == pytest.approx([50.0, 20.0])


def test_roll_outs_without_any_event(tmp_path: Path) -> None:
    paths, distance = of_rollouts(tmp_path, [one()])
    assert (paths.title, distance.title) == ("none: 1 path", "Distance from the goal, demonstration 3")
    assert of_rollouts(tmp_path, [one(time=TIME[:1], **{name: path()[:1] for name in ("x", "p_hat")}, **short())])


def short() -> dict[str, Any]:
    """Of a roll-out that never began."""
    return {
        "gate": np.ones(1, dtype=bool),
        "lyapunov": np.zeros(1),
        "clearance": np.full(1, np.nan),
        "status": np.zeros(1, dtype=np.int8),
    }


def test_a_path_that_goes_astray_does_not_shrink_the_picture(tmp_path: Path) -> None:
    astray = path()
    astray[20:, 1] = 1e6
    paths, _ = of_rollouts(tmp_path, [one(p_hat=astray)])
    assert paths.y_limits[1] < 100.0
    assert np.isnan(named(paths)["executed"].y[20:30]).all()


def test_among_obstacles_one_scene_of_each_method(tmp_path: Path) -> None:
    methods = ("none", "apf", "roas", "modulation", "cbf", "roas+")
    rollouts = [
        one(condition="two", demo=demo, scene=f"two/{demo}", avoidance=method, rollout=f"{method}/{demo}")
        for method in methods
        for demo in ("3", "4")
    ]
    shapes = spheres(np.array([[-0.03, 0.0]]), np.array([0.005]), np.array([[0.0, 0.01]]))
    scenes = [SimpleNamespace(name=f"two/{demo}", shapes=shapes, traps=None, complete=True) for demo in ("3", "4")]
    *paths, distance = of_rollouts(tmp_path, rollouts, scenes)
    assert [plot.title for plot in paths] == [f"{m}, two: 1 path" for m in ("none", "roas", "modulation", "roas+")]
    edge = named(paths[0])["obstacle at the start"]
    assert (np.nanmin(edge.x), np.nanmax(edge.x)) == (pytest.approx(-35.0, abs=0.1), pytest.approx(-25.0, abs=0.1))
    assert distance.title == "Distance from the goal, demonstration 3 (2 cases not drawn)"


def test_boxes_that_are_carried(tmp_path: Path) -> None:
    boxes = [box("held", 0), box("held", 1), box("pushed", 0, push="left", force=(4.0, 6.0), desired=5.5)]
    *paths, distance, forces = of_rollouts(tmp_path, boxes, d=3)
    assert [plot.title for plot in paths] == ["held: 2 paths", "pushed: 1 path"]
    assert distance.title == "Distance of the box from its goal"
    assert distance.series[0].y[-1] == pytest.approx(0.0, abs=1e-9)
    assert forces.title == "Contact forces of clpvds-robust/pushed/0 (arrived)"
    found = named(forces)
    assert {name: series.mark for name, series in found.items()} == {"left arm": "L", "right arm": "R", "F_d": "d"}
    assert [found[name].y[30] for name in found] == [4.0, 6.0, 5.5]


def test_boxes_among_pots(tmp_path: Path) -> None:
    boxes = [box("roas+", k, pots=[POT], avoidance="roas+") for k in (0, 1)]
    paths, *_ = of_rollouts(tmp_path, boxes, [scene(one, (0.0, 0.0, 0.0)) for one in boxes], d=3)
    assert paths.title == "roas+: 1 path"  # the other box has a pot elsewhere
    assert named(paths)["obstacle"].mark == "#"


# --- metrics ----------------------------------------------------------------------------------------------------------


def test_distances_by_controller_and_condition(tmp_path: Path) -> None:
    rows = [
        {"controller": controller, "condition": condition, "dtw_mm": value}
        for controller, condition, value in (
            ("lpvds", "none", 1.0),
            ("lpvds", "none", 3.0),
            ("lpvds", "cond1", None),
            ("clpvds", "cond1", 5.0),
        )
    ]
    (chart,) = metrics(tmp_path, rows)
    assert chart.title == "Mean dynamic time warping distance to the demonstrations [mm]"
    found = bars(chart)
    assert [*found] == ["lpvds, none", "lpvds, cond1", "clpvds, cond1"]
    assert found["lpvds, none"] == (2.0, "")
    assert np.isnan(found["lpvds, cond1"][0])


def test_arrivals_among_obstacles(tmp_path: Path) -> None:
    rows = [
        {"avoidance": method, "condition": "two", "scene": "two", "outcome": outcome}
        for method, outcome in (("apf", "arrived"), ("apf", "collided"), ("roas+", "arrived"))
    ]
    alone = {"condition": "none", "dtw_mm": 4.0}
    (chart,) = metrics(tmp_path, [*rows, alone])
    assert bars(chart) == {"apf": (0.5, "1 of 2"), "roas+": (1.0, "1 of 1")}
    assert len(metrics(tmp_path, [*rows, alone, alone | {"condition": "cond1"}])) == 2


def test_deliveries_and_forces(tmp_path: Path) -> None:
    rows = [
        {"condition": "held", "delivered": True, "force_mean_n": 5.0, "desired_force_n": 5.0},
        {"condition": "held", "delivered": False, "force_mean_n": 3.0, "desired_force_n": 6.98},
        {"condition": "stiff", "delivered": False, "force_mean_n": None},
    ]
    shares, forces = metrics(tmp_path, rows)
    assert bars(shares) == {"held": (0.5, "1 of 2"), "stiff": (0.0, "0 of 1")}
    assert forces.title == "Mean contact force [N]; F_d is 5 to 6.98 N at the end"
    assert bars(forces)["held"] == (4.0, "")


# --- the stages -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reference", STAGES)
def test_every_stage_names_what_draws_it_and_no_key_depends_on_it(reference: str) -> None:
    stage = load(reference)
    module = stage.plots.partition(":")[0]
    assert callable(load(stage.plots))
    for kind in [*stage.implementations] or [""]:
        reached = code.reached(stage.modules(SimpleNamespace(kind=kind)))
        assert module not in reached
        assert not any(name.startswith("stages.figures") for name in reached)
