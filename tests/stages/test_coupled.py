"""The coupled system: the printed and the deadbeat follower, their gates, and what is refused. Paper eqs. (9)-(12)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from pipeline.errors import ParameterError
from stages.policy.coupled import (
    PLAIN,
    energy,
    follow_deadbeat,
    follow_printed,
    follow_printed_explicitly,
    observe,
    rate,
    speed_limit,
)
from stages.policy.coupling import (
    PaperCoupling,
    RobustCoupling,
    check_explicit,
    gate_for,
    p_max_for,
    paper_coupling,
    robust_coupling,
)

AT = "rollout.controllers.1"
ACCURACY = 3e-3
"""Relative accuracy of the printed follower that its docstring states."""


def exponents(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda power: 10.0**power)


def exact_distance(distance: float, dt: float, p_max: float, k_c: float) -> float:
    """|p_hat - x| after dt by eq. (9): with y = log |e|, y' = -C."""

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        return np.asarray(p_max * np.expm1(-k_c * np.exp(y)))

    solution = solve_ivp(slope, (0.0, dt), [math.log(distance)], method="LSODA", rtol=1e-11, atol=1e-13)
    return math.exp(solution.y[0, -1])


def test_rate_by_hand() -> None:
    assert rate(0.0, 10.0, 100.0) == 0.0
    assert rate(math.log(2.0) / 100.0, 10.0, 100.0) == pytest.approx(5.0, rel=1e-15)
    assert rate(10.0, 10.0, 100.0) == pytest.approx(10.0, rel=1e-15)
    assert rate(1e-12, 10.0, 100.0) == pytest.approx(1e-9, rel=1e-9)  # no cancellation near x


def test_speed_limit_and_its_inverses_by_hand() -> None:
    # eps = log(2) / k_c makes C = p_max / 2.
    eps = math.log(2.0) / 100.0
    assert speed_limit(eps, 10.0, 100.0) == pytest.approx(5.0 * eps, rel=1e-15)
    assert gate_for(10.0, 100.0, 5.0 * eps) == pytest.approx(eps, rel=1e-12)
    assert p_max_for(eps, 100.0, 5.0 * eps) == pytest.approx(10.0, rel=1e-12)


@given(exponents(-2, 6), exponents(-2, 6), exponents(-6, 2))
def test_gate_and_p_max_solve_the_speed_limit(p_max: float, k_c: float, speed: float) -> None:
    assert speed_limit(gate_for(p_max, k_c, speed), p_max, k_c) == pytest.approx(speed, rel=1e-9)
    gate = speed / p_max
    assert speed_limit(gate, p_max_for(gate, k_c, speed), k_c) == pytest.approx(speed, rel=1e-9)


@given(exponents(-5, 0), exponents(-4, -1), exponents(-1, 4), exponents(0, 4))
def test_printed_follower_is_as_accurate_as_stated(distance: float, dt: float, p_max: float, k_c: float) -> None:
    x, direction = np.array([0.2, -0.1]), np.array([0.6, 0.8])
    p_hat = x + distance * direction
    start = float(np.linalg.norm(p_hat - x))
    follow_printed(x, p_hat, dt, p_max, k_c)
    assert np.linalg.norm(p_hat - x) == pytest.approx(exact_distance(start, dt, p_max, k_c), rel=ACCURACY, abs=1e-15)


@given(exponents(-6, 2), exponents(-5, 2), exponents(-2, 9), exponents(-2, 6), st.integers(1, 7))
def test_printed_follower_never_overshoots_nor_arrives(
    distance: float, dt: float, p_max: float, k_c: float, d: int
) -> None:
    x, p_hat = np.zeros(d), np.zeros(d)
    p_hat[0] = distance
    follow_printed(x, p_hat, dt, p_max, k_c)
    assert 0.0 < p_hat[0] <= distance
    assert (p_hat[1:] == 0.0).all()
    assert (x == 0.0).all()


def test_printed_follower_where_explicit_euler_diverges() -> None:
    # p_max = 600 at 4 ms: C dt = 2.4.
    x, p_hat = np.zeros(2), np.array([1.0, 0.0])
    for _ in range(5):
        follow_printed(x, p_hat, 0.004, 600.0, 1e4)
    assert p_hat[0] == pytest.approx(exact_distance(1.0, 0.02, 600.0, 1e4), rel=ACCURACY)


