"""The errors a user can cause, as one tree, and the exit codes of the command line.

Every message is one sentence that names the file or the dotted parameter, what was wrong, what would be right and,
where there is one, the command that helps. Data stays on the error as fields.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

EXIT_DONE = 0
EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_STALE = 3
EXIT_MISMATCH = 4


class ClpvError(Exception):
    """Anything a user may cause; `exit_code` is what the command line returns for it."""

    exit_code = EXIT_FAILED


class UsageError(ClpvError):
    """A name, an option, a parameter or a file of parameters is wrong."""

    exit_code = EXIT_USAGE


class ParameterError(UsageError):
    """A parameter is unknown or has a wrong type or value.

    Attributes:
        location: dotted place of the parameter, e.g. ``mixture.alpha``.
    """

    def __init__(self, location: str, problem: str) -> None:
        super().__init__(f"{location}: {problem}")
        self.location = location
        self.problem = problem

    def __reduce__(self) -> tuple[type[ParameterError], tuple[str, str]]:
        return type(self), (self.location, self.problem)


class DataError(ClpvError):
    """Recorded or derived data cannot be used; `source` names the file, the demonstration or the artifact."""

    def __init__(self, source: str, problem: str) -> None:
        super().__init__(f"{source}: {problem}")
        self.source = source
        self.problem = problem

    def __reduce__(self) -> tuple[type[DataError], tuple[str, str]]:
        return type(self), (self.source, self.problem)


class SolverError(ClpvError):
    """A numerical program did not reach an acceptable answer.

    Attributes:
        status: what the solver said.
        residuals: named residuals of its last iterate.
        program: the arrays and numbers of the program by name, to be saved for study, or None.
    """

    def __init__(
        self, problem: str, status: str, residuals: dict[str, float], program: Mapping[str, Any] | None = None
    ) -> None:
        super().__init__(problem)
        self.problem = problem
        self.status = status
        self.residuals = residuals
        self.program = program

    def __reduce__(self) -> tuple[type[SolverError], tuple[str, str, dict[str, float], Mapping[str, Any] | None]]:
        return type(self), (self.problem, self.status, self.residuals, self.program)


class StoreError(ClpvError):
    """The store or the folder of runs cannot be read or written."""


class ExecutionError(ClpvError):
    """A stage failed; `stage` and `point` say where."""

    def __init__(self, message: str, stage: str, point: str) -> None:
        super().__init__(message)
        self.message = message
        self.stage = stage
        self.point = point

    def __reduce__(self) -> tuple[type[ExecutionError], tuple[str, str, str]]:
        return type(self), (self.message, self.stage, self.point)


class StaleError(ClpvError):
    """Results are asked for that have not been computed, or are out of date."""

    exit_code = EXIT_STALE


class MismatchError(ClpvError):
    """A recomputation does not agree with the manifest."""

    exit_code = EXIT_MISMATCH


def choices(wrong: str, valid: Iterable[str]) -> str:
    """End of a sentence that names the nearest valid name, where there is one, and all of them."""
    names = sorted(valid)
    near = difflib.get_close_matches(wrong, names, n=1, cutoff=0.6)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{hint}Valid: {', '.join(names)}."
