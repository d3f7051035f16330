"""Stop flag: set from any thread, it stops or pauses the thread that steps the robot."""

from __future__ import annotations

import threading

from bricksrl.errors import StoppedError


class StopFlag:
    """Flag for stop and pause, set from any thread and checked by the one that steps the robot."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._is_stopped = self._is_paused = False

    @property
    def is_paused(self) -> bool:
        """True while a pause is requested."""
        return self._is_paused

    def stop(self) -> None:
        """Stop at once, until ``go_on``."""
        with self._changed:
            self._is_stopped = True
            self._changed.notify_all()

    def pause(self) -> None:
        """Pause after the current step, until ``go_on``."""
        with self._changed:
            self._is_paused = True

    def go_on(self) -> None:
        """Clear stop and pause."""
        with self._changed:
            self._is_stopped = self._is_paused = False
            self._changed.notify_all()

    def check(self) -> None:
        """Raise StoppedError if a stop is requested."""
        if self._is_stopped:
            raise StoppedError("the robot was stopped by hand; call resume() when it may move again")

    def wait(self, timeout_s: float) -> bool:
        """Wait up to ``timeout_s`` for the end of the pause or for a stop; True if either happened."""
        with self._changed:
            return self._changed.wait_for(lambda: self._is_stopped or not self._is_paused, timeout_s)
