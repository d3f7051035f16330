"""Robots of building plans: a plan completes the description of a robot, and both must agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from brickhub.errors import DescriptionError, PlanError, UnknownNameError, an
from brickhub.finding import Finding, Outcome
from brickhub.robot import (
    AnyHub,
    Direction,
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    Robot,
    Sensor,
    SensorKind,
)
from brickhub.robot.spec import sensor_of
from brickhub.user_files import PLAN_ENDINGS
from bricktwin import robots
from bricktwin.robots.plan_facts import DeviceFacts, PlanFacts, facts_of, read_facts

if TYPE_CHECKING:
    from bricktwin.plans.plan import Plan

_WHEEL_TOLERANCE_MM = 0.5
"""Largest difference of a wheel's diameter, mm."""
_TRACK_TOLERANCE_MM = 2.0
"""Largest difference of the distance between the wheels, mm."""
_RATIO_TOLERANCE = 0.01
"""Largest difference of a gear ratio, as a share of it."""
_Mistake = tuple[int, str, str]
"""A mistake: its line in the plan's file (0 for the whole plan), its name, and what is wrong and
what to do."""


def is_plan(file: str) -> bool:
    """Whether a file's name is one of a building plan."""
    return file.lower().endswith(PLAN_ENDINGS)


def plan_file(model: str) -> Path | None:
    """Path of the building plan that a robot's model is, ``FILE`` or ``package:FILE``; ``None`` for
    other models. Raises DescriptionError if there is no such package."""
    package, _, file = model.rpartition(":")
    if not is_plan(file):
        return None
    # A single letter before the colon is a drive of Windows.
    if len(package) < 2:
        return Path(model)
    try:
        return Path(str(resources.files(package))) / file
    except (ImportError, TypeError, ValueError) as error:
        raise DescriptionError(
            f"there is no package '{package}' with the plan {file} ({error}); name the file"
        ) from None


class _Description(NamedTuple):
    """A robot in the words of `Robot`, while its plan still completes it."""

    name: str
    hub: AnyHub
    motors: tuple[Motor, ...]
    sensors: tuple[Sensor, ...]
    drive_base: DriveBase | None
    needs_imu: bool
    hub_sides: tuple[str, ...]


def robot_of_plan(
    path: Path | str,
    name: str | None = None,
    hub: AnyHub | None = None,
    *,
    motors: Sequence[Motor] = (),
    sensors: Sequence[Sensor] = (),
    drive_base: DriveBase | None = None,
    needs_imu: bool | None = None,
    hub_sides: tuple[str, ...] = (),
    model: str | None = None,
    mirrored: tuple[tuple[str, str], ...] = (),
) -> Robot:
    """The robot that a building plan describes: its hub, and the motors and sensors on the hub's
    ports, with gears, wheels and end stops. The plan is read once, here, and is the model of the
    virtual robot if none is named.

    Args:
        path: LDraw file, or ``package:FILE``.
        name: of the robot; by default that of the file.
        hub: by default the plan's.
        motors: what the plan does not say of some motors, such as their ranges. One whose port is
            "" is on the port of that name in the plan.
        sensors: as ``motors``.
        drive_base: a wheel diameter or axle track of 0 is the plan's.
        needs_imu: by default whether the hub has an IMU and is straight in the plan.
        hub_sides: by default as in the plan, where the IMU is needed.
        model, mirrored: as of `Robot`.

    Raises:
        PlanError: the plan cannot be read.
        DescriptionError: the plan has no hub, or contradicts what is said here.
    """
    # A file without a plan's ending may be a plan all the same, which reading it will show.
    file = plan_file(str(path)) or Path(path)
    design = read_facts(file)
    if hub is None:
        hub = _hub_of(file, design)
    if needs_imu is None:
        # An inertial sensor is only useful if the plan says how the hub lies.
        needs_imu = hub.model.has_imu and len(design.hub_sides) == 2
    description = Robot(
        _name_of(file) if name is None else name,
        hub,
        motors=tuple(motors),
        sensors=tuple(sensors),
        drive_base=drive_base,
        needs_imu=needs_imu,
        hub_sides=hub_sides,
        model=model,
        plan=str(file),
        mirrored=mirrored,
    )
    return completed(description)


