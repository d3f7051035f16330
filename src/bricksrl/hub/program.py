"""Robot and interface in, MicroPython program out.

A program is: a header that says what it is for, the constants of the wire, the robot's devices, ``start_moves`` and
``read_channels``, and then the loop from ``onboard/loop.py``, which is the same for every robot.
"""

from __future__ import annotations

import hashlib
from importlib import resources

from bricksrl.hub.interface import (
    PARTS,
    Channel,
    Command,
    Distance,
    DriveStraight,
    Interface,
    MotorAngle,
    Pitch,
    Roll,
    RunAngle,
    SensorReading,
    UntilDone,
    YawRate,
)
from bricksrl.hub.protocol import (
    APP_DATA_BYTES,
    CONTROL_OVERHEAD,
    CRC_POLYNOMIAL,
    DOWN_PAYLOAD_BYTES,
    MAGIC,
    NOTIFICATION_BYTES,
    PROTOCOL_VERSION,
    ByeReason,
    Down,
    Up,
    WireFormat,
)
from bricksrl.hub.transport import HubProgram, Pipe
from bricksrl.hub.validation import validate
from bricksrl.robots import Direction, Motor, PoweredUpSensor, Robot, Sensor

WATCHDOG_MS = 400
"""Silence after which the hub stops its motors, until a WATCHDOG frame says otherwise."""
END_MS = 10_000
"""Further silence after which the program ends, so that the hub advertises again."""

_HUB_PART = "# --- the hub's part ---\n"


_ONBOARD = {Pipe.STDIN: "stdio", Pipe.APP_DATA: "app_data"}


def generate(robot: Robot, interface: Interface, pipe: Pipe = Pipe.STDIN) -> HubProgram:
    """The program that lets ``robot`` take the commands and report the channels of ``interface``.

    The hash is that of the text before the hash itself is written into it.

    Raises:
        DescriptionError: robot and interface do not fit each other.
        ProgramError: the robot's hub cannot run such a program.
    """
    validate(robot, interface)
    loop_imports, loop = _onboard("loop")
    way_imports, way = _onboard(_ONBOARD[pipe])
    parts = [
        _constants(interface, pipe),
        way,  # first of all, since the host may write as soon as the program runs
        _devices(robot, interface),
        _start_moves(interface, _joints(robot, interface)),
        _read_channels(interface),
        loop,
    ]
    if _joints(robot, interface):
        parts.insert(1, _onboard("joint")[1])
    imports = _robot_imports(robot, interface) + way_imports + loop_imports
    text = "\n\n".join([_header(robot, interface) + "\n" + _sorted_imports(imports), *parts])
    program_hash = hashlib.sha256(text.encode()).digest()[:4]
    source = text.replace(_hash_line(bytes(4)), _hash_line(program_hash), 1)
    return HubProgram(source, int.from_bytes(program_hash, "little"), pipe)


def _onboard(name: str) -> tuple[list[str], str]:
    """Import lines and body of the hub's part of a file in ``onboard``."""
    text = resources.files("bricksrl.hub.onboard").joinpath(f"{name}.py").read_text(encoding="utf-8")
    lines = text.split(_HUB_PART, 1)[1].splitlines()
    imports = [line for line in lines if line.startswith(("import ", "from "))]
    return imports, "\n".join(line for line in lines if line not in imports).strip() + "\n"


def _sorted_imports(lines: list[str]) -> str:
    return "\n".join(sorted(lines, key=lambda line: (line.split()[1], line))) + "\n"


def _hash_line(program_hash: bytes) -> str:
    return f"PROGRAM_HASH = {program_hash!r}"


def _header(robot: Robot, interface: Interface) -> str:
    lines = [
        f'Program of the robot "{robot.name}" for the {robot.hub.value} hub, written by BricksRL from the robot\'s description.',
        "Do not edit: it is written anew whenever the description changes.",
        "Commands, in the order of the action:",
        *(f"  {_command_text(command)}" for command in interface.commands),
        "Channels, in the order of the observation:",
        *(f"  {channel.name}, {channel.low:g} to {channel.high:g} {channel.unit}" for channel in interface.channels),
        _settle_text(interface),
    ]
    return "".join(f"# {line}\n" for line in lines)


def _command_text(command: Command) -> str:
    if isinstance(command, RunAngle):
        return f"{command.name}: turn by {command.low:g} to {command.high:g} deg at {command.speed_deg_s} deg/s"
    return f"{command.name}: drive {command.low:g} to {command.high:g} mm"


def _settle_text(interface: Interface) -> str:
    settle = interface.settle
    if isinstance(settle, UntilDone):
        return f"It answers when all moves have ended, or after {settle.timeout_ms} ms, when it stops those that have not."
    return f"It answers {settle.time_ms} ms after the commands started."


