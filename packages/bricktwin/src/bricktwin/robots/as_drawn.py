"""Robots as they are drawn: from a building plan alone, names, directions, drive base and mirrored
pairs follow from where its motors and sensors are, and what they move."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from brickhub.robot import (
    Direction,
    DriveBase,
    Motor,
    MotorKind,
    Robot,
    Sense,
    Sensor,
    SensorKind,
)
from brickhub.robot.spec import sensor_of
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.robots.plan_facts import DeviceFacts, read_facts
from bricktwin.robots.planned import plan_file, robot_of_plan

_ALIKE_M = 0.004
"""Largest difference of positions that are mirror images of each other: half a module of LEGO."""
_ROW_M = 0.016
"""Largest difference of positions ahead within a row of legs."""
_ROWS = {1: ("",), 2: ("front", "back"), 3: ("front", "middle", "back")}
"""Names of rows of legs, from the front, by their number."""
_SINGLE = ("drive", "steering")
_MARGIN_DEG = 5.0
"""Way that is left before the end stops of a joint."""
_LEAST_WAY_DEG = 20.0
"""Least way of a joint that is worth turning."""
_LEVEL_COSINE = 0.9
"""Least share of an axis that points to the side."""


@dataclass(frozen=True)
class DrawnMotor:
    """A motor of a drawing, and what it moves.

    Attributes:
        name: in the robot's description.
        facts: of the plan.
        place: where what moves the robot is, such as "left front"; "" if that is not clear.
    """

    name: str
    facts: DeviceFacts
    place: str

    @property
    def role(self) -> Role | None:
        """What it moves; ``None`` for nothing."""
        return Role(self.facts.role) if self.facts.role else None

    @property
    def moves(self) -> str:
        """What it moves, in words."""
        facts = self.facts
        where = f", {self.place}" if self.place else ""
        if facts.turns_with:
            return f"turns with port {facts.turns_with}"
        match self.role:
            case Role.WHEEL:
                return f"turns a wheel of {facts.wheel_mm:g} mm{where}"
            case Role.LEG:
                return f"turns a leg{where}"
            case Role.STEERING:
                return "steers"
            case Role.JOINT if facts.way_deg or facts.stops_deg:
                low, high = facts.stops_deg or facts.way_deg
                return f"turns a joint, from {low:.0f} to {high:.0f}°"
            case Role.JOINT:
                return "turns something all around that reaches no floor"
        return "turns nothing"


@dataclass(frozen=True)
class DrawnSensor:
    """A sensor of a drawing.

    Attributes:
        name: in the robot's description.
        facts: of the plan.
    """

    name: str
    facts: DeviceFacts


@dataclass(frozen=True)
class DrawnRobot:
    """A robot as it is drawn.

    Attributes:
        path: of the plan.
        robot: its description.
        motors, sensors: in its order, with what the plan shows of them.
        hub: the part that is its hub.
        lacks: what of the plan has no twin, in words.
        is_wired: whether the plan says the ports.
    """

    path: Path
    robot: Robot
    motors: tuple[DrawnMotor, ...]
    sensors: tuple[DrawnSensor, ...]
    hub: DeviceFacts
    lacks: tuple[str, ...]
    is_wired: bool

    def motors_with(self, role: Role) -> list[DrawnMotor]:
        """The motors that move this, without those that only turn with another."""
        return _moving(self.motors, role)

    def sensor_looking(self, sense: Sense, looks: str) -> str | None:
        """Name of the first sensor with a sense that looks in a direction, a name of ``LOOKS``."""
        for sensor in self.sensors:
            senses = SensorKind(sensor.facts.name).model.senses
            if sense in senses and sensor.facts.looks == looks:
                return sensor.name
        return None


def robot_as_drawn(path: Path | str) -> DrawnRobot:
    """The robot of a plan file, as it is drawn. Raises PlanError if the plan cannot be read or
    something has no twin, DescriptionError if it has no hub."""
    file = plan_file(str(path)) or Path(path)
    facts = read_facts(file)
    places = {motor.port: place for motor, place in _places(facts.motors)}
    motor_names = _motor_names(facts.motors, places)
    motors: list[DrawnMotor] = []
    for name, motor in zip(motor_names, facts.motors, strict=True):
        place = places.get(motor.port, "").replace("_", " ")
        # The only one of a kind is nowhere but there.
        place = "" if place in _SINGLE else place
        motors.append(DrawnMotor(name, motor, place))
    sensor_names = _sensor_names(facts.sensors, taken=motor_names)
    sensors = [
        DrawnSensor(name, sensor) for name, sensor in zip(sensor_names, facts.sensors, strict=True)
    ]
    robot = robot_of_plan(
        file,
        motors=[_described(motor) for motor in motors],
        sensors=[_sensor(sensor) for sensor in sensors],
        drive_base=_drive_base(motors),
        mirrored=tuple(_mirrored(motors)),
    )
    return DrawnRobot(
        file,
        robot,
        tuple(motors),
        tuple(sensors),
        facts.hubs[0],
        tuple(facts.lacks),
        facts.is_wired,
    )


def _moving(motors: Sequence[DrawnMotor], *roles: Role) -> list[DrawnMotor]:
    """The motors of some roles, without those that only turn with another."""
    return [motor for motor in motors if motor.role in roles and not motor.facts.turns_with]


def _described(motor: DrawnMotor) -> Motor:
    """The description of a motor, which counts up when it rolls or walks forwards; that of a joint
    keeps within its way."""
    facts = motor.facts
    direction = Direction.CLOCKWISE if facts.is_forward else Direction.COUNTERCLOCKWISE
    described = Motor(
        motor.name,
        facts.port,
        MotorKind(facts.name),
        direction,
        gears=facts.gears,
    )
    way_deg = facts.stops_deg or facts.way_deg
    if motor.role is not Role.JOINT or not way_deg:
        return described
    low_deg, high_deg = sorted(angle / described.shaft_turns for angle in way_deg)
    # Beyond half a turn of the shaft, the angle after switching on is ambiguous.
    half_deg = described.turn_deg / 2
    low_deg = max(low_deg, -half_deg) + _MARGIN_DEG
    high_deg = min(high_deg, half_deg) - _MARGIN_DEG
    if high_deg - low_deg < _LEAST_WAY_DEG:
        return described
    return replace(described, range_deg=(math.ceil(low_deg), math.floor(high_deg)))


def _sensor(sensor: DrawnSensor) -> Sensor:
    return sensor_of(SensorKind(sensor.facts.name), sensor.name, sensor.facts.port)


def _motor_names(motors: Sequence[DeviceFacts], places: Mapping[str, str]) -> list[str]:
    """Names of motors: those of the plan; else by their place, as far as places differ."""
    labels = [motor.label for motor in motors]
    names: list[str] = []
    for motor in motors:
        place = places.get(motor.port, "")
        is_clear = place != "" and place not in labels and list(places.values()).count(place) == 1
        names.append(motor.label or (place if is_clear else f"motor_{motor.port.lower()}"))
    return names


def _places(motors: Sequence[DeviceFacts]) -> Iterator[tuple[DeviceFacts, str]]:
    """Motors that move the robot, with names of their places: ``left_front``."""
    for role in (Role.WHEEL, Role.LEG):
        moving = [motor for motor in motors if motor.role == role and not motor.turns_with]
        if len(moving) == 1:
            yield moving[0], "drive"
            continue
        middle_m = _middle_m(moving)
        rows = _rows(moving)
        for row, name in zip(rows, _ROWS.get(len(rows), ()), strict=False):
            for motor in row:
                side = "left" if motor.at_m[1] > middle_m else "right"
                yield motor, "_".join(filter(None, (side, name)))
    for motor in motors:
        if motor.role == Role.STEERING:
            yield motor, "steering"


def _rows(motors: Sequence[DeviceFacts]) -> list[list[DeviceFacts]]:
    """Motors by how far ahead they are, the foremost first."""
    rows: list[list[DeviceFacts]] = []
    for motor in sorted(motors, key=lambda motor: -motor.at_m[0]):
        if rows and rows[-1][0].at_m[0] - motor.at_m[0] < _ROW_M:
            rows[-1].append(motor)
        else:
            rows.append([motor])
    return rows


def _middle_m(motors: Sequence[DeviceFacts]) -> float:
    """Where the middle between the motors on the left and those on the right is."""
    sides = [motor.at_m[1] for motor in motors]
    return (min(sides) + max(sides)) / 2 if sides else 0.0


_SENSES = {
    (Sense.DISTANCE, "ahead"): "eyes",
    (Sense.SURFACE, "down"): "light",
    (Sense.ROTATION, ""): "gyro",
}
"""Names of sensors, by what they sense and where they look, "" for anywhere."""


def _sensor_names(sensors: Sequence[DeviceFacts], taken: Sequence[str]) -> list[str]:
    """Names of sensors: those of the plan; else by what they see, as far as that is one."""
    names: list[str] = []
    for sensor in sensors:
        senses = SensorKind(sensor.name).model.senses
        wanted = [
            name
            for (sense, looks), name in _SENSES.items()
            if sense in senses and looks in ("", sensor.looks)
        ]
        free = [name for name in wanted if name not in (*names, *taken)]
        names.append(sensor.label or next(iter(free), f"sensor_{sensor.port.lower()}"))
    return names


def _drive_base(motors: Sequence[DrawnMotor]) -> DriveBase | None:
    """The drive base of a robot with two driven wheels, one on each side of one axle."""
    wheels = _moving(motors, Role.WHEEL)
    if len(wheels) != 2 or not _are_mirrored(wheels[0].facts, wheels[1].facts, wheels):
        return None
    right, left = sorted(wheels, key=lambda wheel: wheel.facts.wheel_left_m)
    are_alike = left.facts.wheel_mm == right.facts.wheel_mm
    return DriveBase(left.name, right.name) if are_alike else None


def _mirrored(motors: Sequence[DrawnMotor]) -> Iterator[tuple[str, str]]:
    """Pairs of motors that change places in a mirror, the left one first."""
    moving = _moving(motors, Role.WHEEL, Role.LEG)
    left_over = list(moving)
    for first, second in itertools.combinations(moving, 2):
        is_free = first in left_over and second in left_over
        are_images = _are_mirrored(first.facts, second.facts, moving)
        if is_free and are_images and _turn_as_in_mirror(first.facts, second.facts):
            left_over.remove(first)
            left_over.remove(second)
            pair = sorted((first, second), key=lambda motor: -motor.facts.at_m[1])
            yield pair[0].name, pair[1].name


def _turn_as_in_mirror(first: DeviceFacts, second: DeviceFacts) -> bool:
    """Whether two motors at mirrored places are mounted as their kind is in a mirror."""
    are_mounted_alike = first.axis[1] * second.axis[1] > 0.0
    return are_mounted_alike == MotorKind(first.name).model.is_two_sided


def _are_mirrored(
    first: DeviceFacts,
    second: DeviceFacts,
    among: Sequence[DrawnMotor],
) -> bool:
    """Whether two motors are at mirrored places in the middle of some."""
    middle_m = _middle_m([motor.facts for motor in among])
    is_ahead_alike = abs(first.at_m[0] - second.at_m[0]) < _ALIKE_M
    is_high_alike = abs(first.at_m[2] - second.at_m[2]) < _ALIKE_M
    from_middle_m = first.at_m[1] + second.at_m[1] - 2 * middle_m
    is_apart = abs(first.at_m[1] - second.at_m[1]) > _ALIKE_M
    are_sideways = min(abs(first.axis[1]), abs(second.axis[1])) > _LEVEL_COSINE
    is_alike = first.name == second.name and first.gears == second.gears
    return (
        is_alike
        and is_ahead_alike
        and is_high_alike
        and is_apart
        and are_sideways
        and abs(from_middle_m) < 2 * _ALIKE_M
    )
