"""Drive base of two servos: one controller for the distance, one for the heading."""

from __future__ import annotations

import errno
from collections.abc import Callable
from math import trunc

from brickhub.virtual.firmware.angle import Angle, difference, from_unit, mean, to_mdeg, to_unit, to_unit_float
from brickhub.virtual.firmware.control import Controller, ControlType, OnCompletion, State
from brickhub.virtual.firmware.heading import GyroHeading
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.firmware.settings import drive_base_settings
from brickhub.virtual.firmware.trajectory import validate_acceleration, validate_speed

_TURN_MDEG_OVER_PI = 114_592
_MIN_RADIUS_MM = 10
_INT32_MAX = 2**31 - 1
_NONE = ControlType.NONE

_Values = tuple[int, int, int, int]
"""Fields of a ``State``, as a tuple: creating an object in the control loop costs as much as the computation."""


class DriveBaseControl:
    """Distances in mm, headings in degrees (clockwise positive).

    Attributes:
        left, right: the motors.
        distance, heading: controllers of the mean of both motors, and of the left motor's lead over it.

    Raises:
        ValueError: the geometry is out of range, both motors are the same, or their gears differ.
        OSError: EBUSY, a motor belongs to another drive base; ENODEV, it is closed.
    """

    def __init__(self, left: Servo, right: Servo, wheel_diameter_um: int, axle_track_um: int, heading: GyroHeading) -> None:
        steps = left.settings.steps_per_unit
        if left is right or steps != right.settings.steps_per_unit:
            raise ValueError("a drive base needs two motors with the same gears")
        if left.parent is not None or right.parent is not None:
            raise OSError(errno.EBUSY, "a motor belongs to another drive base")
        self.left, self.right = left, right
        self._clock, self._gyro = left.clock, heading
        # As in the firmware, both motors now belong to it, even if its geometry is refused below.
        left.parent = right.parent = self
        distance_settings, heading_settings = drive_base_settings(left.settings, right.settings)
        self.distance, self.heading = Controller(distance_settings), Controller(heading_settings)
        self._paused = False
        self._uses_gyro = False
        self._set_zero((0, 0), (0, 0))
        self.stop(OnCompletion.COAST)
        too_large = steps > _INT32_MAX // _TURN_MDEG_OVER_PI or steps > _INT32_MAX // max(axle_track_um, 1)
        if wheel_diameter_um < 1000 or axle_track_um < 1000 or too_large:
            raise ValueError("the wheel diameter or the axle track is out of range")
        heading_settings.steps_per_unit = steps * axle_track_um // wheel_diameter_um
        distance_settings.steps_per_unit = steps * _TURN_MDEG_OVER_PI // wheel_diameter_um
        if not (heading_settings.steps_per_unit and distance_settings.steps_per_unit):
            raise ValueError("the wheel diameter is out of range")
        self.reset(0, 0)

    @property
    def is_open(self) -> bool:
        """Whether its control loop runs: both motors are open and belong to it."""
        left, right = self.left, self.right
        return left.parent is self and right.parent is self and left.is_open and right.is_open

    def release(self) -> None:
        """Release both motors."""
        self.left.parent = self.right.parent = None

    # ---- commands

    def straight(self, distance_mm: int, then: OnCompletion) -> None:
        self._drive_relative(distance_mm, 0, then)

    def curve(self, radius_mm: int, angle_deg: int, then: OnCompletion) -> None:
        """Turn by an angle along an arc; radius 0 turns in place, a negative radius drives backwards."""
        length_mm = trunc(10 * abs(angle_deg) * radius_mm / 573)
        self._drive_relative(length_mm, -angle_deg if radius_mm < 0 else angle_deg, then)

    def turn(self, angle_deg: int, then: OnCompletion) -> None:
        """Turn in place by an angle."""
        self._turn(lambda time, state: self._turn_by(time, state, angle_deg, then), then)

    def turn_to(self, angle_deg: int, then: OnCompletion) -> None:
        """Turn in place to a heading modulo 360 degrees, the shorter way."""
        self._turn(lambda time, state: self._turn_up_to(time, state, angle_deg, then), then)

    def _turn_by(self, time: int, state: State, angle_deg: int, then: OnCompletion) -> None:
        distance = self.heading.settings.position_from_unit(angle_deg)
        self.heading.start_relative(time, state, distance, 0, then, allow_shift=False)

    def _turn_up_to(self, time: int, state: State, angle_deg: int, then: OnCompletion) -> None:
        settings = self.heading.settings
        remaining = angle_deg - to_unit(self._angles()[1], settings.steps_per_unit)
        turns = -(-(remaining - 180) // 360) if remaining > 180 else -(-(-180 - remaining) // 360) if remaining < -180 else 0
        target = angle_deg - 360 * turns if remaining > 0 else angle_deg + 360 * turns
        self.heading.start_position(time, state, settings.position_from_unit(target), 0, then)

    def _turn(self, start: Callable[[int, State], None], then: OnCompletion) -> None:
        """Turn in place and hold the distance for the same time, even if stopping takes longer."""
        distance, heading, time = *self._begin(), self._clock.time_ticks
        self.distance.start_relative(time, distance, 0, 0, then, allow_shift=False)
        start(time, heading)
        self.distance.trajectory.stretch(self.heading.trajectory)

    def arc_distance(self, radius_mm: int, distance_mm: int, then: OnCompletion) -> None:
        """Drive a distance along an arc, to the right for a positive radius. Raises ValueError for a radius under 10 mm."""
        _check_radius(radius_mm)
        angle_deg = abs(distance_mm) * 573 // abs(radius_mm) // 10
        self._drive_relative(distance_mm, angle_deg if (radius_mm < 0) == (distance_mm < 0) else -angle_deg, then)

    def arc_angle(self, radius_mm: int, angle_deg: int, then: OnCompletion) -> None:
        """Turn by an angle along an arc, to the right for a positive radius; a negative angle drives backwards. Raises
        ValueError for a radius under 10 mm."""
        _check_radius(radius_mm)
        length_mm = trunc(10 * angle_deg * abs(radius_mm) / 573)
        self._drive_relative(length_mm, -angle_deg if radius_mm < 0 else angle_deg, then)

    def drive(self, speed_mm_s: int, turn_rate_deg_s: int) -> None:
        """Drive until the next command."""
        distance, heading, time = *self._begin(), self._clock.time_ticks
        self.distance.start_forever(time, distance, self.distance.settings.from_unit(speed_mm_s))
        self.heading.start_forever(time, heading, self.heading.settings.from_unit(turn_rate_deg_s))

    def stop(self, then: OnCompletion) -> None:
        """Stop both motors. Raises OSError (ENODEV) if one is closed."""
        self._check_open()
        if then is OnCompletion.HOLD:
            self.straight(0, then)
            return
        self._stop_control()
        # Not Servo.stop, which would call back stop_from_servo.
        for servo in (self.left, self.right):
            servo.control.stop()
            servo.set_voltage(None if then.passive is OnCompletion.COAST else 0)

    def stop_from_servo(self) -> None:
        """Stop controlling and let both motors coast, because one got another command."""
        if self.distance.is_active and self.heading.is_active:
            self._stop_control()
            self.left.set_voltage(None)
            self.right.set_voltage(None)

    def reset(self, distance_mm: int, angle_deg: int) -> None:
        """Set distance and heading, also the gyroscope's if in use; a running move stops."""
        self.stop(OnCompletion.COAST)
        distance, heading = self._wheel_angles()
        new_distance = from_unit(distance_mm, self.distance.settings.steps_per_unit)
        new_heading = from_unit(angle_deg, self.heading.settings.steps_per_unit)
        self._set_zero(difference(distance, new_distance), difference(heading, new_heading))
        if self._uses_gyro:
            self._gyro.set_angle(float(angle_deg))

    def use_gyro(self, use: bool) -> None:
        """Take the heading from the hub's gyroscope or from the wheels; each has its own zero. A change stops a running move."""
        if use is not self._uses_gyro:
            self.stop(OnCompletion.COAST)
            self._uses_gyro = use

    @property
    def needs_gyro(self) -> bool:
        """Whether a move or hold uses the gyroscope, whose heading must not be set then."""
        return self._uses_gyro and self.is_open and (self.distance.is_active or self.heading.is_active)

    @property
    def turns_by_gyro(self) -> bool:
        """Whether the current move ends only after the gyroscope has turned."""
        remaining = self.heading.trajectory.end.position - self._state()[1].position
        return self._uses_gyro and self.heading.is_active and abs(remaining) > self.heading.settings.position_tolerance

    def set_settings(self, speed: int, acceleration: tuple[int, int], turn_rate: int, turn_acceleration: tuple[int, int]) -> None:
        """Set the defaults of moves; accelerations as (up, down). Raises ValueError, without a change, for one out of range."""
        pairs = ((self.distance.settings, speed, acceleration), (self.heading.settings, turn_rate, turn_acceleration))
        for settings, rate, (up, down) in pairs:
            validate_speed(settings.steps_per_unit, rate)
            validate_acceleration(settings.steps_per_unit, up)
            validate_acceleration(settings.steps_per_unit, down)
        for settings, rate, (up, down) in pairs:
            settings.default_speed = min(settings.from_unit(rate), settings.max_speed)
            settings.acceleration, settings.deceleration = settings.from_unit(up), settings.from_unit(down)

    # ---- state

    def is_done(self) -> bool:
        return self.distance.is_done and self.heading.is_done

    def is_stalled(self) -> bool:
        self._check_open()
        if self.distance.is_active and self.heading.is_active:
            return self.distance.is_stalled or self.heading.is_stalled
        return self.left.is_stalled() or self.right.is_stalled()

    def state(self) -> tuple[int, int, int, int]:
        """Distance (mm), speed (mm/s), heading (deg), turn rate (deg/s)."""
        distance, heading = self._state()
        distance_angle, heading_angle = self._angles()
        sd, sh = self.distance.settings, self.heading.settings
        return (
            to_unit(distance_angle, sd.steps_per_unit),
            sd.to_unit(distance.speed),
            to_unit(heading_angle, sh.steps_per_unit),
            sh.to_unit(heading.speed),
        )

    def angle_deg(self) -> float:
        return to_unit_float(self._angles()[1], self.heading.settings.steps_per_unit)

    # ---- the loop

    def update(self) -> None:
        """One control step, before those of the servos."""
        distance, heading = self.distance, self.heading
        if distance.type is _NONE or heading.type is _NONE or not self.is_open:
            return
        time = self._clock.time_ms * 10
        distance_state, heading_state = self._measured()
        action = distance.update(time, *distance_state[:3], self._paused)
        torque, speed, acceleration, end_of_distance, distance_at_limit = action
        action = heading.update(time, *heading_state[:3], self._paused)
        turn_torque, turn_speed, turn_acceleration, end_of_heading, heading_at_limit = action
        if distance.log.is_active:
            distance.log_row(self._clock.time_ms, State(*distance_state), torque, end_of_distance)
        if heading.log.is_active:
            heading.log_row(self._clock.time_ms, State(*heading_state), turn_torque, end_of_heading)
        # Both pause while one is saturated, so that they arrive together.
        self._paused = distance_at_limit or heading_at_limit
        for end in (end_of_distance, end_of_heading):
            if end is not None:
                self.stop(end)
                return
        self.left.actuate(torque + turn_torque, speed + turn_speed, acceleration + turn_acceleration)
        self.right.actuate(torque - turn_torque, speed - turn_speed, acceleration - turn_acceleration)

    def _state(self) -> tuple[State, State]:
        """Distance and heading."""
        distance, heading = self._measured()
        return State(*distance), State(*heading)

    def _measured(self) -> tuple[_Values, _Values]:
        """Distance and heading. The gyroscope gives only position and speed of the heading; the estimates are the motors'."""
        distance, heading = self._measured_by_motors()
        if self._uses_gyro:
            gyro, steps = self._gyro, self.heading.settings.steps_per_unit
            heading = to_mdeg(gyro.angle(steps)), trunc(gyro.rate_deg_s() * steps), *heading[2:]
        return distance, heading

    def _angles(self) -> tuple[Angle, Angle]:
        """Distance and heading as the firmware stores them."""
        distance, heading = self._wheel_angles()
        if self._uses_gyro:
            heading = self._gyro.angle(self.heading.settings.steps_per_unit)
        else:
            heading = difference(heading, self._heading_zero)
        return difference(distance, self._distance_zero), heading

    def _wheel_angles(self) -> tuple[Angle, Angle]:
        """Mean of both motors and the left one's lead over it, from the zeros of the motors."""
        right = self.right.angle()
        distance = mean(self.left.angle(), right)
        return distance, difference(distance, right)

    def _set_zero(self, distance: Angle, heading: Angle) -> None:
        self._distance_zero, self._heading_zero = distance, heading
        self._distance_zero_mdeg, self._heading_zero_mdeg = to_mdeg(distance), to_mdeg(heading)

    def _measured_by_motors(self) -> tuple[_Values, _Values]:
        """Distance and heading by the motors."""
        right_position, left, right = self.right.position(), self.left.observer, self.right.observer
        position, is_odd = divmod(self.left.position() + right_position, 2)
        if is_odd:
            position = to_mdeg(mean(self.left.angle(), self.right.angle()))
        speed = trunc((left.measured_speed + right.measured_speed) / 2)
        estimate = trunc((left.speed + right.speed) / 2)
        angle = trunc((left.angle + right.angle) / 2)
        distance_zero, heading_zero = self._distance_zero_mdeg, self._heading_zero_mdeg
        lead, lead_estimate = position - right_position - heading_zero, angle - right.angle - heading_zero
        distance = position - distance_zero, speed, estimate, angle - distance_zero
        return distance, (lead, speed - right.measured_speed, estimate - right.speed, lead_estimate)

    def _check_open(self) -> None:
        if not self.is_open:
            raise OSError(errno.ENODEV, "a motor of the drive base is closed")

    def _begin(self) -> tuple[State, State]:
        """Take over both motors and return their state. Raises OSError (ENODEV) if one is closed."""
        self._check_open()
        self.left.control.stop()
        self.right.control.stop()
        return self._state()

    def _drive_relative(self, distance_mm: int, angle_deg: int, then: OnCompletion) -> None:
        length, turn = self.distance.settings.position_from_unit(distance_mm), self.heading.settings.position_from_unit(angle_deg)
        distance, heading, time = *self._begin(), self._clock.time_ticks
        self.distance.start_relative(time, distance, length, 0, then, allow_shift=False)
        self.heading.start_relative(time, heading, turn, 0, then, allow_shift=False)
        leader, follower = self.heading.trajectory, self.distance.trajectory
        if follower.t3 > leader.t3:
            leader, follower = follower, leader
        follower.stretch(leader)

    def _stop_control(self) -> None:
        self.distance.stop()
        self.heading.stop()
        self._paused = False


def _check_radius(radius_mm: int) -> None:
    if abs(radius_mm) < _MIN_RADIUS_MM:
        raise ValueError("the radius of an arc is too small")
