"""``hub.imu``: gyroscope and accelerometer, and the accelerometer of the Move hub.

The latter computes with integers (``pb_type_movehub.c``, v4).
"""

import math
from collections.abc import Sequence
from typing import Any

from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.firmware.drive_base import GyroHeading
from brickhub.virtual.micropython.exceptions import HubOSError
from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.pybricks.arguments import expect, get_array, get_int, get_number
from brickhub.virtual.pybricks.context import Native
from brickhub.virtual.pybricks.matrix import Matrix, vector
from brickhub.virtual.pybricks.parameters import Axis, Side

_DEG_PER_RAD = 57.296
"""Degrees of a radian, as rounded in the firmware, whose angles differ from the exact ones in the
last digits."""
_GRAVITY_MM_S2 = 9806.65
_REST_MS = 1000
"""Duration of 833 samples of the gyroscope, all below the threshold."""
_SETTINGS: dict[str, tuple[Any, float]] = {
    "angular_velocity_threshold": (2.0, math.inf),
    "acceleration_threshold": (2500.0, math.inf),
    "angular_velocity_bias": ((0.0, 0.0, 0.0), math.inf),
    "angular_velocity_scale": ((360.0, 360.0, 360.0), 15.0),
    "acceleration_correction": ((_GRAVITY_MM_S2, -_GRAVITY_MM_S2) * 3, _GRAVITY_MM_S2 / 10),
    "heading_correction": (360.0, 15.0),
}
"""Default values, and the largest deviation from them that the firmware accepts."""
_Vector = tuple[float, float, float]
_MM_S2_PER_STEP = 0.244 * 9.81
"""Resolution of the accelerometer (LSM6DS3TR-C) in its range of 8 g."""
# In its range of 2 g, the Move hub's sensor (LIS3DH) has 8 bits. The firmware has no floats there,
# so it shows a count as a whole number of mm/s2.
_COUNTS_PER_G = 64
_G_MM_S2 = 9806.65
_MM_S2_PER_COUNT = 158
_ARC_TANGENTS = (
    (0, 0),
    (409, 178),
    (972, 348),
    (1638, 472),
    (2560, 545),
    (3891, 605),
    (5120, 632),
    (7168, 660),
    (15360, 692),
    (25600, 705),
)
"""1024 times a ratio, and 8 times its arc tangent in degrees (``pbio/int_math.c``)."""


def _side_up(upwards: Sequence[float]) -> Any:
    """The ``Side`` of the hub through which a vector in its frame passes."""
    magnitudes = [abs(part) for part in upwards]
    largest = magnitudes.index(max(magnitudes))
    sides_of_axes = (
        (Side.FRONT, Side.BACK),
        (Side.LEFT, Side.RIGHT),
        (Side.TOP, Side.BOTTOM),
    )
    positive, negative = sides_of_axes[largest]
    return positive if upwards[largest] >= 0 else negative


def _axis(value: Any) -> _Vector:
    if not isinstance(value, Matrix):
        raise TypeError("Axis must be Matrix.")
    values = list(value)
    if len(values) != 3:
        raise ValueError("Axis must be 1x3 or 3x1 matrix.")
    return values[0], values[1], values[2]


def _project(value: _Vector, axis: Any) -> float:
    direction = _axis(axis)
    length = math.sqrt(_dot(direction, direction))
    expect(length)
    return to_single(_dot(value, direction) / length)


def _dot(a: _Vector, b: _Vector) -> float:
    # The sum begins with 0.0, so that it is never -0.0.
    total = 0.0
    total += a[0] * b[0]
    total += a[1] * b[1]
    total += a[2] * b[2]
    return total


def _scaled_to_one(vector: _Vector) -> _Vector:
    """The unit vector of the same direction."""
    length = math.sqrt(_dot(vector, vector))
    x, y, z = vector
    return x / length, y / length, z / length


