"""Callback that ends a training run after the first episode that meets a condition."""

from __future__ import annotations

import threading
from collections.abc import Callable

from bricksrl.training import Callback, Episode, Progress


class StopWhen(Callback):
    """Callback of a run; pass its ``stop`` to the run too."""

    def __init__(self, condition: Callable[[Episode], bool]) -> None:
        self.stop = threading.Event()
        self._condition = condition

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        if self._condition(episode):
            self.stop.set()
