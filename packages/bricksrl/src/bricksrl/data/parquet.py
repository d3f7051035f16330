"""Parquet files: conversion between arrays and bytes, and LeRobot's statistics of columns."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bricksrl.data.layout import numbers
from bricksrl.data.schema import Description
from bricksrl.errors import DataError

RESTORE = "restore it from a copy, or save the intact episodes with `bricksrl data repair DIR --out NEW`"
"""What to do about a damaged file of episodes."""

Columns = Mapping[str, NDArray[Any]]
"""Arrays ``[steps]`` and ``[steps, n]`` by the names of the columns."""

Statistics = dict[str, dict[str, list[Any]]]
"""``min``, ``max``, ``mean``, ``std`` and ``count`` of each column, as in LeRobot."""


def to_parquet(table: pa.Table) -> bytes:
    """Bytes of a Parquet file, with page checksums to detect damage."""
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="snappy", write_page_checksum=True)
    return sink.getvalue()


def read_verified(path: Path, digest: str | None) -> bytes:
    """Content of a file, of this SHA-256 ``digest`` unless ``None``. Raises DataError if it cannot be read or differs."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"cannot read {path} ({error.strerror}); restore it, or run `bricksrl data repair`") from None
    if digest is not None and hashlib.sha256(data).hexdigest() != digest:
        raise DataError(f"{path} is damaged: its content is not what was written; {RESTORE}")
    return data


def read_parquet(path: Path, *, digest: str | None = None) -> pa.Table:
    """Read a table that `to_parquet` wrote, of this SHA-256 ``digest`` if given. Nothing in the file is executed. Raises
    DataError if the file is missing or damaged."""
    data = read_verified(path, digest)
    try:
        file = pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True)
        if file.metadata.num_rows > len(data):
            raise DataError(f"{path} claims more rows than it can hold; it is damaged or not ours; {RESTORE}")
        table = file.read(use_threads=False)  # a thread of Arrow that lets go of `data` while Python exits aborts the program
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError, TypeError, OverflowError, MemoryError, RecursionError):
        raise DataError(f"{path} is not a valid Parquet file; {RESTORE}") from None
    return table


def to_table(columns: Columns, description: Description) -> pa.Table:
    """Arrow table of the columns, in the layout of the data files."""
    arrays = {}
    for name, n, type_ in numbers(description):
        flat = pa.array(columns[name].reshape(-1), type_)
        arrays[name] = flat if n == 1 else pa.FixedSizeListArray.from_arrays(flat, n)
    return pa.table(arrays)


def from_table(table: pa.Table, description: Description, names: Iterable[str], where: Path) -> dict[str, NDArray[Any]]:
    """Inverse of `to_table` for some of the columns; vectors of length 1 are returned as ``[steps]``. Raises DataError if a
    column has another type than in the description."""
    shapes = {name: (n, type_) for name, n, type_ in numbers(description)}
    arrays = {}
    for name in names:
        n, type_ = shapes[name]
        try:
            column = table[name].combine_chunks()
        except KeyError:
            raise DataError(f"{where} has not one column {name}; it is not a file of this dataset") from None
        expected = type_ if n == 1 else pa.list_(type_, n)
        if not (column.type == expected or _is_list_of(column.type, type_)) or column.null_count:
            raise DataError(f"{where}: column {name} is {column.type}, not {expected}; it is not a file of this dataset")
        flat = column if n == 1 else column.flatten()
        if len(flat) != n * len(column) or flat.null_count:
            raise DataError(f"{where}: column {name} has rows of another length than {n}; it is not a file of this dataset")
        values = flat.to_numpy(zero_copy_only=False)
        arrays[name] = values if n == 1 else values.reshape(-1, n)
    return arrays


def _is_list_of(type_: pa.DataType, item: pa.DataType) -> bool:
    """True for lists of the item type, fixed-size or not: other programs write vectors as variable-length lists."""
    is_list = pa.types.is_list(type_) or pa.types.is_fixed_size_list(type_)
    return bool(is_list and type_.value_type == item)


def has_task(path: Path, instruction: str) -> bool:
    """True if the file is a ``meta/tasks.parquet`` with this task only."""
    try:
        return bool(read_parquet(path).to_pylist() == [{"task_index": 0, "task": instruction}])
    except DataError:
        return False


def tasks_table(instruction: str) -> bytes:
    """Bytes of ``meta/tasks.parquet``: the instruction is the pandas index of the table, as LeRobot expects."""
    column = {"field_name": None, "metadata": None}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [{"name": None, "pandas_type": "unicode", "numpy_type": "object", **column}],
        "columns": [
            {"name": "task_index", "pandas_type": "int64", "numpy_type": "int64", **column, "field_name": "task_index"},
            {"name": "task", "pandas_type": "unicode", "numpy_type": "object", **column, "field_name": "task"},
        ],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array([0], pa.int64()), "task": pa.array([instruction], pa.string())})
    return to_parquet(table.replace_schema_metadata({"pandas": json.dumps(pandas)}))


def statistics(columns: Columns) -> Statistics:
    """Statistics of the columns of one episode."""
    return {name: _statistics(np.asarray(values, np.float64)) for name, values in columns.items()}


def image_statistics(images: NDArray[np.uint8]) -> dict[str, list[Any]]:
    """Statistics of images ``[steps, height, width, 3]`` per colour in 0..1, of shape ``[3, 1, 1]`` except the count."""
    values = _statistics(images.reshape(-1, 3) / 255.0)
    count = [len(images)]
    return {name: count if name == "count" else [[[v]] for v in value] for name, value in values.items()}


def _statistics(values: NDArray[np.float64]) -> dict[str, list[Any]]:
    rows = values.reshape(len(values), -1)
    with np.errstate(invalid="ignore"):  # a missing clock reads NaN
        values_by_name = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    return {**{name: value.tolist() for name, value in values_by_name.items()}, "count": [len(rows)]}


def join_statistics(parts: Sequence[Statistics]) -> Statistics:
    """Statistics of all episodes together, from those of each episode."""
    return {name: _join([part[name] for part in parts]) for name in (parts[0] if parts else ())}


def _join(parts: Sequence[dict[str, list[Any]]]) -> dict[str, list[Any]]:
    count = np.array([part["count"][0] for part in parts], np.float64)
    low, high, means, stds = (np.array([part[key] for part in parts], np.float64) for key in ("min", "max", "mean", "std"))
    share = (count / count.sum()).reshape(-1, *[1] * (means.ndim - 1))
    mean = (share * means).sum(0)
    variance = (share * (stds**2 + (means - mean) ** 2)).sum(0)
    joined = {"min": low.min(0), "max": high.max(0), "mean": mean, "std": np.sqrt(variance)}
    return {**{name: value.tolist() for name, value in joined.items()}, "count": [int(count.sum())]}
