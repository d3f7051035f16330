"""Completion of robot descriptions from building plans, and check that both agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bricksrl.errors import DescriptionError, PlanError, UnknownNameError
from bricksrl.finding import Finding, Outcome
from bricksrl.plans.mechanism.kinematics import TO_TWIN
from bricksrl.plans.part import DeviceKind
from bricksrl.plans.plan import Placed, Plan
from bricksrl.plans.planned_robot import PlannedRobot, planned, planned_robot
from bricksrl.robots.spec import (
    LOOKS,
    Direction,
    DriveBase,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Sensor,
    SensorKind,
    UltrasonicSensor,
)

if TYPE_CHECKING:
    from bricksrl.robots.spec import Robot

_WHEEL_MM, _TRACK_MM = 0.5, 2.0
_RATIO = 0.01
_ALONG = 0.999


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
    made = planned_robot(Path(robot.plan or ""))
    _refuse_strangers(robot, made)
    motors = _motors(robot, made)
    sensors = _sensors(robot, made)
    base = robot.drive_base
    if base is not None and not (base.wheel_diameter_mm and base.axle_track_mm):
        ports = {motor.name: motor.port for motor in motors}
        wheels = {wheel.port: wheel for wheel in made.rolling}
        sides = [wheels.get(ports.get(name, "")) for name in (base.left, base.right)]
        left, right = sides
        if left is None or right is None:
            missing = base.left if left is None else base.right
            raise DescriptionError(f"robot '{robot.name}': '{missing}' turns no wheel in {robot.plan}; correct the drive base")
        base = replace(
            base,
            wheel_diameter_mm=base.wheel_diameter_mm or left.diameter_mm,
            axle_track_mm=base.axle_track_mm or round(abs(float(left.centre_m[1] - right.centre_m[1])) * 1000, 3),
        )
    found = disagreements(robot.name, robot.hub.value, (*motors, *sensors), base, made)
    mounted = robot.hub_sides
    if robot.needs_imu:
        mounted = mounted or hub_sides(made)
        found += _turned_hub(robot.name, mounted, made)
    if found:
        where = f", line {found[0].line}" if found[0].line else ""
        raise DescriptionError(f"{robot.plan}{where}: {found[0].detail}")
    return motors, sensors, base, mounted


def hub_sides(made: PlannedRobot) -> tuple[str, ...]:
    """Where the top and the front of the plan's hub look; empty if it has none, or one at an angle."""
    for hub in made.plan.devices(DeviceKind.HUB):
        axes = (TO_TWIN @ hub.rotation @ np.array(side) for side in ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)))
        return tuple(name for axis in axes for name, way in LOOKS.items() if float(axis @ np.array(way)) > _ALONG)
    return ()


def _turned_hub(name: str, sides: tuple[str, ...], made: PlannedRobot) -> list[Finding]:
    """Findings on the orientation of a hub whose IMU is read."""
    hub = next(iter(made.plan.devices(DeviceKind.HUB)), None)
    there = hub_sides(made)
    if hub is None or there == sides:
        return []
    if len(there) < 2:
        text = "the hub is at an angle, so its IMU cannot be read; turn it, or say needs_imu=False"
    else:
        text = f"the hub's top looks {there[0]} and its front {there[1]}, but for the robot {name} {sides[0]} and {sides[1]}"
        text += f"; turn it, or say hub_sides={there}"
    return [Finding("wiring", Outcome.ERROR, text, hub.line)]


def _refuse_strangers(robot: Robot, made: PlannedRobot) -> None:
    """Refuse motors and sensors that no hub of ours runs, as those of EV3."""
    kinds = {kind.value for kind in (*MotorKind, *SensorKind)} | {UltrasonicSensor.class_name}
    for one in made.plan.devices(DeviceKind.MOTOR) + made.plan.devices(DeviceKind.SENSOR):
        if one.part.device is not None and one.part.device.name not in kinds:
            where = f"{robot.plan}, line {one.line}"
            raise DescriptionError(f"{where}: no hub of ours runs {one.name}; take a motor or sensor of Powered Up or SPIKE")


