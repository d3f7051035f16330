"""``pybricks.robotics.Car``: one motor steers, others drive."""

from __future__ import annotations

from typing import Any

from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks.context import RunLoop, charged, expect_type, firmware_errors, get_int
from brickhub.virtual.pybricks.pupdevices import Motor

_STEERING_SPEED_DEG_S = 300
_POLL_MS = 10
_SEARCH_TIMEOUT_MS = 10_000
_BACKLASH_DEG = 10
_COAST_BELOW_PCT = 10
_MAX_DRIVE_MOTORS = 5


class Car:
    """Finds the end stops of its steering at construction; the middle between them is straight ahead."""

    _machine: Machine
    _loop: RunLoop

    def __init__(self, steer_motor: Any, drive_motors: Any, torque_limit: Any = 100) -> None:
        self._steer = _servo(steer_motor)
        motors = drive_motors if isinstance(drive_motors, list | tuple) else [drive_motors]
        if not 1 <= len(motors) <= _MAX_DRIVE_MOTORS:
            raise ValueError(f"drive_motors must be a list of 1 to {_MAX_DRIVE_MOTORS} motors")
        self._drive = [_servo(motor) for motor in motors]
        if self._steer in self._drive:
            raise ValueError("drive_motors and steer_motor must be different")
        if len(set(map(id, self._drive))) < len(self._drive):
            raise ValueError("drive_motors must be unique")
        limit = self._steer.settings.max_torque * max(0, min(100, get_int(torque_limit))) // 100
        left = self._end_stop(-_STEERING_SPEED_DEG_S, limit)
        right = self._end_stop(_STEERING_SPEED_DEG_S, limit)
        self._max_angle = int((right - left) / 2)
        self._steer.reset_angle(self._max_angle)
        self._steer.track_target(0)

    @charged
    def steer(self, percentage: Any) -> None:
        self._steer.track_target(int((self._max_angle - _BACKLASH_DEG) * _percentage(percentage) / 100))

    @charged
    def drive_power(self, power: Any) -> None:
        power_pct = _percentage(power)
        sign = (power_pct > 0) - (power_pct < 0)
        for servo in self._drive:
            if abs(power_pct) < _COAST_BELOW_PCT:
                servo.coast()
            else:
                servo.dc(int(power_pct * 8 / 10) + 20 * sign)

    @charged
    def drive_speed(self, speed: Any) -> None:
        value = get_int(speed)
        for servo in self._drive:
            with firmware_errors():
                servo.run(value)

    def _end_stop(self, speed: int, torque_unm: int) -> int:
        self._loop.assert_blocking()
        servo, start_ms = self._steer, self._machine.time_ms
        servo.run_until_stalled_with(speed, OnCompletion.COAST, torque_unm)
        while not servo.is_done():
            if self._machine.time_ms - start_ms > _SEARCH_TIMEOUT_MS:
                raise RuntimeError("The steering mechanism has no end stop. Did you build a car yet?")
            self._machine.advance(_POLL_MS)
        return servo.angle_deg()


def _servo(motor: Any) -> Servo:
    expect_type(motor, Motor)
    return motor._servo  # type: ignore[no-any-return]


def _percentage(value: Any) -> int:
    return max(-100, min(100, get_int(value)))
