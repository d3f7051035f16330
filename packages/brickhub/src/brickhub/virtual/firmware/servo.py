"""Servo: a motor with encoder, observer, controller and voltage."""

from math import trunc
from typing import Protocol

from brickhub.robot import Direction, MotorKind
from brickhub.virtual import error_numbers
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.body import Body
from brickhub.virtual.firmware import RefusedError, UnavailableError
from brickhub.virtual.firmware.angle import Angle, difference, from_unit, split, to_mdeg, to_unit
from brickhub.virtual.firmware.control import Controller, ControlType, Logger, OnCompletion, State
from brickhub.virtual.firmware.motor_model import MOTOR_TYPES, MotorType, Observer
from brickhub.virtual.firmware.settings import ControlSettings
from brickhub.virtual.firmware.trajectory import TURN_MDEG

_NONE = ControlType.NONE
_VOLTAGE = 2
"""Code of a voltage in a motor's log (``PBIO_DCMOTOR_ACTUATION_VOLTAGE``)."""


class Clock(Protocol):
    """Simulated time in ms and in ticks of 0.1 ms, for controllers, observers and logs."""

    time_ms: int
    time_ticks: int


class Parent(Protocol):
    """Controller of several motors, which releases them when one gets another command."""

    def stop_from_servo(self) -> None: ...


