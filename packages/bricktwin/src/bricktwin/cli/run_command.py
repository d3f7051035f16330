"""``bricktwin run``: programs on a hub whose robot has a body, and films of it."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from brickhub.cli import run_command as run
from brickhub.cli.options import option

if TYPE_CHECKING:
    from brickhub.virtual.body import Body

ROBOT_OF_FILMS = "two-wheeler"


@dataclass(frozen=True)
class Run(run.Run):
    """Run a Pybricks program on a hub, virtual or real, and print its output and traceback; exit code 1 if it raises.

    Files that it imports from its folder are included. The program can read standard input. Ctrl-C stops it and its motors. A
    program that imports LEGO's package `legoeducation` runs on this computer, and drives virtual devices of LEGO's kits.

    Without --robot, the virtual hub adapts to the program: its kind is the one that the program imports, and each port has the
    device that the program expects there. With --video, the robot is the two-wheeler by default.

    Examples:
      bricktwin run main.py --robot walker --video walk.mp4
      bricktwin run main.py --robot my_robot.ldr --video drive.mp4
      bricktwin run main.py --robot my_robot.py --time-limit-s 60
      bricktwin run main.py --reading B=red --reading C=200mm --press left@2.5s
      bricktwin run main.py --hub ble
      bricktwin run lego_program.py --robot cart --video cart.mp4
    """

    robot: Annotated[str | None, option(metavar="ROBOT")] = None
    """Virtual robot: two-wheeler, walker, robo-arm, cart or bench; a building plan, my_robot.ldr; my_robot.py."""
    video: Annotated[Path | None, option(metavar="FILE")] = None
    """Film the virtual robot into this mp4 file."""

    def body(self, stack: ExitStack) -> Body | None:
        if self.video is None:
            return super().body(stack)
        from brickhub.target import find
        from bricktwin.twin.render.video import filmed

        film = filmed(find(self.robot or ROBOT_OF_FILMS).make_body(), self.video)
        return self.faulty(stack.enter_context(film))
