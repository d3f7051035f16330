"""Editing of datasets: merge, split, and salvage of a damaged one, each into a new dataset. Sources are never changed.

The datasets written here have few large files, as LeRobot prefers, where a recording has one file per episode.
"""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from brickhub.files import atomic_folder, refuse_existing, write_durably
from brickhub.seed import check_seed
from bricksrl.data.episode_index import Index, read_description, read_index, read_rows, rows_table, task_instruction, write_index
from bricksrl.data.layout import FileIndex, Layout
from bricksrl.data.parquet import tasks_table, to_parquet
from bricksrl.data.reader import EpisodeReader
from bricksrl.data.recorded_episode import EpisodeData, EpisodeRow, write_episodes
from bricksrl.data.schema import Description
from bricksrl.errors import DataError, counted

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
    episodes = (map(EpisodeReader(index).read, index.rows) for index in indices)
    return write_dataset(out, indices[0].description, itertools.chain.from_iterable(episodes))


def split(source: Path, first: Path, second: Path, share: float, seed: int) -> tuple[Index, Index]:
    """Write a random share of the episodes to ``first`` and the others to ``second``, both in order. Raises DataError if the
    source is damaged, a target exists, or a target would be empty, DescriptionError if the seed is invalid."""
    if not 0.0 <= share <= 1.0:
        raise DataError(f"share is {share:g}; give a number between 0 and 1")
    check_seed(seed)
    index = read_index(source)
    count = round(share * len(index.rows))
    if not 0 < count < len(index.rows):
        raise DataError(
            f"a share of {share:g} of {counted(len(index.rows), 'episode')} leaves one of the two empty; choose another"
        )
    chosen = set(np.random.default_rng(seed).permutation(len(index.rows))[:count].tolist())
    drawn, others = ([row for row in index.rows if (row.episode in chosen) is is_drawn] for is_drawn in (True, False))
    for target in (first, second):
        refuse_existing(target, DataError)
    if first.resolve() == second.resolve():
        raise DataError(f"both parts are to go to {first}; give each a separate folder")
    read = EpisodeReader(index).read
    part = write_dataset(first, index.description, map(read, drawn))
    try:
        return part, write_dataset(second, index.description, map(read, others))
    except BaseException:  # both parts or none
        shutil.rmtree(first, ignore_errors=True)
        raise


def salvage(source: Path, out: Path) -> tuple[Index, list[str]]:
    """Write the intact episodes of a damaged dataset to a new one; returns its index and messages on what was lost. Raises
    DataError if the description is damaged, no episode is intact, or ``out`` exists."""
    layout = Layout(source)
    refuse_existing(out, DataError)
    description = read_description(layout)
    lost: list[str] = []
    rows: list[EpisodeRow] = []
    for path in sorted((source / "meta/episodes").glob("chunk-[0-9]*/file-[0-9][0-9][0-9].parquet")):
        try:
            rows += read_rows(path, description)
        except DataError as error:
            lost.append(str(error))
    rows.sort(key=lambda row: row.episode)
    missing = rows[-1].episode + 1 - len(rows) if rows else 0
    if missing > 0:
        lost.append(f"{counted(missing, 'episode')} before the last one: no row in meta/episodes")
    reader = EpisodeReader(Index(layout, description, tuple(rows), None))
    kept: list[EpisodeData] = []
    for row in rows:
        try:
            kept.append(reader.read(row))
        except DataError as error:
            lost.append(f"episode {row.episode}: {error}")
    if not kept:
        raise DataError(f"no episode in {source} is whole; restore it from a copy")
    return write_dataset(out, description, kept), lost


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