def completed(robot: Robot) -> Robot:
    """A robot with what its building plan says: motors and sensors that the description does not
    name, ports that are "", gears, wheels, end stops and, where the IMU is needed, how the hub is
    mounted. The plan is read here, and is the model of the virtual robot if none is named. A robot
    without a plan is complete.

    Raises:
        PlanError: the plan cannot be read.
        DescriptionError: the plan contradicts the description, or neither says something.
    """
    if robot.plan is None:
        return robot
    path = plan_file(robot.plan) or Path(robot.plan)
    description = _Description(
        robot.name,
        robot.hub,
        robot.motors,
        robot.sensors,
        robot.drive_base,
        robot.needs_imu,
        robot.hub_sides,
    )
    whole = _completed(description, read_facts(path), path)
    # The plan has said all that it can, so the completed robot does not name it.
    return replace(
        robot,
        motors=whole.motors,
        sensors=whole.sensors,
        drive_base=whole.drive_base,
        hub_sides=whole.hub_sides,
        model=robot.model or str(path),
        plan=None,
    )


def _hub_of(path: Path, design: PlanFacts) -> HubKind:
    """The kind of the plan's hub, of several the first. Raises DescriptionError if it has none."""
    if not design.hubs:
        raise DescriptionError(f"{path} has no hub; a robot needs one that runs Pybricks")
    return HubKind(design.hubs[0].name)


def _name_of(path: Path) -> str:
    """A name for the robot of a file, which is an identifier."""
    stem = "".join(letter if letter.isalnum() else "_" for letter in path.stem)
    return stem if stem.isidentifier() else f"robot_{stem}"


def _completed(
    robot: _Description,
    design: PlanFacts,
    path: Path,
) -> _Description:
    """A description with what only its plan says. Raises DescriptionError if the plan contradicts
    it."""
    motors = _motors(robot, design, path)
    sensors = _sensors(robot, design, path)
    # This comes after the motors, because the plan knows their wheels by the ports that they have
    # now.
    base = robot.drive_base
    if base is not None and not (base.wheel_diameter_mm and base.axle_track_mm):
        base = _with_wheels(
            base,
            robot.name,
            motors,
            design,
            path,
        )
    sides = robot.hub_sides
    # How the hub lies matters only if its IMU is read.
    if robot.needs_imu and not sides:
        sides = design.hub_sides
    completed = robot._replace(
        motors=motors,
        sensors=sensors,
        drive_base=base,
        hub_sides=sides,
    )
    # What the plan has filled in agrees with it, but what the description itself said may not.
    _raise_first(disagreements(completed, design), path)
    return completed


def _with_wheels(
    base: DriveBase,
    name: str,
    motors: tuple[Motor, ...],
    design: PlanFacts,
    path: Path,
) -> DriveBase:
    """A drive base with the wheel diameter and axle track of the plan, where it says none."""
    # A drive base names its motors, while a plan knows them by their ports.
    wheel_motors = {part.port: part for part in design.motors if part.wheel_mm}
    driven: dict[str, DeviceFacts] = {}
    for motor in motors:
        if motor.port in wheel_motors:
            driven[motor.name] = wheel_motors[motor.port]
    for side in (base.left, base.right):
        if side not in driven:
            raise DescriptionError(
                f"robot '{name}': '{side}' turns no wheel in {path}; correct the drive base"
            )
    left = driven[base.left]
    right = driven[base.right]
    track_mm = round(abs(left.wheel_left_m - right.wheel_left_m) * 1000, 3)
    return replace(
        base,
        wheel_diameter_mm=base.wheel_diameter_mm or left.wheel_mm,
        axle_track_mm=base.axle_track_mm or track_mm,
    )


def _motors(
    robot: _Description,
    design: PlanFacts,
    path: Path,
) -> tuple[Motor, ...]:
    """Motors of the description, then those that only the plan has."""
    motors: list[Motor] = []
    for motor in robot.motors:
        port = motor.port or _port_of(
            motor.name,
            design.motors,
            robot.name,
            path,
        )
        motors.append(replace(motor, port=port))
    described = {motor.port for motor in motors}
    for part in design.motors:
        if part.port not in described:
            # A motor that only the plan has counts up when the robot rolls forward.
            direction = Direction.CLOCKWISE if part.is_forward else Direction.COUNTERCLOCKWISE
            name = part.label or f"motor_{part.port.lower()}"
            motors.append(
                Motor(
                    name,
                    part.port,
                    MotorKind(part.name),
                    direction,
                )
            )
    gears = {part.port: part.gears for part in design.motors}
    stops = {part.port: part.stops_deg for part in design.motors if part.stops_deg}
    completed_motors: list[Motor] = []
    for motor in motors:
        geared = replace(motor, gears=motor.gears or gears.get(motor.port, ()))
        # Stops need the gears first: a plan gives them as angles of the motor's shaft, a
        # description as angles of its output.
        completed_motors.append(_with_stops(geared, stops.get(motor.port)))
    return tuple(completed_motors)


