"""``pybricks.common``: controllers, log and model of motors and drive bases."""

from __future__ import annotations

from collections.abc import Callable
from math import trunc
from typing import Any

from brickhub.virtual.firmware.control import Controller
from brickhub.virtual.firmware.logger import Logger
from brickhub.virtual.firmware.observer import Observer, ObserverSettings
from brickhub.virtual.machine import CONTROL_LOOP_MS, Machine
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.pybricks.context import Context, charged, firmware_errors, get_array, get_int


def acceleration_value(up: int, down: int) -> Any:
    """Acceleration as the firmware shows it: one number, or a pair when slowing down differs."""
    return up if up == down else (up, down)


def acceleration_pair(value: Any, up: int, down: int) -> tuple[int, int]:
    """Pair of accelerations from one number or a pair; ``None`` keeps what is set."""
    if value is None:
        return up, down
    if isinstance(value, list | tuple):
        if len(value) != 2:
            raise ValueError("Invalid argument")
        return get_int(value[0]), get_int(value[1])
    acceleration = get_int(value)
    return acceleration, acceleration


def magnitude(value: Any, default: int) -> int:
    """Absolute value; ``None`` keeps the default."""
    return default if value is None else abs(get_int(value))


def _tolerances(current: tuple[int, int], setter: Callable[[int, int], None], first: Any, second: Any) -> tuple[int, int] | None:
    """The present values if no new one is given; otherwise set the given ones."""
    if first is None and second is None:
        return current
    with firmware_errors():
        setter(magnitude(first, current[0]), magnitude(second, current[1]))
    return None


class Control:
    """Settings of one controller. Without arguments, each method returns what is set."""

    def __init__(self, controller: Callable[[], Controller], context: Context) -> None:
        self._controller = controller
        self._machine = context.machine
        self._scale = controller().settings.steps_per_unit
        self._log = Log(lambda: controller().log, context)

    @property
    def scale(self) -> int:
        return self._scale

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
        with firmware_errors():
            settings.set_limits(magnitude(speed, now_speed), up, down, magnitude(torque, now_torque))
        return None

    @charged
    def pid(
        self, kp: Any = None, ki: Any = None, kd: Any = None, integral_deadzone: Any = None, integral_rate: Any = None
    ) -> tuple[int, ...] | None:
        arguments = (kp, ki, kd, integral_deadzone, integral_rate)
        settings = self._controller().settings
        current = settings.pid()
        if all(value is None for value in arguments):
            return current
        values = [magnitude(value, default) for value, default in zip(arguments, current, strict=True)]
        with firmware_errors():
            settings.set_pid(*values)
        return None

    @charged
    def target_tolerances(self, speed: Any = None, position: Any = None) -> tuple[int, int] | None:
        settings = self._controller().settings
        return _tolerances(settings.target_tolerances(), settings.set_target_tolerances, speed, position)

    @charged
    def stall_tolerances(self, speed: Any = None, time: Any = None) -> tuple[int, int] | None:
        settings = self._controller().settings
        return _tolerances(settings.stall_tolerances(), settings.set_stall_tolerances, speed, time)

    # ---- of older versions, and still there

    @charged
    def trajectory(self) -> tuple[int, ...] | None:
        """Times (ms), angles (deg), speeds (deg/s) and accelerations (deg/s2) of the phases, while it is active."""
        controller = self._controller()
        if not controller.is_active:
            return None
        t = controller.trajectory
        times, angles = (trunc(x / 10) for x in (t.t1, t.t2, t.t3)), (trunc(x / 1000) for x in (t.th1, t.th2, t.th3))
        return 0, *times, 0, *angles, *(trunc(w / 10) for w in (t.w0, t.w1, t.w3)), t.a0, t.a2

    @charged
    def done(self) -> bool:
        return self._controller().is_done

    @charged
    def load(self) -> int:
        controller = self._controller()
        return trunc(controller.pid_average / 1000) if controller.is_active else 0

    @charged
    def stalled(self) -> bool:
        return self._controller().is_stalled


class Log:
    """Records the state at each control loop, and prints it as a file that pybricksdev saves."""

    def __init__(self, logger: Callable[[], Logger], context: Context) -> None:
        self._logger = logger
        self._machine = context.machine
        self._console = context.console

    @charged
    def start(self, duration: Any, down_sample: Any = 1) -> None:
        step = max(get_int(down_sample), 1)
        duration_ms = get_int(duration)
        if duration_ms < 0:
            raise MemoryError("memory allocation failed")
        self._logger().start(self._machine.time_ticks // 10, duration_ms // CONTROL_LOOP_MS // step, step)

    @charged
    def stop(self) -> None:
        self._logger().stop()

    @charged
    def save(self, path: Any = None) -> None:
        logger = self._logger()
        logger.stop()
        if path is not None and not isinstance(path, str):
            raise TypeError(f"can't convert '{type(path).__name__}' object to str implicitly")
        self._print(f"PB_OF:{path or 'log.txt'}")
        for row in logger.rows:
            self._print(", ".join(map(str, row)))
        self._print("PB_EOF")

    def _print(self, line: str) -> None:
        self._console.write(f"{line}\r\n".encode())


Log.__name__ = Log.__qualname__ = "Logger"


class MotorModel:
    """State of the observer, at the motor's own shaft: gears do not count (``pb_type_motor_model.c``)."""

    def __init__(self, observer: Callable[[], Observer], machine: Machine) -> None:
        self._observer = observer
        self._machine = machine

    @charged
    def state(self) -> tuple[float, float, float, bool]:
        """Angle (deg), speed (deg/s), current (mA), and whether it stalls at this moment, however shortly."""
        observer = self._observer()
        numbers = (observer.angle / 1000, observer.speed / 1000, observer.current / 10)
        return (*map(to_single, numbers), observer.is_pushed_back)  # type: ignore[return-value]

    @charged
    def settings(self, values: Any = None) -> tuple[int, ...] | None:
        """The eight ``ObserverSettings``, or set them all."""
        observer = self._observer()
        if values is None:
            return tuple(observer.settings)
        if len(get_array(values)) != len(ObserverSettings._fields):
            raise ValueError("Invalid argument")
        observer.tune(ObserverSettings(*map(get_int, values)))
        return None
