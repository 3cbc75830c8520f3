"""Metrics of one roll-out: what they are of, in which unit, and what does not count."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest

from stages.evaluate.compare import Comparison, compare, largest_rise, recovery_time
from stages.policy.outcome import Outcome
from stages.trajectory import Trajectory

GOAL = np.array([0.1, 0.0])


def reference(samples: int = 11) -> Trajectory:
    """A line of 100 mm in 2 s."""
    time = np.linspace(0.0, 2.0, samples)
    position = np.linspace([0.0, 0.0], GOAL, samples)
    return Trajectory(
        dataset="line",
        demo="1",
        split="test",
        time=time,
        position=position,
        velocity=np.gradient(position, time, axis=0),
    )


def measure(executed: np.ndarray, samples: int = 101, **changes: object) -> Comparison:
    n = executed.shape[0]
    given: dict[str, object] = {
        "time": np.linspace(0.0, 1.0, n),
        "x": executed,
        "executed": executed,
        "gate": np.ones(n, dtype=bool),
        "lyapunov": np.linspace(1.0, 0.0, n),
        "clearance": np.full(n, np.nan),
        "status": np.full(n, "free", dtype=object),
        "disturbed": (),
        "outcome": Outcome.ARRIVED,
        "reference": reference(),
        "goal": GOAL,
        "samples": samples,
    }
    return compare(**(given | changes))  # type: ignore[arg-type]


def test_every_metric_of_a_parallel_path() -> None:
    path = np.linspace([0.0, 0.007], [GOAL[0], 0.007], 5)
    row = measure(path)
    assert row.dtw_mm == pytest.approx(101 * 7.0, rel=1e-12)
    assert row.dtw_per_step_mm == pytest.approx(7.0, rel=1e-12)
    assert row.sea_mm2 == pytest.approx(700.0, rel=1e-12)
    assert row.sea_per_step_mm2 == pytest.approx(7.0, rel=1e-12)
    assert row.steps == 4
    assert row.duration_s == 1.0
    assert row.final_error_mm == pytest.approx(7.0, rel=1e-12)
    assert row.lyapunov_rise_max == 0.0
    assert row.clearance_min_mm is None
    assert row.gate_closed_steps == 0
    assert row.recovery_s is None
    assert row.outcome == "arrived"
    assert type(row.outcome) is str


def test_a_path_compared_with_itself_at_another_clock_differs_by_nothing() -> None:
    row = measure(np.linspace([0.0, 0.0], GOAL, 40))
    assert row.dtw_mm == pytest.approx(0.0, abs=1e-10)
    assert row.sea_mm2 == pytest.approx(0.0, abs=1e-10)


def test_all_values_are_plain_numbers() -> None:
    for value in asdict(measure(np.linspace([0.0, 0.0], GOAL, 40))).values():
        assert value is None or type(value) in (str, int, float)


def test_a_path_of_one_sample_has_metrics() -> None:
    row = measure(np.array([[0.05, 0.005]]), lyapunov=np.array([1.0]))
    assert row.steps == 0
    assert row.duration_s == 0.0
    assert row.sea_mm2 == pytest.approx(250.0, rel=1e-12)
    assert math.isfinite(row.dtw_mm)


def test_rises_of_v() -> None:
    eps = np.finfo(float).eps
    assert largest_rise(np.array([4.0, 3.0, 3.5, 3.6, 1.0]), ()) == 0.5
    assert largest_rise(np.array([4.0, 3.0, 3.5, 3.75, 1.0]), [(2, 2)]) == 0.25
    assert largest_rise(np.array([4.0, 3.0, 3.5, 3.75, 4.5]), [(2, 3)]) == 0.75
    assert largest_rise(np.array([4.0, 3.0, 3.5, 3.75, 1.0]), [(2, 2), (3, 3)]) == 0.0
    assert largest_rise(np.array([4.0, 3.0, 2.0]), ()) == 0.0
    assert largest_rise(np.array([1.0, 1.0 + 16 * eps]), ()) == 0.0
    assert largest_rise(np.array([1.0, 1.0 + 32 * eps]), ()) == 32 * eps
    assert largest_rise(np.array([0.0, 1e-300]), ()) == 1e-300
    assert largest_rise(np.array([2.0]), [(0, 0)]) == 0.0


def test_recovery_is_from_the_end_of_a_disturbance_until_the_gate_opens() -> None:
    time = np.arange(8) * 0.5
    gate = np.array([True, True, False, False, True, False, False, True])
    assert recovery_time(time, gate, [(2, 2)]) == 1.0
    assert recovery_time(time, gate, [(2, 3)]) == 0.5  # held for two samples
    assert recovery_time(time, gate, [(1, 1)]) is None
    assert recovery_time(time, gate, ()) is None
    assert recovery_time(time, gate, [(3, 3), (5, 5)]) == 1.0  # the longest of two
    assert recovery_time(time, np.array([True, True, *[False] * 6]), [(2, 2)]) is None


def test_what_obstacles_did_is_counted() -> None:
    path = np.linspace([0.0, 0.0], GOAL, 7)
    status = np.array(["free", "active", "detouring", "yielding", "infeasible", "too-fast", "active"], dtype=object)
    clearance = np.array([0.02, 0.015, 0.003, 0.001, 0.004, 0.01, 0.02])
    row = measure(path, status=status, clearance=clearance)
    assert row.clearance_min_mm == pytest.approx(1.0)
    assert (row.avoiding_steps, row.detour_steps, row.yielding_steps, row.flagged_steps) == (5, 1, 1, 2)


def test_the_energy_of_eq_24_holds_the_coupling_term() -> None:
    x = np.linspace([0.0, 0.0], GOAL, 4)
    executed = x + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.02], [0.0, 0.0]])
    V = np.array([1.0, 0.9, 0.8999, 0.8])
    row = measure(executed, x=x, lyapunov=V)
    assert row.lyapunov_rise_max == 0.0
    assert row.energy_rise_max == pytest.approx(0.02**2 - 1e-4)
    assert measure(executed, x=x, lyapunov=V, disturbed=[(2, 2)]).energy_rise_max == 0.0


def test_closed_steps_do_not_count_the_last_sample_which_no_step_follows() -> None:
    path = np.linspace([0.0, 0.0], GOAL, 4)
    row = measure(path, gate=np.array([True, False, False, False]), disturbed=[(1, 1)])
    assert row.gate_closed_steps == 2
