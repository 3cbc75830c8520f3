"""What ``clpv show`` draws of demonstrations, mixtures, systems and metrics: files of a stage in, small plots out.

The stages name these functions by import string, so that no key depends on what is drawn. Files are those of the stage
and of the stages before it. Not here: roll-outs (`terminal_rollouts.py`), and how plots are drawn (`pipeline.drawing`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.plots import Bar, Bars, Plot, Series
from stages.figures.flow import planes
from stages.figures.numbers import MM
from stages.trajectory import Array

Files = Mapping[str, Path]

FEW = 60
"""Samples of a path that is shown as dots."""

SIDES = {"left": "L", "right": "R"}
"""Arms and their signs; the one point of a recording without arms has none."""

GOAL = "G"

Place = tuple[int, int]
"""The two coordinates that are shown."""


def ingest(files: Files) -> list[Plot | Bars]:
    """The demonstrations as recorded, by arm."""
    from stages.artifacts.demonstrations import read_demonstrations

    paths: dict[str, list[Array]] = {}
    for demonstration in read_demonstrations(files["demonstrations"]):
        for arm, recording in demonstration.arms.items():
            paths.setdefault(arm, []).append(recording.position)
    plane = plane_of([path for found in paths.values() for path in found])
    series = [
        line(arm if len(paths) > 1 else "", found, plane, mark=SIDES.get(arm, "")) for arm, found in paths.items()
    ]
    return [plane_plot(f"Demonstrations as recorded: {len(next(iter(paths.values())))}", plane, series)]


def midpoint(files: Files) -> list[Plot | Bars]:
    """The demonstrations as they are learned from and tested on, and their goal."""
    from stages.artifacts.midpoints import read_midpoints

    found = read_midpoints(files["midpoints"])
    plane = plane_of([t.position for t in found.trajectories])
    goal = points("goal", [found.goal], plane, GOAL)
    drawn = {}
    for split, word in (("train", "training"), ("test", "test")):
        paths = [t.position for t in found.of_split(split)]
        if paths:
            drawn[f"Demonstrations, {word}: {len(paths)}"] = [line("", paths, plane), goal]
    within = [one for series in drawn.values() for one in series]
    return [plane_plot(title, plane, series, within) for title, series in drawn.items()]


def mixture(files: Files) -> list[Plot | Bars]:
    """How the sampler's chains, and EM, came to what they found."""
    from stages.artifacts.mixture import read_sampler

    columns, criteria = read_sampler(files["sampler"])
    courses: dict[tuple[str, str], list[Series]] = {}
    for candidate in dict.fromkeys(columns["candidate"].tolist()):
        sampled = candidate == "pcgmm"
        labels = ("Log posterior of PC-GMM's chains", "sweep") if sampled else ("Log likelihood by EM", "iteration")
        own = columns["candidate"] == candidate
        for chain in dict.fromkeys(columns["chain"][own].tolist()):
            part = own & (columns["chain"] == chain)
            name = f"chain {chain}" if sampled else candidate
            sweep = np.asarray(columns["sweep"][part], dtype=np.float64)
            courses.setdefault(labels, []).append(Series(name=name, x=sweep, y=columns["log_posterior"][part]))
    plots: list[Plot | Bars] = [
        Plot(title=title, x_label=label, y_label="log density", series=tuple(series))
        for (title, label), series in courses.items()
    ]
    for candidate, criterion in criteria.items():
        if len(criterion) > 1:
            lowest = min(criterion.values())
            bars = tuple(Bar(name=f"{k} components", value=value - lowest) for k, value in criterion.items())
            plots.append(Bars(title=f"Bayesian information criterion of {candidate}, above its lowest", bars=bars))
    return plots


def dynamics(files: Files) -> list[Plot | Bars]:
    """Where the components of the system lie, and the scores of what it was chosen from."""
    from stages.artifacts.dynamics import read_details, read_dynamics
    from stages.artifacts.midpoints import read_midpoints

    model, train = read_dynamics(files["dynamics"]), read_midpoints(files["midpoints"]).of_split("train")
    plane = plane_of([t.position for t in train])
    series = [
        line("training demonstrations", [t.position for t in train], plane),
        points("means of components", model.mixture.means, plane, "o"),
        points("goal", [model.goal], plane, GOAL),
    ]
    plots: list[Plot | Bars] = [plane_plot(f"The system's {model.mixture.components} components", plane, series)]
    tried = read_details(files["dynamics"])["tried"]
    if tried:
        bars = tuple(
            Bar(
                name=f"{entry['mixture']}, share {entry['share']:g}, guidance {entry['guidance']:g}",
                value=math.nan if entry["score"] is None else entry["score"] * MM,
                text=f"{entry['score'] * MM:.4g}, chosen" if entry["chosen"] and entry["score"] is not None else "",
            )
            for entry in tried
        )
        plots.append(Bars(title="Scores of the candidates [mm]: the lowest is best", bars=bars))
    return plots


