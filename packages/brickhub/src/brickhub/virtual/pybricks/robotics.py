"""``pybricks.robotics``."""

from __future__ import annotations

import errno
import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

from brickhub.errors import TwinError
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.car import Car
from brickhub.virtual.pybricks.common import Control, acceleration_pair, acceleration_value, magnitude
from brickhub.virtual.pybricks.context import (
    Awaited,
    Context,
    RunLoop,
    bind,
    charged,
    expect_type,
    firmware_errors,
    get_int,
    get_scaled,
    hide_attributes,
    os_error,
)
from brickhub.virtual.pybricks.parameters import Stop
from brickhub.virtual.pybricks.pupdevices import Motor, completion

_MAX_DISTANCE_MM = 2**15 - 1
_DEG_PER_RAD = 57.29578


class DriveBase:
    """Drive base of two motors: mm, degrees, clockwise positive."""

    _context: Context
    _machine: Machine
    _loop: RunLoop

    def __init__(self, left_motor: Any, right_motor: Any, wheel_diameter: Any, axle_track: Any) -> None:
        for motor in (left_motor, right_motor):
            expect_type(motor, Motor)
        sizes_um = get_scaled(wheel_diameter, 1000), get_scaled(axle_track, 1000)
        with firmware_errors():
            base = self._machine.new_drive_base(left_motor._servo, right_motor._servo, *sizes_um)
        self._base = base
        self._awaited = Awaited(self._loop)
        self._distance_control = Control(lambda: base.distance, self._context)
        self._heading_control = Control(lambda: base.heading, self._context)

    @property
    def distance_control(self) -> Control:
        return self._distance_control

    @property
    def heading_control(self) -> Control:
        return self._heading_control

    # ---- moves

    @charged
    def straight(self, distance: Any, then: Any = Stop.HOLD, wait: Any = True) -> Any:
        with firmware_errors():
            self._base.straight(get_int(distance), completion(then))
        return self._finish() if wait else None

    @charged
    def turn(self, angle: Any, then: Any = Stop.HOLD, wait: Any = True, absolute: Any = False) -> Any:
        with firmware_errors():
            if absolute:
                self._base.turn_to(get_int(angle), completion(then))
            else:
                self._base.turn(get_int(angle), completion(then))
        return self._finish() if wait else None

    @charged
    def move_by(self, dx: Any, dy: Any, then: Any = Stop.HOLD) -> Any:
        """Turn the shorter way and drive to a point, x ahead of heading 0 and y to its left. Direction and distance are truncated
        to whole degrees and mm."""
        x, y = get_int(dx), get_int(dy)
        direction = int(to_single(math.atan2(y, x) * _DEG_PER_RAD))
        if max(abs(x), abs(y)) > _MAX_DISTANCE_MM:
            raise ValueError("Invalid argument")
        with firmware_errors():
            self._base.turn_to(-direction, OnCompletion.HOLD)
        distance, end = int(to_single(math.sqrt(x * x + y * y))), completion(then)
        return self._finish(lambda: self._base.straight(distance, end))

    @charged
    def curve(self, radius: Any, angle: Any, then: Any = Stop.HOLD, wait: Any = True) -> Any:
        with firmware_errors():
            self._base.curve(get_int(radius), get_int(angle), completion(then))
        return self._finish() if wait else None

    @charged
    def arc(self, radius: Any, angle: Any = None, distance: Any = None, then: Any = Stop.HOLD, wait: Any = True) -> Any:
        radius_mm = get_int(radius)
        if (angle is None) == (distance is None):
            raise ValueError("Please specify distance or angle but not both.")
        with firmware_errors():
            if distance is not None:
                self._base.arc_distance(radius_mm, get_int(distance), completion(then))
            else:
                self._base.arc_angle(radius_mm, get_int(angle), completion(then))
        return self._finish() if wait else None

    @charged
    def drive(self, speed: Any, turn_rate: Any) -> None:
        rates = get_int(speed), get_int(turn_rate)
        self._awaited.cancel()
        with firmware_errors():
            self._base.drive(*rates)

    @charged
    def stop(self) -> None:
        self._end(OnCompletion.COAST)

    @charged
    def brake(self) -> None:
        self._end(OnCompletion.BRAKE)

    @charged
    def hold(self) -> None:
        self._end(OnCompletion.HOLD)

    # ---- state

    @charged
    def distance(self) -> int:
        return self._base.state()[0]

    @charged
    def angle(self) -> float:
        return to_single(self._base.angle_deg()) if self._machine.robot.hub.model.has_float else self._base.state()[2]

    @charged
    def state(self) -> tuple[int, int, int, int]:
        return self._base.state()

    def done(self) -> bool:
        self._machine.charge_call()
        return self._base.is_done()

    @charged
    def stalled(self) -> bool:
        with firmware_errors():
            return self._base.is_stalled()

    # ---- settings

    @charged
    def reset(self, distance: Any = 0, angle: Any = 0) -> None:
        values = get_int(distance), get_int(angle)
        with firmware_errors():
            self._base.reset(*values)

    @charged
    def use_gyro(self, use_gyro: Any) -> None:
        with firmware_errors():
            self._base.use_gyro(bool(use_gyro))

    @charged
    def settings(
        self,
        straight_speed: Any = None,
        straight_acceleration: Any = None,
        turn_rate: Any = None,
        turn_acceleration: Any = None,
    ) -> tuple[Any, ...] | None:
        distance, heading = self._base.distance.settings, self._base.heading.settings
        straight = distance.to_unit(distance.default_speed), *distance.limits()[1:3]
        turn = heading.to_unit(heading.default_speed), *heading.limits()[1:3]
        if all(value is None for value in (straight_speed, straight_acceleration, turn_rate, turn_acceleration)):
            return straight[0], acceleration_value(*straight[1:]), turn[0], acceleration_value(*turn[1:])
        with firmware_errors():
            self._base.set_settings(
                magnitude(straight_speed, straight[0]),
                acceleration_pair(straight_acceleration, *straight[1:]),
                magnitude(turn_rate, turn[0]),
                acceleration_pair(turn_acceleration, *turn[1:]),
            )
        return None

    def _end(self, then: OnCompletion) -> None:
        self._awaited.cancel()
        with firmware_errors():
            self._base.stop(then)

    def _finish(self, *others: Callable[[], None]) -> Any:
        """Wait for the started move, then start and wait for the ``others`` one by one. Raises TwinError for a turn by the
        gyroscope of a hub that never turns."""
        if self._base.turns_by_gyro and not getattr(self._machine.body, "turns_with_its_wheels", True):
            raise TwinError(
                "a turn by the gyroscope never ends on the bench, where the hub lies still; "
                "take a robot that drives, such as --robot two-wheeler, or leave use_gyro(True) out"
            )
        following = iter(others)

        def is_done() -> bool:
            if not self._is_done():
                return False
            start = next(following, None)
            if start is not None:
                start()
            return start is None

        return self._awaited.finish(is_done, None, lambda: self._end(OnCompletion.COAST))

    def _is_done(self) -> bool:
        if not self._base.is_open:
            raise os_error(errno.ENODEV)
        return self._base.is_done()


def robotics_module(context: Context) -> ModuleType:
    model = context.machine.robot.hub.model
    subclass = bind(DriveBase, context)
    if not model.has_imu:
        hide_attributes(subclass, "use_gyro")
    if not model.has_float:
        hide_attributes(subclass, "distance_control", "heading_control", "move_by")
    return module("robotics", {"DriveBase": subclass, "Car": bind(Car, context)})
