"""Terminal of a command that learns: the request to place a robot; uninterrupted slow imports."""

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


def place_robot(_rng: np.random.Generator | None = None) -> None:
    """Ask the user to put a real robot at the start, and wait for Enter. Raises RunError if standard input has ended."""
    sys.stderr.write("put the robot where an episode starts, then press Enter ")
    sys.stderr.flush()
    if not (sys.stdin and sys.stdin.readline()):
        sys.stderr.write("\n")
        raise RunError("nobody can be asked to place the robot: standard input is not a terminal; start this in one")


def load_learning() -> None:
    """Import torch and TorchRL; a Ctrl-C meanwhile is raised afterwards, because these modules may ignore it."""
    from bricktwin.twin.make_body import check_mujoco

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
