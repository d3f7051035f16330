"""Whether a robot can do what an interface asks, told before anything is sent to a hub."""

from __future__ import annotations

from collections import Counter

from bricksrl.errors import DescriptionError, ProgramError
from bricksrl.hub.interface import PARTS, Distance, DriveStraight, Interface, MotorAngle, RunAngle, SensorReading, UntilDone
from bricksrl.hub.protocol import MAX_ACTIONS
from bricksrl.robots import PoweredUpSensor, Robot, UltrasonicSensor

_INT16_HIGH = 2**15 - 1
_MAX_SETTLE_MS = 60_000


def validate(robot: Robot, interface: Interface) -> None:
    """Check that the robot has every device that the interface names and that all ranges fit the wire.

    Raises:
        ProgramError: no program of ours runs on this kind of hub.
        DescriptionError: robot and interface do not fit each other.
    """
    model = robot.hub.model
    if model.stdin_bytes == 0:
        raise ProgramError(
            f"robot '{robot.name}': a {robot.hub.value} hub has neither standard input nor floating point numbers nor ustruct, "
            "and is not supported; choose a prime, essential, technic or city hub"
        )
    _check_commands(robot, interface)
    _check_channels(robot, interface)
    settle = interface.settle
    time_ms = settle.timeout_ms if isinstance(settle, UntilDone) else settle.time_ms
    if not 0 < time_ms <= _MAX_SETTLE_MS:
        raise DescriptionError(f"the step settles after {time_ms} ms; give 1 to {_MAX_SETTLE_MS} ms")


def _check_commands(robot: Robot, interface: Interface) -> None:
    commands = interface.commands
    if len(commands) > MAX_ACTIONS:
        raise DescriptionError(f"{len(commands)} commands do not fit one write of 20 bytes; use at most {MAX_ACTIONS}")
    _check_unique("command", [command.name for command in commands])
    driven: set[str] = set()
    for command in commands:
        _check_range("command", command.name, command.low, command.high, command.scale)
        if isinstance(command, RunAngle):
            robot.motor(command.motor)
            if not 1 <= command.speed_deg_s <= _INT16_HIGH:
                raise DescriptionError(
                    f"command '{command.name}': speed {command.speed_deg_s} deg/s; give a positive one, the sign is the angle's"
                )
        else:
            driven |= _driven_motors(robot, command)
    both = sorted(driven & {command.name for command in commands})
    if both:
        raise DescriptionError(f"motor '{both[0]}' is in the drive base and has its own command; use one of the two")


def _driven_motors(robot: Robot, command: DriveStraight) -> set[str]:
    if robot.drive_base is None:
        raise DescriptionError(f"robot '{robot.name}' has no drive base for '{command.name}'; describe one or command its motors")
    names = {robot.drive_base.left, robot.drive_base.right}
    for name in sorted(names):
        if robot.motor(name).range_deg is not None:
            raise DescriptionError(f"motor '{name}' of the drive base has a range; wheels turn endlessly, take range_deg away")
    return names


def _check_channels(robot: Robot, interface: Interface) -> None:
    if not interface.channels:
        raise DescriptionError("the interface has no channels; name at least one, so that the hub has something to answer")
    _check_unique("channel", [channel.name for channel in interface.channels])
    for channel in interface.channels:
        _check_range("channel", channel.name, channel.low, channel.high, channel.scale)
        if isinstance(channel, MotorAngle):
            robot.motor(channel.motor)
        elif isinstance(channel, Distance):
            if not isinstance(robot.sensor(channel.sensor), UltrasonicSensor):
                raise DescriptionError(
                    f"channel '{channel.name}': '{channel.sensor}' is no UltrasonicSensor; use a SensorReading"
                )
        elif isinstance(channel, SensorReading):
            if not isinstance(robot.sensor(channel.sensor), PoweredUpSensor):
                raise DescriptionError(f"channel '{channel.name}': '{channel.sensor}' is an UltrasonicSensor; use Distance")
            if not channel.method.isidentifier():
                raise DescriptionError(
                    f"channel '{channel.name}': '{channel.method}' is no method; give a name such as 'reflection'"
                )
            _check_part(channel)
        elif not robot.hub.model.has_imu:
            raise DescriptionError(
                f"channel '{channel.name}' needs an IMU, which the {robot.hub.value} hub lacks; "
                "choose a prime, essential or technic hub, or leave the channel out"
            )


def _check_part(reading: SensorReading) -> None:
    parts = PARTS.get(reading.method)
    if parts is None and reading.part is not None:
        raise DescriptionError(
            f"channel '{reading.name}': {reading.method}() is one number; leave the part '{reading.part}' away"
        )
    if parts is not None and reading.part not in parts:
        raise DescriptionError(
            f"channel '{reading.name}': {reading.method}() is {len(parts)} numbers; give as part one of {', '.join(parts)}"
        )


def _check_unique(kind: str, names: list[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise DescriptionError(f"{kind} '{name}' is named {count} times; name each once")


def _check_range(kind: str, name: str, low: float, high: float, scale: int) -> None:
    largest = _INT16_HIGH / scale
    if not -largest <= low < high <= largest:
        raise DescriptionError(f"{kind} '{name}' ranges from {low} to {high}; give low < high within +-{largest:g}")
