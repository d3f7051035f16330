"""``bricksrl hub run``: programs on a hub, in a robot or an environment, shown live."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

from brickhub.cli.options import option
from bricksrl.cli.page import LivePageGroup, PageFlag, announce, shown
from bricksrl.errors import DescriptionError
from bricksrl.page.server import PageOptions
from bricktwin.cli import run_command as run

if TYPE_CHECKING:
    from brickhub.virtual.body import Body
    from brickhub.virtual.machine import Machine


@dataclass(frozen=True)
class Run(run.Run):
    """Run a Pybricks program on a hub, virtual or real, and print its output and traceback; exit code 1 if it raises.

    Files that it imports from its folder are included. The program can read standard input. Ctrl-C stops it and its motors. A
    program that imports LEGO's package `legoeducation` runs on this computer, and drives virtual devices of LEGO's kits.

    Without --robot, the virtual hub adapts to the program: its kind is the one that the program imports, and each port has the
    device that the program expects there. With --video or --page, the robot is the two-wheeler by default.

    Examples:
      bricksrl hub run main.py
      bricksrl hub run main.py --reading B=red --reading C=200mm --press left@2.5s
      bricksrl hub run main.py --realtime --panel
      bricksrl hub run main.py --robot two-wheeler --time-limit-s 60
      bricksrl hub run main.py --robot walker --video walk.mp4
      bricksrl hub run main.py --robot walker --page
      bricksrl hub run main.py --robot my_robot.py
      bricksrl hub run main.py --hub ble
    """

    robot: Annotated[str | None, option(metavar="ROBOT")] = None
    """Virtual robot: two-wheeler, walker, robo-arm, cart or bench; RunAway-v0, with its scene, or another environment; a building
    plan, my_robot.ldr; my_robot.py."""
    page: PageFlag = False
    live_page: LivePageGroup = PageOptions()

    def body(self, stack: ExitStack) -> Body | None:
        shown(self.live_page, self.page)
        drawn = replace(self, robot=run.ROBOT_OF_FILMS) if self.page and self.robot is None else self
        return super(Run, drawn).body(stack)

    def attend(self, stack: ExitStack) -> Callable[[Machine], None] | None:
        if not self.page:
            return None
        if self.video is not None or self.realtime:
            raise DescriptionError("the page has a pace of its own; leave out --page, or --video and --realtime")
        from bricksrl.page.program import ProgramPage

        page = stack.enter_context(ProgramPage(self.file.name, self.live_page))
        announce(page.url)
        return page.attend
