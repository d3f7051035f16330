"""Body of a virtual robot: the interface between hub and physics."""

from typing import Protocol

from brickhub.hub.link.profiles import LinkProfile
from brickhub.robot import Robot, Sense
from brickhub.virtual.stimuli import Sensed


class Rng(Protocol):
    """Source of random numbers, such as NumPy's ``Generator`` or Python's ``random.Random``."""

    def uniform(
        self,
        low: float,
        high: float,
        /,
    ) -> float:
        """A random number of a range."""


class Body(Protocol):
    """Physical part of a virtual robot: what motors move and sensors measure.

    Motor angles are those of the shaft, clockwise positive, before direction and gears.
    """

    robot: Robot
    """Hub, motors and sensors with their ports."""
    battery_mv: int
    link: LinkProfile
    """Delays and losses of the hub's link."""

    def reset(self, rng: Rng) -> None:
        """Place the robot at the start of an episode."""

    def advance_to(self, time_ms: int) -> None:
        """Integrate the physics up to a simulated time."""

    def angle_mdeg(self, port: str) -> int:
        """Angle of a motor's shaft by its rotation sensor."""

    def set_voltage(
        self,
        port: str,
        voltage_mv: int | None,
    ) -> None:
        """Apply a voltage to a motor; ``None`` opens the circuit (coast)."""

    def sensed(
        self,
        port: str,
        sense: Sense,
    ) -> Sensed:
        """Present stimulus of the sensor on a port."""

    def distance_mm(self, port: str) -> int:
        """Reading of an ultrasonic sensor, 40..2000."""

    def tilt_deg(self) -> tuple[float, float]:
        """Pitch and roll as of ``hub.imu.tilt``."""

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        """Gyroscope in the hub's frame: x forward, y left, z up."""

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        """Accelerometer in the hub's frame; at rest (0, 0, +9810)."""

    def heading_deg(self) -> float:
        """Rotation about the vertical since the start, clockwise positive, not wrapped."""

    def rotation_deg(self) -> tuple[float, float, float]:
        """Angular velocity in the hub's frame, integrated since the start."""

    def true_place(self) -> tuple[float, float, float]:
        """Where the robot is, without any noise: x and y in mm, and its heading in deg, clockwise
        positive. A bench stays at 0, 0."""
