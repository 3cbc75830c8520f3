"""Masters: the made operator arrives, replays are faithful, keys and sticks do what they say; what is refused."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import DataError, ParameterError, UsageError
from pipeline.validation import validate_as
from stages.teleoperation.devices import Gamepad, Keyboard, Window, described, open_window
from stages.teleoperation.mapping import Clutch, MasterSample, SharedTeleoperation
from stages.teleoperation.masters import Master, Replay, Seen
from stages.teleoperation.parameters import (
    GamepadParameters,
    KeyboardParameters,
    MappingParameters,
    MasterParameters,
    ReplayParameters,
    SimulatedOperatorParameters,
)
from stages.teleoperation.simulated import SHORTEST, SimulatedOperator, minimum_jerk

AT = "teleoperation.master"
DT = 0.01
L = 0.3
START = np.array([0.45, -0.15, 0.35])
LEFT = START + np.array([0.0, 0.5 * L, 0.0])
VIA = np.array([[0.45, -0.15, 0.47], [0.55, 0.0, 0.50], [0.65, 0.15, 0.50], [0.65, 0.15, 0.47]])
"""The box of notes/simulation.md: up, across, down."""
TURNED = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
SEEN = Seen(np.zeros(3))
seeds = st.integers(0, 2**32 - 1)


@dataclass
class Led:
    """What came of an operator at a mapping; n ticks."""

    operator: SimulatedOperator
    samples: list[MasterSample]
    path: np.ndarray
    """Shape (n, 3): where the midpoint really was."""

    @property
    def hand(self) -> np.ndarray:
        return np.array([sample.position for sample in self.samples])

    @property
    def clutch(self) -> np.ndarray:
        return np.array([sample.clutch for sample in self.samples])

    def misses(self, via: np.ndarray = VIA) -> np.ndarray:
        """How near the path came to each via-point, in their order, and how far from the last one it ended; metres."""
        found, at = [], 0
        for place in via:
            step, to = np.diff(self.path[at:], axis=0), place - self.path[at:-1]
            length = (step**2).sum(axis=1)
            share = np.clip((step * to).sum(axis=1) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
            distance = np.linalg.norm(to - share[:, None] * step, axis=1)
            found.append(distance.min())
            at += int(np.argmin(distance))
        return np.array([*found, np.linalg.norm(self.path[-1] - via[-1])])


def lead(
    seed: int = 0,
    *,
    alpha: float = 1.0,
    R_mf: tuple[float, ...] = TURNED,
    lag: float = 0.0,
    bias: Sequence[float] = (0.0, 0.0, 0.0),
    via: np.ndarray = VIA,
    limit: float = 60.0,
    low_pass: float = 3.0,
    lost_at: int = -1,
    **changed: Any,
) -> Led:
    """Let an operator lead; `lag`: of the arms, s; `bias`: of where they stand; `lost_at`: tick of a bad sample."""
    chosen = MappingParameters(
        alpha=alpha, R_mf=R_mf, separation=L, low_pass=low_pass, low=(0.3, -0.6, 0.1), high=(0.8, 0.6, 0.8)
    )
    mapping = SharedTeleoperation(chosen, LEFT)
    operator = SimulatedOperator(
        SimulatedOperatorParameters(**changed), via, np.random.default_rng(seed), alpha=mapping.alpha, R_mf=mapping.R_mf
    )
    midpoint, samples, path, rest = START, [], [], 50
    share = 1.0 if lag == 0.0 else -math.expm1(-DT / lag)
    while rest > 0 and len(path) * DT < limit:
        time = len(path) * DT
        sample = operator.sample(time, Seen(midpoint))
        lost = len(path) == lost_at
        pads = mapping.step(time, MasterSample(time, np.full(3, math.nan), sample.quaternion, True) if lost else sample)
        midpoint = midpoint + share * (pads.midpoint + bias - midpoint)
        samples.append(sample)
        path.append(midpoint)
        rest -= operator.done
    return Led(operator, samples, np.array(path))


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_the_operator_arrives_at_all_via_points(seed: int, stops: bool) -> None:
    led = lead(seed, stops=stops)
    assert led.operator.done
    assert led.operator.reached == len(VIA)
    assert led.misses().max() < 0.005
    assert led.misses()[-1] < 0.0025


@pytest.mark.parametrize(
    "how",
    [
        {"alpha": 0.5},
        {"alpha": 3.0},
        {"R_mf": (0.5, 0.5, 0.5, 0.5)},
        {"lag": 0.1},
        {"bias": (0.004, -0.006, 0.003)},
        {"alpha": 1.3, "lag": 0.15, "bias": (0.0, 0.01, 0.0), "aim": 0.1},
        {"stroke": 0.04},
        {"stroke": 0.6},
        {"tremor": 0.0, "aim": 0.0, "pause": 0.0, "reaction": 0.0},
        {"tremor": 0.0009},
    ],
    ids=str,
)
def test_the_operator_corrects_for_where_the_arms_really_are(how: dict[str, Any]) -> None:
    for seed in range(3):
        led = lead(seed, **how)
        assert led.operator.done
        assert led.misses().max() < 0.005


def test_the_operator_stays_in_the_small_workspace_and_lets_go_to_return() -> None:
    led = lead(tremor=0.0, aim=0.0)
    assert np.linalg.norm(led.hand, axis=1).max() <= 0.06 * (1.0 + 1e-6)
    presses = int((np.diff(led.clutch.astype(int)) == 1).sum())
    # .12 up, .22 across in two strokes of at most .12 each, and the same again, then .03 down.
    assert 4 <= presses <= 6
    length = np.linalg.norm(np.diff(np.vstack([START, VIA]), axis=0), axis=1).sum()
    engaged = led.clutch[1:] & led.clutch[:-1]
    assert np.linalg.norm(np.diff(led.hand, axis=0), axis=1)[engaged].sum() == pytest.approx(length, rel=0.02)
    assert not led.clutch[-1]
    assert (np.linalg.norm(np.diff(led.path, axis=0), axis=1)[~led.clutch[1:]] == 0.0).all()


def test_more_room_needs_fewer_strokes() -> None:
    def presses(**how: Any) -> int:
        return int((np.diff(lead(**how).clutch.astype(int)) == 1).sum())

    assert presses(stroke=0.05) > presses(stroke=0.12) > presses(stroke=0.6)
    assert presses(alpha=0.5) > presses(alpha=1.0) > presses(alpha=3.0)


def test_the_hand_is_no_faster_than_it_is_said_to_be() -> None:
    led = lead(tremor=0.0, speed=0.1)
    speed = np.linalg.norm(np.diff(led.hand, axis=0), axis=1) / DT
    assert speed.max() <= 0.1 * (1.0 + 1e-3)
    assert speed.max() >= 0.0995


def test_the_operator_is_the_same_for_a_seed_and_no_other() -> None:
    one, same, other = lead(1), lead(1), lead(2)
    assert (one.hand == same.hand).all()
    assert (one.clutch == same.clutch).all()
    assert (one.path == same.path).all()
    assert len(one.samples) != len(other.samples) or (one.hand != other.hand).any()


def test_the_operator_reacts_after_its_reaction_time_and_hesitates() -> None:
    quick = lead(reaction=0.1, pause=0.0)
    slow = lead(reaction=0.5, pause=0.0)
    hesitant = lead(reaction=0.1, pause=0.4)
    for led, reaction in ((quick, 0.1), (slow, 0.5)):
        # It looks, returns to where it takes hold, and presses the clutch.
        first = int(np.argmax(led.clutch)) * DT
        assert reaction + SHORTEST <= first <= reaction + 1.5
    assert len(quick.path) < len(slow.path)
    assert len(quick.path) < len(hesitant.path)


def test_tremor_is_within_its_band_and_as_large_as_it_is_said_to_be() -> None:
    operator = SimulatedOperator(
        SimulatedOperatorParameters(tremor=0.0002),
        VIA,
        np.random.default_rng(3),
        alpha=1.0,
        R_mf=np.eye(3),
        leads_in=(),
    )  # leads in no phase: the hand only trembles
    dt, n = 0.005, 12_000
    shake = np.array([operator.sample(k * dt, Seen(START)).position for k in range(n)])
    assert np.sqrt((shake**2).mean(axis=0)) == pytest.approx([0.0002] * 3, rel=0.02)
    assert np.abs(shake).max() < 0.001
    power = np.abs(np.fft.rfft(shake * np.hanning(n)[:, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(n, dt)
    inside = (frequency > 7.9) & (frequency < 12.1)
    assert power[inside].sum() > 0.9999 * power.sum()


def test_the_low_pass_keeps_tremor_from_the_arms() -> None:
    def shaken(**how: Any) -> float:
        """Root mean square of the second differences of the midpoint's path, m."""
        return float(np.sqrt((np.diff(lead(aim=0.0, **how).path, n=2, axis=0) ** 2).mean()))

    calm, filtered, raw = shaken(tremor=0.0), shaken(tremor=0.0009), shaken(tremor=0.0009, low_pass=math.inf)
    # Between 8 and 12 Hz the low-pass leaves .25 to .13 of an amplitude.
    assert 0.1 < math.sqrt((filtered**2 - calm**2) / (raw**2 - calm**2)) < 0.3


