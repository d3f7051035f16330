"""Reader of a dataset into memory: all transitions of all episodes, in order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bricksrl.data.episode_index import Index, read_index
from bricksrl.data.images import decode
from bricksrl.data.layout import ACTION, NEXT, OBSERVATION, STEP_COLUMNS, FileIndex, numbers
from bricksrl.data.parquet import from_table, read_parquet, read_verified
from bricksrl.data.recorded_episode import EpisodeData, EpisodeRow
from bricksrl.data.schema import Description
from bricksrl.errors import DataError

if TYPE_CHECKING:
    from tensordict import TensorDict
    from torch import Tensor

COLUMNS = {**STEP_COLUMNS, "episode": "episode_index"}
"""Columns of the tensors of `Episodes`, by name."""


@dataclass(frozen=True)
class Episodes:
    """``N`` transitions of consecutive episodes.

    Attributes:
        description: names, units and ranges of the numbers.
        observation, next_observation: float32 ``[N, n]``.
        action: float32 ``[N, m]``, in -1..1.
        reward: float32 ``[N]``.
        terminated, truncated: bool ``[N]``; bootstrap values through a truncation only.
        episode: int64 ``[N]``, from 0.
        intervention: bool ``[N]``; whether a human chose the action.
        age_s: float32 ``[N]``; age of the observation when the action was sent.
        hub_time_s: float64 ``[N]``; the hub's clock at ``next_observation``, NaN without a hub.
        image, next_image: uint8 ``[N, side, side, 3]``; ``None`` without a camera, or if not requested.
        rows: row of each episode.
    """

    description: Description
    observation: Tensor
    action: Tensor
    reward: Tensor
    next_observation: Tensor
    terminated: Tensor
    truncated: Tensor
    episode: Tensor
    intervention: Tensor
    age_s: Tensor
    hub_time_s: Tensor
    image: Tensor | None = None
    next_image: Tensor | None = None
    rows: tuple[EpisodeRow, ...] = ()

    def __len__(self) -> int:
        return len(self.reward)

    def returns(self) -> NDArray[np.float64]:
        """Sum of the rewards of each episode."""
        return np.array([row.return_ for row in self.rows])

    def to_tensordict(self) -> TensorDict:
        """Transitions ``[N]`` in TorchRL's format: outcomes under ``next``, flags and rewards ``[N, 1]``."""
        from tensordict import TensorDict

        n = [len(self)]
        after = {
            "observation": self.next_observation,
            "reward": self.reward[:, None],
            "terminated": self.terminated[:, None],
            "truncated": self.truncated[:, None],
            "done": (self.terminated | self.truncated)[:, None],
        }
        step = {name: getattr(self, name) for name in ("observation", "action", "episode", "intervention")}
        if self.image is not None and self.next_image is not None:
            step["image"], after["image"] = self.image, self.next_image
        return TensorDict({**step, "next": TensorDict(after, n)}, n)


def load(path: Path | str, *, images: bool = True) -> Episodes:
    """Load the dataset in a folder, or in the folder of a run. Nothing in it is executed, nothing is written. Raises DataError if
    there is no dataset, it is damaged, or it was not made by BricksRL.

    Args:
        images: read the images too, if there are any.
    """
    import torch

    index = read_index(Path(path))
    reader = EpisodeReader(index, COLUMNS.values(), images=images)
    episodes = [reader.read(row) for row in index.rows]
    columns = _joined(index, episodes)
    arrays = {name: columns[column] for name, column in COLUMNS.items()}
    if reader.image_key is not None:
        arrays["image"] = np.concatenate([episode.images for episode in episodes])
        arrays["next_image"] = np.concatenate([image for episode in episodes for image in _next_images(index, episode)])
    tensors = {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}
    return Episodes(description=index.description, rows=index.rows, **tensors)


