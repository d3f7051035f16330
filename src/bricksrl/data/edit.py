"""Editing of datasets: merge, split, and salvage of a damaged one, each into a new dataset. Sources are never changed.

The datasets written here have few large files, as LeRobot prefers, where a recording has one file per episode.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bricksrl.data.episode import EpisodeData, EpisodeRow, write_episodes
from bricksrl.data.episode_index import Index, read_description, read_index, read_rows, rows_table, task_instruction, write_index
from bricksrl.data.images import decode
from bricksrl.data.layout import FileIndex, Layout, numbers
from bricksrl.data.parquet import from_table, read_verified, tasks_table, to_parquet
from bricksrl.data.reader import read_file
from bricksrl.data.schema import Description
from bricksrl.errors import DataError, counted
from bricksrl.files import atomic_folder, refuse_existing, write_durably
from bricksrl.seed import check_seed

STEPS_PER_FILE = 20_000
"""Steps after which a new file begins."""


def merge(sources: Sequence[Path], out: Path) -> Index:
    """Merge the episodes of all ``sources``, in order, into a new dataset; a single source is copied compactly. Raises DataError
    if a source is damaged, their descriptions differ, or ``out`` exists."""
    indices = [read_index(source) for source in sources]
    for source, index in zip(sources[1:], indices[1:], strict=True):
        differences = indices[0].description.differences(index.description)
        if differences:
            raise DataError(f"{source} cannot join {sources[0]}: {'; '.join(differences)}; join data of one kind")
    episodes = (episode for index in indices for episode in read_episodes(index, index.rows))
    return write_dataset(out, indices[0].description, episodes)


def split(source: Path, first: Path, second: Path, share: float, seed: int) -> tuple[Index, Index]:
    """Write a random share of the episodes to ``first`` and the others to ``second``, both in order. Raises DataError if the
    source is damaged, a target exists, or a target would be empty, DescriptionError if the seed is invalid."""
    if not math.isfinite(share):
        raise DataError(f"share is {share:g}; give a number between 0 and 1")
    check_seed(seed)
    index = read_index(source)
    count = round(share * len(index.rows))
    if not 0 < count < len(index.rows):
        raise DataError(
            f"a share of {share:g} of {counted(len(index.rows), 'episode')} leaves one of the two empty; choose another"
        )
    chosen = set(np.random.default_rng(seed).permutation(len(index.rows))[:count].tolist())
    parts = [[row for row in index.rows if (row.episode in chosen) is in_first] for in_first in (True, False)]
    for target in (first, second):
        refuse_existing(target, DataError)
    if first.resolve() == second.resolve():
        raise DataError(f"both parts are to go to {first}; give each a separate folder")
    written = [
        write_dataset(target, index.description, read_episodes(index, rows))
        for target, rows in zip((first, second), parts, strict=True)
    ]
    return written[0], written[1]


def salvage(source: Path, out: Path) -> tuple[Index, list[str]]:
    """Write the intact episodes of a damaged dataset to a new one; returns its index and messages on what was lost. Raises
    DataError if the description is damaged, no episode is intact, or ``out`` exists."""
    layout = Layout(source)
    refuse_existing(out, DataError)
    description = read_description(layout)
    lost: list[str] = []
    rows: list[EpisodeRow] = []
    at = FileIndex()
    for at in _file_indices(layout):
        try:
            rows += read_rows(layout.episodes(at), description)
        except DataError as error:
            lost.append(str(error))
    index = Index(layout, description, tuple(sorted(rows, key=lambda row: row.episode)), at)
    kept: list[EpisodeData] = []
    for row in index.rows:
        try:
            kept += read_episodes(index, [row])
        except DataError as error:
            lost.append(f"episode {row.episode}: {error}")
    if not kept:
        raise DataError(f"no episode in {source} is whole; restore it from a copy")
    return write_dataset(out, description, kept), lost


def _file_indices(layout: Layout) -> Iterator[FileIndex]:
    for path in sorted((layout.root / "meta/episodes").glob("chunk-*/file-*.parquet")):
        try:
            yield FileIndex(int(path.parent.name.removeprefix("chunk-")), int(path.stem.removeprefix("file-")))
        except ValueError:
            continue


def read_episodes(index: Index, rows: Iterable[EpisodeRow]) -> Iterator[EpisodeData]:
    """Read episodes of a dataset, one by one. Raises DataError if an episode is damaged."""
    key, side = index.description.image_key, index.description.image_px
    names = [name for name, _, _ in numbers(index.description)]
    tables: dict[FileIndex, pa.Table] = {}
    videos: dict[FileIndex, NDArray[np.uint8]] = {}
    for row in rows:
        same_file = [other for other in index.rows if other.data_file == row.data_file]
        if row.data_file not in tables:
            tables = {row.data_file: read_file(index, same_file)}
        table = tables[row.data_file].slice(row.start - same_file[0].start, row.length)
        columns = from_table(table, index.description, names, index.layout.data(row.data_file))
        images = None
        if key is not None and row.video_file is not None:
            same_file = [other for other in index.rows if other.video_file == row.video_file]
            if row.video_file not in videos:
                path = index.layout.video(key, row.video_file)
                read_verified(path, row.video_sha256)
                videos = {row.video_file: decode(path, sum(other.length for other in same_file), side)}
            offset = row.start - same_file[0].start
            images = videos[row.video_file][offset : offset + row.length]
        yield EpisodeData(row, columns, images)


def write_dataset(out: Path, description: Description, episodes: Iterable[EpisodeData]) -> Index:
    """Write a dataset atomically. Raises DataError if ``out`` exists, or there are no episodes."""
    refuse_existing(out, DataError)
    with atomic_folder(out) as folder:
        rows: list[EpisodeRow] = []
        layout = Layout(folder)
        at = FileIndex()
        for group in _groups(episodes):
            start = rows[-1].start + rows[-1].length if rows else 0
            rows += write_episodes(layout, description, group, len(rows), start, at)
            at = at.next()
        if not rows:
            raise DataError(f"there are no episodes to write to {out}; choose others")
        write_durably(layout.description, description.to_json())
        write_durably(layout.tasks, tasks_table(task_instruction(description)))
        write_durably(layout.episodes(FileIndex()), to_parquet(rows_table(rows, description, FileIndex())))
        write_index(layout, description, rows)
    return Index(Layout(out), description, tuple(rows), FileIndex())


def _groups(episodes: Iterable[EpisodeData]) -> Iterator[list[EpisodeData]]:
    group: list[EpisodeData] = []
    steps = 0
    for episode in episodes:
        group.append(episode)
        steps += episode.row.length
        if steps >= STEPS_PER_FILE:
            yield group
            group, steps = [], 0
    if group:
        yield group
