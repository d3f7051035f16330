"""Drive base of two servos: one controller for the distance, one for the heading.

The gyroscope's heading is that of ``pbio/imu.c``, v4, shared by ``hub.imu`` and all drive bases.
"""

from collections.abc import Callable
from math import trunc
from operator import add, sub

from brickhub.virtual import error_numbers
from brickhub.virtual.body import Body
from brickhub.virtual.firmware import RefusedError, UnavailableError
from brickhub.virtual.firmware.angle import (
    Angle,
    difference,
    from_unit,
    mean,
    single,
    to_mdeg,
    to_unit,
    to_unit_float,
)
from brickhub.virtual.firmware.control import Controller, ControlType, OnCompletion, State
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.firmware.settings import drive_base_settings
from brickhub.virtual.firmware.trajectory import (
    INT32_MAX,
    TURN_MDEG,
    validate_acceleration,
    validate_speed,
)

_Vector = tuple[float, float, float]
# A wheel turns by this many mdeg over a way as long as its diameter; it is an integer, as in the
# firmware.
_TURN_MDEG_OVER_PI = 114_592
# An arc turns by its length over its radius, which must therefore not be 0.
_MIN_RADIUS_MM = 10
_NONE = ControlType.NONE


class GyroHeading:
    """Degrees, clockwise positive seen from above, not wrapped.

    Attributes:
        frame: directions of the hub's front, left and top in the frame of the robot.
        turn_deg: reading of the heading for a whole turn, by which a program corrects it.
    """

    def __init__(self, body: Body) -> None:
        self._body = body
        self.frame: tuple[_Vector, _Vector, _Vector] = (
            (1.0, 0.0, 0.0),
            (0.0, 1.0, 0.0),
            (0.0, 0.0, 1.0),
        )
        self.turn_deg = 360.0
        self._gyro_deg: _Vector = (360.0, 360.0, 360.0)
        self._yaw_deg = 0.0
        self._rotation_deg: _Vector = (0.0, 0.0, 0.0)
        self._zero_deg = self._total_deg()

    def angle_deg(self) -> float:
        return self._total_deg() - self._zero_deg

    def angle(self, steps_per_deg: int) -> Angle:
        """Heading in control units, in single precision as in the firmware."""
        angle_deg = single(self.angle_deg())
        turn_deg = single(TURN_MDEG / steps_per_deg)
        turns = trunc(single(angle_deg / turn_deg))
        rest = single(angle_deg - single(turns * turn_deg))
        return turns, trunc(single(rest * steps_per_deg))

    def set_angle(self, angle_deg: float) -> None:
        """Set the present heading."""
        self._zero_deg = self._total_deg() - angle_deg

    def rate_deg_s(self) -> float:
        """Angular velocity about the robot's vertical axis, clockwise."""
        # The gyroscope counts counterclockwise about the vertical, but a heading counts clockwise.
        return -sum(
            rate * axis[2] for rate, axis in zip(self.rates_deg_s(), self.frame, strict=True)
        )

    def rates_deg_s(self, *, calibrated: bool = True) -> _Vector:
        """Angular velocity in the frame of the hub."""
        rates = self._body.angular_velocity_deg_s()
        return self._scaled(rates) if calibrated else rates

    def rotation_deg(self, *, calibrated: bool) -> _Vector:
        """Angular velocity in the frame of the hub, integrated over time."""
        scaled = self._scaled(self._body.rotation_deg())
        x, y, z = map(add, scaled, self._rotation_deg)
        turn_deg = (360.0, 360.0, 360.0) if calibrated else self._gyro_deg
        scale_x, scale_y, scale_z = turn_deg
        return (
            x * scale_x / 360.0,
            y * scale_y / 360.0,
            z * scale_z / 360.0,
        )

    def yaw_deg(self) -> float:
        """Rotation about the vertical since the hub was switched on, without the correction of the
        heading."""
        # The corrections of the hub's three axes are weighed by the vertical's components in its
        # frame.
        scale = sum(
            axis[2] ** 2 * 360.0 / turn_deg
            for axis, turn_deg in zip(self.frame, self._gyro_deg, strict=True)
        )
        return self._body.heading_deg() * scale + self._yaw_deg

    def calibrate(self, gyro_deg: _Vector) -> None:
        """Set the reading of the gyroscope for a whole turn about each axis of the hub; earlier
        rotation stays."""
        # A hub scales each sample as it comes, but this one the whole rotation. So what was
        # measured with the former scale is kept in offsets.
        yaw_deg = self.yaw_deg()
        rotation_deg = self.rotation_deg(calibrated=True)
        self._gyro_deg = gyro_deg
        self._yaw_deg += yaw_deg - self.yaw_deg()
        scaled = self._scaled(self._body.rotation_deg())
        x, y, z = map(sub, rotation_deg, scaled)
        self._rotation_deg = x, y, z

    def _scaled(self, vector: _Vector) -> _Vector:
        (x, y, z) = vector
        (scale_x, scale_y, scale_z) = self._gyro_deg
        return (
            x * 360.0 / scale_x,
            y * 360.0 / scale_y,
            z * 360.0 / scale_z,
        )

    def _total_deg(self) -> float:
        return self.yaw_deg() * (360.0 / self.turn_deg)


