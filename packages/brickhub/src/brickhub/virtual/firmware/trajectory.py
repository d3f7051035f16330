"""Reference trajectories: speed up, cruise, slow down, each with constant acceleration.

Speeds inside this module are in ddeg/s and accelerations in deg/s2, for the same rounding as in the
firmware (``pbio/trajectory.c``, v4). The names of its variables are the firmware's: ``t`` is a time
since the start in ticks of 0.1 ms, ``th`` an angle since the start in mdeg, ``w`` a speed, ``a`` an
acceleration. A factor such as 100 or 1000 in a formula converts between these units: ddeg/s times
ticks is a hundredth of a mdeg, deg/s2 times ticks a thousandth of a ddeg/s.
"""

import math
from collections.abc import Callable
from math import trunc
from typing import NamedTuple

from brickhub.virtual.firmware import InfeasibleMoveError, RefusedError

FOREVER_MS = 60_000
"""Length of a move without an end: a minute, after which the last speed goes on."""
TURN_MDEG = 360_000
INT32_MAX = 2**31 - 1
# An angle takes half of 32 bits, so that a sum or a difference of two angles still fits.
_ANGLE_MAX_MDEG = (2**31 - 1) // 2
# These limit any command, in deg/s and deg/s2 at the motor times the scales of this module.
_SPEED_MAX = 20_000
_ACCELERATION_MIN = 50
_ACCELERATION_MAX = 20_000
# Within this many ticks, even the fastest move stays inside the largest angle.
_TIME_MAX = _ANGLE_MAX_MDEG // (_SPEED_MAX * 100) * 10_000
_TURNS_MAX = _ANGLE_MAX_MDEG // TURN_MDEG - 1


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

    ``wu`` is the requested speed, whether reached or not. Times and angles count from the start, at
    ``time`` and ``position``, where the speed is ``w0``.
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

    def __init__(
        self,
        time: int,
        position: int,
    ) -> None:
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
        # A trajectory without a first ramp still begins at its start, because the firmware takes
        # the moment 0 into the first phase even where that has no length.
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
        # The small functions below are written out here, because this runs in each control step of
        # each motor. Each product is truncated on its own, in the firmware's order.
        t = time - self.time
        if t < self.t1 or t == self.t1 == 0:
            a = self.a0
            gain = trunc(a * t / 1000)
            th = trunc(self.w0 * t / 100)
            th += trunc(trunc(gain * t / 100) / 2)
            return self.position + th, (self.w0 + gain) * 100, a * 1000
        if t < self.t2:
            w = self.w1
            th = self.th1 + trunc(w * (t - self.t1) / 100)
            return self.position + th, w * 100, 0
        if t < self.t3:
            t -= self.t2
            a = self.a2
            w = self.w1
            gain = trunc(a * t / 1000)
            th = self.th2 + trunc(w * t / 100)
            th += trunc(trunc(gain * t / 100) / 2)
            return self.position + th, (w + gain) * 100, a * 1000
        w = self.w3
        # Moves usually end with a motor that holds, for which nothing has to be multiplied.
        if not w:
            return self.position + self.th3, 0, 0
        th = self.th3 + trunc(w * (t - self.t3) / 100)
        return self.position + th, w * 100, 0

    def stretch(self, leader: "Trajectory") -> None:
        """Cover the same angle with the phases of a longer trajectory, so that both end
        together."""
        self.t1 = leader.t1
        self.t2 = leader.t2
        self.t3 = leader.t3
        if self.t3 == 0:
            self.end = self._endpoint()
            return
        # The speed over time is a trapezoid, whose area is the angle. Times, angle, w0 and w3 are
        # given, so twice the area gives its height, w1.
        braking = self.t3 - self.t2
        angle_of_w0 = _angle(self.w0, self.t1)
        angle_of_w3 = _angle(self.w3, braking)
        angle = 2 * self.th3 - angle_of_w0 - angle_of_w3
        duration = self.t3 + self.t2 - self.t1
        # An angle that would overflow 32 bits is shortened first, as in the firmware.
        if abs(angle) < INT32_MAX // 100:
            self.w1 = trunc(angle * 100 / duration)
        else:
            self.w1 = trunc(angle / duration) * 100
        # The accelerations follow from w1, so they are computed before w3 is overwritten.
        self.a0 = 0
        if self.t1:
            self.a0 = trunc((self.w1 - self.w0) * 1000 / self.t1)
        self.a2 = 0
        if braking:
            self.a2 = trunc((self.w3 - self.w1) * 1000 / braking)
        self.w3 = 0 if braking else self.w1
        speed_gain = _speed_gain(self.a0, self.t1)
        angle_gain = trunc(_angle(speed_gain, self.t1) / 2)
        self.th1 = angle_of_w0 + angle_gain
        self.th2 = self.th1 + _angle(self.w1, self.t2 - self.t1)
        self.end = self._endpoint()

    def _point(
        self,
        t: int,
        th: int,
        w: int,
        a: int,
    ) -> TrajectoryReference:
        return TrajectoryReference(
            self.time + t,
            self.position + th,
            w * 100,
            a * 1000,
        )

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
    turns = (abs(distance) - 1) // TURN_MDEG
    if turns >= _TURNS_MAX:
        raise RefusedError("the angle is too large for one move")
    if command.target_speed == 0 or distance == 0:
        return Trajectory(command.time, command.position)
    # Every move is computed forward and mirrored if need be, so that only one sign of each square
    # root and each comparison has to be right.
    forward = command._replace(end=command.position + abs(distance))
    return _built(forward, distance < 0, _forward_angle)


