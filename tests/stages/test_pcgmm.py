"""PC-GMM, ref. [32]: what the mixture is chosen for, its chains, and what it refuses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import DataError, ParameterError
from stages.dynamics import qlf
from stages.dynamics.parameters import QlfParameters
from stages.mixture.data import by_arc_length, normalisation
from stages.mixture.em import fit_em
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import log_densities
from stages.mixture.links import sweeps
from stages.mixture.parameters import EmParameters, PcGmmParameters
from stages.mixture.pcgmm import components_of, fit_pcgmm, similarity
from stages.mixture.seating import Seating
from stages.mixture.spread import chain_spread, r_hat
from stages.trajectory import Trajectory

QUICK = PcGmmParameters(sweeps=15, points=150)


def lanes(gap: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eight demonstrations along one lane and eight back along another, `gap` standard deviations beside it."""
    rng = np.random.default_rng(seed)
    n, deviation = 100, 0.02
    positions, velocities = [], []
    for back in [False] * 8 + [True] * 8:
        s = np.linspace(0.0, 1.0, n)
        wave = np.sin(2.0 * np.pi * (s * rng.uniform(0.5, 2.0) + rng.uniform()))
        beside = deviation * (gap * back + 0.8 * rng.normal() + 0.7 * rng.normal() * wave)
        positions.append(np.column_stack([s[::-1] if back else s, beside]))
        velocities.append(np.gradient(positions[-1], 0.01, axis=0))
    return np.concatenate(positions), np.concatenate(velocities), np.full(16, n)


def purity(labels: np.ndarray, direction: np.ndarray) -> float:
    """Share of the points whose cluster mostly moves as they do."""
    return sum(np.bincount(direction[labels == k]).max() for k in np.unique(labels)) / len(labels)


