"""Index of a dataset: its description, and a row for each committed episode (``meta/episodes``).

The rows have LeRobot's columns, and ours with the provenance of an episode.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from brickhub.fields import check_fields
from brickhub.files import folder_with, quoted, write_durably
from bricksrl.data.layout import CODEBASE_VERSION, DATA_PATH, FileIndex, Layout, features, info
from bricksrl.data.parquet import RESTORE, Statistics, join_statistics, read_parquet
from bricksrl.data.recorded_episode import About, EpisodeRow
from bricksrl.data.schema import Description
from bricksrl.errors import DataError, counted


@dataclass(frozen=True)
class Index:
    """Index of a dataset.

    Attributes:
        rows: rows of its episodes, in order and contiguous.
        last_file: last file with rows; ``None`` if there is none.
    """

    layout: Layout
    description: Description
    rows: tuple[EpisodeRow, ...]
    last_file: FileIndex | None

    @property
    def steps(self) -> int:
        """Number of steps of all episodes."""
        return sum(row.length for row in self.rows)


def is_dataset(root: Path) -> bool:
    """True if the folder has a dataset, even an empty one."""
    return Layout(root).description.exists() or Layout(root).info.exists()


def dataset_folder(path: Path | str) -> Path:
    """Folder of the dataset: the given one, or ``data`` in the folder of a run."""
    path = Path(path)
    folder = path / "data"
    return folder if Layout(folder).info.exists() and not Layout(path).info.exists() else path


def read_index(path: Path | str) -> Index:
    """Read the index of the dataset in a folder, or in the folder of a run. Raises DataError if there is no dataset, it is
    damaged, or it was not made by BricksRL."""
    layout = Layout(dataset_folder(path))
    if not layout.info.exists():
        others = folder_with(layout.root, "meta/info.json", "data/meta/info.json")
        raise DataError(f"there is no dataset in {layout.root}; choose {others}")
    description = read_description(layout)
    episodes = read_episode_count(layout, description)
    rows, last = read_all_rows(layout, description)
    rows = rows[:episodes]  # later rows are from an unfinished commit of a killed writer
    check_order(rows, episodes, layout)
    return Index(layout, description, tuple(rows), last)


def read_description(layout: Layout) -> Description:
    """Read the description in ``meta/bricksrl.json``. Raises DataError if it is damaged or missing."""
    try:
        return Description.from_json(layout.description.read_bytes(), str(layout.description))
    except FileNotFoundError:
        raise DataError(
            f"the dataset in {layout.root} was not made by BricksRL: it has no meta/bricksrl.json; choose another"
        ) from None
    except OSError as error:
        raise DataError(f"cannot read {layout.description} ({error.strerror}); restore it from a copy") from None


def read_episode_count(layout: Layout, description: Description) -> int:
    """Read the number of committed episodes."""
    try:
        data = json.loads(layout.info.read_bytes())
    except OSError as error:
        raise DataError(f"cannot read {layout.info} ({error.strerror}); restore it from a copy") from None
    except (ValueError, RecursionError):
        raise DataError(f"{layout.info} is not JSON; restore it, or run `bricksrl data repair {quoted(layout.root)}`") from None
    if not isinstance(data, dict) or data.get("codebase_version") != CODEBASE_VERSION:
        raise DataError(f"{layout.info} is of no dataset in LeRobot's format {CODEBASE_VERSION}; choose another")
    if data.get("features") != features(description) or data.get("data_path") != DATA_PATH:
        raise DataError(f"{layout.info} and {layout.description.name} disagree about the columns; restore both from one copy")
    episodes = data.get("total_episodes")
    if type(episodes) is not int or episodes < 0:
        raise DataError(f"{layout.info} does not count its episodes; run `bricksrl data repair {quoted(layout.root)}`")
    return episodes


def read_all_rows(layout: Layout, description: Description) -> tuple[list[EpisodeRow], FileIndex | None]:
    """Read the rows of all consecutive files, including those of an unfinished commit; returns them and the last file."""
    rows: list[EpisodeRow] = []
    at, last = FileIndex(), None
    while layout.episodes(at).exists():
        rows += read_rows(layout.episodes(at), description)
        at, last = at.next(), at
    return rows, last


def unfinished_files(layout: Layout, description: Description, last: FileIndex | None) -> list[Path]:
    """Files of an episode without a row, because its writer was killed."""
    at = FileIndex() if last is None else last.next()
    if layout.data(at.next()).exists() or layout.episodes(at.next()).exists():
        return []  # a killed writer leaves one at most: here row files are missing
    paths = [layout.data(at)] if description.image_key is None else [layout.data(at), layout.video(description.image_key, at)]
    return [path for path in paths if path.exists()]


def check_order(rows: Sequence[EpisodeRow], episodes: int, layout: Layout) -> None:
    """Raise DataError unless the rows are those of ``episodes`` consecutive episodes."""
    start = 0
    for number, row in enumerate(rows):
        if row.episode != number or row.start != start:
            raise DataError(f"the rows in {layout.root / 'meta/episodes'} are not in order at episode {number}; restore them")
        start += row.length
    if len(rows) != episodes:
        raise DataError(
            f"{layout.info} counts {counted(episodes, 'episode')} and meta/episodes holds {len(rows)}; "
            f"restore it from a copy, or run `bricksrl data repair {quoted(layout.root)}`"
        )


def write_index(layout: Layout, description: Description, rows: Sequence[EpisodeRow]) -> None:
    """Write the joint statistics and the number of episodes; the latter comes last, and commits the newest episode."""
    write_durably(layout.stats, to_json(join_statistics([row.statistics for row in rows])))
    write_durably(layout.info, to_json(info(description, len(rows), sum(row.length for row in rows))))


def to_json(value: Any) -> bytes:
    """JSON in LeRobot's formatting."""
    return (json.dumps(value, indent=4) + "\n").encode()