def for_time(command: TrajectoryCommand) -> Trajectory:
    """The trajectory that lasts ``command.duration``. Raises ValueError if that is too long,
    InfeasibleMoveError if rounding leaves no trajectory, as with almost equal accelerations."""
    if command.duration == 0:
        return Trajectory(command.time, command.position)
    is_backward = command.target_speed < 0
    return _built(command, is_backward, _forward_time)


def _built(
    command: TrajectoryCommand,
    backward: bool,
    build: Callable[[TrajectoryCommand], Trajectory],
) -> Trajectory:
    """The trajectory of a command, built forward."""
    speed = -command.speed if backward else command.speed
    target_speed = min(abs(command.target_speed), command.max_speed)
    forward = command._replace(target_speed=target_speed, speed=speed)
    trajectory = build(forward)
    # Integers may round a phase to a negative length. As in the firmware, the times are checked for
    # both kinds of commands, but the angles only where they were the goal.
    times_are_ordered = 0 <= trajectory.t1 <= trajectory.t2 <= trajectory.t3
    angles_are_ordered = (
        build is _forward_time or trajectory.th1 <= trajectory.th2 <= trajectory.th3
    )
    if not (times_are_ordered and angles_are_ordered):
        raise InfeasibleMoveError("the phases of the move are not in order")
    if backward:
        trajectory._mirror()
    trajectory.end = trajectory._endpoint()
    return trajectory


def validate_speed(steps_per_unit: int, speed: int) -> None:
    """Raise ValueError for a speed limit that the firmware refuses."""
    low = 100 * 100 // steps_per_unit
    high = _SPEED_MAX * 100 // steps_per_unit
    if not low <= speed <= high:
        raise RefusedError("the speed limit is out of range")


def validate_acceleration(steps_per_unit: int, acceleration: int) -> None:
    """Raise ValueError for an acceleration limit that the firmware refuses."""
    low = _ACCELERATION_MIN * 1000 // steps_per_unit
    high = _ACCELERATION_MAX * 1000 // steps_per_unit
    if not low <= acceleration <= high:
        raise RefusedError("the acceleration limit is out of range")


# These are the firmware's formulas (`mul_a_by_t`, `mul_w_by_t`, `div_w2_by_a`, `div_w_by_a` and
# `bind_w0`), each with one truncation at its end.


def _speed_gain(a: int, t: int) -> int:
    return trunc(a * t / 1000)


def _angle(w: int, t: int) -> int:
    return trunc(w * t / 100)


