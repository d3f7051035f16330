"""Motors of ``pybricks.pupdevices``, with the controllers, logs and models of ``pybricks.common``.

Sensors and lights are in ``pupsensors.py``.
"""

from collections.abc import Callable
from math import trunc
from types import ModuleType
from typing import Any

from brickhub.errors import TwinError
from brickhub.robot import Direction as MotorDirection
from brickhub.virtual import error_numbers
from brickhub.virtual.firmware.control import Controller, Logger, OnCompletion
from brickhub.virtual.firmware.motor_model import Observer, ObserverSettings
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.machine import CONTROL_LOOP_MS, Machine
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.arguments import (
    expect,
    expect_type,
    get_array,
    get_int,
    os_error,
    percentage,
)
from brickhub.virtual.pybricks.context import (
    Awaited,
    Context,
    Native,
    bind,
    classes,
    firmware_errors,
)
from brickhub.virtual.pybricks.device_modes import reports_angle
from brickhub.virtual.pybricks.parameters import Direction, Stop
from brickhub.virtual.pybricks.pupsensors import DEVICES, PFMotor
from brickhub.virtual.pybricks.wireless import DuploTrain, MarioHub, Remote, TechnicMoveHub


def acceleration_value(up: int, down: int) -> Any:
    """Acceleration as the firmware shows it: one number, or a pair when slowing down differs."""
    return up if up == down else (up, down)


def acceleration_pair(
    value: Any,
    up: int,
    down: int,
) -> tuple[int, int]:
    """Pair of accelerations from one number or a pair; ``None`` keeps what is set."""
    if value is None:
        return up, down
    if isinstance(value, list | tuple):
        expect(len(value) == 2)
        return get_int(value[0]), get_int(value[1])
    return get_int(value), get_int(value)


def magnitude(value: Any, default: int) -> int:
    """Absolute value; ``None`` keeps the default."""
    return default if value is None else abs(get_int(value))


class Control(Native):
    """Settings of one controller. Without arguments, each method returns what is set."""

    def __init__(
        self,
        controller: Callable[[], Controller],
        context: Context,
    ) -> None:
        self._controller = controller
        self._machine = context.machine
        self.scale = controller().settings.steps_per_unit
        self.log = Log(lambda: controller().log, context)

    def limits(
        self,
        speed: Any = None,
        acceleration: Any = None,
        torque: Any = None,
    ) -> tuple[Any, ...] | None:
        settings = self._controller().settings
        now_speed, up, down, now_torque = settings.limits()
        if speed is None and acceleration is None and torque is None:
            return now_speed, acceleration_value(up, down), now_torque
        up, down = acceleration_pair(acceleration, up, down)
        new_speed = magnitude(speed, now_speed)
        new_torque = magnitude(torque, now_torque)
        settings.set_limits(
            new_speed,
            up,
            down,
            new_torque,
        )
        return None

    def pid(
        self,
        kp: Any = None,
        ki: Any = None,
        kd: Any = None,
        integral_deadzone: Any = None,
        integral_rate: Any = None,
    ) -> tuple[int, ...] | None:
        return self._get_or_set(
            "pid",
            kp,
            ki,
            kd,
            integral_deadzone,
            integral_rate,
        )

    def target_tolerances(
        self,
        speed: Any = None,
        position: Any = None,
    ) -> tuple[int, ...] | None:
        return self._get_or_set("target_tolerances", speed, position)

    def stall_tolerances(
        self,
        speed: Any = None,
        time: Any = None,
    ) -> tuple[int, ...] | None:
        return self._get_or_set("stall_tolerances", speed, time)

    def _get_or_set(
        self,
        name: str,
        *values: Any,
    ) -> tuple[int, ...] | None:
        settings = self._controller().settings
        current = settings.group(name)
        if all(value is None for value in values):
            return current
        settings.set_group(name, map(magnitude, values, current))
        return None

    # Programs still use the methods of older versions that follow.

    def trajectory(self) -> tuple[int, ...] | None:
        """Times (ms), angles (deg), speeds (deg/s) and accelerations (deg/s2) of the phases, while
        it is active."""
        controller = self._controller()
        if not controller.is_active:
            return None
        # Times are ticks of 0.1 ms, angles mdeg and speeds ddeg/s, but accelerations already
        # deg/s2.
        t = controller.trajectory
        return (
            0,
            trunc(t.t1 / 10),
            trunc(t.t2 / 10),
            trunc(t.t3 / 10),
            0,
            trunc(t.th1 / 1000),
            trunc(t.th2 / 1000),
            trunc(t.th3 / 1000),
            trunc(t.w0 / 10),
            trunc(t.w1 / 10),
            trunc(t.w3 / 10),
            t.a0,
            t.a2,
        )

    def done(self) -> bool:
        return self._controller().is_done

    def load(self) -> int:
        controller = self._controller()
        return trunc(controller.pid_average / 1000) if controller.is_active else 0

    def stalled(self) -> bool:
        return self._controller().is_stalled


