"""Damaged, foreign and malicious datasets: one error, no execution, no writing."""

from __future__ import annotations

import io
import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_edit import same
from toy_data import SEEING, TOY, record, record_episode

from bricksrl.data import Episodes, Recorder, load
from bricksrl.data.edit import merge
from bricksrl.data.integrity import check, recover
from bricksrl.errors import DataError

EXPLODED = Path(__file__).with_name("exploded")
INFO, ROWS, DATA = (
    "meta/info.json",
    "meta/episodes/chunk-000/file-001.parquet",
    "data/chunk-000/file-001.parquet",
)


class Bomb:
    def __reduce__(self):
        return (Path.touch, (EXPLODED,))


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Episodes]:
    root = record(tmp_path_factory.mktemp("sound") / "set")
    return root, load(root)


def contents(root: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()
    }


def is_prefix(ours: Episodes, theirs: Episodes) -> bool:
    n = len(ours)
    return np.array_equal(ours.observation, theirs.observation[:n]) and np.array_equal(
        ours.reward, theirs.reward[:n]
    )


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from([DATA, ROWS, INFO, "meta/bricksrl.json"]),
    st.integers(0, 10**9),
    st.integers(1, 255),
    st.booleans(),
)
def test_damaged_file_never_gives_wrong_data(
    tmp_path_factory, sound, name, place, mask, cut
) -> None:
    root, wanted = sound
    damaged = tmp_path_factory.mktemp("damaged") / "set"
    shutil.copytree(root, damaged)
    data = bytearray((damaged / name).read_bytes())
    if cut:
        del data[place % len(data) :]
    else:
        data[place % len(data)] ^= mask
    (damaged / name).write_bytes(data)
    before = contents(damaged)
    try:
        found = load(damaged)
    except DataError:
        pass
    else:
        # The index may count fewer episodes now, and a row's texts and numbers are as good as
        # others.
        assert (
            is_prefix(found, wanted)
            if name == INFO
            else np.array_equal(found.observation, wanted.observation)
        )
        assert same(found, wanted) or name in (ROWS, INFO)
    assert contents(damaged) == before
    shutil.rmtree(damaged)


def bomb_as_type() -> bytes:
    """An Arrow extension type with a pickle as metadata, which old readers executed."""
    sink = io.BytesIO()
    metadata = {
        b"ARROW:extension:name": b"arrow.py_extension_type",
        b"ARROW:extension:metadata": pickle.dumps(Bomb()),
    }
    field = pa.field("index", pa.int64(), metadata=metadata)
    pq.write_table(pa.Table.from_arrays([pa.array([1])], schema=pa.schema([field])), sink)
    return sink.getvalue()


@pytest.mark.parametrize(
    "content",
    [pickle.dumps(Bomb()), b"", b"\0" * 1000, bomb_as_type(), b'{"a": 1}', b"[" * 100_000],
)
@pytest.mark.parametrize("name", [DATA, ROWS, INFO, "meta/bricksrl.json"])
def test_foreign_file_raises_without_execution(tmp_path: Path, name: str, content: bytes) -> None:
    root = record(tmp_path / "set")
    (root / name).write_bytes(content)
    before = contents(root)
    for act in (load, lambda path: merge([path], tmp_path / "out")):
        with pytest.raises(DataError) as error:
            act(root)
        assert "\n" not in str(error.value)
    if name != DATA:  # the recorder reads no data
        with pytest.raises(DataError):
            Recorder(root, TOY)
    assert contents(root) == before
    assert not EXPLODED.exists() and not (tmp_path / "out").exists()


def edit_rows(root: Path, **cells: object) -> None:
    table = pq.read_table(root / ROWS)
    for name, value in cells.items():
        column = table.schema.get_field_index(name)
        table = table.set_column(
            column, table.schema.field(column), pa.array([value], table.schema.field(column).type)
        )
    pq.write_table(table, root / ROWS)


@pytest.mark.parametrize(
    "cells",
    [
        {"length": 10**15},
        {"length": 2**62},
        {"length": -1},
        {"dataset_from_index": 0},
        {"data/file_index": 0},
        {"data/file_index": -1},
        {"episode_index": 7},
        {"versions": "no json"},
        {"versions": "[" * 50_000},
    ],
)
def test_inconsistent_rows_raise(tmp_path: Path, cells: dict[str, object]) -> None:
    root = record(tmp_path / "set")
    edit_rows(root, **cells)
    with pytest.raises(DataError):
        load(root)


