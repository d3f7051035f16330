"""Recorder of a run, whose dataset holds each episode of the run once, also where the run was
killed and resumed.

An episode is written into the dataset before the checkpoint that counts it, so that no failure
loses what a real robot did. A run that is killed between the two plays that episode again when it
is resumed. Of a virtual robot the dataset then keeps the first recording and leaves the second one
out; with a real robot the two are different episodes, and both are kept.
"""

import logging
from collections.abc import Sequence
from pathlib import Path

from bricksrl.data.dataset import About
from bricksrl.data.recorder import Recorder
from bricksrl.data.schema import Description
from bricksrl.data.steps import Step

_log = logging.getLogger(__name__)


class RunRecorder(Recorder):
    """Recorder of the episodes of a run. Raises DataError as `Recorder` does.

    Args:
        root: folder of the dataset, created with the first episode.
        counted: whole episodes in it that the run's checkpoint counts.

    Attributes:
        whole: whole episodes in it.
    """

    def __init__(
        self,
        root: Path,
        description: Description,
        counted: int,
    ) -> None:
        super().__init__(root, description)
        whole = [row.about for row in self.rows if row.about.whole]
        self.whole = len(whole)
        if self.whole < counted:
            _log.warning(
                "%s has %d of the %d episodes of this run, the others are gone: what is recorded "
                "from here on is a part of it; stop and put the folder back, if you have a copy",
                root,
                self.whole,
                counted,
            )
        # These are the seeds of what was recorded after the checkpoint. A virtual robot will play
        # the same episodes again.
        uncounted = whole[counted:]
        self._uncounted = {about.seed for about in uncounted if about.hub in ("", "virtual")}

    def write(
        self,
        steps: Sequence[Step],
        about: About,
    ) -> None:
        """Write an episode, as `Recorder.write`, unless it was recorded before the run was
        killed."""
        if about.whole and about.seed in self._uncounted:
            self._uncounted.remove(about.seed)
            return
        before = len(self.rows)
        super().write(steps, about)
        # The base class may leave an episode out, for example one without steps.
        self.whole += sum(row.about.whole for row in self.rows[before:])
