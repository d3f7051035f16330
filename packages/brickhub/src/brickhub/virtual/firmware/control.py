"""Position and speed controller: PID along a trajectory, with anti-windup, stall detection and
completion.

Its log is that of ``pbio/logger.c``, v4.
"""

import enum
from math import trunc
from typing import NamedTuple

from brickhub.virtual.firmware import trajectory as trajectories
from brickhub.virtual.firmware.settings import ControlSettings
from brickhub.virtual.firmware.trajectory import (
    FOREVER_MS,
    Trajectory,
    TrajectoryCommand,
    TrajectoryReference,
)

LOOPS_PER_S = 200
_FOREVER = FOREVER_MS * 10
_UNBOUNDED = 2**31 - 1


class PositionIntegrator:
    """Integral of the position error; a pause also stops the trajectory's clock."""

    def __init__(self, settings: ControlSettings, time: int) -> None:
        self._settings = settings
        self.running = True
        self.pause_began = time
        self.integral = self._paused_total = 0

    def trajectory_time(self, time: int) -> int:
        return (time if self.running else self.pause_began) - self._paused_total

    def toggle(self, time: int, error: int) -> None:
        """Pause, or resume."""
        if self.running:
            self.pause_began = time
        else:
            self._paused_total += time - self.pause_began
        self.running = not self.running

    def update(self, error: int, target_error: int) -> int:
        """Add the error of one control step, unless it winds up, and return the integral (mdeg
        s)."""
        s = self._settings
        integral = self.integral
        change = trunc(error / LOOPS_PER_S)
        shrinks = abs(integral + change) < abs(integral)
        if not shrinks:
            if not self.running:
                return integral
            rate = s.integral_rate
            if not -rate <= error <= rate:
                change = trunc((rate if error > 0 else -rate) / LOOPS_PER_S)
                shrinks = abs(integral + change) < abs(integral)
        if shrinks or s.integral_deadzone <= abs(target_error) <= s.saturation_error * 2:
            integral = integral + change
            limit = s.max_integral
            self.integral = integral = (
                limit if integral > limit else -limit if integral < -limit else integral
            )
        return integral

    def is_stalled(self, time: int, speed: int, reference_speed: int) -> bool:
        if self.running:
            limit = self._settings.max_integral
            if limit == 0 or -limit < self.integral < limit:
                return False
        return _stalls(self._settings, self.pause_began, time, speed, reference_speed)


class SpeedIntegrator:
    """Integral of the speed error: a difference of positions."""

    def __init__(self, settings: ControlSettings) -> None:
        self._settings = settings
        self.running = True
        self.pause_began = self._paused_error = self._error_at_resume = 0

    def error(self, position_error: int) -> int:
        return self._paused_error + (position_error - self._error_at_resume if self.running else 0)

    def toggle(self, time: int, position_error: int) -> None:
        """Pause, or resume."""
        if self.running:
            self._paused_error += position_error - self._error_at_resume
            self.pause_began = time
        else:
            self._error_at_resume = position_error
        self.running = not self.running

    def is_stalled(self, time: int, speed: int, reference_speed: int) -> bool:
        return not self.running and _stalls(
            self._settings, self.pause_began, time, speed, reference_speed
        )


def _stalls(s: ControlSettings, since: int, time: int, speed: int, reference_speed: int) -> bool:
    if reference_speed < 0:
        reference_speed = -reference_speed
        speed = -speed
    if reference_speed != 0 and speed > s.stall_speed:
        return False
    return time - since >= s.stall_time


class Logger:
    """Recorded ``rows`` of integers, each beginning with the ms since the start."""

    __slots__ = ("_capacity", "_down_sample", "_skipped", "_start_ms", "is_active", "rows")

    def __init__(self) -> None:
        self.is_active = False
        self.rows: list[tuple[int, ...]] = []

    def start(self, time_ms: int, capacity: int, down_sample: int) -> None:
        """Start anew: record one of ``down_sample`` rows, up to ``capacity`` of them."""
        self.rows = []
        self._start_ms = time_ms
        self._capacity = capacity
        self._down_sample = down_sample
        self._skipped = 0
        self.is_active = True

    def add(self, time_ms: int, *values: int) -> None:
        """Record a row of the control loop."""
        self._skipped += 1
        if self._skipped < self._down_sample:
            return
        self._skipped = 0
        if len(self.rows) == self._capacity:
            self.is_active = False
        else:
            self.rows.append((time_ms - self._start_ms, *values))


