"""Listener for single key presses in a terminal."""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prompt_toolkit.input import Input

ESCAPE_S = 0.05
"""Time after which an escape character is the Esc key and not the start of an escape sequence."""
_POLL_S = 0.02
_END_S = 2.0
"""Longest wait for the thread to begin, and to end."""


@contextmanager
def keys_heard(on_key: Callable[[str], None], source: Input | None = None) -> Iterator[None]:
    """Call ``on_key`` for each key press inside this context, in a separate thread. Ctrl-C still
    interrupts.

    Args:
        on_key: called with the key's name: a letter, or one of prompt_toolkit's names, such as
            ``"escape"``.
        source: input to read; by default the terminal.
    """
    from prompt_toolkit.input import create_input

    end = threading.Event()
    ready = threading.Event()

    def listen(source: Input) -> None:
        last_s = 0.0
        with source.raw_mode():
            ready.set()
            # Keys are polled, because a blocking read could not be ended from outside.
            while not end.wait(_POLL_S) and not source.closed:
                presses = source.read_keys()
                now_s = time.monotonic()
                if presses:
                    last_s = now_s
                elif now_s - last_s > ESCAPE_S:
                    # An escape character is held back until something follows, so after a while it
                    # is flushed.
                    presses = source.flush_keys()
                for press in presses:
                    key = str(getattr(press.key, "value", press.key))
                    # In raw mode the terminal sends no signal for Ctrl-C.
                    if key == "c-c":
                        interrupt_main()
                    else:
                        on_key(key)

    thread = threading.Thread(
        target=listen,
        args=(source or create_input(),),
        name="bricksrl-keys",
        daemon=True,
    )
    thread.start()
    # Once the listener is ready, keys are neither echoed nor lost to a line that the terminal
    # collects.
    ready.wait(_END_S)
    try:
        yield
    finally:
        end.set()
        thread.join(_END_S)


def interrupt_main() -> None:
    """Send Ctrl-C to the main thread, even while it is blocked."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


def can_listen() -> bool:
    """True if keys can be read: standard input is a terminal and we run in its foreground, where
    reading does not suspend us."""
    if sys.stdin is None or not sys.stdin.isatty():
        return False
    if not hasattr(os, "tcgetpgrp"):
        return True
    # The shell would stop a background job that reads from the terminal.
    try:
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return False