def test_the_operator_leads_in_its_phases_only() -> None:
    operator = SimulatedOperator(
        SimulatedOperatorParameters(), VIA, np.random.default_rng(0), alpha=1.0, R_mf=np.eye(3), leads_in={"lead"}
    )
    phases = ["grasp"] * 200 + ["lead"] * 300 + ["lost"] * 100 + ["lead"] * 300
    clutch = np.array([operator.sample(k * DT, Seen(START, phase)).clutch for k, phase in enumerate(phases)])
    assert not clutch[:200].any()
    assert clutch[200:500].any()
    assert not clutch[500:620].any()
    assert clutch[600:].any()


def test_the_operator_takes_hold_again_where_the_arms_do_not_follow() -> None:
    led = lead(lost_at=120)
    assert led.operator.done
    assert led.misses().max() < 0.005


def test_one_lost_stroke_costs_one_return() -> None:
    via = START + np.array([[0.0, 0.0, 0.03]])
    plain = lead(via=via, aim=0.0, tremor=0.0)
    first = int(np.argmax(plain.clutch))
    led = lead(via=via, aim=0.0, tremor=0.0, lost_at=first + 20)
    assert led.operator.done
    assert int((np.diff(led.clutch.astype(int)) == 1).sum()) == 2
    # It looks, returns, takes hold and makes the stroke: as long again as at first.
    assert len(led.path) < 2 * len(plain.path)


