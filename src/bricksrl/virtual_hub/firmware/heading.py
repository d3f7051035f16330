"""Heading of a robot by its gyroscope (``pbio/imu.c``, v4), shared by ``hub.imu`` and all drive bases."""

from __future__ import annotations

from math import trunc

from bricksrl.virtual_hub.body import Body
from bricksrl.virtual_hub.firmware.angle import TURN_MDEG, Angle, single

_Vector = tuple[float, float, float]


class Heading:
    """Degrees, clockwise positive seen from above, not wrapped.

    Attributes:
        frame: directions of the hub's front, left and top in the frame of the robot.
        turn_deg: reading of the heading for a whole turn, by which a program corrects it.
        gyro_deg: reading of the gyroscope for a whole turn about each axis of the hub, by which a program corrects it.
    """

    def __init__(self, body: Body) -> None:
        self._body = body
        self.frame: tuple[_Vector, _Vector, _Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        self.turn_deg = 360.0
        self.gyro_deg: _Vector = (360.0, 360.0, 360.0)
        self._zero_deg = body.heading_deg()

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

    def rates_deg_s(self) -> _Vector:
        """Angular velocity in the frame of the hub."""
        x, y, z = self._body.angular_velocity_deg_s()
        scale_x, scale_y, scale_z = self.gyro_deg
        return x * 360.0 / scale_x, y * 360.0 / scale_y, z * 360.0 / scale_z

    def _total_deg(self) -> float:
        return self._body.heading_deg() * (360.0 / self.turn_deg) * (360.0 / self.gyro_deg[2])
