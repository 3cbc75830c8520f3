"""The report's section of two arms with a box draws what was recorded, and its numbers are those of the metrics."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawings import drawn, strokes, texts
from made_boxes import GOAL, START, box, column, learn, results_of, said, tables, with_boxes
from pages import check_page

from pipeline.report import Figure, Paragraph, assemble
from stages.artifacts.demonstrations import write_demonstrations
from stages.artifacts.metrics import read_metrics
from stages.dynamics.parameters import QlfParameters
from stages.evaluate.parameters import EvaluateParameters
from stages.figures import animation
from stages.figures.carry_cases import held_groups
from stages.figures.carry_panels import (
    MOST_LINES,
    Led,
    Pressed,
    Way,
    force_panel,
    spread,
    way_frame,
    way_panel,
)
from stages.figures.carry_section import carry_section, carry_sentence, chosen
from stages.figures.deviation import Deviation, Resolved
from stages.figures.deviations import deviations
from stages.figures.intervals import tally
from stages.figures.numbers import MISSING, NO_BREAK, number
from stages.figures.results import PointResults, Results
from stages.figures.sections import lead, sections
from stages.figures.teleoperation_figure import led_by, teleoperation_figure
from stages.ingest.parameters import LasaParameters
from stages.mixture.parameters import EmParameters
from stages.policy.outcome import Outcome
from stages.policy.parameters import AdmittanceParameters
from stages.rollout.parameters import CarryCondition, CarryParameters
from stages.trajectory import ArmRecording, Demonstration

MIXED = (
    box(number=0),
    box(number=1, force=(4.0, 6.0)),
    box("<stiff>", 0, force=(3.0, 3.0), compliance=False),
    box("<stiff>", 1, force=(11.0, 30.0), compliance=False, outcome=Outcome.LOST_BOX, ratio=1.2),
)


@pytest.fixture(autouse=True)
def few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """The moving picture of a report takes seconds; `test_camera.py` looks at it."""
    monkeypatch.setattr(animation, "PICTURES", 2)


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return learn(tmp_path_factory.mktemp("carry"))


# --- tables ---------------------------------------------------------------------------------------------------------


def test_numbers_in_the_tables_are_those_of_the_rows(learned: Results, tmp_path: Path) -> None:
    results = results_of(learned, tmp_path, MIXED)
    rows = read_metrics(results.shown.files["metrics"])
    delivery, failures, force, every = tables(carry_section(results))
    assert column(delivery, "condition") == ["held", "<stiff>"]
    assert column(delivery, "pressing") == ["admittance, robust", "no compliance"]
    assert column(delivery, "error of L [mm]") == ["0 to 1", "0 to 1"]
    assert column(delivery, "delivered") == [tally(2, 2), tally(1, 2)]
    assert column(delivery, "dropped") == ["0", "1"]
    assert column(delivery, "ended otherwise") == [MISSING, "lost-box: 1"]
    assert column(delivery, "error of delivery [mm]", "mean") == ["0", "0"]
    assert column(delivery, "grip ratio at least 1.7", "boxes") == ["2", "1"]
    assert column(delivery, "below 1.7", "boxes") == [MISSING, "1"]
    assert column(delivery, "below 1.7", "slip [mm]") == [MISSING, number(rows[3]["slip_max_mm"])]
    assert rows[3]["slip_max_mm"] > 100.0  # the box fell while the pads were still carrying
    assert column(failures, "outcome") == ["lost-box"]
    assert column(failures, "what helps") == [Outcome.LOST_BOX.remedy]
    # Of 10 samples of each arm: 5; 4 and 6; 3; 11 and 30.
    assert column(force, "mean force [N]", "mean") == ["5.00", number((3.0 + 20.5) / 2)]
    assert column(force, "deviation [N]") == ["0.500", number(9.5 / 2)]
    assert column(force, "percentiles [N]", "5th, lowest") == ["4.00", "3.00"]
    assert column(force, "percentiles [N]", "95th, highest") == ["6.00", "30.0"]
    assert column(force, "time in the band", "least") == [f"100{NO_BREAK}%", f"0.0{NO_BREAK}%"]
    assert column(force, "settles at [N]") == ["5", MISSING]
    assert column(every, "roll-out") == [r["rollout"] for r in rows]
    for name, digits in (("force_mean_n", 3), ("force_p95_n", 3), ("slip_max_mm", 3), ("dtw_mm", 4)):
        title = {
            "force_mean_n": "force [N]",
            "force_p95_n": "95 % [N]",
            "slip_max_mm": "slip [mm]",
            "dtw_mm": "DTW [mm]",
        }
        assert column(every, title[name]) == [number(r[name], digits) for r in rows]


def test_a_bias_of_the_sensors_is_told_apart(learned: Results, tmp_path: Path) -> None:
    boxes = [box(number=0, force=(4.9, 4.9), bias=0.1), box(number=1, force=(5.2, 5.2), bias=-0.2)]
    _, force, _ = tables(carry_section(results_of(learned, tmp_path, boxes)))
    assert column(force, "mean force [N]", "mean") == ["5.05"]
    assert column(force, "mean force [N]", "beyond the bias") == ["5.00"]
    (tmp_path / "more").mkdir()
    _, force, _ = tables(carry_section(results_of(learned, tmp_path / "more", [box()])))
    assert "beyond the bias" not in force.columns


def test_the_printed_law_is_told_apart_and_its_force_explained(learned: Results, tmp_path: Path) -> None:
    stiff = box("stiff", compliance=False)
    point = with_boxes(
        learned, tmp_path, [box(mode="paper", force=(4.81, 4.81)), box("stiff", mode="paper", compliance=False)]
    )
    given = replace(point.point.parameters["rollout"], mode="paper")
    own = replace(point.point, id="mode=paper", parameters={**point.point.parameters, "rollout": given})
    swept = replace(own, overrides={"rollout.mode": "paper"})
    robust = with_boxes(learned, tmp_path, [box(), stiff], name="robust")
    results = replace(learned, points=(robust, replace(point, point=swept)))
    section = carry_section(results)
    force = tables(section)[1]
    assert column(force, "pressing") == ["admittance, robust", "no compliance", "admittance as printed"]
    assert column(force, "settles at [N]") == ["5", MISSING, "4.81"]  # 5 * 25/26
    assert column(force, "mean force [N]", "mean") == ["5.00", "5.00", "4.81"]
    assert "F_{d} k_{p}/(k_{p} + 1) = 4.808 N instead of 5 N; the mean over roll-outs is 4.810 N" in said(section)
    assert "sweep" not in force.columns  # modes are told apart by the law
    assert column(force, "carried") == ["1", "1", "1"]  # without compliance the same box in both modes, counted once


def test_replicates_are_pooled_and_other_points_of_a_sweep_are_not(learned: Results, tmp_path: Path) -> None:
    def at(name: str, value: Any, ident: str) -> PointResults:
        point = with_boxes(learned, tmp_path, [box(), box(number=1)], name=ident)
        return replace(point, point=replace(point.point, id=ident, overrides={name: value}))

    pooled = replace(learned, points=tuple(at("rollout.replicate", k, f"replicate={k}") for k in (0, 1, 2)))
    delivery, force, every = tables(carry_section(pooled))
    assert column(delivery, "delivered") == [tally(6, 6)]
    assert column(every, "roll-out")[2] == "replicate=1: clpvds-robust/held/0"
    assert [len(held.rollouts) for held in held_groups(pooled)] == [6]
    apart = replace(learned, points=tuple(at("rollout.scene.mass", m, f"mass={m}") for m in (0.2, 0.6)))
    delivery, force, _ = tables(carry_section(apart))
    assert column(delivery, "sweep") == column(force, "sweep") == ["mass 0.2", "mass 0.6"]


# --- the section and the page ---------------------------------------------------------------------------------------


def test_figures_say_in_words_what_they_show(learned: Results, tmp_path: Path) -> None:
    section = carry_section(results_of(learned, tmp_path, MIXED))
    assert section is not None
    ways, forces = (block for block in section.blocks if isinstance(block, Figure))  # no teleoperation: one point
    assert [panel.alt for panel in ways.panels][::2] == [
        "held, seen from above. Boxes delivered: 2 of 2.",
        "<stiff>, seen from above. Boxes delivered: 1 of 2.",
    ]
    assert "not delivered" in [key.label for key in ways.legend]
    assert forces.panels[0].alt == (
        "held: left arm, contact force over time, 2 roll-outs: while carried 4.50 N in the mean, nine in ten samples "
        "within 4.00 to 5.00 N."
    )
    assert "Peaks of up to 30.0 N are cut off at 3 F_{d}." in forces.caption
    assert {"grip", "carry", "set-down", "release"} <= set(texts(forces.panels[0].svg))


def test_the_whole_report_leaves_out_what_makes_no_sense_and_escapes_names(learned: Results, tmp_path: Path) -> None:
    results = results_of(learned, tmp_path, MIXED)
    made = sections(results)
    page, shown = assemble("box", lead(results), made), [section.id for section in made]
    check_page(page)
    assert shown[0] == "carry"
    assert not {"rollouts", "accuracy", "metrics", "recovery", "facts", "obstacles", "kinds"} & set(shown)
    assert {"certificates", "deviations", "parameters", "provenance"} <= set(shown)
    assert "&lt;stiff&gt;" in page
    assert "<stiff>" not in page
    assert "A &lt;box&gt; &amp; two arms" in page


def test_the_lead_counts_boxes_and_gives_the_force(learned: Results, tmp_path: Path) -> None:
    results = results_of(learned, tmp_path, MIXED)
    sentence = carry_sentence(results)
    assert sentence == (
        "Boxes that two arms delivered: with compliance 2 of 2 (mean contact force 5.00 N) and without compliance "
        "1 of 2 (mean contact force 11.8 N); 5 N were wanted."
    )
    (paragraph,) = [b for b in lead(results)[1:] if isinstance(b, Paragraph)]
    assert paragraph.text == sentence


@pytest.mark.parametrize(
    "boxes",
    [
        [box()],
        [box("<stiff>", compliance=False)],
        [box(outcome=Outcome.LOST_BOX)],
        [box(outcome=Outcome.NOT_GRIPPED)],
        [box(), box("<stiff>", compliance=False, outcome=Outcome.NOT_GRIPPED)],
        [box(outcome=Outcome.MISPLACED)],
    ],
    ids=["compliant", "stiff", "lost", "not gripped", "stiff not gripped", "misplaced"],
)
def test_a_report_of_few_or_failed_roll_outs_is_made(
    learned: Results, tmp_path: Path, boxes: list[SimpleNamespace]
) -> None:
    results = results_of(learned, tmp_path, boxes)
    section = carry_section(results)
    delivery = tables(section)[0]
    delivered = [held.outcome is Outcome.ARRIVED for held in boxes]
    cells = column(delivery, "delivered")
    assert sum(int(cell.partition(NO_BREAK)[0]) for cell in cells) == sum(delivered)
    assert len(tables(section)) == (3 if all(delivered) else 4)  # with what helps
    assert section is not None
    page = assemble("box", lead(results), [section])
    assert not re.search(r"\b(nan|inf|infinite)\b", page)


def test_a_box_that_was_never_carried_has_no_forces(learned: Results, tmp_path: Path) -> None:
    results = results_of(learned, tmp_path, [box(outcome=Outcome.NOT_GRIPPED)])
    force = tables(carry_section(results))[2]
    assert column(force, "carried") == ["0"]
    assert column(force, "mean force [N]", "mean") == column(force, "deviation [N]") == [MISSING]
    assert column(force, "time in the band", "least") == [MISSING]
    assert "never carried" in carry_sentence(results)


def test_without_arms_there_is_no_section() -> None:
    assert carry_section(None) is None
    assert carry_sentence(None) == ""


def test_pictures_show_each_law_before_they_show_more_of_one(learned: Results, tmp_path: Path) -> None:
    boxes = [box(name) for name in ("a", "b", "c", "d", "e")] + [box("f", compliance=False)]
    groups = held_groups(results_of(learned, tmp_path, boxes))
    assert [held.condition for held in chosen(groups)] == ["a", "b", "c", "f"]
    assert [held.condition for held in chosen(groups[:2])] == ["a", "b"]


# --- pictures -------------------------------------------------------------------------------------------------------


def pressed(count: int) -> list[Pressed]:
    return [Pressed(time=np.linspace(-1.0, 5.0 + k, 50), force=np.full(50, 4.0 + 0.1 * k)) for k in range(count)]


def test_few_roll_outs_are_lines_and_many_are_a_band() -> None:
    phases = {"grip": -0.5, "carry": 0.0}

    def drawn_of(count: int) -> str:
        return force_panel(pressed(count), phases, (5.0,), (2.0, 10.0), "Title", "series-2", (-1.0, 6.0), 2)

    assert strokes(drawn_of(3), "series-2") == 3
    assert strokes(drawn_of(MOST_LINES), "series-2") == MOST_LINES
    many = drawn_of(MOST_LINES + 1)
    assert strokes(many, "series-2") == 1
    assert {"Title", "time since the lift [s]", "contact force [N]", "grip", "carry"} <= set(texts(many))


def test_the_band_of_many_roll_outs_is_of_those_that_are_there() -> None:
    clock, low, middle, high = spread(pressed(11), (-2.0, 20.0))
    before, during, after = clock < -1.0, (clock > 0.0) & (clock < 5.0), clock > 15.0
    assert np.isnan(middle[before]).all()
    assert np.isnan(low[after]).all()
    assert middle[during] == pytest.approx(np.full(during.sum(), 4.5))
    assert low[during] == pytest.approx(np.full(during.sum(), 4.05))
    assert high[during] == pytest.approx(np.full(during.sum(), 4.95))
    last = (clock > 14.1) & (clock < 14.9)  # only the longest is left
    assert middle[last] == pytest.approx(np.full(last.sum(), 5.0))


def test_the_way_shows_boxes_demonstrations_and_crosses_what_was_lost() -> None:
    path = START + np.linspace(0.0, 1.0, 20)[:, None] * (GOAL - START)
    way = Way(demonstrations=[path, path + 0.01], box=np.array([0.2, 0.3, 0.2]), start=START, goal=GOAL)
    (x0, x1), (y0, y1) = extent = way_frame(way, [path], (1, 2))
    assert x0 < START[1] - 0.15
    assert x1 > GOAL[1] + 0.15
    assert y0 < START[2] - 0.1
    assert y1 > GOAL[2] + 0.1

    def of(lost: list[bool]) -> str:
        return way_panel(way, [path, path], lost, "Title", "series-1", extent, (1, 2), 2)

    assert strokes(of([False, False]), "series-1") == 2
    assert strokes(of([False, False]), "ink") == 2
    assert strokes(of([False, False]), "muted") == 2  # edges of both boxes
    assert len(drawn(of([True, False]), "use")) == len(drawn(of([False, False]), "use")) + 1
    assert {"y [mm]", "z [mm]"} <= set(texts(of([True, True])))


# --- teleoperation --------------------------------------------------------------------------------------------------


def arm(side: float, force: bool = True, begin: float = 0.0, step: float = 0.02) -> ArmRecording:
    """An arm 0.15 m beside a midpoint that goes 0.1 m/s along x and presses with 5 N; 2 s."""
    time = begin + step * np.arange(round(2.0 / step) + 1)
    position = np.column_stack([0.1 * time, np.full(time.shape, 0.15 * side), np.full(time.shape, 0.4)])
    pressing = np.tile([0.0, 3.0, -4.0], (time.shape[0], 1)) if force else None
    return ArmRecording(time=time, position=position, force=pressing)


def test_arms_of_a_demonstration_share_a_clock() -> None:
    led = led_by(arm(1.0), arm(-1.0, begin=0.5, step=0.03), 1)
    assert led is not None
    assert led.time[0] == 0.0
    assert led.time[-1] == pytest.approx(1.5)
    assert led.separation == pytest.approx(np.full(led.time.shape, 0.3))
    assert led.midpoint[:, 0] == pytest.approx(0.1 * (led.time + 0.5))
    assert led.speed == pytest.approx(np.full(led.time.shape, 0.1))
    assert led.force is not None
    assert led.force == pytest.approx(np.full((2, led.time.shape[0]), 5.0))
    assert led_by(arm(1.0), arm(-1.0, begin=10.0), 1) is None


def test_the_speed_shows_a_stroke_and_a_pause() -> None:
    time = 0.01 * np.arange(201)
    x = 0.1 * np.minimum(time, 1.0)  # a stroke of a second, a second's rest
    at = np.column_stack([x, np.zeros((201, 2))])
    led = Led(time=time, arms=np.stack([at, at]), force=None, clamp_axis=1)
    assert led.speed[20:80] == pytest.approx(np.full(60, 0.1))
    assert led.speed[120:] == pytest.approx(np.zeros(81), abs=1e-12)


def test_the_demonstration_is_drawn_with_or_without_forces(learned: Results, tmp_path: Path) -> None:
    for force in (True, False):
        path = tmp_path / f"{force}.parquet"
        arms = {"left": arm(1.0, force), "right": arm(-1.0, force)}
        write_demonstrations(path, [Demonstration(dataset="<d>", demo="7", split="train", arms=arms)], {})
        point = learned.points[0]
        figure = teleoperation_figure(replace(point, files={**point.files, "demonstrations": path}))
        assert figure is not None
        assert "300 mm apart along y" in figure.panels[0].alt
        assert ("left 5.00 N and right 5.00 N" in figure.panels[1].alt) == force
        assert ("force [N]" in texts(figure.panels[1].svg)) == force
        assert figure.caption.startswith("Fig. 5e. <d>, demonstration 7: ")
        assert ("wrists measured" in figure.caption) == force
    assert teleoperation_figure(learned.points[0]) is None  # one point, no arms


# --- deviations -----------------------------------------------------------------------------------------------------


def rows_for(rollout: CarryParameters) -> list[Deviation]:
    parameters = {
        "ingest": LasaParameters(motion="Angle"),
        "mixture": EmParameters(),
        "dynamics": QlfParameters(),
        "rollout": rollout,
        "evaluate": EvaluateParameters(),
    }
    coupling = {"v_max": 0.75, "gate": 0.0, "p_max": 0.0, "k_c": 0.0}
    return deviations(parameters, [Resolved(top_speed=0.15, couplings={"clpvds robust": coupling})])


def text(rows: Sequence[Deviation], place: str) -> str:
    return " ".join(f"{r.printed} {r.here} {r.why}" for r in rows if r.where == place)


def test_deviations_of_the_admittance_follow_the_mode() -> None:
    robust, paper = rows_for(CarryParameters()), rows_for(CarryParameters(mode="paper"))
    places = ["(14)", "(15), (16)", "(17)", "(17), + F_{d}", "(18)", "(15)-(17), values"]
    for rows in (robust, paper):
        found = [row.where for row in rows]
        assert found[found.index("(14)") :][: len(places)] == places
        assert "= 4.81 N, not at 5 N" in text(rows, "(17), + F_{d}")
    assert "Not added." in text(robust, "(17), + F_{d}")
    assert "As printed." in text(paper, "(17), + F_{d}")
    assert "leaks away at 2 1/s" in text(robust, "(18)")
    assert "leak" not in text(paper, "(18)")
    other = rows_for(CarryParameters(admittance=AdmittanceParameters(force=8.0, k_p=3.0)))
    assert "= 6.00 N, not at 8 N" in text(other, "(17), + F_{d}")


def test_deviations_without_compliance_say_how_pads_press() -> None:
    stiff = CarryCondition(name="stiff", compliance=False)
    alone = rows_for(CarryParameters(conditions=(stiff,), squeeze=0.003))
    assert not [row for row in alone if row.where.startswith(("(15)", "(17)", "(18)"))]
    assert "3 mm beyond the face" in text(alone, "Fig. 5c, without compliance")
    assert not text(rows_for(CarryParameters()), "Fig. 5c, without compliance")
    both = rows_for(CarryParameters(conditions=(CarryCondition(), stiff)))
    assert text(both, "(17)")
    assert text(both, "Fig. 5c, without compliance")
