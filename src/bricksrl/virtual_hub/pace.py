"""Real time: simulated time that keeps pace with the clock on the wall, in small pieces."""

from __future__ import annotations

import time
from collections.abc import Callable

PIECE_MS = 15
"""The most that simulated time goes on at once, so that a picture moves evenly and a stop is heard soon."""


class Pace:
    """Lets simulated time wait for the clock on the wall.

    Args:
        clock_s, sleep: the clock, and what waits; others in tests.
    """

    def __init__(self, clock_s: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep) -> None:
        self._clock_s, self._sleep = clock_s, sleep
        self._start_s = clock_s()

    def wall_ms(self) -> float:
        """Time on the wall since the start."""
        return (self._clock_s() - self._start_s) * 1000

    def keep(self, time_ms: float) -> None:
        """Wait where simulated time is ahead."""
        ahead_ms = time_ms - self.wall_ms()
        if ahead_ms > 0:
            self._sleep(ahead_ms / 1000)
