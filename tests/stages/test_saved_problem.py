"""A program that failed is saved whole, and fails again when it is loaded."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import DataError, SolverError
from stages.dynamics.program import solve as module
from stages.dynamics.program.regression import gather, with_ridge
from stages.dynamics.program.saved import load_problem, save_problem
from stages.dynamics.program.solve import solve


def failure(weight: float, coupled: bool, form: str = "qr") -> SolverError:
    """Nearly coincident components, and more accuracy asked for than there is."""
    rng = np.random.default_rng(0)
    z = rng.normal(size=(60, 2))
    features = np.hstack([(0.5 + 1e-9 * z[:, :1]) * z, (0.5 - 1e-9 * z[:, :1]) * z])
    W = np.tile(np.eye(2), (60, 1, 1)) if coupled else None
    problem = gather(features, -z + 0.1 * rng.normal(size=(60, 2)), inverse_jacobian=W)
    if weight > 0.0:
        problem = with_ridge(problem, weight)
    with pytest.raises(SolverError, match="not accurate enough") as caught:
        solve(problem, 0.1, np.diag([1.5, 0.5]), tolerance=1e-25)
    return caught.value


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("weight", [0.0, 1e-3])
def test_a_saved_problem_fails_as_it_did(tmp_path: Path, weight: float, coupled: bool) -> None:
    error = failure(weight, coupled)
    assert error.program is not None
    path = tmp_path / "failed.npz"
    save_problem(path, error.program)
    assert [file.name for file in tmp_path.iterdir()] == ["failed.npz"]
    problem, arguments = load_problem(path)
    with pytest.raises(SolverError) as caught:
        solve(problem, **arguments)
    assert str(caught.value) == str(error) or caught.value.residuals == pytest.approx(error.residuals, abs=1e-9)
    assert caught.value.status == error.status
    # All of it is there: with a tolerance that can be met it is solved, in the same form.
    arguments["tolerance"] = 1e-6
    found = solve(problem, **arguments)
    assert found.form == ("qr" if weight == 0.0 else "gram")
    np.testing.assert_array_equal(problem.gram, error.program["gram"])
    assert (problem.ridge is not None) == (weight > 0.0)


def test_an_error_keeps_its_program_between_processes() -> None:
    error = failure(0.0, False)
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    np.testing.assert_array_equal(again.program["factor"], error.program["factor"])


def test_the_first_failure_is_the_one_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> object:
        raise SolverError(f"attempt {_[2]}", "x", {})

    monkeypatch.setattr(module, "_attempt", refuse)
    rng = np.random.default_rng(0)
    z = rng.normal(size=(60, 2))
    with pytest.raises(SolverError, match="attempt gram"):
        solve(gather(z, -z), 0.1)


def test_what_is_not_a_saved_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "failed.npz"
    path.write_bytes(b"no archive")
    with pytest.raises(DataError, match="is not a saved program"):
        load_problem(path)
    np.savez(path, gram=np.eye(2))
    with pytest.raises(DataError, match="is not a saved program"):
        load_problem(path)


def test_an_interrupted_write_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "failed.npz"
    path.write_bytes(b"before")

    def interrupted(file: object, **_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez", interrupted)
    with pytest.raises(OSError, match="disk full"):
        save_problem(path, {"gram": np.eye(2)})
    assert path.read_bytes() == b"before"
    assert [file.name for file in tmp_path.iterdir()] == ["failed.npz"]
