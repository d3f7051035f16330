"""Reader of a dataset into memory: all transitions of all episodes, in order."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bricksrl.data.columns import arrow_types, decode, from_table, read_parquet, read_verified
from bricksrl.data.dataset import Dataset, Episode, EpisodeRow, dataset_folder, read_dataset
from bricksrl.data.schema import ACTION, NEXT, OBSERVATION, STEP_COLUMNS, Description
from bricksrl.errors import DataError

if TYPE_CHECKING:
    from tensordict import TensorDict
    from torch import Tensor

    from bricksrl.envs.task import Task

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
        image, next_image: uint8 ``[N, side, side, 3]``; ``None`` without a camera, or if not
            requested.
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

    def observing(self, names: Sequence[str]) -> Episodes:
        """The same transitions with these entries of the observation only, in this order; each must
        be there."""
        all_names = [entry.name for entry in self.description.observation]
        places = [all_names.index(name) for name in names]
        entries = tuple(self.description.observation[place] for place in places)
        return dataclasses.replace(
            self,
            description=dataclasses.replace(self.description, observation=entries),
            observation=self.observation[:, places],
            next_observation=self.next_observation[:, places],
        )

    def to_tensordict(self) -> TensorDict:
        """Transitions ``[N]`` in TorchRL's format: outcomes under ``next``, flags and rewards ``[N,
        1]``."""
        from tensordict import TensorDict

        n = [len(self)]
        after = {
            "observation": self.next_observation,
            "reward": self.reward[:, None],
            "terminated": self.terminated[:, None],
            "truncated": self.truncated[:, None],
            "done": (self.terminated | self.truncated)[:, None],
        }
        step = {
            "observation": self.observation,
            "action": self.action,
            "episode": self.episode,
            "intervention": self.intervention,
        }
        if self.image is not None and self.next_image is not None:
            step["image"] = self.image
            after["image"] = self.next_image
        return TensorDict({**step, "next": TensorDict(after, n)}, n)


def load(
    path: Path | str,
    *,
    images: bool = True,
    task: Task | str | None = None,
) -> Episodes:
    """Load the dataset in a folder, or in the folder of a run; also one that LeRobot recorded.
    Nothing in it is executed, nothing is written. Raises DataError if there is no dataset, it is
    damaged, or it does not have what is needed.

    Args:
        images: read the images too, if there are any.
        task: whose rewards and ends what LeRobot recorded gets; by default that of the robot which
            it names.
    """
    import torch

    # This import is here because that module writes datasets with what this one defines.
    from bricksrl.data.lerobot import is_lerobot, read_lerobot

    if is_lerobot(root := dataset_folder(path)):
        dataset, episodes = _as_dataset(root, *read_lerobot(root, task))
        reader = EpisodeReader(dataset, COLUMNS.values(), images=False)
    else:
        dataset = read_dataset(path)
        reader = EpisodeReader(dataset, COLUMNS.values(), images=images)
        episodes = [reader.read(row) for row in dataset.rows]
    columns = _joined(dataset, episodes)
    arrays = {name: columns[column] for name, column in COLUMNS.items()}
    if reader.image_key is not None:
        shown = [episode.images for episode in episodes if episode.images is not None]
        arrays["image"] = np.concatenate([images[:-1] for images in shown])
        arrays["next_image"] = np.concatenate([images[1:] for images in shown])
    tensors = {
        name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()
    }
    return Episodes(
        description=dataset.description,
        rows=dataset.rows,
        **tensors,
    )


def _as_dataset(
    root: Path,
    description: Description,
    episodes: list[Episode],
) -> tuple[Dataset, list[Episode]]:
    """A dataset with rows of these episodes, which no file of ours holds, and the episodes with
    their numbers."""
    rows = []
    numbered = []
    start = 0
    for number, episode in enumerate(episodes):
        # Files hold single numbers as [steps] and not [steps, 1]; `_joined` restores vectors of
        # length 1.
        columns = dict(episode.columns)
        for name, values in columns.items():
            if values[0].size == 1:
                columns[name] = values.reshape(-1)
        length = len(columns["index"])
        row = EpisodeRow(
            episode=number,
            length=length,
            start=start,
            return_=float(columns["next.reward"].sum(dtype=np.float64)),
            terminated=bool(columns["next.terminated"][-1]),
            interventions=0,
            data_file=0,
            data_sha256=None,
            statistics={},
            about=episode.about,
        )
        rows.append(row)
        columns["episode_index"] = np.full(length, number)
        numbered.append(dataclasses.replace(episode, columns=columns))
        start += length
    return Dataset(root, description, tuple(rows)), numbered


def read_columns(dataset: Dataset, names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Read columns of all steps: ``[N]``, vectors ``[N, n]`` even for ``n`` = 1. Raises DataError
    if a file is missing or damaged."""
    reader = EpisodeReader(dataset, names, images=False)
    return _joined(dataset, [reader.read(row) for row in dataset.rows])