def test_the_operator_does_not_swing_wide_of_two_points_close_together() -> None:
    via = START + np.array([[0.05, 0.0, 0.0], [0.053, 0.0, 0.0], [0.053, 0.05, 0.0]])
    led = lead(via=via, stroke=0.3, aim=0.0, tremor=0.0)
    assert led.operator.done
    assert (led.path - START).min() > -0.004
    assert (led.path - START)[:, 0].max() < 0.057
    assert led.misses(via).max() < 0.003


def test_the_operator_that_is_where_it_should_be_does_nothing() -> None:
    led = lead(via=START + np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0]]))
    assert led.operator.done
    assert not led.clutch.any()


def test_the_operator_does_not_give_up() -> None:
    led = lead(via=np.array([[0.5, 0.9, 0.4]]), limit=20.0)
    assert not led.operator.done
    assert led.path[-1][1] == pytest.approx(0.45, abs=1e-3)  # the left pad is at the workspace's edge


@settings(max_examples=40)
@given(seeds, st.sampled_from([{"stops": True, "speed": 0.4}, {}]))
def test_the_operator_arrives_at_random_via_points(seed: int, how: dict[str, Any]) -> None:
    generator = np.random.default_rng(seed)
    via = generator.uniform([0.35, -0.4, 0.15], [0.75, 0.4, 0.75], (int(generator.integers(1, 4)), 3))
    led = lead(seed, via=via, alpha=3.0, **how)
    assert led.operator.done
    assert led.misses(via).max() < 0.005


@pytest.mark.parametrize(
    "via", [np.zeros(3), np.zeros((0, 3)), np.zeros((2, 2)), [[0.0, math.nan, 0.0]], "there", [[0.0], [0.0, 1.0]]]
)
def test_via_points_that_cannot_be_used_are_refused(via: Any) -> None:
    with pytest.raises(DataError, match="finite numbers of shape") as error:
        SimulatedOperator(SimulatedOperatorParameters(), via, np.random.default_rng(0), alpha=1.0, R_mf=np.eye(3))
    assert error.value.source == "via-points"


