"""Parquet files with a named, versioned schema and units: the one place that writes and reads them.

Writer options are pinned: equal tables give equal bytes. Units stand as metadata of each field, everything else that a
table says (goal, dimension, certificate …) as one JSON object under the key ``clpv`` of the file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.errors import DataError
from pipeline.values import canonical

KEY = b"clpv"
TYPES = {
    "float": pa.float64(),
    "int": pa.int64(),
    "bool": pa.bool_(),
    "text": pa.string(),
    "label": pa.dictionary(pa.int32(), pa.string()),
    "vector": pa.list_(pa.float64()),
}
"""``label``: a text that repeats over many rows; ``vector``: a short list of numbers, row-major for a matrix."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column: name, type (a key of `TYPES`), SI unit ("" where it has none)."""

    name: str
    type: str = "float"
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Schema:
    """A table's name, version and columns."""

    name: str
    version: int
    columns: tuple[Column, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Coded:
    """Labels of many rows: codes, array of int, shape (n,), and the name of each code."""

    codes: NDArray[Any]
    names: Sequence[str]

    def __len__(self) -> int:
        return len(self.codes)


def vectors(prefix: str, unit: str, axes: str = "xyz") -> tuple[Column, ...]:
    """Columns ``<prefix>x``, ``<prefix>y``, ``<prefix>z``."""
    return tuple(Column(name=f"{prefix}{axis}", unit=unit) for axis in axes)


def write(path: Path, schema: Schema, columns: Mapping[str, Any], metadata: Mapping[str, Any]) -> None:
    """Write a table; columns that are not given, or are None, are all null.

    Arguments:
        columns: name -> array, shape (n,), or sequence; nan in a float column is kept as nan, infinity becomes null.
            Of a label also `Coded`.
        metadata: plain values, kept as JSON.
    """
    rows = len(next(values for values in columns.values() if values is not None))
    fields, arrays = [], []
    for column in schema.columns:
        kind = TYPES[column.type]
        values = columns.get(column.name)
        arrays.append(pa.nulls(rows, kind) if values is None else _array(values, kind))
        fields.append(pa.field(column.name, kind, metadata={"unit": column.unit} if column.unit else None))
    document = {"schema": schema.name, "version": schema.version, **metadata}
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata={KEY: canonical(document).encode()}))
    labels = [column.name for column in schema.columns if column.type == "label"]
    pq.write_table(
        table,
        path,
        compression="zstd",
        compression_level=3,
        use_dictionary=labels,
        write_statistics=False,
        version="2.6",
    )


def read(path: Path, schema: Schema) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Columns as arrays, shape (n,) (texts and vectors as arrays of objects), and the metadata.

    Raises DataError where the file is no parquet file or holds another table or version.
    """
    try:
        table = _read(path)
        metadata = json.loads((table.schema.metadata or {})[KEY])
    except (OSError, pa.ArrowException, KeyError, ValueError):
        raise DataError(
            f"{schema.name}.parquet", "is not a table of clpv, or is damaged: run the stage again."
        ) from None
    if (metadata.get("schema"), metadata.get("version")) != (schema.name, schema.version):
        raise DataError(
            f"{schema.name}.parquet",
            f"holds {metadata.get('schema')} version {metadata.get('version')}, not version {schema.version}.",
        )
    return {column.name: _values(table[column.name]) for column in schema.columns}, metadata


def records(path: Path) -> list[dict[str, Any]]:
    """Rows as dictionaries of plain values; for small tables."""
    return [dict(row) for row in _read(path).to_pylist()]


def header(path: Path) -> dict[str, Any]:
    """The metadata of a table, without its rows."""
    with pq.ParquetFile(path) as file:
        found: dict[str, Any] = json.loads(file.schema_arrow.metadata[KEY])
    return found


def _read(path: Path) -> pa.Table:
    """All of a file; `pq.read_table` would import half of pyarrow first."""
    with pq.ParquetFile(path) as file:
        return file.read()


def _array(values: Any, kind: pa.DataType) -> pa.Array:
    if isinstance(values, Coded):
        return pa.DictionaryArray.from_arrays(pa.array(values.codes, pa.int32()), pa.array(values.names, pa.string()))
    if pa.types.is_dictionary(kind):
        return pa.array(values, pa.string()).dictionary_encode().cast(kind)
    if isinstance(values, np.ndarray):
        mask = np.isinf(values) if values.dtype.kind == "f" else None
        return pa.array(np.ascontiguousarray(values), kind, from_pandas=False, mask=mask)
    return pa.array(values, kind)


def _values(column: pa.ChunkedArray) -> NDArray[Any]:
    if pa.types.is_floating(column.type):
        return np.asarray(column.to_numpy(), dtype=np.float64)
    if column.null_count == len(column):
        return np.full(len(column), None, dtype=object)
    if pa.types.is_list(column.type):
        values = np.empty(len(column), dtype=object)
        values[:] = [np.asarray(item, dtype=np.float64) for item in column.to_pylist()]
        return values
    return np.asarray(column.to_numpy())


def runs(labels: Sequence[Any]) -> list[tuple[int, int]]:
    """First and past-the-last index of each run of equal neighbours."""
    array = np.asarray(labels)
    if array.shape[0] == 0:
        return []
    edges = np.flatnonzero(array[1:] != array[:-1]) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), array.shape[0]], strict=True))
