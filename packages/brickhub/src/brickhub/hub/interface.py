"""Interface between a task and a hub: the commands that the hub takes and the channels that it
reports.

An ``Interface`` and a ``Robot`` determine the hub program, the wire format and the specs of the
environment. All values are in the units of their names; the wire carries int16 fixed-point numbers,
and int32 ones of what counts without end.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

from brickhub.entry import Entry
from brickhub.errors import an, hint
from brickhub.fields import check_fields, check_value
from brickhub.hub.commands import (
    WIDE_MAX,
    WIRE_MAX,
    ClientCommand,
    Command,
    Curve,
    DriveSpeed,
    DriveStraight,
    DriveTurnRate,
    HubLight,
    HubSound,
    Imports,
    LightBrightness,
    RunAngle,
    RunDuty,
    RunSpeed,
    TrackTarget,
    Turn,
    WireNumber,
    drive_base,
    drive_base_setup,
)
from brickhub.robot import Robot, Sense, UltrasonicSensor
from brickhub.robot.hardware import REMOTE_BUTTONS

# The commands are exported too, so that a user's file imports all parts of an interface from one
# module.
__all__ = [
    "PARTS",
    "Channel",
    "ClientChannel",
    "ClientCommand",
    "Command",
    "Curve",
    "Distance",
    "DriveAngle",
    "DriveDistance",
    "DriveSpeed",
    "DriveStraight",
    "DriveTurnRate",
    "Heading",
    "HubButton",
    "HubLight",
    "HubSound",
    "Imports",
    "Interface",
    "LightBrightness",
    "MotorAngle",
    "Pitch",
    "PitchRate",
    "RemoteButton",
    "Roll",
    "RunAngle",
    "RunDuty",
    "RunSpeed",
    "SensorReading",
    "TrackTarget",
    "Turn",
    "UntilDone",
    "Wait",
    "WatchedButton",
    "WatchedRemoteButton",
    "WheelsAngle",
    "WheelsSpeed",
    "WireNumber",
    "YawRate",
    "drive_base",
    "drive_base_setup",
]


@dataclass(frozen=True)
class Channel(WireNumber, ABC):
    """Number that the hub reports at every step.

    Attributes:
        is_nominal: whether values beyond ``low`` and ``high`` are possible, up to the limits of the
            wire.
        accumulates: whether it counts from the start of the program, without end; environments let
            it count from the start of each episode.
        noise, noise_share: names of the twin's physics parameters for its noise: the standard
            deviation, and an additional one as a share of the value.
        wireless: kind of the device beside the hub that it reads, such as ``"remote"``; ``None``
            without one.
        setup_s: longest time that its setup takes at the start of the program.
        is_aside: whether it is for this computer alone, and in no observation.
        roughness: insignificant difference between a robot and its twin, in the unit, due to
            rounding and clock ticks.
    """

    role: ClassVar[str] = "channel"
    wireless: ClassVar[str | None] = None
    setup_s: ClassVar[float] = 0.0
    is_aside: ClassVar[bool] = False
    is_nominal: ClassVar[bool] = False
    accumulates: ClassVar[bool] = False
    noise: ClassVar[str | None] = None
    noise_share: ClassVar[str | None] = None
    roughness: ClassVar[float] = 1.0

    @property
    def device(self) -> str | None:
        """Name of the motor or sensor that the channel reads; ``None`` for the hub itself."""
        return None

    def devices(self, robot: Robot) -> tuple[str, ...]:
        """Names of the motors and sensors that the hub program needs for the channel."""
        return () if self.device is None else (self.device,)

    @property
    def wraps(self) -> bool:
        """True for an angle that wraps from 360 to 0."""
        return False

    @property
    def limits(self) -> tuple[float, float] | None:
        """Possible range, if ``low`` and ``high`` are only nominal."""
        if not self.is_nominal:
            return None
        largest_on_wire = WIDE_MAX if self.accumulates else WIRE_MAX
        largest = largest_on_wire / self.scale
        return -largest, largest

    def is_wide(self, robot: Robot | None) -> bool:
        """Whether the number takes 32 bits on the wire rather than 16, because it counts without
        end. ``robot`` is the one that it is read on, or ``None`` for one whose motors have
        ranges."""
        return self.accumulates

    @property
    def entry(self) -> Entry:
        return Entry(
            self.name,
            self.low,
            self.high,
            self.unit,
            self.limits,
            self.wraps,
        )

    @abstractmethod
    def check(self, robot: Robot) -> None:
        """Raise DescriptionError unless the robot supports the channel."""

    def setup(self, robot: Robot) -> tuple[str, ...]:
        """Statements of the hub program that make the object to read, after the motors; equal ones
        occur once."""
        return ()

    @property
    def statement(self) -> str | None:
        """Line of the hub program before all channels are read, such as a call that returns several
        numbers.

        Equal lines of several channels occur once.
        """
        return None

    @property
    @abstractmethod
    def expression(self) -> str:
        """Expression of the value in the hub program, in its unit, from ``hub``, ``motor_NAME`` and
        ``sensor_NAME``."""


@dataclass(frozen=True)
class MotorAngle(Channel):
    """``Motor.angle()``; wrapped into 0..360 if that is the range, else unchanged, even beyond the
    range."""

    motor: str
    low: float = 0.0
    high: float = 360.0
    unit: ClassVar[str] = "deg"
    roughness: ClassVar[float] = 0.5

    @property
    def name(self) -> str:
        return f"{self.motor}_angle"

    @property
    def device(self) -> str:
        return self.motor

    @property
    def wraps(self) -> bool:
        # Whole turns of an endless wheel mean nothing, only where it stands.
        return (self.low, self.high) == (0.0, 360.0)

    def in_mirror(self, robot: Robot) -> tuple[str, int]:
        motor, sign = robot.in_mirror(self.motor)
        return replace(self, motor=motor).name, sign

    @property
    def is_nominal(self) -> bool:  # type: ignore[override]  # a constant of most kinds
        return not self.wraps

    @property
    def limits(self) -> tuple[float, float] | None:
        if self.wraps:
            return None
        return -WIDE_MAX / self.scale, WIDE_MAX / self.scale

    def is_wide(self, robot: Robot | None) -> bool:
        # A joint with a range fits into 16 bits, in tenths of a degree, but a wheel counts on.
        if self.wraps or robot is None:
            return False
        return robot.motor(self.motor).range_deg is None

    def check(self, robot: Robot) -> None:
        robot.motor(self.motor)

    @property
    def expression(self) -> str:
        # The hub wraps the angle, because a wheel's turns would soon be too many for 16 bits.
        wrap = " % 360" if self.wraps else ""
        return f"motor_{self.motor}.angle(){wrap}"


class _WheelsChannel(Channel):
    """Channel of two motors, the mean of both."""

    left: str
    right: str

    def devices(self, robot: Robot) -> tuple[str, ...]:
        return self.left, self.right

    def check(self, robot: Robot) -> None:
        robot.motor(self.left)
        robot.motor(self.right)


@dataclass(frozen=True)
class WheelsAngle(_WheelsChannel):
    """Mean of ``Motor.angle()`` of two motors: how far a robot has rolled; the range is nominal."""

    left: str
    right: str
    low: float = -360.0
    high: float = 360.0
    unit: ClassVar[str] = "deg"
    name: ClassVar[str] = "wheels_angle"
    is_nominal: ClassVar[bool] = True
    accumulates: ClassVar[bool] = True

    @property
    def expression(self) -> str:
        return f"(motor_{self.left}.angle() + motor_{self.right}.angle()) / 2"


@dataclass(frozen=True)
class WheelsSpeed(_WheelsChannel):
    """Mean of ``Motor.speed()`` of two motors; the range is nominal."""

    left: str
    right: str
    low: float = -1000.0
    high: float = 1000.0
    unit: ClassVar[str] = "deg/s"
    name: ClassVar[str] = "wheels_speed"
    is_nominal: ClassVar[bool] = True
    # A hub estimates a speed from angles of whole degrees in 100 ms.
    roughness: ClassVar[float] = 20.0

    @property
    def expression(self) -> str:
        return f"(motor_{self.left}.speed() + motor_{self.right}.speed()) / 2"


class _ImuChannel(Channel):
    """Channel of the hub's IMU."""

    def check(self, robot: Robot) -> None:
        if not robot.hub.model.has_imu:
            remedy = "choose a prime, essential or technic hub, or omit the channel"
            raise self.error(f" needs an IMU, which the {robot.hub.value} hub lacks; {remedy}")


