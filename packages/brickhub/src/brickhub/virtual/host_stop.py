"""End of a running program that comes from its host: Ctrl-C, a time limit, output that cannot be written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class HostStop(BaseException):
    """Ends a program past its exception handlers and reaches the caller; derive the host's own ends from it. Whatever else is
    raised while a program runs is an error of the program, but for a failing scene and a film that cannot be written."""


class _Interrupted(HostStop):
    """Ctrl-C by the user."""


def _interrupt(_signum: int, _frame: FrameType | None) -> None:
    raise _Interrupted


@contextmanager
def interruptible() -> Iterator[None]:
    """Context in which Ctrl-C ends a program past its handlers, to which a KeyboardInterrupt is an ordinary error; that is raised
    at the end of the context. No effect in other threads than the main one, which get no signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous_handler = signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    except _Interrupted:
        raise KeyboardInterrupt from None
    finally:
        signal.signal(signal.SIGINT, previous_handler)
