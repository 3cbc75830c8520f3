"""95 % intervals, of means by the bootstrap or Student's t, of counted shares by Wilson, and how tables write them.

Arrays and counts in, numbers and text out. What roll-outs have in common, as a motion of a sweep, varies as one: means
are resampled by what varies. Resamples of few vary less than the mean does, so there Student's t is taken.
"""

from __future__ import annotations

import functools
import math
import zlib
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from stages.figures.numbers import MISSING, NO_BREAK, number, percent
from stages.trajectory import Array

RESAMPLES = 4000
"""Bootstrap resamples of an interval; its ends then vary by about a fiftieth of its width."""

FEW = 10
"""Below this number of values intervals of means are Student's: resamples of few vary less than the mean does."""

FEWEST = 3
"""Below this number a mean gets no interval: two values say next to nothing of how far a third may be."""

STUDENT = "Student's t"

SHARES = "In brackets: 95 % intervals (Wilson)"
"""What captions say of tables with intervals of shares alone."""


def brackets(over: str, most: int, *, shares: bool = True) -> str:
    """What captions say of tables with intervals of means, and of shares.

    Arguments:
        over: what means are taken over and resampled by, in the plural.
        most: how many of it the mean of the most has.
        shares: whether the table has any.
    """
    if most < FEWEST:
        return SHARES if shares else f"Means over fewer than {FEWEST} {over} have no interval"
    how = f"bootstrap; {STUDENT} of fewer than {FEW}" if most >= FEW else STUDENT
    means = f"of means over {over} ({how})"
    return f"In brackets: 95 % intervals{', of shares (Wilson) and' if shares else ''} {means}"


def wilson(count: int, total: int, z: float = 1.959964) -> tuple[float, float]:
    """95 % interval of a share that was counted as `count` of `total`: Wilson's score interval (1927)."""
    share, n = count / total, float(total)
    middle = share + z * z / (2.0 * n)
    half = z * math.sqrt(share * (1.0 - share) / n + z * z / (4.0 * n * n))
    return max((middle - half) / (1.0 + z * z / n), 0.0), min((middle + half) / (1.0 + z * z / n), 1.0)


def bootstrap_interval(values: Array, name: str) -> tuple[float, float]:
    """95 % interval of the mean of `values`, shape (n,): percentiles over resamples, drawn by a seed made of `name`."""
    return _percentiles(values[_drawn(values.shape[0], name)].mean(axis=1))


def student(means: Array, middle: float) -> tuple[float, float]:
    """95 % interval about `middle` by the spread of n means, shape (n,): Student's t with n - 1 degrees of freedom."""
    from scipy.special import stdtrit

    n = means.shape[0]
    half = float(stdtrit(n - 1, 0.975)) * float(means.std(ddof=1)) / math.sqrt(n)
    return middle - half, middle + half


def change_interval(before: Array, after: Array, name: str) -> tuple[float, float]:
    """95 % interval of the ratio of two means, less one: `after` to `before`, shape (n,), resampled in pairs."""
    drawn = _drawn(after.shape[0], name)
    return _percentiles(after[drawn].mean(axis=1) / before[drawn].mean(axis=1) - 1.0)


def mean_interval(values: Sequence[float], units: Sequence[Hashable], name: str) -> tuple[float, float] | None:
    """95 % interval of the mean of all values, by unit: resampled, or, of fewer than `FEW` units, Student's.

    None where there are fewer than `FEWEST` units.

    Arguments:
        values: one a roll-out.
        units: what each of them belongs to; those of a unit are drawn together.
        name: makes the seed.
    """
    places = {unit: index for index, unit in enumerate(dict.fromkeys(units))}
    if len(places) < FEWEST:
        return None
    own = np.array([places[unit] for unit in units])
    sums = np.bincount(own, weights=np.array(values, dtype=np.float64))
    counts = np.bincount(own)
    if len(places) < FEW:
        return student(sums / counts, math.fsum(values) / len(values))
    drawn = _drawn(len(places), name)
    return _percentiles(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1))


def mean_cell(
    rows: Iterable[Mapping[str, Any]], name: str, digits: int = 3, *, unit: str = "", ratio: bool = False
) -> str:
    """The mean of a column over roll-outs, as in ``5.02 (4.96 to 5.07)``; a dash where there is nothing.

    Arguments:
        rows: of metrics.parquet, each with its point; those without the value are left out.
        name: of the column.
        digits: significant ones.
        unit: column that says which roll-outs are drawn together; "": each is drawn alone.
        ratio: whether values are shares, written as percentages.
    """
    known = [row for row in rows if row[name] is not None and not math.isnan(row[name])]
    units = [row[unit] for row in known] if unit else range(len(known))
    return spread_cell([float(row[name]) for row in known], units, name, digits, ratio=ratio)


def spread_cell(
    values: Sequence[float], units: Sequence[Hashable], name: str, digits: int = 3, *, ratio: bool = False
) -> str:
    """The mean of values and, where units are not few, its interval; arguments as of `mean_interval`, `mean_cell`."""
    if not values:
        return MISSING
    mean, interval = math.fsum(values) / len(values), mean_interval(values, units, name)
    if interval is not None and min(values) >= 0.0:  # Student's t knows no bounds; lengths, forces and shares do
        interval = max(interval[0], 0.0), min(interval[1], 1.0 if ratio else math.inf)
    written = percent if ratio else functools.partial(number, digits=digits)
    return with_interval(written(mean), interval and tuple(map(written, interval)))


def with_interval(text: str, ends: Sequence[str] | None) -> str:
    """What was found and its interval, as in ``5.02 (4.96 to 5.07)``; only between the two may a line break.

    Of percentages the sign is written once: ``86 % (49 to 97 %)``.
    """
    if ends is None:
        return text.replace(" ", NO_BREAK)
    interval = f"({ends[0].removesuffix(f'{NO_BREAK}%')} to {ends[1]})"
    return f"{text.replace(' ', NO_BREAK)} {interval.replace(' ', NO_BREAK)}"


def of(count: int, total: int) -> str:
    """As in ``6 of 7``."""
    return f"{count} of {total}".replace(" ", NO_BREAK)


def tally(count: int, total: int) -> str:
    """As in ``6 of 7 (49 to 97 %)``, with its 95 % interval; a dash where there is nothing to count."""
    if total == 0:
        return MISSING
    low, high = (100.0 * end for end in wilson(count, total))
    return with_interval(of(count, total), (f"{low:.0f}", f"{high:.0f} %"))


def share(count: int, total: int) -> str:
    """As in ``86 % (49 to 97 %)``, with its 95 % interval; a dash where there is nothing to count."""
    if total == 0:
        return MISSING
    return with_interval(percent(count / total), tuple(map(percent, wilson(count, total))))


def _drawn(count: int, name: str) -> Any:
    """Indices of resamples, shape (RESAMPLES, count), drawn by a seed made of `name`."""
    return np.random.default_rng(zlib.crc32(name.encode())).integers(0, count, size=(RESAMPLES, count))


def _percentiles(means: Array) -> tuple[float, float]:
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)
