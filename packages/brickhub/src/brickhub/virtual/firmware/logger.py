"""Log of the control loop (``pbio/logger.c``, v4)."""

from __future__ import annotations


class Logger:
    """Recorded ``rows`` of integers, each beginning with the ms since the start."""

    __slots__ = ("_capacity", "_down_sample", "_skipped", "_start_ms", "is_active", "rows")

    def __init__(self) -> None:
        self.is_active = False
        self.rows: list[tuple[int, ...]] = []

    def start(self, time_ms: int, capacity: int, down_sample: int) -> None:
        """Start anew: record one of ``down_sample`` rows, up to ``capacity`` of them."""
        self.rows = []
        self._start_ms, self._capacity, self._down_sample, self._skipped = time_ms, capacity, down_sample, 0
        self.is_active = True

    def stop(self) -> None:
        """Stop recording."""
        self.is_active = False

    def add(self, time_ms: int, *values: int) -> None:
        """Record a row of the control loop."""
        self._skipped += 1
        if self._skipped < self._down_sample:
            return
        self._skipped = 0
        if len(self.rows) == self._capacity:
            self.is_active = False
        else:
            self.rows.append((time_ms - self._start_ms, *values))
