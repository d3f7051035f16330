"""Commands of a hub to its motors, drive base, light and loudspeaker, sent at every step.

A kind is one frozen dataclass, here or in a user's file. Each is one number with a range, to which
the hub clamps it, and one line of the hub program. Endless moves (``RunSpeed``, ``RunDuty``,
``DriveSpeed``, ``DriveTurnRate``) go on until the next step; if the host falls silent, the hub's
watchdog stops them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from brickhub.entry import Entry
from brickhub.errors import DescriptionError, an
from brickhub.robot import DriveBase, Robot

WIRE_MAX = 2**15 - 1
"""Largest number on the wire, an int16."""
WIDE_MAX = 2**31 - 1
"""Largest number of a channel that is wide on the wire, an int32."""

Imports = tuple[tuple[str, str], ...]
"""Pairs of a module and a name that a hub program imports from it."""
_MAX_TEST_TURN_DEG = 10.0
"""Largest turn that the test of an endless move requires."""
_LOWEST_TONE_HZ = 64
"""Lowest tone of a hub's loudspeaker, which is silent below it."""


class WireNumber:
    """Number on the wire.

    Attributes:
        role: ``"command"`` or ``"channel"``, for messages.
        low, high: range in its unit; the hub clamps commands to it.
        scale: factor from the number to its fixed-point value on the wire.
        imports: names that the hub program imports for it, besides hub, ports and devices.
        mirror_sign: its factor in a mirror from left to right; 0 if its mirror image is none of its
            values.
    """

    role: ClassVar[str]
    scale: ClassVar[int] = 10
    imports: ClassVar[Imports] = ()
    mirror_sign: ClassVar[int] = 1

    # Each kind has these as fields, properties or constants, so only type checkers see them here.
    if TYPE_CHECKING:

        @property
        def name(self) -> str: ...

        @property
        def low(self) -> float: ...

        @property
        def high(self) -> float: ...

        @property
        def unit(self) -> str: ...

        def devices(self, robot: Robot) -> tuple[str, ...]: ...

    @property
    def entry(self) -> Entry:
        """Name, range and unit."""
        return Entry(
            self.name,
            self.low,
            self.high,
            self.unit,
        )

    def in_mirror(self, robot: Robot) -> tuple[str, int]:
        """Name of the number in whose place it is in a mirror from left to right, and its factor
        there."""
        return self.name, self.mirror_sign

    def error(self, problem: str) -> DescriptionError:
        """Error about this number; ``problem`` goes on after its name."""
        return DescriptionError(f"{self.role} '{self.name}'{problem}")


@dataclass(frozen=True)
class Command(WireNumber, ABC):
    """Number that is sent to the hub at every step, and its effect.

    Attributes:
        mover: moving object in the hub program, with the methods ``done()`` and ``stop()``;
            ``None`` for a light or a sound.
        ends: whether the move ends by itself, so that a step may wait for it.
        needs_encoder: whether its motors need a rotation sensor.
        is_turn_by: whether its amount is an angle by which one motor turns, which a motor with a
            range counts from its target.
        is_whole: whether the hub program gets it in whole units, as motors take them; otherwise as
            it is on the wire.
        call: commands with the same ``call`` are the arguments of one call on the hub; ``None`` for
            a separate call.
        description: for the header of the hub program; a format of the command.
        code: statement that starts the move; a format of the command and the expression of its
            value. See `start`.
    """

    role: ClassVar[str] = "command"
    description: ClassVar[str] = "{0.low:g} to {0.high:g} {0.unit}"
    code: ClassVar[str]
    ends: ClassVar[bool] = True
    needs_encoder: ClassVar[bool] = True
    is_turn_by: ClassVar[bool] = False
    is_whole: ClassVar[bool] = True
    call: ClassVar[str | None] = None

    @property
    def mover(self) -> str | None:
        return None

    @abstractmethod
    def check(self, robot: Robot) -> None:
        """Raise DescriptionError unless the robot supports the command."""

    def motors(self, robot: Robot) -> tuple[str, ...]:
        """Names of the motors that the command turns."""
        return ()

    def devices(self, robot: Robot) -> tuple[str, ...]:
        """Names of the motors and sensors that the hub program needs for the command."""
        return self.motors(robot)

    def turns_deg(
        self,
        robot: Robot,
        amount: float,
    ) -> tuple[float, ...]:
        """Angle that each of its motors turns by; for an endless move, at least in one second."""
        return ()

    def setup(self, robot: Robot) -> tuple[str, ...]:
        """Statements of the hub program that make the mover, after the motors; equal ones of
        several commands occur once."""
        return ()

    def start(
        self,
        robot: Robot,
        amounts: Mapping[str, str],
    ) -> str:
        """Statement of the hub program that starts the move, without waiting for its end.
        ``amounts``: expressions of all commands of one ``call``, by their names."""
        return self.code.format(self, amounts[self.name])


