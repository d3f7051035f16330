"""Reader of a dataset into memory: all transitions of all episodes, in order."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bricksrl.data.episode import EpisodeRow
from bricksrl.data.episode_index import Index, read_index
from bricksrl.data.layout import ACTION, NEXT, OBSERVATION, FileIndex
from bricksrl.data.parquet import from_table, read_parquet, read_verified
from bricksrl.data.schema import Description
from bricksrl.errors import DataError

if TYPE_CHECKING:
    from tensordict import TensorDict
    from torch import Tensor

COLUMNS = {
    "observation": OBSERVATION,
    "action": ACTION,
    "reward": "next.reward",
    "next_observation": NEXT,
    "terminated": "next.terminated",
    "truncated": "next.truncated",
    "episode": "episode_index",
    **{name: name for name in ("intervention", "age_s", "hub_time_s")},
}
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

    index = read_index(dataset_folder(Path(path)))
    columns = read_columns(index, tuple(COLUMNS.values()))
    tensors = {name: torch.from_numpy(np.ascontiguousarray(columns[column])) for name, column in COLUMNS.items()}
    images_read: dict[str, Any] = {}
    if images and index.description.camera is not None:
        image, after = read_images(index)
        images_read = {"image": torch.from_numpy(image), "next_image": torch.from_numpy(after)}
    return Episodes(description=index.description, rows=index.rows, **tensors, **images_read)


def dataset_folder(path: Path) -> Path:
    """Folder of the dataset: the given one, or ``data`` in the folder of a run."""
    folder = path / "data"
    return folder if (folder / "meta/info.json").exists() and not (path / "meta/info.json").exists() else path


def read_columns(index: Index, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Read columns of all steps: ``[N]``, vectors ``[N, n]`` even for ``n`` = 1. Raises DataError if a file is missing
    or damaged."""
    widths = {OBSERVATION: len(index.description.observation), NEXT: len(index.description.observation)}
    widths[ACTION] = len(index.description.action)
    parts: list[dict[str, NDArray[Any]]] = []
    for rows in by_file(index.rows):
        table = read_file(index, rows)
        parts.append(from_table(table, index.description, names, index.layout.data(rows[0].data_file)))
    if not parts:
        raise DataError(f"the dataset in {index.layout.root} has no episodes yet; record some")
    joined = {name: np.concatenate([part[name] for part in parts]) for name in names}
    return {name: array.reshape(-1, widths[name]) if name in widths else array for name, array in joined.items()}


def read_file(index: Index, rows: Sequence[EpisodeRow]) -> pa.Table:
    """Read the steps of the episodes in one file, checked against their rows."""
    path = index.layout.data(rows[0].data_file)
    table = read_parquet(path, digest=rows[0].data_sha256)
    table = table.slice(0, sum(row.length for row in rows))  # episodes of an unfinished commit may follow
    numbers = from_table(table, index.description, ("index", "episode_index"), path)
    lengths = [row.length for row in rows]
    if sum(lengths) != len(table) or not (  # checked first, since a damaged row may claim any size
        np.array_equal(numbers["index"], rows[0].start + np.arange(len(table)))
        and np.array_equal(numbers["episode_index"], np.repeat([row.episode for row in rows], lengths))
    ):
        raise DataError(f"{path} holds other steps than meta/episodes says; restore both from one copy")
    return table


def by_file(rows: Sequence[EpisodeRow]) -> Iterator[list[EpisodeRow]]:
    """Rows grouped by data file."""
    for _, part in itertools.groupby(rows, key=lambda row: row.data_file):
        yield list(part)


def read_images(index: Index) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Read the images before and after all steps, each ``[N, side, side, 3]``. Raises DataError if a video is missing or
    damaged."""
    from bricksrl.data.images import decode

    key, side = index.description.image_key, index.description.image_px
    if key is None:
        raise DataError(f"the dataset in {index.layout.root} has no images; it was recorded without a camera")
    before, after = [], []
    for file, part in itertools.groupby(index.rows, key=lambda row: row.video_file):
        rows = list(part)
        path = index.layout.video(key, file or FileIndex())
        read_verified(path, rows[0].video_sha256)
        images = decode(path, sum(row.length for row in rows), side)
        offset = 0
        for row in rows:
            episode = images[offset : offset + row.length]
            final = np.frombuffer(row.final_image or b"", np.uint8)
            if final.size != episode[0].size:
                raise DataError(f"episode {row.episode} in {index.layout.root} has no final image; restore meta/episodes")
            before.append(episode)
            after.append(np.concatenate([episode[1:], final.reshape(1, side, side, 3)]))
            offset += row.length
    return np.concatenate(before), np.concatenate(after)
