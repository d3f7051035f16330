"""Editing of datasets: merge, split, select episodes, and salvage a damaged one, each into a new
dataset. Sources are never changed.

The datasets written here have few large files, as LeRobot prefers, where a recording has one file
per episode.
"""

import itertools
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from brickhub.files import atomic_folder
from brickhub.seed import check_seed
from bricksrl.data.dataset import (
    Dataset,
    Episode,
    EpisodeRow,
    existing_dataset,
    read_dataset,
    read_description,
    read_rows,
    refuse_target,
)
from bricksrl.data.reader import EpisodeReader
from bricksrl.data.schema import Description
from bricksrl.data.selection import Selection
from bricksrl.errors import DataError, counted

STEPS_PER_FILE = 20_000
"""Steps after which a new file begins."""


def merge(sources: Sequence[Path], out: Path) -> Dataset:
    """Merge the episodes of all ``sources``, in order, into a new dataset; a single source is
    copied compactly. Raises DataError if a source is damaged or named twice, their descriptions
    differ, or ``out`` exists."""
    refuse_target(out)
    _refuse_twice(sources)
    datasets = [read_dataset(source) for source in sources]
    for source, dataset in zip(sources[1:], datasets[1:], strict=True):
        differences = datasets[0].description.differences(dataset.description)
        if differences:
            raise DataError(
                f"{source} cannot join {sources[0]}: {'; '.join(differences)}; join data of "
                "one kind"
            )
    episodes = (map(EpisodeReader(dataset).read, dataset.rows) for dataset in datasets)
    return write_dataset(out, datasets[0].description, itertools.chain.from_iterable(episodes))


def _refuse_twice(sources: Sequence[Path]) -> None:
    """Raise DataError if two sources are one dataset, also by other names: a link, or a run and its
    folder data. Each of its episodes would count twice."""
    seen: set[Path] = set()
    for source in sources:
        folder = existing_dataset(source).resolve()
        if folder in seen:
            raise DataError(f"{source} is named twice; name it once")
        seen.add(folder)


def split(
    source: Path,
    first: Path,
    second: Path,
    share: float,
    seed: int,
) -> tuple[Dataset, Dataset]:
    """Write a random share of the episodes to ``first`` and the others to ``second``, both in
    order. Raises DataError if the source is damaged, a target exists, or a target would be empty,
    DescriptionError if the seed is invalid."""
    if not 0.0 <= share <= 1.0:
        raise DataError(f"share is {share:g}; give a number between 0 and 1")
    check_seed(seed)
    dataset = read_dataset(source)
    count = round(share * len(dataset.rows))
    if not 0 < count < len(dataset.rows):
        raise DataError(
            f"a share of {share:g} of {counted(len(dataset.rows), 'episode')} leaves one of the "
            "two empty; choose another"
        )
    shuffled = np.random.default_rng(seed).permutation(len(dataset.rows))
    chosen = set(shuffled[:count].tolist())
    drawn = [row for row in dataset.rows if row.episode in chosen]
    others = [row for row in dataset.rows if row.episode not in chosen]
    for target in (first, second):
        refuse_target(target)
    if first.resolve() == second.resolve():
        raise DataError(f"both parts are to go to {first}; give each a separate folder")
    # Before anything is written, which takes long.
    for inner, outer in ((first, second), (second, first)):
        if inner.resolve().is_relative_to(outer.resolve()):
            raise DataError(f"{inner} is to be within {outer}; give each part a separate folder")
    read = EpisodeReader(dataset).read
    part = write_dataset(first, dataset.description, map(read, drawn))
    try:
        return part, write_dataset(second, dataset.description, map(read, others))
    except BaseException:
        # Either both parts appear or none, because the first one alone would look like the whole
        # dataset.
        shutil.rmtree(first, ignore_errors=True)
        raise


def select(source: Path, out: Path, selection: Selection, *, keep: bool = True) -> Dataset:
    """Write the episodes that meet a selection, or with ``keep=False`` all others, to a new
    dataset, in order. Raises DataError if the source is damaged, ``out`` exists, the selection is
    no valid one, or no episode would be left."""
    refuse_target(out)
    dataset = read_dataset(source)
    chosen = selection.choose(dataset.rows)
    rows = [row for row in dataset.rows if (row.episode in chosen) is keep]
    if not rows:
        count = counted(len(dataset.rows), "episode")
        raise DataError(f"none of {count} would be left; choose others")
    return write_dataset(out, dataset.description, map(EpisodeReader(dataset).read, rows))


def salvage(source: Path, out: Path) -> tuple[Dataset, list[str]]:
    """Write the intact episodes of a damaged dataset to a new one; returns it and messages on what
    was lost. Raises DataError if the description is damaged, no episode is intact, or ``out``
    exists."""
    refuse_target(out)
    description = read_description(source)
    lost: list[str] = []
    rows: list[EpisodeRow] = []
    # All files of rows are taken, and not one after the other up to a gap, because a file may be
    # missing.
    row_files = (source / "meta/episodes").glob("chunk-[0-9]*/file-[0-9][0-9][0-9].parquet")
    for path in sorted(row_files):
        try:
            rows += read_rows(path, description)
        except DataError as error:
            lost.append(str(error))
    rows.sort(key=lambda row: row.episode)
    missing = rows[-1].episode + 1 - len(rows) if rows else 0
    if missing > 0:
        lost.append(f"{counted(missing, 'episode')} before the last one: no row in meta/episodes")
    reader = EpisodeReader(Dataset(source, description, tuple(rows)))
    kept: list[Episode] = []
    for row in rows:
        try:
            kept.append(reader.read(row))
        except DataError as error:
            lost.append(f"episode {row.episode}: {error}")
    if not kept:
        raise DataError(f"no episode in {source} is whole; restore it from a copy")
    return write_dataset(out, description, kept), lost


def write_dataset(
    out: Path,
    description: Description,
    episodes: Iterable[Episode],
) -> Dataset:
    """Write a dataset atomically. Raises DataError if ``out`` exists, or there are no episodes."""
    refuse_target(out)
    with atomic_folder(out) as folder:
        dataset = Dataset(folder, description)
        group: list[Episode] = []
        steps = 0
        # Episodes are read one by one, so that only a group of them is in memory.
        for episode in episodes:
            group.append(episode)
            steps += len(episode.columns["index"])
            if steps >= STEPS_PER_FILE:
                dataset = dataset.write_episodes(group)
                group = []
                steps = 0
        if group:
            dataset = dataset.write_episodes(group)
        if not dataset.rows:
            raise DataError(f"there are no episodes to write to {out}; choose others")
        dataset.write_description()
        dataset = dataset.write_rows(0)
        dataset.write_index()
    return replace(dataset, root=out)
