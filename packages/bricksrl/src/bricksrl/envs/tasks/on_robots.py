"""Tasks of one driving robot on another one."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, TypeVar

from brickhub.errors import hint
from brickhub.hub.interface import (
    Channel,
    Command,
    Distance,
    Heading,
    Interface,
    Pitch,
    Roll,
    YawRate,
)
from brickhub.robot import Robot, Sense
from brickhub.user_files import NotCode
from bricksrl.envs.task import Task
from bricksrl.errors import DescriptionError

_Part = TypeVar("_Part", Channel, Command)


def on_robot(
    task: Task,
    name: str,
    others: tuple[Robot, ...],
) -> Task:
    """The task on the robot of that name, its own or one of the others. Raises DescriptionError for
    any other name."""
    known = {robot.name: robot for robot in (task.robot, *others)}
    if name not in known:
        raise DescriptionError(
            f"{task.id} is not for robot '{name}'{hint(name, known)}; choose {' or '.join(known)}"
        )
    # Where nothing changes, the very same task is returned, so that it can be compared with the
    # registered one.
    if name == task.robot.name:
        return task
    robot = known[name]
    return replace(task, robot=robot, interface=interface_on(task.interface, robot))


def with_robots(task: Task, *others: Robot) -> Callable[..., Task]:
    """Builder of a task that other driving robots can do too: the option ``robot`` names its own or
    one of theirs."""

    def build(robot: Annotated[str, NotCode()] = task.robot.name) -> Task:
        return on_robot(task, robot, others)

    return build


def interface_on(
    interface: Interface,
    robot: Robot,
    names: Mapping[str, str] | None = None,
) -> Interface:
    """What a robot can do and report of an interface: without a hub whose IMU can be read no tilt,
    and turns only by a gyroscope on a port; without either no turns.

    Args:
        names: names of the robot's motors and sensors, by those of the interface, where they
            differ.
    """
    names = names or {}
    commands = tuple(_renamed(command, names) for command in interface.commands)
    channels: list[Channel] = []
    for channel in interface.channels:
        channel = _renamed(channel, names)
        match channel:
            case Pitch() | Roll() if not robot.needs_imu:
                continue
            case YawRate() | Heading() if not robot.needs_imu:
                gyroscope = gyroscope_of(robot)
                if gyroscope:
                    channels.append(replace(channel, sensor=gyroscope))
            case Distance():
                range_mm = robot.sensor(channel.sensor).kind.model.range_mm
                farthest_mm = float(max(range_mm or (0,)))
                channels.append(replace(channel, high=farthest_mm))
            case _:
                channels.append(channel)
    return replace(interface, commands=commands, channels=tuple(channels))


def _renamed(part: _Part, names: Mapping[str, str]) -> _Part:
    """A command or channel whose motor or sensor has the robot's name."""
    changed = {}
    for field in ("motor", "sensor"):
        name: str = getattr(part, field, "")
        if name in names:
            changed[field] = names[name]
    return replace(part, **changed) if changed else part


def gyroscope_of(robot: Robot) -> str:
    """Name of a robot's gyroscope on a port; empty if it has none."""
    for sensor in robot.sensors:
        if Sense.ROTATION in sensor.kind.model.senses:
            return sensor.name
    return ""
