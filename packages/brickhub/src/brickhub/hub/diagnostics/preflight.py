"""Preflight check of a robot: hub, ports, battery, sensors and motors against the description."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

from brickhub.errors import HubError, percent
from brickhub.finding import Finding, Outcome
from brickhub.hub.diagnostics.latency import Latency, advice, measure
from brickhub.hub.diagnostics.survey import Survey, survey
from brickhub.hub.interface import Interface
from brickhub.hub.kinds import Command
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.transport import Transport
from brickhub.hub.transports.connection import HubIdentity
from brickhub.robot import HubKind, Motor, MotorKind, Robot, SensorKind
from brickhub.robot.hardware import DC_MOTOR_ID

TEST_MOVE = 30.0
"""Degrees or millimetres of a test move."""
_LEAST_SHARE = 0.5
"""Share of a test move that a motor has to complete."""
_RANGE_MARGIN_DEG = 8.0
"""Tolerance for a joint that yields beyond its range."""
_TEST_MOVE_READS = 40

# Below the first voltage the hub warns, below the second it soon switches off; limits of the firmware (battery.c).
_LITHIUM_MV = (6800, 6000)
_CELLS_MV = (5400, 4800)
_ENCODERS = {kind.model.device_id for kind in MotorKind}
"""Device ids of motors with an encoder: a program for one also drives the others."""
_NAMES = (
    {kind.model.device_id: f"motor {kind.value}" for kind in MotorKind}
    | {kind.model.device_id: re.sub("(?<!^)([A-Z])", r" \1", kind.value).lower() for kind in SensorKind}
    | {0: "nothing", DC_MOTOR_ID: "medium linear motor without angle", 2: "train motor"}
)


def check_robot(
    transport: Transport,
    robot: Robot,
    interface: Interface,
    *,
    may_move: Callable[[], bool],
    is_right: Callable[[str], bool] | None = None,
    calibrate: Callable[[Robot], Robot] | None = None,
) -> Iterator[Finding]:
    """Check everything that a task needs of a robot. Opens the transport, and closes it at the end. Raises HubError if the hub
    cannot be reached.

    Args:
        transport: transport to the hub.
        robot, interface: expected robot and interface.
        may_move: asked before the first test move.
        is_right: asked after each test move, e.g. "left turned by 30 degrees"; ``None`` if nobody watches.
        calibrate: as for :class:`HubLink`.
    """
    try:
        transport.open()
        calibrated = robot if calibrate is None else calibrate(robot)
        yield from check_hub(getattr(transport, "identity", None), robot)
        result = survey(transport, calibrated)
        port_findings = list(check_ports(robot, result))
        yield from port_findings
        yield check_battery(robot.hub, result.battery_mv)
        yield from check_imu(robot, result)
        if any(finding.outcome is Outcome.ERROR for finding in port_findings):
            yield Finding("program", Outcome.SKIPPED, "the environment's program does not start before all is plugged in")
            return
        yield from _check_with_program(transport, robot, interface, may_move, is_right, calibrate)
    finally:
        transport.close()


def _check_with_program(
    transport: Transport,
    robot: Robot,
    interface: Interface,
    may_move: Callable[[], bool],
    is_right: Callable[[str], bool] | None,
    calibrate: Callable[[Robot], Robot] | None,
) -> Iterator[Finding]:
    """Checks that run the environment's program: angles, latency, directions."""
    try:
        with HubLink(transport, robot, interface, calibrate=calibrate) as link:
            yield Finding("program", Outcome.OK, f"runs (hash {link.program.hash:08x})")
            yield from check_angles(robot, interface, link.read().values)
            yield check_latency(measure(link, interface))
            if may_move():
                for index in range(len(interface.commands)):
                    yield _check_move(link, robot, interface, index, is_right)
            else:
                yield Finding("directions", Outcome.SKIPPED, "nothing was moved, because nobody said yes")
    except HubError as error:
        yield Finding("program", Outcome.ERROR, str(error))


