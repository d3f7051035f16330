"""``pybricks.robotics``: drive bases, and cars of which one motor steers and others drive."""

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

from brickhub.errors import TwinError
from brickhub.virtual import error_numbers
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.arguments import (
    expect,
    expect_type,
    get_int,
    get_scaled,
    os_error,
    percentage,
    truncated,
)
from brickhub.virtual.pybricks.context import Awaited, Context, Native, bind, firmware_errors
from brickhub.virtual.pybricks.parameters import Stop
from brickhub.virtual.pybricks.pupdevices import (
    Control,
    Motor,
    acceleration_pair,
    acceleration_value,
    completion,
    magnitude,
)

_MAX_DISTANCE_MM = 2**15 - 1
"""Largest way along x or y: the sum of both squares fits into 32 bits."""
_DEG_PER_RAD = 57.29578
# A Car searches for the end stops of its steering at this speed, and then stays  before them.
_STEERING_SPEED_DEG_S = 300
_POLL_MS = 10
_SEARCH_TIMEOUT_MS = 10_000
_BACKLASH_DEG = 10
_COAST_BELOW_PCT = 10
_MAX_DRIVE_MOTORS = 5


class DriveBase(Native):
    """Drive base of two motors: mm, degrees, clockwise positive."""

    def __init__(
        self,
        left_motor: Any,
        right_motor: Any,
        wheel_diameter: Any,
        axle_track: Any,
    ) -> None:
        for motor in (left_motor, right_motor):
            expect_type(motor, Motor)
        sizes_um = get_scaled(wheel_diameter, 1000), get_scaled(axle_track, 1000)
        with firmware_errors():
            base = self._machine.new_drive_base(left_motor._servo, right_motor._servo, *sizes_um)
        self._base = base
        self._awaited = Awaited(self._context)
        self.distance_control = Control(lambda: base.distance, self._context)
        self.heading_control = Control(lambda: base.heading, self._context)

    def straight(
        self,
        distance: Any,
        then: Any = Stop.HOLD,
        wait: Any = True,
    ) -> Any:
        self._base.straight(get_int(distance), completion(then))
        return self._finish() if wait else None

    def turn(
        self,
        angle: Any,
        then: Any = Stop.HOLD,
        wait: Any = True,
        absolute: Any = False,
    ) -> Any:
        if absolute:
            self._base.turn_to(get_int(angle), completion(then))
        else:
            self._base.turn(get_int(angle), completion(then))
        return self._finish() if wait else None

    def move_by(
        self,
        dx: Any,
        dy: Any,
        then: Any = Stop.HOLD,
    ) -> Any:
        """Turn the shorter way and drive to a point, x ahead of heading 0 and y to its left.
        Direction and distance are truncated to whole degrees and mm."""
        x = get_int(dx)
        y = get_int(dy)
        direction_deg = math.atan2(y, x) * _DEG_PER_RAD
        direction = truncated(to_single(direction_deg))
        expect(max(abs(x), abs(y)) <= _MAX_DISTANCE_MM)
        # Left is positive in y, but a heading counts clockwise.
        self._base.turn_to(-direction, OnCompletion.HOLD)
        length_mm = math.sqrt(x * x + y * y)
        distance = truncated(to_single(length_mm))
        end = completion(then)
        return self._finish(lambda: self._base.straight(distance, end))

    def curve(
        self,
        radius: Any,
        angle: Any,
        then: Any = Stop.HOLD,
        wait: Any = True,
    ) -> Any:
        radius_mm = get_int(radius)
        angle_deg = get_int(angle)
        self._base.curve(radius_mm, angle_deg, completion(then))
        return self._finish() if wait else None

    def arc(
        self,
        radius: Any,
        angle: Any = None,
        distance: Any = None,
        then: Any = Stop.HOLD,
        wait: Any = True,
    ) -> Any:
        radius_mm = get_int(radius)
        if (angle is None) == (distance is None):
            raise ValueError("Please specify distance or angle but not both.")
        if distance is None:
            self._base.arc(
                radius_mm,
                None,
                get_int(angle),
                completion(then),
            )
        else:
            self._base.arc(
                radius_mm,
                get_int(distance),
                0,
                completion(then),
            )
        return self._finish() if wait else None

    def drive(
        self,
        speed: Any,
        turn_rate: Any,
    ) -> None:
        speed_mm_s = get_int(speed)
        turn_rate_deg_s = get_int(turn_rate)
        # Whoever awaits the former move goes on, whether this one is accepted or not.
        self._awaited.cancel()
        self._base.drive(speed_mm_s, turn_rate_deg_s)

    def stop(self) -> None:
        self._end(OnCompletion.COAST)

    def brake(self) -> None:
        self._end(OnCompletion.BRAKE)

    def hold(self) -> None:
        self._end(OnCompletion.HOLD)

    def distance(self) -> int:
        return self._base.state()[0]

    def angle(self) -> float:
        if self._machine.robot.hub.model.has_float:
            return to_single(self._base.angle_deg())
        _, _, heading_deg, _ = self._base.state()
        return heading_deg

    def state(self) -> tuple[int, int, int, int]:
        return self._base.state()

    def done(self) -> bool:
        return self._base.is_done()

    def stalled(self) -> bool:
        return self._base.is_stalled()

    def reset(
        self,
        distance: Any = 0,
        angle: Any = 0,
    ) -> None:
        distance_mm = get_int(distance)
        angle_deg = get_int(angle)
        self._base.reset(distance_mm, angle_deg)

    def use_gyro(self, use_gyro: Any) -> None:
        self._base.use_gyro(bool(use_gyro))

    def settings(
        self,
        straight_speed: Any = None,
        straight_acceleration: Any = None,
        turn_rate: Any = None,
        turn_acceleration: Any = None,
    ) -> tuple[Any, ...] | None:
        distance = self._base.distance.settings
        heading = self._base.heading.settings
        now_speed = distance.to_unit(distance.default_speed)
        _, up, down, _ = distance.limits()
        now_turn_rate = heading.to_unit(heading.default_speed)
        _, turn_up, turn_down, _ = heading.limits()
        arguments = (straight_speed, straight_acceleration, turn_rate, turn_acceleration)
        if all(value is None for value in arguments):
            return (
                now_speed,
                acceleration_value(up, down),
                now_turn_rate,
                acceleration_value(turn_up, turn_down),
            )
        # Settings that are not named stay as they are, in the program's whole units.
        self._base.set_settings(
            magnitude(straight_speed, now_speed),
            acceleration_pair(straight_acceleration, up, down),
            magnitude(turn_rate, now_turn_rate),
            acceleration_pair(turn_acceleration, turn_up, turn_down),
        )
        return None

    def _end(self, then: OnCompletion) -> None:
        self._awaited.cancel()
        with firmware_errors():
            self._base.stop(then)

    def _finish(self, *others: Callable[[], None]) -> Any:
        """Wait for the started move, then start and wait for the ``others`` one by one. Raises
        TwinError for a turn by the gyroscope of a hub that never turns."""
        # Only a bench says that its hub does not turn.
        hub_turns = getattr(self._machine.body, "turns_with_its_wheels", True)
        if self._base.turns_by_gyro and not hub_turns:
            raise TwinError(
                "a turn by the gyroscope never ends on the bench, where the hub lies still; "
                "take a robot that drives, such as --robot two-wheeler, or leave use_gyro(True) out"
            )
        following = iter(others)

        def is_done() -> bool:
            if not self._base.is_open:
                raise os_error(error_numbers.ENODEV)
            if not self._base.is_done():
                return False
            start = next(following, None)
            if start is None:
                return True
            start()
            return False

        return self._awaited.finish(is_done, None, lambda: self._end(OnCompletion.COAST))


