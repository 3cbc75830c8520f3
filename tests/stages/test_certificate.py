"""The proof of stability, checked against exact rational arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from rational import exact, is_positive_definite, random_case, truly_stable

from pipeline.errors import SolverError
from stages.dynamics.certificate import certify, proofs, restore


def test_the_exact_check_by_hand() -> None:
    # Leading minors 2 and 2 * 0.5 - 1 = 0; a little more or less on the diagonal decides.
    edge = np.array([[2.0, 1.0], [1.0, 0.5]])
    assert not is_positive_definite(exact(edge))
    assert is_positive_definite(exact(edge + np.diag([0.0, 2.0**-53])))
    assert not is_positive_definite(exact(edge - np.diag([0.0, 2.0**-53])))
    assert not is_positive_definite(exact(np.diag([1.0, -1.0, -1.0])))
    assert truly_stable(np.array([[-1.0, 3.0], [-3.0, -0.5]]), np.eye(2), 0.999)
    assert not truly_stable(np.array([[-1.0, 3.0], [-3.0, -0.5]]), np.eye(2), 1.0)


@pytest.mark.parametrize("identity", [True, False])
def test_no_proof_is_wrong(identity: bool) -> None:
    rng = np.random.default_rng(0)
    proved = refused = stable = 0
    for _ in range(400):
        A, P, margin = random_case(rng, identity=identity, dimensions=(2, 4))
        truth = truly_stable(A, P, margin)
        claim = bool(proofs(A[None], P, margin)[0])
        assert truth or not claim
        proved += claim
        refused += not claim
        stable += truth
    # The cases do straddle the boundary, and the proof is not merely timid.
    assert 100 < stable < 300
    assert proved > 0.3 * stable
    assert refused > 100


@pytest.mark.parametrize("identity", [True, False])
def test_no_proof_is_wrong_in_higher_dimensions_and_what_is_clear_of_rounding_is_proved(identity: bool) -> None:
    rng = np.random.default_rng(4)
    clear = 0
    for _ in range(300):
        A, P, margin = random_case(rng, identity=identity, dimensions=(5, 7))
        claim = bool(proofs(A[None], P, margin)[0])
        assert truly_stable(A, P, margin) or not claim
        room = 32 * len(P) ** 2 * 2.0**-53 * np.abs(A).max() * np.abs(P).max()
        if truly_stable(A, P, margin + room):
            assert claim
            clear += 1
    assert clear > 10


def test_matrices_well_inside_are_proved() -> None:
    rng = np.random.default_rng(1)
    for d in range(1, 8):
        skew = 1e3 * rng.normal(size=(20, d, d))
        matrices = skew - skew.transpose(0, 2, 1) - 0.5000001e-3 * np.eye(d)
        certificate = certify(matrices, np.eye(d), 0.999e-3)
        assert certificate.margin == 0.999e-3
        assert (certificate.shift == 0.0).all()
        np.testing.assert_allclose(certificate.largest_eigenvalues, -1e-3, rtol=1e-3)


def test_largest_eigenvalue_by_hand() -> None:
    A = np.array([[[-1.0, 3.0], [1.0, -2.0]], [[-1.0, 5.0], [-5.0, -1.0]]])
    # A + A' = [[-2, 4], [4, -4]]: -3 +- sqrt(17); the second is -2 I.
    assert proofs(A, np.eye(2), 0.0).tolist() == [False, True]
    with pytest.raises(SolverError, match="Component 0"):
        certify(A, np.eye(2), 0.0)
    np.testing.assert_allclose(certify(A[1:], np.eye(2), 1.9).largest_eigenvalues, [-2.0])


@pytest.mark.parametrize("excess", [1e-7, 1e-12, 0.0])
def test_an_eigenvalue_that_is_not_negative_is_refused(excess: float) -> None:
    A = np.diag([-1.0, 0.5 * excess])
    with pytest.raises(SolverError, match="could not be proved stable") as caught:
        certify(A[None], np.eye(2), 0.0)
    assert caught.value.status == "not certified"
    assert caught.value.residuals["largest_eigenvalue"] == pytest.approx(excess, abs=1e-15)


@pytest.mark.parametrize("d", [2, 3, 7])
def test_a_positive_eigenvalue_of_1e_7_is_refused_under_a_general_lyapunov_matrix(d: int) -> None:
    rng = np.random.default_rng(d)
    root = rng.normal(size=(d, d))
    P = root @ root.T + 0.5 * np.eye(d)
    Q = np.linalg.qr(rng.normal(size=(d, d)))[0]
    skew = rng.normal(size=(d, d))
    for excess, accepted in ((1e-7, False), (-1e-7, True)):
        # A'P + PA = Q diag(excess, -1, ..., -1) Q'.
        half = 0.5 * (Q * [excess, *-np.ones(d - 1)]) @ Q.T + skew - skew.T
        A = np.linalg.solve(P, half)
        if accepted:
            assert certify(A[None], P, 0.0).largest_eigenvalues[0] == pytest.approx(excess, rel=1e-5)
        else:
            with pytest.raises(SolverError, match="Component 0 could not be proved stable"):
                certify(A[None], P, 0.0)


def test_what_cannot_be_a_lyapunov_function_is_refused() -> None:
    A = -np.eye(2)[None]
    for P in (
        [[1.0, 2.0], [2.0, 1.0]],
        [[1.0, 0.1], [0.0, 1.0]],
        [[1.0, 0.0], [0.0, 0.0]],
        [[np.nan, 0.0], [0.0, 1.0]],
    ):
        with pytest.raises(SolverError, match="P could not be proved"):
            certify(A, np.array(P), 0.0)
    for margin in (-1.0, np.nan, np.inf):
        with pytest.raises(SolverError, match="cannot be certified"):
            certify(A, np.eye(2), margin)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e308])
def test_what_is_not_finite_is_refused(bad: float) -> None:
    A = np.array([[[-1.0, 0.0], [0.0, -1.0]], [[-1.0, bad], [bad, -1.0]]])
    assert proofs(A, np.eye(2), 0.0).tolist() == [True, False]
    with pytest.raises(SolverError, match="Component 1"):
        restore(A, np.eye(2), 0.0)


def test_restoring_shifts_only_what_fails_and_little_more_than_needed() -> None:
    margin = 1e-3
    A = np.array([[[-1.0, 7.0], [-7.0, 0.5 * (-margin + 3e-9)]], [[-1.0, 0.0], [0.0, -2.0]]])
    restored, certificate = restore(A, np.eye(2), margin)
    assert certificate.shift[0] == pytest.approx(1.5e-9, rel=1e-3)
    assert certificate.shift[1] == 0.0
    np.testing.assert_allclose(restored[0], A[0] - certificate.shift[0] * np.eye(2), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(restored[1], A[1])
    assert truly_stable(restored[0], np.eye(2), margin)


@pytest.mark.parametrize("identity", [True, False])
def test_restoring_proves_every_case_near_the_boundary(identity: bool) -> None:
    rng = np.random.default_rng(2)
    for _ in range(150):
        A, P, margin = random_case(rng, identity=identity)
        restored, certificate = restore(A[None], P, margin)
        assert truly_stable(restored[0], P, margin)
        assert 0.0 <= certificate.shift[0] <= 1e-9 * np.abs(A).max() * np.linalg.cond(P)


def test_no_lyapunov_matrix_is_wrongly_called_positive_definite() -> None:
    rng = np.random.default_rng(3)
    accepted = indefinite = 0
    for _ in range(300):
        d = int(rng.integers(2, 6))
        Q = np.linalg.qr(rng.normal(size=(d, d)))[0]
        values = rng.random(d)
        values[0] = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-18, -13)
        P = (Q * values) @ Q.T
        P = 0.5 * (P + P.T)
        truth = is_positive_definite(exact(P))
        try:
            proofs(-np.eye(d)[None], P, 0.0)
        except SolverError:
            claim = False
        else:
            claim = True
        assert truth or not claim
        accepted += claim
        indefinite += not truth
    assert accepted > 30
    assert indefinite > 100
