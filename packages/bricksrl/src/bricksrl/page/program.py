"""Live page of a program on a virtual hub: the robot, its hub, what the program prints, and a stop
button; or of several programs, whose robots share one world."""

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any

from brickhub.virtual.machine import Machine
from brickhub.virtual.run import stop_program
from bricksrl.page.board import Board
from bricksrl.page.robot_view import SPEEDS, RobotView
from bricksrl.page.server import PageOptions, PageServer, chosen
from bricksrl.page.visitors import Visitor
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.view.around import view_around
from bricktwin.view.mirror import Mirror

_MAX_CHARACTERS = 8000
"""Length of the shown end of what a program prints."""
_POLL_S = 0.2
_RELOAD_S = 3.0


class Told:
    """A stream whose text, or bytes, are shown by a function too."""

    def __init__(
        self,
        stream: Any,
        show: Callable[[str], None],
    ) -> None:
        self._stream = stream
        self._show = show

    def write(self, said: Any) -> int:
        """Write to the stream, and show it."""
        self._show(said if isinstance(said, str) else said.decode(errors="replace"))
        return int(self._stream.write(said))

    def flush(self) -> None:
        """Flush the stream."""
        self._stream.flush()


class ProgramPage(PageServer):
    """Page of one program, served while entered.

    Args:
        title: title of the page.
        options: address of the server.
    """

    def __init__(
        self,
        title: str,
        options: PageOptions | None = None,
    ) -> None:
        super().__init__(
            Board(),
            self._press,
            self.stop,
            options,
        )
        self._halted = threading.Event()
        self._speed = "1x"
        self._said = ""
        self._machines: list[Machine] = []
        self._view = RobotView(self.board, self._halted, lambda: SPEEDS[self._speed])
        self.board.update_status(
            title=title,
            subtitle="a program on a virtual hub",
            state="waiting",
            speeds=list(SPEEDS),
        )
        self.board.update_status(controls=["stop", "speed", "pull"], speed=self._speed)

    def has_stopped(self) -> bool:
        return not any(machine.is_driven for machine in self._machines)

    def attend(self, machine: Machine) -> None:
        """Show the robot of a machine; called as `Operation.attend`."""
        self._machines = [machine]
        self._view.show_machine(machine, stop_program)
        self.board.update_status(state="running")

    def attend_together(self, machine: Machine, world: ArenaWorld) -> None:
        """Show the world of several robots with the hub of the first machine, and pace the others;
        called as `Operation.attend` of each of them."""
        self._machines.append(machine)
        if len(self._machines) > 1:
            self._view.accompany(machine, stop_program)
            return
        self._view.show_machine(
            machine,
            stop_program,
            body=world.bodies[0],
            mirror=_mirror_of(world),
        )
        self.board.update_status(
            state="running",
            subtitle=f"{len(world.bodies)} programs on virtual hubs in one room",
        )

    def tell(self, text: str) -> None:
        """Show text in the page's console."""
        self._said = (self._said + text)[-_MAX_CHARACTERS:]
        self.board.update_status(console=self._said)

    def stay(self, opening_s: float) -> None:
        """Once the program has ended, stay as long as somebody looks at the page, at least until a
        browser can be open; Ctrl-C ends it."""
        if not self._halted.is_set():
            self.board.update_status(
                state="finished",
                controls=[],
                note="The program has ended.",
            )
        until_s = time.monotonic() + opening_s
        with contextlib.suppress(KeyboardInterrupt):
            while self.is_watched or time.monotonic() < until_s:
                # A browser that loads the page again is gone for a moment.
                if self.is_watched:
                    until_s = max(until_s, time.monotonic() + _RELOAD_S)
                time.sleep(_POLL_S)

    def stop(self) -> None:
        """End the program at the next control loop; its motors coast."""
        self._halted.set()
        self.board.update_status(state="stopped", message="The program was stopped by hand.")

    def _press(
        self,
        name: str,
        value: Any,
        _visitor: Visitor | None = None,
    ) -> None:
        if name in ("pull", "left"):
            self._view.hand.pull(value)
        if name == "speed":
            self._speed = chosen("speed", value, SPEEDS)
            self.board.update_status(speed=self._speed)


def _mirror_of(world: ArenaWorld) -> Mirror:
    """Mirror of several robots, seen from behind and above."""
    view = view_around([body.pose() for body in world.bodies])
    return Mirror(ArenaWorld(world.arena).bodies[0], view)
