"""Selections in a table: columns by name, a prefix of columns, elements of a column of lists, joints by name."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pipeline.errors import DataError
from stages.ingest.names import nearest
from stages.ingest.recording import Topic
from stages.ingest.selections import layouts
from stages.ingest.selections.extractors import Cells, Flag
from stages.ingest.selections.kinematics import Robot
from stages.ingest.selections.layouts import Layout
from stages.ingest.selections.resolved import Quantity, Resolved, chain_to, layout_of, resolved


def resolve_joints(table: Topic, link: str, robot: Robot | None, place: str) -> Resolved:
    """Forward kinematics of columns that are called like joints; raises DataError where one is missing."""
    chain = chain_to(link, robot, place)
    scalars, _ = _kinds(table)
    for joint in chain.drivers:
        if joint not in scalars:
            raise DataError(place, f"has no column for the joint {joint!r}; {nearest(joint, scalars)}")
    return resolved(place, table, Cells(chain.drivers), len(chain.drivers), "joints", chain.drivers, chain)


def resolve_elements(table: Topic, column: str, names: Sequence[str], place: str, quantity: Quantity) -> Resolved:
    """Elements, by the names that the recording gives them, of a column of lists; raises DataError where one is not."""
    _, lists = _kinds(table)
    if column not in lists:
        raise DataError(place, f"has no column of lists {column!r}; {nearest(column, table.fields)}")
    known = table.names.get(column, ())
    for name in names:
        if name not in known:
            raise DataError(place, f"the column {column!r} has no element {name!r}; {nearest(name, known)}")
    layout = layout_of(len(names), place, quantity)
    return resolved(place, table, Cells((column,), [known.index(n) for n in names]), len(names), layout, (column,))


def resolve_columns(table: Topic, text: str, place: str, quantity: Quantity) -> Resolved:
    """Columns joined by commas, a prefix, or a part of a column of lists.

    Raises DataError, with the nearest names that there are, where there is no such column of numbers.
    """
    scalars, lists = _kinds(table)
    columns = tuple(name.strip() for name in text.split(","))
    if len(columns) == 1 and columns[0] not in scalars:
        match = re.fullmatch(r"(.+?)(?:\[(\d+)(:\d+)?\])?", columns[0])
        if match is not None and match[1] in lists:
            length = lists[match[1]]
            first = int(match[2] or 0)
            last = length if match[2] is None else first + 1 if match[3] is None else int(match[3][1:])
            return _part(table, match[1], first, last, place, quantity)
        columns, layout = _prefixed(columns[0], scalars, place, quantity)
    else:
        for column in columns:
            if column not in scalars:
                raise DataError(place, f"has no column of numbers {column!r}; {nearest(column, table.fields)}")
        layout = layout_of(len(columns), place, quantity)
    cells = Cells(columns)
    return resolved(place, table, Flag(cells) if quantity == "number" else cells, len(columns), layout, columns)


def _kinds(table: Topic) -> tuple[set[str], dict[str, int]]:
    """Columns of numbers, and columns of lists with their length (0: it varies)."""
    scalars: set[str] = set()
    lists: dict[str, int] = {}
    for field in table.fields:
        match = re.fullmatch(r"(.*)\[(\d*)\]", field)
        if match is None:
            scalars.add(field)
        else:
            lists[match[1]] = int(match[2] or 0)
    return scalars, lists


def _part(table: Topic, name: str, first: int, last: int, place: str, quantity: Quantity) -> Resolved:
    length = _kinds(table)[1][name]
    if first >= last or (length and last > length):
        there = f"it has {length} numbers a row" if length else f"name the numbers, such as {name}[0:3]"
        raise DataError(place, f"is no part of the column of lists {name!r}: {there}.")
    layout = layout_of(last - first, place, quantity)
    cells = Cells((name,), range(first, last))
    return resolved(place, table, Flag(cells) if quantity == "number" else cells, last - first, layout, (name,))


def _prefixed(prefix: str, there: set[str], place: str, quantity: Quantity) -> tuple[tuple[str, ...], Layout]:
    """Columns of a pose or a force that share a prefix."""
    position = tuple(f"{prefix}{axis}" for axis in layouts.AXES)
    if quantity == "number" or not there.issuperset(position):
        what = "no column of numbers" if quantity == "number" else "neither a column of numbers nor a prefix of x y z"
        raise DataError(place, f"{prefix!r} is {what}; {nearest(prefix, there)}")
    if quantity == "pose":
        kinds: tuple[tuple[Layout, tuple[str, ...]], ...] = (
            ("quaternion", layouts.QUATERNION),
            ("euler", layouts.EULER),
        )
        for layout, names in kinds:
            turns = tuple(f"{prefix}{name}" for name in names)
            if there.issuperset(turns):
                return position + turns, layout
    return position, "position"
