"""Description of a LEGO robot: hub, ports, motors, sensors, drive base. Pure, frozen, validated
data."""

import enum
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

from brickhub.errors import DescriptionError, an
from brickhub.fields import check_fields
from brickhub.robot.hardware import AnyHub, HubKind, KindType, MotorKind, SensorKind


class Direction(enum.Enum, metaclass=KindType):
    """Direction in which a motor counts up, seen from its shaft."""

    CLOCKWISE = 1
    COUNTERCLOCKWISE = -1


@dataclass(frozen=True)
class Motor:
    """Motor on a port; angles and speeds are those of the gear train's output.

    Attributes:
        port: port of the hub, a letter; "" for ``bricktwin.robots.planned.completed``, which takes
            the one of that name in a building plan.
        gears: teeth from the motor to the output, as in Pybricks, e.g. ``(20, 60)``. Empty means
            the motor's shaft, or those of a building plan, if the robot is made of one; ``(1, 1)``
            means the motor's shaft in any case.
        range_deg: range that the hub clamps every target to; ``None`` for endless rotation.
        end_stops_deg: lowest and highest angle at which what the motor drives meets something, so
            that it stalls there; ``None`` if nothing is known. A virtual robot stops there; a real
            one has its own. Angles as in ``range_deg``.
        speed_limit_deg_s, acceleration_deg_s2, torque_limit_mnm: arguments of
            ``Motor.control.limits``; ``None`` keeps the firmware's default.
        zero_deg: output angle, after the hub is switched on, at which our angle is 0. It depends on
            how the motor is mounted; `brickhub calibrate` finds it.
    """

    name: str
    port: str = ""
    kind: MotorKind = MotorKind.SPIKE_MEDIUM
    direction: Direction = Direction.CLOCKWISE
    gears: tuple[int, ...] = ()
    range_deg: tuple[int, int] | None = None
    end_stops_deg: tuple[float, float] | None = None
    speed_limit_deg_s: int | None = None
    acceleration_deg_s2: int | None = None
    torque_limit_mnm: int | None = None
    zero_deg: int = 0

    @property
    def turn_deg(self) -> float:
        """Output angle per turn of the motor's shaft; absolute angles are ambiguous beyond it."""
        if not self.gears:
            return 360.0
        # Gears between the first and the last one change no angle but their own.
        return 360.0 * self.gears[0] / self.gears[-1]

    @property
    def shaft_turns(self) -> float:
        """Clockwise turns of the motor's shaft per turn of the output; negative if the motor counts
        up counterclockwise."""
        ratio = self.gears[-1] / self.gears[0] if self.gears else 1.0
        return ratio * self.direction.value

    def __post_init__(self) -> None:
        _check_device(self)
        is_train = len(self.gears) != 1 and all(teeth >= 1 for teeth in self.gears)
        if not is_train:
            raise DescriptionError(
                f"motor '{self.name}': gears {self.gears} are not a train; give the teeth from "
                "motor to output, e.g. (20, 60)"
            )
        if self.range_deg is not None and self.range_deg[0] >= self.range_deg[1]:
            raise DescriptionError(
                f"motor '{self.name}': range {self.range_deg} is empty; give (lowest, highest) "
                "in degrees"
            )
        if self.end_stops_deg is not None and not self.end_stops_deg[0] < self.end_stops_deg[1]:
            raise DescriptionError(
                f"motor '{self.name}': end stops {self.end_stops_deg} leave no way; give (lowest, "
                "highest) in degrees"
            )
        # This is checked here rather than on the hub, where a motor without an encoder has no such
        # methods.
        for field in ("speed_limit_deg_s", "acceleration_deg_s2", "torque_limit_mnm", "range_deg"):
            value = getattr(self, field)
            if value is not None and not self.kind.model.has_encoder:
                raise DescriptionError(
                    f"motor '{self.name}': a {self.kind.value} motor has no encoder; omit {field}"
                )
            # The range is a pair, and was checked before.
            if isinstance(value, int) and value < 1:
                raise DescriptionError(
                    f"motor '{self.name}': {field} is {value}; give a positive number or None"
                )


LOOKS: dict[str, tuple[float, float, float]] = {
    "ahead": (1.0, 0.0, 0.0),
    "back": (-1.0, 0.0, 0.0),
    "left": (0.0, 1.0, 0.0),
    "right": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
}
"""Directions in the axes of a robot: x forward, y left, z up."""
HUB_FLAT = ("up", "ahead")
"""Directions of top and front of a hub that lies flat, with its USB port ahead."""


