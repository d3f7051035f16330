"""Columns of steps as files: damage is found, statistics join."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from bricksrl.data.columns import (
    column_statistics,
    join_statistics,
    read_parquet,
    read_verified,
    to_parquet,
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