@dataclass(frozen=True)
class _Tilt(_ImuChannel):
    low: float = -90.0
    high: float = 90.0
    scale: ClassVar[int] = 100
    unit: ClassVar[str] = "deg"
    # One call reads both angles, so that they are of the same moment.
    statement: ClassVar[str] = "pitch, roll = hub.imu.tilt()"
    noise: ClassVar[str] = "tilt_noise_deg"
    roughness: ClassVar[float] = 0.3

    @property
    def expression(self) -> str:
        return self.name


@dataclass(frozen=True)
class Pitch(_Tilt):
    """First value of ``hub.imu.tilt()``: nose down is positive."""

    name: ClassVar[str] = "pitch"


@dataclass(frozen=True)
class Roll(_Tilt):
    """Second value of ``hub.imu.tilt()``."""

    name: ClassVar[str] = "roll"
    mirror_sign: ClassVar[int] = -1


@dataclass(frozen=True)
class PitchRate(_ImuChannel):
    """``hub.imu.angular_velocity(Axis.Y)``: how fast the nose goes down; the range is nominal."""

    low: float = -300.0
    high: float = 300.0
    unit: ClassVar[str] = "deg/s"
    name: ClassVar[str] = "pitch_rate"
    imports: ClassVar[Imports] = (("pybricks.parameters", "Axis"),)
    is_nominal: ClassVar[bool] = True
    noise: ClassVar[str] = "gyro_noise_deg_s"
    roughness: ClassVar[float] = 4.0
    expression: ClassVar[str] = "hub.imu.angular_velocity(Axis.Y)"


