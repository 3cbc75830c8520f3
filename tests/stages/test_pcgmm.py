"""PC-GMM, ref. [32]: the sampler against brute force, and the properties that the mixture is chosen for."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.stats import multivariate_t

from pipeline.errors import DataError, ParameterError
from stages.mixture.conjugate import count_constants, log_determinant, log_marginal, moments
from stages.mixture.data import by_arc_length, normalisation, numbered
from stages.mixture.em import fit_em
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import log_densities
from stages.mixture.links import Prior, Seating, draw_link, log_posterior, prior, recount, scratch, seat, sweeps
from stages.mixture.parameters import EmParameters, PcGmmParameters
from stages.mixture.pcgmm import components_of, fit_pcgmm, similarity

QUICK = PcGmmParameters(sweeps=15, points=150)


def marginal(points: np.ndarray, kappa: float, scatter: np.ndarray) -> float:
    constants = count_constants(len(points), kappa, scatter)
    return log_marginal(moments(points).sum(axis=0), kappa, scatter, constants, np.zeros_like(scatter))


def tiny(n: int, d: int, seed: int = 0) -> Prior:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, d))
    points -= points.mean(axis=0)
    alike = similarity(points, rng.normal(size=(n, d)), 0.9)
    return prior(points, alike, 0.7, 1.3, np.cov(points.T, bias=True) + np.eye(d))


def tables_of(link: np.ndarray) -> np.ndarray:
    n = len(link)
    return connected_components(sparse.coo_matrix((np.ones(n), (np.arange(n), link)), shape=(n, n)))[1]


def brute_force_log_posterior(link: np.ndarray, fixed: Prior) -> float:
    """From the definitions alone: the links' normalised prior, and every table's likelihood from its own points."""
    n, d = len(link), len(fixed.scatter)
    points = fixed.moments[:, 1 : 1 + d]
    weights = fixed.similarity.copy()
    weights[np.arange(n), np.arange(n)] = fixed.alpha
    result = float(np.log(weights[np.arange(n), link] / weights.sum(axis=1)).sum())
    tables = tables_of(link)
    return result + sum(marginal(points[tables == t], fixed.kappa, fixed.scatter) for t in np.unique(tables))


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
    np.testing.assert_allclose(s, s.T)
    np.testing.assert_array_equal(s, similarity(points, 1e-3 * velocity, 0.5))


@pytest.mark.parametrize("d", [1, 2, 3, 4, 7])
def test_determinant(d: int) -> None:
    root = np.random.default_rng(d).normal(size=(d, d))
    matrix = root @ root.T + 0.1 * np.eye(d)
    assert log_determinant(matrix.copy()) == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-11)


@pytest.mark.parametrize("d", [1, 2, 3, 5])
def test_marginal_is_the_product_of_student_predictives(d: int) -> None:
    # The chain rule: each point given those before it is Student's t with parameters of the updated prior.
    rng = np.random.default_rng(d)
    points, kappa = rng.normal(size=(6, d)), 0.8
    scatter = np.eye(d) + 0.3
    expected = 0.0
    for n, x in enumerate(points):
        seen = points[:n]
        kappa_n, nu_n = kappa + n, d + n
        mean = seen.sum(axis=0) / kappa_n
        updated = scatter + seen.T @ seen - kappa_n * np.outer(mean, mean)
        freedom = nu_n - d + 1
        shape = updated * (kappa_n + 1) / (kappa_n * freedom)
        expected += multivariate_t(mean, shape, freedom).logpdf(x)
    assert marginal(points, kappa, scatter) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize(("n", "d"), [(40, 2), (30, 3), (25, 4)])
def test_tables_stay_what_their_links_and_points_say(n: int, d: int) -> None:
    fixed = tiny(n, d)
    state, buffers = seat(fixed), scratch(fixed)
    rng = np.random.default_rng(0)
    tables_met = set()
    for i in rng.integers(0, n, 1500):
        draw_link(int(i), rng.random(), rng.random(), state, fixed, buffers)
        tables_met.add(int(state.used[0]))
    assert len(tables_met) > 2  # tables were split and joined
    # Same partition as the connected components of the links.
    expected = tables_of(state.link)
    assert len(set(zip(expected, state.table, strict=True))) == len(set(expected)) == state.used[0]
    # Incremental statistics against a recount from scratch.
    fresh = Seating(*(np.copy(part) for part in state))
    recount(fresh, fixed, buffers)
    used = state.active[: state.used[0]]
    np.testing.assert_allclose(state.tables[used], fresh.tables[used], atol=1e-11)
    np.testing.assert_allclose(state.marginal[used], fresh.marginal[used], atol=1e-9)
    np.testing.assert_allclose(log_posterior(state, fixed), brute_force_log_posterior(state.link, fixed), rtol=1e-11)
    # The lists of back-links against the links.
    for j in range(n):
        linked, i = [], state.first[j]
        while i >= 0:
            linked.append(int(i))
            i = state.after[i]
        assert sorted(linked) == np.flatnonzero(state.link == j).tolist()


@pytest.mark.parametrize("link", [[1, 1, 3, 3, 4], [1, 2, 0, 3, 3], [0, 1, 2, 3, 4]], ids=["chain", "ring", "alone"])
@pytest.mark.parametrize("d", [2, 3])
def test_conditional_distribution_of_a_link_agrees_with_enumeration(d: int, link: list[int]) -> None:
    fixed = tiny(5, d, seed=d)
    start, buffers = seat(fixed, np.array(link)), scratch(fixed)
    for i in range(5):
        posterior = np.zeros(5)
        for j in range(5):
            other = np.array(link)
            other[i] = j
            posterior[j] = brute_force_log_posterior(other, fixed)
        expected = np.exp(posterior - posterior.max())
        drawn = np.zeros(5)
        # A grid of uniforms instead of random ones: exact up to its spacing.
        for u_table, u_point in itertools.product((np.arange(80) + 0.5) / 80, (np.arange(40) + 0.5) / 40):
            state = Seating(*(part.copy() for part in start))
            draw_link(i, u_table, u_point, state, fixed, buffers)
            drawn[state.link[i]] += 1.0 / 3200
        np.testing.assert_allclose(drawn, expected / expected.sum(), atol=0.015)


def test_the_chain_visits_partitions_by_their_posterior() -> None:
    fixed = tiny(4, 2, seed=11)
    expected: Counter[tuple[int, ...]] = Counter()
    for link in itertools.product(range(4), repeat=4):
        weight = math.exp(brute_force_log_posterior(np.array(link), fixed))
        expected[tuple(numbered(tables_of(np.array(link))))] += weight
    rng, count = np.random.default_rng(0), 30_000
    state, buffers = seat(fixed), scratch(fixed)
    posterior, tables, best = np.zeros(1), np.zeros(1, dtype=np.int64), np.zeros(4, dtype=np.int64)
    orders = rng.permuted(np.tile(np.arange(4), (count, 1)), axis=1)
    visits: Counter[tuple[int, ...]] = Counter()
    for order, uniforms in zip(orders, rng.random((count, 4, 2)), strict=True):
        sweeps(state, fixed, buffers, order[None], uniforms[None], posterior, tables, best)
        visits[tuple(numbered(best))] += 1
    assert len(expected) == 15  # all partitions of four points
    assert max(expected.values()) < 0.5 * sum(expected.values())
    for partition, weight in expected.items():
        # Four standard errors of 30,000 draws that are somewhat correlated.
        assert visits[partition] / count == pytest.approx(weight / sum(expected.values()), abs=0.015), partition


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
    assert found.log_posterior.shape == found.components_by_sweep.shape == (QUICK.sweeps,)
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


def test_a_demonstration_that_ends_standing_still() -> None:
    position, velocity, lengths = curve()
    velocity = velocity.copy()
    velocity[-20:] = 0.0
    assert np.isfinite(fit((position, velocity, lengths)).log_posterior).all()


def test_a_straight_line_is_held_up_by_the_floor() -> None:
    position = np.linspace([0.1, 0.2], [0.0, 0.0], 100)
    found = fit((position, np.full((100, 2), -1.0), np.array([100])))
    radius = normalisation(position[found.sampled]).radius
    assert np.linalg.eigvalsh(found.mixture.covariances).min() >= 0.99 * QUICK.variance_floor * radius**2


def test_refusals() -> None:
    position, velocity, lengths = curve(30)
    bad = position.copy()
    bad[11, 1] = np.nan
    cases: list[tuple[tuple[np.ndarray, ...], str]] = [
        ((bad, velocity, lengths), "position is not finite at sample 11"),
        ((position, bad, lengths), "velocity is not finite at sample 11"),
        ((position[:3], velocity[:3], np.array([3])), "needs at least 4 points, not 3"),
        ((np.zeros((90, 2)), velocity, lengths), "a demonstration must move"),
        ((np.full((90, 2), 0.3), velocity, lengths), "a demonstration must move"),
        ((position, velocity[:-1], lengths), "must both have shape"),
        ((position, velocity, np.array([30, 30])), "sum to 90"),
    ]
    for data, message in cases:
        for points in (20, 500):
            with pytest.raises(DataError, match=message):
                fit(data, replace(QUICK, points=points))
    for name in ("alpha", "length_scale", "kappa", "variance_floor", "sweeps", "points"):
        with pytest.raises(ParameterError, match=rf"mixture\.{name}"):
            fit((position, velocity, lengths), replace(QUICK, **{name: 0}))
    with pytest.raises(ParameterError, match=r"mixture\.polish"):
        fit((position, velocity, lengths), replace(QUICK, polish=-1))
    assert fit((position, velocity, lengths), replace(QUICK, polish=0)).mixture.components >= 1
