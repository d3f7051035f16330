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
_MM_S2_PER_STEP = 0.244 * 9.81  # of the accelerometer (LSM6DS3TR-C) at 8 g
# of the sensor (LIS3DH) at 2 g, 8 bits
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
    sides = ((Side.FRONT, Side.BACK), (Side.LEFT, Side.RIGHT), (Side.TOP, Side.BOTTOM))[largest]
    return sides[0 if upwards[largest] >= 0 else 1]


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
    return 0.0 + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]  # no -0.0


class IMU(Native):
    """Gyroscope and accelerometer, in the robot's frame as defined by ``top_side`` and
    ``front_side``."""

    def __init__(self) -> None:
        body = self._machine.body
        self._bench = body if isinstance(body, FittedBench) else None
        self._settings = {name: default for name, (default, _) in _SETTINGS.items()}
        self._turned_ms: int | None = None
        self._orient(Axis.Z, Axis.X)

    def _orient(self, top_side: Any, front_side: Any) -> None:
        """Set the directions of the hub's top and front in the robot's frame, and the heading to 0.
        Raises ValueError if they are not at right angles."""
        front = _axis(front_side)
        top = _axis(top_side)
        expect(not abs(_dot(front, top)) > 1e-3 and _dot(front, front) and _dot(top, top))
        front, top = (tuple(x / math.sqrt(_dot(v, v)) for x in v) for v in (front, top))  # type: ignore[assignment]
        (a, b, c) = top
        (x, y, z) = front
        left = b * z - c * y, c * x - a * z, a * y - b * x
        self._frame = self._heading.frame = front, left, top
        if self._bench is not None:
            self._bench.mount((front[2], left[2], top[2]))
        self._heading.set_angle(0.0)
        self._is_aligned = front == (1.0, 0.0, 0.0) and top == (0.0, 0.0, 1.0)

    @property
    def _heading(self) -> GyroHeading:
        """Heading, once the bench has found its wheels."""
        if self._bench is not None:
            self._bench.find_wheels(
                {port: servo.direction for port, servo in self._machine.servos.items()}
            )
        return self._machine.heading

    def tilt(self, calibrated: Any = True) -> tuple[float, float]:
        pitch, roll = self._machine.body.tilt_deg()
        if not (calibrated and self._is_aligned):
            x, y, z = self._in_robot_frame(
                self._gravity_in_hub() if calibrated else self._machine.body.acceleration_mm_s2()
            )
            pitch = math.atan2(-x, math.hypot(y, z)) * _DEG_PER_RAD
            roll = math.atan2(y + 0.0, z) * _DEG_PER_RAD  # -0.0 would change it by 360
        tilt = to_single(pitch), to_single(roll)
        if self._machine.log is not None:
            self._machine.log.read(("pitch_deg", "roll_deg"), tilt)
        return tilt

    def up(self, calibrated: Any = True) -> Any:
        return _side_up(
            self._gravity_in_hub() if calibrated else self._machine.body.acceleration_mm_s2()
        )

    def acceleration(self, axis: Any = None, calibrated: Any = True) -> Any:
        x, y, z = (
            round(part / _MM_S2_PER_STEP) * _MM_S2_PER_STEP
            for part in self._machine.body.acceleration_mm_s2()
        )
        force = self._in_robot_frame(self._corrected((x, y, z)) if calibrated else (x, y, z))
        return vector(*force) if axis is None else _project(force, axis)

    def angular_velocity(self, axis: Any = None, calibrated: Any = True) -> Any:
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

    def rotation(self, axis: Any = None, calibrated: Any = True) -> float:
        return _project(
            self._in_robot_frame(self._heading.rotation_deg(calibrated=bool(calibrated))), axis
        )

    def orientation(self) -> Any:
        pitch, roll = (math.radians(a) for a in self._machine.body.tilt_deg())
        yaw = -math.radians(self._heading.yaw_deg())
        cp, sp, cr, sr, cy, sy = (f(a) for a in (pitch, roll, yaw) for f in (math.cos, math.sin))
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
        if any(abs(rate) >= limit for rate in self._machine.body.angular_velocity_deg_s()):
            self._turned_ms = self._machine.time_ms
        moved_ms = [
            ms for ms in (self._turned_ms, *(servo.driven_ms for servo in servos)) if ms is not None
        ]
        rests = not moved_ms or self._machine.time_ms - max(moved_ms) >= _REST_MS
        return rests and all(servo.voltage_mv is None for servo in servos)

    def settings(
        self,
        angular_velocity_threshold: Any = None,
        acceleration_threshold: Any = None,
        heading_correction: Any = None,
        angular_velocity_bias: Any = None,
        angular_velocity_scale: Any = None,
        acceleration_correction: Any = None,
    ) -> tuple[Any, ...] | None:
        given = {
            name: value
            for name, value in locals().items()
            if name in _SETTINGS and value is not None
        }
        if not given:
            values = self._settings.values()
            return tuple(
                tuple(map(to_single, value)) if isinstance(value, tuple) else to_single(value)
                for value in values
            )
        for name, value in given.items():
            default, max_deviation = _SETTINGS[name]
            is_tuple = isinstance(default, tuple)
            if is_tuple and len(get_array(value)) != len(default):
                raise ValueError(
                    f"{name.replace('_', ' ').capitalize()} must be a {len(default)}-element tuple."
                )
            numbers = tuple(map(get_number, value if is_tuple else (value,)))
            nominal = default if is_tuple else (default,)
            expect(
                not any(
                    abs(number - other) > max_deviation
                    for number, other in zip(numbers, nominal, strict=True)
                )
            )
            self._settings[name] = numbers if is_tuple else numbers[0]
        self._heading.turn_deg = self._settings["heading_correction"]
        if angular_velocity_scale is not None:
            self._heading.calibrate(self._settings["angular_velocity_scale"])
        return None

    def _corrected(self, force: _Vector) -> _Vector:
        """An acceleration, corrected by the readings for gravity along each axis that a program has
        set."""
        limits = self._settings["acceleration_correction"]
        pairs = zip(force, limits[::2], limits[1::2], strict=True)
        x, y, z = (
            (value - (up + down) / 2) * _GRAVITY_MM_S2 / ((up - down) / 2)
            for value, up, down in pairs
        )
        return x, y, z

    def _gravity_in_hub(self) -> _Vector:
        """Unit vector upwards in the hub's frame."""
        pitch, roll = (math.radians(a) for a in self._machine.body.tilt_deg())
        return -math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)

    def _in_robot_frame(self, v: _Vector) -> _Vector:
        if self._is_aligned:
            return v
        front, left, top = self._frame
        x, y, z = (v[0] * front[i] + v[1] * left[i] + v[2] * top[i] for i in range(3))
        return x, y, z