def _robot_imports(robot: Robot, interface: Interface) -> list[str]:
    parameters = {"Port"}
    devices = set()
    if _motors(robot, interface):
        devices.add("Motor")
    if any(motor.direction is Direction.COUNTERCLOCKWISE for motor in _motors(robot, interface)):
        parameters.add("Direction")
    if any(isinstance(channel, YawRate) for channel in interface.channels):
        parameters.add("Axis")
    devices |= {_class_of(sensor) for sensor in _sensors(robot, interface)}
    lines = [f"from pybricks.hubs import {robot.hub.model.class_name}"]
    if devices:
        lines.append(f"from pybricks.parameters import {', '.join(sorted(parameters))}")
        lines.append(f"from pybricks.pupdevices import {', '.join(sorted(devices))}")
    elif "Axis" in parameters:
        lines.append("from pybricks.parameters import Axis")
    if any(isinstance(command, DriveStraight) for command in interface.commands):
        lines.append("from pybricks.robotics import DriveBase")
    return lines


def _constants(interface: Interface, pipe: Pipe) -> str:
    wire = WireFormat.of(interface)
    until_done = isinstance(interface.settle, UntilDone)
    settle_ms = interface.settle.timeout_ms if isinstance(interface.settle, UntilDone) else interface.settle.time_ms
    sizes = ", ".join(f"{kind.name}: {CONTROL_OVERHEAD + DOWN_PAYLOAD_BYTES[kind]}" for kind in Down)
    lines = [
        "# The wire, from the same definitions as on the host's side. Kinds of frames are ASCII letters.",
        f"MAGIC = 0x{MAGIC:02X}",
        f"CRC_POLYNOMIAL = 0x{CRC_POLYNOMIAL:X}",
        *(f"{kind.name} = {kind.value}  # '{chr(kind.value)}'" for kind in Down),
        *(f"{reason.name} = {reason.value}" for reason in ByeReason),
        f'ACTION_FORMAT = "{wire.action_format}"',
        f'ANSWER_FORMAT = "{wire.answer_format}"',
        f"COMMAND_BYTES = {wire.down_frame_bytes}  # length of a frame with actions",
        f"CONTROL_BYTES = {{{sizes}}}",
        f"PIECE_BYTES = {NOTIFICATION_BYTES}  # what fits one notification",
        f"HELLO_HEAD = bytes([MAGIC, 0, {Up.HELLO.value}, {PROTOCOL_VERSION}])",
        f"BYE_HEAD = bytes([MAGIC, 0, {Up.BYE.value}])",
        *([f"SLOT_BYTES = {APP_DATA_BYTES}  # of AppData"] if pipe is Pipe.APP_DATA else []),
        _hash_line(bytes(4)),
        "",
        f"UNTIL_DONE = {until_done}  # answer when all moves have ended",
        f"SETTLE_MS = {settle_ms}  # answer after this time {'at the latest' if until_done else 'in any case'}",
        f"WATCHDOG_MS = {WATCHDOG_MS}  # silence that stops the motors",
        f"END_MS = {END_MS}  # further silence that ends the program",
    ]
    return "\n".join(lines) + "\n"


def _motors(robot: Robot, interface: Interface) -> list[Motor]:
    """The motors that the interface commands or reads, in the robot's order."""
    names: set[str] = set()
    for device in (*interface.commands, *interface.channels):
        if isinstance(device, (RunAngle, MotorAngle)):
            names.add(device.motor)
        elif isinstance(device, DriveStraight) and robot.drive_base is not None:
            names |= {robot.drive_base.left, robot.drive_base.right}
    return [motor for motor in robot.motors if motor.name in names]


def _sensors(robot: Robot, interface: Interface) -> list[Sensor]:
    """The sensors that the interface reads, each once, in the order of its channels."""
    names = [channel.sensor for channel in interface.channels if isinstance(channel, (Distance, SensorReading))]
    return [robot.sensor(name) for name in dict.fromkeys(names)]


def _class_of(sensor: Sensor) -> str:
    return sensor.kind.value if isinstance(sensor, PoweredUpSensor) else "UltrasonicSensor"


def _joints(robot: Robot, interface: Interface) -> set[str]:
    """Names of the commanded motors whose targets have a range."""
    commanded = [robot.motor(command.motor) for command in interface.commands if isinstance(command, RunAngle)]
    return {motor.name for motor in commanded if motor.range_deg is not None}