class Servo:
    """One motor port. Angles and speeds are whole degrees at the gear train's output.

    Until :meth:`setup` the motor only coasts. Refused commands raise ValueError for a bad value,
    OSError with EBUSY, or with ENODEV if it is not in use.

    Attributes:
        is_plain: whether it lacks a rotation sensor.
        is_taken: whether it must be closed before the next :meth:`setup`. A setup that is refused
            for this still ends the control loop, and the motor keeps its voltage.
        direction: 1 if the angle increases when the shaft turns clockwise, else -1.
        voltage_mv: present voltage; ``None`` while it coasts.
        driven_ms: time at which it began to coast; ``None`` before its first voltage.
    """

    def __init__(
        self,
        kind: MotorKind,
        port: str,
        body: Body,
        clock: Clock,
    ) -> None:
        self.kind = kind
        self.port = port
        self.body = body
        self.clock = clock
        self.type = MOTOR_TYPES[kind]
        self._drive_mv = self.type.model.drive_mv
        self.is_taken = False
        self.is_plain = False
        self._is_updated = False
        self.parent: Parent | None = None
        self.direction = 1
        self._set_zero((0, 0))
        self.voltage_mv: int | None = None
        self.driven_ms: int | None = None
        self.max_voltage_mv = self.type.max_voltage_mv
        self.control = Controller(servo_settings(self.type, 1000, 0))
        self.observer = Observer(self.type, self.settings)
        self.log = Logger()

    @property
    def settings(self) -> ControlSettings:
        return self.control.settings

    @property
    def is_open(self) -> bool:
        """Whether the motor takes commands. Its control loop goes on after :meth:`close`, until
        something first asks this."""
        self._is_updated = self._is_updated and self.is_taken
        return self._is_updated

    def set_max_voltage(self, value_mv: int) -> None:
        """Set the limit of the voltage. Raises RefusedError if the motor takes less."""
        if not 0 <= value_mv <= self.type.max_voltage_mv:
            raise RefusedError("the voltage limit is out of range")
        self.max_voltage_mv = value_mv

    def setup(
        self,
        direction: Direction,
        gear_ratio_milli: int,
        reset_angle: bool,
        profile_deg: int,
    ) -> None:
        """Take the motor into use; ``gear_ratio_milli`` is 1000 times the motor's turns for one of
        the output. Raises OSError (EBUSY) if it is in use, ValueError if the gear ratio or the
        profile is out of range."""
        # The firmware has this order: a setup that is refused below has already ended the control
        # loop and moved the zero.
        self._is_updated = False
        if reset_angle:
            measured = split(self.body.angle_mdeg(self.port))
            absolute_mdeg = self._absolute_mdeg() if self.kind.model.is_absolute else 0
            self._set_zero(difference(measured, (0, absolute_mdeg)))
        if self.is_taken:
            raise UnavailableError(error_numbers.EBUSY, "the motor is in use already")
        self.set_voltage(None)
        self.direction = direction.value
        self.is_taken = True
        self.max_voltage_mv = self.type.max_voltage_mv
        self.control.reset()
        self.control = Controller(servo_settings(self.type, gear_ratio_milli, profile_deg))
        measured_speed = self.observer.measured_speed
        self.observer = Observer(self.type, self.settings)
        # The new observer keeps the measured speed until its first step.
        self.observer.measured_speed = measured_speed
        self.observer.reset(self.position())
        self._is_updated = True

    def setup_plain(self, direction: Direction) -> None:
        """Take it into use as a motor without rotation sensor: voltage only."""
        self.is_plain = True
        self.set_voltage(None)
        self.direction = direction.value
        self.max_voltage_mv = self.type.max_voltage_mv

    def close(self) -> None:
        """Coast, and allow a new setup."""
        self.set_voltage(None)
        self._end_control()
        self.parent = None
        self.is_taken = False

    def check_open(self) -> None:
        """Raise OSError (ENODEV) unless its control loop runs."""
        if not self.is_open:
            raise UnavailableError(error_numbers.ENODEV, "the motor is not in use")

    def position(self) -> int:
        """Angle of the motor's shaft in mdeg, in the program's direction and from its zero."""
        return (self.body.angle_mdeg(self.port) - self._zero_mdeg) * self.direction

    def angle(self) -> Angle:
        """:meth:`position` as the firmware stores it."""
        measured = split(self.body.angle_mdeg(self.port))
        turns, mdeg = difference(measured, self._zero)
        return turns * self.direction, mdeg * self.direction

    def state(self) -> State:
        observer = self.observer
        position = self.position()
        return State(
            position,
            observer.measured_speed,
            observer.speed,
            observer.angle,
        )

    def angle_deg(self) -> int:
        self.check_open()
        return to_unit(self.angle(), self.settings.steps_per_unit)

    def speed_deg_s(self, window_ms: int = 100) -> int:
        """Mean speed over the last ``window_ms``. Raises ValueError for a window over 300 ms."""
        return self.settings.to_unit(self.observer.window_speed(window_ms))

    def load_mnm(self) -> int:
        """Estimated torque of the load."""
        self.check_open()
        return self._load_mnm(self.position())

    def observed(self) -> tuple[float | None, int | None, int | None, int | None]:
        """Angle (deg), mean speed over 100 ms (deg/s), load (mNm) and voltage (mV, ``None`` while
        it coasts) of the last control step, for a log: nothing is measured. Angle, speed and load
        are ``None`` without a control loop."""
        if not self._is_updated:
            return None, None, None, self.voltage_mv
        position = self.observer.history[-1]
        # Adding 0.0 turns -0.0 into 0.0, which is what a log should show.
        angle_deg = round(position / self.settings.steps_per_unit, 3) + 0.0
        return angle_deg, self.speed_deg_s(), self._load_mnm(position), self.voltage_mv

    def is_done(self) -> bool:
        return self.control.is_done

    def is_stalled(self) -> bool:
        self.check_open()
        if self.control.is_active:
            return self.control.is_stalled
        # Without a controller, as after `dc()`, only the observer can tell, by its model running
        # ahead. It knows no motor that coasts.
        if self.voltage_mv is None:
            return False
        return self.observer.is_stalled(self.clock.time_ticks)

    def reset_angle(self, angle_deg: int | None) -> None:
        """Set the angle, with ``None`` to the absolute angle of the shaft. A running move stops.
        Raises OSError (EOPNOTSUPP) for a motor that does not know that."""
        # Stopping clears what the motor did, so that is remembered first.
        was_active = self.control.is_active
        then = self.control.on_completion
        voltage = self.voltage_mv
        self.stop(OnCompletion.COAST)
        self.control.reset()
        if angle_deg is None:
            if not self.kind.model.is_absolute:
                raise UnavailableError(
                    error_numbers.EOPNOTSUPP, "the motor does not know its absolute angle"
                )
            turns = 0
            mdeg = self._absolute_mdeg() * self.direction
        else:
            turns, mdeg = from_unit(angle_deg, self.settings.steps_per_unit)
        measured = split(self.body.angle_mdeg(self.port))
        clockwise = turns * self.direction, mdeg * self.direction
        self._set_zero(difference(measured, clockwise))
        self.observer.reset(to_mdeg((turns, mdeg)))
        # A motor under control goes on as its last command would have ended, mostly by holding
        # here. A motor that was driven by a voltage gets that voltage again.
        if was_active:
            self.stop(then)
        elif voltage is not None:
            self.set_voltage(voltage)

    def dc(self, duty_pct: int) -> None:
        """Apply a percentage of the battery voltage, -100..100."""
        self._end_control()
        duty_pct = max(-100, min(100, duty_pct))
        voltage_mv = trunc(duty_pct * self.body.battery_mv / 100)
        self.set_voltage(voltage_mv)

    def coast(self) -> None:
        self._end_control()
        self.set_voltage(None)

    def brake(self) -> None:
        self._end_control()
        self.set_voltage(0)

    def stop(self, then: OnCompletion) -> None:
        """End the running move: hold at its reference, or become passive."""
        self._take_over()
        if then.is_active:
            # A running move holds at its reference, from which the motor may lag behind, so that
            # the motor does not jerk back.
            state = self.state()
            target = state.position
            if self.control.is_active:
                target = self.control.reference(self.clock.time_ticks, state).position
            self.track_target(self.settings.position_to_unit(target))
            return
        self.control.stop()
        self.set_voltage(None if then.passive is OnCompletion.COAST else 0)

    def run(self, speed: int) -> None:
        self._take_over()
        control_speed = self.settings.from_unit(speed)
        self.control.start_forever(self.clock.time_ticks, self.state(), control_speed)

    def run_time(
        self,
        speed: int,
        time_ms: int,
        then: OnCompletion,
    ) -> None:
        self._take_over()
        duration_ticks = time_ms * 10
        control_speed = self.settings.from_unit(speed)
        self.control.start_timed(
            self.clock.time_ticks,
            self.state(),
            duration_ticks,
            control_speed,
            then,
        )

    def run_until_stalled(
        self,
        speed: int,
        then: OnCompletion,
        duty_limit_pct: int | None,
        limit_unm: int | None = None,
    ) -> None:
        """Run with a limit as a duty or a torque, or the motor's own. Raises RefusedError for
        ``CONTINUE``."""
        if then is OnCompletion.CONTINUE:
            raise RefusedError("a stalled motor cannot continue")
        limit = self.settings.max_torque if limit_unm is None else limit_unm
        if duty_limit_pct is not None:
            # This is the torque of a motor at rest, at this share of the battery's voltage.
            limit_mv = trunc(duty_limit_pct * self.body.battery_mv / 100)
            limit = self.type.model.torque_unm(limit_mv)
        self._take_over()
        control_speed = self.settings.from_unit(speed)
        # Motors on a bench turn freely, so such a run would never end.
        if isinstance(self.body, FittedBench):
            clockwise = self.direction if control_speed > 0 else -self.direction
            self.body.block(self.port, clockwise)
        self.control.start_until_stalled(
            self.clock.time_ticks,
            self.state(),
            control_speed,
            limit,
            then,
        )

    def run_angle(
        self,
        speed: int,
        angle: int,
        then: OnCompletion,
    ) -> None:
        """Run by an angle; a negative speed reverses it, at speed 0 the motor stays."""
        self._take_over()
        s = self.settings
        sign = (speed > 0) - (speed < 0)
        distance = sign * angle * s.steps_per_unit
        self.control.start_relative(
            self.clock.time_ticks,
            self.state(),
            distance,
            s.from_unit(speed),
            then,
        )

    def run_target(
        self,
        speed: int,
        target: int,
        then: OnCompletion,
    ) -> None:
        """Run to an angle at the magnitude of the speed; at speed 0 the motor stays."""
        # Speed 0 means the default speed to the controller.
        if speed == 0:
            self.run_angle(0, 0, then)
            return
        self._take_over()
        s = self.settings
        target_position = target * s.steps_per_unit
        self.control.start_position(
            self.clock.time_ticks,
            self.state(),
            target_position,
            s.from_unit(speed),
            then,
        )

    def track_target(self, target: int) -> None:
        self._take_over()
        position = target * self.settings.steps_per_unit
        self.control.start_hold(self.clock.time_ticks, position)

    def update(self) -> None:
        """One control step: controller, voltage, observer."""
        if not self._is_updated:
            return
        time = self.clock.time_ms * 10
        # This repeats `position()` without the call, because it is in the hot loop of every virtual
        # robot.
        position = (self.body.angle_mdeg(self.port) - self._zero_mdeg) * self.direction
        control = self.control
        observer = self.observer
        torque = speed = acceleration = 0
        # `pbio_servo_update` has this order: the controller sees the observer's estimate of the
        # last step, and then the observer predicts with the voltage of this one.
        if control.type is not _NONE:
            torque, speed, acceleration, passive, _ = control.update(
                time,
                position,
                observer.measured_speed,
                observer.speed,
            )
            if passive is None:
                self.set_voltage(
                    self._drive_mv(
                        torque,
                        speed,
                        acceleration,
                        control.torque_limit,
                    )
                )
            else:
                self.set_voltage(None if passive is OnCompletion.COAST else 0)
            if control.log.is_active:
                control.log_row(
                    self.clock.time_ms,
                    self.state(),
                    torque,
                    passive,
                )
        if self.log.is_active:
            feedforward = self.type.model.feedforward_unm(speed, acceleration)
            self._log_row(position, torque, feedforward)
        observer.update(time, position, self.voltage_mv or 0)

    def actuate(
        self,
        torque_unm: int,
        speed: int,
        acceleration: int,
    ) -> None:
        """Exert a torque plus the feedforward of a reference (mdeg/s, mdeg/s2)."""
        self.set_voltage(self._drive_mv(torque_unm, speed, acceleration))

    def set_voltage(self, voltage_mv: int | None) -> None:
        """Set the voltage, or coast for ``None``, without a change of the controllers."""
        if voltage_mv is None:
            if self.voltage_mv is not None:
                self.driven_ms = self.clock.time_ms
            self.voltage_mv = None
            self.body.set_voltage(self.port, None)
            return
        limit = self.max_voltage_mv
        if voltage_mv > limit:
            voltage_mv = limit
        elif voltage_mv < -limit:
            voltage_mv = -limit
        self.voltage_mv = voltage_mv
        self.body.set_voltage(self.port, voltage_mv * self.direction)

    def _log_row(
        self,
        position: int,
        feedback_unm: int,
        feedforward_unm: int,
    ) -> None:
        s = self.settings
        observer = self.observer
        # The firmware packs the kind of actuation and the stall flag into one column.
        actuation = 0 if self.voltage_mv is None else _VOLTAGE
        actuation |= self.is_stalled() << 2
        self.log.add(
            self.clock.time_ms,
            self.clock.time_ticks,
            s.position_to_unit(position),
            s.to_unit(observer.measured_speed),
            actuation,
            self.voltage_mv or 0,
            s.position_to_unit(observer.angle),
            s.to_unit(observer.speed),
            feedback_unm,
            feedforward_unm,
            observer.feedback_mv(position),
        )

    def _take_over(self) -> None:
        self.check_open()
        if self.parent is not None:
            self.parent.stop_from_servo()

    def _end_control(self) -> None:
        """End the control by its controller or by its drive base."""
        if self.control.is_active:
            self.control.reset()
        elif self.parent is not None:
            self.parent.stop_from_servo()

    def _load_mnm(self, position: int) -> int:
        if self.voltage_mv is None:
            return 0
        # On average, the controller's torque balances the load. Without a controller, the
        # observer's feedback shows what would have to be added to its model.
        if self.control.is_active:
            return trunc(-self.control.pid_average / 1000)
        feedback_mv = self.observer.feedback_mv(position)
        return trunc(self.type.model.torque_unm(feedback_mv) / 1000)

    def _absolute_mdeg(self) -> int:
        """Absolute angle of the shaft, clockwise, -180..180 degrees."""
        half_turn = TURN_MDEG // 2
        return (self.body.angle_mdeg(self.port) + half_turn) % TURN_MDEG - half_turn

    def _set_zero(self, zero: Angle) -> None:
        # Both forms are kept: the loop computes in mdeg, and what a program reads is rounded by
        # parts.
        self._zero = zero
        self._zero_mdeg = to_mdeg(zero)


