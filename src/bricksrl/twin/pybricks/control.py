"""``Motor.control``, ``DriveBase.distance_control`` and ``DriveBase.heading_control``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bricksrl.twin.firmware.control import Controller
from bricksrl.twin.pybricks.context import Context, charged, get_int, refusals
from bricksrl.twin.pybricks.log import Log


def acceleration_value(up: int, down: int) -> Any:
    """How the firmware shows an acceleration: one number, or a pair when slowing down differs."""
    return up if up == down else (up, down)


def acceleration_pair(value: Any, up: int, down: int) -> tuple[int, int]:
    """From one number or a pair; ``None`` keeps what is set."""
    if value is None:
        return up, down
    if isinstance(value, list | tuple):
        if len(value) != 2:
            raise ValueError("Invalid argument")
        return abs(get_int(value[0])), abs(get_int(value[1]))
    both = abs(get_int(value))
    return both, both


def magnitude(value: Any, default: int) -> int:
    """A size; ``None`` keeps the default."""
    return default if value is None else abs(get_int(value))


class Control:
    """Settings of one controller. Without arguments, each method returns what is set."""

    def __init__(self, controller: Callable[[], Controller], context: Context) -> None:
        self._controller = controller
        self._machine = context.machine
        self._log = Log(lambda: controller().log, context)

    @property
    def log(self) -> Log:
        return self._log

    @charged
    def limits(self, speed: Any = None, acceleration: Any = None, torque: Any = None) -> tuple[Any, ...] | None:
        settings = self._controller().settings
        now_speed, up, down, now_torque = settings.limits()
        if speed is None and acceleration is None and torque is None:
            return now_speed, acceleration_value(up, down), now_torque
        up, down = acceleration_pair(acceleration, up, down)
        with refusals():
            settings.set_limits(magnitude(speed, now_speed), up, down, magnitude(torque, now_torque))
        return None

    @charged
    def pid(
        self, kp: Any = None, ki: Any = None, kd: Any = None, integral_deadzone: Any = None, integral_rate: Any = None
    ) -> tuple[int, ...] | None:
        given = (kp, ki, kd, integral_deadzone, integral_rate)
        settings = self._controller().settings
        now = settings.pid()
        if all(value is None for value in given):
            return now
        values = [magnitude(value, default) for value, default in zip(given, now, strict=True)]
        with refusals():
            settings.set_pid(*values)
        return None

    @charged
    def target_tolerances(self, speed: Any = None, position: Any = None) -> tuple[int, int] | None:
        settings = self._controller().settings
        now_speed, now_position = settings.target_tolerances()
        if speed is None and position is None:
            return now_speed, now_position
        with refusals():
            settings.set_target_tolerances(magnitude(speed, now_speed), magnitude(position, now_position))
        return None

    @charged
    def stall_tolerances(self, speed: Any = None, time: Any = None) -> tuple[int, int] | None:
        settings = self._controller().settings
        now_speed, now_time = settings.stall_tolerances()
        if speed is None and time is None:
            return now_speed, now_time
        with refusals():
            settings.set_stall_tolerances(magnitude(speed, now_speed), magnitude(time, now_time))
        return None