class OnCompletion(enum.Enum):
    """Behaviour at the end of a move."""

    COAST = "coast"
    BRAKE = "brake"
    HOLD = "hold"
    CONTINUE = "continue"
    COAST_SMART = "coast_smart"
    BRAKE_SMART = "brake_smart"

    @property
    def is_active(self) -> bool:
        return self in (OnCompletion.HOLD, OnCompletion.CONTINUE)

    @property
    def is_smart(self) -> bool:
        return self in (OnCompletion.COAST_SMART, OnCompletion.BRAKE_SMART)

    @property
    def passive(self) -> "OnCompletion":
        """Coast or brake, without the smart variant."""
        return (
            OnCompletion.COAST
            if self in (OnCompletion.COAST, OnCompletion.COAST_SMART)
            else OnCompletion.BRAKE
        )


class ControlType(enum.Enum):
    NONE = 0
    TIMED = 1
    POSITION = 2


class State(NamedTuple):
    """Measured position (mdeg) and speed (mdeg/s), and the observer's estimates."""

    position: int
    speed: int
    speed_estimate: int
    position_estimate: int = 0


Action = tuple[int, int, int, OnCompletion | None, bool]
"""Output of a controller: torque (uNm), speed and acceleration of the reference, passive stop or
``None``, and whether it is saturated."""

ACTUATIONS = {OnCompletion.COAST: 0, OnCompletion.BRAKE: 1, None: 3}
"""Codes of a log, as in the firmware; 2 is a voltage, 3 a torque."""
_POSITION = ControlType.POSITION
_TIMED = ControlType.TIMED


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)