@dataclass(frozen=True)
class Mount:
    """Mount of a sensor on a driving robot, for its virtual body; a real robot ignores it. Raises
    DescriptionError if position or direction is invalid.

    Attributes:
        at_mm: position of its eye, or its button: ahead of the middle of the axle, to the left of
            it, and above the floor.
        looks: viewing direction, one of ``LOOKS``.
    """

    at_mm: tuple[float, float, float]
    looks: str = "ahead"

    def __post_init__(self) -> None:
        check_fields(Mount, vars(self))
        if self.looks not in LOOKS:
            raise DescriptionError(
                f"a sensor cannot look '{self.looks}'; choose {', '.join(LOOKS)}"
            )
        if not all(math.isfinite(value) for value in self.at_mm) or self.at_mm[2] <= 0:
            raise DescriptionError(
                f"a sensor cannot sit at {self.at_mm}; give mm ahead, to the left and above "
                "the floor"
            )


@dataclass(frozen=True)
class UltrasonicSensor:
    """SPIKE distance sensor, with a range of 40 to 2000 mm."""

    name: str
    port: str = ""
    mount: Mount | None = None
    kind: ClassVar[SensorKind] = SensorKind.ULTRASONIC
    NEAREST_MM: ClassVar[int] = 40
    FARTHEST_MM: ClassVar[int] = 2000

    def __post_init__(self) -> None:
        _check_device(self)


@dataclass(frozen=True)
class PoweredUpSensor:
    """Any other sensor on a port, a letter, or a digit for one of EV3's sensor ports; read by a
    ``SensorReading``, or by a ``Distance`` if it measures millimetres."""

    name: str
    port: str
    kind: SensorKind
    mount: Mount | None = None

    def __post_init__(self) -> None:
        _check_device(self)


Sensor = UltrasonicSensor | PoweredUpSensor


def sensor_of(
    kind: SensorKind,
    name: str,
    port: str,
) -> Sensor:
    """Description of a sensor by its kind, as a user writes it."""
    if kind is UltrasonicSensor.kind:
        return UltrasonicSensor(name, port)
    return PoweredUpSensor(name, port, kind)


_Device = TypeVar("_Device", Motor, Sensor)


@dataclass(frozen=True)
class DriveBase:
    """Drive base of two named motors. A wheel diameter or axle track of 0 is for
    ``bricktwin.robots.planned.completed``, which takes that of a building plan."""

    left: str
    right: str
    wheel_diameter_mm: float = 0.0
    axle_track_mm: float = 0.0

    def __post_init__(self) -> None:
        check_fields(DriveBase, vars(self))
        if self.left == self.right:
            raise DescriptionError(
                f"drive base: left and right are both '{self.left}'; name two motors"
            )
        if self.wheel_diameter_mm < 0 or self.axle_track_mm < 0:
            raise DescriptionError(
                "drive base: wheel diameter and axle track must be positive millimetres"
            )

    def turn_deg(self, distance_mm: float) -> float:
        """Angle that the wheels turn by over a distance."""
        return 360.0 * distance_mm / (math.pi * self.wheel_diameter_mm)


@dataclass(frozen=True)
class Chassis:
    """Chassis of a driving robot, for its virtual body; positions in mm ahead of the middle of the
    axle, and to the left of it. Raises DescriptionError if a value is invalid.

    Attributes:
        hub_mm: middle of the hub; ``None`` for slightly behind the axle.
        caster_mm: position of the ball caster.
        ballast_g: mass in addition to hub, motors, sensors, wheels and a light frame.
    """

    hub_mm: tuple[float, float] | None = None
    caster_mm: tuple[float, float] = (-60.0, 0.0)
    ballast_g: float = 0.0

    def __post_init__(self) -> None:
        check_fields(Chassis, vars(self))
        numbers = (*(self.hub_mm or (0.0, 0.0)), *self.caster_mm, self.ballast_g)
        are_finite = all(math.isfinite(number) for number in numbers)
        # A caster below the axle would let the robot tip over.
        is_caster_off_axle = abs(self.caster_mm[0]) >= 20
        if not are_finite or self.ballast_g < 0 or not is_caster_off_axle:
            raise DescriptionError(
                f"a chassis with its caster at {self.caster_mm} mm and {self.ballast_g} g; put "
                "the caster 20 mm or more before "
                "or behind the axle, and give 0 g or more"
            )


