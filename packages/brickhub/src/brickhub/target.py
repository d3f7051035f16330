"""Target of a command: a robot with an interface and a body, found by the name that a user gives.

A house that stands on this one and knows more names than the user's files (robots, plans,
environments) declares its own `find` as an entry point of the group ``brickhub.target``, and asks
the house below for what it does not know.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import metadata
from typing import Any, Protocol

from brickhub import HOUSES
from brickhub.errors import UnknownNameError
from brickhub.hub.interface import (
    Channel,
    Distance,
    Interface,
    MotorAngle,
    Pitch,
    Roll,
    RunAngle,
    Wait,
    YawRate,
)
from brickhub.robot import BENCH, Robot
from brickhub.user_files import is_reference, load_robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body

_FAST_DEG_S = 1000
"""Full speed of a medium motor."""
_TURN_DEG = 600.0
"""Largest angle of a command, either way."""


class SharedWorld(Protocol):
    """World of several robots.

    Attributes:
        runners: functions that let each robot's hub come to a time (ms), as ``Room.run_until``.
    """

    runners: list[Callable[[int], None]]

    @property
    def bodies(self) -> Sequence[Body]:
        """Bodies of the robots, by number."""

    def distance_m(self, one: int, other: int) -> float:
        """Distance of two hubs, by number."""


@dataclass(frozen=True)
class Target:
    """Robot of a command.

    Attributes:
        name: of the robot, or of the environment that it is for.
        interface: commands and channels of the program on its hub.
        make_body: builds the body of the virtual robot; its options are those of the house that
            found it.
        scene: surroundings of the virtual robot, as that house describes them; ``None`` if nothing
            is said.
        note: what a person who gave the name should know of it.
        share_world: puts the robots of several targets into one world, each with the name that a
            person gave; ``None`` where robots have no bodies.
    """

    name: str
    robot: Robot
    interface: Interface
    make_body: Callable[..., Body]
    scene: Any = None
    note: str = ""
    share_world: Callable[[Sequence[tuple[str, Target]]], SharedWorld] | None = None


def whole_interface(robot: Robot) -> Interface:
    """Interface with every motor at full speed, the IMU and the distance sensor, 50 ms after each
    command. Raises DescriptionError if the robot has a plan that nobody has read."""
    robot.check_complete()
    commands = []
    channels: list[Channel] = []
    for motor in robot.motors:
        commands.append(
            RunAngle(
                motor.name,
                -_TURN_DEG,
                _TURN_DEG,
                _FAST_DEG_S,
            )
        )
        # A motor without a range turns endlessly, so its angle is one within a turn.
        low_deg, high_deg = motor.range_deg or (0, 360)
        channels.append(MotorAngle(motor.name, float(low_deg), float(high_deg)))
    if robot.needs_imu:
        channels += [Pitch(), Roll(), YawRate()]
    for sensor in robot.sensors:
        range_mm = sensor.kind.model.range_mm
        if range_mm is not None:
            channels.append(Distance(sensor.name, 0.0, float(range_mm[1])))
            break
    return Interface(tuple(commands), tuple(channels), Wait(50))


def find_in_files(name: str, complete: Callable[[Robot], Robot] = lambda robot: robot) -> Target:
    """The robot in a user's file, or ``bench``, on the bench. Raises UnknownNameError if there is
    none, DescriptionError if the file is wrong. ``complete``: of a house that reads plans."""
    if name == BENCH.name:
        robot = BENCH
    elif is_reference(name):
        robot = complete(load_robot(name))
    else:
        raise UnknownNameError(
            f"there is no robot '{name}'; name a Python file with one, such as my_robot.py, "
            "or bench"
        )
    make_body = functools.partial(BenchBody, robot)
    return Target(
        robot.name,
        robot,
        whole_interface(robot),
        make_body,
    )


def find(name: str) -> Target:
    """The target of that name, as the last house that is installed knows it. Raises
    UnknownNameError if there is none, DescriptionError if a user's file is wrong."""
    return _finder()(name)


@functools.cache
def _finder() -> Callable[[str], Target]:
    points = {point.name: point for point in metadata.entry_points(group="brickhub.target")}
    # The last house knows most, and asks the one before it for what it does not know.
    for house in reversed(HOUSES):
        if house in points:
            finder: Callable[[str], Target] = points[house].load()
            return finder
    return find_in_files