_TEXT, _INT, _FLOAT, _BOOL = pa.string(), pa.int64(), pa.float64(), pa.bool_()
_STATS = ("min", "max", "mean", "std", "count")
_ABOUT = {
    "policy": _TEXT,
    "seed": _INT,
    "success": _BOOL,
    "whole": _BOOL,
    "started": _TEXT,
    "hub": _TEXT,
    "robot": _TEXT,
    "program_hash": _INT,
}
_ABOUT_JSON = ("versions", "physics")
"""Attributes of `About`: columns of their own, and dictionaries as texts."""


def task_instruction(description: Description) -> str:
    """Task instruction of the dataset, in words; all episodes share it."""
    return description.env


def rows_table(rows: Sequence[EpisodeRow], description: Description, at: FileIndex) -> pa.Table:
    """Table of the rows for the file ``at``."""
    cells: dict[str, tuple[list[Any], pa.DataType]] = {
        "episode_index": ([row.episode for row in rows], _INT),
        "tasks": ([[task_instruction(description)]] * len(rows), pa.list_(_TEXT)),
        "length": ([row.length for row in rows], _INT),
        "data/chunk_index": ([row.data_file.chunk for row in rows], _INT),
        "data/file_index": ([row.data_file.file for row in rows], _INT),
        "data/sha256": ([row.data_sha256 for row in rows], _TEXT),
        "dataset_from_index": ([row.start for row in rows], _INT),
        "dataset_to_index": ([row.start + row.length for row in rows], _INT),
        "meta/episodes/chunk_index": ([at.chunk] * len(rows), _INT),
        "meta/episodes/file_index": ([at.file] * len(rows), _INT),
        "return": ([row.return_ for row in rows], _FLOAT),
        "terminated": ([row.terminated for row in rows], _BOOL),
        "interventions": ([row.interventions for row in rows], _INT),
        **{name: ([getattr(row.about, name) for row in rows], type_) for name, type_ in _ABOUT.items()},
        **{name: ([json.dumps(getattr(row.about, name)) for row in rows], _TEXT) for name in _ABOUT_JSON},
    }
    key = description.image_key
    if key is not None:
        files = [row.video_file or FileIndex() for row in rows]
        cells |= {
            f"videos/{key}/chunk_index": ([file.chunk for file in files], _INT),
            f"videos/{key}/file_index": ([file.file for file in files], _INT),
            f"videos/{key}/from_timestamp": ([row.video_start_s for row in rows], _FLOAT),
            f"videos/{key}/to_timestamp": ([row.video_start_s + row.length / description.rate_hz for row in rows], _FLOAT),
            f"videos/{key}/sha256": ([row.video_sha256 for row in rows], _TEXT),
            f"final/{key}": ([row.final_image for row in rows], pa.binary()),
        }
    for name, feature in features(description).items():
        type_ = pa.list_(pa.list_(pa.list_(_FLOAT))) if feature["dtype"] == "video" else pa.list_(_FLOAT)
        for stat in _STATS:
            column = [row.statistics[name][stat] for row in rows]
            cells[f"stats/{name}/{stat}"] = (column, pa.list_(_INT) if stat == "count" else type_)
    return pa.table({name: pa.array(values, type_) for name, (values, type_) in cells.items()})


