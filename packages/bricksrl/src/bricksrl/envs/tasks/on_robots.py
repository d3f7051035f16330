"""Tasks of one driving robot on another one."""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated

from brickhub.errors import hint
from brickhub.hub.interface import Channel, Distance, Heading, Interface, Pitch, Roll, YawRate
from brickhub.robot import Robot, Sense
from brickhub.user_files import NotCode
from bricksrl.envs.task import Task
from bricksrl.errors import DescriptionError


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
    return replace(task, robot=robot, interface=_interface_on(task.interface, robot))


def with_robots(task: Task, *others: Robot) -> Callable[..., Task]:
    """Builder of a task that other driving robots can do too: the option ``robot`` names its own or
    one of theirs."""

    def build(robot: Annotated[str, NotCode()] = task.robot.name) -> Task:
        return on_robot(task, robot, others)

    return build


def _interface_on(interface: Interface, robot: Robot) -> Interface:
    """What a robot can report of an interface: without an IMU no tilt, and turns only by a
    gyroscope on a port."""
    channels: list[Channel] = []
    for channel in interface.channels:
        match channel:
            case Pitch() | Roll() if not robot.hub.model.has_imu:
                continue
            case YawRate() | Heading() if not robot.hub.model.has_imu:
                channels.append(replace(channel, sensor=_gyroscope(robot)))
            case Distance():
                range_mm = robot.sensor(channel.sensor).kind.model.range_mm
                farthest_mm = float(max(range_mm or (0,)))
                channels.append(replace(channel, high=farthest_mm))
            case _:
                channels.append(channel)
    return replace(interface, channels=tuple(channels))


def _gyroscope(robot: Robot) -> str:
    """Name of a robot's gyroscope on a port; empty if it has none."""
    for sensor in robot.sensors:
        if Sense.ROTATION in sensor.kind.model.senses:
            return sensor.name
    return ""