def test_what_the_operator_cannot_use_is_refused() -> None:
    chosen = SimulatedOperatorParameters(tremor_band=(12.0, 8.0))
    with pytest.raises(ParameterError, match="lower frequency") as error:
        SimulatedOperator(chosen, VIA, np.random.default_rng(0), alpha=1.0, R_mf=np.eye(3))
    assert error.value.location == f"{AT}.tremor_band"
    operator = lead(limit=0.1).operator
    with pytest.raises(DataError, match="midpoint that is seen"):
        operator.sample(1.0, Seen(np.array([0.0, math.nan, 0.0])))


def test_a_straight_stroke_is_the_minimum_jerk_motion() -> None:
    s = np.linspace(0.0, 1.0, 11)
    share = 10 * s**3 - 15 * s**4 + 6 * s**5
    end = np.array([0.1, -0.2, 0.05])
    assert minimum_jerk([np.zeros(3), end])(s) == pytest.approx(np.outer(share, end), abs=1e-15)
    through = minimum_jerk([np.zeros(3), 0.2 * end, 0.5 * end, end])  # on the line: the same motion
    assert through(s) == pytest.approx(np.outer(share, end), abs=1e-12)


@given(seeds, st.integers(2, 6))
def test_a_stroke_passes_its_points_and_rests_at_both_ends(seed: int, n: int) -> None:
    points = np.random.default_rng(seed).normal(size=(n, 3))
    path = minimum_jerk(points)
    assert path([0.0, 1.0]) == pytest.approx(points[[0, -1]], abs=1e-9)
    for order in (1, 2):
        assert path.derivative(order)([0.0, 1.0]) == pytest.approx(np.zeros((2, 3)), abs=1e-6)
    found = path(np.linspace(0.0, 1.0, 4001))
    for place in points:
        assert np.linalg.norm(found - place, axis=1).min() < 0.01


# Replay


def stream(**changed: Any) -> dict[str, Any]:
    half = math.sqrt(0.5)
    chosen: dict[str, Any] = {
        "time": [100.0, 100.01, 100.03, 100.20],
        "position": [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.2, 0.0], [0.1, 0.2, 0.3]],
        "quaternion": [[0, 0, 0, 1], [0, 0, half, half], [0, 0, -half, -half], [0, 0, 1, 0]],
        "clutch": [False, True, True, False],
    }
    return chosen | changed


def test_a_replay_by_hand() -> None:
    replay = Replay(**stream(), start=2.0)
    assert replay.sample(1.999, SEEN) is None
    assert not replay.done
    quarter = math.pi / 8
    for time, said, position, quaternion, clutch in [
        (2.0, 2.0, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], False),
        (2.005, 2.005, [0.05, 0.0, 0.0], [0.0, 0.0, math.sin(quarter), math.cos(quarter)], False),
        (2.0201, 2.0201, [0.1, 0.101, 0.0], [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)], True),  # q and -q are the same
        (2.1, 2.03, [0.1, 0.2, 0.0], [0.0, 0.0, -math.sqrt(0.5), -math.sqrt(0.5)], True),  # in a gap
        (2.3, 2.2, [0.1, 0.2, 0.3], [0.0, 0.0, 1.0, 0.0], False),
    ]:
        sample = replay.sample(time, SEEN)
        assert sample is not None
        assert sample.time == pytest.approx(said, abs=1e-9)
        assert sample.position == pytest.approx(position, abs=1e-9)
        assert sample.quaternion == pytest.approx(quaternion, abs=1e-9)
        assert sample.clutch == clutch
    assert replay.done


def test_a_replay_in_its_own_ticks_repeats_what_the_operator_did() -> None:
    led = lead(4)
    time = [sample.time for sample in led.samples]
    replay = Replay(time, led.hand, [sample.quaternion for sample in led.samples], led.clutch)
    chosen = MappingParameters(R_mf=TURNED, separation=L, low=(0.3, -0.6, 0.1), high=(0.8, 0.6, 0.8))
    mapping = SharedTeleoperation(chosen, LEFT)
    path = np.array([mapping.step(t, replay.sample(t, SEEN)).midpoint for t in time])
    assert path == pytest.approx(led.path, abs=1e-12)
    assert replay.done


