"""Functions that are entered, each noted once a test, by number.

`benchmarks.entries` compiles the modules of a tree so that each function begins with a look into
``seen``. It stands alone, as any process that imports such a module imports it too.
"""

from __future__ import annotations

import os

FILE = "BRICKS_TESTS_ENTERED"
"""Environment variable with the file for the numbers; what a test starts inherits it."""
FOLDER = "BRICKS_TESTS_ENTRIES"
"""Environment variable with the folder of a run's files."""
seen = bytearray(1 << 16)
"""Whether a function was noted, by its number."""

# Tests replace what modules have.
_environment, _open, _write, _close = os.environ, os.open, os.write, os.close
_APPENDS = os.O_WRONLY | os.O_CREAT | os.O_APPEND


def note(number: int) -> None:
    """Note a function."""
    seen[number] = 1
    path = _environment.get(FILE)
    if not path:
        return
    try:
        file = _open(path, _APPENDS, 0o644)
        _write(file, b"%d\n" % number)
        _close(file)
    except OSError:  # a test that lets no file be opened
        return


def forget() -> None:
    """Note all functions again."""
    seen[:] = bytes(len(seen))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=forget)
