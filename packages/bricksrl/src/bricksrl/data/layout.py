"""Files and columns of a dataset: the layout of LeRobot's datasets, version 3.0.

::

    meta/info.json                          number of episodes, columns, paths; written last
    meta/stats.json                         minimum, maximum, mean and deviation of every column
    meta/tasks.parquet                      the task instruction, in words
    meta/episodes/chunk-000/file-000.parquet    a row for each episode
    meta/bricksrl.json                      our description: robot, units, ranges; LeRobot does not read it
    data/chunk-000/file-000.parquet         a row for each step
    videos/<camera>/chunk-000/file-000.mp4  an image for each step

A column of vectors of length 1 holds plain numbers, as in LeRobot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from bricksrl.data.schema import Description

CODEBASE_VERSION = "v3.0"
CHUNK_SIZE = 1000
"""Maximum number of files in a folder."""
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"

OBSERVATION, ACTION, NEXT = "observation.state", "action", "next.observation.state"
STEP_COLUMNS = {
    "observation": OBSERVATION,
    "action": ACTION,
    "reward": "next.reward",
    "next_observation": NEXT,
    "terminated": "next.terminated",
    "truncated": "next.truncated",
    "intervention": "intervention",
    "age_s": "age_s",
    "hub_time_s": "hub_time_s",
}
"""Column of each attribute of a step, except its images."""


@dataclass(frozen=True, order=True)
class FileIndex:
    """Number of a file: its chunk folder and its number in it."""

    chunk: int = 0
    file: int = 0

    def next(self) -> FileIndex:
        """The next file."""
        return FileIndex(self.chunk + 1, 0) if self.file == CHUNK_SIZE - 1 else FileIndex(self.chunk, self.file + 1)


@dataclass(frozen=True)
class Layout:
    """Paths of a dataset's files."""

    root: Path

    @property
    def info(self) -> Path:
        return self.root / "meta/info.json"

    @property
    def stats(self) -> Path:
        return self.root / "meta/stats.json"

    @property
    def tasks(self) -> Path:
        return self.root / "meta/tasks.parquet"

    @property
    def description(self) -> Path:
        return self.root / "meta/bricksrl.json"

    def data(self, at: FileIndex) -> Path:
        return self.root / DATA_PATH.format(chunk_index=at.chunk, file_index=at.file)

    def episodes(self, at: FileIndex) -> Path:
        return self.root / EPISODES_PATH.format(chunk_index=at.chunk, file_index=at.file)

    def video(self, key: str, at: FileIndex) -> Path:
        return self.root / VIDEO_PATH.format(video_key=key, chunk_index=at.chunk, file_index=at.file)


def features(description: Description) -> dict[str, dict[str, Any]]:
    """Columns as declared in ``info.json``."""
    observation = [channel.name for channel in description.observation]
    action = [channel.name for channel in description.action]
    columns: dict[str, dict[str, Any]] = {
        OBSERVATION: _feature("float32", observation),
        ACTION: _feature("float32", action),
        NEXT: _feature("float32", observation),
        "next.reward": _feature("float32"),
        "next.done": _feature("bool"),
        "next.terminated": _feature("bool"),
        "next.truncated": _feature("bool"),
        "intervention": _feature("bool"),
        "age_s": _feature("float32"),
        "hub_time_s": _feature("float64"),
        "timestamp": _feature("float32"),
        "frame_index": _feature("int64"),
        "episode_index": _feature("int64"),
        "index": _feature("int64"),
        "task_index": _feature("int64"),
    }
    if description.image_key is not None:
        columns[description.image_key] = _video_feature(description)
    return columns


def _feature(dtype: str, names: list[str] | None = None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [len(names) if names else 1], "names": names}


def _video_feature(description: Description) -> dict[str, Any]:
    side = description.image_px
    video_info = {
        "video.height": side,
        "video.width": side,
        "video.codec": "h264",
        "video.pix_fmt": "gbrp",
        "video.is_depth_map": False,
        "video.fps": rate(description),
        "video.channels": 3,
        "has_audio": False,
    }
    return {"dtype": "video", "shape": [side, side, 3], "names": ["height", "width", "channels"], "info": video_info}


def rate(description: Description) -> int | float:
    """Steps per second, as an integer if possible, as in LeRobot."""
    return int(description.rate_hz) if description.rate_hz.is_integer() else description.rate_hz


def info(description: Description, episodes: int, frames: int) -> dict[str, Any]:
    """Content of ``info.json``."""
    return {
        "codebase_version": CODEBASE_VERSION,
        "robot_type": description.robot.get("name"),
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": CHUNK_SIZE,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate(description),
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA_PATH,
        "video_path": None if description.camera is None else VIDEO_PATH,
        "features": features(description),
    }


def numbers(description: Description) -> Iterator[tuple[str, int, pa.DataType]]:
    """Name, length and type of each column that is stored in Parquet."""
    for name, feature in features(description).items():
        if feature["dtype"] != "video":
            yield name, feature["shape"][0], _TYPES[feature["dtype"]]


_TYPES = {"float32": pa.float32(), "float64": pa.float64(), "int64": pa.int64(), "bool": pa.bool_()}
