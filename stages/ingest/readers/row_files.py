"""Recordings in rows, and those that are CSV: named columns, Baxter's joint_recorder files.

Their one topic is called ``table``. The clock is the column named in `CLOCKS`; its unit is the one its name ends with,
else it follows from the numbers, see `nanoseconds_in`. Not here: parquet (`parquet_files.py`), and what is an arm or a
pose (`selections/selection.py`).
"""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, Self, TextIO

import numpy as np

from pipeline.errors import DataError
from stages.ingest.names import nearest
from stages.ingest.readers.message_files import damage, integers
from stages.ingest.recording import Integrity, Nanoseconds, Request, Samples, Topic

CLOCKS = (
    *("time", "t", "timestamp", "stamp"),
    *(f"{name}_{unit}" for name in ("time", "timestamp", "stamp", "t") for unit in ("s", "ms", "us", "ns")),
    *("seconds", "sec", "header.stamp", "rosbagtimestamp"),
)
"""Names of a clock's column, in any case; the first that is there is taken."""

UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}

EPOCHS = ((1e17, 1), (1e14, 10**3), (1e11, 10**6))
"""Least value and nanoseconds in a unit: of today, times since 1970 are 1.8e18 ns, 1.8e15 us, 1.8e12 ms, 1.8e9 s."""

NANOSECOND_STEP = 1e5
"""Median step from which whole numbers count nanoseconds (0.1 ms and more): as seconds it would be more than a day."""

PEEKED = 1000
"""Rows by which a file is judged."""

LONGEST_HEAD = 1_000_000
"""Characters of a header line that are read at most."""


def nanoseconds_in(name: str, values: Sequence[float]) -> int:
    """Nanoseconds in the unit of a clock's column, by its name's end or by its first values.

    Since 1970: 1e17 and more are ns, 1e14 us, 1e11 ms. Below, whole numbers whose median step is 1e5 or more are ns,
    and all others are seconds.
    """
    ending = name.lower().rpartition("_")[2]
    if "_" in name and ending in UNITS:
        return UNITS[ending]
    if name.lower() == "rosbagtimestamp":
        return 1
    finite = np.array([value for value in values if math.isfinite(value)], dtype=np.float64)
    if finite.size == 0:
        return UNITS["s"]
    largest = float(np.abs(finite).max())
    for least, unit in EPOCHS:
        if largest >= least:
            return unit
    whole = bool((finite == np.floor(finite)).all())
    if whole and finite.size > 1 and float(np.median(np.abs(np.diff(finite)))) >= NANOSECOND_STEP:
        return 1
    return UNITS["s"]


