"""Clock of a virtual robot that somebody watches: simulated time at a chosen speed, and a look now and then."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from bricksrl.virtual_hub.machine import Machine
from bricksrl.virtual_hub.pace import Pace

SPEEDS = {"1x": 1.0, "10x": 10.0, "max": 0.0}
"""Of simulated time; 0 is as fast as it goes."""
LOOK_S = 0.04
"""Between two looks at the robot, in time on the wall."""
_BEHIND_S, _AHEAD_S = 0.05, 0.01
"""Further behind, what was lost is not caught up with; less ahead is not worth a pause."""


class SteeredPace(Pace):
    """Pace of a machine whose speed may change at any moment; a stop ends the waiting at once.

    Called by the thread that steps the robot, once for each control loop of simulated time, so it does next to nothing.

    Args:
        machine: whose time it holds back.
        halted: set when the robot is to stop.
        speed: simulated seconds for a second, 0 for as many as there can be.
        look: called when it is time for a look.
        halt: called once halted; without it the host has its turn, which stops the program.
    """

    def __init__(
        self,
        machine: Machine,
        halted: threading.Event,
        speed: Callable[[], float],
        look: Callable[[], None],
        halt: Callable[[], None] | None = None,
    ) -> None:
        super().__init__()
        self._halt = halt
        self._machine, self._halted, self._speed, self._look = machine, halted, speed, look
        self._look_s = 0.0
        self._used = -1.0
        self._from_s, self._from_ms = 0.0, 0.0

    def keep(self, time_ms: float) -> None:
        """Look, and wait where simulated time is ahead."""
        now_s = time.monotonic()
        if now_s >= self._look_s:
            self._look_s = now_s + LOOK_S
            self._look()
        if self._halted.is_set():
            if self._halt is not None:
                self._halt()
            elif self._machine.alarm_ms is not None:
                self._machine.alarm_ms = int(time_ms)  # back to the host, which then stops the program
            return
        speed = self._speed()
        if speed <= 0.0:
            return
        ahead_s = self._from_s + (time_ms - self._from_ms) / 1000 / speed - now_s
        if speed != self._used or ahead_s < -_BEHIND_S:
            self._used, self._from_s, self._from_ms = speed, now_s, time_ms
        elif ahead_s > _AHEAD_S:
            self._halted.wait(ahead_s)
