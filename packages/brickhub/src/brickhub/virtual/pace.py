"""Pace: simulated time in step with real time."""

from __future__ import annotations

import time
from collections.abc import Callable

MAX_STEP_MS = 15
"""Maximum step of simulated time, for smooth pictures and a quick stop."""


class Pace:
    """Delays simulated time to real time. ``clock_s, sleep``: replaced in tests."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep) -> None:
        self._clock_s, self._sleep = clock_s, sleep
        self._start_s = clock_s()

    def wall_ms(self) -> float:
        """Real time since the start."""
        return (self._clock_s() - self._start_s) * 1000

    def keep(self, time_ms: float) -> None:
        """Wait if simulated time is ahead."""
        ahead_ms = time_ms - self.wall_ms()
        if ahead_ms > 0:
            self._sleep(ahead_ms / 1000)