def test_explicit_euler_of_the_printed_follower_by_hand_and_where_it_is_refused() -> None:
    x, p_hat = np.zeros(2), np.array([math.log(2.0) / 100.0, 0.0])  # C = p_max / 2
    follow_printed_explicitly(x, p_hat, 0.1, 10.0, 100.0)
    assert p_hat[0] == pytest.approx(0.5 * math.log(2.0) / 100.0, rel=1e-14)
    p_hat = np.array([1.0, 0.0])
    follow_printed_explicitly(x, p_hat, 0.004, 600.0, 1e4)  # C dt = 2.4: thrown to the other side, and farther
    assert p_hat[0] == pytest.approx(-1.4, rel=1e-12)
    coupling = PaperCoupling(p_max=600.0, k_c=1e4, gate=0.002)
    check_explicit(coupling, 1.0 / 600.0, AT)
    with pytest.raises(ParameterError, match="overshoots") as error:
        check_explicit(coupling, 0.004, AT)
    assert error.value.location == f"{AT}.p_max"
    assert "dt <= 0.00167" in error.value.problem
    assert "p_max <= 250" in error.value.problem


def test_printed_follower_approaches_as_one_over_time() -> None:
    # The reason why eq. (12) cannot be met: |e| tends to 1 / (p_max k_c t).
    x, p_hat = np.zeros(1), np.array([0.01])
    for _ in range(20_000):
        follow_printed(x, p_hat, 0.1, 10.0, 100.0)
    assert p_hat[0] == pytest.approx(1.0 / (10.0 * 100.0 * 2000.0), rel=0.01)


def test_printed_follower_stands_where_x_is() -> None:
    x = np.array([0.3, 0.1])
    p_hat = x.copy()
    follow_printed(x, p_hat, 0.01, 10.0, 100.0)
    assert (p_hat == x).all()


def test_deadbeat_follower_by_hand() -> None:
    x, p_hat = np.array([0.3, 0.4]), np.zeros(2)
    follow_deadbeat(x, p_hat, 0.1, 2.0)  # 0.2 of 0.5
    assert p_hat == pytest.approx([0.12, 0.16], rel=1e-15)
    follow_deadbeat(x, p_hat, 0.1, 2.0)
    follow_deadbeat(x, p_hat, 0.1, 2.0)
    assert (p_hat == x).all()


@given(st.integers(0, 2**32 - 1), st.integers(1, 7), exponents(-3, 3))
def test_deadbeat_follower_reaches_x_bitwise_in_the_fewest_steps(seed: int, d: int, scale: float) -> None:
    generator = np.random.default_rng(seed)
    x, p_hat = scale * generator.normal(size=(2, d))
    distance = float(np.linalg.norm(x - p_hat))
    v_max, dt = distance * generator.uniform(0.05, 2.0), 1.0
    fewest = math.ceil(distance / (v_max * dt))
    for _ in range(fewest + 1):  # one more, if rounding left a last bit
        before = p_hat.copy()
        follow_deadbeat(x, p_hat, dt, v_max)
        assert np.linalg.norm(p_hat - before) <= v_max * dt * (1 + 1e-12)
    assert (p_hat == x).all()


def test_deadbeat_follower_assigns_x_where_adding_the_difference_would_round() -> None:
    x, p_hat = np.array([1e-20, 0.1]), np.array([1.0, 0.7])
    assert p_hat[0] + (x[0] - p_hat[0]) != x[0]
    follow_deadbeat(x, p_hat, 1.0, 2.0)
    assert (p_hat == x).all()


def test_gate_of_the_printed_follower_has_hysteresis() -> None:
    coupling = PaperCoupling(p_max=10.0, k_c=100.0, gate=0.5).compiled
    x = np.zeros(2)
    for distance, when_open, when_closed in [(0.0, 1, 1), (0.5, 1, 1), (0.75, 1, 0), (1.0, 1, 0), (1.001, 0, 0)]:
        p_hat = np.array([0.0, distance])
        assert observe(coupling, x, p_hat, True) == bool(when_open)
        assert observe(coupling, x, p_hat, False) == bool(when_closed)


def test_gate_of_the_deadbeat_follower_is_exact() -> None:
    coupling = RobustCoupling(v_max=1.0).compiled
    x = np.array([0.1, 0.2])
    for was_open in (True, False):
        assert observe(coupling, x, x.copy(), was_open)
        assert not observe(coupling, x, np.array([0.1, math.nextafter(0.2, 1.0)]), was_open)
        assert not observe(coupling, x, np.array([math.nextafter(0.1, 0.0), 0.2]), was_open)
    assert (x == [0.1, 0.2]).all()


