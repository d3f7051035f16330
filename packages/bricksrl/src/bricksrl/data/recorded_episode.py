"""Episodes to be written: their steps, and their rows in ``meta/episodes``."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from brickhub.files import write_durably
from bricksrl.data.images import encode
from bricksrl.data.layout import STEP_COLUMNS, FileIndex, Layout, features, numbers
from bricksrl.data.parquet import Statistics, image_statistics, statistics, to_parquet, to_table
from bricksrl.data.schema import Description

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Step:
    """One step of an episode.

    Attributes:
        observation, next_observation: ``[n]``, before and after the step.
        action: ``[m]``, in -1..1, as given to the environment.
        image, next_image: uint8 ``[side, side, 3]``, with a camera.
        intervention: whether a human chose the action.
        age_s: age of the observation when the action was sent to the robot.
        hub_time_s: the hub's clock when it measured ``next_observation``; NaN without a hub.
    """

    observation: ArrayLike
    action: ArrayLike
    reward: float
    next_observation: ArrayLike
    terminated: bool
    truncated: bool
    image: Image | None = None
    next_image: Image | None = None
    intervention: bool = False
    age_s: float = 0.0
    hub_time_s: float = float("nan")


@dataclass(frozen=True)
class About:
    """Provenance of an episode: policy, seed, hub, versions, success.

    Attributes:
        policy: source of the actions, such as ``"random"``, ``"sac"``, ``"keyboard"``.
        seed: seed of the episode; ``None`` if none was given.
        success: success by the task; ``None`` if it defines none.
        whole: whether the episode ran to its end; false if it was interrupted.
        started: date and time of its start, with the time zone.
        hub: how the robot was reached.
        robot: name of the robot, if several recorded together.
        program_hash: hash of the program on its hub; ``None`` without a hub.
        versions: versions of the recording packages.
        physics: physics of a virtual robot, as plain values.
    """

    policy: str = ""
    seed: int | None = None
    success: bool | None = None
    whole: bool = True
    started: str = ""
    hub: str = ""
    robot: str = ""
    program_hash: int | None = None
    versions: dict[str, str] = field(default_factory=dict)
    physics: dict[str, float] = field(default_factory=dict)


def _columns(steps: list[Step], description: Description) -> dict[str, NDArray[Any]]:
    """Columns ``[steps, n]`` and ``[steps]`` of the first episode of a dataset."""
    dtypes = {name: feature["dtype"] for name, feature in features(description).items()}
    columns = {}
    for name, column in STEP_COLUMNS.items():
        columns[column] = np.stack([np.asarray(getattr(step, name), dtypes[column]).reshape(-1) for step in steps])
    frames, zeros = np.arange(len(steps), dtype=np.int64), np.zeros(len(steps), np.int64)
    columns["next.done"] = columns["next.terminated"] | columns["next.truncated"]
    columns["timestamp"] = (frames / description.rate_hz).astype(np.float32)
    columns |= {"frame_index": frames, "episode_index": zeros, "index": frames, "task_index": zeros}
    return {name: columns[name] for name, _, _ in numbers(description)}


@dataclass(frozen=True)
class EpisodeRow:
    """Row of an episode in ``meta/episodes``.

    Attributes:
        start: first row of the episode in the dataset.
        data_file: file with its steps; ``data_sha256`` is the file's digest, ``None`` if none was recorded.
        video_file, video_start_s, video_sha256: the same for its images.
        final_image: raw bytes of the image after the last step, which the video does not have.
        return_: sum of its rewards.
        statistics: statistics of its columns.
    """

    episode: int
    length: int
    start: int
    return_: float
    terminated: bool
    interventions: int
    data_file: FileIndex
    data_sha256: str | None
    statistics: Statistics
    about: About
    video_file: FileIndex | None = None
    video_start_s: float = 0.0
    video_sha256: str | None = None
    final_image: bytes | None = None


@dataclass(frozen=True)
class EpisodeData:
    """Complete episode: its row, columns ``[length, ...]`` and images."""

    row: EpisodeRow
    columns: dict[str, NDArray[Any]]
    images: NDArray[np.uint8] | None


def new_episode(steps: list[Step], about: About, description: Description) -> EpisodeData:
    """Episode of these steps, as the first one of a dataset; `write_episodes` gives it another number and its files."""
    columns = _columns(steps, description)
    key, final, images = description.image_key, steps[-1].next_image, None
    if key is not None and final is not None:
        images = np.stack([step.image for step in steps if step.image is not None])
    row = EpisodeRow(
        episode=0,
        length=len(steps),
        start=0,
        return_=float(columns["next.reward"].sum(dtype=np.float64)),
        terminated=bool(columns["next.terminated"][-1]),
        interventions=int(columns["intervention"].sum()),
        data_file=FileIndex(),
        data_sha256=None,
        statistics={} if key is None or images is None else {key: image_statistics(images)},
        about=about,
        final_image=None if images is None else np.ascontiguousarray(final).tobytes(),
    )
    return EpisodeData(row, columns, images)


def write_episodes(
    layout: Layout, description: Description, episodes: Sequence[EpisodeData], number: int, start: int, at: FileIndex
) -> list[EpisodeRow]:
    """Write one data file and one video file; returns the new rows of the episodes, which are numbered from ``number``, and their
    steps from ``start``."""
    rows, tables, key = [], [], description.image_key
    video_s = 0.0
    for item in episodes:
        length = item.row.length
        columns = {
            **item.columns,
            "episode_index": np.full(length, number, np.int64),
            "index": np.arange(start, start + length, dtype=np.int64),
        }
        tables.append(to_table(columns, description))
        row = dataclasses.replace(item.row, episode=number, start=start, data_file=at, statistics=statistics(columns))
        if key is not None and item.images is not None:
            row.statistics[key] = item.row.statistics[key]
            row = dataclasses.replace(row, video_file=at, video_start_s=video_s)
        rows.append(row)
        number += 1
        start += length
        video_s += length / description.rate_hz
    data = to_parquet(pa.concat_tables(tables))
    write_durably(layout.data(at), data)
    rows = [dataclasses.replace(row, data_sha256=hashlib.sha256(data).hexdigest()) for row in rows]
    images = [item.images for item in episodes if item.images is not None]
    if key is not None and images:
        video = encode(np.concatenate(images), description.rate_hz)
        write_durably(layout.video(key, at), video)
        rows = [dataclasses.replace(row, video_sha256=hashlib.sha256(video).hexdigest()) for row in rows]
    return rows
