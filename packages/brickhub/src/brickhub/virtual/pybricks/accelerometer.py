"""``hub.imu`` of the Move hub, which has an accelerometer only and computes with integers (``pb_type_movehub.c``, v4)."""

from __future__ import annotations

import math
from typing import Any

from brickhub.virtual.body import FittingBody
from brickhub.virtual.pybricks.context import Context, charged, get_int
from brickhub.virtual.pybricks.imu import side_up

_COUNTS_PER_G, _G_MM_S2 = 64, 9806.65  # of the sensor (LIS3DH) at 2 g, 8 bits
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


class Accelerometer:
    """Accelerometer in the robot's frame, as defined by ``top_side`` and ``front_side``."""

    def __init__(self, context: Context) -> None:
        self._machine = context.machine
        self.orient(3, 1)

    def orient(self, top_side: Any, front_side: Any) -> None:
        """Set the axes, 1 to 3 or negative, along which top and front of the hub are in the robot. Raises ValueError if they are
        not at right angles."""
        top, front = get_int(top_side), get_int(front_side)
        axes = {abs(top), abs(front)}
        if len(axes) < 2 or not axes <= {1, 2, 3}:
            raise ValueError("Invalid argument")
        (left,) = {1, 2, 3} - axes
        follows = (abs(front) - abs(top)) % 3 == 1
        self._axes = front, left if follows is (top * front > 0) else -left, top
        if isinstance(self._machine.body, FittingBody):
            x, y, z = (float((axis == 3) - (axis == -3)) for axis in self._axes)
            self._machine.body.mount((x, y, z))

    @charged
    def up(self) -> Any:
        x, y, z = self._counts()
        return side_up((x, y, z))

    @charged
    def acceleration(self) -> tuple[int, ...]:
        return tuple(count * _MM_S2_PER_COUNT for count in self._in_robot_frame())

    @charged
    def tilt(self) -> tuple[int, int]:
        x, y, z = self._in_robot_frame()
        return _atan2_deg(-x, math.isqrt(z * z + y * y)), _atan2_deg(y, z)

    def _counts(self) -> list[int]:
        force = self._machine.body.acceleration_mm_s2()
        return [max(-128, min(127, math.floor(part * _COUNTS_PER_G / _G_MM_S2))) for part in force]

    def _in_robot_frame(self) -> list[int]:
        values = {abs(axis): count if axis > 0 else -count for axis, count in zip(self._axes, self._counts(), strict=True)}
        return [values[axis] for axis in (1, 2, 3)]


def _atan2_deg(y: int, x: int) -> int:
    """Arc tangent in whole degrees, as the firmware interpolates it."""
    if y == 0:
        return 0 if x > 0 else -180
    if x == 0:
        return 90 if y > 0 else -90
    ratio = abs(1024 * y) // abs(x)
    pairs = zip(_ARC_TANGENTS, _ARC_TANGENTS[1:], strict=False)
    eighths = next((a + (ratio - r) * (b - a) // (s - r) for (r, a), (s, b) in pairs if ratio < s), _ARC_TANGENTS[-1][1])
    angle = eighths // 8 if (x > 0) == (y > 0) else -(eighths // 8)
    if x > 0:
        return angle
    return angle - 180 if angle > 0 else angle + 180
