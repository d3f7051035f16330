"""Ctrl-C handling: stop a run at the next safe place."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Self

_POLL_S = 0.2
"""Longest wait in one piece, which Ctrl-C does not break off on Windows."""


class InterruptedEpisodeError(Exception):
    """The run was stopped during an episode, which does not count; internal."""


class StopSignals(ExitStack):
    """While entered, Ctrl-C sets ``stop``, which the run checks after each step. Inside `at_once`
    the first Ctrl-C raises `KeyboardInterrupt`; elsewhere the second, except inside `held_back`.
    Only the main thread receives Ctrl-C; other threads may set ``stop``."""

    def __init__(self, stop: threading.Event) -> None:
        super().__init__()
        self._stop = stop
        self._at_once = False
        self._held_back = False

    @property
    def requested(self) -> bool:
        """Whether the run is to end."""
        return self._stop.is_set()

    def __enter__(self) -> Self:
        # Python refuses handlers in other threads, and runs of the page are stopped by their event.
        if threading.current_thread() is threading.main_thread():
            before = signal.signal(signal.SIGINT, self._on_interrupt)
            self.callback(signal.signal, signal.SIGINT, before)
        return super().__enter__()

    def at_once(self) -> AbstractContextManager[None]:
        """Inside, the first Ctrl-C raises, also one that came just before."""
        if self.requested:
            raise KeyboardInterrupt
        return self._while("_at_once")

    def held_back(self) -> AbstractContextManager[None]:
        """Inside, Ctrl-C never raises: files are being written."""
        return self._while("_held_back")

    @contextmanager
    def _while(self, flag: str) -> Iterator[None]:
        before = getattr(self, flag)
        setattr(self, flag, True)
        try:
            yield
        finally:
            setattr(self, flag, before)

    def wait(self, duration_s: float) -> None:
        """Wait, at most until the run is to end. Raises KeyboardInterrupt if the run is to end."""
        end_s = time.monotonic() + duration_s
        with self.at_once():
            left_s = end_s - time.monotonic()
            # The wait is cut into pieces, because Windows tells of a Ctrl-C only when a wait is
            # over.
            while left_s > 0.0:
                # Another thread has set this, which raises nothing here.
                if self._stop.wait(min(left_s, _POLL_S)):
                    raise KeyboardInterrupt
                left_s = end_s - time.monotonic()

    def _on_interrupt(self, *_: object) -> None:
        # Whoever asks again does not want to wait for a safe place.
        is_second = self._stop.is_set()
        self._stop.set()
        is_wanted_now = is_second or self._at_once
        if is_wanted_now and not self._held_back:
            raise KeyboardInterrupt