def _test_turn_deg(turn_deg: float) -> float:
    return max(-_MAX_TEST_TURN_DEG, min(_MAX_TEST_TURN_DEG, turn_deg))


@dataclass(frozen=True)
class _MotorCommand(Command):
    """Command of one motor."""

    motor: str
    low: float
    high: float

    @property
    def name(self) -> str:
        return self.motor

    @property
    def mover(self) -> str:
        return f"motor_{self.motor}"

    def motors(self, robot: Robot) -> tuple[str, ...]:
        return (robot.motor(self.motor).name,)

    def in_mirror(self, robot: Robot) -> tuple[str, int]:
        return robot.in_mirror(self.motor)


@dataclass(frozen=True)
class RunAngle(_MotorCommand):
    """Turn one motor by an angle, without waiting: ``Motor.run_angle(speed, angle,
    wait=False)``."""

    speed_deg_s: int
    unit: ClassVar[str] = "deg"
    is_turn_by: ClassVar[bool] = True
    description: ClassVar[str] = "turn by {0.low:g} to {0.high:g} deg at {0.speed_deg_s} deg/s"

    def check(self, robot: Robot) -> None:
        # A motor at speed 0 never arrives, and `UntilDone` would wait until its timeout.
        if not 1 <= self.speed_deg_s <= WIRE_MAX:
            raise self.error(
                f": speed {self.speed_deg_s} deg/s; give a positive one, the sign is the angle's"
            )

    def turns_deg(
        self,
        robot: Robot,
        amount: float,
    ) -> tuple[float, ...]:
        return (amount,)

    def start(
        self,
        robot: Robot,
        amounts: Mapping[str, str],
    ) -> str:
        # A motor with a range is a Joint on the hub, which keeps targets within the range.
        if robot.motor(self.motor).range_deg is not None:
            return f"{self.mover}.turn({self.speed_deg_s}, {amounts[self.name]})"
        return f"{self.mover}.run_angle({self.speed_deg_s}, {amounts[self.name]}, wait=False)"


@dataclass(frozen=True)
class _Endless(_MotorCommand):
    """Command that turns a motor until the next command; not for motors with a range."""

    ends: ClassVar[bool] = False

    def check(self, robot: Robot) -> None:
        if robot.motor(self.motor).range_deg is not None:
            raise self.error(
                f" turns endlessly, and motor '{self.motor}' has a range; use RunAngle or "
                "TrackTarget"
            )

    def turns_deg(
        self,
        robot: Robot,
        amount: float,
    ) -> tuple[float, ...]:
        return (_test_turn_deg(amount),)


@dataclass(frozen=True)
class RunSpeed(_Endless):
    """Turn one motor at a controlled speed: ``Motor.run(speed)``."""

    unit: ClassVar[str] = "deg/s"
    description: ClassVar[str] = "run at {0.low:g} to {0.high:g} deg/s"
    code: ClassVar[str] = "{0.mover}.run({1})"