def _with_stops(motor: Motor, stops_deg: tuple[float, ...] | None) -> Motor:
    """A motor with the end stops of the plan, if it has none of its own."""
    if motor.end_stops_deg is not None or stops_deg is None:
        return motor
    # The ends are sorted, because a motor that counts the other way round swaps them.
    low, high = sorted(angle / motor.shaft_turns for angle in stops_deg)
    return replace(motor, end_stops_deg=(low, high))


def _sensors(
    robot: _Description,
    design: PlanFacts,
    path: Path,
) -> tuple[Sensor, ...]:
    """Sensors of the description, then those that only the plan has."""
    sensors: list[Sensor] = []
    for sensor in robot.sensors:
        port = sensor.port or _port_of(
            sensor.name,
            design.sensors,
            robot.name,
            path,
        )
        sensors.append(replace(sensor, port=port))
    described = {sensor.port for sensor in sensors}
    others = [part for part in design.sensors if part.port not in described]
    for part in others:
        name = part.label or f"sensor_{part.port.lower()}"
        sensors.append(sensor_of(SensorKind(part.name), name, part.port))
    return tuple(sensors)


def _port_of(
    name: str,
    parts: Sequence[DeviceFacts],
    robot: str,
    path: Path,
) -> str:
    """Port of a named device in the plan."""
    for part in parts:
        if part.label == name:
            return part.port
    known = ", ".join(part.label for part in parts if part.label) or "none"
    raise DescriptionError(
        f"robot '{robot}': '{name}' has no port, and {path} no device of that name (it "
        f"has: {known}); say its port"
    )


def disagreements(robot: Robot | _Description, design: PlanFacts) -> Iterator[_Mistake]:
    """Contradictions between a description and a plan."""
    name = robot.name
    devices: tuple[Motor | Sensor, ...] = (*robot.motors, *robot.sensors)
    base = robot.drive_base
    sides = robot.hub_sides
    hub = robot.hub.value
    parts = {part.port: part for part in (*design.motors, *design.sensors)}
    for hub_part in design.hubs:
        if hub_part.name != hub:
            yield (
                hub_part.line,
                "wiring",
                f"{hub_part.part} is not {an(hub)} hub, as the robot {name} has; make both agree",
            )
    for device in devices:
        if device.port in parts:
            yield from _check_device(name, device, parts[device.port])
        else:
            text = (
                f"the robot {name} has '{device.name}' on port {device.port}, but the plan has "
                "nothing there; add it with 0 !BRICKSRL PORT"
            )
            yield 0, "wiring", text
    # The other way round, the plan may have a device that the description lacks.
    described = {device.port for device in devices}
    for port, part in parts.items():
        if port not in described:
            text = (
                f"port {port} has {_named(part)} in the plan, but the robot {name} has nothing "
                "there; make both agree"
            )
            yield part.line, "wiring", text
    if base is not None:
        ports = {device.name: device.port for device in devices}
        left = parts.get(ports.get(base.left, ""))
        right = parts.get(ports.get(base.right, ""))
        yield from _check_wheels(name, base, left, right)
    is_mounted_so = design.hub_sides == sides and len(sides) == 2
    if robot.needs_imu and design.hubs and not is_mounted_so:
        yield design.hubs[0].line, "wiring", _wrong_mount(name, sides, design.hub_sides)


def _wrong_mount(
    name: str,
    sides: tuple[str, ...],
    planned_sides: tuple[str, ...],
) -> str:
    """Message on how the hub lies in a plan: what is wrong, and what to do. ``sides`` are those of
    its top and its front in the description."""
    # Pybricks is told which axes of the hub point up and forwards, so the hub cannot lie in
    # between.
    if len(planned_sides) != 2:
        return "the hub is at an angle, so its IMU cannot be read; turn it, or say needs_imu=False"
    top, front = planned_sides
    return (
        f"the hub's top looks {top} and its front {front} in the plan, but the robot {name} says "
        f"{sides[0]} and {sides[1]}; turn it, or say hub_sides={planned_sides}"
    )


def _named(part: DeviceFacts) -> str:
    """A device of a plan in words: its part, and its name there, if it has one."""
    return part.part if part.label is None else f"{part.part} '{part.label}'"


