"""Terminal: results on standard output, all other lines and questions on standard error; uninterrupted slow imports."""

from __future__ import annotations

import importlib
import signal
import sys
from types import FrameType
from typing import TYPE_CHECKING

from bricksrl.errors import RunError

if TYPE_CHECKING:
    import numpy as np

_SLOW_IMPORTS = ("torch", "torchrl.data", "torchrl.envs")


class Interrupted(Exception):
    """Ctrl-C or a stop, which ends the command. The message says what is saved; without one, nothing is printed."""


def print_line(line: str = "") -> None:
    """Print a line of results, flushed even into a pipe."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def print_error(message: str) -> None:
    """Print ``error: ...`` as one line, with the line breaks of the message removed."""
    sys.stderr.write(f"error: {' '.join(message.split())}\n")


def print_note(line: str) -> None:
    """Print a line for the user, apart from the results."""
    sys.stderr.write(f"{line}\n")


def is_terminal() -> bool:
    """Whether the user can be asked a question."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def confirm(question: str) -> bool:
    """Ask a question on standard error; True if the answer is yes, False without a terminal."""
    if not is_terminal():
        return False
    sys.stderr.write(f"{question} [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def place_robot(_rng: np.random.Generator | None = None) -> None:
    """Ask the user to put a real robot at the start, and wait for Enter. Raises RunError if standard input has ended."""
    sys.stderr.write("put the robot where an episode starts, then press Enter ")
    sys.stderr.flush()
    if not (sys.stdin and sys.stdin.readline()):
        sys.stderr.write("\n")
        raise RunError("nobody can be asked to place the robot: standard input is not a terminal; start this in one")


def load_learning() -> None:
    """Import torch and TorchRL; a Ctrl-C meanwhile is raised afterwards, because these modules may ignore it."""
    from bricksrl.twin.make_body import check_mujoco

    interrupted = False

    def remember(_signum: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True

    previous_handler = signal.signal(signal.SIGINT, remember)
    try:
        check_mujoco()
        for name in _SLOW_IMPORTS:
            importlib.import_module(name)
            if interrupted:
                break
    finally:
        signal.signal(signal.SIGINT, previous_handler)
    if interrupted:
        raise KeyboardInterrupt