@dataclass(frozen=True)
class RunDuty(_Endless):
    """Drive one motor, also one without encoder, with a duty cycle in percent of the battery's
    voltage: ``Motor.dc(duty)``."""

    needs_encoder: ClassVar[bool] = False
    low: float = -100.0
    high: float = 100.0
    unit: ClassVar[str] = "%"
    description: ClassVar[str] = "run with {0.low:g} to {0.high:g} % of the battery's voltage"
    code: ClassVar[str] = "{0.mover}.dc({1})"

    def check(self, robot: Robot) -> None:
        super().check(robot)
        if self.low < -100 or self.high > 100:
            raise self.error(
                f" ranges from {self.low:g} to {self.high:g} %; stay within -100 to 100"
            )


@dataclass(frozen=True)
class TrackTarget(_MotorCommand):
    """Move one motor to an angle as fast as possible, without a profile, and hold it:
    ``Motor.track_target(angle)``."""

    unit: ClassVar[str] = "deg"
    ends: ClassVar[bool] = False
    description: ClassVar[str] = "go to {0.low:g} to {0.high:g} deg"
    code: ClassVar[str] = "{0.mover}.track_target({1})"

    def check(self, robot: Robot) -> None:
        range_deg = robot.motor(self.motor).range_deg
        if range_deg is None:
            return
        # The hub clamps a target to the command's range only, so a target outside of the motor's
        # range is refused here.
        low_deg, high_deg = range_deg
        is_within = low_deg <= self.low < self.high <= high_deg
        if not is_within:
            beyond = f"beyond the motor's range of {low_deg} to {high_deg}"
            raise self.error(
                f" ranges from {self.low:g} to {self.high:g} deg, {beyond}; stay within"
            )

    def turns_deg(
        self,
        robot: Robot,
        amount: float,
    ) -> tuple[float, ...]:
        # The motor may already be at its target, so it need not turn at all.
        return (0.0,)


@dataclass(frozen=True)
class _DriveBaseCommand(Command):
    """Command of both motors of the drive base."""

    low: float
    high: float
    mover: ClassVar[str] = "drive_base"
    is_turn: ClassVar[bool] = False
    imports: ClassVar[Imports] = (("pybricks.robotics", "DriveBase"),)

    def check(self, robot: Robot) -> None:
        for name in sorted(self.motors(robot)):
            if robot.motor(name).range_deg is not None:
                raise DescriptionError(
                    f"motor '{name}' of the drive base has a range; wheels turn endlessly, take "
                    "range_deg away"
                )

    def motors(self, robot: Robot) -> tuple[str, ...]:
        base = drive_base(robot, self.name)
        return base.left, base.right

    def wheel_turns_deg(
        self,
        robot: Robot,
        amount: float,
    ) -> tuple[float, ...]:
        """Angle that each wheel turns by; for an endless move, in one second."""
        base = drive_base(robot, self.name)
        # A turn on the spot rolls each wheel along a circle whose diameter is the axle track, the
        # left one forward if it is clockwise.
        if self.is_turn:
            turn_deg = amount * base.axle_track_mm / base.wheel_diameter_mm
            return turn_deg, -turn_deg
        return (base.turn_deg(amount),) * 2

    def turns_deg(
        self,
        robot: Robot,
        amount: float,
    ) -> tuple[float, ...]:
        return self.wheel_turns_deg(robot, amount)

    def setup(self, robot: Robot) -> tuple[str, ...]:
        return drive_base_setup(robot, self.name)


@dataclass(frozen=True)
class DriveStraight(_DriveBaseCommand):
    """Drive the drive base by a distance, without waiting: ``DriveBase.straight(distance,
    wait=False)``."""

    unit: ClassVar[str] = "mm"
    name: ClassVar[str] = "straight"
    description: ClassVar[str] = "drive {0.low:g} to {0.high:g} mm"
    code: ClassVar[str] = "{0.mover}.straight({1}, wait=False)"


@dataclass(frozen=True)
class Turn(_DriveBaseCommand):
    """Turn the drive base on the spot, clockwise positive, without waiting: ``DriveBase.turn(angle,
    wait=False)``."""

    unit: ClassVar[str] = "deg"
    name: ClassVar[str] = "turn"
    is_turn: ClassVar[bool] = True
    description: ClassVar[str] = "turn by {0.low:g} to {0.high:g} deg"
    code: ClassVar[str] = "{0.mover}.turn({1}, wait=False)"


