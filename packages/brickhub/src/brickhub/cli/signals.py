"""Signals that end a command, and its first moments, in which there is nothing to save yet.

Importing this takes no time, as what ends before it is imported prints a traceback.
"""

import contextlib
import os
import signal

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

INTERRUPTED = 130
"""Exit code of a command that was ended, as in shells after Ctrl-C."""
_NAMES = ("SIGTERM", "SIGHUP", "SIGBREAK")


def end_signals() -> list[signal.Signals]:
    """Signals that end a command, except Ctrl-C: SIGTERM, SIGHUP (a closed terminal) and, on
    Windows, Ctrl-Break. Those that the caller has made us ignore, as ``nohup`` does, are left
    out."""
    known = [signal.Signals[name] for name in _NAMES if hasattr(signal, name)]
    return [number for number in known if signal.getsignal(number) is not signal.SIG_IGN]


def ending_at_once() -> "dict[signal.Signals, Any]":
    """From here on, Ctrl-C and the signals of `end_signals` end the process at once, in one line.

    It is for the time in which modules are imported: there is nothing to save yet, and no robot;
    and an exception there would be a traceback, or be ignored by a library. Returns the handlers
    before. Needs the main thread.
    """
    numbers = end_signals()
    # A shell lets its background jobs ignore Ctrl-C, which is meant for the job in front, so that
    # stays.
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        numbers.append(signal.SIGINT)
    return {number: signal.signal(number, _end) for number in numbers}


def _end(_number: int, _frame: "Any") -> None:
    # A stream may be in the middle of a line, so this writes past it. The terminal may also be
    # closed.
    with contextlib.suppress(OSError):
        os.write(2, b"interrupted: nothing was saved\n")
    os._exit(INTERRUPTED)