def _motors(robot: Robot, made: PlannedRobot) -> tuple[Motor, ...]:
    """Motors of the description, then those that only the plan has."""
    placed = made.plan.devices(DeviceKind.MOTOR)
    motors = [replace(motor, port=motor.port or _port_of(motor.name, placed, robot)) for motor in robot.motors]
    forward = {wheel.port: wheel.is_clockwise_forward for wheel in made.rolling}
    for one in placed:
        if one.port is not None and one.port not in {motor.port for motor in motors} and one.part.device is not None:
            # Motors that only the plan has count up when the robot rolls forward.
            direction = Direction.CLOCKWISE if forward.get(one.port, True) else Direction.COUNTERCLOCKWISE
            name = one.device or f"motor_{one.port.lower()}"
            motors.append(Motor(name, one.port, MotorKind(one.part.device.name), direction))
    geared = {train.port: train.gears for train in made.trains}
    return tuple(replace(motor, gears=motor.gears or geared.get(motor.port, ())) for motor in motors)


def _sensors(robot: Robot, made: PlannedRobot) -> tuple[Sensor, ...]:
    placed = made.plan.devices(DeviceKind.SENSOR)
    sensors: list[Sensor] = [replace(one, port=one.port or _port_of(one.name, placed, robot)) for one in robot.sensors]
    for one in placed:
        if one.port is not None and one.port not in {sensor.port for sensor in sensors} and one.part.device is not None:
            name, kind = one.device or f"sensor_{one.port.lower()}", one.part.device.name
            is_sonar = kind == UltrasonicSensor.class_name
            sensors.append(UltrasonicSensor(name, one.port) if is_sonar else PoweredUpSensor(name, one.port, SensorKind(kind)))
    return tuple(sensors)


def _port_of(name: str, placed: Sequence[Placed], robot: Robot) -> str:
    """Port of a named device in the plan."""
    for one in placed:
        if one.device == name and one.port is not None:
            return one.port
    known = ", ".join(one.device for one in placed if one.device) or "none"
    raise DescriptionError(
        f"robot '{robot.name}': '{name}' has no port, and {robot.plan} no device of that name (it has: {known}); say its port"
    )


def disagreements(
    name: str, hub: str, devices: Sequence[Motor | Sensor], base: DriveBase | None, made: PlannedRobot
) -> list[Finding]:
    """Findings on contradictions between a description and a plan."""
    placed = {one.port: one for kind in (DeviceKind.MOTOR, DeviceKind.SENSOR) for one in made.plan.devices(kind)}
    findings = []
    for one in made.plan.devices(DeviceKind.HUB):
        if one.part.device is not None and one.part.device.name != hub:
            text = f"{one.name} is not a {hub} hub, which the robot {name} has; make both agree"
            findings.append(Finding("wiring", Outcome.ERROR, text, one.line))
    for device in devices:
        there = placed.get(device.port)
        if there is None:
            text = f"the robot {name} has '{device.name}' on port {device.port}, the plan nothing; add it with 0 !BRICKSRL PORT"
            findings.append(Finding("wiring", Outcome.ERROR, text))
        else:
            findings += _compared(name, device, there, made)
    for port, there in placed.items():
        if port not in {device.port for device in devices}:
            text = f"port {port} has {there.name} '{there.device or ''}', but for the robot {name} nothing; make both agree"
            findings.append(Finding("wiring", Outcome.ERROR, text, there.line))
    if base is not None:
        ports = {device.name: device.port for device in devices}
        findings += _rolled(name, base, ports, placed, made)
    return findings


