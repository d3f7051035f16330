"""Motors of ``pybricks.pupdevices``; sensors and lights are in ``pupsensors.py``."""

from __future__ import annotations

import errno
from types import ModuleType
from typing import Any

from brickhub.robot import Direction as MotorDirection
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.common import Control, Log, MotorModel
from brickhub.virtual.pybricks.context import (
    Awaited,
    Context,
    RunLoop,
    bind,
    charged,
    expect_type,
    firmware_errors,
    get_array,
    get_int,
    hide_attributes,
    os_error,
)
from brickhub.virtual.pybricks.device_modes import reports_angle
from brickhub.virtual.pybricks.parameters import Direction, Parameters, Stop
from brickhub.virtual.pybricks.pupsensors import DEVICES, PFMotor
from brickhub.virtual.pybricks.wireless import DuploTrain, MarioHub, Remote, TechnicMoveHub, wireless

COMPLETIONS = {
    Stop.COAST: OnCompletion.COAST,
    Stop.BRAKE: OnCompletion.BRAKE,
    Stop.HOLD: OnCompletion.HOLD,
    Stop.NONE: OnCompletion.CONTINUE,
    Stop.COAST_SMART: OnCompletion.COAST_SMART,
    Stop.BRAKE_SMART: OnCompletion.BRAKE_SMART,
}


def completion(then: Any) -> OnCompletion:
    """Behaviour at the end of a move for a ``Stop``. Raises TypeError for anything else."""
    expect_type(then, Stop)
    return COMPLETIONS[then]


def _gear_ratio_milli(gears: Any) -> int:
    """1000 times the motor's turns for one of the output, from ``(12, 36)`` or ``((12, 20), (20, 40))``."""
    trains = () if gears is None else get_array(gears)
    if trains and isinstance(trains[0], int) and isinstance(trains[-1], int):
        trains = (trains,)
    first = last = 1
    for train in map(get_array, trains):
        first *= get_int(train[0])
        last *= get_int(train[-1])
    if first < 1 or last < 1:
        raise ZeroDivisionError("Gears must be positive integers.")
    return 1000 * last // first


class _BaseMotor:
    """Common methods of motors with and without rotation sensor."""

    _context: Context
    _machine: Machine
    _loop: RunLoop
    _parameters: Parameters
    _servo: Servo

    def __init__(self, port: Any, positive_direction: Any) -> None:
        self._loop.assert_blocking()
        self._letter = self._parameters.port_letter(port)
        expect_type(positive_direction, Direction)
        is_clockwise = positive_direction is Direction.CLOCKWISE
        self._direction = MotorDirection.CLOCKWISE if is_clockwise else MotorDirection.COUNTERCLOCKWISE

    def __repr__(self) -> str:
        direction = Direction.CLOCKWISE if self._servo.direction > 0 else Direction.COUNTERCLOCKWISE
        return f"{type(self).__name__}(Port.{self._letter}, {direction!r})"

    @charged
    def stop(self) -> None:
        self._servo.coast()

    @charged
    def brake(self) -> None:
        self._servo.brake()

    @charged
    def dc(self, duty: Any) -> None:
        self._servo.dc(get_int(duty))

    @charged
    def settings(self, max_voltage: Any = None) -> tuple[int] | None:
        if max_voltage is None:
            return (self._servo.max_voltage_mv,)
        with firmware_errors():
            self._servo.max_voltage_mv = get_int(max_voltage)
        return None

    @charged
    def close(self) -> None:
        self._servo.close()


