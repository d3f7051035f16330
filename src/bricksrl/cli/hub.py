"""``bricksrl hub``: the program of a hub, and programs on a virtual hub."""

from __future__ import annotations

import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from bricksrl.cli.console import INTERRUPTED, print_interrupted, print_line
from bricksrl.errors import DescriptionError, UnknownNameError

if TYPE_CHECKING:
    from bricksrl.robots import Robot
    from bricksrl.twin.scene import Scene


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
    """Run a Pybricks program on a hub, virtual or real: its output, its traceback, exit code 1 when it raises.

    Files beside the program that it imports go with it. Standard input is what it reads. Ctrl-C stops it, and its motors.

    Examples:
      bricksrl hub run main.py --robot bench
      bricksrl hub run main.py --robot two-wheeler --time-limit-s 60
      bricksrl hub run main.py --robot walker --video walk.mp4
      bricksrl hub run main.py --hub ble
    """

    file: Annotated[Positional[Path], arg(metavar="FILE")]
    """Pybricks program."""
    robot: Annotated[str, arg(metavar="ROBOT")] = "two-wheeler"
    """Robot that a virtual hub sits in: two-wheeler, walker, robo-arm, or bench, a motor without load on every port. Or an
    environment, such as RunAway-v0: its robot, in its surroundings."""
    hub: Annotated[str, arg(metavar="HUB")] = "virtual"
    """Which hub: virtual, in simulated time, or ble, ble:NAME, ble:ADDRESS, usb, usb:PORT."""
    time_limit_s: Annotated[float | None, arg(metavar="SECONDS")] = None
    """Time after which the program is stopped; that is no error."""
    video: Annotated[Path | None, arg(metavar="FILE")] = None
    """Film the virtual robot into this mp4 file."""

    def execute(self) -> int:
        """Run it."""
        # A Ctrl-C of ours, not one that the program sees: its own KeyboardInterrupt is an error like any other.
        before = signal.signal(signal.SIGINT, _interrupt)
        try:
            return self._run()
        except _Interrupted:
            print_interrupted("the program was stopped; there was nothing to save")
            return INTERRUPTED
        finally:
            signal.signal(signal.SIGINT, before)

    def _run(self) -> int:
        from bricksrl.hub.address import parse_hub
        from bricksrl.hub.own_program import own_program
        from bricksrl.hub.run_program import run_program
        from bricksrl.twin.run import run_file

        address = parse_hub(self.hub)
        out, err, stdin = sys.stdout.buffer, sys.stderr, sys.stdin
        if address.is_virtual:
            read = None if stdin is None or stdin.isatty() else stdin.buffer
            robot, scene = self._robot()
            return run_file(
                self.file,
                robot,
                scene=scene,
                stdout=out,
                stderr=err,
                stdin=read,
                time_limit_s=self.time_limit_s,
                video=self.video,
            )
        if self.video is not None:
            raise DescriptionError("only a virtual robot can be filmed; leave out --video or --hub")
        program = own_program(self.file)
        read = None if stdin is None else stdin.buffer
        transport = address.transport()
        try:
            return run_program(transport, program, stdout=out, stderr=err, stdin=read, time_limit_s=self.time_limit_s)
        finally:
            transport.close()

    def _robot(self) -> tuple[Robot, Scene | None]:
        from bricksrl import robots

        if self.robot in robots.ROBOTS:
            return robots.get(self.robot), None
        from bricksrl.envs import get_task

        try:
            task = get_task(self.robot)
        except UnknownNameError:
            raise UnknownNameError(
                f"there is no robot and no environment '{self.robot}'; choose {', '.join(robots.ROBOTS)}, or see `bricksrl list`"
            ) from None
        return task.robot, task.scene


class _Interrupted(BaseException):
    """Ctrl-C."""


def _interrupt(_signum: int, _frame: FrameType | None) -> None:
    raise _Interrupted