class RowRecording:
    """A recording in rows; formats derive from it, give the rows, and say what its columns are."""

    def __init__(self, path: Path, format_name: str) -> None:
        self.path = path
        self.format = format_name
        self.columns: tuple[str, ...] = ()
        self.fields: tuple[str, ...] = ()
        self.names: Mapping[str, tuple[str, ...]] = {}
        self.clock = ""
        self.note = "Files of rows carry no checksums: a changed digit goes unnoticed."
        self._topic: Topic | None = None

    def rows(self, columns: Sequence[str], episode: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Time in nanoseconds and values of the columns, row by row."""
        raise NotImplementedError

    def integrity(self) -> Integrity:
        """Never protected."""
        return Integrity(protected=False, note=self.note)

    def close(self) -> None:
        """Nothing stays open."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def episodes(self) -> list[str]:
        """One, without a name."""
        return [""]

    def topics(self) -> list[Topic]:
        """The table."""
        if self._topic is None:
            times = self.clocks()["table"][0]
            self._topic = Topic(
                name="table",
                type="rows",
                count=len(times),
                first=int(times.min()) if len(times) else None,
                last=int(times.max()) if len(times) else None,
                fields=self.fields,
                names=self.names,
            )
        return [self._topic]

    def clocks(self) -> dict[str, tuple[Nanoseconds, Nanoseconds | None]]:
        """Times of the rows; they have no other stamps."""
        times = array("q")
        with damage(self.path):
            for episode in self.episodes():
                times.extend(time for time, _ in self.rows((), episode))
        return {"table": (integers(times), None)}

    def read(self, requests: Sequence[Request], episode: str = "") -> list[Samples]:
        """Numbers of the requests, in their order and in the order of the rows; streams.

        Raises DataError where a topic or a column is not there, a cell holds no number, or the file is damaged.
        """
        for request in requests:
            if request.topic != "table":
                raise DataError(self.path.name, f"holds rows, so its one topic is 'table', not {request.topic!r}.")
            for column in request.columns:
                if column not in self.columns:
                    raise DataError(self.path.name, f"has no column {column!r}; {nearest(column, self.columns)}")
        if episode not in self.episodes():
            raise DataError(self.path.name, f"has no episode {episode!r}; {nearest(episode, self.episodes())}")
        columns = tuple(dict.fromkeys(column for request in requests for column in request.columns))
        logs = [array("q") for _ in requests]
        values = [array("d") for _ in requests]
        with damage(self.path):
            for number, (time, row) in enumerate(self.rows(columns, episode), start=1):
                for request, log, found in zip(requests, logs, values, strict=True):
                    try:
                        numbers = request.extract(row)
                        if numbers is None:
                            continue
                        if len(numbers) != request.width:
                            raise ValueError(f"{len(numbers)} numbers instead of {request.width}")
                        found.extend(numbers)
                    except DataError:
                        raise
                    except Exception as error:
                        raise DataError(
                            f"{self.path.name}, row {number}", f"does not hold what is selected of it ({error})."
                        ) from error
                    log.append(time)
        return [
            Samples(
                log_time=integers(log),
                stamp=None,
                values=np.frombuffer(found, dtype=np.float64).reshape(-1, request.width),
            )
            for request, log, found in zip(requests, logs, values, strict=True)
        ]

    def find_clock(self) -> str:
        """The column that is the clock; raises DataError where none is named like one."""
        by_name = {column.lower(): column for column in reversed(self.columns)}
        for name in CLOCKS:
            if name in by_name:
                return by_name[name]
        raise DataError(
            self.path.name,
            f"has no column for the time; name one 'time' (seconds) or 'time_ns'. "
            f"Its columns: {', '.join(self.columns[:12])}{', …' if len(self.columns) > 12 else ''}.",
        )


class CsvRecording(RowRecording):
    """A CSV file with a header line; separated by commas, semicolons or tabs."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "CSV")
        with damage(path):
            self._open()

    def _open(self) -> None:
        with self._stream() as stream:
            head = stream.readline(LONGEST_HEAD)
            start = [line for line in (stream.readline(LONGEST_HEAD) for _ in range(PEEKED)) if line.strip()]
        self.delimiter = max(",;\t", key=head.count)
        if self.delimiter not in head:
            raise DataError(
                self.path.name, "has no header line of column names, separated by commas, semicolons or tabs."
            )
        self.columns = tuple(cell.strip() for cell in next(csv.reader([head.lstrip("#% ")], delimiter=self.delimiter)))
        if all(_is_number(cell) for cell in self.columns):
            raise DataError(
                self.path.name, "begins with numbers: its first line must name the columns, e.g. time,left_x."
            )
        if doubled := sorted({column for column in self.columns if self.columns.count(column) > 1}):
            raise DataError(self.path.name, f"names the column {doubled[0]!r} more than once.")
        if "" in self.columns:
            raise DataError(self.path.name, f"has no name for its column {self.columns.index('') + 1}.")
        self.clock = self.find_clock()
        self.fields = tuple(column for column in self.columns if column != self.clock)
        if {"left_s0", "left_e0", "left_w0"} <= set(self.columns):
            self.format = "CSV (Baxter's joint_recorder)"
        index = self.columns.index(self.clock)
        cells = [row[index] for row in csv.reader(start, delimiter=self.delimiter) if len(row) > index]
        peeked = [float(cell) for cell in cells if _is_number(cell)]
        self.unit = nanoseconds_in(self.clock, peeked)

    def _stream(self) -> TextIO:
        return self.path.open(encoding="utf-8-sig", newline="")

    def rows(self, columns: Sequence[str], episode: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Time in nanoseconds and values of the columns, row by row; an empty cell is not a number (NaN)."""
        width, clock = len(self.columns), self.columns.index(self.clock)
        places = [(column, self.columns.index(column)) for column in columns]
        number = 0
        with self._stream() as stream:
            stream.readline(LONGEST_HEAD)
            for cells in csv.reader(stream, delimiter=self.delimiter, strict=True):
                if len(cells) < 2 and not any(cell.strip() for cell in cells):
                    continue
                number += 1
                if len(cells) != width:
                    raise DataError(
                        f"{self.path.name}, row {number}",
                        f"has {len(cells)} cells where the header names {width} columns; remove or repair it.",
                    )
                time = self._time(cells[clock], number)
                yield time, {column: self._number(cells[place], column, number) for column, place in places}

    def _time(self, cell: str, number: int) -> int:
        """A cell of the clock, in nanoseconds, without the rounding that a float would bring."""
        try:
            time = Decimal(cell) * self.unit
        except ArithmeticError:
            time = Decimal("nan")
        if not time.is_finite() or abs(time) >= 2**63:  # before it becomes a whole number of perhaps a billion digits
            raise DataError(
                f"{self.path.name}, row {number}", f"its time, column {self.clock!r}, is {cell[:40]!r}, which is none."
            )
        return int(time.to_integral_value())

    def _number(self, cell: str, column: str, number: int) -> float | bool:
        try:
            return float(cell)
        except ValueError:
            if not cell.strip():
                return math.nan
            truth = {"true": True, "false": False}.get(cell.strip().lower())
            if truth is not None:
                return truth
            raise DataError(
                f"{self.path.name}, row {number}", f"column {column!r} holds {cell[:40]!r}, which is no number."
            ) from None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