def check_hub(identity: HubIdentity | None, robot: Robot) -> Iterator[Finding]:
    """Kind and versions of a connected hub; empty for one without an identity, such as the virtual hub."""
    if identity is None:
        return
    kind, firmware, version = identity.kind, identity.firmware, ".".join(map(str, identity.profile_version))
    if kind is not robot.hub:
        detail = f"it is a {kind.value} hub, '{robot.name}' has a {robot.hub.value} hub; take that one, or describe your robot"
        yield Finding("hub", Outcome.ERROR, detail)
    else:
        yield Finding("hub", Outcome.OK, f"'{identity.name}', {kind.value}, {identity.address}")
    if firmware.partition(".")[0] in ("2", "3"):
        detail = f"Pybricks {firmware}, profile {version}; BricksRL was written for version 4, update it on code.pybricks.com"
        yield Finding("firmware", Outcome.WARNING, detail)
    else:
        yield Finding("firmware", Outcome.OK, f"Pybricks {firmware}, profile {version}")


def device_name(number: int) -> str:
    """Readable name of a device id."""
    return _NAMES.get(number, f"device {number}")


def check_ports(robot: Robot, result: Survey) -> Iterator[Finding]:
    """Port check: expected against connected device."""
    expected = {device.port: device for device in (*robot.motors, *robot.sensors)}
    for port in robot.hub.model.ports:
        found_id, device = result.ports.get(port, 0), expected.get(port)
        found_name, name = device_name(found_id), f"port {port}"
        if device is None:
            detail = "nothing is expected" + ("" if not found_id else f", {found_name} is there, which does no harm")
            yield Finding(name, Outcome.OK, detail)
            continue
        expected_id = device.kind.model.device_id
        label = f"'{device.name}', {device_name(expected_id)}"
        if found_id == expected_id:
            yield Finding(name, Outcome.OK, label)
        elif {expected_id, found_id} <= _ENCODERS:
            detail = f"{label} is expected, {found_name} is there; it works, but the virtual robot has the other one's strength"
            yield Finding(name, Outcome.WARNING, detail)
        else:
            detail = f"{label} is expected, {found_name} is there; {_plug_advice(robot, expected_id, port, result)}"
            yield Finding(name, Outcome.ERROR, detail)


def _plug_advice(robot: Robot, missing_id: int, port: str, result: Survey) -> str:
    """Advice on the missing device: the port where it might be, or to plug it in."""
    taken = {device.port for device in (*robot.motors, *robot.sensors) if device.kind.model.device_id == missing_id}
    others = [other for other, found_id in result.ports.items() if found_id == missing_id and other not in taken]
    return f"move it from port {others[0]} to {port}" if others else f"plug it into port {port} until it clicks"


def check_battery(hub: HubKind, battery_mv: int) -> Finding:
    """Battery check: enough voltage for the motors."""
    low_mv, critical_mv = _LITHIUM_MV if hub.model.is_rechargeable else _CELLS_MV
    remedy = "charge it" if hub.model.is_rechargeable else "put fresh batteries in"
    volts = f"{battery_mv / 1000:.2f} V"
    if battery_mv < critical_mv:
        return Finding("battery", Outcome.ERROR, f"{volts}, it is empty; {remedy}")
    if battery_mv < low_mv:
        return Finding("battery", Outcome.WARNING, f"{volts}, it is low and the motors are weak; {remedy}")
    return Finding("battery", Outcome.OK, volts)


def check_imu(robot: Robot, result: Survey) -> Iterator[Finding]:
    """IMU check, for robots that need it: gyroscope and accelerometer are ready."""
    if not robot.needs_imu:
        return
    tilt = f"pitch {result.pitch_deg}, roll {result.roll_deg} deg"
    if result.imu_ready is None:
        yield Finding(
            "imu", Outcome.ERROR, "the hub did not say anything about its IMU; update its firmware on code.pybricks.com"
        )
    elif not result.imu_ready:
        yield Finding("imu", Outcome.WARNING, f"{tilt}, not ready; leave the robot still for some seconds and check again")
    else:
        yield Finding("imu", Outcome.OK, f"ready, {tilt}" + ("" if result.imu_still else ", moving"))


