"""Recorder of episodes, each of which is committed durably to the disk."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

from brickhub.files import is_unused, only_writer, write_durably
from bricksrl.data.episode_index import is_dataset, rows_table, task_instruction, write_index
from bricksrl.data.layout import FileIndex, Layout
from bricksrl.data.parquet import tasks_table, to_parquet
from bricksrl.data.recorded_episode import About, Step, new_episode, write_episodes
from bricksrl.data.repair import recover
from bricksrl.data.schema import Description
from bricksrl.errors import DataError

if TYPE_CHECKING:
    from bricksrl.data.recorded_episode import EpisodeRow


class Recorder:
    """Recorder of episodes into a new or an existing dataset. Raises DataError if the folder holds something else or data of
    another robot, rate or shape, or is being recorded into.

    `add` keeps a step in memory; `commit` writes the episode: its steps and images, then its row, then the index. If the program
    is killed in between, only that episode is lost. Use it as a context manager: leaving commits the unfinished episode as an
    interrupted one.

    Args:
        root: folder of the dataset, created with the first episode.
    """

    def __init__(self, root: Path, description: Description) -> None:
        self.root = root
        self.description = description
        self._layout = Layout(root)
        self._steps: list[Step] = []
        self._rows: list[EpisodeRow] = []
        self._next = FileIndex()
        self._about = About()
        self._lock = contextlib.ExitStack()
        self._is_open = False
        if root.exists() and not root.is_dir():
            raise DataError(f"{root} is a file; choose a folder for the dataset")
        if is_dataset(root):
            self._open()
        elif root.exists() and not is_unused(root):
            raise DataError(f"{root} holds something else than a dataset; choose a new folder")

    def _open(self) -> None:
        """Lock the folder, and continue the dataset in it, which another program may have begun meanwhile, or begin one."""
        with contextlib.ExitStack() as lock:
            lock.enter_context(only_writer(self.root, DataError))
            if is_dataset(self.root):
                index = recover(self.root).index
                differences = index.description.differences(self.description)
                if differences:
                    remedy = "move it away, or choose another folder"
                    raise DataError(f"{self.root} holds other data: {'; '.join(differences)}; {remedy}")
                self._rows = list(index.rows)
                self._next = FileIndex() if index.last_file is None else index.last_file.next()
            else:
                write_durably(self._layout.description, self.description.to_json())
                write_durably(self._layout.tasks, tasks_table(task_instruction(self.description)))
            self._lock, self._is_open = lock.pop_all(), True

    @property
    def episodes(self) -> int:
        """Number of committed episodes, including earlier recordings."""
        return len(self._rows)

    def begin(self, about: About) -> None:
        """Begin an episode; uncommitted steps are discarded."""
        self._about = about
        self._steps.clear()

    def add(self, step: Step) -> None:
        """Add a step to the episode."""
        self._steps.append(step)

    def commit(self, *, success: bool | None = None, whole: bool = True) -> None:
        """Write the episode; when this returns it is on the disk. An episode without steps is not written.

        Args:
            success: success by the task.
            whole: whether the episode ran to its end; if it was interrupted, its last step counts as truncated.
        """
        if not self._steps:
            return
        if not (self._steps[-1].terminated or self._steps[-1].truncated):
            self._steps[-1] = replace(self._steps[-1], truncated=True)
            whole = False
        if not self._is_open:
            self._open()
        row = self._write(replace(self._about, success=success, whole=whole))
        self._rows.append(row)
        self._next = self._next.next()
        self._steps.clear()  # the row is on the disk: even if the index fails, the episode is not written again
        write_index(self._layout, self.description, self._rows)

    def _write(self, about: About) -> EpisodeRow:
        """Write all of the episode except the index."""
        steps, camera = self._steps, self.description.camera
        if camera is not None and (steps[-1].next_image is None or any(step.image is None for step in steps)):
            raise DataError(f"{self.root} is to hold images of {camera}, and a step has none; add them to each")
        start = self._rows[-1].start + self._rows[-1].length if self._rows else 0
        episode = new_episode(steps, about, self.description)
        [row] = write_episodes(self._layout, self.description, [episode], len(self._rows), start, self._next)
        write_durably(self._layout.episodes(self._next), to_parquet(rows_table([row], self.description, self._next)))
        return row

    def close(self) -> None:
        """Commit the unfinished episode as an interrupted one, and release the folder."""
        try:
            self.commit(whole=False)
        finally:
            self._lock.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
