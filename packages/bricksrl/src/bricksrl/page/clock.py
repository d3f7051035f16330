"""Clock of a virtual robot on a page: simulated time at a selectable speed, and periodic updates of the view."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from brickhub.virtual.machine import Machine, Pace

SPEEDS = {"1x": 1.0, "10x": 10.0, "max": 0.0}
"""Speeds of simulated time; 0 is as fast as possible."""
VIEW_PERIOD_S = 0.04
"""Period of the view's updates, in wall time."""
_MAX_LAG_S, _MIN_LEAD_S = 0.05, 0.01
"""Lag beyond which the clock is restarted instead of catching up; least lead for which it waits."""


class SteeredPace(Pace):
    """Pace of a machine with a variable speed; a stop ends a wait at once.

    It is called by the thread that steps the robot, once per control loop of simulated time, so it must be fast.

    Args:
        machine: machine whose time is paced.
        halted: set when the robot is to stop.
        speed: returns simulated seconds per second, 0 for as fast as possible.
        update_view: called periodically to update the view.
        halt: called when halted; by default control returns to the host, which stops the program.
    """

    def __init__(
        self,
        machine: Machine,
        halted: threading.Event,
        speed: Callable[[], float],
        update_view: Callable[[], None],
        halt: Callable[[], None] | None = None,
    ) -> None:
        super().__init__()
        self._halt = halt
        self._machine, self._halted, self._speed, self._update_view = machine, halted, speed, update_view
        self._view_due_s = 0.0
        self._last_speed = -1.0
        self._start_s, self._start_ms = 0.0, 0.0

    def keep(self, time_ms: float) -> None:
        """Update the view, and wait if simulated time is ahead."""
        now_s = time.monotonic()
        if now_s >= self._view_due_s:
            self._view_due_s = now_s + VIEW_PERIOD_S
            self._update_view()
        if self._halted.is_set():
            if self._halt is not None:
                self._halt()
            elif self._machine.alarm_ms is not None:
                self._machine.alarm_ms = int(time_ms)  # back to the host, which then stops the program
            return
        speed = self._speed()
        if speed <= 0.0:
            return
        ahead_s = self._start_s + (time_ms - self._start_ms) / 1000 / speed - now_s
        if speed != self._last_speed or ahead_s < -_MAX_LAG_S:
            self._last_speed, self._start_s, self._start_ms = speed, now_s, time_ms
        elif ahead_s > _MIN_LEAD_S:
            self._halted.wait(ahead_s)
