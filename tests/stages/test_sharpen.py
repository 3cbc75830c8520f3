"""Newton's method on the optimality conditions: exact where it arrives, and without a trace where it does not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stages.dynamics.program.conic import SOLVED, Answer, Limits, limits, minimise_gram, pull, slack, whole
from stages.dynamics.program.sharpen import ACCURACY, sharpen

Program = tuple[np.ndarray, np.ndarray, Limits]


def program(K: int, d: int, coupled: bool, seed: int) -> Program:
    """A random one of condition 1e4 or so; about half of the constraints bind."""
    rng = np.random.default_rng([K, d, seed])
    side = d * K * d if coupled else K * d
    root = rng.normal(size=(side, side)) * np.logspace(0.0, -1.0, side)
    gram = root @ root.T / side + 1e-4 * np.eye(side)
    axes = rng.normal(size=(d, d))
    P = axes @ axes.T + 0.3 * np.eye(d)
    return gram, 0.1 * rng.normal(size=(d, K * d)), limits(P * (d / np.trace(P)), rng.uniform(0.01, 0.1, K))


def left(program: Program, x: np.ndarray, z: np.ndarray) -> float:
    """The norm of the gradient and of S - proj(S - Z), as one would write them down."""
    gram, cross, constraints = program
    d, K = len(cross), len(constraints.bounds)
    B = x.reshape(d, K, d)
    image = gram @ x if gram.shape[0] == x.size else (x.reshape(d, K * d) @ gram).ravel()
    gradient = 2.0 * (image - cross.ravel()) + pull(constraints, z).ravel()
    S, Z = whole(slack(constraints, B), d), whole(z, d)
    values, vectors = np.linalg.eigh(S - Z)
    apart = S - np.einsum("kia,ka,kja->kij", vectors, np.maximum(values, 0.0), vectors)
    return float(np.sqrt((gradient**2).sum() + (apart**2).sum()))


def test_a_projection_by_hand() -> None:
    # |B - M|^2 with B + B' <= 0: the nearest matrix has the symmetric part diag(0, -1), and Z takes the rest.
    M = np.array([[1.0, -2.0], [2.0, -1.0]])
    constraints = limits(np.eye(2), np.zeros(1))
    answer = Answer(np.array([1e-4, -2.0, 2.0, -1.0]), np.array([[0.999, 0.0, 1e-4]]), SOLVED, 7)
    found = sharpen(np.eye(2), M, constraints, answer)
    np.testing.assert_allclose(found.x, [0.0, -2.0, 2.0, -1.0], atol=1e-15)
    # 2 (B - M) + 2 Z = 0.
    np.testing.assert_allclose(found.z, [[1.0, 0.0, 0.0]], atol=1e-15)
    assert (found.status, found.iterations) == (SOLVED, 7)
    assert 0 < found.refinements <= 3


@pytest.mark.parametrize("d", [1, 2, 3])
def test_a_constraint_that_is_active_without_a_multiplier_by_hand(d: int) -> None:
    # The unconstrained minimum M lies on the boundary: S and Z share a zero, where Newton's method on S Z = 0 stalls.
    skew = np.triu(np.full((d, d), 0.7), 1)
    M = skew - skew.T - np.diag(np.arange(d) + 0.05)
    constraints = limits(np.eye(d), np.array([0.1]))
    rough = minimise_gram(np.eye(d), M, constraints, loose=True)
    found = sharpen(np.eye(d), M, constraints, rough)
    assert np.abs(rough.x - M.ravel()).max() > 1e-5
    np.testing.assert_allclose(found.x, M.ravel(), atol=1e-14)
    np.testing.assert_allclose(found.z, 0.0, atol=1e-14)
    assert 0 < found.refinements <= 4


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize(("K", "d"), [(1, 1), (6, 2), (3, 3), (2, 5)])
def test_a_loose_answer_becomes_exact_in_few_steps(K: int, d: int, coupled: bool) -> None:
    active = compared = 0
    for seed in range(20):
        given = program(K, d, coupled, seed)
        rough = minimise_gram(*given, loose=True)
        before, kept = left(given, rough.x, rough.z), (rough.x.copy(), rough.z.copy())
        found = sharpen(*given, rough)
        assert 0 < found.refinements <= 6
        assert left(given, found.x, found.z) < 1e-14 * max(1.0, float(np.linalg.norm(found.x))) < 1e-3 * before
        # From the solver's best answer, if it has one, the same point is reached.
        again = sharpen(*given, minimise_gram(*given, loose=False))
        if again.status == SOLVED:
            np.testing.assert_allclose(again.x, found.x, atol=1e-10 * np.abs(found.x).max())
            np.testing.assert_allclose(again.z, found.z, atol=1e-12)
            compared += 1
        assert rough.x.tobytes() == kept[0].tobytes()
        assert rough.z.tobytes() == kept[1].tobytes()
        # The constraints hold, and the multipliers have their sign.
        S, Z = whole(slack(given[2], found.x.reshape(d, K, d)), d), whole(found.z, d)
        size = np.abs(found.x).max()
        assert np.linalg.eigvalsh(S).min() > -1e-14 * max(1.0, size)
        assert np.linalg.eigvalsh(Z).min() > -1e-14
        np.testing.assert_allclose(S @ Z, 0.0, atol=1e-13 * max(1.0, size))
        active += int((np.linalg.eigvalsh(Z) > 1e-6).any())
    assert active > 5
    assert compared > 10


@given(st.integers(0, 10_000), st.floats(-8.0, 4.0), st.booleans(), st.integers(1, 3))
def test_no_answer_becomes_worse(seed: int, power: float, coupled: bool, d: int) -> None:
    given = program(3, d, coupled, seed % 20)
    rng = np.random.default_rng(seed)
    exact = sharpen(*given, minimise_gram(*given, loose=True))
    x, z = (
        exact.x + 10.0**power * rng.normal(size=exact.x.shape),
        exact.z + 10.0**power * rng.normal(size=exact.z.shape),
    )
    found = sharpen(*given, exact._replace(x=x, z=z, refinements=0))
    before, after = left(given, x, z), left(given, found.x, found.z)
    if found.refinements:
        assert after < before
        assert after < 2.0 * ACCURACY * max(1.0, float(np.linalg.norm(x)))
    else:
        assert found.x is x
        assert found.z is z
    # What is near enough is always taken.
    assert found.refinements or power > -4.0


def test_what_does_not_arrive_stays() -> None:
    given = program(6, 2, False, 1)
    rough = minimise_gram(*given, loose=True)
    for answer in (rough._replace(status="AlmostSolved"), rough._replace(x=np.full_like(rough.x, np.nan))):
        assert sharpen(*given, answer) is answer
    gram, cross, constraints = given
    # A condition of 1e11 is refused, one of 1e9 is not.
    values, vectors = np.linalg.eigh(gram)
    for least, refused in ((1e-11, True), (1e-9, False)):
        values[0] = least * values[-1]
        worse = (vectors * values) @ vectors.T
        answer = minimise_gram(worse, cross, constraints, loose=True)
        assert answer.status == SOLVED
        assert (sharpen(worse, cross, constraints, answer) is answer) == refused
    assert sharpen(-gram, cross, constraints, rough) is rough
