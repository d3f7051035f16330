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
"""Control steps a second (``PBIO_CONFIG_CONTROL_LOOP_TIME_MS`` is 5 on all hubs)."""
# This is in ticks of 0.1 ms, as all times here: milliseconds would be too coarse for the speeds of
# short ramps.
_FOREVER = FOREVER_MS * 10
# A move without a target has this error to it, which is larger than any range it is compared with.
_UNBOUNDED = 2**31 - 1


class PositionIntegrator:
    """Integral of the position error; a pause also stops the trajectory's clock."""

    def __init__(
        self,
        settings: ControlSettings,
        time: int,
    ) -> None:
        self._settings = settings
        self.running = True
        self.pause_began = time
        self.integral = 0
        self._paused_total = 0

    def trajectory_time(self, time: int) -> int:
        """Time on the trajectory, which stands still during a pause."""
        now = time if self.running else self.pause_began
        return now - self._paused_total

    def toggle(
        self,
        time: int,
        error: int,
    ) -> None:
        """Pause, or resume."""
        if self.running:
            self.pause_began = time
        else:
            self._paused_total += time - self.pause_began
        self.running = not self.running

    def update(
        self,
        error: int,
        target_error: int,
    ) -> int:
        """Add the error of one control step, unless it winds up, and return the integral (mdeg
        s)."""
        s = self._settings
        integral = self.integral
        change = trunc(error / LOOPS_PER_S)
        # Shrinking cannot wind up, so it is allowed during a pause too.
        shrinks = abs(integral + change) < abs(integral)
        if not shrinks:
            if not self.running:
                return integral
            rate = s.integral_rate
            if not -rate <= error <= rate:
                limited_error = rate if error > 0 else -rate
                change = trunc(limited_error / LOOPS_PER_S)
                # The limited change may no longer cross zero and come out beyond, so this is asked
                # again.
                shrinks = abs(integral + change) < abs(integral)
        # The integral grows near the target, but not too near. It begins at twice the error of
        # saturation, because the firmware begins a bit before the proportional part comes off its
        # limit.
        if shrinks or s.integral_deadzone <= abs(target_error) <= s.saturation_error * 2:
            integral = integral + change
            limit = s.max_integral
            if integral > limit:
                integral = limit
            elif integral < -limit:
                integral = -limit
            self.integral = integral
        return integral

    def is_stalled(
        self,
        time: int,
        speed: int,
        reference_speed: int,
    ) -> bool:
        # The proportional part at its limit pauses the integrator; the integral part at its own
        # limit is the other sign that the motor gives all it has.
        if self.running:
            limit = self._settings.max_integral
            if limit == 0 or -limit < self.integral < limit:
                return False
        return _stalls(
            self._settings,
            self.pause_began,
            time,
            speed,
            reference_speed,
        )


class SpeedIntegrator:
    """Integral of the speed error: a difference of positions."""

    # Positions are exact, so this integral needs no sum over steps. It is the difference since the
    # last resume, plus what had come together before the last pause.

    def __init__(self, settings: ControlSettings) -> None:
        self._settings = settings
        self.running = True
        self.pause_began = 0
        self._paused_error = 0
        self._error_at_resume = 0

    def error(self, position_error: int) -> int:
        if not self.running:
            return self._paused_error
        return self._paused_error + (position_error - self._error_at_resume)

    def toggle(
        self,
        time: int,
        position_error: int,
    ) -> None:
        """Pause, or resume."""
        if self.running:
            self._paused_error += position_error - self._error_at_resume
            self.pause_began = time
        else:
            self._error_at_resume = position_error
        self.running = not self.running

    def is_stalled(
        self,
        time: int,
        speed: int,
        reference_speed: int,
    ) -> bool:
        if self.running:
            return False
        return _stalls(
            self._settings,
            self.pause_began,
            time,
            speed,
            reference_speed,
        )


def _stalls(
    s: ControlSettings,
    since: int,
    time: int,
    speed: int,
    reference_speed: int,
) -> bool:
    # A motor that is pushed backward counts as slow, however fast it turns, so the speeds are
    # mirrored to a forward move.
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

    def start(
        self,
        time_ms: int,
        capacity: int,
        down_sample: int,
    ) -> None:
        """Start anew: record one of ``down_sample`` rows, up to ``capacity`` of them."""
        self.rows = []
        self._start_ms = time_ms
        self._capacity = capacity
        self._down_sample = down_sample
        self._skipped = 0
        self.is_active = True

    def add(
        self,
        time_ms: int,
        *values: int,
    ) -> None:
        """Record a row of the control loop."""
        self._skipped += 1
        if self._skipped < self._down_sample:
            return
        self._skipped = 0
        # A hub allocates all rows at the start, so a full log ends instead of growing.
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
        if self in (OnCompletion.COAST, OnCompletion.COAST_SMART):
            return OnCompletion.COAST
        return OnCompletion.BRAKE


