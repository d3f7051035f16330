"""Completion of robot descriptions from building plans, and check that both agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from brickhub.errors import DescriptionError, PlanError, UnknownNameError
from brickhub.finding import Finding, Outcome
from brickhub.robot import Direction, DriveBase, Motor, MotorKind, Sensor, SensorKind
from brickhub.robot.spec import LOOKS, sensor_of
from bricktwin import robots
from bricktwin.plans.facts import DeviceFacts, PlanFacts, facts_of, read_facts

if TYPE_CHECKING:
    from brickhub.robot.spec import Robot
    from bricktwin.plans.plan import Plan

_WHEEL_TOLERANCE_MM, _TRACK_TOLERANCE_MM = 0.5, 2.0
_RATIO_TOLERANCE = 0.01
_ALIGNED_COSINE = 0.999


def plan_file(model: str) -> Path | None:
    """Path of the building plan that a robot's model is, ``FILE`` or ``package:FILE``; ``None`` for other models. Raises
    DescriptionError if there is no such package."""
    package, _, file = model.rpartition(":")
    if not file.lower().endswith((".ldr", ".mpd", ".io")):
        return None
    if len(package) < 2:  # one letter is the drive of a path of Windows
        return Path(model)
    try:
        return Path(str(resources.files(package))) / file
    except (ImportError, TypeError, ValueError) as error:
        raise DescriptionError(f"there is no package '{package}' with the plan {file} ({error}); name the file") from None


def completed(robot: Robot) -> tuple[tuple[Motor, ...], tuple[Sensor, ...], DriveBase | None, tuple[str, ...]]:
    """Motors, sensors, drive base and hub sides of a description, completed from its plan. Raises DescriptionError if the plan
    contradicts the description, PlanError if the plan cannot be read."""
    design = read_facts(Path(robot.plan or ""))
    _require_known_devices(robot, design)
    motors = _motors(robot, design)
    sensors = _sensors(robot, design)
    base = robot.drive_base
    if base is not None and not (base.wheel_diameter_mm and base.axle_track_mm):
        ports = {motor.name: motor.port for motor in motors}
        wheels = {wheel.port: wheel for wheel in design.wheels}
        left, right = (wheels.get(ports.get(name, "")) for name in (base.left, base.right))
        if left is None or right is None:
            missing = base.left if left is None else base.right
            raise DescriptionError(f"robot '{robot.name}': '{missing}' turns no wheel in {robot.plan}; correct the drive base")
        base = replace(
            base,
            wheel_diameter_mm=base.wheel_diameter_mm or left.diameter_mm,
            axle_track_mm=base.axle_track_mm or round(abs(left.left_m - right.left_m) * 1000, 3),
        )
    sides = (robot.hub_sides or hub_sides(design)) if robot.needs_imu else robot.hub_sides
    _raise_first(disagreements(robot, (*motors, *sensors), base, sides, design), robot.plan)
    return motors, sensors, base, sides


def hub_sides(design: PlanFacts) -> tuple[str, ...]:
    """Directions of the top and the front of the plan's hub; empty if it has none, or one at an angle."""
    for hub in design.devices("hub"):
        axes = (hub.top, hub.front)
        return tuple(name for axis in axes for name, look in LOOKS.items() if _dot(axis, look) > _ALIGNED_COSINE)
    return ()


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _check_hub_sides(name: str, sides: tuple[str, ...], design: PlanFacts) -> Iterator[Finding]:
    """Findings on the orientation of a hub whose IMU is read."""
    hub = next(iter(design.devices("hub")), None)
    plan_sides = hub_sides(design)
    if hub is None or (plan_sides == sides and len(sides) == 2):
        return
    if len(plan_sides) < 2:
        text = "the hub is at an angle, so its IMU cannot be read; turn it, or say needs_imu=False"
    else:
        top, front = plan_sides
        text = f"the hub's top looks {top} and its front {front}, but for the robot {name} {sides[0]} and {sides[1]}"
        text += f"; turn it, or say hub_sides={plan_sides}"
    yield Finding("wiring", Outcome.ERROR, text, hub.line)


