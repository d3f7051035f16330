"""``bricksrl hub``: the program of a hub, and programs on a virtual hub."""

from __future__ import annotations

import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated

from tyro.conf import Positional, arg

from bricksrl.cli.console import INTERRUPTED, print_interrupted, print_line


@dataclass(frozen=True)
class Program:
    """Print the MicroPython program that runs on the hub in an environment.

    Examples:
      bricksrl hub program RunAway-v0
      bricksrl hub program RunAway-v0 > run_away.py
    """

    env: Annotated[Positional[str], arg(metavar="ENV")]
    """Environment; `bricksrl list` shows them."""

    def execute(self) -> int:
        """Print it."""
        from bricksrl.envs import get_task
        from bricksrl.hub.program import generate

        task = get_task(self.env)
        print_line(generate(task.robot, task.interface).source.rstrip("\n"))
        return 0


@dataclass(frozen=True)
class Run:
    """Run a Pybricks program on a virtual hub: its output, its traceback, exit code 1 when it raises.

    Examples:
      bricksrl hub run main.py --robot bench
      bricksrl hub run main.py --robot two-wheeler --time-limit-s 60
    """

    file: Annotated[Positional[Path], arg(metavar="FILE")]
    """Pybricks program."""
    robot: Annotated[str, arg(metavar="ROBOT")] = "two-wheeler"
    """Robot that the hub sits in: two-wheeler, walker, robo-arm, or bench, a motor without load on every port."""
    time_limit_s: Annotated[float | None, arg(metavar="SECONDS")] = None
    """Simulated time after which the program is stopped; that is no error."""

    def execute(self) -> int:
        """Run it."""
        from bricksrl.twin.run import run_file

        # A Ctrl-C of ours, not one that the program sees: its own KeyboardInterrupt is an error like any other.
        before = signal.signal(signal.SIGINT, _interrupt)
        stdin = None if sys.stdin is None or sys.stdin.isatty() else sys.stdin.buffer
        try:
            return run_file(
                self.file, self.robot, stdout=sys.stdout.buffer, stderr=sys.stderr, stdin=stdin, time_limit_s=self.time_limit_s
            )
        except _Interrupted:
            print_interrupted("the program was stopped; there was nothing to save")
            return INTERRUPTED
        finally:
            signal.signal(signal.SIGINT, before)


class _Interrupted(BaseException):
    """Ctrl-C."""


def _interrupt(_signum: int, _frame: FrameType | None) -> None:
    raise _Interrupted
