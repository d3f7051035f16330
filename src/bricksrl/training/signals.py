"""Ctrl-C as a wish that is fulfilled at the next safe place."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Self


class StopSignals:
    """While entered, Ctrl-C sets ``stop``, which the run looks at after each step.

    Where the run says `at_once`, Ctrl-C raises `KeyboardInterrupt`; so does a second Ctrl-C anywhere, except where the run says
    `held_back`. Only the main thread gets Ctrl-C; in others this does nothing, ``stop`` can be set there by whoever holds it.
    """

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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._restored.close()

    @contextlib.contextmanager
    def at_once(self) -> Iterator[None]:
        """Inside, the first Ctrl-C raises."""
        self._at_once = True
        try:
            yield
        finally:
            self._at_once = False

    @contextlib.contextmanager
    def held_back(self) -> Iterator[None]:
        """Inside, Ctrl-C never raises: files are being written."""
        self._held_back = True
        try:
            yield
        finally:
            self._held_back = False

    def wait(self, duration_s: float) -> None:
        """Wait, for less time where the run is to end meanwhile.

        Raises:
            KeyboardInterrupt: it is.
        """
        with self.at_once():
            if self._stop.wait(duration_s):
                raise KeyboardInterrupt

    def _on_interrupt(self, *_: object) -> None:
        again = self._stop.is_set()
        self._stop.set()
        if (again or self._at_once) and not self._held_back:
            raise KeyboardInterrupt
