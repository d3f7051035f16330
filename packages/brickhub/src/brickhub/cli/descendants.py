"""Processes that a process has started, and those that these have started.

They end by themselves when it is gone, which a frozen one (SIGSTOP) cannot.
"""

import contextlib
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

_PROC = Path("/proc")
_PS = ("ps", "-A", "-o", "pid=,ppid=,state=")
"""Command that lists processes where there is no ``/proc``, as on macOS."""
_FROZEN = "Tt"
"""States of a process that is stopped by a signal, or by a debugger."""
_PS_S = 1.0


def kill_frozen(pid: int) -> None:
    """Kill the frozen ones among the descendants of a process. On Windows nothing freezes one."""
    if os.name != "posix":
        return
    table = {child: (parent, state) for child, parent, state in _processes()}
    for child, (_, state) in table.items():
        if state in _FROZEN and pid in _ancestors(child, table):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(child, signal.SIGKILL)


def _ancestors(child: int, table: dict[int, tuple[int, str]]) -> Iterator[int]:
    # The number of an ended process may be given to a new one while the table is read, which could
    # make a cycle, so the number of steps is limited.
    for _ in range(len(table)):
        if child not in table:
            return
        child = table[child][0]
        yield child


def _processes() -> Iterator[tuple[int, int, str]]:
    """Number, parent's number and state of each process."""
    if not (_PROC / "self" / "stat").exists():
        yield from _listed()
        return
    for path in _PROC.glob("[0-9]*/stat"):
        # A process that has ended in the meantime has no file any more.
        with contextlib.suppress(OSError):
            text = path.read_text(errors="replace")
            # A process's name stands in parentheses and may contain some itself, so the last one
            # counts.
            _, _, after_name = text.rpartition(")")
            state, parent = after_name.split()[:2]
            yield int(path.parent.name), int(parent), state


def _listed() -> Iterator[tuple[int, int, str]]:
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(  # noqa: S603  a command of the system
            _PS,
            capture_output=True,
            text=True,
            timeout=_PS_S,
            check=False,
        )
        for line in done.stdout.splitlines():
            pid, parent, state = line.split()
            yield int(pid), int(parent), state[0]