def _devices(robot: Robot, interface: Interface) -> str:
    joints = _joints(robot, interface)
    lines = [f"hub = {robot.hub.model.class_name}()"]
    for motor in _motors(robot, interface):
        lines += _motor_lines(motor, motor.name in joints)
    movers = [f"motor_{command.motor}" for command in interface.commands if isinstance(command, RunAngle)]
    base = robot.drive_base
    if base is not None and any(isinstance(command, DriveStraight) for command in interface.commands):
        lines.append(
            f"drive_base = DriveBase(motor_{base.left}, motor_{base.right}, "
            f"wheel_diameter={base.wheel_diameter_mm!r}, axle_track={base.axle_track_mm!r})"
        )
        movers.append("drive_base")
    for sensor in _sensors(robot, interface):
        lines.append(f"sensor_{sensor.name} = {_class_of(sensor)}(Port.{sensor.port})")
    lines += ["", f"MOVERS = [{', '.join(movers)}]"]
    return "\n".join(lines) + "\n"


def _motor_lines(motor: Motor, is_joint: bool) -> list[str]:
    variable = f"motor_{motor.name}"
    arguments = [f"Port.{motor.port}"]
    if motor.direction is Direction.COUNTERCLOCKWISE:
        arguments.append("Direction.COUNTERCLOCKWISE")
    if motor.gears:
        arguments.append(f"gears={list(motor.gears)}")
    lines = [f"{variable} = Motor({', '.join(arguments)})"]
    if motor.zero_deg:
        lines.append(f"{variable}.reset_angle({_from_zero(motor, f'{variable}.angle()')})")
    limits = {
        "speed": motor.speed_limit_deg_s,
        "acceleration": motor.acceleration_deg_s2,
        "torque": motor.torque_limit_mnm,
    }
    given = ", ".join(f"{name}={value}" for name, value in limits.items() if value is not None)
    if given:
        lines.append(f"{variable}.control.limits({given})")
    if is_joint and motor.range_deg is not None:
        lines.append(f"{variable} = Joint({variable}, {motor.range_deg[0]}, {motor.range_deg[1]})")
    return lines


def _from_zero(motor: Motor, shown: str) -> str:
    """Expression for the angle from the calibrated zero: of those that differ by whole turns, the one near the range."""
    if not motor.turn_deg.is_integer():
        return f"{shown} - {motor.zero_deg}"
    turn, middle = int(motor.turn_deg), sum(motor.range_deg or (0, 0)) // 2
    lowest = middle - turn // 2
    return f"({shown} - {motor.zero_deg + lowest}) % {turn} + {lowest}"


def _start_moves(interface: Interface, joints: set[str]) -> str:
    lines = [
        "def start_moves(actions):",
        '    """Start the commands, clamped to their ranges, without waiting for their ends."""',
    ]
    for index, command in enumerate(interface.commands):
        low, high = round(command.low * command.scale), round(command.high * command.scale)
        amount = f"whole(actions[{index}], {low}, {high}, {command.scale})"
        if isinstance(command, DriveStraight):
            lines.append(f"    drive_base.straight({amount}, wait=False)")
        elif command.motor in joints:
            lines.append(f"    motor_{command.motor}.turn({command.speed_deg_s}, {amount})")
        else:
            lines.append(f"    motor_{command.motor}.run_angle({command.speed_deg_s}, {amount}, wait=False)")
    return "\n".join(lines) + "\n"


def _read_channels(interface: Interface) -> str:
    lines = [
        "def read_channels(time_ms):",
        '    """The answer\'s numbers: the clock, and each channel in its unit times its scale."""',
    ]
    if any(isinstance(channel, (Pitch, Roll)) for channel in interface.channels):
        lines.append("    pitch, roll = hub.imu.tilt()")
    several = [channel for channel in interface.channels if isinstance(channel, SensorReading) and channel.part is not None]
    for sensor, method in dict.fromkeys((channel.sensor, channel.method) for channel in several):
        lines.append(f"    read_{sensor}_{method} = sensor_{sensor}.{method}()")
    lines += ["    return ustruct.pack(", "        ANSWER_FORMAT,", "        time_ms,"]
    lines += [f"        wire({_reading(channel)} * {channel.scale})," for channel in interface.channels]
    lines.append("    )")
    return "\n".join(lines) + "\n"


def _reading(channel: Channel) -> str:
    """Expression for a channel, in its unit."""
    if isinstance(channel, MotorAngle):
        return f"motor_{channel.motor}.angle()" + (" % 360" if channel.wraps else "")
    if isinstance(channel, Distance):
        return f"sensor_{channel.sensor}.distance()"
    if isinstance(channel, SensorReading) and channel.part is not None:
        return f"read_{channel.sensor}_{channel.method}[{PARTS[channel.method].index(channel.part)}]"
    if isinstance(channel, SensorReading):
        return f"sensor_{channel.sensor}.{channel.method}()"
    if isinstance(channel, YawRate):
        return "hub.imu.angular_velocity(Axis.Z)"
    return channel.name
