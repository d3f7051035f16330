"""Machine behind a virtual hub: one clock, the 5 ms control loop of the firmware, and the body that it moves.

Time is a whole number of milliseconds and passes only in :meth:`Machine.advance`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from bricksrl.virtual_hub.body import Body, FittingBody
from bricksrl.virtual_hub.firmware.drive_base import DriveBaseControl
from bricksrl.virtual_hub.firmware.heading import Heading
from bricksrl.virtual_hub.firmware.servo import Servo
from bricksrl.virtual_hub.pace import Pace
from bricksrl.virtual_hub.panel import Panel

CONTROL_LOOP_MS = 5
# A program that polls without waiting would stand still in simulated time for ever. On a hub each call costs
# some 10 us; here calls are free until there are many of them without a wait.
_FREE_CALLS = 200
_CALLS_PER_MS = 100
_AFTER_LOOP_TICKS = 10


class Machine:
    """Clock, servos and drive bases of one virtual hub.

    Attributes:
        runs_program: whether a stop button has something to stop.
        pace: what holds simulated time to that on the wall, at each control loop; ``None`` for as fast as it goes.
        panel: its buttons, light, display and loudspeaker.
        heading: what the gyroscope says about where the robot looks.
        time_ms: simulated time since the hub was switched on.
        time_ticks: the same in the firmware's control ticks of 0.1 ms, as the motor control sees it. After the control loop the
            firmware sleeps until its next event, 1 ms at most, and only then goes on with the program: what a program starts
            is that much younger than the loop of the same millisecond.
        alarm_ms: simulated time at which ``on_alarm`` is called from within :meth:`advance`; ``None`` for never.
    """

    def __init__(self, body: Body, panel: Panel | None = None) -> None:
        self.robot = body.robot
        self.body = body
        self.panel = panel or Panel(body.robot.hub)
        self.panel.clock_ms = lambda: self.time_ms
        self.runs_program = False
        self.pace: Pace | None = None
        self.time_ms = 0
        self.time_ticks = _AFTER_LOOP_TICKS
        self.alarm_ms: int | None = None
        self.on_alarm: Callable[[], None] = lambda: None
        self.heading = Heading(body)
        self.servos = {motor.port: Servo(motor.kind, motor.port, body, self) for motor in body.robot.motors}
        self.drive_bases: list[DriveBaseControl] = []
        self._calls = 0
        self._is_ahead = self._is_stopping = False

    @property
    def body_ms(self) -> int:
        """Simulated time at which the body is: the program's, or a millisecond more."""
        return self.time_ms + self._is_ahead

    def plug_in(self, port: str, device: str) -> bool:
        """Whether a body that fits itself to the program has this device on that port now."""
        if not (isinstance(self.body, FittingBody) and self.body.plug_in(port, device)):
            return False
        if port in self.body.motors and port not in self.servos:
            self.servos[port] = Servo(self.body.motors[port], port, self.body, self)
        return True

    def new_drive_base(self, left: Servo, right: Servo, wheel_diameter_um: int, axle_track_um: int) -> DriveBaseControl:
        """Two servos as a vehicle, which the control loop then moves.

        Raises:
            ValueError: the geometry is impossible, or both motors are the same, or their gears differ.
            OSError: EBUSY, a motor belongs to another drive base; ENODEV, it is closed.
        """
        base = DriveBaseControl(left, right, wheel_diameter_um, axle_track_um, self.heading)
        self.drive_bases.append(base)
        return base

    def advance(self, duration_ms: int) -> None:
        """Let time pass: physics, control loop, alarm."""
        self._calls = 0
        end_ms = self.time_ms + duration_ms
        while self.time_ms < end_ms:
            self._advance_towards(end_ms)

    def doze(self, duration_ms: int) -> int:
        """Let time pass, but not beyond the next alarm, which may have brought input; returns how long it was."""
        self._calls = 0
        start_ms = self.time_ms
        end_ms = start_ms + duration_ms
        while self.time_ms < end_ms and not self._advance_towards(end_ms):
            pass
        return self.time_ms - start_ms

    def _advance_towards(self, end_ms: int) -> bool:
        """Advance as far as nothing but physics happens, at most to ``end_ms``; whether there was an alarm."""
        time_ms = self.time_ms
        event_ms = self.panel.next_ms
        if self._is_ahead:
            stop_ms = self.time_ms = time_ms + 1
            self._is_ahead = False
        else:
            next_ms = time_ms - time_ms % CONTROL_LOOP_MS + CONTROL_LOOP_MS
            stop_ms = next_ms if next_ms < end_ms else end_ms
            if event_ms is not None and event_ms < stop_ms:
                stop_ms = max(event_ms, time_ms + 1)
            alarm_ms = self.alarm_ms
            if alarm_ms is not None and time_ms < alarm_ms < stop_ms:
                stop_ms = alarm_ms
            self._move_on(stop_ms)
        self.time_ticks = stop_ms * 10 + _AFTER_LOOP_TICKS
        if event_ms is not None and event_ms <= stop_ms and self.panel.stops(stop_ms) and self.runs_program:
            self.time_ms, self.time_ticks, self._is_ahead = stop_ms - 1, stop_ms * 10, True
            raise SystemExit
        if self.alarm_ms is None or stop_ms < self.alarm_ms:
            return False
        self.on_alarm()
        return True

    def _move_on(self, time_ms: int) -> None:
        """Physics until a time, and the control loop, if it is its time."""
        self.body.advance_to(time_ms)
        self.time_ms = time_ms
        if time_ms % CONTROL_LOOP_MS == 0:
            self.time_ticks = time_ms * 10
            for base in self.drive_bases:
                base.update()
            for servo in self.servos.values():
                servo.update()
            if self.pace is not None:
                self.pace.keep(time_ms)

    def settle(self) -> None:
        """Let the rest of the hub catch up with the program, which it has not done yet.

        A program goes on at the beginning of a millisecond, and the rest of the hub does what is due in it only when the program
        branches for the first time, as it does at each turn of a loop.
        """
        time_ms, time_ticks = self.time_ms, self.time_ticks
        self._move_on(time_ms + 1)
        self.time_ms, self.time_ticks, self._is_ahead = time_ms, time_ticks, True

    def branch(self, value: Any) -> Any:
        """What the program branches on, as it is."""
        if not (self._is_ahead or self._is_stopping):
            self.settle()
        return value

    @contextlib.contextmanager
    def stopping(self) -> Iterator[None]:
        """Inside, branches let no time pass."""
        self._is_stopping = True
        try:
            yield
        finally:
            self._is_stopping = False

    def turn_loop(self) -> None:
        """One turn of a loop that may not wait."""
        self.branch(None)
        self.charge_call()

    def advance_to_control(self) -> None:
        """Let time pass until the control loop has run once: the grain at which moves end."""
        self.advance(CONTROL_LOOP_MS - self.time_ms % CONTROL_LOOP_MS)

    def charge_call(self) -> None:
        """Count a call that takes no simulated time, so that a polling loop comes to an end."""
        self._calls = calls = self._calls + 1
        if calls > _FREE_CALLS and calls % _CALLS_PER_MS == 0:
            self.advance(1)
            self._calls = calls

    def stop_motors(self) -> None:
        """End of a program, as the firmware does it: all motors coast, all objects are forgotten, the display is dark."""
        self.runs_program = False
        self.panel.start_program()
        for base in self.drive_bases:
            base.release()
        self.drive_bases.clear()
        for servo in self.servos.values():
            servo.close()
