"""Validation of an interface against a robot, before anything is sent to a hub."""

from __future__ import annotations

from collections import Counter

from brickhub.errors import DescriptionError, ProgramError
from brickhub.fields import check_fields
from brickhub.hub.interface import Interface
from brickhub.hub.kinds import WIRE_MAX, Command
from brickhub.hub.protocol import MAX_ACTIONS
from brickhub.robot import Robot

_MAX_SETTLE_MS = 60_000


def validate(robot: Robot, interface: Interface) -> None:
    """Check that the robot has every device that the interface names and that all ranges fit the wire. Raises ProgramError if
    this kind of hub is not supported, DescriptionError if robot and interface do not match."""
    model = robot.hub.model
    if model.stdin_bytes == 0:
        raise ProgramError(
            f"robot '{robot.name}': a {robot.hub.value} hub has neither standard input nor floating point numbers nor ustruct, "
            "and is not supported; choose a prime, essential, technic or city hub"
        )
    _check_commands(robot, interface)
    _check_channels(robot, interface)
    check_fields(type(interface.settle), vars(interface.settle))
    time_ms = interface.settle.longest_ms
    if not 0 < time_ms <= _MAX_SETTLE_MS:
        raise DescriptionError(f"the step settles after {time_ms} ms; give 1 to {_MAX_SETTLE_MS} ms")


def _check_commands(robot: Robot, interface: Interface) -> None:
    commands = interface.commands
    if len(commands) > MAX_ACTIONS:
        raise DescriptionError(f"{len(commands)} commands do not fit one write of 20 bytes; use at most {MAX_ACTIONS}")
    _check_unique("command", [command.name for command in commands])
    until_done, movers = interface.settle.fixed_ms is None, dict[str, Command]()
    for command in commands:
        _check_range("command", command.name, command.low, command.high, command.scale)
        for motor in command.motors(robot):
            other = movers.setdefault(motor, command)
            if other is not command and (command.call is None or command.call != other.call):
                raise DescriptionError(f"motor '{motor}' is moved by the commands '{other.name}' and '{command.name}'; use one")
        command.check(robot)
        if until_done and not command.ends:
            raise DescriptionError(f"the command '{command.name}' goes on until the next step; let the step Wait, not UntilDone")


def _check_channels(robot: Robot, interface: Interface) -> None:
    if not interface.channels:
        raise DescriptionError("the interface has no channels; name at least one, so that the hub has something to answer")
    _check_unique("channel", [channel.name for channel in interface.channels])
    for channel in interface.channels:
        _check_range("channel", channel.name, channel.low, channel.high, channel.scale)
        channel.check(robot)


def _check_unique(kind: str, names: list[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise DescriptionError(f"{kind} '{name}' is named {count} times; name each once")


def _check_range(kind: str, name: str, low: float, high: float, scale: int) -> None:
    largest = WIRE_MAX / scale
    if not -largest <= low < high <= largest:
        raise DescriptionError(f"{kind} '{name}' ranges from {low} to {high}; give low < high within +-{largest:g}")
