"""Reference trajectories: speed up, cruise, slow down, each with constant acceleration.

Speeds inside this module are in ddeg/s and accelerations in deg/s2, for the same rounding as in the
firmware.
"""

import math
from collections.abc import Callable
from math import trunc
from typing import NamedTuple

from brickhub.virtual.firmware import InfeasibleMoveError, RefusedError

FOREVER_MS = 60_000
_ANGLE_MAX_MDEG = (2**31 - 1) // 2
_SPEED_MAX = 20_000
_ACCELERATION_MIN = 50
_ACCELERATION_MAX = 20_000
_TIME_MAX = _ANGLE_MAX_MDEG // (_SPEED_MAX * 100) * 10_000
TURN_MDEG = 360_000
_TURNS_MAX = _ANGLE_MAX_MDEG // TURN_MDEG - 1
INT32_MAX = 2**31 - 1


class TrajectoryCommand(NamedTuple):
    """Start and goal of a trajectory; control units.

    ``end`` is the target position of an angle command, ``duration`` (ticks) that of a timed one.
    """

    time: int
    position: int
    speed: int
    target_speed: int
    max_speed: int
    acceleration: int
    deceleration: int
    keep_running: bool
    end: int = 0
    duration: int = 0


class TrajectoryReference(NamedTuple):
    """A point on a trajectory; control units."""

    time: int
    position: int
    speed: int
    acceleration: int


class Trajectory:
    """Three phases: until t1 with a0, until t2 at speed w1, until t3 with a2, then at speed w3.

    ``wu`` is the requested speed, whether reached or not.
    """

    __slots__ = (
        "a0",
        "a2",
        "end",
        "position",
        "t1",
        "t2",
        "t3",
        "th1",
        "th2",
        "th3",
        "time",
        "w0",
        "w1",
        "w3",
        "wu",
    )

    def __init__(self, time: int, position: int) -> None:
        """A constant trajectory."""
        self.time = time
        self.position = position
        self.t1 = self.t2 = self.t3 = 0
        self.th1 = self.th2 = self.th3 = 0
        self.w0 = self.w1 = self.wu = self.w3 = 0
        self.a0 = self.a2 = 0
        self.end = self._endpoint()

    def last_vertex(self, time: int) -> TrajectoryReference:
        """Start of the phase at a time."""
        t = time - self.time
        if t < self.t1 or t == self.t1 == 0:
            return self._point(0, 0, self.w0, 0)
        if t < self.t2:
            return self._point(self.t1, self.th1, self.w1, 0)
        if t < self.t3:
            return self._point(self.t2, self.th2, self.w1, 0)
        return self.end

    def reference(self, time: int) -> TrajectoryReference:
        """Reference of the motor at a time."""
        return TrajectoryReference(time, *self.at(time))

    def at(self, time: int) -> tuple[int, int, int]:
        """Position, speed and acceleration at a time, without the cost of a
        :class:`TrajectoryReference`."""
        t = time - self.time
        if t < self.t1 or t == self.t1 == 0:
            a = self.a0
            gain = trunc(a * t / 1000)
            th = trunc(self.w0 * t / 100) + trunc(trunc(gain * t / 100) / 2)
            return self.position + th, (self.w0 + gain) * 100, a * 1000
        if t < self.t2:
            w = self.w1
            return self.position + self.th1 + trunc(w * (t - self.t1) / 100), w * 100, 0
        if t < self.t3:
            t -= self.t2
            a = self.a2
            w = self.w1
            gain = trunc(a * t / 1000)
            th = self.th2 + trunc(w * t / 100) + trunc(trunc(gain * t / 100) / 2)
            return self.position + th, (w + gain) * 100, a * 1000
        w = self.w3
        if not w:
            return self.position + self.th3, 0, 0
        return self.position + self.th3 + trunc(w * (t - self.t3) / 100), w * 100, 0

    def stretch(self, leader: "Trajectory") -> None:
        """Cover the same angle with the phases of a longer trajectory, so that both end
        together."""
        self.t1 = leader.t1
        self.t2 = leader.t2
        self.t3 = leader.t3
        if self.t3 == 0:
            self.end = self._endpoint()
            return
        braking = self.t3 - self.t2
        angle = 2 * self.th3 - _angle(self.w0, self.t1) - _angle(self.w3, braking)
        duration = self.t3 + self.t2 - self.t1
        # An angle that would overflow 32 bits loses digits first, as in the firmware.
        self.w1 = (
            trunc(angle * 100 / duration)
            if abs(angle) < INT32_MAX // 100
            else trunc(angle / duration) * 100
        )
        self.a0 = trunc((self.w1 - self.w0) * 1000 / self.t1) if self.t1 else 0
        self.a2 = trunc((self.w3 - self.w1) * 1000 / braking) if braking else 0
        self.w3 = 0 if braking else self.w1
        self.th1 = _angle(self.w0, self.t1) + trunc(
            _angle(_speed_gain(self.a0, self.t1), self.t1) / 2
        )
        self.th2 = self.th1 + _angle(self.w1, self.t2 - self.t1)
        self.end = self._endpoint()

    def _point(self, t: int, th: int, w: int, a: int) -> TrajectoryReference:
        return TrajectoryReference(self.time + t, self.position + th, w * 100, a * 1000)

    def _endpoint(self) -> TrajectoryReference:
        return self._point(self.t3, self.th3, self.w3, 0)

    def _mirror(self) -> None:
        self.th1 = -self.th1
        self.th2 = -self.th2
        self.th3 = -self.th3
        self.wu = -self.wu
        self.w0 = -self.w0
        self.w1 = -self.w1
        self.w3 = -self.w3
        self.a0 = -self.a0
        self.a2 = -self.a2


