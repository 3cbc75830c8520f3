"""The report's section on recordings: what was read, what cleaning found, how far apart the arms were. Results in."""

from __future__ import annotations

from typing import Any

from pipeline.report import Block, Paragraph, Section, Table
from stages.artifacts.parquet import header
from stages.figures.numbers import MISSING, MM, number
from stages.figures.results import PointResults, Results


def recordings_section(results: Results) -> Section | None:
    """Counts of the cleaning and the demonstrations one by one; none where the data were not recordings."""
    shown = results.shown
    counts = header(shown.files["demonstrations"]).get("counts", {})
    if not counts:
        return None
    details: dict[str, Any] = header(shown.files["midpoints"])
    blocks: list[Block] = [
        Table(
            caption="What was found and done while recordings became demonstrations",
            columns=("count of", "number"),
            rows=tuple((name.replace("_", " "), number(value)) for name, value in counts.items()),
        ),
        _demonstrations(shown, details),
    ]
    if "clamp_axis" in details:
        text = f"The arms clamp along {details['clamp_axis']}. L is their mean separation along it; deviation is the "
        blocks.append(Paragraph(text=text + "largest departure from that mean over the demonstration."))
    return Section(id="recordings", title="Recordings", blocks=tuple(blocks))


def _demonstrations(shown: PointResults, details: dict[str, Any]) -> Table:
    """One row a demonstration."""
    separations = details.get("separation") or [None] * len(shown.midpoints.trajectories)
    rows = []
    for index, trajectory in enumerate(shown.midpoints.trajectories):
        apart = separations[index]
        rows.append(
            (
                trajectory.demo,
                trajectory.split,
                number(trajectory.time.shape[0]),
                f"{trajectory.duration:.2f}",
                number(apart["mean"] * MM) if apart else MISSING,
                number(apart["deviation"] * MM) if apart else MISSING,
            )
        )
    columns = ("demonstration", "split", "samples", "duration [s]", "L [mm]", "deviation of L [mm]")
    return Table(caption="Demonstrations", columns=columns, rows=tuple(rows))
