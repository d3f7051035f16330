"""Recorder of episodes, each of which is committed durably to the disk."""

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from brickhub.files import is_unused, only_writer
from bricksrl.data.dataset import About, Dataset, EpisodeRow, is_dataset, refuse_within_dataset
from bricksrl.data.integrity import recover
from bricksrl.data.schema import Description
from bricksrl.data.steps import Step, new_episode
from bricksrl.errors import DataError


class Recorder(contextlib.AbstractContextManager["Recorder"]):
    """Recorder of episodes into a new or an existing dataset. Raises DataError if the folder holds
    something else or data of another robot, rate or shape, or is being recorded into.

    `write` writes an episode: its steps and images, then its row, then the index. If the program is
    killed in between, only that episode is lost. Use it as a context manager: leaving releases the
    folder.

    Args:
        root: folder of the dataset, created with the first episode.
    """

    def __init__(
        self,
        root: Path,
        description: Description,
    ) -> None:
        self.root = root
        self.description = description
        self._dataset = Dataset(root, description)
        self._lock: contextlib.ExitStack | None = None
        self._is_closed = False
        refuse_within_dataset(root)
        if root.exists() and not root.is_dir():
            raise DataError(f"{root} is a file; choose a folder for the dataset")
        if is_dataset(root):
            self._open()
        elif root.exists() and not is_unused(root):
            raise DataError(f"{root} holds something else than a dataset; choose a new folder")

    def _open(self) -> None:
        """Lock the folder, and continue the dataset in it, which another program may have begun
        meanwhile, or begin one."""
        with contextlib.ExitStack() as lock:
            lock.enter_context(only_writer(self.root, DataError))
            if is_dataset(self.root):
                self._dataset, *_ = recover(self.root)
                differences = self._dataset.description.differences(self.description)
                if differences:
                    remedy = "move it away, or choose another folder"
                    raise DataError(
                        f"{self.root} holds other data: {'; '.join(differences)}; {remedy}"
                    )
            else:
                self._dataset.write_description()
            self._lock = lock.pop_all()

    @property
    def rows(self) -> tuple[EpisodeRow, ...]:
        """Rows of the committed episodes, including those of earlier recordings."""
        return self._dataset.rows

    def write(
        self,
        steps: Sequence[Step],
        about: About,
    ) -> None:
        """Write an episode; when this returns it is on the disk. An episode without steps is not
        written; the last step of one that has no end counts as truncated. Raises DataError after
        `close`: another program may record into the folder by now."""
        if self._is_closed:
            raise DataError(
                f"the recorder of {self.root} is closed; make another one, which goes on with "
                "that dataset"
            )
        if not steps:
            return
        # An interrupted episode gets an end, because it would otherwise run into the next one.
        if not (steps[-1].terminated or steps[-1].truncated):
            steps = [*steps[:-1], replace(steps[-1], truncated=True)]
            about = replace(about, whole=False)
        camera = self.description.camera
        lacks_image = steps[-1].next_image is None or any(step.image is None for step in steps)
        if camera is not None and lacks_image:
            raise DataError(
                f"{self.root} is to hold images of {camera}, and a step has none; add them to each"
            )
        # The folder is made with the first episode, so that a recording that records nothing leaves
        # none.
        if self._lock is None:
            self._open()
        episode = new_episode(steps, about, self.description)
        first_new = len(self.rows)
        # The order matters: a row promises that its steps are there, and the index that its row is.
        dataset = self._dataset.write_episodes([episode])
        self._dataset = dataset.write_rows(first_new)
        self._dataset.write_index()

    def close(self) -> None:
        """Release the folder. May be called twice."""
        self._is_closed = True
        if self._lock is not None:
            self._lock.close()

    def __exit__(self, *_: object) -> None:
        self.close()
