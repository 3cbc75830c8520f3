"""Errors: they survive the way back from a worker, and name the valid choices."""

from __future__ import annotations

import pickle

import pytest

from pipeline import errors
from pipeline.errors import choices

EVERY = [
    errors.ClpvError("x."),
    errors.UsageError("x."),
    errors.ParameterError("fit.offset", "wrong."),
    errors.DataError("file.mat", "wrong."),
    errors.SolverError("no solution.", "infeasible", {"primal": 1.0}),
    errors.StoreError("x."),
    errors.ExecutionError("stage fit failed.", "fit", "main"),
    errors.StaleError("x."),
    errors.MismatchError("x."),
]


@pytest.mark.parametrize("error", EVERY, ids=lambda error: type(error).__name__)
def test_an_error_survives_pickling(error):
    found = pickle.loads(pickle.dumps(error))
    assert (type(found), str(found), vars(found)) == (type(error), str(error), vars(error))
    assert found.exit_code == error.exit_code


def test_every_error_is_tested():
    classes = {value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, Exception)}
    assert classes == {type(error) for error in EVERY}


@pytest.mark.parametrize(
    ("wrong", "valid", "sentence"),
    [
        ("Agnle", ["Sine", "Angle"], "did you mean 'Angle'? Valid: Angle, Sine."),
        ("x", ["b", "a"], "Valid: a, b."),
        ("", ["a"], "Valid: a."),
        ("x", [], "Valid: ."),
    ],
)
def test_choices(wrong, valid, sentence):
    assert choices(wrong, valid) == sentence
