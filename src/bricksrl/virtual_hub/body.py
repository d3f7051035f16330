"""Body of a virtual robot: the interface between the simulated hub and what its motors turn and its sensors see."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from bricksrl.robots import MotorKind, Robot
from bricksrl.virtual_hub.stimuli import Sense, Sensed

if TYPE_CHECKING:
    import numpy as np


class Body(Protocol):
    """The physical half of a virtual robot: what motors turn and sensors see.

    Motor angles are those of the motor's own shaft, clockwise positive, before direction and gears.
    """

    robot: Robot
    """Hub, motors and sensors, and the ports that they are plugged into."""
    battery_mv: int

    @property
    def link_interval_ms(self) -> float:
        """Connection interval of the hub's link, at whose ticks messages travel; 0 for a link without delay."""

    def reset(self, rng: np.random.Generator) -> None:
        """The human hand: put the robot at the start of an episode."""

    def advance_to(self, time_ms: int) -> None:
        """Integrate the physics up to this simulated time."""

    def angle_mdeg(self, port: str) -> int:
        """Angle of a motor's shaft as its rotation sensor reports it."""

    def set_voltage(self, port: str, voltage_mv: int | None) -> None:
        """Apply a voltage to a motor; ``None`` opens the circuit (coast)."""

    def distance_mm(self, port: str) -> int:
        """Reading of an ultrasonic sensor, 40..2000."""

    def tilt_deg(self) -> tuple[float, float]:
        """Pitch and roll as ``hub.imu.tilt`` reports them."""

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        """Gyroscope in the frame of the hub: x forward, y left, z up."""

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        """Accelerometer in the frame of the hub; at rest (0, 0, +9810)."""

    def heading_deg(self) -> float:
        """Integrated rotation about z, clockwise positive, since the start; not wrapped."""


@runtime_checkable
class SensingBody(Protocol):
    """A body with other sensors than those."""

    def sensed(self, port: str, sense: Sense) -> Sensed:
        """Stimulus of the sensor on this port now."""


@runtime_checkable
class FittingBody(Protocol):
    """A body that takes the devices for which a program asks."""

    motors: dict[str, MotorKind]
    """Port letter to the kind of motor that was plugged in there."""

    def plug_in(self, port: str, device: str) -> bool:
        """Plug a device in, by the name of its class in ``pybricks.pupdevices``; true if that is now there."""

    def device(self, port: str) -> str | None:
        """Name of the class of the device that is plugged in there."""