class _TurnChannel(_ImuChannel):
    """Channel of the hub's IMU, or of a gyroscope on one of its ports."""

    sensor: str

    @property
    def device(self) -> str | None:
        return self.sensor or None

    def check(self, robot: Robot) -> None:
        if not self.sensor:
            super().check(robot)
        elif Sense.ROTATION not in robot.sensor(self.sensor).kind.model.senses:
            raise self.error(f": '{self.sensor}' is no GyroSensor; name one, or omit the sensor")


@dataclass(frozen=True)
class YawRate(_TurnChannel):
    """``hub.imu.angular_velocity(Axis.Z)``, or the opposite of ``GyroSensor.speed()``, which counts
    clockwise; the range is nominal: faster turns are reported as they are. ``sensor``: name of a
    gyroscope on a port; empty for the hub's."""

    low: float = -100.0
    high: float = 100.0
    sensor: str = ""
    unit: ClassVar[str] = "deg/s"
    name: ClassVar[str] = "yaw_rate"
    mirror_sign: ClassVar[int] = -1
    is_nominal: ClassVar[bool] = True
    noise: ClassVar[str] = "gyro_noise_deg_s"
    roughness: ClassVar[float] = 4.0

    @property
    def imports(self) -> Imports:  # type: ignore[override]  # a constant of most kinds
        return () if self.sensor else (("pybricks.parameters", "Axis"),)

    @property
    def expression(self) -> str:
        if self.sensor:
            return f"-sensor_{self.sensor}.speed()"
        return "hub.imu.angular_velocity(Axis.Z)"


@dataclass(frozen=True)
class Heading(_TurnChannel):
    """``hub.imu.heading()``, or ``GyroSensor.angle()``, clockwise positive, not wrapped; the range
    is nominal. ``sensor``: as of a ``YawRate``."""

    low: float = -180.0
    high: float = 180.0
    sensor: str = ""
    unit: ClassVar[str] = "deg"
    name: ClassVar[str] = "heading"
    mirror_sign: ClassVar[int] = -1
    is_nominal: ClassVar[bool] = True
    accumulates: ClassVar[bool] = True

    @property
    def expression(self) -> str:
        return f"sensor_{self.sensor}.angle()" if self.sensor else "hub.imu.heading()"


@dataclass(frozen=True)
class _DriveBaseChannel(Channel):
    """Odometry of the drive base since the program started; the range is nominal."""

    low: float
    high: float
    imports: ClassVar[Imports] = (("pybricks.robotics", "DriveBase"),)
    is_nominal: ClassVar[bool] = True
    accumulates: ClassVar[bool] = True

    def check(self, robot: Robot) -> None:
        drive_base(robot, self.name)

    def devices(self, robot: Robot) -> tuple[str, ...]:
        base = drive_base(robot, self.name)
        return base.left, base.right

    def setup(self, robot: Robot) -> tuple[str, ...]:
        return drive_base_setup(robot, self.name)