def servo_settings(
    motor: MotorType,
    gear_ratio_milli: int,
    profile_deg: int,
) -> ControlSettings:
    """The firmware's settings of a single motor. Raises ValueError for a gear ratio under 1/1000 or
    a profile under 5 degrees."""
    precision_deg = profile_deg or motor.precision_deg
    if gear_ratio_milli < 1 or precision_deg < 5:
        raise RefusedError("the gear ratio or the profile is out of range")
    # The proportional part should reach the nominal torque at an error as large as the precision.
    # The differential part goes by the motor's own precision, whatever the profile.
    nominal_mv = min(motor.max_voltage_mv, 7500)
    nominal_torque = motor.model.torque_unm(nominal_mv)
    gains = (
        nominal_torque // precision_deg,
        nominal_torque // precision_deg // 2,
        nominal_torque // motor.precision_deg // 8,
    )
    kp, ki, kd = (
        gain * share // whole for gain, (share, whole) in zip(gains, motor.gain_shares, strict=True)
    )
    speed = motor.max_speed_deg_s * 1000
    return ControlSettings(
        steps_per_unit=gear_ratio_milli,
        max_speed=speed,
        default_speed=speed,
        acceleration=2_000_000,
        deceleration=2_000_000,
        max_torque=motor.model.torque_unm(motor.max_voltage_mv),
        kp=kp,
        ki=ki,
        kd=kd,
        kp_low_pct=50,
        kp_low_error=5_000,
        kp_low_speed=motor.low_kp_speed_deg_s * 1000,
        integral_deadzone=8_000,
        integral_rate=15_000,
        speed_tolerance=50_000,
        position_tolerance=precision_deg * 1000,
        stall_speed=20_000,
        stall_time=2_000,
        smart_hold_time=1_000,
    )