def to_angle(command: TrajectoryCommand) -> Trajectory:
    """The trajectory that ends at ``command.end``; the sign of the target speed is ignored. Raises
    ValueError if the angle or its duration is too long, InfeasibleMoveError if rounding leaves no
    trajectory."""
    distance = command.end - command.position
    if (abs(distance) - 1) // TURN_MDEG >= _TURNS_MAX:
        raise RefusedError("the angle is too large for one move")
    if command.target_speed == 0 or distance == 0:
        return Trajectory(command.time, command.position)
    return _built(
        command._replace(end=command.position + abs(distance)), distance < 0, _forward_angle
    )


def for_time(command: TrajectoryCommand) -> Trajectory:
    """The trajectory that lasts ``command.duration``. Raises ValueError if that is too long,
    InfeasibleMoveError if rounding leaves no trajectory, as with almost equal accelerations."""
    if command.duration == 0:
        return Trajectory(command.time, command.position)
    return _built(command, command.target_speed < 0, _forward_time)


def _built(
    command: TrajectoryCommand, backward: bool, build: Callable[[TrajectoryCommand], Trajectory]
) -> Trajectory:
    """The trajectory of a command, built forward."""
    speed = -command.speed if backward else command.speed
    trajectory = build(
        command._replace(
            target_speed=min(abs(command.target_speed), command.max_speed), speed=speed
        )
    )
    angles_are_ordered = (
        build is _forward_time or trajectory.th1 <= trajectory.th2 <= trajectory.th3
    )
    if not (0 <= trajectory.t1 <= trajectory.t2 <= trajectory.t3 and angles_are_ordered):
        raise InfeasibleMoveError("the phases of the move are not in order")
    if backward:
        trajectory._mirror()
    trajectory.end = trajectory._endpoint()
    return trajectory


def validate_speed(steps_per_unit: int, speed: int) -> None:
    """Raise ValueError for a speed limit that the firmware refuses."""
    if not 100 * 100 // steps_per_unit <= speed <= _SPEED_MAX * 100 // steps_per_unit:
        raise RefusedError("the speed limit is out of range")


def validate_acceleration(steps_per_unit: int, acceleration: int) -> None:
    """Raise ValueError for an acceleration limit that the firmware refuses."""
    low = _ACCELERATION_MIN * 1000 // steps_per_unit
    high = _ACCELERATION_MAX * 1000 // steps_per_unit
    if not low <= acceleration <= high:
        raise RefusedError("the acceleration limit is out of range")


def _speed_gain(a: int, t: int) -> int:
    return trunc(a * t / 1000)


def _angle(w: int, t: int) -> int:
    return trunc(w * t / 100)


def _ramp_angle(w_end: int, w_start: int, a: int) -> int:
    """Angle turned while the speed changes."""
    return trunc((w_end * w_end - w_start * w_start) * 5 / a)


def _ramp_time(w: int, a: int) -> int:
    return trunc(w * 1000 / a)


def _start_speed(w_end: int, a: int, th: int) -> int:
    """Speed from which ``a`` leads to ``w_end`` within an angle."""
    return math.isqrt(max(0, w_end * w_end + trunc(a * th / 5)))


def _start(command: TrajectoryCommand) -> tuple[Trajectory, int, int, int]:
    """A trajectory with its given speeds, then target speed, acceleration and deceleration."""
    trajectory = Trajectory(command.time, command.position)
    speeds = (trunc(speed / 100) for speed in (command.target_speed, command.speed))
    target, trajectory.w0 = (max(-_SPEED_MAX, min(_SPEED_MAX, speed)) for speed in speeds)
    trajectory.wu = target
    trajectory.w3 = target if command.keep_running else 0
    rates = (trunc(rate / 1000) for rate in (command.acceleration, command.deceleration))
    acceleration, deceleration = (
        max(_ACCELERATION_MIN, min(_ACCELERATION_MAX, rate)) for rate in rates
    )
    return trajectory, target, acceleration, deceleration