def _check_device(
    name: str,
    device: Motor | Sensor,
    part: DeviceFacts,
) -> Iterator[_Mistake]:
    """Contradictions in name, kind and gears of a motor or sensor."""
    kind = device.kind.value
    label = f"port {device.port} has {_named(part)} in the plan"
    if part.name != kind:
        yield (
            part.line,
            "wiring",
            f"{label}, but the robot {name} has '{device.name}' there, {an(kind)}; make both agree",
        )
    elif part.label is not None and part.label != device.name:
        yield (
            part.line,
            "wiring",
            f"{label}, but the robot {name} calls it '{device.name}'; make both agree",
        )
    elif isinstance(device, Motor) and device.gears and part.ratio:
        if device.gears[0] == device.gears[-1]:
            return
        # The sign is left out, because teeth do not tell which way the output turns.
        ratio = device.gears[0] / device.gears[-1]
        if abs(ratio - abs(part.ratio)) > _RATIO_TOLERANCE * ratio:
            teeth = " to ".join(map(str, part.gears)) or "no gears"
            text = (
                f"the robot {name} says that motor '{device.name}' has gears {device.gears}, but "
                f"the plan has {teeth}; correct one"
            )
            yield part.line, "gears", text


def _check_wheels(
    name: str,
    base: DriveBase,
    left: DeviceFacts | None,
    right: DeviceFacts | None,
) -> Iterator[_Mistake]:
    """Contradictions in a drive base: wheel diameter and axle track."""
    positions_m = []
    for side, part in ((base.left, left), (base.right, right)):
        # A motor that the plan lacks is skipped, because `disagreements` already reports it.
        if part is None:
            return
        if not part.wheel_mm or abs(part.wheel_mm - base.wheel_diameter_mm) > _WHEEL_TOLERANCE_MM:
            turns = f"one of {part.wheel_mm:g} mm" if part.wheel_mm else "none"
            text = (
                f"motor '{side}' should turn a wheel of {base.wheel_diameter_mm:g} mm, as "
                f"{name} says, but turns {turns}"
            )
            yield part.line, "wheels", f"{text}; use the wheel that is meant"
            # The track between wheels that are not the intended ones means nothing.
            return
        positions_m.append(part.wheel_left_m)
    track_mm = abs(positions_m[0] - positions_m[1]) * 1000
    if left is not None and abs(track_mm - base.axle_track_mm) > _TRACK_TOLERANCE_MM:
        text = (
            f"the wheels are {track_mm:.1f} mm apart, but {name} says {base.axle_track_mm:g}; "
            "make both agree"
        )
        yield left.line, "wheels", text


def check_named(plan: Plan) -> list[Finding]:
    """Findings on contradictions between a plan and the built-in robot that it names; empty if it
    names none.

    A plan that is not a complete robot has none here; the check of plans reports it.
    """
    if plan.robot is None:
        return []
    # This is imported late, because the mechanism of a plan takes longer to import than kept facts
    # to read.
    from bricktwin.plans.planned_robot import planned

    try:
        robot = robots.get(plan.robot)
        design = facts_of(planned(plan))
    except UnknownNameError as error:
        return [Finding("wiring", Outcome.ERROR, str(error))]
    except PlanError:
        return []
    found = disagreements(robot, design)
    return [Finding(name, Outcome.ERROR, text, line) for line, name, text in found]


def without_stops(plan: Plan) -> list[str]:
    """Ports of the motors that turn no wheel and that nothing stops in a twin; empty for a plan
    that is no complete robot."""
    from bricktwin.plans.planned_robot import planned, stops_deg

    try:
        design = planned(plan)
    except PlanError:
        return []
    robot = robots.ROBOTS.get(plan.robot or "")
    described = robot.motors if robot is not None else ()
    ranged = {motor.port for motor in described if motor.range_deg or motor.end_stops_deg}
    rolling = {drive.port for drive, _ in design.rolling}
    ports = []
    for drive in design.articulation.drives:
        port = drive.port
        if port in ranged or port in rolling or design.device(port).stops_deg is not None:
            continue
        # This test comes last, because it turns the motor through all of its ways.
        if stops_deg(design, port) is None:
            ports.append(port)
    return sorted(ports)


def check_description(robot: Robot, path: Path) -> None:
    """Check that a plan agrees with a description, which may have more sensors. Raises
    DescriptionError if the plan contradicts the description, PlanError if the plan cannot be
    read."""
    design = read_facts(path)
    # A sensor that was added to the robot of a plan does not contradict the plan.
    ports = {part.port for part in design.sensors}
    sensors = tuple(sensor for sensor in robot.sensors if sensor.port in ports)
    compared = _Description(
        robot.name,
        robot.hub,
        robot.motors,
        sensors,
        robot.drive_base,
        robot.needs_imu,
        robot.hub_sides,
    )
    _raise_first(disagreements(compared, design), path)


def _raise_first(mistakes: Iterator[_Mistake], plan: Path) -> None:
    """Raise DescriptionError for the first mistake, if there is one."""
    for line, _, text in mistakes:
        place = f"{plan}, line {line}" if line else f"{plan}"
        raise DescriptionError(f"{place}: {text}")