class Accelerometer(Native):
    """Accelerometer in the robot's frame, as defined by ``top_side`` and ``front_side``."""

    def __init__(self) -> None:
        self._orient(3, 1)

    def _orient(self, top_side: Any, front_side: Any) -> None:
        """Set the axes, 1 to 3 or negative, along which top and front of the hub are in the robot.
        Raises ValueError if they are not at right angles."""
        top = get_int(top_side)
        front = get_int(front_side)
        axes = {abs(top), abs(front)}
        expect(len(axes) == 2 and axes <= {1, 2, 3})
        (left,) = {1, 2, 3} - axes
        follows = (abs(front) - abs(top)) % 3 == 1
        self._axes = front, left if follows is (top * front > 0) else -left, top
        if isinstance(self._machine.body, FittedBench):
            x, y, z = (float((axis == 3) - (axis == -3)) for axis in self._axes)
            self._machine.body.mount((x, y, z))

    def up(self) -> Any:
        return _side_up(self._counts())

    def acceleration(self) -> tuple[int, ...]:
        return tuple(count * _MM_S2_PER_COUNT for count in self._in_robot_frame())

    def tilt(self) -> tuple[int, int]:
        x, y, z = self._in_robot_frame()
        return _atan2_deg(-x, math.isqrt(z * z + y * y)), _atan2_deg(y, z)

    def _counts(self) -> Sequence[int]:
        force = self._machine.body.acceleration_mm_s2()
        return [max(-128, min(127, math.floor(part * _COUNTS_PER_G / _G_MM_S2))) for part in force]

    def _in_robot_frame(self) -> list[int]:
        values = {
            abs(axis): count if axis > 0 else -count
            for axis, count in zip(self._axes, self._counts(), strict=True)
        }
        return [values[axis] for axis in (1, 2, 3)]


def _atan2_deg(y: int, x: int) -> int:
    """Arc tangent in whole degrees, as the firmware interpolates it."""
    if y == 0:
        return 0 if x > 0 else -180
    if x == 0:
        return 90 if y > 0 else -90
    ratio = abs(1024 * y) // abs(x)
    pairs = zip(_ARC_TANGENTS, _ARC_TANGENTS[1:], strict=False)
    eighths = next(
        (a + (ratio - r) * (b - a) // (s - r) for (r, a), (s, b) in pairs if ratio < s),
        _ARC_TANGENTS[-1][1],
    )
    angle = eighths // 8 if (x > 0) == (y > 0) else -(eighths // 8)
    if x > 0:
        return angle
    return angle - 180 if angle > 0 else angle + 180
