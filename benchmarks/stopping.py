"""Ends a training run at the end of the first episode that fulfils a condition."""

from __future__ import annotations

import threading
from collections.abc import Callable

from bricksrl.training import Callback, Episode, Progress


class StopWhen(Callback):
    """Give it to a run as its callback, and its ``stop`` as the run's."""

    def __init__(self, condition: Callable[[Episode], bool]) -> None:
        self.stop = threading.Event()
        self._condition = condition

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        if self._condition(episode):
            self.stop.set()