@pytest.mark.parametrize(("chunk", "file"), [(1, -999), (-1, 1001), (0, 1000), (0, -1)])
def test_a_file_has_one_number_in_its_folder_alone(tmp_path: Path, chunk: int, file: int) -> None:
    """The first two would be the right file, counted from another folder."""
    root = record(tmp_path / "set")
    edit_rows(root, **{"data/chunk_index": chunk, "data/file_index": file})
    with pytest.raises(DataError, match="rows that are not ours"):
        load(root)


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("stats/frame_index/mean", "null"),
        ("stats/action/min", {"a": 1}),
        ("stats/action/min", [1.0, 2.0]),
        ("stats/index/count", "[1]"),
        ("stats/index/count", [0]),
        ("length", [3]),
    ],
)
def test_wrong_cell_type_or_shape_raises(tmp_path: Path, column: str, value: object) -> None:
    """Merging writes a new index only if all statistics are valid."""
    root = record(tmp_path / "set")
    table = pq.read_table(root / ROWS)
    pq.write_table(
        table.set_column(table.schema.get_field_index(column), column, pa.array([value])),
        root / ROWS,
    )
    before = contents(root)
    for act in (
        load,
        lambda path: recover(path, rebuild=True),
        lambda path: merge([path], tmp_path / "out"),
    ):
        with pytest.raises(DataError, match="rows that are not ours"):
            act(root)
    assert contents(root) == before and not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["age_s", "index"])
def test_missing_column_raises(tmp_path: Path, name: str) -> None:
    root = record(tmp_path / "set")
    pq.write_table(pq.read_table(root / DATA).drop_columns([name]), root / DATA)
    edit_rows(root, **{"data/sha256": None})
    with pytest.raises(DataError, match=f"file-001.parquet has not one column {name}"):
        load(root)
    assert f"has not one column {name}" in "".join(map(str, check(root)))


def test_symlink_out_of_dataset_is_not_followed(tmp_path: Path) -> None:
    """Writes replace a symlink, not its target."""
    root = record(tmp_path / "set")
    outside = tmp_path / "outside.json"
    outside.write_bytes((root / INFO).read_bytes())
    before = outside.read_bytes()
    (root / INFO).unlink()
    (root / INFO).symlink_to(outside)
    with Recorder(root, TOY) as recorder:
        record_episode(recorder, 9, 2)
    assert outside.read_bytes() == before
    assert len(load(root).rows) == 4


def test_index_paths_stay_inside(tmp_path: Path) -> None:
    root = record(tmp_path / "set")
    info = json.loads((root / INFO).read_text())
    (root / INFO).write_text(
        json.dumps({**info, "data_path": "../../secret/{chunk_index}{file_index}"})
    )
    with pytest.raises(DataError, match="disagree"):
        load(root)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda root: None, "there is no dataset"),
        (lambda root: (root / "meta").mkdir(parents=True), "there is no dataset"),
        (
            lambda root: (record(root), (root / "meta/bricksrl.json").unlink()),
            "does not tell the environment",
        ),
        (lambda root: (record(root), (root / DATA).unlink()), "cannot read"),
        (
            lambda root: (record(root), (root / ROWS).unlink()),
            "counts 3 episodes and meta/episodes holds 1",
        ),
    ],
)
def test_missing_files_are_named(tmp_path: Path, make, told: str) -> None:
    make(tmp_path / "set")
    with pytest.raises(DataError, match=told):
        load(tmp_path / "set")


def test_steps_of_another_place_are_refused(tmp_path: Path) -> None:
    """Two files that were exchanged, or one that was cut, are whole by themselves."""
    root = record(tmp_path / "set", (4, 4, 4))
    for number in (0, 1, 2):
        rows = root / ROWS.replace("001", f"00{number}")
        table = pq.read_table(rows)
        place = table.schema.get_field_index("data/sha256")
        none = pa.array([None], pa.string())
        pq.write_table(table.set_column(place, table.schema.field(place), none), rows)
    assert len(load(root)) == 12
    first, second = root / DATA.replace("001", "000"), root / DATA
    data = first.read_bytes(), second.read_bytes()
    first.write_bytes(data[1])
    with pytest.raises(DataError, match="holds other steps than meta/episodes says"):
        load(root)
    first.write_bytes(data[0])
    pq.write_table(pq.read_table(second).slice(0, 3), second)
    with pytest.raises(DataError, match="file-001.parquet holds other steps than meta/episodes"):
        load(root)
    # What follows is of an episode whose recording was killed.
    pq.write_table(pa.concat_tables([pq.read_table(first)] * 2), first)
    second.write_bytes(data[1])
    assert len(load(root)) == 12


def test_a_video_has_the_image_after_the_last_step_in_its_row(tmp_path: Path) -> None:
    root = record(tmp_path / "set", description=SEEING)
    edit_rows(root, **{"final/observation.images.webcam": b"short"})
    with pytest.raises(DataError, match="episode 1 in .* has no final image; restore meta/episode"):
        load(root)
    assert len(load(root, images=False)) == 12


def test_a_dataset_without_episodes_is_not_loaded(tmp_path: Path) -> None:
    root = record(tmp_path / "set", (2,))
    info = json.loads((root / INFO).read_text())
    (root / INFO).write_text(json.dumps({**info, "total_episodes": 0}))
    with pytest.raises(DataError, match="has no episodes yet; record some"):
        load(root)
