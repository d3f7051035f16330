"""Repair of a dataset whose writer was killed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from brickhub.files import remove_unfinished, write_durably
from bricksrl.data.episode_index import (
    Index,
    check_order,
    read_all_rows,
    read_description,
    read_episode_count,
    task_instruction,
    unfinished_files,
    write_index,
)
from bricksrl.data.layout import Layout
from bricksrl.data.parquet import has_task, tasks_table
from bricksrl.errors import DataError


@dataclass(frozen=True)
class Recovery:
    """Result of a repair.

    Attributes:
        adopted: number of intact episodes that were added to the index.
        unfinished: number of unfinished files that were removed.
    """

    index: Index
    adopted: int
    unfinished: int


def recover(root: Path, *, rebuild: bool = False) -> Recovery:
    """Update the index from the files on the disk. The caller must hold the write lock. Raises DataError if the dataset has
    damage that a killed writer cannot cause.

    A row is written after all other files of its episode, so a row that the index does not count is a complete episode.

    Args:
        rebuild: rebuild a damaged index too.
    """
    layout = Layout(root)
    description = read_description(layout)
    committed = 0
    if layout.info.exists():
        try:
            committed = read_episode_count(layout, description)
        except DataError:
            if not rebuild:
                raise
    unfinished = remove_unfinished(root)
    rows, last = read_all_rows(layout, description)
    if len(rows) < committed:
        raise DataError(f"{root} has lost rows: {len(rows)} of {committed} episodes are left; restore it from a copy")
    check_order(rows, len(rows), layout)
    for path in unfinished_files(layout, description, last):
        path.unlink()
        unfinished += 1
    if not layout.tasks.exists() or (rebuild and not has_task(layout.tasks, task_instruction(description))):
        write_durably(layout.tasks, tasks_table(task_instruction(description)))
    if rows and (rebuild or len(rows) > committed or not layout.stats.exists()):
        write_index(layout, description, rows)
    return Recovery(Index(layout, description, tuple(rows), last), len(rows) - committed, unfinished)
