"""Stop flag: set from any thread, it stops or pauses the one that steps the robot."""

from __future__ import annotations

import threading

from bricksrl.errors import StoppedError


class StopFlag:
    """Set by one thread, looked at by the one that steps the robot."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._is_stopped = self._is_paused = False

    @property
    def is_paused(self) -> bool:
        """True if the robot is to hold still."""
        return self._is_paused

    def stop(self) -> None:
        """At once, and until ``go_on``."""
        with self._changed:
            self._is_stopped = True
            self._changed.notify_all()

    def pause(self) -> None:
        """After the step at hand, and until ``go_on``."""
        with self._changed:
            self._is_paused = True

    def go_on(self) -> None:
        """Neither stop nor pause."""
        with self._changed:
            self._is_stopped = self._is_paused = False
            self._changed.notify_all()

    def check(self) -> None:
        """Raises StoppedError where the robot is to stop."""
        if self._is_stopped:
            raise StoppedError("the robot was stopped by hand; call resume() when it may move again")

    def wait(self, timeout_s: float) -> bool:
        """True if the pause is over, or somebody wants the robot to stop; waits for it, for a time."""
        with self._changed:
            return self._changed.wait_for(lambda: self._is_stopped or not self._is_paused, timeout_s)
