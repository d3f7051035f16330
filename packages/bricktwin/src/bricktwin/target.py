"""Targets with a body: our robots, robots in the user's files, and building plans."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from brickhub.errors import DescriptionError, UnknownNameError
from brickhub.robot import HubKind, Robot
from brickhub.target import Target, find_in_files, whole_interface
from brickhub.user_files import is_reference
from bricktwin import robots
from bricktwin.robots.planned import is_plan, read_facts
from bricktwin.twin.make_body import make_body


def find(name: str) -> Target:
    """One of our robots, the robot of a building plan, or the robot in a user's file. Raises UnknownNameError if there is none,
    DescriptionError or PlanError if a file is wrong."""
    if name in robots.ROBOTS:
        return with_body(robots.get(name))
    if is_plan(name):
        return with_body(robot_of_plan(Path(name)))
    if not is_reference(name):
        raise UnknownNameError(
            f"there is no robot '{name}'; choose {', '.join(robots.ROBOTS)}, or name a file: my_robot.ldr or my_robot.py"
        )
    target = find_in_files(name)
    return replace(target, make_body=partial(make_body, target.robot))


def with_body(robot: Robot) -> Target:
    """A robot on an open floor, or on the bench if it has no body."""
    return Target(robot.name, robot, whole_interface(robot), partial(make_body, robot))


def robot_of_plan(path: Path) -> Robot:
    """The robot that a building plan describes: its hub, and the motors and sensors on the hub's ports. Raises PlanError if the
    plan cannot be read, DescriptionError if it has no hub of ours."""
    facts = read_facts(path)
    hub = facts.hubs[0] if facts.hubs else None
    kinds = {kind.value: kind for kind in HubKind}
    if hub is None or hub.name not in kinds:
        raise DescriptionError(f"{path} has {'no hub' if hub is None else hub.part}; a robot needs one that runs Pybricks")
    kind = kinds[hub.name]
    needs_imu = kind.model.has_imu and len(facts.hub_sides) == 2
    stem = "".join(letter if letter.isalnum() else "_" for letter in path.stem)
    return Robot(stem if stem.isidentifier() else f"robot_{stem}", kind, needs_imu=needs_imu, plan=str(path))