@dataclass(frozen=True)
class DriveDistance(_DriveBaseChannel):
    """``DriveBase.distance()``, forward positive."""

    scale: ClassVar[int] = 1
    unit: ClassVar[str] = "mm"
    name: ClassVar[str] = "drive_distance"
    roughness: ClassVar[float] = 2.0
    expression: ClassVar[str] = "drive_base.distance()"


@dataclass(frozen=True)
class DriveAngle(_DriveBaseChannel):
    """``DriveBase.angle()``, clockwise positive."""

    unit: ClassVar[str] = "deg"
    name: ClassVar[str] = "drive_angle"
    mirror_sign: ClassVar[int] = -1
    roughness: ClassVar[float] = 2.0
    expression: ClassVar[str] = "drive_base.angle()"


@dataclass(frozen=True)
class Distance(Channel):
    """``UltrasonicSensor.distance()``; ``FARTHEST_MM`` if nothing is in range."""

    sensor: str
    low: float = 0.0
    high: float = 2000.0
    scale: ClassVar[int] = 1
    unit: ClassVar[str] = "mm"
    name: ClassVar[str] = "distance"
    noise: ClassVar[str] = "distance_noise_mm"
    noise_share: ClassVar[str] = "distance_noise_ratio"
    roughness: ClassVar[float] = 3.0
    FARTHEST_MM: ClassVar[float] = float(UltrasonicSensor.FARTHEST_MM)

    @property
    def device(self) -> str:
        return self.sensor

    def check(self, robot: Robot) -> None:
        if robot.sensor(self.sensor).kind.model.range_mm is None:
            raise self.error(f": '{self.sensor}' is not an UltrasonicSensor; use a SensorReading")

    @property
    def expression(self) -> str:
        return f"sensor_{self.sensor}.distance()"


@dataclass(frozen=True)
class HubButton(Channel):
    """Button of the hub, such as ``"left"``: 1 while it is down as the hub reads it, else 0. The
    one that stops programs is none: the center button, or the one at the upper left of an EV3."""

    button: str
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 1.0
    scale: ClassVar[int] = 1
    unit: ClassVar[str] = ""
    imports: ClassVar[Imports] = (("pybricks.parameters", "Button"),)
    owner: ClassVar[str] = "hub"

    @property
    def name(self) -> str:
        return f"{self.owner}_{self.button}"

    def buttons(self, robot: Robot) -> tuple[str, ...]:
        """Names of the buttons that a program may read."""
        # A program never reads the button that stops it.
        model = robot.hub.model
        return tuple(name for name in model.buttons if name != model.stop_button)

    def check(self, robot: Robot) -> None:
        buttons = self.buttons(robot)
        if self.button not in buttons:
            remedy = "take a prime hub, or a RemoteButton"
            if buttons:
                remedy = f"choose {', '.join(buttons)}"
            raise self.error(
                f": the {self.owner} has no such button that a program may read; {remedy}"
            )

    @property
    def expression(self) -> str:
        return f"int(Button.{self.button.upper()} in {self.owner}.buttons.pressed())"


@dataclass(frozen=True)
class RemoteButton(HubButton):
    """Button of the Powered Up remote, such as ``"left_plus"``; switch the remote on within 10 s of
    the program's start."""

    owner: ClassVar[str] = "remote"
    wireless: ClassVar[str] = "remote"
    setup_s: ClassVar[float] = 10.0
    imports: ClassVar[Imports] = (*HubButton.imports, ("pybricks.pupdevices", "Remote"))

    def buttons(self, robot: Robot) -> tuple[str, ...]:
        return REMOTE_BUTTONS

    def setup(self, robot: Robot) -> tuple[str, ...]:
        return ("remote = Remote()",)


@dataclass(frozen=True)
class WatchedButton(HubButton):
    """Button of the hub by which a person tells this computer something, in no observation."""

    is_aside: ClassVar[bool] = True


@dataclass(frozen=True)
class WatchedRemoteButton(RemoteButton):
    """Button of the Powered Up remote by which a person tells this computer something, in no
    observation."""

    is_aside: ClassVar[bool] = True


@dataclass(frozen=True)
class ClientChannel(Channel):
    """Number that a client program of one's own answers; what it answers beyond the range is cut to
    it."""

    name: str
    low: float
    high: float
    unit: str = ""
    expression: ClassVar[str] = ""

    def check(self, robot: Robot) -> None:
        raise self.error(" is of a client of your own; name its program, or take another channel")