def _require_known_devices(robot: Robot, design: PlanFacts) -> None:
    """Refuse motors and sensors that no hub of ours runs, as those of EV3."""
    kinds = {kind.value for kind in (*MotorKind, *SensorKind)}
    for part in design.devices("motor", "sensor"):
        if part.name not in kinds:
            where = f"{robot.plan}, line {part.line}"
            raise DescriptionError(f"{where}: no hub of ours runs {part.part}; take a motor or sensor of Powered Up or SPIKE")


def _motors(robot: Robot, design: PlanFacts) -> tuple[Motor, ...]:
    """Motors of the description, then those that only the plan has."""
    parts = design.devices("motor")
    motors = [replace(motor, port=motor.port or _port_of(motor.name, parts, robot)) for motor in robot.motors]
    forward = {wheel.port: wheel.is_clockwise_forward for wheel in design.wheels}
    for part in parts:
        if part.port is not None and part.port not in {motor.port for motor in motors}:
            # Motors that only the plan has count up when the robot rolls forward.
            direction = Direction.CLOCKWISE if forward.get(part.port, True) else Direction.COUNTERCLOCKWISE
            name = part.label or f"motor_{part.port.lower()}"
            motors.append(Motor(name, part.port, MotorKind(part.name), direction))
    gears = {train.port: train.gears for train in design.trains}
    return tuple(replace(motor, gears=motor.gears or gears.get(motor.port, ())) for motor in motors)


def _sensors(robot: Robot, design: PlanFacts) -> tuple[Sensor, ...]:
    parts = design.devices("sensor")
    sensors: list[Sensor] = [replace(sensor, port=sensor.port or _port_of(sensor.name, parts, robot)) for sensor in robot.sensors]
    for part in parts:
        port = part.port
        if port is not None and port not in {sensor.port for sensor in sensors}:
            sensors.append(sensor_of(SensorKind(part.name), part.label or f"sensor_{port.lower()}", port))
    return tuple(sensors)


def _port_of(name: str, parts: Sequence[DeviceFacts], robot: Robot) -> str:
    """Port of a named device in the plan."""
    for part in parts:
        if part.label == name and part.port is not None:
            return part.port
    known = ", ".join(part.label for part in parts if part.label) or "none"
    raise DescriptionError(
        f"robot '{robot.name}': '{name}' has no port, and {robot.plan} no device of that name (it has: {known}); say its port"
    )


def disagreements(
    robot: Robot, devices: Sequence[Motor | Sensor], base: DriveBase | None, sides: tuple[str, ...], design: PlanFacts
) -> Iterator[Finding]:
    """Findings on contradictions between a description, with these devices, drive base and hub sides, and a plan."""
    name, hub = robot.name, robot.hub.value
    parts = {part.port: part for part in design.devices("motor", "sensor")}
    for hub_part in design.devices("hub"):
        if hub_part.name != hub:
            text = f"{hub_part.part} is not a {hub} hub, which the robot {name} has; make both agree"
            yield Finding("wiring", Outcome.ERROR, text, hub_part.line)
    for device in devices:
        part = parts.get(device.port)
        if part is None:
            text = f"the robot {name} has '{device.name}' on port {device.port}, the plan nothing; add it with 0 !BRICKSRL PORT"
            yield Finding("wiring", Outcome.ERROR, text)
        else:
            yield from _check_device(name, device, part, design)
    for port, part in parts.items():
        if port not in {device.port for device in devices}:
            text = f"port {port} has {part.part} '{part.label or ''}', but for the robot {name} nothing; make both agree"
            yield Finding("wiring", Outcome.ERROR, text, part.line)
    if base is not None:
        ports = {device.name: device.port for device in devices}
        yield from _check_wheels(name, base, ports, parts, design)
    if robot.needs_imu:
        yield from _check_hub_sides(name, sides, design)