@dataclass(frozen=True)
class Curve(_DriveBaseCommand):
    """Drive along a circle by an angle, to the right for a positive one, without waiting:
    ``DriveBase.curve(..., wait=False)``. ``radius_mm``: radius of the path of the robot's centre;
    negative to drive backwards."""

    radius_mm: int
    unit: ClassVar[str] = "deg"
    name: ClassVar[str] = "curve"
    mirror_sign: ClassVar[int] = 0
    description: ClassVar[str] = (
        "drive along a circle of {0.radius_mm} mm by {0.low:g} to {0.high:g} deg"
    )
    code: ClassVar[str] = "{0.mover}.curve({0.radius_mm}, {1}, wait=False)"

    def check(self, robot: Robot) -> None:
        super().check(robot)
        if not 10 <= abs(self.radius_mm) <= WIRE_MAX:
            raise self.error(
                f": a radius of {self.radius_mm} mm; give 10 or more, or Turn on the spot"
            )

    def turns_deg(
        self,
        robot: Robot,
        amount: float,
    ) -> tuple[float, ...]:
        base = drive_base(robot, self.name)
        # Arcs are an angle (deg) times a radius (mm). `path` is the arc of the robot's centre; the
        # left wheel rolls `turn` more than that, and the right one `turn` less.
        path = abs(amount) * self.radius_mm
        turn = math.copysign(amount, amount * self.radius_mm) * base.axle_track_mm / 2
        left_deg = 2 * (path + turn) / base.wheel_diameter_mm
        right_deg = 2 * (path - turn) / base.wheel_diameter_mm
        return left_deg, right_deg


@dataclass(frozen=True)
class _Drive(_DriveBaseCommand):
    """One of the two arguments of ``DriveBase.drive(speed, turn_rate)``; the other is 0 unless it
    is a command too."""

    ends: ClassVar[bool] = False
    call: ClassVar[str] = "drive"

    def turns_deg(
        self,
        robot: Robot,
        amount: float,
    ) -> tuple[float, ...]:
        return tuple(map(_test_turn_deg, self.wheel_turns_deg(robot, amount)))

    def start(
        self,
        robot: Robot,
        amounts: Mapping[str, str],
    ) -> str:
        # `drive` needs both values, so a command of only one of them leaves the other at 0.
        speed = amounts.get(DriveSpeed.name, "0")
        turn_rate = amounts.get(DriveTurnRate.name, "0")
        return f"{self.mover}.drive({speed}, {turn_rate})"


@dataclass(frozen=True)
class DriveSpeed(_Drive):
    """Speed of ``DriveBase.drive(speed, turn_rate)``, forward positive."""

    unit: ClassVar[str] = "mm/s"
    name: ClassVar[str] = "drive_speed"
    description: ClassVar[str] = "drive at {0.low:g} to {0.high:g} mm/s"


@dataclass(frozen=True)
class DriveTurnRate(_Drive):
    """Turn rate of ``DriveBase.drive(speed, turn_rate)``, clockwise positive."""

    unit: ClassVar[str] = "deg/s"
    name: ClassVar[str] = "turn_rate"
    is_turn: ClassVar[bool] = True
    mirror_sign: ClassVar[int] = -1
    description: ClassVar[str] = "turn at {0.low:g} to {0.high:g} deg/s"


def drive_base(robot: Robot, needed_by: str) -> DriveBase:
    """The robot's drive base. Raises DescriptionError if the robot has no drive base."""
    if robot.drive_base is None:
        raise DescriptionError(
            f"robot '{robot.name}' has no drive base for '{needed_by}'; describe one or command "
            "its motors"
        )
    return robot.drive_base


