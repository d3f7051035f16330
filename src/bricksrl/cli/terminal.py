"""The terminal: results on standard output, all else on standard error, a line each; questions; slow imports in one piece."""

from __future__ import annotations

import importlib
import signal
import sys
from types import FrameType
from typing import TYPE_CHECKING

from bricksrl.errors import RunError

if TYPE_CHECKING:
    import numpy as np

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""
_HEAVY = ("torch", "torchrl.data", "torchrl.envs")


def print_line(line: str = "") -> None:
    """A line of results, at once even into a pipe."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def print_error(message: str) -> None:
    """``error: ...`` in one line, whatever the message holds."""
    sys.stderr.write(f"error: {' '.join(message.split())}\n")


def print_note(line: str) -> None:
    """A line for the human, beside the results."""
    sys.stderr.write(f"{line}\n")


def print_interrupted(saved: str) -> None:
    """A line on what Ctrl-C left."""
    sys.stderr.write(f"interrupted: {saved}\n")


def is_terminal() -> bool:
    """True if somebody can answer."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def yes(question: str) -> bool:
    """True if the answer is yes; no where nobody can answer. Asks on standard error, results stay clean."""
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


def load_learning() -> None:
    """Import what all learning needs; a Ctrl-C meanwhile counts when it is done, because these modules may swallow it."""
    from bricksrl.twin.make_body import check_mujoco

    interrupted = False

    def remember(_signum: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True

    before = signal.signal(signal.SIGINT, remember)
    try:
        check_mujoco()
        for name in _HEAVY:
            importlib.import_module(name)
            if interrupted:
                break
    finally:
        signal.signal(signal.SIGINT, before)
    if interrupted:
        raise KeyboardInterrupt