@dataclass(frozen=True)
class Robot:
    """Description of a robot: one hub, or a device of LEGO's kits in its place, with its devices.
    Raises DescriptionError if the description is invalid.

    Attributes:
        hub_sides: where the hub's top and its front, with the USB port, look: names of
            :data:`LOOKS`; by default ``("up", "ahead")``. The IMU's values are
            along the robot's axes, however the hub is mounted.
        model: MuJoCo model of a virtual robot: ``"package.module:function"``, which is called with
            the robot and its scene and returns an ``MjSpec``, or the path of an MJCF file (see
            ``bricktwin.twin.models.load``) or of a building plan. Without a model, a robot with a
            drive base gets a generated body, and any other one is a bench.
        plan: path of a building plan, an LDraw file, that completes this description:
            ``bricktwin.robots.planned.completed`` reads it, and gives a robot without a plan. Until
            then ports may be "", and what the plan says may be missing.
        chassis: chassis of the generated body of a drive base without model.
        mirrored: of a body whose left and right sides are alike, the pairs of motors, or of
            sensors, that change places in a mirror. A motor that is paired with itself turns the
            other way there; one in no pair turns as it does.
    """

    name: str
    hub: AnyHub
    motors: tuple[Motor, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    drive_base: DriveBase | None = None
    needs_imu: bool = False
    hub_sides: tuple[str, ...] = ()
    model: str | None = None
    plan: str | None = None
    chassis: Chassis = Chassis()
    mirrored: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        # A robot's name becomes no variable on the hub, unlike a device's, so it may have hyphens.
        _check_name(str(self.name).replace("-", "_"))
        # A list is as good as a tuple, but it cannot be hashed.
        for field in ("motors", "sensors"):
            value = getattr(self, field)
            if isinstance(value, list):
                object.__setattr__(self, field, tuple(value))
        check_fields(Robot, vars(self))
        # The plan has what is missing, and the completed robot is checked like any other.
        if self.plan is not None:
            return
        if not self.hub_sides:
            object.__setattr__(self, "hub_sides", HUB_FLAT)
        if not _are_at_right_angles(self.hub_sides):
            remedy = f'give two of {", ".join(LOOKS)} at right angles, such as ("up", "ahead")'
            raise self._error(f"the hub's top and front cannot look {self.hub_sides}; {remedy}")
        if self.hub_sides != HUB_FLAT and not self.needs_imu:
            raise self._error("only the IMU depends on hub_sides; omit them, or say needs_imu=True")
        self._check_devices()
        if self.needs_imu and not self.hub.model.has_imu:
            raise self._error(
                f"{an(self.hub.value)} hub has no IMU; choose a prime, essential or technic hub"
            )
        if self.drive_base is not None:
            if not (self.drive_base.wheel_diameter_mm and self.drive_base.axle_track_mm):
                raise self._error(
                    "its drive base has no wheel diameter or no axle track; say both in mm, or "
                    "name a plan"
                )
            left = self.motor(self.drive_base.left)
            right = self.motor(self.drive_base.right)
            # The firmware refuses such a pair only when the program runs, which is late.
            if left.gears != right.gears:
                raise self._error("both motors of a drive base need the same gears")
        self._check_mirror()

    def check_complete(self) -> None:
        """Raise DescriptionError if the robot has a plan that nobody has read."""
        if self.plan is not None:
            raise self._error(
                f"its plan {self.plan} was not read; write completed(Robot(...)), which "
                "bricktwin.robots.planned has"
            )

    def _error(self, problem: str) -> DescriptionError:
        return DescriptionError(f"robot '{self.name}': {problem}")

    def _check_devices(self) -> None:
        devices: tuple[Motor | Sensor, ...] = (*self.motors, *self.sensors)
        self._check_unique("port", [device.port for device in devices])
        self._check_unique("name", [device.name for device in devices])
        for device in devices:
            if not device.port:
                raise self._error(f"'{device.name}' has no port; say it, or name a plan that does")
            # The length is checked too, because "AB" is part of the text "ABCDEF".
            if len(device.port) != 1 or device.port not in self.hub.model.ports:
                ports = f"{an(self.hub.value)} hub has ports {', '.join(self.hub.model.ports)}"
                raise self._error(
                    f"'{device.name}' is on port {device.port}, but {ports}; move it or choose "
                    "another hub"
                )
            fitting_ports = self.hub.model.takes(device.kind.model)
            if device.port not in fitting_ports:
                raise self._error(_misfit(device, self.hub, fitting_ports))

    def _check_unique(
        self,
        kind: str,
        values: list[str],
    ) -> None:
        for value, count in Counter(values).items():
            if count > 1:
                raise self._error(f"{kind} {value} is used {count} times; give each device its own")

    def _check_mirror(self) -> None:
        known = [device.name for device in (*self.motors, *self.sensors)]
        # A device that is paired with itself counts once.
        named = Counter(name for pair in self.mirrored for name in dict.fromkeys(pair))
        for name, count in named.items():
            if name not in known or count > 1:
                raise self._error(
                    f"mirrored names '{name}' {count} times; it may name each motor and sensor of "
                    "the robot once"
                )
        for pair in self.mirrored:
            # Devices of a pair take each other's place in a mirror, so kind and gears of both have
            # to be equal.
            sorts: set[tuple[MotorKind | SensorKind, tuple[int, ...]]] = set()
            for motor in self.motors:
                if motor.name in pair:
                    sorts.add((motor.kind, motor.gears))
            for sensor in self.sensors:
                if sensor.name in pair:
                    sorts.add((sensor.kind, ()))
            if len(sorts) > 1:
                raise self._error(
                    f"{pair[0]} and {pair[1]} are no mirror images; pair two of the same kind, "
                    "with the same gears"
                )

    def in_mirror(self, name: str) -> tuple[str, int]:
        """The motor or sensor in whose place a device is in a mirror from left to right, and the
        factor of its angle there. A mirror image turns the other way, seen from its shaft."""
        pairs = dict(self.mirrored) | {second: first for first, second in self.mirrored}
        other = pairs.get(name, name)
        motors = [motor for motor in self.motors if motor.name in (name, other)]
        # Sensors have no direction.
        if name not in pairs or not motors:
            return other, 1
        count_alike = len({motor.direction for motor in motors}) == 1
        # Two that are mounted alike turn alike in a mirror; two that look to opposite sides do so
        # if they count in opposite directions.
        are_mounted_alike = motors[0].kind.model.is_two_sided
        return other, 1 if count_alike == are_mounted_alike else -1

    def motor(self, name: str) -> Motor:
        """The motor of that name. Raises DescriptionError if the robot has no such motor."""
        return _find_device(
            self,
            "motor",
            self.motors,
            name,
        )

    def sensor(self, name: str) -> Sensor:
        """The sensor of that name. Raises DescriptionError if the robot has no such sensor."""
        return _find_device(
            self,
            "sensor",
            self.sensors,
            name,
        )


def _misfit(
    device: Motor | Sensor,
    hub: AnyHub,
    fitting_ports: str,
) -> str:
    """Why a motor or sensor does not fit its port, and what does."""
    kind = device.kind.value
    if fitting_ports:
        return (
            f"'{device.name}' is {an(kind)} on port {device.port}, where it does not fit; move it "
            f"to one of {', '.join(fitting_ports)}"
        )
    return (
        f"'{device.name}' is {an(kind)}, whose plug fits no port of {an(hub.value)} hub; take "
        f"one of pybricks.{hub.model.devices}, or another hub"
    )


def _are_at_right_angles(sides: tuple[str, ...]) -> bool:
    """Whether these are two names of `LOOKS`, neither the same nor opposite."""
    if len(sides) != 2 or not all(side in LOOKS for side in sides):
        return False
    top, front = (LOOKS[side] for side in sides)
    product = sum(a * b for a, b in zip(top, front, strict=True))
    return product == 0


def _check_device(device: Motor | Sensor) -> None:
    _check_name(device.name)
    # This comes before all other checks, because Pybricks writes `Port.A` here and the message can
    # say what to write.
    if not isinstance(device.port, str):
        raise DescriptionError(
            f"'{device.name}' is on port {device.port!r}; give the port's letter, such as 'A'"
        )
    check_fields(type(device), vars(device))


def _check_name(name: str) -> None:
    # The name becomes part of a variable's name in the hub program.
    if not isinstance(name, str) or not name.isidentifier():
        raise DescriptionError(
            f"'{name}' is not a name; use letters, digits and underscores, not starting "
            "with a digit"
        )


def _find_device(
    robot: Robot,
    kind: str,
    devices: tuple[_Device, ...],
    name: str,
) -> _Device:
    for device in devices:
        if device.name == name:
            return device
    known = ", ".join(device.name for device in devices) or "none"
    raise DescriptionError(f"robot '{robot.name}' has no {kind} '{name}' (it has: {known})")


def with_end_stops(robot: Robot, end_stops: Mapping[str, tuple[float, float]]) -> Robot:
    """The robot whose motors of these names meet something at these angles (deg of the output).
    Raises DescriptionError if it has no such motor, or the stops leave no way."""
    # The robot is unchanged, so it need not be checked again.
    if not end_stops:
        return robot
    # `motor` raises for a name that no motor has.
    for name in end_stops:
        robot.motor(name)
    motors = (
        replace(motor, end_stops_deg=end_stops.get(motor.name, motor.end_stops_deg))
        for motor in robot.motors
    )
    return replace(robot, motors=tuple(motors))


BENCH = Robot(
    "bench",
    HubKind.PRIME,
    tuple(Motor(f"motor_{port.lower()}", port) for port in "ABCDEF"),
    needs_imu=True,
)
"""A bare Prime hub with an unloaded medium motor on every port."""
