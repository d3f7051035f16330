"""``hub.imu``."""

from __future__ import annotations

import math
from typing import Any

from bricksrl.twin.micropython.errors import HubOSError
from bricksrl.twin.micropython.floats import to_single
from bricksrl.twin.pybricks.context import Context, charged
from bricksrl.twin.pybricks.matrix import Matrix, vector
from bricksrl.twin.pybricks.parameters import Axis, Side

_DEG_PER_RAD = 57.296
_DEFAULTS = (2.0, 2500.0, (0.0, 0.0, 0.0), (360.0, 360.0, 360.0), (9806.65, -9806.65) * 3, 360.0)
_NAMES = (
    "angular_velocity_threshold",
    "acceleration_threshold",
    "angular_velocity_bias",
    "angular_velocity_scale",
    "acceleration_correction",
    "heading_correction",
)
_LENGTHS = {"angular_velocity_bias": 3, "angular_velocity_scale": 3, "acceleration_correction": 6}
_Vector = tuple[float, float, float]


def _axis(value: Any) -> _Vector:
    if not isinstance(value, Matrix):
        raise TypeError("Axis must be Matrix.")
    values = value.flat()
    if len(values) != 3:
        raise ValueError("Axis must be 1x3 or 3x1 matrix.")
    return values[0], values[1], values[2]


def _dot(a: _Vector, b: _Vector) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


class IMU:
    """Gyroscope and accelerometer, in the frame of the robot that ``top_side`` and ``front_side`` define."""

    def __init__(self, context: Context) -> None:
        self._machine = context.machine
        self._context = context
        self._heading_zero = self._machine.body.heading_deg()
        self._settings: dict[str, Any] = dict(zip(_NAMES, _DEFAULTS, strict=True))
        self.orient(Axis.Z, Axis.X)

    def orient(self, top_side: Any, front_side: Any) -> None:
        """Say in which directions of the robot the hub's top and front look.

        Raises:
            ValueError: they are not at right angles.
        """
        front, top = _axis(front_side), _axis(top_side)
        if abs(_dot(front, top)) > 1e-3 or not _dot(front, front) or not _dot(top, top):
            raise ValueError("Invalid argument")
        front, top = (tuple(x / math.sqrt(_dot(v, v)) for x in v) for v in (front, top))  # type: ignore[assignment]
        left = (
            top[1] * front[2] - top[2] * front[1],
            top[2] * front[0] - top[0] * front[2],
            top[0] * front[1] - top[1] * front[0],
        )
        self._frame = front, left, top
        self._is_straight = front == (1.0, 0.0, 0.0) and top == (0.0, 0.0, 1.0)

    @charged
    def tilt(self, calibrated: Any = True) -> tuple[float, float]:
        pitch, roll = self._machine.body.tilt_deg()
        if not self._is_straight:
            x, y, z = self._up_vector()
            pitch = math.atan2(-x, math.hypot(y, z)) * _DEG_PER_RAD
            roll = math.atan2(y, z) * _DEG_PER_RAD
        return to_single(pitch), to_single(roll)

    @charged
    def up(self, calibrated: Any = True) -> Any:
        x, y, z = self._gravity_in_hub()
        sizes = (abs(x), abs(y), abs(z))
        largest = sizes.index(max(sizes))
        sides = ((Side.FRONT, Side.BACK), (Side.LEFT, Side.RIGHT), (Side.TOP, Side.BOTTOM))[largest]
        return sides[0 if (x, y, z)[largest] >= 0 else 1]

    @charged
    def acceleration(self, axis: Any = None, calibrated: Any = True) -> Any:
        return self._along(self._in_robot(self._machine.body.acceleration_mm_s2()), axis)

    @charged
    def angular_velocity(self, axis: Any = None, calibrated: Any = True) -> Any:
        return self._along(self._in_robot(self._machine.body.angular_velocity_deg_s()), axis)

    @charged
    def heading(self) -> float:
        return to_single((self._machine.body.heading_deg() - self._heading_zero) * (self._frame[2][2] or 1.0))

    @charged
    def reset_heading(self, angle: Any) -> None:
        if not isinstance(angle, int | float):
            raise TypeError(f"can't convert {type(angle).__name__} to float")
        if self._context.gyro_users:
            raise HubOSError("Can't reset heading while gyro in use. Stop driving first.")
        self._heading_zero = self._machine.body.heading_deg() - angle * (self._frame[2][2] or 1.0)

    @charged
    def rotation(self, axis: Any, calibrated: Any = True) -> float:
        wanted = _axis(axis)
        pitch, roll = self._machine.body.tilt_deg()
        return to_single(_dot(self._in_robot((roll, pitch, -self._machine.body.heading_deg())), wanted))

    @charged
    def orientation(self) -> Any:
        pitch, roll = (math.radians(a) for a in self._machine.body.tilt_deg())
        yaw = -math.radians(self._machine.body.heading_deg() - self._heading_zero)
        cp, sp, cr, sr, cy, sy = (f(a) for a in (pitch, roll, yaw) for f in (math.cos, math.sin))
        return Matrix(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    @charged
    def ready(self) -> bool:
        return True

    @charged
    def stationary(self) -> bool:
        limit = self._settings["angular_velocity_threshold"]
        return all(abs(rate) < limit for rate in self._machine.body.angular_velocity_deg_s())

    @charged
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
            "angular_velocity_threshold": angular_velocity_threshold,
            "acceleration_threshold": acceleration_threshold,
            "heading_correction": heading_correction,
            "angular_velocity_bias": angular_velocity_bias,
            "angular_velocity_scale": angular_velocity_scale,
            "acceleration_correction": acceleration_correction,
        }
        if all(value is None for value in given.values()):
            return tuple(map(_single, self._settings.values()))
        for name, value in given.items():
            if value is None:
                continue
            if name in _LENGTHS and len(value) != _LENGTHS[name]:
                what = name.replace("_", " ").capitalize()
                raise ValueError(f"{what} must be a {_LENGTHS[name]}-element tuple.")
            self._settings[name] = tuple(value) if name in _LENGTHS else value
        return None

    def _gravity_in_hub(self) -> _Vector:
        """What points up, in the frame of the hub."""
        pitch, roll = (math.radians(a) for a in self._machine.body.tilt_deg())
        return -math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)

    def _up_vector(self) -> _Vector:
        return self._in_robot(self._gravity_in_hub())

    def _in_robot(self, v: _Vector) -> _Vector:
        if self._is_straight:
            return v
        front, left, top = self._frame
        x, y, z = (v[0] * front[i] + v[1] * left[i] + v[2] * top[i] for i in range(3))
        return x, y, z

    @staticmethod
    def _along(value: _Vector, axis: Any) -> Any:
        if axis is None:
            return vector(*value)
        wanted = _axis(axis)
        length = math.sqrt(_dot(wanted, wanted))
        if not length:
            raise ValueError("Invalid argument")
        return to_single(_dot(value, wanted) / length)


def _single(value: Any) -> Any:
    return tuple(map(to_single, value)) if isinstance(value, tuple) else to_single(value)