def read_columns(index: Index, names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Read columns of all steps: ``[N]``, vectors ``[N, n]`` even for ``n`` = 1. Raises DataError if a file is missing
    or damaged."""
    reader = EpisodeReader(index, names, images=False)
    return _joined(index, [reader.read(row) for row in index.rows])


def _joined(index: Index, episodes: Sequence[EpisodeData]) -> dict[str, NDArray[Any]]:
    """Columns of all episodes together, as of `read_columns`."""
    if not episodes:
        raise DataError(f"the dataset in {index.layout.root} has no episodes yet; record some")
    joined = {name: np.concatenate([episode.columns[name] for episode in episodes]) for name in episodes[0].columns}
    vectors = (OBSERVATION, ACTION, NEXT)
    return {name: array.reshape(len(array), -1) if name in vectors else array for name, array in joined.items()}


def _next_images(index: Index, episode: EpisodeData) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Images after the steps of an episode: those before the later steps, and the final one."""
    assert episode.images is not None  # noqa: S101  the caller reads them
    final = np.frombuffer(episode.row.final_image or b"", np.uint8)
    if final.size != episode.images[0].size:
        raise DataError(f"episode {episode.row.episode} in {index.layout.root} has no final image; restore meta/episodes")
    return episode.images[1:], final.reshape(1, *episode.images.shape[1:])


class EpisodeReader:
    """Reader of single episodes of a dataset. It keeps the file that it has read last, which may hold the next episode too.

    Args:
        names: columns to read; by default all.
        images: read the images too, if there are any.

    Attributes:
        image_key: name of the images' feature; ``None`` if none are read.
    """

    def __init__(self, index: Index, names: Iterable[str] | None = None, *, images: bool = True) -> None:
        self.image_key = index.description.image_key if images else None
        self._index = index
        self._names = [name for name, _, _ in numbers(index.description)] if names is None else list(names)
        self._by_data_file: dict[FileIndex, list[EpisodeRow]] = {}
        self._by_video_file: dict[FileIndex | None, list[EpisodeRow]] = {}
        for row in index.rows:
            self._by_data_file.setdefault(row.data_file, []).append(row)
            self._by_video_file.setdefault(row.video_file, []).append(row)
        self._table: tuple[FileIndex, pa.Table] | None = None
        self._video: tuple[FileIndex | None, NDArray[np.uint8]] | None = None

    def read(self, row: EpisodeRow) -> EpisodeData:
        """Read an episode. Raises DataError if a file of it is missing or damaged."""
        index = self._index
        rows = self._by_data_file[row.data_file]
        if self._table is None or self._table[0] != row.data_file:
            self._table = row.data_file, _read_file(index, rows)
        table = self._table[1].slice(row.start - rows[0].start, row.length)
        columns = from_table(table, index.description, self._names, index.layout.data(row.data_file))
        return EpisodeData(row, columns, None if self.image_key is None else self._images(row, self.image_key))

    def _images(self, row: EpisodeRow, key: str) -> NDArray[np.uint8]:
        """Images before the steps of an episode."""
        rows = self._by_video_file[row.video_file]
        if self._video is None or self._video[0] != row.video_file:
            path = self._index.layout.video(key, row.video_file or FileIndex())
            read_verified(path, row.video_sha256)
            self._video = row.video_file, decode(path, sum(other.length for other in rows), self._index.description.image_px)
        start = row.start - rows[0].start
        return self._video[1][start : start + row.length]


def _read_file(index: Index, rows: Sequence[EpisodeRow]) -> pa.Table:
    """Read the steps of the episodes in one file, checked against their rows."""
    path = index.layout.data(rows[0].data_file)
    table = read_parquet(path, digest=rows[0].data_sha256)
    table = table.slice(0, sum(row.length for row in rows))  # episodes of an unfinished commit may follow
    stored = from_table(table, index.description, ("index", "episode_index"), path)
    lengths = [row.length for row in rows]
    if sum(lengths) != len(table) or not (  # checked first, since a damaged row may claim any size
        np.array_equal(stored["index"], rows[0].start + np.arange(len(table)))
        and np.array_equal(stored["episode_index"], np.repeat([row.episode for row in rows], lengths))
    ):
        raise DataError(f"{path} holds other steps than meta/episodes says; restore both from one copy")
    return table
