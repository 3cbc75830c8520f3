"""A program that could not be solved, kept in a file for study: `SolverError.program` as an archive of numpy arrays.

No artifact: nothing reads it but a person who asks why. Not here: the program itself (`solve.py`).
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import DataError
from stages.dynamics.program.regression import Block, LeastSquares, Ridge

_ARGUMENTS = ("margin", "lyapunov_matrix", "tolerance", "loose")


def save_problem(path: Path, program: Mapping[str, Any]) -> None:
    """Write the program of a `SolverError` to a file, whose name should end in ``.npz``, as a whole or not at all.

    Raises OSError: the file cannot be written.
    """
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, allow_pickle=False, **{name: np.asarray(value) for name, value in program.items()})
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def load_problem(path: Path) -> tuple[LeastSquares, dict[str, Any]]:
    """Return a saved program: ``solve(problem, **arguments)`` fails as it did.

    Raises DataError: the file is not a saved program. OSError: it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            program = {name: archive[name] for name in archive.files}
        arguments = {name: program[name] if program[name].ndim else program[name].item() for name in _ARGUMENTS}
        ridge = None
        if "ridge_weights" in program:
            ridge = Ridge(weights=program["ridge_weights"], centres=program["ridge_centres"])
        problem = LeastSquares(
            gram=program["gram"],
            cross=program["cross"],
            mean_square_distance=float(program["mean_square_distance"]),
            mean_square_speed=float(program["mean_square_speed"]),
            ridge=ridge,
            rows=_rows(program) if "factor" in program else None,
        )
    except (ValueError, KeyError, EOFError) as error:
        raise DataError(str(path), f"is not a saved program ({error}).") from None
    return problem, arguments


def _rows(program: Mapping[str, Any]) -> Any:
    """Return what yields a triangle as if its rows were samples, and below it a row for the rest."""
    factor, target = program["factor"], program["target"]
    last = np.zeros((1, target.shape[1]))
    last[0, 0] = np.sqrt(program["rest"])
    design = np.concatenate([factor, np.zeros((1, factor.shape[1]))])
    block = Block(design, np.concatenate([target, last]), np.ones(len(design)))

    def rows() -> Iterator[Block]:
        yield block

    return rows