def read_rows(path: Path, description: Description) -> list[EpisodeRow]:
    """Read the rows in a file. Raises DataError if the file is missing, damaged or not of such a dataset."""
    records = read_parquet(path).to_pylist()
    try:
        return [_row(record, description) for record in records]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError):
        raise DataError(f"{path} holds rows that are not ours; {RESTORE}") from None


def _row(record: dict[str, Any], description: Description) -> EpisodeRow:
    key = description.image_key
    video: dict[str, Any] = {}
    if key is not None:
        video = {
            "video_file": _file(record, f"videos/{key}"),
            "video_start_s": float(record[f"videos/{key}/from_timestamp"]),
            "video_sha256": _optional(str, record[f"videos/{key}/sha256"]),
            "final_image": _optional(bytes, record[f"final/{key}"]),
        }
    row = EpisodeRow(
        episode=int(record["episode_index"]),
        length=int(record["length"]),
        start=int(record["dataset_from_index"]),
        return_=float(record["return"]),
        terminated=bool(record["terminated"]),
        interventions=int(record["interventions"]),
        data_file=_file(record, "data"),
        data_sha256=_optional(str, record["data/sha256"]),
        statistics=_statistics(record, description),
        about=_about(record),
        **video,
    )
    if row.length < 1 or row.start < 0 or row.episode < 0:
        raise ValueError("an episode without steps")
    return row


def _file(record: dict[str, Any], prefix: str) -> FileIndex:
    at = FileIndex(int(record[f"{prefix}/chunk_index"]), int(record[f"{prefix}/file_index"]))
    if at.chunk < 0 or at.file < 0:
        raise ValueError("a file with a negative number")
    return at


def _optional(type_: type, value: Any) -> Any:
    if value is not None and not isinstance(value, type_):
        raise TypeError("another type")
    return value


def _about(record: dict[str, Any]) -> About:
    values = {name: record[name] for name in _ABOUT if name in record}  # older datasets name no robot
    values |= {name: json.loads(record[name]) for name in _ABOUT_JSON}
    check_fields(About, values)
    return About(**values)


def _statistics(record: dict[str, Any], description: Description) -> Statistics:
    statistics = {}
    for name, feature in features(description).items():
        statistics[name] = {stat: list(record[f"stats/{name}/{stat}"]) for stat in _STATS}
        expected = (3, 1, 1) if feature["dtype"] == "video" else tuple(feature["shape"])
        shapes = [np.shape(np.array(statistics[name][stat], np.float64)) for stat in _STATS]
        if shapes != [expected] * 4 + [(1,)] or not statistics[name]["count"][0] > 0:
            raise ValueError("statistics of something else")
    return statistics
