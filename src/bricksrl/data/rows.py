"""The rows of ``meta/episodes``: LeRobot's columns, and ours about how an episode came about."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from bricksrl.data.description import Description
from bricksrl.data.episode import About, EpisodeRow
from bricksrl.data.layout import FileIndex, features
from bricksrl.data.tables import Statistics, read_parquet
from bricksrl.errors import DataError

_TEXT, _WHOLE, _REAL, _FLAG = pa.string(), pa.int64(), pa.float64(), pa.bool_()
_STATS = ("min", "max", "mean", "std", "count")


def sentence(description: Description) -> str:
    """What the robot is to do, in words; a dataset has one."""
    return description.env


def rows_table(rows: Sequence[EpisodeRow], description: Description, at: FileIndex) -> pa.Table:
    """Rows as they are kept in the file ``at``."""
    cells: dict[str, tuple[list[Any], pa.DataType]] = {
        "episode_index": ([row.episode for row in rows], _WHOLE),
        "tasks": ([[sentence(description)]] * len(rows), pa.list_(_TEXT)),
        "length": ([row.length for row in rows], _WHOLE),
        "data/chunk_index": ([row.data_file.chunk for row in rows], _WHOLE),
        "data/file_index": ([row.data_file.file for row in rows], _WHOLE),
        "data/sha256": ([row.data_sha256 for row in rows], _TEXT),
        "dataset_from_index": ([row.start for row in rows], _WHOLE),
        "dataset_to_index": ([row.start + row.length for row in rows], _WHOLE),
        "meta/episodes/chunk_index": ([at.chunk] * len(rows), _WHOLE),
        "meta/episodes/file_index": ([at.file] * len(rows), _WHOLE),
        "return": ([row.return_ for row in rows], _REAL),
        "terminated": ([row.terminated for row in rows], _FLAG),
        "interventions": ([row.interventions for row in rows], _WHOLE),
        "policy": ([row.about.policy for row in rows], _TEXT),
        "seed": ([row.about.seed for row in rows], _WHOLE),
        "success": ([row.about.success for row in rows], _FLAG),
        "whole": ([row.about.whole for row in rows], _FLAG),
        "started": ([row.about.started for row in rows], _TEXT),
        "hub": ([row.about.hub for row in rows], _TEXT),
        "program_hash": ([row.about.program_hash for row in rows], _WHOLE),
        "versions": ([json.dumps(row.about.versions) for row in rows], _TEXT),
        "physics": ([json.dumps(row.about.physics) for row in rows], _TEXT),
    }
    key = description.image_key
    if key is not None:
        files = [row.video_file or FileIndex() for row in rows]
        cells |= {
            f"videos/{key}/chunk_index": ([file.chunk for file in files], _WHOLE),
            f"videos/{key}/file_index": ([file.file for file in files], _WHOLE),
            f"videos/{key}/from_timestamp": ([row.video_start_s for row in rows], _REAL),
            f"videos/{key}/to_timestamp": ([row.video_start_s + row.length / description.rate_hz for row in rows], _REAL),
            f"videos/{key}/sha256": ([row.video_sha256 for row in rows], _TEXT),
            f"final/{key}": ([row.final_image for row in rows], pa.binary()),
        }
    for name, feature in features(description).items():
        kind = pa.list_(pa.list_(pa.list_(_REAL))) if feature["dtype"] == "video" else pa.list_(_REAL)
        for stat in _STATS:
            column = [row.statistics[name][stat] for row in rows]
            cells[f"stats/{name}/{stat}"] = (column, pa.list_(_WHOLE) if stat == "count" else kind)
    return pa.table({name: pa.array(values, kind) for name, (values, kind) in cells.items()})


def read_rows(path: Path, description: Description) -> list[EpisodeRow]:
    """The rows in a file.

    Raises:
        DataError: it is missing, damaged or none of such a dataset.
    """
    records = read_parquet(path).to_pylist()
    try:
        return [_row(record, description) for record in records]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError):
        raise DataError(f"{path} holds rows that are not ours; restore it from a copy") from None


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
        about=About(
            policy=str(record["policy"]),
            seed=_optional(int, record["seed"]),
            success=_optional(bool, record["success"]),
            whole=bool(record["whole"]),
            started=str(record["started"]),
            hub=str(record["hub"]),
            program_hash=_optional(int, record["program_hash"]),
            versions=_dictionary(record["versions"]),
            physics=_dictionary(record["physics"]),
        ),
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


def _optional(kind: type, value: Any) -> Any:
    if value is not None and not isinstance(value, kind):
        raise TypeError("another type")
    return value


def _dictionary(text: str) -> dict[str, Any]:
    value = json.loads(text)
    if not isinstance(value, dict):
        raise TypeError("another type")
    return value


def _statistics(record: dict[str, Any], description: Description) -> Statistics:
    found = {}
    for name, feature in features(description).items():
        found[name] = {stat: list(record[f"stats/{name}/{stat}"]) for stat in _STATS}
        wanted = (3, 1, 1) if feature["dtype"] == "video" else tuple(feature["shape"])
        shapes = [np.shape(np.array(found[name][stat], np.float64)) for stat in _STATS]
        if shapes != [wanted] * 4 + [(1,)] or not found[name]["count"][0] > 0:
            raise ValueError("statistics of something else")
    return found


def moved(row: EpisodeRow, episode: int, start: int) -> EpisodeRow:
    """The row where the episode gets another number and place."""
    return dataclasses.replace(row, episode=episode, start=start)