class DCMotor(_BaseMotor):
    """Motor without rotation sensor; only a ``FittingBody`` has some."""

    def __init__(self, port: Any, positive_direction: Any = Direction.CLOCKWISE) -> None:
        super().__init__(port, positive_direction)
        if not self._machine.plug_in(self._letter, "DCMotor"):
            raise os_error(errno.ENODEV)
        self._servo = self._machine.servos[self._letter]
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
        if servo is None or servo.is_plain or not reports_angle(servo.kind, self._machine.modes.get(self._letter)):
            raise os_error(errno.ENODEV)
        ratio = _gear_ratio_milli(gears)
        with firmware_errors():
            servo.setup(self._direction, ratio, bool(reset_angle), 0 if profile is None else abs(get_int(profile)))
        self._servo = servo
        self._awaited = Awaited(self._loop)
        self._control = Control(lambda: servo.control, self._context)
        self._log = Log(lambda: servo.log, self._context)
        self._model = MotorModel(lambda: servo.observer, self._machine)

    @property
    def control(self) -> Control:
        return self._control

    @property
    def log(self) -> Log:
        return self._log

    @property
    def model(self) -> MotorModel:
        return self._model

    # ---- reading

    def angle(self) -> int:
        self._machine.charge_call()
        if not self._servo.is_open:
            raise os_error(errno.ENODEV)
        return self._servo.angle_deg()

    @charged
    def speed(self, window: Any = 100) -> int:
        with firmware_errors():
            return self._servo.speed_deg_s(max(0, get_int(window)))

    @charged
    def load(self) -> int:
        with firmware_errors():
            return self._servo.load_mnm()

    @charged
    def stalled(self) -> bool:
        with firmware_errors():
            return self._servo.is_stalled()

    def done(self) -> bool:
        self._machine.charge_call()
        return self._servo.is_done()

    # ---- commands that do not wait

    @charged
    def hold(self) -> None:
        with firmware_errors():
            self._servo.hold()
        self._awaited.cancel()

    @charged
    def reset_angle(self, angle: Any = None) -> None:
        with firmware_errors():
            self._servo.reset_angle(None if angle is None else get_int(angle))
        self._awaited.cancel()

    @charged
    def run(self, speed: Any) -> None:
        with firmware_errors():
            self._servo.run(get_int(speed))
        self._awaited.cancel()

    @charged
    def track_target(self, target_angle: Any) -> None:
        with firmware_errors():
            self._servo.track_target(get_int(target_angle))
        self._awaited.cancel()

    # ---- moves

    @charged
    def run_time(self, speed: Any, time: Any, then: Any = Stop.HOLD, wait: Any = True) -> Any:
        with firmware_errors():
            self._servo.run_time(get_int(speed), max(0, get_int(time)), completion(then))
        return self._finish() if wait else None

    @charged
    def run_angle(self, speed: Any, rotation_angle: Any, then: Any = Stop.HOLD, wait: Any = True) -> Any:
        with firmware_errors():
            self._servo.run_angle(get_int(speed), get_int(rotation_angle), completion(then))
        return self._finish() if wait else None

    @charged
    def run_target(self, speed: Any, target_angle: Any, then: Any = Stop.HOLD, wait: Any = True) -> Any:
        with firmware_errors():
            self._servo.run_target(get_int(speed), get_int(target_angle), completion(then))
        return self._finish() if wait else None

    @charged
    def run_until_stalled(self, speed: Any, then: Any = Stop.COAST, duty_limit: Any = None) -> Any:
        limit = None if duty_limit is None else max(0, min(100, get_int(duty_limit)))
        with firmware_errors():
            self._servo.run_until_stalled(get_int(speed), completion(then), limit)
        return self._finish(returns_angle=True)

    def _finish(self, returns_angle: bool = False) -> Any:
        return self._awaited.finish(self._is_done, self._servo.angle_deg if returns_angle else None, self._servo.coast)

    def _is_done(self) -> bool:
        if not self._servo.is_open:
            raise os_error(errno.ENODEV)
        return self._servo.is_done()


def pupdevices_module(context: Context, parameters: Parameters) -> ModuleType:
    names: dict[str, Any] = {"PFMotor": PFMotor, **wireless((Remote, TechnicMoveHub, DuploTrain, MarioHub), context)}
    for kind in (Motor, DCMotor, *DEVICES):
        subclass: Any = bind(kind, context)
        subclass._parameters = parameters
        names[kind.__name__] = subclass
    if not context.machine.robot.hub.model.has_float:
        hide_attributes(names["Motor"], "control", "log", "model")
    return module("pupdevices", names)
