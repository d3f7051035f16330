"""``bricksrl hub run``: programs on a hub, in a robot or an environment, shown live."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, BinaryIO, ClassVar, TextIO, cast

from tyro.conf import UseAppendAction

from brickhub.options import Existing, option
from brickhub.user_files import check_there
from bricksrl.cli.page import LivePageGroup, PageFlag, announce, has_screen, shown
from bricksrl.errors import DescriptionError
from bricksrl.page.server import PageOptions
from bricktwin.cli import run_command as run

if TYPE_CHECKING:
    from brickhub.virtual.body import Body
    from brickhub.virtual.machine import Machine
    from bricksrl.page.program import ProgramPage

_OPENING_S = 15.0
"""Time for a browser to open, after which the page of a program that has ended closes if nobody
looks at it."""


@dataclass(frozen=True)
class Run(run.Run):
    """Run a Pybricks program on a hub, virtual or real, and print its output and traceback; exit
    code 1 if it raises.

    Files that it imports from its folder are included. The program can read standard input. Ctrl-C
    stops it and its motors. A program that imports LEGO's package `legoeducation` runs on this
    computer, and drives virtual devices of LEGO's kits.

    Without --robot, the virtual hub adapts to the program: its kind is the one that the program
    imports, and each port has the device that the program expects there. With --video, --scene or
    --page, the robot is the scout by default, a 2Wheeler with a color sensor.

    Examples:
      bricksrl hub run main.py
      bricksrl hub run main.py --reading B=red --reading C=200mm --press left@2.5s
      bricksrl hub run main.py --realtime --panel
      bricksrl hub run main.py --robot two-wheeler --time-limit-s 60
      bricksrl hub run main.py --robot walker --video walk.mp4
      bricksrl hub run main.py --robot walker --page
      bricksrl hub run main.py --scene maze --page
      bricksrl hub run left.py right.py --robot two-wheeler --robot scout --page
      bricksrl hub run main.py --robot my_robot.py
      bricksrl hub run main.py --hub ble
    """

    robot: Annotated[
        UseAppendAction[tuple[str, ...]], option(metavar="ROBOT"), Existing(check_there)
    ] = ()
    """Virtual robot: two-wheeler, scout, ev3-driver, walker, robo-arm, cart or bench; RunAway-v0,
    with its scene, or another environment; a building plan, my_robot.ldr; my_robot.py. With several
    programs once for each, in their order: they share one world."""
    page: PageFlag = False
    live_page: LivePageGroup = PageOptions()

    of_a_room: ClassVar[tuple[str, ...]] = (
        *run.Run.of_a_room,
        "--page",
        "--page-host",
        "--page-port",
    )

    def body(self, stack: ExitStack) -> Body | None:
        shown(self.live_page, self.page)
        drawn = self
        # A page without a robot has nothing to draw.
        if self.page and not self.robot:
            drawn = replace(self, robot=(run.ROBOT_OF_SCENES,))
        return super(Run, drawn).body(stack)

    @functools.cached_property
    def _page(self) -> ProgramPage:
        from bricksrl.page.program import ProgramPage

        names = [path.name for path in (self.file, *self.others)]
        return ProgramPage(", ".join(names), self.live_page)

    def streams(self, stack: ExitStack) -> tuple[BinaryIO, TextIO]:
        from bricksrl.page.program import Told

        if not self.page:
            return super().streams(stack)
        if self.video is not None or self.realtime:
            raise DescriptionError(
                "the page has a pace of its own; leave out --page, or --video and --realtime"
            )
        page = stack.enter_context(self._page)

        def stay(error: object, *_: object) -> None:
            if error is None:
                page.stay(_OPENING_S if has_screen() else 0.0)

        stack.push(stay)
        announce(page.url)
        output = Told(sys.stdout.buffer, page.tell)
        errors = Told(sys.stderr, page.tell)
        return cast(BinaryIO, output), cast(TextIO, errors)

    def bodies(self, stack: ExitStack) -> Sequence[Body | None]:
        shown(self.live_page, self.page)
        if self.page and not self.robot:
            raise DescriptionError(
                "the page draws robots, and there are none; name a robot for each program, or omit "
                "--page"
            )
        return super().bodies(stack)

    def attend_in_room(self) -> Callable[[Machine], None] | None:
        if not self.page:
            return None
        return lambda machine: self._page.attend_together(machine, self.world)

    def attend(self, stack: ExitStack) -> Callable[[Machine], None] | None:
        return self._page.attend if self.page else None
