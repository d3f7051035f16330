"""The command ``brickhub``, and the start of every command line of this project.

Modules of commands are imported when they are needed, so that help is printed at once.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys

from brickhub.cli.signals import INTERRUPTED, ending_at_once

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import NoReturn

    from brickhub.cli.app import ParsedCommand


_MIN_COLUMNS = 20
"""Width below which a terminal's claim is ignored."""
_COLLECT_EVERY = 50_000
"""New objects until Python looks for unreachable ones among them."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command of ``brickhub`` and return its exit code, as `start`."""
    return start("brickhub.cli.command_table", arguments)


def collect_rarely() -> None:
    """Let Python's garbage collector work less often in this process: what imports define stays,
    and to look through it again and again takes a quarter of the time of importing torch and
    TorchRL."""
    import gc

    gc.set_threshold(_COLLECT_EVERY)


def start(table: str, arguments: Sequence[str] | None = None) -> int:
    """Run one command of a module's ``LINE`` in a terminal of any kind, and return its exit code:
    0, 1 for a hub program that failed, 2 for an error, 130 for Ctrl-C. ``arguments`` are those of
    the process by default."""
    # This comes before any other import, so that a Ctrl-C in the first moments prints no traceback.
    before = ending_at_once() if arguments is None else {}
    # The help texts are docstrings, which -OO leaves out.
    if sys.flags.optimize > 1:
        sys.stderr.write(
            "error: Python leaves docstrings out (-OO); unset PYTHONOPTIMIZE or set it to 1\n"
        )
        return 2
    collect_rarely()
    _prepare_terminal()
    # A program that calls this has signals and an end of its own.
    if arguments is not None:
        return _run(table, arguments, None)
    # Processes that are started from here must not import from the present folder by accident.
    os.environ["PYTHONSAFEPATH"] = "1"
    from brickhub.cli.ending import ended_in_time
    from brickhub.options import SavesNothing

    with ended_in_time() as end:
        # This is done once more, because entering the context has set handlers and the command is
        # imported only now.
        at_once = ending_at_once()

        def begin(command: ParsedCommand) -> None:
            """Let the command end in order from here on, and save."""
            end.saves = not isinstance(command, SavesNothing)
            for number in at_once:
                signal.signal(number, signal.default_int_handler)

        try:
            code = _run(table, sys.argv[1:], begin)
            end.is_said.set()
            # A Ctrl-C after the last line comes too late to end anything.
            if signal.SIGINT in at_once:
                signal.signal(signal.SIGINT, signal.SIG_IGN)
        except OSError:
            if not end.is_asked.is_set():
                raise
            # The terminal is closed, so nobody reads what could be said.
            code = INTERRUPTED
        if code == INTERRUPTED or end.is_asked.is_set():
            _leave(code)
    for number, handler in before.items():
        if number != signal.SIGINT:
            signal.signal(number, handler)
    return code


def _prepare_terminal() -> None:
    """Make the terminal one that takes all that we print."""
    # Narrower tables are unreadable, so such a width is ignored.
    columns = os.environ.get("COLUMNS", "")
    if columns.isdecimal() and int(columns) < _MIN_COLUMNS:
        del os.environ["COLUMNS"]
    # Python puts None in place of a stream that the caller has closed.
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            setattr(sys, name, os.fdopen(nowhere, "w"))
    # Some terminals lack a character that we print. Streams that tests put here cannot be changed.
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _run(
    table: str,
    arguments: Sequence[str],
    begin: Callable[[ParsedCommand], None] | None,
) -> int:
    """Run one command; a Ctrl-C that it does not handle ends it. ``begin`` is called when all that
    it needs to begin is imported."""
    import atexit
    import importlib

    try:
        from brickhub.cli import app

        return app.run(importlib.import_module(table).LINE, arguments, begin)
    except KeyboardInterrupt:
        # Writing fails if the terminal is closed.
        with contextlib.suppress(OSError):
            sys.stderr.write("interrupted: nothing was saved\n")
        return INTERRUPTED
    finally:
        # Libraries work at the end of the process, where another Ctrl-C would show a traceback.
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)


def _leave(code: int) -> NoReturn:
    """End this process without the seconds in which the interpreter takes torch apart and waits for
    threads."""
    import atexit

    # An orderly end would call these too: they close links, and so stop motors.
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)