class ControlType(enum.Enum):
    """Quantities that can be controlled: the speed of a timed move, or the position."""

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
# The loop reads these all the time, and a global name is found faster than a member of a class.
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
        self._until_stalled = False
        self._stalled = False
        self._is_fast = False
        self._acts_when_done = False
        self._position = PositionIntegrator(settings, 0)
        self._speed = SpeedIntegrator(settings)
        self.log = Logger()
        # The terms of the last step are kept for its row in the log, which is written when the
        # outcome is known.
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

    def reference(
        self,
        time: int,
        state: State,
    ) -> TrajectoryReference:
        """Reference at a time, without the shifts caused by load."""
        ref = self.trajectory.reference(self._trajectory_time(time))
        if self.type is not _TIMED:
            return ref
        # A pause of the speed integrator leaves the trajectory's clock running, so its positions
        # have moved on by what the motor could not follow.
        error = ref.position - state.position
        shift = self._speed.error(error) - error
        return TrajectoryReference(
            ref.time,
            ref.position + shift,
            ref.speed,
            ref.acceleration,
        )

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
        # An active controller branches off from its reference and not from the motor, which lags
        # behind it. So the speed does not drop between two commands.
        if self.is_active:
            start = self.reference(time, state)
        else:
            start = TrajectoryReference(
                time,
                state.position,
                state.speed,
                0,
            )
        target_speed = speed or self.settings.default_speed
        command = self._command(
            start,
            target_speed,
            then,
            end=target,
        )
        new = trajectories.to_angle(command)
        if self.type is _POSITION and allow_shift and new.a0 == start.acceleration:
            # The new trajectory starts where the current phase began, so that commands in a tight
            # loop do not accumulate rounding errors. The firmware compares deg/s2 with mdeg/s2, so
            # this applies only if neither accelerates.
            vertex = self.trajectory.last_vertex(start.time)
            new = trajectories.to_angle(_from_vertex(command, vertex))
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
            # After a smart stop the last target counts if the motor is still near it. So a program
            # of many relative moves does not add up the errors at their ends.
            origin = state.position
            end = self.trajectory.end.position
            tolerance = self.settings.position_tolerance * 2
            if self.on_completion.is_smart and abs(end - origin) < tolerance:
                origin = end
        self.start_position(
            time,
            state,
            origin + distance,
            speed,
            then,
            allow_shift,
        )

    def start_hold(
        self,
        time: int,
        position: int,
    ) -> None:
        """Hold a position, without a ramp to it."""
        # The integrator keeps an active controller's pauses, so the time is counted as it counts.
        constant = Trajectory(self._trajectory_time(time), position)
        self._follow(
            _POSITION,
            constant,
            time,
            OnCompletion.HOLD,
        )

    def start_timed(
        self,
        time: int,
        state: State,
        duration: int,
        speed: int,
        then: OnCompletion,
    ) -> None:
        """Run at a speed (control units) for a duration in ticks."""
        # A smart stop needs a target, which a timed move does not have.
        if then.is_smart:
            then = then.passive
        start = TrajectoryReference(
            time,
            state.position,
            state.speed,
            0,
        )
        if self.is_active:
            start = self.trajectory.reference(self._trajectory_time(time))
        command = self._command(
            start._replace(time=time),
            speed,
            then,
            duration=duration,
        )
        new = trajectories.for_time(command)
        # As in `start_position`, rounding errors must not add up in a tight loop.
        if self.type is _TIMED and new.a0 == start.acceleration:
            vertex = self.trajectory.last_vertex(time)
            new = trajectories.for_time(_from_vertex(command, vertex))
        self._follow(_TIMED, new, time, then)

    def start_forever(
        self,
        time: int,
        state: State,
        speed: int,
    ) -> None:
        self.start_timed(
            time,
            state,
            _FOREVER,
            speed,
            OnCompletion.CONTINUE,
        )

    def start_until_stalled(
        self,
        time: int,
        state: State,
        speed: int,
        torque_limit: int,
        then: OnCompletion,
    ) -> None:
        """Run until stalled, with a torque limit (uNm) for this run only.

        It starts as an endless run, whose integral it continues, but not that of another run until
        stalled.
        """
        self.start_forever(time, state, speed)
        # The start sets all of these for an endless run, so they are changed after it.
        self.on_completion = then
        self._acts_when_done = False
        self._until_stalled = True
        self.torque_limit = torque_limit

    def _command(
        self,
        start: TrajectoryReference,
        speed: int,
        then: OnCompletion,
        **goal: int,
    ) -> TrajectoryCommand:
        s = self.settings
        return TrajectoryCommand(
            time=start.time,
            position=start.position,
            speed=start.speed,
            target_speed=speed,
            max_speed=s.max_speed,
            acceleration=s.acceleration,
            deceleration=s.deceleration,
            keep_running=then is OnCompletion.CONTINUE,
            **goal,
        )

    def update(
        self,
        time: int,
        position: int,
        speed: int,
        speed_estimate: int,
        paused_by_other: bool = False,
    ) -> Action:
        """One control step (``pbio_control_update``).

        Args:
            position, speed: measured, mdeg and mdeg/s.
            speed_estimate: the observer's.
            paused_by_other: whether the drive base pauses both its controllers.
        """
        # This is written in one piece, because most of a virtual robot's computing time is spent
        # here.
        s = self.settings
        limit = self.torque_limit
        end_time, end_position, end_speed, _ = self.trajectory.end
        # A timed move controls the speed, whose error integrates into a position. Its proportional
        # part works on that position, so there is no second integral.
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
        # Gains are in uNm per degree but errors in mdeg, so the products are divided by 1000.
        kp = s.kp if self._is_fast or error == 0 else self._soft_kp(error, target_error)
        proportional = trunc(kp * used_error / 1000)
        torque = proportional
        torque += trunc(s.kd * (reference_speed - speed_estimate) / 1000)
        if integral:
            torque += trunc(integral * s.ki / 1000)
        if torque > limit:
            torque = limit
        elif torque < -limit:
            torque = -limit
        # This is the anti-windup: at the limit, the reference waits for the motor. The cheap
        # comparison comes first, because it settles nearly all steps.
        at_limit = abs(proportional) >= limit and self._is_winding_up(
            proportional,
            speed,
            reference_speed,
            acceleration,
        )
        if integrator.running is (at_limit or paused_by_other):
            integrator.toggle(time, error)
        self._stalled = integrator.is_stalled(time, speed, reference_speed)
        # `load()` must not jump with each step, so the torque is smoothed over 20 of them.
        self.pid_average = trunc((self.pid_average * 95 + torque * 5) / 100)
        if self.log.is_active:
            # These are computed a second time, so that a step without a log does not pay for them.
            integral_part = trunc(integral * s.ki / 1000)
            derivative = trunc(s.kd * (reference_speed - speed_estimate) / 1000)
            self._terms = (
                reference_time,
                reference + used_error - error,
                reference_speed,
                proportional,
                integral_part,
                derivative,
                int(at_limit),
            )
        action = torque, reference_speed, acceleration, None, at_limit
        self.is_done = reference_time >= end_time and self._has_arrived(
            end_position - position, end_speed, speed
        )
        # An endless run counts as done from its start, and a run until stalled when it stalls.
        if self.type is _TIMED and not self.is_done:
            if self._until_stalled:
                self.is_done = self._stalled
            else:
                self.is_done = self.trajectory.t3 >= _FOREVER
        if not self.is_done or self._acts_when_done:
            return action
        then = self.on_completion
        if then.is_active:
            # A timed move that ends in HOLD goes on as a move of position, in whole units.
            position_in_units = s.position_to_unit(position)
            self.start_hold(time, position_in_units * s.steps_per_unit)
            return action
        # A smart stop holds a moment longer, so that the motor stands still and the next command
        # can go on from there.
        if then.is_smart and reference_time - end_time < s.smart_hold_time:
            return action
        self.stop()
        return 0, reference_speed, acceleration, then.passive, at_limit

    def log_row(
        self,
        time_ms: int,
        state: State,
        torque: int,
        passive: OnCompletion | None,
    ) -> None:
        """Log the last :meth:`update` and its outcome."""
        s = self.settings
        reference_time, reference, reference_speed, *terms, at_limit = self._terms
        # The firmware packs the kind of actuation and three flags into one column.
        actuation = ACTUATIONS[passive]
        actuation |= self._stalled << 2
        actuation |= self.is_done << 3
        actuation |= at_limit << 4
        self.log.add(
            time_ms,
            reference_time - self.trajectory.time,
            s.position_to_unit(state.position),
            s.to_unit(state.speed),
            actuation,
            torque,
            s.position_to_unit(reference),
            s.to_unit(reference_speed),
            s.position_to_unit(state.position_estimate),
            s.to_unit(state.speed_estimate),
            *terms,
        )

    def _trajectory_time(self, time: int) -> int:
        # Only the position integrator stops the trajectory's clock in a pause.
        if self.type is _POSITION:
            return self._position.trajectory_time(time)
        return time

    def _follow(
        self,
        new: ControlType,
        trajectory: Trajectory,
        time: int,
        then: OnCompletion,
    ) -> None:
        self.trajectory = trajectory
        # The factor 100 is needed because `wu` is in ddeg/s and the limit in mdeg/s.
        self._is_fast = abs(trajectory.wu) * 100 >= self.settings.kp_low_speed
        self.on_completion = then
        # A timed move that ends in HOLD is left out, because its end has a step of its own in
        # `update`.
        goes_on = new is _POSITION or then is OnCompletion.CONTINUE
        self._acts_when_done = then.is_active and goes_on
        self.torque_limit = self.settings.max_torque
        self.is_done = False
        # Commands of one kind in a row share an integrator, so that its integral and a pause
        # outlast them. Another kind begins anew, and so does what follows a run until stalled.
        if self.type is new and not self._until_stalled:
            return
        self._stalled = False
        if new is _POSITION:
            self._position = PositionIntegrator(self.settings, time)
        else:
            self._speed = SpeedIntegrator(self.settings)
        self.type = new
        self._until_stalled = False

    def _soft_kp(
        self,
        error: int,
        target_error: int,
    ) -> int:
        """Position gain of a slow move: reduced for small errors, full near the target."""
        s = self.settings
        target_error = abs(target_error)
        near = s.saturation_error
        if target_error < near:
            return s.kp
        # The gain by the error gives the torque the low slope up to kp_low_error, and the full one
        # beyond.
        error = abs(error)
        low = s.kp * s.kp_low_pct // 100
        by_error = low
        if error > s.kp_low_error:
            by_error = s.kp - s.kp_low_error * (s.kp - low) // error
        # The gain by the remaining way rises from low, when far away, to full near the target. The
        # larger of both gains counts.
        far = near * 100 // s.kp_low_pct
        if target_error > far:
            return max(by_error, low)
        product = s.kp * (100 - s.kp_low_pct) * (far - target_error)
        # This product overflows 32 bits in the firmware, which goes on with the wrapped value.
        product = (product + 2**31) % 2**32 - 2**31
        added = trunc(trunc(product / (far - near)) / 100)
        return max(by_error, low + added)

    def _is_winding_up(
        self,
        proportional: int,
        speed: int,
        reference_speed: int,
        acceleration: int,
    ) -> bool:
        """Whether the proportional part alone exceeds the torque limit, and the reference will not
        reduce it."""
        s = self.settings
        # The margin is the way of two steps. With it, the torque does not fall below the limit
        # again in the very next step.
        margin = trunc(abs(speed) / LOOPS_PER_S) * 2
        max_windup_torque = self.torque_limit + trunc(s.kp * margin / 1000)
        if abs(proportional) < max_windup_torque:
            return False
        # If the reference already turns back or brakes, going on is what frees the motor.
        moving = 0 if abs(speed) < s.stall_speed else speed
        sign = _sign(proportional)
        speed_helps = sign == -_sign(reference_speed - moving)
        acceleration_helps = sign == -_sign(acceleration)
        return not speed_helps and not acceleration_helps

    def _has_arrived(
        self,
        remaining: int,
        end_speed: int,
        speed: int,
    ) -> bool:
        """Whether the end is reached, given that its time is over."""
        if self.type is _TIMED:
            return not self._until_stalled
        # A move that goes on has arrived once it is past its target, however far.
        if end_speed != 0:
            return _sign(remaining) != _sign(end_speed)
        s = self.settings
        return abs(speed) <= s.speed_tolerance and abs(remaining) <= s.position_tolerance


def _from_vertex(command: TrajectoryCommand, vertex: TrajectoryReference) -> TrajectoryCommand:
    # A timed move that starts earlier becomes longer by as much, so that its end stays.
    duration = 0
    if command.duration:
        duration = command.duration + command.time - vertex.time
    return command._replace(
        time=vertex.time,
        position=vertex.position,
        speed=vertex.speed,
        duration=duration,
    )