def test_a_tolerance_gives_the_deadbeat_gate_hysteresis() -> None:
    coupling = robust_coupling(v_max=1.0, tolerance=0.5, top_speed=0.1, location=AT).compiled
    x = np.zeros(2)
    for distance, when_open, when_closed in [(0.5, 1, 1), (0.75, 1, 0), (1.0, 1, 0), (1.001, 0, 0)]:
        p_hat = np.array([0.0, distance])
        assert observe(coupling, x, p_hat, True) == bool(when_open)
        assert observe(coupling, x, p_hat, False) == bool(when_closed)
    for wrong in (-1e-3, math.nan, math.inf):
        with pytest.raises(ParameterError, match="metres"):
            robust_coupling(v_max=1.0, tolerance=wrong, top_speed=0.1, location=AT)


def test_uncoupled_x_is_the_executed_state() -> None:
    x = np.array([0.1, 0.2])
    assert observe(PLAIN, x, np.array([5.0, 6.0]), False)
    assert (x == [5.0, 6.0]).all()


def test_paper_coupling_is_completed_from_the_top_speed() -> None:
    by_gate = paper_coupling(p_max=None, k_c=100.0, gate=0.002, top_speed=0.1, location=AT)
    assert speed_limit(0.002, by_gate.p_max, 100.0) == pytest.approx(0.12, rel=1e-12)
    by_p_max = paper_coupling(p_max=10.0, k_c=100.0, gate=None, top_speed=0.1, location=AT)
    assert speed_limit(by_p_max.gate, 10.0, 100.0) == pytest.approx(0.12, rel=1e-9)
    both = paper_coupling(p_max=1000.0, k_c=100.0, gate=0.002, top_speed=0.1, location=AT)
    assert both == PaperCoupling(p_max=1000.0, k_c=100.0, gate=0.002)
    assert robust_coupling(v_max=None, top_speed=0.1, location=AT) == RobustCoupling(v_max=pytest.approx(0.5))
    assert robust_coupling(v_max=0.01, top_speed=0.1, location=AT).v_max == 0.01


@pytest.mark.parametrize(
    ("given", "name", "says"),
    [
        ({"gate": 0.0}, "gate", "never reaches x"),
        ({"gate": 0.0, "p_max": 10.0}, "gate", "never reaches x"),
        ({"gate": None}, "gate", "neither"),
        ({"gate": 0.002, "p_max": 10.0}, "gate", "outrun"),
        ({"gate": -0.002}, "gate", "positive"),
        ({"gate": math.nan}, "gate", "positive"),
        ({"p_max": -1.0}, "p_max", "positive"),
        ({"p_max": math.inf}, "p_max", "positive"),
        ({"k_c": 0.0}, "k_c", "positive"),
    ],
)
def test_paper_coupling_refuses_what_cannot_work(given: dict[str, float | None], name: str, says: str) -> None:
    wanted: dict[str, float | None] = {"p_max": None, "k_c": 100.0, "gate": 0.002} | given
    with pytest.raises(ParameterError, match=says) as error:
        paper_coupling(**wanted, top_speed=0.1, location=AT)  # type: ignore[arg-type]
    assert error.value.location == f"{AT}.{name}"


def test_the_refusal_of_an_outrun_follower_names_values_that_are_accepted() -> None:
    with pytest.raises(ParameterError) as error:
        paper_coupling(p_max=10.0, k_c=100.0, gate=0.002, top_speed=0.1, location=AT)
    words = error.value.problem.split()
    p_max = float(words[[i for i, word in enumerate(words) if word == "p_max"][-1] + 2])
    gate = float(words[[i for i, word in enumerate(words) if word == "gate"][-1] + 2])
    paper_coupling(p_max=p_max, k_c=100.0, gate=0.002, top_speed=0.1, location=AT)
    paper_coupling(p_max=10.0, k_c=100.0, gate=gate, top_speed=0.1, location=AT)


def test_robust_coupling_refuses_a_follower_that_stands() -> None:
    for v_max in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(ParameterError, match="positive"):
            robust_coupling(v_max=v_max, top_speed=0.1, location=AT)


def test_energy_by_hand() -> None:
    x, p_hat = np.array([[4.0, 5.0], [1.0, 1.0]]), np.array([[4.0, 7.0], [1.0, 1.0]])
    assert energy(x, p_hat, np.array([1.0, 1.0])).tolist() == [9.0 + 16.0 + 4.0, 0.0]