def _forward_angle(command: TrajectoryCommand) -> Trajectory:
    tr, target, accel, decel = _start(command)
    tr.th3 = command.end - command.position
    strongest = max(accel, decel)
    if tr.w0 > 0 and _ramp_angle(tr.w0, tr.w3, strongest) > tr.th3:
        tr.w0 = _start_speed(tr.w3, strongest, tr.th3)
    # A start in the wrong direction adds to the angle.
    angle = tr.th3 - (0 if tr.w0 > 0 else _ramp_angle(0, tr.w0, accel))
    if _ramp_angle(target, tr.w3, decel) > angle:
        target = _start_speed(tr.w3, decel, angle)
    if target == 0:
        return Trajectory(command.time, command.position)
    if trunc(angle * 100 / target) + (_ramp_time(-tr.w0, accel) if tr.w0 < 0 else 0) > _TIME_MAX:
        raise RefusedError("the move would take too long")
    tr.a0 = accel if tr.w0 < target else -accel
    tr.a2 = -decel
    # Angle at which the first ramp, extrapolated, has speed zero.
    origin = _ramp_angle(0, tr.w0, tr.a0)
    tr.th1 = origin + _ramp_angle(target, 0, tr.a0)
    tr.th2 = tr.th3 + _ramp_angle(target, tr.w3, tr.a2)
    tr.w1 = target
    if tr.th2 < tr.th1:
        _join_ramps(tr, origin, accel, command.keep_running)
    cruise = 0 if tr.th2 == tr.th1 else trunc((tr.th2 - tr.th1) * 100 / tr.w1)
    tr.t1 = _ramp_time(tr.w1 - tr.w0, tr.a0)
    if tr.t1 == 0:
        tr.w0 = tr.w1
    tr.t2 = tr.t1 + cruise
    tr.t3 = tr.t2 + _ramp_time(tr.w3 - tr.w1, tr.a2)
    return tr


def _join_ramps(tr: Trajectory, origin: int, accel: int, keep_running: bool) -> None:
    """Let the ramps meet without a cruise, for an angle that is too small for the target speed."""
    if keep_running and tr.a0 > 0:
        tr.w1 = tr.w3 = _start_speed(0, tr.a0, tr.th3 - origin)
        tr.th1 = tr.th2 = tr.th3
    elif keep_running:
        tr.w0 = _start_speed(tr.w3, -tr.a0, tr.th3)
        tr.w1 = tr.w3
        tr.th1 = tr.th2 = tr.th3
    else:
        if tr.th3 == origin:
            tr.th1 = origin
        else:
            tr.th1 = origin + trunc((tr.th3 - origin) * tr.a2 / (tr.a2 - tr.a0))
        tr.th2 = tr.th1
        tr.w1 = _start_speed(0, tr.a0, tr.th1 - origin)
        # Rounding may have put the peak on the other side of the start speed.
        tr.a0 = accel if tr.w0 < tr.w1 else -accel


def _forward_time(command: TrajectoryCommand) -> Trajectory:
    if command.duration > _TIME_MAX:
        raise RefusedError("the duration is too long for one move")
    tr, target, accel, decel = _start(command)
    tr.t3 = command.duration
    if _angle(target, tr.t3) > _ANGLE_MAX_MDEG:
        raise RefusedError("the move would turn too far")
    strongest = max(accel, decel)
    if _ramp_time(tr.w0, accel) < -tr.t3:
        tr.w0 = -_speed_gain(accel, tr.t3)
    if _ramp_time(tr.w0 - tr.w3, strongest) > tr.t3:
        tr.w0 = tr.w3 + _speed_gain(strongest, tr.t3)
    if _ramp_time(target - tr.w3, decel) > tr.t3:
        target = tr.w3 + _speed_gain(decel, tr.t3)
    tr.a0 = accel if tr.w0 < target else -accel
    tr.a2 = -decel
    tr.t1 = _ramp_time(target - tr.w0, tr.a0)
    cruise = tr.t3 - tr.t1 - _ramp_time(tr.w3 - target, tr.a2)
    tr.w1 = target
    if cruise < 0:
        cruise = 0
        if command.keep_running and tr.a0 > 0:
            tr.t1 = tr.t3
            tr.w1 = tr.w3 = tr.w0 + _speed_gain(tr.a0, tr.t3)
        else:
            tr.t1 = _ramp_time(tr.w3 - tr.w0 - _speed_gain(tr.a2, tr.t3), tr.a0 - tr.a2)
            tr.w1 = tr.w0 + _speed_gain(tr.a0, tr.t1)
    if tr.t1 == 0:
        tr.w0 = tr.w1
    tr.t2 = tr.t1 + cruise
    tr.th1 = _ramp_angle(tr.w1, tr.w0, tr.a0)
    tr.th2 = tr.th1 + _angle(tr.w1, cruise)
    tr.th3 = tr.th2 + _ramp_angle(tr.w3, tr.w1, tr.a2)
    return tr
