"""Questions to whoever sits at the terminal."""

from __future__ import annotations

import sys


def is_terminal() -> bool:
    """Whether somebody can answer."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def yes(question: str) -> bool:
    """Whether the answer is yes; no where nobody can answer. Asks on standard error, results stay clean."""
    if not is_terminal():
        return False
    sys.stderr.write(f"{question} [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")