def test_the_arms_stop_where_a_replay_was_silent() -> None:
    replay = Replay(**stream(time=[0.0, 0.01, 0.02, 1.0], clutch=[True] * 4))
    chosen = MappingParameters(separation=L, low=(0.3, -0.6, 0.1), high=(0.8, 0.6, 0.8))
    mapping = SharedTeleoperation(chosen, LEFT)
    statuses = []
    for tick in range(100):
        mapping.step(tick * DT, replay.sample(tick * DT, SEEN))
        statuses.append(mapping.status)
    assert statuses[11] is Clutch.ENGAGED
    assert statuses[13] is Clutch.LOST


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"time": [0.0, 0.1, 0.1, 0.2]}, "duplicate of that of sample 2"),
        ({"time": [0.0, 0.2, 0.1, 0.3]}, "time must increase"),
        ({"time": [0.0, math.nan, 0.1, 0.3]}, "time is not a finite number at sample 2"),
        ({"time": [0.0, 0.1, 0.2]}, "does not go with positions"),
        ({"time": "now"}, "does not go with positions"),
        ({"position": np.full((4, 3), math.inf)}, "position is not a finite number at sample 1"),
        ({"position": np.zeros((4, 2))}, "moves in 3 coordinates, not 2"),
        ({"quaternion": np.full((4, 4), math.nan)}, "quaternion of sample 1 has length nan"),
        ({"quaternion": [[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 2], [0, 0, 0, 1]]}, "sample 3 has length 2, which must"),
        ({"quaternion": np.zeros((4, 3))}, "must be of shape (4, 4)"),
        ({"clutch": [True]}, "4 times true or false"),
        ({"clutch": [0, 1, 2, 0]}, "4 times true or false"),
    ],
)
def test_a_stream_that_cannot_be_replayed_is_refused(changed: dict[str, Any], says: str) -> None:
    with pytest.raises(DataError) as error:
        Replay(**stream(**changed), source="lead.mcap")
    assert says in error.value.problem
    assert error.value.source == "lead.mcap"


# Parameters


def test_masters_are_told_apart_by_kind() -> None:
    assert validate_as(MasterParameters, AT, {}) == SimulatedOperatorParameters()
    assert validate_as(MasterParameters, AT, {"kind": "replay", "file": "lead.mcap"}) == ReplayParameters(
        file="lead.mcap"
    )
    assert validate_as(MasterParameters, AT, {"kind": "keyboard", "slow": 0.5}).slow == 0.5
    assert validate_as(MasterParameters, AT, {"kind": "gamepad"}) == GamepadParameters()


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"kind": "mouse"}, "kind"),
        ({"kind": "replay"}, "file"),
        ({"stroke": 0.0}, "stroke"),
        ({"tremor": 0.002}, "tremor"),
        ({"tremor_band": [8.0]}, "tremor_band"),
        ({"kind": "gamepad", "deadzone": 1.0}, "deadzone"),
        ({"kind": "keyboard", "jump": "j"}, "jump"),
    ],
)
def test_parameters_of_masters_that_are_refused(changed: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError) as error:
        validate_as(MasterParameters, AT, changed)
    assert error.value.location == f"{AT}.{name}"


class Posted:
    """Events as a test posts them."""

    def __init__(self) -> None:
        self.events: list[Any] = []

    def get(self) -> Sequence[Any]:
        events, self.events = self.events, []
        return events


def test_the_lines_of_the_window_say_what_every_key_does() -> None:
    chosen = KeyboardParameters(clutch="tab", up="page up")
    lines = described(chosen)
    assert lines[0] == "hold tab: the arms follow"
    assert "page up: up" in lines
    assert len(lines) == 9
    assert described(GamepadParameters())[-1] == "button 7: end the demonstration"


