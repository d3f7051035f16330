"""Two servos as a vehicle: one controller for the distance, one for the heading."""

from __future__ import annotations

import errno
from math import trunc
from typing import TYPE_CHECKING

from bricksrl.twin.firmware.control import Controller, OnCompletion, State
from bricksrl.twin.firmware.servo import Servo
from bricksrl.twin.firmware.settings import drive_base_settings
from bricksrl.twin.firmware.trajectory import validate_acceleration, validate_speed

if TYPE_CHECKING:
    from bricksrl.twin.machine import Machine

_TURN_MDEG_OVER_PI = 114_592
_INT32_MAX = 2**31 - 1


class DriveBaseControl:
    """Distances in mm, headings in degrees (clockwise positive).

    Attributes:
        left, right: the motors.
        distance, heading: what controls the mean of both, and what the left one is ahead of it.

    Raises:
        ValueError: the geometry is impossible, or both motors are the same, or their gears differ.
        OSError: EBUSY, a motor belongs to another drive base.
    """

    def __init__(self, left: Servo, right: Servo, wheel_diameter_um: int, axle_track_um: int, machine: Machine) -> None:
        steps = left.settings.steps_per_unit
        too_large = steps > _INT32_MAX // _TURN_MDEG_OVER_PI or steps > _INT32_MAX // max(axle_track_um, 1)
        if left is right or steps != right.settings.steps_per_unit:
            raise ValueError("a drive base needs two motors with the same gears")
        if wheel_diameter_um < 1000 or axle_track_um < 1000 or too_large:
            raise ValueError("the wheel diameter or the axle track is out of range")
        if left.parent is not None or right.parent is not None:
            raise OSError(errno.EBUSY, "a motor belongs to another drive base")
        self.left, self.right = left, right
        self._machine = machine
        distance, heading = drive_base_settings(left.settings, right.settings)
        heading.steps_per_unit = steps * axle_track_um // wheel_diameter_um
        distance.steps_per_unit = steps * _TURN_MDEG_OVER_PI // wheel_diameter_um
        if not (heading.steps_per_unit and distance.steps_per_unit):
            raise ValueError("the wheel diameter is out of range")
        self.distance, self.heading = Controller(distance), Controller(heading)
        self._paused = False
        self._uses_gyro = False
        self._distance_zero = self._heading_zero = 0
        left.parent = right.parent = self
        self.reset(0, 0)
        machine.drive_bases.append(self)

    def release(self) -> None:
        """Let both motors go."""
        self.left.parent = self.right.parent = None

    # ---- commands

    def straight(self, distance_mm: int, then: OnCompletion) -> None:
        self._drive_relative(distance_mm, 0, then)

    def curve(self, radius_mm: int, angle_deg: int, then: OnCompletion) -> None:
        """Turn by an angle along an arc; radius 0 turns in place, a negative one drives backwards."""
        length_mm = trunc(10 * abs(angle_deg) * radius_mm / 573)
        self._drive_relative(length_mm, -angle_deg if radius_mm < 0 else angle_deg, then)

    def turn_to(self, angle_deg: int, then: OnCompletion) -> None:
        """Turn in place until the heading is this angle."""
        heading = self._state()[1].position
        if self.heading.is_active:
            heading = self.heading.reference(self._machine.time_ticks, self._state()[1]).position
        self._move_relative(0, self.heading.settings.position_from_unit(angle_deg) - heading, then)

    def arc_distance(self, radius_mm: int, distance_mm: int, then: OnCompletion) -> None:
        """Drive a distance along an arc, to the right for a positive radius. Raises ValueError for radius 0."""
        if radius_mm == 0:
            raise ValueError("an arc with a distance needs a radius")
        self._drive_relative(distance_mm, trunc(distance_mm * 573 / (10 * radius_mm)), then)

    def arc_angle(self, radius_mm: int, angle_deg: int, then: OnCompletion) -> None:
        """Turn by an angle along an arc, to the right for a positive radius; a negative angle drives backwards."""
        length_mm = trunc(10 * angle_deg * abs(radius_mm) / 573)
        self._drive_relative(length_mm, -angle_deg if radius_mm < 0 else angle_deg, then)

    def drive(self, speed_mm_s: int, turn_rate_deg_s: int) -> None:
        """Drive on until another command."""
        distance, heading, time = *self._begin(), self._machine.time_ticks
        self.distance.start_forever(time, distance, self.distance.settings.from_unit(speed_mm_s))
        self.heading.start_forever(time, heading, self.heading.settings.from_unit(turn_rate_deg_s))

    def stop(self, then: OnCompletion) -> None:
        if then is OnCompletion.HOLD:
            self.straight(0, then)
            return
        self._stop_control()
        # As the servos' own stop, but without asking their parent, which is this.
        for servo in (self.left, self.right):
            servo.control.stop()
            servo.set_voltage(None if then.passive is OnCompletion.COAST else 0)

    def stop_from_servo(self) -> None:
        """A motor got a command of its own: stop controlling, let both coast."""
        if self.distance.is_active and self.heading.is_active:
            self._stop_control()
            self.left.set_voltage(None)
            self.right.set_voltage(None)

    def reset(self, distance_mm: int, angle_deg: int) -> None:
        """Count distance and heading from these values on; a running move stops."""
        self.stop(OnCompletion.COAST)
        distance, heading = self._state()
        self._distance_zero += distance.position - self.distance.settings.position_from_unit(distance_mm)
        self._heading_zero += heading.position - self.heading.settings.position_from_unit(angle_deg)

    def use_gyro(self, use: bool) -> None:
        """Take the heading from the hub's gyroscope instead of the wheels; a running move stops."""
        self.stop(OnCompletion.COAST)
        before = self._state()[1].position
        self._uses_gyro = use
        self._heading_zero += self._state()[1].position - before

    def set_settings(self, speed: int, acceleration: tuple[int, int], turn_rate: int, turn_acceleration: tuple[int, int]) -> None:
        """Defaults for moves; accelerations as (up, down). Raises ValueError, and changes nothing, when refused."""
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
        if self.distance.is_active and self.heading.is_active:
            return self.distance.is_stalled or self.heading.is_stalled
        return self.left.is_stalled() or self.right.is_stalled()

    def state(self) -> tuple[int, int, int, int]:
        """Distance (mm), speed (mm/s), heading (deg), turn rate (deg/s)."""
        distance, heading = self._state()
        sd, sh = self.distance.settings, self.heading.settings
        return (
            sd.position_to_unit(distance.position),
            sd.to_unit(distance.speed),
            sh.position_to_unit(heading.position),
            sh.to_unit(heading.speed),
        )

    def angle_deg(self) -> float:
        return self._state()[1].position / self.heading.settings.steps_per_unit

    # ---- the loop

    def update(self) -> None:
        """One control loop, before those of the servos."""
        if not (self.distance.is_active and self.heading.is_active):
            return
        time = self._machine.time_ms * 10
        distance, heading = self._state()
        action = self.distance.update(time, distance.position, distance.speed, distance.speed_estimate, self._paused)
        torque, speed, acceleration, end_of_distance, distance_at_limit = action
        action = self.heading.update(time, heading.position, heading.speed, heading.speed_estimate, self._paused)
        turn_torque, turn_speed, turn_acceleration, end_of_heading, heading_at_limit = action
        if self.distance.log.is_active:
            self.distance.log_row(self._machine.time_ms, distance, torque, end_of_distance)
        if self.heading.log.is_active:
            self.heading.log_row(self._machine.time_ms, heading, turn_torque, end_of_heading)
        # Both wait while one of them is at its limit, so that they arrive together.
        self._paused = distance_at_limit or heading_at_limit
        for end in (end_of_distance, end_of_heading):
            if end is not None:
                self.stop(end)
                return
        self.left.actuate(torque + turn_torque, speed + turn_speed, acceleration + turn_acceleration)
        self.right.actuate(torque - turn_torque, speed - turn_speed, acceleration - turn_acceleration)

    def _state(self) -> tuple[State, State]:
        """Mean of both motors, and what the left one is ahead of it."""
        left, right = self.left.state(), self.right.state()
        position = trunc((left.position + right.position) / 2)
        speed = trunc((left.speed + right.speed) / 2)
        estimate = trunc((left.speed_estimate + right.speed_estimate) / 2)
        angle = trunc((left.position_estimate + right.position_estimate) / 2)
        distance = State(position - self._distance_zero, speed, estimate, angle - self._distance_zero)
        turned = angle - right.position_estimate - self._heading_zero
        heading = State(position - right.position, speed - right.speed, estimate - right.speed_estimate, turned)
        if self._uses_gyro:
            body, steps = self._machine.body, self.heading.settings.steps_per_unit
            heading.position = trunc(body.heading_deg() * steps)
            heading.speed = trunc(-body.angular_velocity_deg_s()[2] * steps)
        heading.position -= self._heading_zero
        return distance, heading

    def _begin(self) -> tuple[State, State]:
        self.left.control.stop()
        self.right.control.stop()
        return self._state()

    def _drive_relative(self, distance_mm: int, angle_deg: int, then: OnCompletion) -> None:
        way, turn = self.distance.settings.position_from_unit(distance_mm), self.heading.settings.position_from_unit(angle_deg)
        self._move_relative(way, turn, then)

    def _move_relative(self, way: int, turn: int, then: OnCompletion) -> None:
        distance, heading, time = *self._begin(), self._machine.time_ticks
        self.distance.start_relative(time, distance, way, 0, then, allow_shift=False)
        self.heading.start_relative(time, heading, turn, 0, then, allow_shift=False)
        leader, follower = self.heading.trajectory, self.distance.trajectory
        if follower.t3 > leader.t3:
            leader, follower = follower, leader
        follower.stretch(leader)

    def _stop_control(self) -> None:
        self.distance.stop()
        self.heading.stop()
        self._paused = False