PARTS = {
    "hsv": ("hue", "saturation", "value"),
    "rgb": ("red", "green", "blue"),
    "tilt": ("pitch", "roll"),
}
"""Names of the numbers that some methods of sensors return together."""


@dataclass(frozen=True)
class SensorReading(Channel):
    """Number that a method of a sensor returns, such as ``ColorSensor.reflection()``, with its
    range.

    Attributes:
        part: name of the number if the method returns several, such as ``"hue"`` of ``"hsv"``: see
            ``PARTS``. The hub calls the method once for all of them.
    """

    sensor: str
    method: str
    low: float
    high: float
    unit: str = ""
    part: str | None = None

    @property
    def name(self) -> str:
        return f"{self.sensor}_{self.part or self.method}"

    @property
    def device(self) -> str:
        return self.sensor

    def in_mirror(self, robot: Robot) -> tuple[str, int]:
        # A sensor's reading has no direction, unlike a motor's angle.
        sensor, _ = robot.in_mirror(self.sensor)
        return replace(self, sensor=sensor).name, self.mirror_sign

    @property
    def wraps(self) -> bool:
        # Only angles have this range and unit, for example a hue, so the number wraps.
        return (self.low, self.high, self.unit) == (0.0, 360.0, "deg")

    def check(self, robot: Robot) -> None:
        kind = robot.sensor(self.sensor).kind
        if kind.model.range_mm is not None:
            raise self.error(f": '{self.sensor}' is an {kind.value}; use Distance")
        readings = kind.model.readings
        if self.method not in readings:
            known = f"{hint(self.method, readings)}; it has {', '.join(readings) or 'none'}"
            raise self.error(f": {an(kind.value)} has no reading '{self.method}'{known}")
        parts = PARTS.get(self.method)
        if parts is None and self.part is not None:
            raise self.error(f": {self.method}() is one number; omit the part '{self.part}'")
        if parts is not None and self.part not in parts:
            raise self.error(
                f": {self.method}() is {len(parts)} numbers; give as part one of {', '.join(parts)}"
            )

    @property
    def statement(self) -> str | None:
        return None if self.part is None else f"{self._parts} = {self._call}"

    @property
    def expression(self) -> str:
        if self.part is None:
            return self._call
        # Parts are read by index, because a hub's methods return tuples or what can be indexed like
        # one.
        index = PARTS[self.method].index(self.part)
        return f"{self._parts}[{index}]"

    @property
    def _call(self) -> str:
        return f"sensor_{self.sensor}.{self.method}()"

    @property
    def _parts(self) -> str:
        return f"read_{self.sensor}_{self.method}"


@dataclass(frozen=True)
class Wait:
    """Steps of a fixed time: the hub answers that long after the commands started."""

    time_ms: int

    @property
    def fixed_ms(self) -> int | None:
        """Duration of a step; ``None`` if it varies."""
        return self.time_ms

    @property
    def longest_ms(self) -> int:
        """Longest duration of a step."""
        return self.time_ms


@dataclass(frozen=True)
class UntilDone:
    """Steps that end when all moves have ended; a move that takes longer than the timeout is
    stopped."""

    timeout_ms: int = 3000
    fixed_ms: ClassVar[None] = None

    @property
    def longest_ms(self) -> int:
        return self.timeout_ms


@dataclass(frozen=True)
class Interface:
    """Commands in the order of the action vector, channels in the order of the observation vector.
    Raises DescriptionError if they are none."""

    commands: tuple[Command, ...]
    channels: tuple[Channel, ...]
    settle: Wait | UntilDone

    def __post_init__(self) -> None:
        # A list is as good as a tuple, but it cannot be hashed.
        for field in ("commands", "channels"):
            value = getattr(self, field)
            if isinstance(value, list):
                object.__setattr__(self, field, tuple(value))
        check_fields(Interface, vars(self))
        # The fields are checked here, so that no kind has to check its own.
        for part in (*self.commands, *self.channels):
            check_value(f"low of '{part.name}'", part.low, float)
            check_value(f"high of '{part.name}'", part.high, float)

    @property
    def angle_indices(self) -> dict[str, int]:
        """Index of each motor's angle among the channels, by motor name."""
        return {
            channel.motor: index
            for index, channel in enumerate(self.channels)
            if isinstance(channel, MotorAngle)
        }

    @property
    def distance_index(self) -> int | None:
        """Index of the first distance among the channels; ``None`` if there is none."""
        for index, channel in enumerate(self.channels):
            if isinstance(channel, Distance):
                return index
        return None
