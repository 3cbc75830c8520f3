"""Ten thousand random certificates against exact rational arithmetic. Run by `make bench`."""

from __future__ import annotations

import time

import numpy as np
import pytest
from rational import random_case, truly_stable

from pipeline.errors import SolverError
from stages.dynamics.certificate import certify, restore

CASES = 10_000
"""Required."""


def claimed(A: np.ndarray, P: np.ndarray, margin: float) -> bool:
    try:
        certify(A[None], P, margin)
    except SolverError:
        return False
    return True


def test_ten_thousand_certificates_and_none_is_unsound() -> None:
    rng = np.random.default_rng(0)
    started = time.perf_counter()
    stable = proved = unsound = clear = timid = 0
    for case in range(CASES):
        A, P, margin = random_case(rng, identity=case % 2 == 0)
        truth, claim = truly_stable(A, P, margin), claimed(A, P, margin)
        stable += truth
        proved += claim
        unsound += claim and not truth
        room = 32 * len(P) ** 2 * 2.0**-53 * np.abs(A).max() * np.abs(P).max()
        if truth and truly_stable(A, P, margin + room):
            clear += 1
            timid += not claim
    print(
        f"\n{CASES} certificates at the edge, dimensions 2 to 7: {stable} hold, {proved} proved, {unsound} unsound; "
        f"of {clear} that hold by 32 d^2 roundings {timid} not proved ({time.perf_counter() - started:.0f} s)"
    )
    assert unsound == 0
    # The cases do straddle the boundary, and the proof is not merely timid.
    assert 0.3 * CASES < stable < 0.7 * CASES
    assert clear > 0.1 * CASES
    assert timid == 0


def test_a_thousand_restored_matrices_hold_exactly() -> None:
    rng = np.random.default_rng(1)
    shifted = 0
    for case in range(1000):
        A, P, margin = random_case(rng, identity=case % 2 == 0)
        restored, certificate = restore(A[None], P, margin)
        assert truly_stable(restored[0], P, margin)
        shifted += bool(certificate.shift[0] > 0.0)
    print(f"1000 restored: {shifted} had to be shifted, all hold")
    assert shifted > 300


@pytest.mark.parametrize("d", range(2, 8))
def test_a_positive_eigenvalue_of_1e_7_is_refused(d: int) -> None:
    rng = np.random.default_rng(d)
    for _ in range(100):
        root = rng.normal(size=(d, d))
        P = root @ root.T + 0.1 * np.eye(d)
        P *= d / np.trace(P)
        Q = np.linalg.qr(rng.normal(size=(d, d)))[0]
        skew = rng.normal(size=(d, d))
        broken = 0.5 * (Q * [1e-7, *-rng.uniform(0.1, 2.0, d - 1)]) @ Q.T + skew - skew.T
        A = np.linalg.solve(P, broken)
        with pytest.raises(SolverError, match="could not be proved stable"):
            certify(A[None], 0.5 * (P + P.T), 0.0)