def _ramp_angle(
    w_end: int,
    w_start: int,
    a: int,
) -> int:
    """Angle turned while the speed changes."""
    change_of_square = w_end * w_end - w_start * w_start
    # The formula's half gives 5 together with the units: the square of a ddeg/s by a deg/s2 is a
    # hundredth of a degree, which is 10 mdeg.
    return trunc(change_of_square * 5 / a)


def _ramp_time(w: int, a: int) -> int:
    return trunc(w * 1000 / a)


def _start_speed(
    w_end: int,
    a: int,
    th: int,
) -> int:
    """Speed from which ``a`` leads to ``w_end`` within an angle."""
    square = w_end * w_end + trunc(a * th / 5)
    # Rounding may put the square a little below zero.
    return math.isqrt(max(0, square))


def _start(command: TrajectoryCommand) -> tuple[Trajectory, int, int, int]:
    """A trajectory with its given speeds, then target speed, acceleration and deceleration."""
    trajectory = Trajectory(command.time, command.position)
    target = _bounded_speed(command.target_speed)
    trajectory.w0 = _bounded_speed(command.speed)
    trajectory.wu = target
    trajectory.w3 = target if command.keep_running else 0
    acceleration = _bounded_acceleration(command.acceleration)
    deceleration = _bounded_acceleration(command.deceleration)
    return trajectory, target, acceleration, deceleration


def _bounded_speed(speed_mdeg_s: int) -> int:
    """A speed in ddeg/s, within the limits of any command."""
    speed = trunc(speed_mdeg_s / 100)
    return max(-_SPEED_MAX, min(_SPEED_MAX, speed))


def _bounded_acceleration(acceleration_mdeg_s2: int) -> int:
    """An acceleration in deg/s2, within the limits of any command."""
    acceleration = trunc(acceleration_mdeg_s2 / 1000)
    return max(_ACCELERATION_MIN, min(_ACCELERATION_MAX, acceleration))


def _forward_angle(command: TrajectoryCommand) -> Trajectory:
    """A trajectory over an angle ahead (``pbio_trajectory_new_forward_angle_command``)."""
    tr, target, accel, decel = _start(command)
    w0 = tr.w0
    w3 = tr.w3
    th3 = command.end - command.position
    # The motor may turn too fast to stop within the angle. Then the reference starts slower than
    # the motor, as fast as the strongest ramp allows.
    strongest = max(accel, decel)
    if w0 > 0 and _ramp_angle(w0, w3, strongest) > th3:
        w0 = _start_speed(w3, strongest, th3)
    # Starting in the wrong direction makes the angle longer.
    angle = th3
    if w0 <= 0:
        angle -= _ramp_angle(0, w0, accel)
    # The target speed must leave room for the last ramp.
    if _ramp_angle(target, w3, decel) > angle:
        target = _start_speed(w3, decel, angle)
    if target == 0:
        return Trajectory(command.time, command.position)
    # All of the angle at the target speed, after the way back, is an upper bound, which is enough
    # here.
    duration = trunc(angle * 100 / target)
    if w0 < 0:
        duration += _ramp_time(-w0, accel)
    if duration > _TIME_MAX:
        raise RefusedError("the move would take too long")
    a0 = accel if w0 < target else -accel
    a2 = -decel
    # At this angle the first ramp, extrapolated, would have speed zero.
    origin = _ramp_angle(0, w0, a0)
    th1 = origin + _ramp_angle(target, 0, a0)
    th2 = th3 + _ramp_angle(target, w3, a2)
    tr.th1 = th1
    tr.th2 = th2
    tr.th3 = th3
    tr.w0 = w0
    tr.w1 = target
    tr.a0 = a0
    tr.a2 = a2
    if th2 < th1:
        _join_ramps(
            tr,
            origin,
            accel,
            command.keep_running,
        )
    # Angles were the goal, so the times follow from them.
    cruise = 0
    if tr.th2 != tr.th1:
        cruise = trunc((tr.th2 - tr.th1) * 100 / tr.w1)
    tr.t1 = _ramp_time(tr.w1 - tr.w0, tr.a0)
    # If the first ramp is too short for a tick, the speed would have a step at its start.
    if tr.t1 == 0:
        tr.w0 = tr.w1
    tr.t2 = tr.t1 + cruise
    tr.t3 = tr.t2 + _ramp_time(tr.w3 - tr.w1, tr.a2)
    return tr


