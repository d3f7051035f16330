"""Listener for single key presses in a terminal."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from prompt_toolkit.input import Input

ESCAPE_S = 0.05
"""Time after which an escape character is the Esc key and not the start of an escape sequence."""
_POLL_S, _END_S = 0.02, 2.0


class KeyListener:
    """Context that calls ``on_key`` for each key press, in a separate thread. Ctrl-C still interrupts.

    Args:
        on_key: called with the key's name: a letter, or one of prompt_toolkit's names, such as ``"escape"``.
        source: input to read; by default the terminal.
    """

    def __init__(self, on_key: Callable[[str], None], source: Input | None = None) -> None:
        self._on_key, self._source = on_key, source
        self._end, self._ready = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="bricksrl-keys", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait(_END_S)
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join(_END_S)

    def _run(self) -> None:
        from prompt_toolkit.input import create_input

        source, last_s = self._source or create_input(), 0.0
        with source.raw_mode():
            self._ready.set()
            while not self._end.wait(_POLL_S) and not source.closed:
                presses, now_s = source.read_keys(), time.monotonic()
                last_s = now_s if presses else last_s
                for press in presses or (source.flush_keys() if now_s - last_s > ESCAPE_S else ()):
                    key = str(getattr(press.key, "value", press.key))
                    if key == "c-c":  # in raw mode the terminal sends no signal for it
                        interrupt_main()
                    else:
                        self._on_key(key)


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
