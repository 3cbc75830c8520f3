"""Candidates: what each is learned from, how it is rolled out and held out, and which one is taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from motions import gaussians, goal, hook, trajectory

from pipeline.errors import SolverError
from stages.dynamics import choose as module
from stages.dynamics import learn
from stages.dynamics.choose import DISPLACEMENT, FOLDS, Choice, Tried, choose
from stages.dynamics.follow import ARRIVED, LONGEST, STEPS, deviation, follow
from stages.dynamics.kernels import workspace
from stages.dynamics.learn import Data, Learning, Recipe, find, place, pooled, regularised, smoothed, system
from stages.dynamics.lpvds import LpvDs
from stages.dynamics.samples import Frame, Samples, frame_of, guides, thinned
from stages.dynamics.straighten import mean_demonstration, straighten
from stages.dynamics.warp import STEEPEST, Warp
from stages.mixture.gaussian import GaussianMixture
from stages.trajectory import Trajectory

LEARNING = Learning(
    margin=0.03, condition=50.0, ridge=1e-3, width=0.04, decay=0.15, speed_limit=math.inf, tolerance=1e-6
)
NOT_LEARNED = ("condition", "velocity_error", "held_out_error", "deviation", "held_out_deviation", "score", "arrives")


def recipes(demonstrations: Sequence[Trajectory], frame: Frame, d: int = 2) -> list[Recipe]:
    """Two mixtures, with and without a warp, with and without guides."""
    mean = mean_demonstration(demonstrations, goal(d))
    warps = {0.0: Warp.identity(d), 0.6: straighten(mean, 0.6, 15)}
    return [
        Recipe(
            mixture=f"of-{components}",
            gaussians=smoothed(gaussians(list(demonstrations), components), 2.0, 0.02 * frame.size),
            warp=warp,
            share=share,
            guidance=guidance,
        )
        for components in (3, 5)
        for share, warp in warps.items()
        for guidance in (0.0, 0.6)
    ]


def data_of(recipe: Recipe, at: np.ndarray, own: Samples, beside: Samples) -> Data:
    return learn.data_of(recipe, place(recipe.warp, at, own), place(recipe.warp, at, beside, guides=True))


def one_linear(A: np.ndarray, at: np.ndarray) -> LpvDs:
    d = len(at)
    mixture = GaussianMixture(weights=[1.0], means=[at], covariances=[np.eye(d)])
    return LpvDs(mixture=mixture, matrices=[A], goal=at, lyapunov_matrix=np.eye(d))


def rolled_out(model: LpvDs, start: np.ndarray, dt: float, count: int) -> np.ndarray:
    path = [start]
    for _ in range(count):
        path.append(model.step(path[-1][None], dt)[0])
    return np.array(path)


# Roll-outs.


@pytest.mark.parametrize("d", [2, 3])
def test_the_motion_of_the_system_itself_deviates_by_nothing(d: int) -> None:
    A = -2.0 * np.eye(d) + 3.0 * (np.eye(d, k=1) - np.eye(d, k=-1))
    model = one_linear(A, goal(d))
    path = rolled_out(model, goal(d) + 1.0, 0.02, STEPS)
    away = np.linalg.norm(path - goal(d), axis=1)
    size = math.sqrt(away[-2] * away[-1]) / ARRIVED  # near enough at the last sample, and not before
    way, arrived = deviation(model.arrays, trajectory(path), path[0], size)
    assert arrived
    assert way < 1e-14


def test_the_deviation_is_the_mean_distance() -> None:
    # Along the first axis, beside the demonstration by 0.3 m.
    model = one_linear(-2.0 * np.eye(2), np.zeros(2))
    path = rolled_out(model, np.array([1.0, 0.0]), 0.02, STEPS)
    beside = trajectory(path + np.array([0.0, 0.3]))
    way, arrived = deviation(model.arrays, beside, path[0], 1.01 * path[-1, 0] / ARRIVED)
    assert arrived
    assert way == pytest.approx(0.3, rel=1e-12)


def test_a_roll_out_ends_where_it_is_near_or_takes_too_long() -> None:
    model = one_linear(-np.eye(2), np.zeros(2)).arrays
    work, path = workspace(model), np.empty((50, 2))
    # A step of 2/3 s halves the distance: (1 - h/2)/(1 + h/2) = 1/2.
    assert follow(np.array([1.0, 0.0]), model, 2.0 / 3.0, 0.2, work, path) == (4, True)
    np.testing.assert_allclose(path[:4, 0], [1.0, 0.5, 0.25, 0.125], rtol=1e-14)
    assert follow(np.zeros(2), model, 0.1, 0.0, work, path) == (1, True)
    assert follow(np.array([1.0, 0.0]), model, 1e-3, 0.2, work, path) == (50, False)
    demonstration = trajectory([[1.0, 0.0], [0.5, 0.0], [0.0, 0.0]], duration=1.0)
    slow = one_linear(-0.01 * np.eye(2), np.zeros(2)).arrays
    way, arrived = deviation(slow, demonstration, np.array([1.0, 0.0]), 1.0)
    assert not arrived
    # It has hardly moved by then: half the demonstration, on average, is farther off.
    left = math.exp(-0.01 * LONGEST)
    assert 0.4 < way < 0.5 * (1.0 + left) + 0.01


def test_a_roll_out_that_is_no_number_is_infinitely_far_off() -> None:
    # I - h A/2 = 0: the step is a division by zero.
    demonstration = trajectory([[1.0, 0.0], [0.0, 0.0]], duration=1.0)
    model = one_linear(2.0 * STEPS * np.eye(2), np.zeros(2)).arrays
    assert deviation(model, demonstration, np.array([1.0, 0.0]), 1.0) == (math.inf, False)


# What a candidate is learned from.


def test_smoothing_by_hand() -> None:
    mixture = GaussianMixture(weights=[1.0], means=[[1.0, 2.0]], covariances=[np.diag([4.0, 9.0])])
    wider = smoothed(mixture, 2.0, 0.5)
    np.testing.assert_allclose(wider.covariances, [np.diag([8.25, 18.25])])
    np.testing.assert_array_equal(wider.means, mixture.means)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("share", [0.0, 0.6])
def test_the_least_squares_are_those_of_the_system(d: int, share: float) -> None:
    demonstrations = hook(d)
    frame = frame_of(demonstrations, goal(d))
    recipe = next(r for r in recipes(demonstrations, frame, d) if r.share == share and r.guidance > 0.0)
    parts = [data_of(recipe, goal(d), thinned(one, 40), guides(one, frame, 0.01, 0.05)) for one in demonstrations]
    whole = pooled(parts)
    K = recipe.gaussians.components
    A = np.random.default_rng(d).normal(size=(K, d, d)) - 3.0 * np.eye(d)
    model = system(recipe, goal(d), A, np.eye(d), LEARNING)

    def error(samples: Samples) -> float:
        return float(((model.velocity(samples.position) - samples.velocity) ** 2).sum(axis=1).mean())

    own = [error(thinned(one, 40)) for one in demonstrations]
    for part, expected in zip(parts, own, strict=True):
        assert part.samples == 40
        assert part.own.error(A) == pytest.approx(expected, rel=1e-9)
    assert whole.samples == 120
    assert whole.own.error(A) == pytest.approx(np.mean(own), rel=1e-9)
    assert whole.guides is not None
    if share == 0.0:
        beside = np.mean([error(guides(one, frame, 0.01, 0.05)) for one in demonstrations])
        assert whole.guides.error(A) == pytest.approx(beside, rel=1e-9)
        together = regularised(recipe, whole, replace(LEARNING, ridge=0.0))
        assert together.error(A) == pytest.approx(np.mean(own) + recipe.guidance * beside, rel=1e-9)
    assert regularised(recipe, whole, LEARNING).ridge is not None
    # The same, unsquared.
    triangle = regularised(recipe, whole, LEARNING).triangle
    assert triangle is not None
    np.testing.assert_allclose(
        triangle.factor.T @ triangle.factor, regularised(recipe, whole, LEARNING).gram, atol=1e-12
    )


def test_demonstrations_of_unequal_length_count_by_their_samples() -> None:
    demonstrations = hook(2)
    recipe = recipes(demonstrations, frame_of(demonstrations, goal(2)))[0]
    nothing = Samples(position=np.empty((0, 2)), velocity=np.empty((0, 2)))
    counts = (10, 90, 30)
    parts = [
        data_of(recipe, goal(2), thinned(one, count), nothing)
        for one, count in zip(demonstrations, counts, strict=True)
    ]
    whole = pooled(parts)
    assert whole.guides is None
    np.testing.assert_allclose(whole.own.gram, np.average([p.own.gram for p in parts], axis=0, weights=counts))


def test_guides_count_only_where_they_have_weight_and_the_warp_lets_them() -> None:
    demonstrations = hook(2)
    frame = frame_of(demonstrations, goal(2))
    recipe = recipes(demonstrations, frame)[1]
    one = demonstrations[0]
    beside = guides(one, frame, 0.01, 0.05)
    assert data_of(recipe, goal(2), thinned(one, 40), beside).guides is not None
    assert data_of(replace(recipe, guidance=0.0), goal(2), thinned(one, 40), beside).guides is None
    # A warp that is as good as flat at a state: a guide there would ask for a velocity that only the warp makes.
    v = np.array([0.02, 0.0])
    rate = 0.999 / (STEEPEST * 0.02)
    flat = beside.position[:1] - goal(2)
    warp = Warp(centres=flat - [1.0 / (math.sqrt(2.0) * rate), 0.0], translations=[v], rates=[rate])
    steep = replace(recipe, warp=warp, share=0.5)
    found = data_of(steep, goal(2), thinned(one, 40), Samples(position=flat + goal(2), velocity=beside.velocity[:1]))
    assert found.guides is None
    kept = np.linalg.svd(warp.apply(beside.position - goal(2))[1], compute_uv=False)[:, -1] >= 0.05
    assert 0 < kept.sum() < len(kept)
    few = Samples(position=beside.position[kept], velocity=beside.velocity[kept])
    all_of_them, those_kept = (data_of(steep, goal(2), thinned(one, 40), given).guides for given in (beside, few))
    assert all_of_them is not None
    assert those_kept is not None
    np.testing.assert_array_equal(all_of_them.gram, those_kept.gram)


# Which candidate is taken.


@pytest.fixture(scope="module")
def chosen() -> tuple[list[Trajectory], Frame, list[Recipe], Choice]:
    demonstrations = hook(2)
    frame = frame_of(demonstrations, goal(2))
    candidates = recipes(demonstrations, frame)
    return demonstrations, frame, candidates, choose(demonstrations, goal(2), frame, candidates, LEARNING)


Chosen = tuple[list[Trajectory], Frame, list[Recipe], Choice]


def test_every_candidate_is_told_of_and_the_best_that_arrives_is_taken(chosen: Chosen) -> None:
    _, _, candidates, choice = chosen
    assert len(choice.tried) == len(candidates)
    for recipe, entry in zip(candidates, choice.tried, strict=True):
        assert (entry.mixture, entry.share, entry.guidance) == (recipe.mixture, recipe.share, recipe.guidance)
        assert entry.components == recipe.gaussians.components
        assert None not in asdict(entry).values()
        parts = (entry.deviation, entry.held_out_deviation, entry.held_out_error)
        assert entry.score == pytest.approx((parts[0] + parts[1]) * (1.0 + parts[2]) ** 2, rel=1e-12)
        assert 1.0 <= entry.condition <= 50.0 * (1.0 + 1e-9)
    taken = [number for number, entry in enumerate(choice.tried) if entry.chosen]
    assert len(taken) == 1
    assert choice.recipe is candidates[taken[0]]
    best = min((entry for entry in choice.tried if entry.arrives), key=lambda entry: entry.score)
    assert best.chosen
    # No quadratic function falls along a motion that first moves away: the warp is needed here.
    assert choice.recipe.share == 0.6
    without, needed = (min(e.deviation for e in choice.tried if e.share == share) for share in (0.0, 0.6))
    assert needed < 0.8 * without


def test_the_figures_of_an_entry_are_those_of_its_system(chosen: Chosen) -> None:
    demonstrations, frame, candidates, choice = chosen
    number = 4  # the first of its mixture and warp, so that its search starts afresh
    recipe = candidates[number]
    data = pooled(
        [data_of(recipe, goal(2), thinned(one, 200), guides(one, frame, 0.01, 0.05)) for one in demonstrations]
    )
    found = find(regularised(recipe, data, LEARNING), LEARNING, frame)
    model = system(recipe, goal(2), found.solution.matrices, found.lyapunov_matrix, LEARNING)
    samples = [thinned(one, None) for one in demonstrations]
    x, v = (np.concatenate([getattr(s, name) for s in samples]) for name in ("position", "velocity"))
    entry = choice.tried[number]
    assert entry.velocity_error == pytest.approx(
        math.sqrt(((model.velocity(x) - v) ** 2).sum() / (v**2).sum()), rel=1e-6
    )
    ways = [deviation(model.arrays, one, one.position[0], frame.size)[0] for one in demonstrations]
    assert entry.deviation == pytest.approx(np.mean(ways), rel=1e-9)
    assert entry.condition == pytest.approx(np.linalg.cond(found.lyapunov_matrix), rel=1e-9)


def test_the_same_candidates_give_the_same_choice_and_of_equals_the_first(chosen: Chosen) -> None:
    demonstrations, frame, candidates, choice = chosen
    twins = [candidates[6], replace(candidates[6], mixture="twin"), candidates[6]]
    again = choose(demonstrations, goal(2), frame, twins, LEARNING)
    assert [entry.chosen for entry in again.tried] == [True, False, False]
    assert again.tried[0].score == again.tried[1].score == choice.tried[6].score
    assert again.recipe is twins[0]


def test_the_search_goes_on_from_the_same_mixture_and_warp(chosen: Chosen, monkeypatch: pytest.MonkeyPatch) -> None:
    demonstrations, frame, candidates, _ = chosen
    starts: list[np.ndarray | None] = []
    ends: list[np.ndarray] = []

    def spy(*arguments: Any) -> Any:
        starts.append(arguments[3])
        ends.append(find(*arguments).lyapunov_matrix)
        return find(*arguments)

    monkeypatch.setattr(module, "find", spy)
    choose(demonstrations, goal(2), frame, candidates[:4], LEARNING)
    assert [start is None for start in starts] == [True, False, True, False]
    np.testing.assert_array_equal(starts[1], ends[0])
    np.testing.assert_array_equal(starts[3], ends[2])


def test_a_candidate_that_does_not_arrive_is_passed_over(chosen: Chosen, monkeypatch: pytest.MonkeyPatch) -> None:
    demonstrations, frame, candidates, choice = chosen
    ranked = sorted(range(len(candidates)), key=lambda number: choice.tried[number].score)
    first = [entry.chosen for entry in choice.tried].index(True)
    answers = iter([False, False, True])
    monkeypatch.setattr(module, "_arrives", lambda *_: next(answers))
    other = choose(demonstrations, goal(2), frame, candidates, LEARNING)
    beaten = [number for number in ranked if choice.tried[number].arrives or number == first][:2]
    for number in beaten:
        assert other.tried[number].arrives is False
        assert not other.tried[number].chosen
    assert sum(entry.chosen for entry in other.tried) == 1
    assert other.recipe is not choice.recipe
    # If none arrives, the best one is better than none, and says so.
    monkeypatch.setattr(module, "_arrives", lambda *_: False)
    none = choose(demonstrations, goal(2), frame, candidates, LEARNING)
    assert [entry.arrives for entry in none.tried] == [False] * len(candidates)
    assert none.tried[ranked[0]].chosen


def test_a_system_that_stops_short_is_seen(chosen: Chosen) -> None:
    demonstrations, frame, candidates, _ = chosen
    recipe = candidates[0]
    K = recipe.gaussians.components
    slow = system(recipe, goal(2), np.tile(-0.01 * np.eye(2), (K, 1, 1)), np.eye(2), LEARNING).arrays
    quick = system(recipe, goal(2), np.tile(-5.0 * np.eye(2), (K, 1, 1)), np.eye(2), LEARNING).arrays
    assert not module._arrives(demonstrations, frame, slow)
    assert module._arrives(demonstrations, frame, quick)


def test_starts_are_displaced_along_every_axis(chosen: Chosen, monkeypatch: pytest.MonkeyPatch) -> None:
    demonstrations, frame, _, _ = chosen
    starts: list[np.ndarray] = []

    def spy(model: Any, demonstration: Trajectory, start: np.ndarray, size: float) -> tuple[float, bool]:
        starts.append(start - demonstration.position[0])
        return 0.0, True

    monkeypatch.setattr(module, "deviation", spy)
    assert module._arrives(demonstrations, frame, None)
    assert len(starts) == 3 * 2 * 2
    np.testing.assert_allclose(np.linalg.norm(starts, axis=1), DISPLACEMENT * frame.size)
    np.testing.assert_allclose(np.sum(starts, axis=0), 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(np.array(starts)) == 2


@pytest.mark.parametrize("count", [2, 3, 5])
def test_what_is_held_out_is_not_learned_from(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    demonstrations = hook(2, count)
    frame = frame_of(demonstrations, goal(2))
    recipe = recipes(demonstrations, frame)[2]
    P = np.array([[1.2, 0.1], [0.1, 0.8]])
    learned: list[np.ndarray] = []
    refine = module.refine

    def spy(*arguments: Any, **options: Any) -> Any:
        solution = refine(*arguments, **options)
        learned.append(solution.matrices)
        return solution

    monkeypatch.setattr(module, "refine", spy)

    def parts_of(given: Sequence[Trajectory]) -> list[Data]:
        return [data_of(recipe, goal(2), thinned(one, 50), guides(one, frame, 0.01, 0.05)) for one in given]

    def held_out(given: Sequence[Trajectory]) -> list[np.ndarray]:
        learned.clear()
        module._held_out(given, goal(2), frame, recipe, LEARNING, parts_of(given), P)
        return list(learned)

    before = held_out(demonstrations)
    assert len(before) == min(FOLDS, count)
    for n in range(count):
        one = demonstrations[n]
        changed = [*demonstrations[:n], trajectory(1.1 * one.position, velocity=2.0 * one.velocity)]
        after = held_out([*changed, *demonstrations[n + 1 :]])
        for fold, (old, new) in enumerate(zip(before, after, strict=True)):
            # Every demonstration is held out of one fold, and learned from in the others.
            assert np.array_equal(old, new) == (n % min(FOLDS, count) == fold)


def test_one_demonstration_is_enough(chosen: Chosen) -> None:
    _, frame, candidates, _ = chosen
    choice = choose(hook(2, 1), goal(2), frame, candidates[2:4], LEARNING)
    for entry in choice.tried:
        assert (entry.held_out_deviation, entry.held_out_error) == (0.0, 0.0)
        assert entry.score == entry.deviation > 0.0
    assert sum(entry.chosen for entry in choice.tried) == 1


def flattened(demonstrations: Sequence[Trajectory], recipe: Recipe) -> Recipe:
    """The recipe with a warp that is one-to-one, but at one sample only just."""
    rate = 0.999 / (STEEPEST * 0.05)
    centre = demonstrations[0].position[0] - goal(2) - [1.0 / (math.sqrt(2.0) * rate), 0.0]
    return replace(recipe, warp=Warp(centres=[centre], translations=[[0.05, 0.0]], rates=[rate]), share=0.9)


def test_a_warp_that_compresses_too_much_is_passed_over(chosen: Chosen) -> None:
    demonstrations, frame, candidates, _ = chosen
    flat = flattened(demonstrations, candidates[0])
    choice = choose(demonstrations, goal(2), frame, [flat, candidates[2]], LEARNING)
    assert choice.tried[0] == Tried(mixture="of-3", components=3, share=0.9, guidance=0.0)
    assert [getattr(choice.tried[0], name) for name in NOT_LEARNED] == [None] * len(NOT_LEARNED)
    assert choice.tried[1].chosen
    with pytest.raises(SolverError, match="Every candidate's warp compresses too much"):
        choose(demonstrations, goal(2), frame, [flat, flat], LEARNING)


def test_a_candidate_that_cannot_be_learned_is_passed_over(chosen: Chosen, monkeypatch: pytest.MonkeyPatch) -> None:
    demonstrations, frame, candidates, choice = chosen

    def fails(*arguments: Any) -> Any:
        if arguments[1] is not LEARNING or bad(arguments[0]):
            raise SolverError("No answer.", "MaxIterations", {"gap": 1.0}, {"gram": np.eye(2)})
        return find(*arguments)

    monkeypatch.setattr(module, "find", fails)
    side = 3 * 2

    def bad(problem: Any) -> bool:
        return bool(problem.cross.shape[1] == side)  # of three components

    other = choose(demonstrations, goal(2), frame, candidates, LEARNING)
    assert [entry.score is None for entry in other.tried] == [entry.components == 3 for entry in choice.tried]
    assert other.recipe.mixture == "of-5"
    with pytest.raises(SolverError, match="No answer") as caught:
        choose(demonstrations, goal(2), frame, candidates[:4], LEARNING)
    assert caught.value.program is not None
