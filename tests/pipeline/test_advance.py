"""What a table of rows leaves out: what says nothing, and what says 0 throughout, which is told once."""

from __future__ import annotations

from typing import Any

from pipeline.advance import brief

ROWS: list[dict[str, Any]] = [
    {"kind": "a", "same": "x", "outcome": "arrived", "error": 1.0, "hits": 0, "rise": 0.0, "none": None, "held": False},
    {
        "kind": "b",
        "same": "x",
        "outcome": "arrived",
        "error": 0.0,
        "hits": 0,
        "rise": None,
        "none": None,
        "held": False,
    },
]


def test_rows_leave_out_what_says_nothing() -> None:
    shown, zero = brief(ROWS)
    assert [list(row) for row in shown] == [["kind", "outcome", "error", "held"]] * 2
    assert zero == ["hits", "rise"]
    assert shown[0] == {"kind": "a", "outcome": "arrived", "error": 1.0, "held": False}


def test_a_single_row_is_shown_whole() -> None:
    assert brief(ROWS[:1]) == (ROWS[:1], [])
    assert brief([]) == ([], [])
