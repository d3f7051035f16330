"""Columns of steps as files: damage is found, statistics join."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from toy_data import SEEING, TOY

from bricksrl.data.columns import (
    arrow_types,
    column_statistics,
    from_table,
    image_statistics,
    join_statistics,
    read_parquet,
    read_verified,
    to_parquet,
    to_table,
)
from bricksrl.errors import DataError


def test_damage_is_found_without_a_digest(tmp_path: Path) -> None:
    """Each page has a checksum: no other number is read in place of the one that was written."""
    numbers = np.random.default_rng(0).normal(size=200)
    path = tmp_path / "numbers.parquet"
    whole = to_parquet(pa.table({"number": numbers}))
    path.write_bytes(whole)
    assert np.array_equal(read_parquet(path)["number"].to_numpy(), numbers)
    found = 0
    for place in range(4, len(whole), 61):
        damaged = bytearray(whole)
        damaged[place] ^= 1
        path.write_bytes(damaged)
        try:
            table = read_parquet(path)
        except DataError:
            found += 1
            continue
        # A bit that nobody reads, such as the name of the writer.
        if "number" in table.column_names:
            assert np.array_equal(table["number"].to_numpy(), numbers)
    assert found > 20


def test_content_has_its_digest(tmp_path: Path) -> None:
    path = tmp_path / "bytes"
    path.write_bytes(b"bricks")
    digest = hashlib.sha256(b"bricks").hexdigest()
    assert read_verified(path, digest) == read_verified(path, None) == b"bricks"
    path.write_bytes(b"brick")
    with pytest.raises(DataError, match="is damaged: its content is not what was written"):
        read_verified(path, digest)
    with pytest.raises(DataError, match="data repair"):
        read_verified(tmp_path / "nothing", None)


def test_statistics_of_parts_are_those_of_the_whole() -> None:
    values = np.random.default_rng(1).normal(3.0, 2.0, size=(11, 2))
    parts = [{"state": column_statistics(part)} for part in (values[:3], values[3:4], values[4:])]
    joined = join_statistics(parts)["state"]
    whole, count = column_statistics(values)
    for name, wanted in zip(("min", "max", "mean", "std"), whole, strict=True):
        assert np.allclose(joined[name], wanted), name
    assert joined["count"] == [count] == [11]


def test_statistics_of_images_are_of_each_color_in_0_to_1() -> None:
    images = np.zeros((2, 2, 2, 3), np.uint8)
    images[0, ..., 0] = 255
    images[1, 0, 0, 2] = 51
    values, count = image_statistics(images)
    assert count == 2 and values.shape == (4, 3, 1, 1)
    low, high, mean, std = values[:, :, 0, 0].tolist()
    assert low == [0.0, 0.0, 0.0]
    assert high == pytest.approx([1.0, 0.0, 0.2])
    assert mean == pytest.approx([0.5, 0.0, 0.2 / 8])
    assert std == pytest.approx([0.5, 0.0, 0.2 * np.sqrt(7) / 8])


def test_a_table_of_more_rows_than_bytes_is_refused(tmp_path: Path) -> None:
    """A few bytes could claim to be all of the memory."""
    path = tmp_path / "zeros.parquet"
    for rows, fits in ((100, True), (1_000_000, False)):
        path.write_bytes(to_parquet(pa.table({"index": np.zeros(rows, np.int8)})))
        if fits:
            assert read_parquet(path).num_rows == rows
            continue
        assert path.stat().st_size < rows
        with pytest.raises(DataError, match="claims more rows than it can hold"):
            read_parquet(path)


def test_a_text_that_is_no_utf_8_is_refused(tmp_path: Path) -> None:
    """Whoever reads the column would meet it in the middle of a training."""
    ends = pa.py_buffer(np.array([0, 3], np.int32).tobytes())
    letters = pa.py_buffer(b"\xff\xfe\xfd")
    column = pa.StringArray.from_buffers(1, ends, letters)
    path = tmp_path / "letters.parquet"
    path.write_bytes(to_parquet(pa.table({"task": column})))
    with pytest.raises(DataError, match="not a valid Parquet file"):
        read_parquet(path)


def toy_columns() -> dict[str, np.ndarray]:
    types = arrow_types(SEEING)
    rng = np.random.default_rng(2)
    columns = {}
    for name, (n, type_) in types.items():
        values = rng.integers(0, 2, (3, n)) if n == 1 else rng.normal(size=(3, n))
        columns[name] = values.astype(type_.to_pandas_dtype())
    return columns


def test_columns_of_a_table_come_back_and_images_are_none_of_them() -> None:
    columns = toy_columns()
    assert "observation.images.webcam" not in columns and "observation.state" in columns
    table = to_table(columns, SEEING)
    found = from_table(table, SEEING, columns, Path("x"))
    for name, values in columns.items():
        wanted = values[:, 0] if values.shape[1] == 1 else values
        assert np.array_equal(found[name], wanted) and found[name].dtype == values.dtype, name
    assert list(from_table(table, SEEING, ["action"], Path("x"))) == ["action"]


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("next.reward", pa.array([1.0, 2.0, 3.0]), "next.reward is double, not float"),
        ("next.reward", pa.array([1.0, None, 3.0], pa.float32()), "is float, not float"),
        ("index", pa.array([[1], [2], [3]]), "not int64"),
        (
            "observation.state",
            pa.array([[1.0, 2.0]] * 3),
            "state is list<.*double>, not",
        ),
        (
            "observation.state",
            pa.array([[1.0, 2.0]] * 2 + [[1.0]], pa.list_(pa.float32())),
            "rows of another length than 2",
        ),
        (
            "observation.state",
            pa.array([[1.0, 2.0]] * 2 + [[1.0, None]], pa.list_(pa.float32())),
            "rows of another length than 2",
        ),
        (
            "observation.state",
            pa.array([[1.0, 2.0]] * 2 + [None], pa.list_(pa.float32())),
            "state is list<.*float>, not",
        ),
        ("observation.state", pa.array([1.0, 2.0, 3.0], pa.float32()), "is float, not"),
    ],
)
def test_a_column_of_another_kind_is_refused(name: str, values: pa.Array, says: str) -> None:
    table = to_table(toy_columns(), TOY)
    table = table.set_column(table.schema.get_field_index(name), name, values)
    with pytest.raises(DataError, match=f"file.parquet: column .*{says}"):
        from_table(table, TOY, [name], Path("file.parquet"))


def test_lists_of_other_programs_are_read_and_a_name_stands_once() -> None:
    table = to_table(toy_columns(), TOY)
    place = table.schema.get_field_index("observation.state")
    lists = pa.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], pa.list_(pa.float32()))
    plain = table.set_column(place, "observation.state", lists)
    found = from_table(plain, TOY, ["observation.state"], Path("x"))["observation.state"]
    assert found.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    twice = table.append_column("index", table["index"])
    for wrong in (twice, table.drop_columns(["index"])):
        with pytest.raises(DataError, match="has not one column index"):
            from_table(wrong, TOY, ["index"], Path("x"))
