"""Live page of a program on a virtual hub: the robot, its hub, and a stop button."""

from __future__ import annotations

import threading
from typing import Any

from brickhub.virtual.machine import Machine
from brickhub.virtual.run import stop_program
from bricksrl.page.board import Board
from bricksrl.page.robot_view import SPEEDS, RobotView
from bricksrl.page.server import PageOptions, PageServer, chosen


class ProgramPage(PageServer):
    """Page of one program, served while entered.

    Args:
        title: title of the page.
        options: address of the server.
    """

    def __init__(self, title: str, options: PageOptions | None = None) -> None:
        super().__init__(Board(), self._press, self.stop, options)
        self._halted, self._speed = threading.Event(), "1x"
        self._view = RobotView(self.board, self._halted, lambda: SPEEDS[self._speed])
        self.board.update_status(title=title, subtitle="a program on a virtual hub", state="waiting", speeds=list(SPEEDS))
        self.board.update_status(controls=["stop", "speed"], speed=self._speed)

    def attend(self, machine: Machine) -> None:
        """Show the robot of a machine; called as `Operation.attend`."""
        self._view.show_machine(machine, stop_program)
        self.board.update_status(state="running")

    def stop(self) -> None:
        """End the program at the next control loop; its motors coast."""
        self._halted.set()
        self.board.update_status(state="stopped", message="The program was stopped by hand.")

    def _press(self, name: str, value: Any) -> None:
        if name == "speed":
            self._speed = chosen("speed", value, SPEEDS)
            self.board.update_status(speed=self._speed)