def drive_base_setup(robot: Robot, needed_by: str) -> tuple[str, ...]:
    """Statement of a hub program that makes the object ``drive_base``."""
    base = drive_base(robot, needed_by)
    # `repr` keeps all digits, so that hub and twin compute with the same numbers.
    size = f"wheel_diameter={base.wheel_diameter_mm!r}, axle_track={base.axle_track_mm!r}"
    return (f"drive_base = DriveBase(motor_{base.left}, motor_{base.right}, {size})",)


@dataclass(frozen=True)
class HubLight(Command):
    """Hue of the hub's light: ``hub.light.on(Color(hue, 100, 100))``; 0 is red, 120 green, 240
    blue."""

    low: float = 0.0
    high: float = 359.0
    unit: ClassVar[str] = "deg"
    name: ClassVar[str] = "light"
    imports: ClassVar[Imports] = (("pybricks.parameters", "Color"),)
    description: ClassVar[str] = "light of a hue of {0.low:g} to {0.high:g} deg"
    code: ClassVar[str] = "hub.light.on(Color({1}, 100, 100))"

    def check(self, robot: Robot) -> None:
        if self.low < 0 or self.high > 360:
            raise self.error(
                f" ranges from {self.low:g} to {self.high:g}; hues are 0 to 360 degrees"
            )


@dataclass(frozen=True)
class ClientCommand(Command):
    """Number that a client program of one's own gets, such as an action in -1..1."""

    name: str
    low: float = -1.0
    high: float = 1.0
    unit: str = ""

    def check(self, robot: Robot) -> None:
        raise self.error(" is for a client of your own; name its program, or take another command")


@dataclass(frozen=True)
class LightBrightness(Command):
    """Brightness of a light on a port, or of the lights around a distance sensor:
    ``Light.on(brightness)``."""

    sensor: str
    low: float = 0.0
    high: float = 100.0
    unit: ClassVar[str] = "%"
    description: ClassVar[str] = "light with {0.low:g} to {0.high:g} %"

    @property
    def name(self) -> str:
        return f"{self.sensor}_brightness"

    def check(self, robot: Robot) -> None:
        kind = robot.sensor(self.sensor).kind
        if not kind.model.light:
            raise self.error(
                f": {an(kind.value)} has no light to set; use a Light or an UltrasonicSensor"
            )
        if self.low < 0 or self.high > 100:
            raise self.error(f" ranges from {self.low:g} to {self.high:g} %; stay within 0 to 100")

    def devices(self, robot: Robot) -> tuple[str, ...]:
        return (self.sensor,)

    def start(
        self,
        robot: Robot,
        amounts: Mapping[str, str],
    ) -> str:
        light = robot.sensor(self.sensor).kind.model.light
        return f"sensor_{self.sensor}.{light}({amounts[self.name]})"


@dataclass(frozen=True)
class HubSound(Command):
    """Short tone of the hub's loudspeaker: ``hub.speaker.beep(frequency, duration)``; silent below
    64 Hz. ``duration_ms``: duration of the tone, for which the hub waits."""

    low: float = 0.0
    high: float = 2000.0
    duration_ms: int = 50
    scale: ClassVar[int] = 1
    unit: ClassVar[str] = "Hz"
    name: ClassVar[str] = "sound"
    description: ClassVar[str] = "a tone of {0.low:g} to {0.high:g} Hz for {0.duration_ms} ms"
    code: ClassVar[str] = "play_tone({1})"

    def check(self, robot: Robot) -> None:
        if not robot.hub.model.has_speaker:
            raise self.error(
                f": {an(robot.hub.value)} hub has no loudspeaker; choose a prime hub, or use "
                "HubLight"
            )
        if self.low < 0 or not 1 <= self.duration_ms <= 200:
            raise self.error(
                f": {self.low:g} Hz at least, for {self.duration_ms} ms; give 0 Hz or more, and 1 "
                "to 200 ms"
            )

    def setup(self, robot: Robot) -> tuple[str, ...]:
        play = f"hub.speaker.beep(frequency_hz, {self.duration_ms})"
        return (
            "def play_tone(frequency_hz):",
            f"    if frequency_hz >= {_LOWEST_TONE_HZ}:",
            f"        {play}",
            "",
        )