def _joined(dataset: Dataset, episodes: list[Episode]) -> dict[str, NDArray[Any]]:
    """Columns of all episodes together, as of `read_columns`."""
    if not episodes:
        raise DataError(f"the dataset in {dataset.root} has no episodes yet; record some")
    joined = {}
    for name in episodes[0].columns:
        array = np.concatenate([episode.columns[name] for episode in episodes])
        is_vector = name in (OBSERVATION, ACTION, NEXT)
        joined[name] = array.reshape(len(array), -1) if is_vector else array
    return joined


class EpisodeReader:
    """Reader of single episodes of a dataset. It keeps the files that it has read last, which may
    hold the next episode too.

    Args:
        names: columns to read; by default all.
        images: read the images too, if there are any.

    Attributes:
        image_key: name of the images' feature; ``None`` if none are read.
    """

    def __init__(
        self,
        dataset: Dataset,
        names: Iterable[str] | None = None,
        *,
        images: bool = True,
    ) -> None:
        self.image_key = dataset.description.image_key if images else None
        self._dataset = dataset
        self._names = list(arrow_types(dataset.description) if names is None else names)
        self._by_file: dict[int, list[EpisodeRow]] = defaultdict(list)
        for row in dataset.rows:
            self._by_file[row.data_file].append(row)
        # One file of each kind is kept, because a merged dataset has many episodes in a file and is
        # read in order.
        self._table = lru_cache(maxsize=1)(self._read_table)
        self._video = lru_cache(maxsize=1)(self._read_video)

    def read(self, row: EpisodeRow) -> Episode:
        """Read an episode. Raises DataError if a file of it is missing or damaged."""
        dataset = self._dataset
        start = row.start - self._by_file[row.data_file][0].start
        table = self._table(row.data_file).slice(start, row.length)
        columns = from_table(
            table,
            dataset.description,
            self._names,
            dataset.path("data", row.data_file),
        )
        if self.image_key is None:
            return Episode(row.about, columns)
        images = self._video(row.data_file)[start : start + row.length]
        final = np.frombuffer(row.final_image or b"", np.uint8)
        if final.size != images[0].size:
            raise DataError(
                f"episode {row.episode} in {dataset.root} has no final image; restore meta/episodes"
            )
        images = np.concatenate((images, final.reshape(1, *images.shape[1:])))
        return Episode(
            row.about,
            columns,
            images,
            row.statistics[self.image_key],
        )

    def _read_table(self, file: int) -> pa.Table:
        """Steps of the episodes in one file, checked against their rows."""
        dataset = self._dataset
        rows = self._by_file[file]
        path = dataset.path("data", file)
        lengths = [row.length for row in rows]
        table = read_parquet(path, digest=rows[0].data_sha256)
        # Episodes of an unfinished commit may follow, which the index does not have.
        table = table.slice(0, sum(lengths))
        stored = from_table(
            table,
            dataset.description,
            ("index", "episode_index"),
            path,
        )
        fits = sum(lengths) == len(table)
        # Images are decoded only for a table of the right length, because a damaged row may claim
        # any size.
        if fits:
            steps = rows[0].start + np.arange(len(table))
            episodes = np.repeat([row.episode for row in rows], lengths)
            has_steps = np.array_equal(stored["index"], steps)
            fits = has_steps and np.array_equal(stored["episode_index"], episodes)
        if not fits:
            raise DataError(
                f"{path} holds other steps than meta/episodes says; restore both from one copy"
            )
        return table

    def _read_video(self, file: int) -> NDArray[np.uint8]:
        """Images before the steps of the episodes in one file."""
        dataset = self._dataset
        rows = self._by_file[file]
        path = dataset.path("video", file)
        read_verified(path, rows[0].video_sha256)
        return decode(path, sum(row.length for row in rows), dataset.description.image_px)