def evaluate(files: Files) -> list[Plot | Bars]:
    """The headline measures by case: of a box, deliveries and forces; among obstacles, arrivals; else distances."""
    from stages.artifacts.metrics import read_metrics

    rows = read_metrics(files["metrics"])
    carried = [row for row in rows if row["delivered"] is not None]
    among = [row for row in rows if row["delivered"] is None and row["scene"] is not None]
    alone = [row for row in rows if row["delivered"] is None and row["scene"] is None]
    plots: list[Plot | Bars] = []
    if carried:
        plots.append(_shares("Boxes delivered", carried, ("condition",), lambda row: bool(row["delivered"])))
        wanted = sorted({row["desired_force_n"] for row in carried if row["desired_force_n"] is not None})
        title = "Mean contact force [N]" + (f"; F_d is {_span(wanted)} N at the end" if wanted else "")
        plots.append(_means(title, carried, ("condition",), "force_mean_n"))
    if among:
        names = ("controller", "mode", "avoidance")
        plots.append(_shares("Arrived among obstacles", among, names, lambda row: row["outcome"] == "arrived"))
    names = ("controller", "mode", "condition")
    if alone and not (among and len(_grouped(alone, names)) == 1):  # there, only what avoidance is compared with
        plots.append(_means("Mean dynamic time warping distance to the demonstrations [mm]", alone, names, "dtw_mm"))
    return plots


# --- what is drawn of paths, also of roll-outs ------------------------------------------------------------------------


def plane_of(paths: Sequence[Array]) -> Place:
    """The two coordinates in which paths, arrays, shape (n, d), metres, reach farthest; gaps are nan."""
    whole = [path[np.isfinite(path).all(axis=1)] for path in paths]
    return planes(whole)[0] if sum(path.shape[0] for path in whole) else (0, 1)


def line(name: str, paths: Sequence[Array], plane: Place, *, mark: str = "", faint: bool = False) -> Series:
    """Paths, arrays, shape (n, d), metres, as one series of lines, mm."""
    x, y = _apart(paths, plane)
    return Series(name=name, x=x, y=y, mark=mark, faint=faint)


def dotted(name: str, paths: Sequence[Array], plane: Place) -> Series:
    """Paths, arrays, shape (n, d), metres, as faint dots, mm: what others are seen against."""
    thin = [path[np.unique(np.linspace(0, path.shape[0] - 1, FEW).round().astype(int))] for path in paths if len(path)]
    x, y = _apart(thin, plane)
    return Series(name=name, x=x, y=y, joined=False, faint=True)


def points(name: str, at: Sequence[Array] | Array, plane: Place, mark: str) -> Series:
    """Points, arrays, shape (d,), metres, by their sign, mm."""
    x, y = np.array([np.asarray(point)[list(plane)] * MM for point in at]).reshape(-1, 2).T
    return Series(name=name, x=x, y=y, joined=False, mark=mark)


def plane_plot(title: str, plane: Place, series: Sequence[Series], within: Sequence[Series] = ()) -> Plot:
    """Series, mm, on one scale; `within`: what the axes show at least, for plots that are to be compared."""
    labels = [f"{'xyz'[axis]} [mm]" for axis in plane]
    limits = [_extent([getattr(s, name) for s in within]) if within else None for name in ("x", "y")]
    return Plot(
        title=title,
        x_label=labels[0],
        y_label=labels[1],
        series=tuple(series),
        same_scale=True,
        x_limits=limits[0],
        y_limits=limits[1],
    )


def _apart(paths: Sequence[Array], plane: Place) -> tuple[Array, Array]:
    """Two coordinates of paths one after the other, mm, with nan between them."""
    gap = np.full((1, 2), np.nan)
    parts = [part for path in paths for part in (path[:, list(plane)] * MM, gap)]
    x, y = np.concatenate([np.zeros((0, 2)), *parts]).T
    return x, y


def _extent(values: Sequence[Array]) -> tuple[float, float] | None:
    pooled = np.concatenate([one[np.isfinite(one)] for one in values])
    return (float(pooled.min()), float(pooled.max())) if pooled.size else None


# --- bars of metrics --------------------------------------------------------------------------------------------------

Rows = Sequence[Mapping[str, Any]]


def _grouped(rows: Rows, names: Sequence[str]) -> dict[str, list[Mapping[str, Any]]]:
    """Rows by the values of columns, in words: a column that says the same everywhere is left out."""
    told = [name for name in names if len({row[name] for row in rows}) > 1] or list(names[-1:])
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(", ".join(str(row[name]) for name in told), []).append(row)
    return groups


def _shares(title: str, rows: Rows, names: Sequence[str], passed: Callable[[Mapping[str, Any]], bool]) -> Bars:
    bars = []
    for name, members in _grouped(rows, names).items():
        count = sum(map(passed, members))
        bars.append(Bar(name=name, value=count / len(members), text=f"{count} of {len(members)}"))
    return Bars(title=title, bars=tuple(bars), full=1.0)


def _means(title: str, rows: Rows, names: Sequence[str], measure: str) -> Bars:
    bars = []
    for name, members in _grouped(rows, names).items():
        values = [row[measure] for row in members if row[measure] is not None]
        bars.append(Bar(name=name, value=math.fsum(values) / len(values) if values else math.nan))
    return Bars(title=title, bars=tuple(bars))


def _span(values: Sequence[float]) -> str:
    """The one value, or the smallest and the largest, of sorted values."""
    low, high = f"{values[0]:.3g}", f"{values[-1]:.3g}"
    return low if low == high else f"{low} to {high}"
