"""Targets of commands that are environments: a task's robot, interface and scene."""

from __future__ import annotations

from functools import partial

from brickhub.errors import UnknownNameError
from brickhub.target import Target
from brickhub.user_files import is_reference, load_object
from bricksrl.envs.registry import get_task
from bricksrl.envs.task import Task
from bricktwin import robots, target
from bricktwin.robots.planned import is_plan
from bricktwin.twin.make_body import make_body


def find(name: str) -> Target:
    """An environment, or a robot as in `bricktwin`; of a user's file its only task, or else its only robot. Raises
    UnknownNameError if there is none, DescriptionError if a user's file is wrong."""
    if name in robots.ROBOTS or is_plan(name):
        return target.find(name)
    if is_reference(name) and not _names_task(name):
        return target.find(name)
    try:
        task = get_task(name)
    except UnknownNameError as error:
        if is_reference(name):
            raise
        raise UnknownNameError(f"{error}; or a robot: {', '.join(robots.ROBOTS)}") from None
    return Target(task.id, task.robot, task.interface, partial(make_body, task.robot, scene=task.scene), task.scene)


def _names_task(reference: str) -> bool:
    """Whether a reference to the user's code names a task, or a function that returns one, or a file with a single task."""
    try:
        value = load_object(reference, Task)
    except UnknownNameError:
        return False
    return isinstance(value, Task) or callable(value)
