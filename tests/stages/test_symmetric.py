"""Inverse, norm, eigenvectors and halves of small symmetric matrices, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from stages.dynamics.program.conic import whole
from stages.dynamics.program.symmetric import diagonalise, invert, norm, write_turn, write_whole


def random_symmetric(rng: np.random.Generator, d: int) -> np.ndarray:
    root = rng.normal(size=(d, d))
    return np.asarray(root + root.T)


@pytest.mark.parametrize("n", [1, 2, 7, 40])
def test_the_inverse_is_numpys(n: int) -> None:
    root = np.random.default_rng(n).normal(size=(n, n))
    matrix = root @ root.T + 0.1 * np.eye(n)
    inverse = matrix.copy()
    assert invert(inverse)
    np.testing.assert_allclose(inverse @ matrix, np.eye(n), atol=1e-10)
    assert norm(matrix) * norm(inverse) == pytest.approx(np.linalg.cond(matrix, 1))


@pytest.mark.parametrize("matrix", [[[0.0]], [[1.0, 2.0], [2.0, 1.0]], [[1.0, 1.0], [1.0, 1.0]], [[np.nan]]])
def test_what_is_not_positive_definite_is_not_inverted(matrix: list[list[float]]) -> None:
    assert not invert(np.array(matrix))


@pytest.mark.parametrize("d", [1, 2, 3, 4, 7])
def test_eigenvectors_are_those_of_numpy(d: int) -> None:
    rng = np.random.default_rng(d)
    cases = [random_symmetric(rng, d) for _ in range(20)]
    # None to be found, all alike, one alone, far apart, and one that is nearly diagonal already.
    cases += [np.zeros((d, d)), np.eye(d), np.ones((d, d)), np.diag(10.0 ** -np.arange(0, 4 * d, 4.0))]
    cases += [np.eye(d) + 1e-14 * random_symmetric(rng, d)]
    for matrix in cases:
        diagonal, vectors = matrix.copy(), np.empty((d, d))
        diagonalise(diagonal, vectors)
        size = max(1.0, np.abs(matrix).max())
        np.testing.assert_array_equal(diagonal, np.diag(np.diag(diagonal)))
        np.testing.assert_allclose(np.sort(np.diag(diagonal)), np.linalg.eigvalsh(matrix), atol=1e-14 * d * size)
        np.testing.assert_allclose(vectors @ diagonal @ vectors.T, matrix, atol=1e-14 * d * size)
        np.testing.assert_allclose(vectors.T @ vectors, np.eye(d), atol=1e-14 * d)


def test_halves_by_hand() -> None:
    matrix = np.empty((2, 2))
    write_whole(np.array([1.0, 2.0 * np.sqrt(2.0), 3.0]), matrix)
    np.testing.assert_allclose(matrix, [[1.0, 2.0], [2.0, 3.0]], rtol=1e-15)
    # A quarter turn exchanges the axes.
    turn = np.empty((3, 3))
    write_turn(np.array([[0.0, -1.0], [1.0, 0.0]]), turn)
    np.testing.assert_allclose(turn, [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]], atol=1e-15)


@pytest.mark.parametrize("d", [1, 2, 3, 5])
def test_a_half_turns_like_its_matrix(d: int) -> None:
    rng = np.random.default_rng(d)
    m = d * (d + 1) // 2
    half, turn, matrix = rng.normal(size=m), np.empty((m, m)), np.empty((d, d))
    V = np.linalg.qr(rng.normal(size=(d, d)))[0]
    write_turn(V, turn)
    write_whole(half, matrix)
    np.testing.assert_allclose(matrix, whole(half, d), rtol=1e-15)
    np.testing.assert_allclose(whole(turn @ half, d), V @ matrix @ V.T, atol=1e-14)
    np.testing.assert_allclose(turn.T @ turn, np.eye(m), atol=1e-14)
