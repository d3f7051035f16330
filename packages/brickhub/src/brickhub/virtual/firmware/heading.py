"""Heading of a robot by its gyroscope (``pbio/imu.c``, v4), shared by ``hub.imu`` and all drive bases."""

from __future__ import annotations

from math import trunc
from operator import add, sub

from brickhub.virtual.body import Body
from brickhub.virtual.firmware.angle import TURN_MDEG, Angle, single

_Vector = tuple[float, float, float]


class GyroHeading:
    """Degrees, clockwise positive seen from above, not wrapped.

    Attributes:
        frame: directions of the hub's front, left and top in the frame of the robot.
        turn_deg: reading of the heading for a whole turn, by which a program corrects it.
    """

    def __init__(self, body: Body) -> None:
        self._body = body
        self.frame: tuple[_Vector, _Vector, _Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        self.turn_deg = 360.0
        self._gyro_deg: _Vector = (360.0, 360.0, 360.0)
        self._yaw_deg = 0.0
        self._rotation_deg: _Vector = (0.0, 0.0, 0.0)
        self._zero_deg = self._total_deg()

    def angle_deg(self) -> float:
        return self._total_deg() - self._zero_deg

    def angle(self, steps_per_deg: int) -> Angle:
        """Heading in control units, in single precision as in the firmware."""
        angle_deg, turn_deg = single(self.angle_deg()), single(TURN_MDEG / steps_per_deg)
        turns = trunc(single(angle_deg / turn_deg))
        rest = single(angle_deg - single(turns * turn_deg))
        return turns, trunc(single(rest * steps_per_deg))

    def set_angle(self, angle_deg: float) -> None:
        """Set the present heading."""
        self._zero_deg = self._total_deg() - angle_deg

    def rate_deg_s(self) -> float:
        """Angular velocity about the robot's vertical axis, clockwise."""
        return -sum(rate * axis[2] for rate, axis in zip(self.rates_deg_s(), self.frame, strict=True))

    def rates_deg_s(self, *, calibrated: bool = True) -> _Vector:
        """Angular velocity in the frame of the hub."""
        rates = self._body.angular_velocity_deg_s()
        return self._scaled(rates) if calibrated else rates

    def rotation_deg(self, *, calibrated: bool) -> _Vector:
        """Angular velocity in the frame of the hub, integrated over time."""
        x, y, z = map(add, self._scaled(self._body.rotation_deg()), self._rotation_deg)
        scale_x, scale_y, scale_z = (360.0, 360.0, 360.0) if calibrated else self._gyro_deg
        return x * scale_x / 360.0, y * scale_y / 360.0, z * scale_z / 360.0

    def yaw_deg(self) -> float:
        """Rotation about the vertical since the hub was switched on, without the correction of the heading."""
        scale = sum(axis[2] ** 2 * 360.0 / scale for axis, scale in zip(self.frame, self._gyro_deg, strict=True))
        return self._body.heading_deg() * scale + self._yaw_deg

    def calibrate(self, gyro_deg: _Vector) -> None:
        """Set the reading of the gyroscope for a whole turn about each axis of the hub; earlier rotation stays."""
        yaw_deg, rotation_deg = self.yaw_deg(), self.rotation_deg(calibrated=True)
        self._gyro_deg = gyro_deg
        self._yaw_deg += yaw_deg - self.yaw_deg()
        x, y, z = map(sub, rotation_deg, self._scaled(self._body.rotation_deg()))
        self._rotation_deg = x, y, z

    def _scaled(self, vector: _Vector) -> _Vector:
        (x, y, z), (scale_x, scale_y, scale_z) = vector, self._gyro_deg
        return x * 360.0 / scale_x, y * 360.0 / scale_y, z * 360.0 / scale_z

    def _total_deg(self) -> float:
        return self.yaw_deg() * (360.0 / self.turn_deg)