def _join_ramps(
    tr: Trajectory,
    origin: int,
    accel: int,
    keep_running: bool,
) -> None:
    """Let the ramps meet without a cruise, for an angle that is too small for the target speed."""
    if keep_running and tr.a0 > 0:
        # The motor never reaches the target speed, so it speeds up to the very end and goes on with
        # the speed that it has there.
        tr.w1 = tr.w3 = _start_speed(0, tr.a0, tr.th3 - origin)
        tr.th1 = tr.th2 = tr.th3
    elif keep_running:
        # The motor is too fast, and slows down to the speed with which it goes on.
        tr.w0 = _start_speed(tr.w3, -tr.a0, tr.th3)
        tr.w1 = tr.w3
        tr.th1 = tr.th2 = tr.th3
    else:
        # Over the angle, the squares of the speeds of both ramps are straight lines, which cross
        # here. Without any angle between them both may fall alike, which would divide by 0.
        angle = tr.th3 - origin
        if angle == 0:
            tr.th1 = origin
        else:
            tr.th1 = origin + trunc(angle * tr.a2 / (tr.a2 - tr.a0))
        tr.th2 = tr.th1
        tr.w1 = _start_speed(0, tr.a0, tr.th1 - origin)
        # Rounding may have put the peak on the other side of the start speed.
        tr.a0 = accel if tr.w0 < tr.w1 else -accel


def _forward_time(command: TrajectoryCommand) -> Trajectory:
    """A trajectory over a duration, ahead (``pbio_trajectory_new_forward_time_command``)."""
    if command.duration > _TIME_MAX:
        raise RefusedError("the duration is too long for one move")
    tr, target, accel, decel = _start(command)
    w0 = tr.w0
    w3 = tr.w3
    t3 = command.duration
    if _angle(target, t3) > _ANGLE_MAX_MDEG:
        raise RefusedError("the move would turn too far")
    # The first speed and the target are bounded so that each ramp alone fits into the duration: one
    # that starts backward need not reach zero, and one that is too fast must still get slow enough.
    strongest = max(accel, decel)
    if _ramp_time(w0, accel) < -t3:
        w0 = -_speed_gain(accel, t3)
    if _ramp_time(w0 - w3, strongest) > t3:
        w0 = w3 + _speed_gain(strongest, t3)
    if _ramp_time(target - w3, decel) > t3:
        target = w3 + _speed_gain(decel, t3)
    a0 = accel if w0 < target else -accel
    a2 = -decel
    t1 = _ramp_time(target - w0, a0)
    braking = _ramp_time(w3 - target, a2)
    cruise = t3 - t1 - braking
    w1 = target
    if cruise < 0:
        # The ramps overlap, so they meet below the target speed without a cruise between them.
        cruise = 0
        if command.keep_running and a0 > 0:
            # The motor never reaches the target speed, so it speeds up to the very end and goes on
            # with the speed that it has there.
            t1 = t3
            w1 = w3 = w0 + _speed_gain(a0, t3)
        else:
            # Both ramps are straight lines over time. Extrapolated to the start, the last one has
            # this lead in speed, which the first one makes up until they cross.
            lead = w3 - w0 - _speed_gain(a2, t3)
            t1 = _ramp_time(lead, a0 - a2)
            w1 = w0 + _speed_gain(a0, t1)
    # As above, the speed must have no step where the first ramp is too short for a tick.
    if t1 == 0:
        w0 = w1
    # Times were the goal, so the angles follow from them.
    tr.t1 = t1
    tr.t2 = t1 + cruise
    tr.t3 = t3
    tr.th1 = _ramp_angle(w1, w0, a0)
    tr.th2 = tr.th1 + _angle(w1, cruise)
    tr.th3 = tr.th2 + _ramp_angle(w3, w1, a2)
    tr.w0 = w0
    tr.w1 = w1
    tr.w3 = w3
    tr.a0 = a0
    tr.a2 = a2
    return tr
