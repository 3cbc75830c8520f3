"""The sampler of PC-GMM, ref. [32]: its draws, its likelihoods and its log posterior against brute force."""

from __future__ import annotations

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.stats import multivariate_t

from stages.mixture.conjugate import count_constants, log_determinant, log_marginal, moments
from stages.mixture.data import numbered
from stages.mixture.links import draw_link, log_posterior, sweeps
from stages.mixture.pcgmm import similarity
from stages.mixture.seating import Prior, Seating, prior, recount, scratch, seat


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


def test_determinant_of_what_the_floor_holds_up() -> None:
    # Two of three variances at a floor of 1e-10: cofactors would leave nothing of it.
    Q = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    for values in ([1.0, 1e-10, 1e-10], [300.0, 1e-9, 2e-10], [1.0, 1.0, 1e-10]):
        matrix = Q @ np.diag(values) @ Q.T
        assert log_determinant(0.5 * (matrix + matrix.T)) == pytest.approx(np.log(values).sum(), abs=1e-4)


@pytest.mark.parametrize(("n", "d"), [(40, 2), (30, 3), (25, 4)])
@pytest.mark.parametrize("together", [False, True])
def test_tables_stay_what_their_links_and_points_say(n: int, d: int, together: bool) -> None:
    fixed = tiny(n, d)
    state, buffers = seat(fixed, np.maximum(np.arange(n) - 1, 0) if together else None), scratch(fixed)
    assert state.used[0] == (1 if together else n)
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