class Controller:
    """Follows one command at a time; times are control ticks, quantities control units.

    Attributes:
        torque_limit: limit of the current command (uNm); that of a single motor includes the
            feedforward.
        is_done: whether the command is complete, or there is none.
    """

    def __init__(self, settings: ControlSettings) -> None:
        self.settings = settings
        self.type = ControlType.NONE
        self.on_completion = OnCompletion.COAST
        self.trajectory = Trajectory(0, 0)
        self.pid_average = 0
        self.torque_limit = settings.max_torque
        self.is_done = True
        self._until_stalled = self._stalled = self._is_fast = self._acts_when_done = False
        self._position = PositionIntegrator(settings, 0)
        self._speed = SpeedIntegrator(settings)
        self.log = Logger()
        self._terms = (0,) * 7

    @property
    def is_active(self) -> bool:
        return self.type is not ControlType.NONE

    @property
    def is_stalled(self) -> bool:
        return self.is_active and self._stalled

    def stop(self) -> None:
        """Become passive; ``on_completion`` is kept for smart stops."""
        self.type = ControlType.NONE
        self.is_done = True
        self._stalled = False
        self.pid_average = 0

    def reset(self) -> None:
        self.stop()
        self.on_completion = OnCompletion.COAST

    def reference(self, time: int, state: State) -> TrajectoryReference:
        """Reference at a time, without the shifts caused by load."""
        ref = self.trajectory.reference(self._trajectory_time(time))
        if self.type is _TIMED:
            error = ref.position - state.position
            shift = self._speed.error(error) - error
            return TrajectoryReference(ref.time, ref.position + shift, ref.speed, ref.acceleration)
        return ref

    # ---- commands

    def start_position(
        self,
        time: int,
        state: State,
        target: int,
        speed: int,
        then: OnCompletion,
        allow_shift: bool = True,
    ) -> None:
        """Run to a position; speed 0 is the default speed. Raises ValueError for a move that is too
        long."""
        start = (
            self.reference(time, state)
            if self.is_active
            else TrajectoryReference(time, state.position, state.speed, 0)
        )
        command = self._command(start, speed or self.settings.default_speed, then, end=target)
        new = trajectories.to_angle(command)
        if self.type is _POSITION and allow_shift and new.a0 == start.acceleration:
            # Start where the current phase began, so that commands in a tight loop do not
            # accumulate rounding errors. The firmware compares deg/s2 with mdeg/s2, so this applies
            # only if neither accelerates.
            new = trajectories.to_angle(
                _from_vertex(command, self.trajectory.last_vertex(start.time))
            )
        self._follow(_POSITION, new, time, then)

    def start_relative(
        self,
        time: int,
        state: State,
        distance: int,
        speed: int,
        then: OnCompletion,
        allow_shift: bool = True,
    ) -> None:
        """Run by a distance (control units), from the reference if active, else from the measured
        position."""
        if self.is_active:
            origin = self.reference(time, state).position
        else:
            origin = state.position
            end = self.trajectory.end.position
            if (
                self.on_completion.is_smart
                and abs(end - origin) < self.settings.position_tolerance * 2
            ):
                origin = end
        self.start_position(time, state, origin + distance, speed, then, allow_shift)

    def start_hold(self, time: int, position: int) -> None:
        """Hold a position, without a ramp to it."""
        self._follow(
            _POSITION, Trajectory(self._trajectory_time(time), position), time, OnCompletion.HOLD
        )

    def start_timed(
        self, time: int, state: State, duration: int, speed: int, then: OnCompletion
    ) -> None:
        """Run at a speed (control units) for a duration in ticks."""
        if then.is_smart:
            then = then.passive
        start = TrajectoryReference(time, state.position, state.speed, 0)
        if self.is_active:
            start = self.trajectory.reference(self._trajectory_time(time))
        command = self._command(start._replace(time=time), speed, then, duration=duration)
        new = trajectories.for_time(command)
        if self.type is _TIMED and new.a0 == start.acceleration:
            new = trajectories.for_time(_from_vertex(command, self.trajectory.last_vertex(time)))
        self._follow(_TIMED, new, time, then)

    def start_forever(self, time: int, state: State, speed: int) -> None:
        self.start_timed(time, state, _FOREVER, speed, OnCompletion.CONTINUE)

    def start_until_stalled(
        self, time: int, state: State, speed: int, torque_limit: int, then: OnCompletion
    ) -> None:
        """Run until stalled, with a torque limit (uNm) for this run only.

        It starts as an endless run, whose integral it continues, but not that of another run until
        stalled.
        """
        self.start_forever(time, state, speed)
        self.on_completion = then
        self._acts_when_done = False
        self._until_stalled = True
        self.torque_limit = torque_limit

    def _command(
        self, start: TrajectoryReference, speed: int, then: OnCompletion, **goal: int
    ) -> TrajectoryCommand:
        s = self.settings
        limits = s.max_speed, s.acceleration, s.deceleration
        return TrajectoryCommand(
            start.time,
            start.position,
            start.speed,
            speed,
            *limits,
            then is OnCompletion.CONTINUE,
            **goal,
        )

    # ---- the loop

    def update(
        self,
        time: int,
        position: int,
        speed: int,
        speed_estimate: int,
        paused_by_other: bool = False,
    ) -> Action:
        """One control step. Inlined, because most of a virtual robot's computing time is spent
        here.

        Args:
            position, speed: measured, mdeg and mdeg/s.
            speed_estimate: the observer's.
            paused_by_other: whether the drive base pauses both its controllers.
        """
        s = self.settings
        limit = self.torque_limit
        end_time, end_position, end_speed, _ = self.trajectory.end
        integrator: PositionIntegrator | SpeedIntegrator
        if self.type is _POSITION:
            integrator = self._position
            reference_time = integrator.trajectory_time(time)
            reference, reference_speed, acceleration = self.trajectory.at(reference_time)
            used_error = error = reference - position
            target_error = end_position - position
            integral = integrator.update(error, target_error)
        else:
            integrator = self._speed
            reference_time = time
            reference, reference_speed, acceleration = self.trajectory.at(time)
            error = reference - position
            target_error = _UNBOUNDED
            integral = 0
            used_error = integrator.error(error)
        kp = s.kp if self._is_fast or error == 0 else self._soft_kp(error, target_error)
        proportional = trunc(kp * used_error / 1000)
        torque = proportional + trunc(s.kd * (reference_speed - speed_estimate) / 1000)
        if integral:
            torque += trunc(integral * s.ki / 1000)
        torque = limit if torque > limit else -limit if torque < -limit else torque
        at_limit = abs(proportional) >= limit and self._is_winding_up(
            proportional, speed, reference_speed, acceleration
        )
        if integrator.running is (at_limit or paused_by_other):
            integrator.toggle(time, error)
        self._stalled = integrator.is_stalled(time, speed, reference_speed)
        self.pid_average = trunc((self.pid_average * 95 + torque * 5) / 100)
        if self.log.is_active:
            derivative = trunc(s.kd * (reference_speed - speed_estimate) / 1000)
            terms = proportional, trunc(integral * s.ki / 1000), derivative
            self._terms = (
                reference_time,
                reference + used_error - error,
                reference_speed,
                *terms,
                int(at_limit),
            )
        action = torque, reference_speed, acceleration, None, at_limit
        self.is_done = reference_time >= end_time and self._has_arrived(
            end_position - position, end_speed, speed
        )
        if self.type is _TIMED and not self.is_done:
            self.is_done = self._stalled if self._until_stalled else self.trajectory.t3 >= _FOREVER
        if not self.is_done or self._acts_when_done:
            return action
        then = self.on_completion
        if then.is_active:  # a timed move that ends in HOLD
            self.start_hold(time, s.position_to_unit(position) * s.steps_per_unit)
        elif not then.is_smart or reference_time - end_time >= s.smart_hold_time:
            self.stop()
            return 0, reference_speed, acceleration, then.passive, at_limit
        return action

    def log_row(
        self, time_ms: int, state: State, torque: int, passive: OnCompletion | None
    ) -> None:
        """Log the last :meth:`update` and its outcome."""
        s = self.settings
        reference_time, reference, reference_speed, *terms, at_limit = self._terms
        actuation = ACTUATIONS[passive] | self._stalled << 2 | self.is_done << 3 | at_limit << 4
        measured = s.position_to_unit(state.position), s.to_unit(state.speed)
        wanted = s.position_to_unit(reference), s.to_unit(reference_speed)
        estimated = s.position_to_unit(state.position_estimate), s.to_unit(state.speed_estimate)
        since = reference_time - self.trajectory.time
        self.log.add(time_ms, since, *measured, actuation, torque, *wanted, *estimated, *terms)

    def _trajectory_time(self, time: int) -> int:
        return self._position.trajectory_time(time) if self.type is _POSITION else time

    def _follow(
        self, new: ControlType, trajectory: Trajectory, time: int, then: OnCompletion
    ) -> None:
        self.trajectory = trajectory
        self._is_fast = abs(trajectory.wu) * 100 >= self.settings.kp_low_speed
        self.on_completion = then
        self._acts_when_done = then.is_active and (
            new is _POSITION or then is OnCompletion.CONTINUE
        )
        self.torque_limit = self.settings.max_torque
        self.is_done = False
        if self.type is new and not self._until_stalled:
            return
        self._stalled = False
        if new is _POSITION:
            self._position = PositionIntegrator(self.settings, time)
        else:
            self._speed = SpeedIntegrator(self.settings)
        self.type = new
        self._until_stalled = False

    def _soft_kp(self, error: int, target_error: int) -> int:
        """Position gain of a slow move: reduced for small errors, full near the target."""
        s = self.settings
        target_error = abs(target_error)
        near = s.saturation_error
        if target_error < near:
            return s.kp
        error = abs(error)
        low = s.kp * s.kp_low_pct // 100
        piecewise = (
            low if error <= s.kp_low_error else s.kp - s.kp_low_error * (s.kp - low) // error
        )
        far = near * 100 // s.kp_low_pct
        if target_error > far:
            return max(piecewise, low)
        # This product overflows 32 bits in the firmware, which goes on with the wrapped value.
        product = (s.kp * (100 - s.kp_low_pct) * (far - target_error) + 2**31) % 2**32 - 2**31
        return max(piecewise, low + trunc(trunc(product / (far - near)) / 100))

    def _is_winding_up(
        self, proportional: int, speed: int, reference_speed: int, acceleration: int
    ) -> bool:
        """Whether the proportional part alone exceeds the torque limit, and the reference will not
        reduce it."""
        s = self.settings
        margin = trunc(abs(speed) / LOOPS_PER_S) * 2
        if abs(proportional) < self.torque_limit + trunc(s.kp * margin / 1000):
            return False
        moving = 0 if abs(speed) < s.stall_speed else speed
        sign = _sign(proportional)
        return sign != -_sign(reference_speed - moving) and sign != -_sign(acceleration)

    def _has_arrived(self, remaining: int, end_speed: int, speed: int) -> bool:
        """Whether the end is reached, given that its time is over."""
        if self.type is _TIMED:
            return not self._until_stalled
        if end_speed != 0:
            return _sign(remaining) != _sign(end_speed)
        s = self.settings
        return abs(speed) <= s.speed_tolerance and abs(remaining) <= s.position_tolerance


def _from_vertex(command: TrajectoryCommand, vertex: TrajectoryReference) -> TrajectoryCommand:
    duration = command.duration + command.time - vertex.time if command.duration else 0
    return command._replace(
        time=vertex.time, position=vertex.position, speed=vertex.speed, duration=duration
    )
