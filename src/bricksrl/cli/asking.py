"""Questions to whoever sits at the terminal."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from bricksrl.errors import RunError

if TYPE_CHECKING:
    import numpy as np


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


def place_robot(_rng: np.random.Generator | None = None) -> None:
    """Ask the owner of a real robot to put it where an episode starts, and wait for it.

    Raises:
        RunError: nobody is there to ask.
    """
    sys.stderr.write("put the robot where an episode starts, then press Enter ")
    sys.stderr.flush()
    if not (sys.stdin and sys.stdin.readline()):
        sys.stderr.write("\n")
        raise RunError("nobody can be asked to place the robot: standard input is no terminal; start this in one")