def _compared(name: str, device: Motor | Sensor, there: Placed, made: PlannedRobot) -> list[Finding]:
    """Findings on name, kind and gears of a motor or sensor."""
    kind = device.kind.value if isinstance(device, Motor) else device.class_name
    on = f"port {device.port} has {there.name} '{there.device or ''}'"
    if there.part.device is None or there.part.device.name != kind:
        text = f"{on}, but for the robot {name} '{device.name}', a {kind}; make both agree"
        return [Finding("wiring", Outcome.ERROR, text, there.line)]
    if there.device is not None and there.device != device.name:
        text = f"{on}, but for the robot {name} '{device.name}'; make both agree"
        return [Finding("wiring", Outcome.ERROR, text, there.line)]
    train = next((train for train in made.trains if train.port == device.port), None)
    if isinstance(device, Motor) and device.gears and train is not None and device.gears[0] != device.gears[-1]:
        ratio = device.gears[0] / device.gears[-1]
        if abs(ratio - abs(train.ratio)) > _RATIO * ratio:
            teeth = " to ".join(map(str, train.gears)) or "no gears"
            text = f"motor '{device.name}' has gears {device.gears} for the robot {name}, but {teeth} in the plan; correct one"
            return [Finding("gears", Outcome.ERROR, text, there.line)]
    return []


def _rolled(
    name: str, base: DriveBase, ports: dict[str, str], placed: dict[str | None, Placed], made: PlannedRobot
) -> list[Finding]:
    """Findings on a drive base: wheel diameter and axle track."""
    wheels = {wheel.port: wheel for wheel in made.rolling}
    sides = []
    for side in (base.left, base.right):
        wheel, there = wheels.get(ports.get(side, "")), placed.get(ports.get(side))
        if there is None:
            return []
        if wheel is None or abs(wheel.diameter_mm - base.wheel_diameter_mm) > _WHEEL_MM:
            turns = "none" if wheel is None else f"one of {wheel.diameter_mm:g} mm"
            text = f"motor '{side}' should turn a wheel of {base.wheel_diameter_mm:g} mm, as {name} says, but turns {turns}"
            return [Finding("wheels", Outcome.ERROR, f"{text}; use the wheel that is meant", there.line)]
        sides.append(wheel)
    track_mm = abs(float(sides[0].centre_m[1] - sides[1].centre_m[1])) * 1000
    if abs(track_mm - base.axle_track_mm) > _TRACK_MM:
        text = f"the wheels are {track_mm:.1f} mm apart, but {name} says {base.axle_track_mm:g}; make both agree"
        return [Finding("wheels", Outcome.ERROR, text, placed[ports[base.left]].line)]
    return []


def check_named(plan: Plan) -> list[Finding]:
    """Findings on contradictions between a plan and the built-in robot that it names; empty if it names none.

    A plan that is not a complete robot has none here; the check of plans reports it.
    """
    from bricksrl import robots

    if plan.robot is None:
        return []
    try:
        robot, made = robots.get(plan.robot), planned(plan)
    except UnknownNameError as error:
        return [Finding("wiring", Outcome.ERROR, str(error))]
    except PlanError:
        return []
    found = disagreements(robot.name, robot.hub.value, (*robot.motors, *robot.sensors), robot.drive_base, made)
    return found + (_turned_hub(robot.name, robot.hub_sides, made) if robot.needs_imu else [])


def check_description(robot: Robot, path: Path) -> None:
    """Check that a plan agrees with a description, which may have more sensors. Raises DescriptionError if the plan contradicts
    the description, PlanError if the plan cannot be read."""
    made = planned_robot(path)
    placed = {one.port for one in made.plan.devices(DeviceKind.SENSOR)}
    sensors = [sensor for sensor in robot.sensors if sensor.port in placed]
    found = disagreements(robot.name, robot.hub.value, (*robot.motors, *sensors), robot.drive_base, made)
    found += _turned_hub(robot.name, robot.hub_sides, made) if robot.needs_imu else []
    if found:
        where = f", line {found[0].line}" if found[0].line else ""
        raise DescriptionError(f"{path}{where}: {found[0].detail}")
