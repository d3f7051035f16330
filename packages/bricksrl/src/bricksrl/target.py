"""Targets of commands that are environments: a task's robot, interface and scene."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from brickhub.errors import UnknownNameError, hint
from brickhub.target import Target
from brickhub.user_files import is_reference, load_object, without_name
from bricksrl.envs.arenas import ARENAS, get_arena_task
from bricksrl.envs.registry import get_task
from bricksrl.envs.task import Task
from bricktwin import robots, target
from bricktwin.robots.planned import is_plan
from bricktwin.twin.make_body import make_body

if TYPE_CHECKING:
    from bricksrl.envs.arenas.arena_task import ArenaTask


def find(name: str) -> Target:
    """An environment, of an arena the robot that it names (``Tag-v0:runner``) or the first, or a
    robot as in `bricktwin`; of a user's file its only task, or else its only robot. Raises
    UnknownNameError if there is none, DescriptionError if a user's file is wrong."""
    arena, _, contestant = name.partition(":")
    if arena in ARENAS:
        return _in_arena(get_arena_task(arena), contestant)
    if name in robots.ROBOTS or is_plan(name):
        return target.find(name)
    if is_plan(without_name(name)):
        return _of_task(get_task(name))
    # A file that has no task may have a robot alone.
    if is_reference(name) and not _names_task(name):
        return target.find(name)
    try:
        task = get_task(name)
    except UnknownNameError as error:
        if is_reference(name):
            raise
        raise UnknownNameError(f"{error}; or a robot: {', '.join(robots.ROBOTS)}") from None
    return _of_task(task)


def _of_task(task: Task) -> Target:
    """The robot of a task, in its scene."""
    return Target(
        task.id,
        task.robot,
        task.interface,
        partial(make_body, task.robot, scene=task.scene),
        task.scene,
        share_world=target.shared_world,
    )


def _in_arena(task: ArenaTask, name: str) -> Target:
    """A robot of an arena, by itself."""
    if name and name not in task.robots:
        raise UnknownNameError(
            f"{task.id} has no robot '{name}'{hint(name, task.robots)}; it has "
            f"{', '.join(task.robots)}"
        )
    index = task.robots.index(name) if name else 0
    found = task.robots[index]
    robot = task.arena.robots[index].robot
    note = ""
    if not name:
        others = [f"{task.id}:{other}" for other in task.robots if other != found]
        note = f"{task.id} has several robots: this is {found}; there are also {', '.join(others)}"
    return Target(
        f"{task.id}:{found}",
        robot,
        task.interfaces[index],
        partial(make_body, robot),
        note=note,
        share_world=target.shared_world,
    )


def _names_task(reference: str) -> bool:
    """Whether a reference to the user's code names a task, or a function that returns one, or a
    file with a single task."""
    try:
        value = load_object(reference, Task)
    except UnknownNameError:
        return False
    return isinstance(value, Task) or callable(value)