class DriveBaseControl:
    """Distances in mm, headings in degrees (clockwise positive).

    Attributes:
        left, right: the motors.
        distance, heading: controllers of the mean of both motors, and of the left motor's lead over
            it.

    Raises:
        ValueError: the geometry is out of range, both motors are the same, or their gears differ.
        OSError: EBUSY, a motor belongs to another drive base; ENODEV, it is closed.
    """

    def __init__(
        self,
        left: Servo,
        right: Servo,
        wheel_diameter_um: int,
        axle_track_um: int,
        heading: GyroHeading,
    ) -> None:
        steps = left.settings.steps_per_unit
        if left is right or steps != right.settings.steps_per_unit:
            raise RefusedError("a drive base needs two motors with the same gears")
        if left.parent is not None or right.parent is not None:
            raise UnavailableError(error_numbers.EBUSY, "a motor belongs to another drive base")
        self.left = left
        self.right = right
        self._clock = left.clock
        self._gyro = heading
        # Both motors belong to the drive base from now on, even if its geometry is refused below,
        # as in the firmware.
        left.parent = right.parent = self
        distance_settings, heading_settings = drive_base_settings(left.settings, right.settings)
        self.distance = Controller(distance_settings)
        self.heading = Controller(heading_settings)
        self._paused = False
        self._uses_gyro = False
        self._set_zero((0, 0), (0, 0))
        self.stop(OnCompletion.COAST)
        # The products below must fit into 32 bits on a hub.
        largest_factor = max(_TURN_MDEG_OVER_PI, axle_track_um, 1)
        too_large = steps > INT32_MAX // largest_factor
        too_small = wheel_diameter_um < 1000 or axle_track_um < 1000
        if too_small or too_large:
            raise RefusedError("the wheel diameter or the axle track is out of range")
        heading_settings.steps_per_unit = steps * axle_track_um // wheel_diameter_um
        distance_settings.steps_per_unit = steps * _TURN_MDEG_OVER_PI // wheel_diameter_um
        if not (heading_settings.steps_per_unit and distance_settings.steps_per_unit):
            raise RefusedError("the wheel diameter is out of range")
        self.reset(0, 0)

    @property
    def is_open(self) -> bool:
        """Whether the control loop runs: both motors are open and belong to this drive base."""
        left = self.left
        right = self.right
        owns_both = left.parent is self and right.parent is self
        return owns_both and left.is_open and right.is_open

    def release(self) -> None:
        """Release both motors."""
        self.left.parent = self.right.parent = None

    def straight(
        self,
        distance_mm: int,
        then: OnCompletion,
    ) -> None:
        self._drive_relative(distance_mm, 0, then)

    def curve(
        self,
        radius_mm: int,
        angle_deg: int,
        then: OnCompletion,
    ) -> None:
        """Turn by an angle along an arc; radius 0 turns in place, a negative radius drives
        backwards."""
        # The firmware's integers take 573 for ten times the degrees of a radian.
        length_mm = trunc(10 * abs(angle_deg) * radius_mm / 573)
        turn_deg = -angle_deg if radius_mm < 0 else angle_deg
        self._drive_relative(length_mm, turn_deg, then)

    def turn(
        self,
        angle_deg: int,
        then: OnCompletion,
    ) -> None:
        """Turn in place by an angle."""
        heading = self.heading
        way = angle_deg * heading.settings.steps_per_unit

        def start(time: int, state: State) -> None:
            heading.start_relative(
                time,
                state,
                way,
                0,
                then,
                allow_shift=False,
            )

        self._turn(start, then)

    def turn_to(
        self,
        angle_deg: int,
        then: OnCompletion,
    ) -> None:
        """Turn in place to a heading modulo 360 degrees, the shorter way."""
        heading = self.heading
        steps_per_deg = heading.settings.steps_per_unit
        _, present_heading = self._angles()
        remaining = angle_deg - to_unit(present_heading, steps_per_deg)
        # Whole turns are left out, rounded up, so that at most half a turn remains. Exactly half a
        # turn keeps its direction.
        if remaining > 180:
            turns = -(-(remaining - 180) // 360)
        elif remaining < -180:
            turns = -(-(-180 - remaining) // 360)
        else:
            turns = 0
        if remaining < 0:
            turns = -turns
        target = (angle_deg - 360 * turns) * steps_per_deg

        def start(time: int, state: State) -> None:
            heading.start_position(
                time,
                state,
                target,
                0,
                then,
            )

        self._turn(start, then)

    def _turn(
        self,
        start: Callable[[int, State], None],
        then: OnCompletion,
    ) -> None:
        """Turn in place and hold the distance for the same time, even if stopping takes longer."""
        distance, heading = self._begin()
        time = self._clock.time_ticks
        self.distance.start_relative(
            time,
            distance,
            0,
            0,
            then,
            allow_shift=False,
        )
        start(time, heading)
        self.distance.trajectory.stretch(self.heading.trajectory)

    def arc(
        self,
        radius_mm: int,
        distance_mm: int | None,
        angle_deg: int,
        then: OnCompletion,
    ) -> None:
        """Drive a distance, or turn by an angle, along an arc, to the right for a positive radius;
        negative ones drive backwards. Raises RefusedError for a radius under 10 mm."""
        if abs(radius_mm) < _MIN_RADIUS_MM:
            raise RefusedError("the radius of an arc is too small")
        if distance_mm is None:
            distance_mm = trunc(10 * angle_deg * abs(radius_mm) / 573)
            goes_right = radius_mm >= 0
        else:
            angle_deg = abs(distance_mm) * 573 // abs(radius_mm) // 10
            # Driving backward around a center on the left turns right as well.
            goes_right = (radius_mm < 0) == (distance_mm < 0)
        turn_deg = angle_deg if goes_right else -angle_deg
        self._drive_relative(distance_mm, turn_deg, then)

    def drive(
        self,
        speed_mm_s: int,
        turn_rate_deg_s: int,
    ) -> None:
        """Drive until the next command."""
        distance, heading = self._begin()
        time = self._clock.time_ticks
        speed = self.distance.settings.from_unit(speed_mm_s)
        turn_rate = self.heading.settings.from_unit(turn_rate_deg_s)
        self.distance.start_forever(time, distance, speed)
        self.heading.start_forever(time, heading, turn_rate)

    def stop(self, then: OnCompletion) -> None:
        """Stop both motors. Raises OSError (ENODEV) if one is closed."""
        self._check_open()
        # Holding needs the two controllers of the drive base, and not those of its motors.
        if then is OnCompletion.HOLD:
            self.straight(0, then)
            return
        self._stop_control()
        # `Servo.stop` would call `stop_from_servo` back, so it is not used.
        for servo in (self.left, self.right):
            servo.control.stop()
            servo.set_voltage(None if then.passive is OnCompletion.COAST else 0)

    def stop_from_servo(self) -> None:
        """Stop controlling and let both motors coast, because one got another command."""
        if self.distance.is_active and self.heading.is_active:
            self._stop_control()
            self.left.set_voltage(None)
            self.right.set_voltage(None)

    def reset(
        self,
        distance_mm: int,
        angle_deg: int,
    ) -> None:
        """Set distance and heading, also the gyroscope's if in use; a running move stops."""
        self.stop(OnCompletion.COAST)
        # Only the zeros of the drive base move, while the motors keep their angles.
        distance, heading = self._wheel_angles()
        new_distance = from_unit(distance_mm, self.distance.settings.steps_per_unit)
        new_heading = from_unit(angle_deg, self.heading.settings.steps_per_unit)
        self._set_zero(difference(distance, new_distance), difference(heading, new_heading))
        if self._uses_gyro:
            self._gyro.set_angle(float(angle_deg))

    def use_gyro(self, use: bool) -> None:
        """Take the heading from the hub's gyroscope or from the wheels; each has its own zero. A
        change stops a running move."""
        if use is not self._uses_gyro:
            self.stop(OnCompletion.COAST)
            self._uses_gyro = use

    @property
    def needs_gyro(self) -> bool:
        """Whether a move or hold uses the gyroscope, whose heading must not be set then."""
        if not self._uses_gyro or not self.is_open:
            return False
        return self.distance.is_active or self.heading.is_active

    @property
    def turns_by_gyro(self) -> bool:
        """Whether the current move ends only after the gyroscope has turned."""
        _, heading = self._measured()
        remaining = self.heading.trajectory.end.position - heading.position
        is_turning = abs(remaining) > self.heading.settings.position_tolerance
        return self._uses_gyro and self.heading.is_active and is_turning

    def set_settings(
        self,
        speed: int,
        acceleration: tuple[int, int],
        turn_rate: int,
        turn_acceleration: tuple[int, int],
    ) -> None:
        """Set the defaults of moves; accelerations as (up, down). Raises ValueError, without a
        change, for one out of range."""
        pairs = (
            (self.distance.settings, speed, acceleration),
            (self.heading.settings, turn_rate, turn_acceleration),
        )
        # Everything is checked before anything is set, so that a refusal changes nothing.
        for settings, rate, (up, down) in pairs:
            validate_speed(settings.steps_per_unit, rate)
            validate_acceleration(settings.steps_per_unit, up)
            validate_acceleration(settings.steps_per_unit, down)
        for settings, rate, (up, down) in pairs:
            settings.default_speed = min(settings.from_unit(rate), settings.max_speed)
            settings.acceleration = settings.from_unit(up)
            settings.deceleration = settings.from_unit(down)

    def is_done(self) -> bool:
        return self.distance.is_done and self.heading.is_done

    def is_stalled(self) -> bool:
        self._check_open()
        if self.distance.is_active and self.heading.is_active:
            return self.distance.is_stalled or self.heading.is_stalled
        return self.left.is_stalled() or self.right.is_stalled()

    def state(self) -> tuple[int, int, int, int]:
        """Distance (mm), speed (mm/s), heading (deg), turn rate (deg/s)."""
        distance, heading = self._measured()
        distance_angle, heading_angle = self._angles()
        distance_settings = self.distance.settings
        heading_settings = self.heading.settings
        return (
            to_unit(distance_angle, distance_settings.steps_per_unit),
            distance_settings.to_unit(distance.speed),
            to_unit(heading_angle, heading_settings.steps_per_unit),
            heading_settings.to_unit(heading.speed),
        )

    def angle_deg(self) -> float:
        _, heading = self._angles()
        return to_unit_float(heading, self.heading.settings.steps_per_unit)

    def update(self) -> None:
        """One control step, before those of the servos."""
        distance = self.distance
        heading = self.heading
        if distance.type is _NONE or heading.type is _NONE or not self.is_open:
            return
        time = self._clock.time_ms * 10
        # Both controllers see the same moment, before either of them acts.
        distance_state, heading_state = self._measured()
        action = distance.update(time, *distance_state[:3], self._paused)
        torque, speed, acceleration, end_of_distance, distance_at_limit = action
        action = heading.update(time, *heading_state[:3], self._paused)
        turn_torque, turn_speed, turn_acceleration, end_of_heading, heading_at_limit = action
        if distance.log.is_active:
            distance.log_row(
                self._clock.time_ms,
                distance_state,
                torque,
                end_of_distance,
            )
        if heading.log.is_active:
            heading.log_row(
                self._clock.time_ms,
                heading_state,
                turn_torque,
                end_of_heading,
            )
        # Both pause while one of them is saturated, so that they arrive together.
        self._paused = distance_at_limit or heading_at_limit
        # The first controller that becomes passive ends the move of both.
        for end in (end_of_distance, end_of_heading):
            if end is not None:
                self.stop(end)
                return
        # The heading is the left motor's lead over the mean, so it is added on the left.
        self.left.actuate(
            torque + turn_torque, speed + turn_speed, acceleration + turn_acceleration
        )
        self.right.actuate(
            torque - turn_torque, speed - turn_speed, acceleration - turn_acceleration
        )

    def _angles(self) -> tuple[Angle, Angle]:
        """Distance and heading as the firmware stores them."""
        distance, heading = self._wheel_angles()
        # The gyroscope has a zero of its own, so the heading is not that of the wheels.
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

    def _set_zero(
        self,
        distance: Angle,
        heading: Angle,
    ) -> None:
        self._distance_zero = distance
        self._heading_zero = heading
        self._distance_zero_mdeg = to_mdeg(distance)
        self._heading_zero_mdeg = to_mdeg(heading)

    def _measured(self) -> tuple[State, State]:
        """Distance and heading. The gyroscope gives only position and speed of the heading; the
        estimates are the motors'."""
        right_position = self.right.position()
        left = self.left.observer
        right = self.right.observer
        # If the mean does not come out even, the firmware's rounding decides, which halves turns
        # and mdeg separately. That takes longer, and is needed half of the time.
        position, is_odd = divmod(self.left.position() + right_position, 2)
        if is_odd:
            position = to_mdeg(mean(self.left.angle(), self.right.angle()))
        speed = trunc((left.measured_speed + right.measured_speed) / 2)
        estimate = trunc((left.speed + right.speed) / 2)
        angle = trunc((left.angle + right.angle) / 2)
        distance_zero = self._distance_zero_mdeg
        heading_zero = self._heading_zero_mdeg
        lead = position - right_position - heading_zero
        lead_estimate = angle - right.angle - heading_zero
        turn_rate = speed - right.measured_speed
        if self._uses_gyro:
            gyro = self._gyro
            steps = self.heading.settings.steps_per_unit
            lead = to_mdeg(gyro.angle(steps))
            turn_rate = trunc(gyro.rate_deg_s() * steps)
        distance = State(
            position - distance_zero,
            speed,
            estimate,
            angle - distance_zero,
        )
        heading = State(
            lead,
            turn_rate,
            estimate - right.speed,
            lead_estimate,
        )
        return distance, heading

    def _check_open(self) -> None:
        if not self.is_open:
            raise UnavailableError(error_numbers.ENODEV, "a motor of the drive base is closed")

    def _begin(self) -> tuple[State, State]:
        """Take over both motors and return their state. Raises OSError (ENODEV) if one is
        closed."""
        self._check_open()
        # The motors' own controllers would otherwise go on beside those of the drive base.
        self.left.control.stop()
        self.right.control.stop()
        return self._measured()

    def _drive_relative(
        self,
        distance_mm: int,
        angle_deg: int,
        then: OnCompletion,
    ) -> None:
        length = distance_mm * self.distance.settings.steps_per_unit
        turn = angle_deg * self.heading.settings.steps_per_unit
        distance, heading = self._begin()
        time = self._clock.time_ticks
        self.distance.start_relative(
            time,
            distance,
            length,
            0,
            then,
            allow_shift=False,
        )
        self.heading.start_relative(
            time,
            heading,
            turn,
            0,
            then,
            allow_shift=False,
        )
        # The shorter of the two moves is stretched, so that the robot drives an arc all the way.
        leader = self.heading.trajectory
        follower = self.distance.trajectory
        if follower.t3 > leader.t3:
            leader, follower = follower, leader
        follower.stretch(leader)

    def _stop_control(self) -> None:
        self.distance.stop()
        self.heading.stop()
        self._paused = False