def check_angles(robot: Robot, interface: Interface, values: Sequence[float]) -> Iterator[Finding]:
    """Angle check: joints are within their ranges in the reading ``values [n_channels]``."""
    for name, index in interface.angle_indices.items():
        range_deg = robot.motor(name).range_deg
        if range_deg is None:
            continue
        low, high = range_deg
        angle = f"{values[index]:.0f} deg, range {low} to {high}"
        if low - _RANGE_MARGIN_DEG <= values[index] <= high + _RANGE_MARGIN_DEG:
            yield Finding(f"angle {name}", Outcome.OK, angle)
        else:
            detail = f"{angle}; put the joint within its range, or find its zero with `brickhub calibrate`"
            yield Finding(f"angle {name}", Outcome.ERROR, detail)


def check_latency(latency: Latency) -> Finding:
    """Latency check: the connection interval is short."""
    share = "" if latency.link_share is None else f", {percent(latency.link_share)} of a step"
    detail = f"{latency.p50_ms:.0f} ms, p99 {latency.p99_ms:.0f} ms, connection interval {latency.interval_ms:g} ms{share}"
    if latency.is_slow:
        return Finding("round trip", Outcome.WARNING, f"{detail}; {advice()}")
    return Finding("round trip", Outcome.OK, detail)


def small_move(command: Command, range_deg: tuple[int, int] | None, angle_deg: float | None) -> float:
    """A small value of a command; for a joint with a known angle, towards the middle of its range."""
    sign = 1.0
    if range_deg is not None and angle_deg is not None and angle_deg > sum(range_deg) / 2:
        sign = -1.0
    values = [min(max(move, command.low), command.high) for move in (sign * TEST_MOVE, -sign * TEST_MOVE)]
    return values[0] if abs(values[0]) >= abs(values[1]) else values[1]


def _check_move(link: HubLink, robot: Robot, interface: Interface, index: int, is_right: Callable[[str], bool] | None) -> Finding:
    """Send a small value for one command and 0 for the others, and compare the motion of its motors."""
    command = interface.commands[index]
    before = link.read().values
    motors = [robot.motor(name) for name in command.motors(robot)]
    if not motors:
        link.act([command.high if i == index else 0.0 for i in range(len(interface.commands))])
        return Finding(command.name, Outcome.OK, f"{command.high:g} {command.unit}, look or listen")
    angles_before = [_angle(interface, before, motor) for motor in motors]
    value = small_move(command, motors[0].range_deg, angles_before[0])
    name = f"motor {command.name}" if len(motors) == 1 else command.name
    link.act([value if i == index else 0.0 for i in range(len(interface.commands))])
    after = before
    for _ in range(_TEST_MOVE_READS):  # a step may end before its move does
        after = link.read().values
    if not command.ends:
        link.act([0.0] * len(interface.commands))
    turns_deg = command.turns_deg(robot, value)
    for motor, angle_before, turn_deg in zip(motors, angles_before, turns_deg, strict=True):
        angle_after = _angle(interface, after, motor)
        if angle_before is None or angle_after is None:
            continue
        turned = (angle_after - angle_before + 180.0) % 360.0 - 180.0
        if command.ends:  # angles may be wrapped: add the whole turns that bring it nearest to the command
            turned += 360.0 * round((turn_deg - turned) / 360.0)
        if turned * turn_deg < _LEAST_SHARE * turn_deg**2:
            what = f"'{motor.name}' (port {motor.port}) turned by {turned:.0f} deg after {value:g} {command.unit}"
            return Finding(name, Outcome.ERROR, f"{what}; it is blocked, or its cable is loose")
    motion = f"moved by {value:g} {command.unit}"
    if is_right is not None and not is_right(f"{name} {motion}"):
        ports = " and ".join(motor.port for motor in motors)
        names = " ".join(motor.name for motor in motors)
        remedy = f"swap the cables (port {ports}), or `brickhub calibrate --reverse {names}`"
        return Finding(name, Outcome.ERROR, f"{motion}, and you say that it was another motor or the wrong way; {remedy}")
    return Finding(name, Outcome.OK, motion + ("" if is_right is not None else ", nobody watched"))


def _angle(interface: Interface, values: Sequence[float], motor: Motor) -> float | None:
    """Angle of a motor, if it is observed."""
    index = interface.angle_indices.get(motor.name)
    return None if index is None else values[index]