class Log(Native):
    """Records the state at each control loop, and prints it as a file that pybricksdev saves."""

    def __init__(
        self,
        logger: Callable[[], Logger],
        context: Context,
    ) -> None:
        self._logger = logger
        self._machine = context.machine
        self._console = context.console

    def start(
        self,
        duration: Any,
        down_sample: Any = 1,
    ) -> None:
        step = max(get_int(down_sample), 1)
        duration_ms = get_int(duration)
        if duration_ms < 0:
            raise MemoryError("memory allocation failed")
        capacity = duration_ms // CONTROL_LOOP_MS // step
        self._logger().start(self._machine.time_ticks // 10, capacity, step)

    def stop(self) -> None:
        self._logger().is_active = False

    def save(self, path: Any = None) -> None:
        logger = self._logger()
        logger.is_active = False
        if path is not None and not isinstance(path, str):
            raise TypeError(f"can't convert '{type(path).__name__}' object to str implicitly")
        # Only what is between these two lines goes into a file, which pybricksdev writes.
        lines = [f"PB_OF:{path or 'log.txt'}"]
        for row in logger.rows:
            lines.append(", ".join(map(str, row)))
        lines.append("PB_EOF")
        for line in lines:
            self._console.write(f"{line}\r\n".encode())


Log.__name__ = Log.__qualname__ = "Logger"


class MotorModel(Native):
    """State of the observer, at the motor's own shaft: gears do not count
    (``pb_type_motor_model.c``)."""

    def __init__(
        self,
        observer: Callable[[], Observer],
        machine: Machine,
    ) -> None:
        self._observer = observer
        self._machine = machine

    def state(self) -> tuple[float, float, float, bool]:
        """Angle (deg), speed (deg/s), current (mA), and whether it stalls at this moment, however
        shortly."""
        observer = self._observer()
        return (
            to_single(observer.angle / 1000),
            to_single(observer.speed / 1000),
            to_single(observer.current / 10),
            observer.stalled_since is not None,
        )

    def settings(self, values: Any = None) -> tuple[int, ...] | None:
        """The eight ``ObserverSettings``, or set them all."""
        observer = self._observer()
        if values is None:
            return tuple(observer.settings)
        expect(len(get_array(values)) == len(ObserverSettings._fields))
        observer.tune(ObserverSettings(*map(get_int, values)))
        return None


def completion(then: Any) -> OnCompletion:
    """Behaviour at the end of a move for a ``Stop``. Raises TypeError for anything else."""
    expect_type(then, Stop)
    return OnCompletion["CONTINUE" if then is Stop.NONE else then._name]


def _gear_ratio_milli(gears: Any) -> int:
    """1000 times the motor's turns for one of the output, from ``(12, 36)`` or ``((12, 20), (20,
    40))``."""
    trains = () if gears is None else get_array(gears)
    # A single train of gears may be given without a list around it.
    if trains and isinstance(trains[0], int) and isinstance(trains[-1], int):
        trains = (trains,)
    # Gears between the first and the last of a train do not change its ratio.
    first = last = 1
    for train in map(get_array, trains):
        first *= get_int(train[0])
        last *= get_int(train[-1])
    if first < 1 or last < 1:
        raise ZeroDivisionError("Gears must be positive integers.")
    return 1000 * last // first


class _BaseMotor(Native):
    """Common methods of motors with and without rotation sensor."""

    _servo: Servo

    def __init__(
        self,
        port: Any,
        positive_direction: Any,
    ) -> None:
        self._context.assert_blocking()
        self._letter = self._context.port_letter(port)
        expect_type(positive_direction, Direction)
        is_clockwise = positive_direction is Direction.CLOCKWISE
        self._direction = (
            MotorDirection.CLOCKWISE if is_clockwise else MotorDirection.COUNTERCLOCKWISE
        )

    def __repr__(self) -> str:
        direction = Direction.CLOCKWISE if self._servo.direction > 0 else Direction.COUNTERCLOCKWISE
        return f"{type(self).__name__}(Port.{self._letter}, {direction!r})"

    def stop(self) -> None:
        self._servo.coast()

    def brake(self) -> None:
        self._servo.brake()

    def dc(self, duty: Any) -> None:
        self._servo.dc(get_int(duty))

    def settings(self, max_voltage: Any = None) -> tuple[int] | None:
        if max_voltage is None:
            return (self._servo.max_voltage_mv,)
        self._servo.set_max_voltage(get_int(max_voltage))
        return None

    def close(self) -> None:
        self._servo.close()


class DCMotor(_BaseMotor):
    """Motor without rotation sensor."""

    _is_checked = True
    """Whether the port must have such a motor."""

    def __init__(
        self,
        port: Any,
        positive_direction: Any = Direction.CLOCKWISE,
    ) -> None:
        super().__init__(port, positive_direction)
        # On a bench, a motor with an encoder may stand for what the program asks for.
        is_fitted = self._machine.plug_in(self._letter, "DCMotor")
        servo = self._machine.servos.get(self._letter)
        is_other = servo is not None and servo.kind.model.has_encoder and not is_fitted
        if servo is None or (is_other and self._is_checked):
            raise os_error(error_numbers.ENODEV)
        self._servo = servo
        with firmware_errors():
            self._servo.setup_plain(self._direction)


class Motor(_BaseMotor):
    """Motor with rotation sensor, under the firmware's control."""

    def __init__(
        self,
        port: Any,
        positive_direction: Any = Direction.CLOCKWISE,
        gears: Any = None,
        reset_angle: Any = True,
        profile: Any = None,
    ) -> None:
        super().__init__(port, positive_direction)
        self._machine.plug_in(self._letter, "Motor")
        servo = self._machine.servos.get(self._letter)
        mode = self._machine.modes.get(self._letter)
        mode_name = mode.name if mode else None
        # A motor that a program has set up as a DCMotor, or put into another mode, sends no angles.
        if servo is None or servo.is_plain or not reports_angle(servo.kind, mode_name):
            raise os_error(error_numbers.ENODEV)
        ratio = _gear_ratio_milli(gears)
        with firmware_errors():
            # The motor's own profile is 0 here.
            profile_deg = 0 if profile is None else abs(get_int(profile))
            servo.setup(
                self._direction,
                ratio,
                bool(reset_angle),
                profile_deg,
            )
        self._servo = servo
        self._awaited = Awaited(self._context)
        # The control is asked for at each use, because a new setup of the motor makes a new one.
        self.control = Control(lambda: servo.control, self._context)
        self.log = Log(lambda: servo.log, self._context)
        self.model = MotorModel(lambda: servo.observer, self._machine)

    def angle(self) -> int:
        return self._servo.angle_deg()

    def speed(self, window: Any = 100) -> int:
        return self._servo.speed_deg_s(max(0, get_int(window)))

    def load(self) -> int:
        return self._servo.load_mnm()

    def stalled(self) -> bool:
        return self._servo.is_stalled()

    def done(self) -> bool:
        return self._servo.is_done()

    # In these methods the command comes before the cancel, because a refused one must leave the
    # awaited move alone.

    def hold(self) -> None:
        self._servo.stop(OnCompletion.HOLD)
        self._awaited.cancel()

    def reset_angle(self, angle: Any = None) -> None:
        self._servo.reset_angle(None if angle is None else get_int(angle))
        self._awaited.cancel()

    def run(self, speed: Any) -> None:
        self._servo.run(get_int(speed))
        self._awaited.cancel()

    def track_target(self, target_angle: Any) -> None:
        self._servo.track_target(get_int(target_angle))
        self._awaited.cancel()

    def run_time(
        self,
        speed: Any,
        time: Any,
        then: Any = Stop.HOLD,
        wait: Any = True,
    ) -> Any:
        speed_deg_s = get_int(speed)
        time_ms = max(0, get_int(time))
        self._servo.run_time(speed_deg_s, time_ms, completion(then))
        return self._finish(ends_by_time=True) if wait else None

    def run_angle(
        self,
        speed: Any,
        rotation_angle: Any,
        then: Any = Stop.HOLD,
        wait: Any = True,
    ) -> Any:
        speed_deg_s = get_int(speed)
        angle_deg = get_int(rotation_angle)
        self._servo.run_angle(speed_deg_s, angle_deg, completion(then))
        return self._finish() if wait else None

    def run_target(
        self,
        speed: Any,
        target_angle: Any,
        then: Any = Stop.HOLD,
        wait: Any = True,
    ) -> Any:
        speed_deg_s = get_int(speed)
        target_deg = get_int(target_angle)
        self._servo.run_target(speed_deg_s, target_deg, completion(then))
        return self._finish() if wait else None

    def run_until_stalled(
        self,
        speed: Any,
        then: Any = Stop.COAST,
        duty_limit: Any = None,
    ) -> Any:
        speed_deg_s = get_int(speed)
        stop = completion(then)
        duty_limit_pct = None if duty_limit is None else percentage(duty_limit)
        self._servo.run_until_stalled(speed_deg_s, stop, duty_limit_pct)
        return self._finish(returns_angle=True)

    def _finish(
        self,
        returns_angle: bool = False,
        ends_by_time: bool = False,
    ) -> Any:
        """Wait for the end of the move. Raises TwinError if the bench blocks it, so that it never
        ends."""
        machine = self._machine
        angle_deg = self._servo.angle_deg()
        since_ms = machine.time_ms

        def is_done() -> bool:
            nonlocal angle_deg, since_ms
            if not self._servo.is_open:
                raise os_error(error_numbers.ENODEV)
            if self._servo.is_done():
                return True
            if self._servo.angle_deg() != angle_deg:
                angle_deg = self._servo.angle_deg()
                since_ms = machine.time_ms
                return False
            # A wait may be ended by its time, by another task, or by a person who watches.
            may_end = ends_by_time or self._context.is_active or machine.pace
            if machine.time_ms - since_ms > _STUCK_MS and not may_end:
                raise TwinError(
                    f"the program waits for the motor on port {self._letter}, which has been "
                    f"blocked at {angle_deg} degrees for "
                    f"{_STUCK_MS // 1000} s; give it other ends, such as --end-stop "
                    f"{self._letter}=-90..120"
                )
            return False

        result = self._servo.angle_deg if returns_angle else None
        return self._awaited.finish(is_done, result, self._servo.coast)


_STUCK_MS = 60_000
"""Simulated time after which a blocked motor, for which a program waits without an end, is taken
for one that never arrives."""


def pupdevices_modules(context: Context) -> list[ModuleType]:
    """``pybricks.pupdevices``, for hubs that take Powered Up devices."""
    kinds = (Remote, TechnicMoveHub, DuploTrain, MarioHub, DCMotor, *DEVICES)
    # The firmware of a Move hub is built without these.
    model = context.machine.robot.hub.model
    hidden = () if model.has_float else ("control", "log", "model")
    names: dict[str, Any] = {"PFMotor": PFMotor, "Motor": bind(context, Motor, *hidden)}
    names |= classes(context, kinds)
    return [module("pupdevices", names)]