class IMU(Native):
    """Gyroscope and accelerometer, in the robot's frame as defined by ``top_side`` and
    ``front_side``."""

    def __init__(self) -> None:
        body = self._machine.body
        self._bench = body if isinstance(body, FittedBench) else None
        self._settings: dict[str, Any] = {}
        for name, (default, _) in _SETTINGS.items():
            self._settings[name] = default
        self._turned_ms: int | None = None
        self._orient(Axis.Z, Axis.X)

    def _orient(
        self,
        top_side: Any,
        front_side: Any,
    ) -> None:
        """Set the directions of the hub's top and front in the robot's frame, and the heading to 0.
        Raises ValueError if they are not at right angles."""
        front = _axis(front_side)
        top = _axis(top_side)
        expect(not abs(_dot(front, top)) > 1e-3)
        expect(_dot(front, front))
        expect(_dot(top, top))
        front = _scaled_to_one(front)
        top = _scaled_to_one(top)
        # The third axis is the vector product of the first two, top x front.
        a, b, c = top
        x, y, z = front
        left = (
            b * z - c * y,
            c * x - a * z,
            a * y - b * x,
        )
        self._frame = front, left, top
        self._heading.frame = self._frame
        if self._bench is not None:
            # This is the robot's vertical in the hub's frame.
            up = (front[2], left[2], top[2])
            self._bench.mount(up)
        self._heading.set_angle(0.0)
        faces_ahead = front == (1.0, 0.0, 0.0)
        is_upright = top == (0.0, 0.0, 1.0)
        self._is_aligned = faces_ahead and is_upright

    @property
    def _heading(self) -> GyroHeading:
        """Heading, once the bench has found its wheels."""
        if self._bench is not None:
            servos = self._machine.servos
            directions = {port: servo.direction for port, servo in servos.items()}
            self._bench.find_wheels(directions)
        return self._machine.heading

    def tilt(self, calibrated: Any = True) -> tuple[float, float]:
        # For a calibrated hub that is mounted upright and forward, the body's angles are exact.
        pitch, roll = self._machine.body.tilt_deg()
        if not (calibrated and self._is_aligned):
            x, y, z = self._in_robot_frame(self._upwards(calibrated))
            pitch = math.atan2(-x, math.hypot(y, z)) * _DEG_PER_RAD
            # Adding 0.0 keeps a -0.0 from changing the angle by 360 degrees.
            roll = math.atan2(y + 0.0, z) * _DEG_PER_RAD
        tilt = to_single(pitch), to_single(roll)
        if self._machine.log is not None:
            self._machine.log.read(("pitch_deg", "roll_deg"), tilt)
        return tilt

    def up(self, calibrated: Any = True) -> Any:
        return _side_up(self._upwards(calibrated))

    def acceleration(
        self,
        axis: Any = None,
        calibrated: Any = True,
    ) -> Any:
        # A hub reads whole steps of the sensor.
        x, y, z = (
            round(part / _MM_S2_PER_STEP) * _MM_S2_PER_STEP
            for part in self._machine.body.acceleration_mm_s2()
        )
        force = x, y, z
        if calibrated:
            force = self._corrected(force)
        force = self._in_robot_frame(force)
        return vector(*force) if axis is None else _project(force, axis)

    def angular_velocity(
        self,
        axis: Any = None,
        calibrated: Any = True,
    ) -> Any:
        rates = self._in_robot_frame(self._heading.rates_deg_s(calibrated=bool(calibrated)))
        return vector(*rates) if axis is None else _project(rates, axis)

    def heading(self) -> float:
        heading_deg = to_single(self._heading.angle_deg())
        if self._machine.log is not None:
            self._machine.log.read(("heading_deg",), heading_deg)
        return heading_deg

    def reset_heading(self, angle: Any) -> None:
        if any(base.needs_gyro for base in self._machine.drive_bases):
            raise HubOSError("Can't reset heading while gyro in use. Stop driving first.")
        self._heading.set_angle(get_number(angle))

    def rotation(
        self,
        axis: Any = None,
        calibrated: Any = True,
    ) -> float:
        rotation_deg = self._heading.rotation_deg(calibrated=bool(calibrated))
        return _project(self._in_robot_frame(rotation_deg), axis)

    def orientation(self) -> Any:
        pitch_deg, roll_deg = self._machine.body.tilt_deg()
        pitch = math.radians(pitch_deg)
        roll = math.radians(roll_deg)
        # A heading counts clockwise, but a rotation about the upward axis counterclockwise.
        yaw = -math.radians(self._heading.yaw_deg())
        cp = math.cos(pitch)
        sp = math.sin(pitch)
        cr = math.cos(roll)
        sr = math.sin(roll)
        cy = math.cos(yaw)
        sy = math.sin(yaw)
        # This is the rotation matrix R = Rz(yaw) Ry(pitch) Rx(roll), whose rows are the world's
        # axes in the hub's frame.
        return Matrix(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    def ready(self) -> bool:
        return True

    def stationary(self) -> bool:
        """Whether the hub has been at rest for a second, its motors coasting. It rests while no
        motor drives it and it is not seen to turn."""
        servos = self._machine.servos.values()
        limit = self._settings["angular_velocity_threshold"]
        rates = self._machine.body.angular_velocity_deg_s()
        if any(abs(rate) >= limit for rate in rates):
            self._turned_ms = self._machine.time_ms
        # These are the times at which the hub was last turned or driven by a motor, and None for
        # never.
        candidates_ms = [self._turned_ms, *(servo.driven_ms for servo in servos)]
        moved_ms = [time_ms for time_ms in candidates_ms if time_ms is not None]
        if moved_ms and self._machine.time_ms - max(moved_ms) < _REST_MS:
            return False
        return all(servo.voltage_mv is None for servo in servos)

    def settings(
        self,
        angular_velocity_threshold: Any = None,
        acceleration_threshold: Any = None,
        heading_correction: Any = None,
        angular_velocity_bias: Any = None,
        angular_velocity_scale: Any = None,
        acceleration_correction: Any = None,
    ) -> tuple[Any, ...] | None:
        # The order of the arguments matters: a refused one leaves those before it set.
        arguments = {
            "angular_velocity_threshold": angular_velocity_threshold,
            "acceleration_threshold": acceleration_threshold,
            "heading_correction": heading_correction,
            "angular_velocity_bias": angular_velocity_bias,
            "angular_velocity_scale": angular_velocity_scale,
            "acceleration_correction": acceleration_correction,
        }
        changes = {name: value for name, value in arguments.items() if value is not None}
        if not changes:
            return tuple(map(_as_single, self._settings.values()))
        for name, value in changes.items():
            self._settings[name] = _checked_setting(name, value)
        self._heading.turn_deg = self._settings["heading_correction"]
        if angular_velocity_scale is not None:
            self._heading.calibrate(self._settings["angular_velocity_scale"])
        return None

    def _corrected(self, force: _Vector) -> _Vector:
        """An acceleration, corrected by the readings for gravity along each axis that a program has
        set."""
        limits = self._settings["acceleration_correction"]
        # The mean of both readings is an axis's offset, and half their difference its gravity.
        upward = limits[::2]
        downward = limits[1::2]
        readings = zip(force, upward, downward, strict=True)
        x, y, z = (
            (value - (up + down) / 2) * _GRAVITY_MM_S2 / ((up - down) / 2)
            for value, up, down in readings
        )
        return x, y, z

    def _upwards(self, calibrated: Any) -> _Vector:
        """A vector upwards in the hub's frame: by the hub's pose, or by its accelerometer."""
        if calibrated:
            return self._gravity_in_hub()
        return self._machine.body.acceleration_mm_s2()

    def _gravity_in_hub(self) -> _Vector:
        """Unit vector upwards in the hub's frame."""
        pitch_deg, roll_deg = self._machine.body.tilt_deg()
        pitch = math.radians(pitch_deg)
        roll = math.radians(roll_deg)
        x = -math.sin(pitch)
        y = math.cos(pitch) * math.sin(roll)
        z = math.cos(pitch) * math.cos(roll)
        return x, y, z

    def _in_robot_frame(self, vector: _Vector) -> _Vector:
        # A hub that is mounted as usual gets the vector unchanged, and so without rounding.
        if self._is_aligned:
            return vector
        front, left, top = self._frame
        ahead, leftward, upward = vector
        # The columns of the rotation are the hub's front, left and top in the robot's frame.
        return (
            ahead * front[0] + leftward * left[0] + upward * top[0],
            ahead * front[1] + leftward * left[1] + upward * top[1],
            ahead * front[2] + leftward * left[2] + upward * top[2],
        )


def _as_single(value: Any) -> Any:
    """A setting as a program sees it, in 32 bits."""
    if isinstance(value, tuple):
        return tuple(map(to_single, value))
    return to_single(value)


def _checked_setting(name: str, value: Any) -> Any:
    """A new value of a setting: a number, or a tuple of numbers. Raises TypeError or ValueError for
    one that the firmware refuses."""
    default, max_deviation = _SETTINGS[name]
    is_tuple = isinstance(default, tuple)
    if is_tuple and len(get_array(value)) != len(default):
        title = name.replace("_", " ").capitalize()
        raise ValueError(f"{title} must be a {len(default)}-element tuple.")
    numbers = tuple(map(get_number, value if is_tuple else (value,)))
    nominal = default if is_tuple else (default,)
    expect(
        not any(
            abs(number - expected) > max_deviation
            for number, expected in zip(numbers, nominal, strict=True)
        )
    )
    return numbers if is_tuple else numbers[0]


class Accelerometer(Native):
    """Accelerometer in the robot's frame, as defined by ``top_side`` and ``front_side``."""

    def __init__(self) -> None:
        self._orient(3, 1)

    def _orient(
        self,
        top_side: Any,
        front_side: Any,
    ) -> None:
        """Set the axes, 1 to 3 or negative, along which top and front of the hub are in the robot.
        Raises ValueError if they are not at right angles."""
        top = get_int(top_side)
        front = get_int(front_side)
        axes = {abs(top), abs(front)}
        expect(len(axes) == 2 and axes <= {1, 2, 3})
        (left,) = {1, 2, 3} - axes
        # The left side is the vector product top x front. It is positive if the axis of front
        # follows that of top in the circle 1, 2, 3 and both have one sign.
        follows = (abs(front) - abs(top)) % 3 == 1
        has_one_sign = top * front > 0
        if follows is not has_one_sign:
            left = -left
        self._axes = front, left, top
        if isinstance(self._machine.body, FittedBench):
            # This is where the robot's third axis, its vertical, lies in the hub's frame.
            x, y, z = (float((axis == 3) - (axis == -3)) for axis in self._axes)
            self._machine.body.mount((x, y, z))

    def up(self) -> Any:
        return _side_up(self._counts())

    def acceleration(self) -> tuple[int, ...]:
        return tuple(count * _MM_S2_PER_COUNT for count in self._in_robot_frame())

    def tilt(self) -> tuple[int, int]:
        x, y, z = self._in_robot_frame()
        across = math.isqrt(z * z + y * y)
        pitch_deg = _atan2_deg(-x, across)
        roll_deg = _atan2_deg(y, z)
        return pitch_deg, roll_deg

    def _counts(self) -> Sequence[int]:
        # The sensor has 8 bits, so counts are rounded down and saturated.
        counts = []
        for part in self._machine.body.acceleration_mm_s2():
            count = math.floor(part * _COUNTS_PER_G / _G_MM_S2)
            counts.append(max(-128, min(127, count)))
        return counts

    def _in_robot_frame(self) -> list[int]:
        values = {}
        for axis, count in zip(self._axes, self._counts(), strict=True):
            values[abs(axis)] = count if axis > 0 else -count
        return [values[axis] for axis in (1, 2, 3)]


def _atan2_deg(y: int, x: int) -> int:
    """Arc tangent in whole degrees, as the firmware interpolates it."""
    if y == 0:
        return 0 if x > 0 else -180
    if x == 0:
        return 90 if y > 0 else -90
    ratio = abs(1024 * y) // abs(x)
    angle = _arc_tangent_eighths(ratio) // 8
    # The angle so far is that of the magnitudes, and both signs decide the quadrant.
    if (x > 0) != (y > 0):
        angle = -angle
    if x > 0:
        return angle
    return angle - 180 if angle > 0 else angle + 180


def _arc_tangent_eighths(ratio: int) -> int:
    """Arc tangent of a ratio, in straight lines between the points of the table; constant beyond
    the last."""
    for i in range(1, len(_ARC_TANGENTS)):
        low_ratio, low_angle = _ARC_TANGENTS[i - 1]
        high_ratio, high_angle = _ARC_TANGENTS[i]
        if ratio < high_ratio:
            rise = high_angle - low_angle
            run = high_ratio - low_ratio
            return low_angle + (ratio - low_ratio) * rise // run
    _, last_angle = _ARC_TANGENTS[-1]
    return last_angle
