"""The heading of a robot by its gyroscope (``pbio/imu.c``, v4): one for ``hub.imu`` and for all drive bases."""

from __future__ import annotations

from math import trunc

from bricksrl.virtual_hub.body import Body
from bricksrl.virtual_hub.firmware.angle import TURN_MDEG, Angle, single

_Vector = tuple[float, float, float]


class Heading:
    """Degrees, clockwise positive seen from above, not wrapped.

    Attributes:
        frame: where front, left and top of the hub look, in the frame of the robot.
        turn_deg: what the heading counts in a whole turn, where a program said so.
        gyro_deg: what the gyroscope counts in a whole turn about each axis of the hub, where a program said so.
    """

    def __init__(self, body: Body) -> None:
        self._body = body
        self.frame: tuple[_Vector, _Vector, _Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        self.turn_deg = 360.0
        self.gyro_deg: _Vector = (360.0, 360.0, 360.0)
        self._zero_deg = body.heading_deg()

    def angle_deg(self) -> float:
        return self._uncounted_deg() - self._zero_deg

    def angle(self, steps_per_deg: int) -> Angle:
        """In units of control, computed in single precision as the firmware does."""
        angle_deg, turn_deg = single(self.angle_deg()), single(TURN_MDEG / steps_per_deg)
        turns = trunc(single(angle_deg / turn_deg))
        rest = single(angle_deg - single(turns * turn_deg))
        return turns, trunc(single(rest * steps_per_deg))

    def set_angle(self, angle_deg: float) -> None:
        """Count from this angle on."""
        self._zero_deg = self._uncounted_deg() - angle_deg

    def rate_deg_s(self) -> float:
        """Speed at which the robot turns about its own top, clockwise."""
        return -sum(rate * axis[2] for rate, axis in zip(self.rates_deg_s(), self.frame, strict=True))

    def rates_deg_s(self) -> _Vector:
        """Angular velocity in the frame of the hub."""
        x, y, z = self._body.angular_velocity_deg_s()
        scale_x, scale_y, scale_z = self.gyro_deg
        return x * 360.0 / scale_x, y * 360.0 / scale_y, z * 360.0 / scale_z

    def _uncounted_deg(self) -> float:
        return self._body.heading_deg() * (360.0 / self.turn_deg) * (360.0 / self.gyro_deg[2])
