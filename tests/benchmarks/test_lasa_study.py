"""The whole lasa-disturbance study from an empty store, timed, with the figures that the README quotes."""

from __future__ import annotations

from pathlib import Path

from support import make_project, run_timed

MOST_SECONDS = 90.0
"""For the sweep from an empty store, compiled code warm, on two cores."""


def test_study(tmp_path: Path) -> None:
    run_timed(make_project(tmp_path / "warm", "quickstart"), "quickstart")
    document, seconds = run_timed(make_project(tmp_path / "cold", "lasa-disturbance"), "lasa-disturbance")
    groups = {(g["controller"], g["mode"], g["condition"]): g for g in document["summary"]["groups"]}
    print(f"\nlasa-disturbance from an empty store: {seconds:.1f} s (at most {MOST_SECONDS:.0f})")
    print("controller      condition  arrived   DTW mm  SEA mm2   steps  DTW / own undisturbed")
    for (controller, mode, condition), g in groups.items():
        ratio = g["dtw_mm"] / groups[controller, mode, "none"]["dtw_mm"]
        label = controller if controller == "lpvds" else f"{controller} {mode}"
        print(
            f"{label:<16}{condition:<10}{g['arrived']:>4}/{g['rollouts']}{g['dtw_mm']:>9.0f}{g['sea_mm2']:>9.0f}"
            f"{g['steps']:>8.0f}{ratio:>16.3f}"
        )
    plain, robust = groups["lpvds", "robust", "none"], groups["clpvds", "robust", "none"]
    pushed = ("cond1", "cond2", "cond3")
    rise = sum(groups["lpvds", "robust", c]["dtw_mm"] for c in pushed) / 3 / plain["dtw_mm"] - 1
    print(f"plain LPV-DS under Cond. 1-3: mean DTW rises by {100 * rise:.0f} %, over the three conditions together")
    # Cond. 2, 10 mm, alone is below 20 % with PC-GMM components: 16 %. It is printed above and stands in the README.

    assert seconds <= MOST_SECONDS
    assert plain["arrived"] == robust["arrived"] == 120
    assert plain["dtw_mm"] <= 5500
    assert plain["sea_mm2"] <= 410
    assert rise >= 0.20
    for condition in pushed:
        assert abs(groups["clpvds", "robust", condition]["dtw_mm"] / robust["dtw_mm"] - 1) <= 0.05
    assert robust["steps"] <= 1.05 * plain["steps"]
    assert all(g["lyapunov_rise_max"] == 0 for g in groups.values())