@pytest.mark.parametrize(
    "make", [lambda: Keyboard(KeyboardParameters(), Posted()), lambda: Gamepad(GamepadParameters(), Posted())]
)
def test_without_pygame_one_sentence_says_what_to_install(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Any:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(UsageError, match=r"needs pygame, which is not installed: pip install 'clpv\[teleop\]'\.$"):
        make()
    with pytest.raises(UsageError, match="clpv"), open_window(KeyboardParameters()):
        pass


# Keyboard and gamepad: without a screen, events are posted


@pytest.fixture
def pygame(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("SDL_AUDIODRIVER", "dummy")
    monkeypatch.setenv("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    module = pytest.importorskip("pygame")
    module.display.init()
    module.event.clear()
    yield module
    module.quit()


class Typist:
    """A keyboard at which a test types, in ticks."""

    def __init__(self, pygame: Any, **changed: Any) -> None:
        self.pygame, self.time = pygame, 0.0
        self.master = Keyboard(KeyboardParameters(speed=0.1, slow=0.25, **changed), pygame.event)

    def __call__(self, *keys: str) -> MasterSample:
        """Press keys, or release those that begin with a minus; then a tick."""
        for key in keys:
            kind = self.pygame.KEYUP if key.startswith("-") else self.pygame.KEYDOWN
            self.pygame.event.post(self.pygame.event.Event(kind, key=self.pygame.key.key_code(key.removeprefix("-"))))
        self.time += DT
        return self.master.sample(self.time, SEEN)

    def moved(self, *keys: str, ticks: int = 10) -> np.ndarray:
        """Where ten ticks lead with keys held."""
        before = self(*keys).position
        for _ in range(ticks):
            after = self().position
        self(*[f"-{key}" for key in keys])
        return np.asarray(after - before)


@pytest.mark.parametrize(
    ("keys", "direction"),
    [
        (("w",), [1, 0, 0]),
        (("s",), [-1, 0, 0]),
        (("a",), [0, 1, 0]),
        (("d",), [0, -1, 0]),
        (("e",), [0, 0, 1]),
        (("q",), [0, 0, -1]),
        (("w", "s"), [0, 0, 0]),
        (("w", "a"), [math.sqrt(0.5), math.sqrt(0.5), 0]),
        (("left shift", "w"), [0.25, 0, 0]),
        (("x",), [0, 0, 0]),
    ],
)
def test_keys_move_the_master(pygame: Any, keys: tuple[str, ...], direction: list[float]) -> None:
    typist = Typist(pygame)
    assert typist.moved(*keys) == pytest.approx(0.01 * np.array(direction), abs=1e-12)
    assert typist.moved(ticks=3) == pytest.approx(np.zeros(3))  # released: it stands


def test_the_clutch_key_engages_while_it_is_held(pygame: Any) -> None:
    typist = Typist(pygame)
    assert [typist(*keys).clutch for keys in ([], ["space"], [], ["w"], ["-space"], [])] == [0, 1, 1, 1, 0, 0]


def test_a_window_that_loses_the_keyboard_lets_everything_go(pygame: Any) -> None:
    typist = Typist(pygame)
    assert typist("space", "w").clutch
    pygame.event.post(pygame.event.Event(pygame.WINDOWFOCUSLOST))
    at = typist()
    assert not at.clutch
    assert (typist().position == at.position).all()


@pytest.mark.parametrize("how", ["key", "tapped", "window"])
def test_leaving_ends_the_demonstration_and_releases_the_clutch(pygame: Any, how: str) -> None:
    typist = Typist(pygame)
    assert typist("space").clutch
    assert not typist.master.done
    if how == "window":
        pygame.event.post(pygame.event.Event(pygame.QUIT))
    sample = typist(*{"key": ["escape"], "tapped": ["escape", "-escape"], "window": []}[how])
    assert typist.master.done
    assert not sample.clutch
    assert not typist("-space", "space").clutch


def test_a_late_tick_does_not_carry_the_master_away(pygame: Any) -> None:
    typist = Typist(pygame)
    before = typist("w").position
    typist.time += 60.0
    assert typist().position - before == pytest.approx([0.01, 0.0, 0.0])


@pytest.mark.parametrize(
    ("changed", "name", "says"),
    [
        ({"up": "upwards"}, "up", "there is no key 'upwards'"),
        ({"down": "e"}, "down", "'e' is already the key for up"),
        ({"leave": "SPACE"}, "leave", "is already the key for clutch"),
    ],
)
def test_keys_that_cannot_be_used_are_refused(pygame: Any, changed: dict[str, str], name: str, says: str) -> None:
    with pytest.raises(ParameterError) as error:
        Keyboard(KeyboardParameters(**changed), pygame.event)
    assert error.value.location == f"{AT}.{name}"
    assert says in error.value.problem


class Sticks:
    """A gamepad that a test moves."""

    def __init__(self, pygame: Any, **changed: Any) -> None:
        self.pygame, self.time = pygame, 0.0
        self.master = Gamepad(GamepadParameters(speed=0.1, deadzone=0.2, **changed), pygame.event)

    def __call__(self, *events: tuple[str, dict[str, Any]]) -> MasterSample:
        for name, fields in events:
            self.pygame.event.post(self.pygame.event.Event(getattr(self.pygame, name), **fields))
        self.time += DT
        return self.master.sample(self.time, SEEN)

    def pushed(self, axis: int, value: float) -> np.ndarray:
        before = self(("JOYAXISMOTION", {"axis": axis, "value": value})).position
        for _ in range(10):
            after = self().position
        self(("JOYAXISMOTION", {"axis": axis, "value": 0.0}))
        return np.asarray(after - before)


@pytest.mark.parametrize(
    ("axis", "value", "direction"),
    [
        (1, -1.0, [1, 0, 0]),
        (1, 1.0, [-1, 0, 0]),
        (0, -1.0, [0, 1, 0]),
        (4, -1.0, [0, 0, 1]),
        (4, 0.6, [0, 0, -0.5]),  # half of what the dead zone leaves
        (4, 0.2, [0, 0, 0]),
        (4, -0.1, [0, 0, 0]),
        (2, -1.0, [0, 0, 0]),
        (1, -1.0001, [1, 0, 0]),
    ],
)
def test_sticks_move_the_master(pygame: Any, axis: int, value: float, direction: list[float]) -> None:
    sticks = Sticks(pygame)
    assert sticks.pushed(axis, value) == pytest.approx(0.01 * np.array(direction), abs=1e-12)
    assert (sticks().position == sticks().position).all()


def test_buttons_of_the_gamepad(pygame: Any) -> None:
    sticks = Sticks(pygame)
    assert sticks(("JOYBUTTONDOWN", {"button": 5})).clutch
    assert sticks(("JOYBUTTONDOWN", {"button": 0})).clutch
    assert not sticks(("JOYBUTTONUP", {"button": 5})).clutch
    assert sticks(("JOYBUTTONDOWN", {"button": 5}), ("JOYAXISMOTION", {"axis": 1, "value": -1.0})).clutch
    gone = sticks(("JOYDEVICEREMOVED", {"instance_id": 0}))
    assert not gone.clutch
    assert (sticks().position == gone.position).all()
    assert not sticks.master.done
    sticks(("JOYBUTTONDOWN", {"button": 7}), ("JOYBUTTONUP", {"button": 7}))
    assert sticks.master.done


def test_axes_and_buttons_that_cannot_be_used_are_refused(pygame: Any) -> None:
    for changed, name in (({"up": 1}, "up"), ({"leave": 5}, "leave")):
        with pytest.raises(ParameterError) as error:
            Gamepad(GamepadParameters(**changed), pygame.event)
        assert error.value.location == f"{AT}.{name}"


def test_the_window_shows_the_keys_and_hands_out_events(pygame: Any) -> None:
    with open_window(KeyboardParameters()) as window:
        master: Master = Keyboard(KeyboardParameters(), window)
        surface = pygame.display.get_surface()
        assert pygame.display.get_caption()[0] == "clpv teleop"
        assert pygame.transform.average_color(surface)[0] > 0  # there is white on the black
        surface.fill("black")
        pygame.event.post(pygame.event.Event(pygame.WINDOWEXPOSED))
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_SPACE))
        sample = master.sample(0.0, SEEN)
        assert sample is not None
        assert sample.clutch
        assert pygame.transform.average_color(surface)[0] > 0  # drawn again
    assert not pygame.display.get_init()


def test_a_window_is_closed_where_the_demonstration_fails(pygame: Any) -> None:
    def fail() -> None:
        with open_window(KeyboardParameters()) as window:
            assert isinstance(window, Window)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not pygame.display.get_init()


def test_a_gamepad_that_is_not_there_is_refused(pygame: Any) -> None:
    with (
        pytest.raises(UsageError, match=r"gamepad 9 is not there, \d+ connected"),
        open_window(GamepadParameters(device=9)),
    ):
        pass


def test_without_a_display_one_sentence_says_so(pygame: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    pygame.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "nothing")
    says = "kind = keyboard needs a window, and none can be opened"
    with pytest.raises(UsageError, match=says), open_window(KeyboardParameters()):
        pass
    # What SDL falls back to by itself is no display, either.
    for name in ("SDL_VIDEODRIVER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UsageError, match=says), open_window(KeyboardParameters()):
        pass
    assert not pygame.display.get_init()
