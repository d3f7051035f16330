"""What a task asks of a hub: the commands it takes and the channels it reports.

From an ``Interface`` and a ``Robot`` follow the hub program, the bytes on the wire and the specs of the
environment. All values are in the units of their names; the wire carries int16 fixed point numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class RunAngle:
    """Turn one motor by an angle, without waiting: ``Motor.run_angle(speed, angle, wait=False)``."""

    motor: str
    low_deg: float
    high_deg: float
    speed_deg_s: int
    scale: ClassVar[int] = 10

    @property
    def name(self) -> str:
        return self.motor

    @property
    def low(self) -> float:
        return self.low_deg

    @property
    def high(self) -> float:
        return self.high_deg


@dataclass(frozen=True)
class DriveStraight:
    """Drive the drive base by a distance, without waiting: ``DriveBase.straight(distance, wait=False)``."""

    low_mm: float
    high_mm: float
    scale: ClassVar[int] = 10
    name: ClassVar[str] = "straight"

    @property
    def low(self) -> float:
        return self.low_mm

    @property
    def high(self) -> float:
        return self.high_mm


Command = RunAngle | DriveStraight


@dataclass(frozen=True)
class MotorAngle:
    """``Motor.angle()``; wrapped into 0..360 where the range is exactly that, else as it is."""

    motor: str
    low: float = 0.0
    high: float = 360.0
    scale: ClassVar[int] = 10
    unit: ClassVar[str] = "deg"

    @property
    def name(self) -> str:
        return f"{self.motor}_angle"

    @property
    def wraps(self) -> bool:
        return (self.low, self.high) == (0.0, 360.0)


@dataclass(frozen=True)
class Pitch:
    """First value of ``hub.imu.tilt()``: nose down is positive."""

    low: float = -90.0
    high: float = 90.0
    scale: ClassVar[int] = 100
    unit: ClassVar[str] = "deg"
    name: ClassVar[str] = "pitch"


@dataclass(frozen=True)
class Roll:
    """Second value of ``hub.imu.tilt()``."""

    low: float = -90.0
    high: float = 90.0
    scale: ClassVar[int] = 100
    unit: ClassVar[str] = "deg"
    name: ClassVar[str] = "roll"


@dataclass(frozen=True)
class YawRate:
    """``hub.imu.angular_velocity(Axis.Z)``; the range is nominal: faster turns are reported as they are."""

    low: float = -100.0
    high: float = 100.0
    scale: ClassVar[int] = 10
    unit: ClassVar[str] = "deg/s"
    name: ClassVar[str] = "yaw_rate"


@dataclass(frozen=True)
class Distance:
    """``UltrasonicSensor.distance()``."""

    sensor: str
    low: float = 0.0
    high: float = 2000.0
    scale: ClassVar[int] = 1
    unit: ClassVar[str] = "mm"

    @property
    def name(self) -> str:
        return "distance"


PARTS = {"hsv": ("hue", "saturation", "value"), "tilt": ("pitch", "roll")}
"""Methods of sensors that return several numbers at once, and what these are."""


@dataclass(frozen=True)
class SensorReading:
    """A number that a method of a sensor returns, such as ``ColorSensor.reflection()``; the range is that of the number.

    Attributes:
        part: which one, where the method returns several, such as ``"hue"`` of ``"hsv"``: see ``PARTS``. The hub calls the
            method once for all of them.
    """

    sensor: str
    method: str
    low: float
    high: float
    unit: str = ""
    part: str | None = None
    scale: ClassVar[int] = 10

    @property
    def name(self) -> str:
        return f"{self.sensor}_{self.part or self.method}"

    @property
    def wraps(self) -> bool:
        return (self.low, self.high, self.unit) == (0.0, 360.0, "deg")


Channel = MotorAngle | Pitch | Roll | YawRate | Distance | SensorReading


@dataclass(frozen=True)
class Wait:
    """Answer a fixed time after the commands started."""

    time_ms: int


@dataclass(frozen=True)
class UntilDone:
    """Answer when the moves have ended; a move that is blocked for longer than the timeout is stopped."""

    timeout_ms: int = 3000


@dataclass(frozen=True)
class Interface:
    """Commands in the order of the action vector, channels in the order of the observation vector."""

    commands: tuple[Command, ...]
    channels: tuple[Channel, ...]
    settle: Wait | UntilDone