class Car(Native):
    """Finds the end stops of its steering at construction; the middle between them is straight
    ahead."""

    def __init__(
        self,
        steer_motor: Any,
        drive_motors: Any,
        torque_limit: Any = 100,
    ) -> None:
        self._steer = _servo(steer_motor)
        motors = drive_motors if isinstance(drive_motors, list | tuple) else [drive_motors]
        if not 1 <= len(motors) <= _MAX_DRIVE_MOTORS:
            raise ValueError(f"drive_motors must be a list of 1 to {_MAX_DRIVE_MOTORS} motors")
        self._drive = [_servo(motor) for motor in motors]
        if self._steer in self._drive:
            raise ValueError("drive_motors and steer_motor must be different")
        distinct = set(map(id, self._drive))
        if len(distinct) < len(self._drive):
            raise ValueError("drive_motors must be unique")
        limit_unm = self._steer.settings.max_torque * percentage(torque_limit) // 100
        left_deg = self._end_stop(-_STEERING_SPEED_DEG_S, limit_unm)
        right_deg = self._end_stop(_STEERING_SPEED_DEG_S, limit_unm)
        self._max_angle = int((right_deg - left_deg) / 2)
        # The motor is at its right end stop, so its zero is then in the middle.
        self._steer.reset_angle(self._max_angle)
        self._steer.track_target(0)

    def steer(self, percentage: Any) -> None:
        # The steering stays short of the end stops, against which the motor would push.
        usable_deg = self._max_angle - _BACKLASH_DEG
        target_deg = int(usable_deg * _percentage(percentage) / 100)
        self._steer.track_target(target_deg)

    def drive_power(self, power: Any) -> None:
        power_pct = _percentage(power)
        sign = (power_pct > 0) - (power_pct < 0)
        # As in the firmware, a power of 10 to 100 % becomes a duty of 28 to 100 %.
        duty_pct = int(power_pct * 8 / 10) + 20 * sign
        for servo in self._drive:
            if abs(power_pct) < _COAST_BELOW_PCT:
                servo.coast()
            else:
                servo.dc(duty_pct)

    def drive_speed(self, speed: Any) -> None:
        value = get_int(speed)
        for servo in self._drive:
            servo.run(value)

    def _end_stop(
        self,
        speed: int,
        torque_unm: int,
    ) -> int:
        self._context.assert_blocking()
        servo = self._steer
        start_ms = self._machine.time_ms
        servo.run_until_stalled(
            speed,
            OnCompletion.COAST,
            None,
            torque_unm,
        )
        while not servo.is_done():
            if self._machine.time_ms - start_ms > _SEARCH_TIMEOUT_MS:
                raise RuntimeError(
                    "The steering mechanism has no end stop. Did you build a car yet?"
                )
            self._machine.advance(_POLL_MS)
        return servo.angle_deg()


def _servo(motor: Any) -> Servo:
    expect_type(motor, Motor)
    return motor._servo  # type: ignore[no-any-return]


def _percentage(value: Any) -> int:
    return max(-100, min(100, get_int(value)))


def robotics_module(context: Context) -> ModuleType:
    model = context.machine.robot.hub.model
    hidden = []
    if not model.has_imu:
        hidden.append("use_gyro")
    if not model.has_float:
        hidden += ["distance_control", "heading_control", "move_by"]
    names = {"DriveBase": bind(context, DriveBase, *hidden), "Car": bind(context, Car)}
    return module("robotics", names)
