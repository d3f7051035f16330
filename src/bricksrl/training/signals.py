"""Ctrl-C handling: stop a run at the next safe place."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Self


class StopSignals:
    """While entered, Ctrl-C sets ``stop``, which the run checks after each step. Inside `at_once` the first Ctrl-C raises
    `KeyboardInterrupt`; elsewhere the second, except inside `held_back`. Only the main thread receives Ctrl-C; other threads may
    set ``stop``."""

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop
        self._at_once = self._held_back = False
        self._restored = contextlib.ExitStack()

    @property
    def requested(self) -> bool:
        """Whether the run is to end."""
        return self._stop.is_set()

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._restored.callback(signal.signal, signal.SIGINT, signal.signal(signal.SIGINT, self._on_interrupt))
        return self

    def __exit__(self, exc_type: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._restored.close()

    @contextlib.contextmanager
    def at_once(self) -> Iterator[None]:
        """Inside, the first Ctrl-C raises."""
        outer, self._at_once = self._at_once, True
        try:
            yield
        finally:
            self._at_once = outer

    @contextlib.contextmanager
    def held_back(self) -> Iterator[None]:
        """Inside, Ctrl-C never raises: files are being written."""
        self._held_back = True
        try:
            yield
        finally:
            self._held_back = False

    def wait(self, duration_s: float) -> None:
        """Wait, at most until the run is to end. Raises KeyboardInterrupt if the run is to end."""
        with self.at_once():
            if self._stop.wait(duration_s):
                raise KeyboardInterrupt

    def _on_interrupt(self, *_: object) -> None:
        again = self._stop.is_set()
        self._stop.set()
        if (again or self._at_once) and not self._held_back:
            raise KeyboardInterrupt
