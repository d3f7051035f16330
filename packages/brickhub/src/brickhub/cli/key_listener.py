"""Listener for single key presses in a terminal."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from prompt_toolkit.input import Input

ESCAPE_S = 0.05
"""Time after which an escape character is the Esc key and not the start of an escape sequence."""
_END_S = 2.0


class KeyListener:
    """Context that calls ``on_key`` for each key press, in a separate thread. Ctrl-C still interrupts.

    Args:
        on_key: called with the key's name: a letter, or one of prompt_toolkit's names, such as ``"escape"``.
        source: input to read; by default the terminal.
    """

    def __init__(self, on_key: Callable[[str], None], source: Input | None = None) -> None:
        self._on_key, self._source = on_key, source
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bricksrl-keys", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait(_END_S)
        return self

    def __exit__(self, *_: object) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join(_END_S)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._listen())
        finally:
            self._ready.set()
            self._loop.close()

    async def _listen(self) -> None:
        from prompt_toolkit.input import create_input

        source = self._source or create_input()
        flush: asyncio.TimerHandle | None = None

        def read(*, is_late: bool = False) -> None:
            nonlocal flush
            if flush is not None:
                flush.cancel()
            for press in source.flush_keys() if is_late else source.read_keys():
                key = str(getattr(press.key, "value", press.key))
                if key == "c-c":  # in raw mode the terminal sends no signal for it
                    interrupt_main()
                else:
                    self._on_key(key)
            flush = None if is_late else self._loop.call_later(ESCAPE_S, lambda: read(is_late=True))
            if source.closed:
                self._end.set()

        try:
            with source.raw_mode(), source.attach(read):
                self._ready.set()
                await self._end.wait()
        finally:
            if flush is not None:
                flush.cancel()


def interrupt_main() -> None:
    """Send Ctrl-C to the main thread, even while it is blocked."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        import _thread

        _thread.interrupt_main()


def can_listen() -> bool:
    """True if keys can be read: standard input is a terminal and we run in its foreground, where reading does not suspend us."""
    if sys.stdin is None or not sys.stdin.isatty():
        return False
    if not hasattr(os, "tcgetpgrp"):
        return True
    try:
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return False