def curve(n: int = 200, d: int = 2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three demonstrations of one S-shaped motion to the origin."""
    rng = np.random.default_rng(2)
    s = np.linspace(1.0, 0.0, n)
    shape = np.column_stack([s, 0.3 * np.sin(2 * np.pi * s), *(0.2 * s ** (k + 2) for k in range(d - 2))])
    demos = [0.2 * shape * (1.0 + 0.05 * rng.normal(size=d)) for _ in range(3)]
    velocity = [np.gradient(demo, 0.01, axis=0) for demo in demos]
    return np.concatenate(demos), np.concatenate(velocity), np.full(3, n)


def fit(data: tuple[np.ndarray, ...], parameters: PcGmmParameters = QUICK, seed: int = 0) -> MixtureFit:
    return fit_pcgmm(*data, parameters, np.random.default_rng(seed))


def test_similarity_by_hand() -> None:
    points = np.array([[0.0, 0.0], [0.3, 0.4], [0.0, 0.0], [0.0, 0.0]])
    velocity = np.array([[1.0, 0.0], [0.0, 5.0], [-2.0, 0.0], [0.0, 0.0]])
    s = similarity(points, velocity, 0.5)
    assert s[0, 1] == pytest.approx(math.exp(-0.25 / 0.5))  # at right angles, 0.5 apart
    assert s[0, 2] == 0.0  # opposite
    assert s[0, 3] == 1.0  # one stands still: position alone
    assert s[3, 1] == pytest.approx(math.exp(-0.5))
    np.testing.assert_array_equal(s, s.T)
    np.testing.assert_array_equal(np.diag(s), 0.0)  # the link of a point to itself has a weight of its own
    np.testing.assert_array_equal(s, similarity(points, 1e-3 * velocity, 0.5))
    creeping = np.where(velocity == 0.0, 1e-12, velocity)  # a standstill after rounding
    np.testing.assert_allclose(similarity(points, creeping, 0.5), s, atol=1e-9)


def test_similarity_does_not_depend_on_how_many_rows_are_computed_at_once() -> None:
    rng = np.random.default_rng(0)
    points, velocity = rng.normal(size=(70, 3)), rng.normal(size=(70, 3))
    s = similarity(points, velocity, 0.5)
    for i, j in [(0, 69), (31, 32), (33, 2), (64, 63)]:
        cosine = velocity[i] @ velocity[j] / np.linalg.norm(velocity[i]) / np.linalg.norm(velocity[j])
        assert s[i, j] == pytest.approx((1 + cosine) * math.exp(-2.0 * ((points[i] - points[j]) ** 2).sum()))


@pytest.mark.parametrize(("gap", "most_plain"), [(2.0, 0.65), (3.0, 0.85), (5.0, 1.0)])
def test_opposite_lanes_are_kept_apart_where_bic_merges_them(gap: float, most_plain: float) -> None:
    ours, plain = [], []
    for seed in range(3):
        data = lanes(gap, seed)
        direction = (data[1][:, 0] < 0.0).astype(np.int64)
        found = fit(data, PcGmmParameters(), seed)
        ours.append(purity(found.labels, direction[found.sampled]))
        other = fit_em(*data, EmParameters(max_components=8, restarts=2, points=200), np.random.default_rng(seed))
        plain.append(purity(other.labels, direction[other.sampled]))
    assert np.mean(ours) >= 0.95
    assert np.mean(plain) <= min(most_plain, np.mean(ours))


def test_lanes_on_top_of_each_other_cannot_be_told_apart() -> None:
    # Honest limit: a mixture over position does not see direction where two directions share every place.
    data = lanes(0.0, 0)
    found = fit(data, PcGmmParameters())
    direction = (data[1][:, 0] < 0.0).astype(np.int64)
    assert purity(log_densities(found.mixture, data[0]).argmax(axis=1), direction) < 0.7


@pytest.mark.parametrize("d", [2, 3, 5])
def test_a_fit_is_sound(d: int) -> None:
    data = curve(d=d)
    found = fit(data)
    assert found.mixture.dimension == d
    assert 2 <= found.mixture.components <= 20
    assert len(found.sampled) == len(found.labels) <= QUICK.points
    assert set(found.labels) == set(range(found.mixture.components))
    assert np.bincount(found.labels).min() >= d + 2
    assert (np.diff(np.unique(found.labels, return_index=True)[1]) > 0).all()  # numbered by their first point
    assert found.log_posterior.shape == found.components_by_sweep.shape == (1, QUICK.sweeps)
    assert np.isfinite(found.log_posterior).all()


@pytest.mark.parametrize("seed", range(4))
def test_unit_and_rotation_change_neither_components_nor_labels(seed: int) -> None:
    position, velocity, lengths = curve()
    angle = 0.7 + seed
    R = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    found = fit((position, velocity, lengths), seed=seed)
    millimetres = fit((1000.0 * position, 1000.0 * velocity, lengths), seed=seed)
    turned = fit((position @ R.T + [3.0, -1.0], velocity @ R.T, lengths), seed=seed)
    np.testing.assert_array_equal(millimetres.labels, found.labels)
    np.testing.assert_array_equal(turned.labels, found.labels)
    np.testing.assert_allclose(millimetres.mixture.covariances, 1e6 * found.mixture.covariances, rtol=1e-7)
    np.testing.assert_allclose(turned.mixture.means, found.mixture.means @ R.T + [3.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(turned.mixture.covariances, R @ found.mixture.covariances @ R.T, atol=1e-10)


def test_same_seed_same_bytes_other_seed_other_chain() -> None:
    one, two, other = fit(curve()), fit(curve()), fit(curve(), seed=1)
    assert one.mixture.means.tobytes() == two.mixture.means.tobytes()
    assert one.mixture.covariances.tobytes() == two.mixture.covariances.tobytes()
    assert one.log_posterior.tobytes() == two.log_posterior.tobytes()
    assert one.log_posterior.tobytes() != other.log_posterior.tobytes()


def test_the_first_chain_is_the_same_however_many_follow_and_the_best_state_of_all_is_kept() -> None:
    data, kept = curve(), set()
    for seed in range(6):
        one, three = fit(data, seed=seed), fit(data, replace(QUICK, chains=3), seed)
        assert three.log_posterior.shape == three.components_by_sweep.shape == (3, QUICK.sweeps)
        assert three.log_posterior[0].tobytes() == one.log_posterior[0].tobytes()
        assert three.components_by_sweep[0].tobytes() == one.components_by_sweep[0].tobytes()
        assert len({chain.tobytes() for chain in three.log_posterior}) == 3
        chain = int(three.log_posterior.max(axis=1).argmax())
        assert (three.mixture.covariances.tobytes() == one.mixture.covariances.tobytes()) == (chain == 0)
        assert three.mixture.components <= three.spread.components[chain]
        kept.add(chain)
    assert len(kept) > 1


def test_chains_start_from_single_points_and_from_one_table_by_turns_and_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    starts: list[int] = []

    def watched(state: Seating, *others: object) -> None:
        starts.append(int(state.used[0]))
        sweeps(state, *others)

    monkeypatch.setattr("stages.mixture.pcgmm.sweeps", watched)
    found = fit(curve(), replace(QUICK, chains=4, sweeps=60))
    assert starts == [len(found.sampled), 1, len(found.sampled), 1]
    assert found.spread.burn_in <= 20
    assert found.spread.r_hat < 1.3
    assert np.ptp(found.spread.best) < 0.05 * abs(found.spread.best.mean())


def test_spread_by_hand() -> None:
    posterior = np.array([[-9.0, -5.0, -2.0, -3.0, -1.0, -3.0, -2.0, -2.5], [-9.0, -8.0, -7.0, 0.0, -1, -2, -2, -3]])
    components = np.array([[9, 8, 7, 6, 5, 4, 3, 2], [1, 1, 1, 6, 4, 4, 4, 4]])
    spread = chain_spread(posterior, components)
    assert spread.burn_in == 4  # 2 and 4: 0.0 is out of the range of what follows
    np.testing.assert_array_equal(spread.best, [-1.0, 0.0])
    np.testing.assert_array_equal(spread.components, [5, 6])
    # Four parts of two, (-1, -3), (-2, -2.5), (-1, -2) and (-2, -3): variances 2, 1/8, 1/2, 1/2.
    assert spread.r_hat == pytest.approx(math.sqrt(0.5 + np.var([-2, -2.25, -1.5, -2.5], ddof=1) / (3.125 / 4)))
    assert chain_spread(posterior[:1], components[:1]).burn_in == 2


def test_r_hat_tells_mixed_chains_from_others() -> None:
    draws = np.random.default_rng(0).normal(size=(4, 200))
    assert r_hat(draws) == pytest.approx(1.0, abs=0.02)
    assert r_hat(draws + 3.0 * np.arange(4)[:, None]) > 2.0
    assert r_hat(draws[:1] + np.linspace(0.0, 5.0, 200)) > 1.5  # one chain, still on its way
    assert r_hat(np.full((2, 10), 7.0)) == 1.0
    assert r_hat(np.repeat([[1.0], [2.0]], 10, axis=1)) == math.inf
    assert math.isnan(r_hat(draws[:, :3]))


def test_small_tables_are_dissolved_into_their_neighbours() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal([-1.0, 0.0], 0.1, (10, 2)), rng.normal([1.0, 0.0], 0.1, (10, 2))])
    tables = np.array([9] * 8 + [4] * 2 + [7] * 3 + [2] * 7)
    mixture, labels = components_of(points, tables, 1.0, np.eye(2), 1e-6)
    np.testing.assert_array_equal(labels, np.repeat([0, 1], 10))
    np.testing.assert_allclose(mixture.weights, [0.5, 0.5])
    own = points[:10]
    mean = own.sum(axis=0) / 11.0
    np.testing.assert_allclose(mixture.means[0], mean)
    np.testing.assert_allclose(mixture.covariances[0], (np.eye(2) + own.T @ own - 11.0 * np.outer(mean, mean)) / 9.0)


def test_only_small_tables_become_one_component() -> None:
    points = np.random.default_rng(0).normal(size=(6, 2))
    mixture, labels = components_of(points, np.array([0, 0, 1, 1, 2, 2]), 1.0, np.eye(2), 1e-6)
    assert mixture.components == 1
    assert (labels == 0).all()


def test_arc_length_sampling_is_even_and_ignores_standing_still() -> None:
    moving = np.column_stack([np.linspace(0.0, 1.0, 101) ** 2, np.zeros(101)])
    demo = np.concatenate([np.zeros((500, 2)), moving, np.tile([1.0, 0.0], (500, 1))])
    other = np.column_stack([np.linspace(50.0, 51.0, 1001), np.zeros(1001)])  # far away: the jump is no path
    position, lengths = np.concatenate([demo, other]), np.array([len(demo), len(other)])
    chosen = by_arc_length(position, lengths, 40)
    assert len(chosen) == 40
    assert (np.diff(chosen) > 0).all()
    assert (chosen < len(demo)).sum() == 20
    np.testing.assert_allclose(np.diff(position[chosen[:20], 0]), 0.05, atol=0.021)
    np.testing.assert_array_equal(by_arc_length(position, lengths, None), np.arange(len(position)))
    np.testing.assert_array_equal(by_arc_length(position, lengths, 10**6), np.arange(len(position)))


def test_arc_length_sampling_leaves_no_choice_to_rounding() -> None:
    # Targets half-way between samples, on samples, at a standstill and where one demonstration follows another.
    line = np.linspace([1.0, 2.0], [0.0, 0.0], 101)
    rest = np.concatenate([np.repeat(line[:1], 50, axis=0), line, np.repeat(line[-1:], 70, axis=0)])
    middle = np.concatenate([line[:51], np.repeat(line[50:51], 30, axis=0), line[51:]])
    for demos in ([line], [line] * 2, [line] * 3, [rest] * 2, [middle] * 3, [middle, rest, line]):
        position, lengths = np.concatenate(demos), np.array([len(demo) for demo in demos])
        for count in (20, 50, 75, 101):
            expected = by_arc_length(position, lengths, count)
            for angle in (0.3, 1.1, 2.5):
                R = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
                turned = 17.3 * position @ R.T
                np.testing.assert_array_equal(by_arc_length(turned, lengths, count), expected)
                jitter = 1e-14 * np.random.default_rng(0).normal(size=position.shape)
                np.testing.assert_array_equal(by_arc_length(position + jitter, lengths, count), expected)


def test_a_demonstration_that_ends_standing_still() -> None:
    position, velocity, lengths = curve()
    velocity = velocity.copy()
    velocity[-20:] = 0.0
    assert np.isfinite(fit((position, velocity, lengths)).log_posterior).all()


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("floor", [1e-4, 1e-10])
def test_a_straight_line_is_a_motion_and_held_up_by_the_floor(d: int, floor: float) -> None:
    time = np.linspace(0.0, 1.0, 400)
    line = np.linspace(np.arange(1, d + 1) * 0.1, np.zeros(d), 400)
    speed = np.tile(-np.arange(1, d + 1) * 0.1, (400, 1))
    position, velocity = np.tile(line, (2, 1)), np.tile(speed, (2, 1))
    found = fit((position, velocity, np.array([400, 400])), replace(QUICK, points=400, variance_floor=floor))
    radius = normalisation(position[found.sampled]).radius
    values = np.linalg.eigvalsh(found.mixture.covariances)
    np.testing.assert_allclose(values[:, :-1], floor * radius**2, rtol=1e-4)
    assert (values[:, -1] > 1e-3 * radius**2).all()
    assert np.isfinite(found.log_posterior).all()
    if d <= 3 and floor == QUICK.variance_floor:
        demo = Trajectory(dataset="line", demo="1", split="train", time=time, position=line, velocity=speed)
        learned = qlf.fit([demo], {"pcgmm": found.mixture}, np.zeros(d), QlfParameters())
        assert learned.certificate.margin > 0.0


def test_refusals() -> None:
    position, velocity, lengths = curve(30)
    bad, huge = position.copy(), position.copy()
    bad[11, 1], huge[12, 0] = np.nan, -1e200
    cases: list[tuple[tuple[np.ndarray, ...], str]] = [
        ((bad, velocity, lengths), "position is not finite at sample 11"),
        ((position, bad, lengths), "velocity is not finite at sample 11"),
        ((huge, velocity, lengths), r"position is 1e\+200 at sample 12: check its unit"),
        ((position[:3], velocity[:3], np.array([3])), "a mixture in 2 dimensions needs at least 4 points, not 3"),
        ((position[:1], velocity[:1], np.array([1])), "a mixture in 2 dimensions needs at least 4 points, not 1"),
        ((position[:0], velocity[:0], np.array([], int)), "a mixture in 2 dimensions needs at least 4 points, not 0"),
        ((np.zeros((90, 2)), velocity, lengths), "all points are the same: a demonstration must move"),
        ((np.full((90, 2), 0.3), velocity, lengths), "all points are the same: a demonstration must move"),
        ((position, velocity[:-1], lengths), r"must both have shape \(n, d\); they have \(90, 2\) and \(89, 2\)"),
        ((position, velocity[:, :1], lengths), r"must both have shape \(n, d\); they have \(90, 2\) and \(90, 1\)"),
        ((position[:, 0], velocity[:, 0], lengths), r"must both have shape \(n, d\); they have \(90,\) and \(90,\)"),
        ((position, velocity, np.array([30, 30])), "must sum to the 90 samples there are, not 60"),
        ((position, velocity, np.array([100, -10])), r"must be a row of positive numbers, not \[100 -10\]"),
    ]
    for data, message in cases:
        for points in (20, 500):
            with pytest.raises(DataError, match=rf"^training data: .*{message}\.$"):
                fit(data, replace(QUICK, points=points))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("alpha", 0.0, "must be more than 0, not 0.0"),
        ("alpha", math.nan, "must be a finite number, not nan"),
        ("kappa", -1.0, "must be more than 0, not -1.0"),
        ("length_scale", 0.0, "must be at least 1e-06, not 0.0"),
        ("length_scale", 1e200, r"must be at most 1e\+06, not 1e\+200"),
        ("variance_floor", 0.0, "must be at least 1e-10, not 0.0"),
        ("variance_floor", math.inf, "must be a finite number, not inf"),
        ("sweeps", 0, "must be at least 1, not 0"),
        ("chains", 0, "must be at least 1, not 0"),
        ("points", 0, "must be at least 1, not 0"),
        ("points", 5001, "must be at most 5000, not 5001"),
        ("polish", -1, "must be at least 0, not -1"),
    ],
)
def test_parameters_out_of_range(name: str, value: float, message: str) -> None:
    with pytest.raises(ParameterError, match=rf"^mixture\.{name}: {message}\.$"):
        fit(curve(2000), replace(QUICK, **{name: value}))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("alpha", 1e300),
        ("alpha", 1e-300),
        ("kappa", 1e300),
        ("kappa", 1e-300),
        ("length_scale", 1e-6),
        ("length_scale", 1e6),
        ("variance_floor", 1e-10),
        ("variance_floor", 1e3),
        ("polish", 0),
        ("points", 1),
        ("points", 10**9),
    ],
)
@pytest.mark.filterwarnings("error")
def test_extreme_parameters_still_give_a_mixture(name: str, value: float) -> None:
    found = fit(curve(60), replace(QUICK, **{name: value}))
    assert found.mixture.components >= 1
    assert np.isfinite(found.log_posterior).all()