def _check_device(name: str, device: Motor | Sensor, part: DeviceFacts, design: PlanFacts) -> list[Finding]:
    """Findings on name, kind and gears of a motor or sensor."""
    kind = device.kind.value
    label = f"port {device.port} has {part.part} '{part.label or ''}'"
    if part.name != kind:
        text = f"{label}, but for the robot {name} '{device.name}', a {kind}; make both agree"
        return [Finding("wiring", Outcome.ERROR, text, part.line)]
    if part.label is not None and part.label != device.name:
        text = f"{label}, but for the robot {name} '{device.name}'; make both agree"
        return [Finding("wiring", Outcome.ERROR, text, part.line)]
    train = next((train for train in design.trains if train.port == device.port), None)
    if isinstance(device, Motor) and device.gears and train is not None and device.gears[0] != device.gears[-1]:
        ratio = device.gears[0] / device.gears[-1]
        if abs(ratio - abs(train.ratio)) > _RATIO_TOLERANCE * ratio:
            teeth = " to ".join(map(str, train.gears)) or "no gears"
            text = f"motor '{device.name}' has gears {device.gears} for the robot {name}, but {teeth} in the plan; correct one"
            return [Finding("gears", Outcome.ERROR, text, part.line)]
    return []


def _check_wheels(
    name: str, base: DriveBase, ports: dict[str, str], parts: dict[str | None, DeviceFacts], design: PlanFacts
) -> list[Finding]:
    """Findings on a drive base: wheel diameter and axle track."""
    wheels = {wheel.port: wheel for wheel in design.wheels}
    sides = []
    for side in (base.left, base.right):
        wheel, part = wheels.get(ports.get(side, "")), parts.get(ports.get(side))
        if part is None:
            return []
        if wheel is None or abs(wheel.diameter_mm - base.wheel_diameter_mm) > _WHEEL_TOLERANCE_MM:
            turns = "none" if wheel is None else f"one of {wheel.diameter_mm:g} mm"
            text = f"motor '{side}' should turn a wheel of {base.wheel_diameter_mm:g} mm, as {name} says, but turns {turns}"
            return [Finding("wheels", Outcome.ERROR, f"{text}; use the wheel that is meant", part.line)]
        sides.append(wheel)
    track_mm = abs(sides[0].left_m - sides[1].left_m) * 1000
    if abs(track_mm - base.axle_track_mm) > _TRACK_TOLERANCE_MM:
        text = f"the wheels are {track_mm:.1f} mm apart, but {name} says {base.axle_track_mm:g}; make both agree"
        return [Finding("wheels", Outcome.ERROR, text, parts[ports[base.left]].line)]
    return []


def check_named(plan: Plan) -> list[Finding]:
    """Findings on contradictions between a plan and the built-in robot that it names; empty if it names none.

    A plan that is not a complete robot has none here; the check of plans reports it.
    """
    if plan.robot is None:
        return []
    from bricktwin.plans.planned_robot import planned

    try:
        robot, design = robots.get(plan.robot), facts_of(planned(plan))
    except UnknownNameError as error:
        return [Finding("wiring", Outcome.ERROR, str(error))]
    except PlanError:
        return []
    return list(disagreements(robot, (*robot.motors, *robot.sensors), robot.drive_base, robot.hub_sides, design))


def check_description(robot: Robot, path: Path) -> None:
    """Check that a plan agrees with a description, which may have more sensors. Raises DescriptionError if the plan contradicts
    the description, PlanError if the plan cannot be read."""
    design = read_facts(path)
    ports = {part.port for part in design.devices("sensor")}
    sensors = [sensor for sensor in robot.sensors if sensor.port in ports]
    _raise_first(disagreements(robot, (*robot.motors, *sensors), robot.drive_base, robot.hub_sides, design), path)


def _raise_first(findings: Iterator[Finding], plan: Path | str | None) -> None:
    """Raise DescriptionError for the first finding, if there is one."""
    for finding in findings:
        where = f", line {finding.line}" if finding.line else ""
        raise DescriptionError(f"{plan}{where}: {finding.detail}")
