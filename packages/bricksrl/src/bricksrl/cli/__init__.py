"""The command ``bricksrl``.

torch and MuJoCo are imported only by commands that need them, so that help is printed at once.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence


_MIN_COLUMNS = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 1 for a hub program that failed, 2 for an error, 130 for Ctrl-C."""
    os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # hide TorchRL's notes about its buffers
    if sys.flags.optimize > 1:  # TorchRL and the help texts need docstrings
        sys.stderr.write("error: Python leaves docstrings out (-OO); unset PYTHONOPTIMIZE or set it to 1\n")
        return 2
    columns = os.environ.get("COLUMNS", "")
    if columns.isdecimal() and int(columns) < _MIN_COLUMNS:
        del os.environ["COLUMNS"]  # tables this narrow are unreadable
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # for terminals that lack a character
    try:
        from brickhub.cli.app import run

        return run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        sys.stderr.write("interrupted: nothing was saved\n")
        return 130
    finally:  # another Ctrl-C would show a traceback of what libraries do at the end of the process
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
