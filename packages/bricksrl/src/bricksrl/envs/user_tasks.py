"""Loading of tasks from the user's code: ``my_task.py``, ``my_task.py:TASK``, ``package.module:TASK``."""

from __future__ import annotations

import functools
from collections.abc import Callable

from brickhub import user_files
from brickhub.errors import DescriptionError, UnknownNameError
from brickhub.robot import Robot
from bricksrl.envs.task import Task
from bricktwin.twin.scene import Scene

_MISSING = "`bricksrl new {} FILE` writes a file with one"


def load_builder(reference: str) -> Callable[..., Task]:
    """Builder of a task in the user's code, as a function of its options.

    Args:
        reference: a Python file or an importable module, a colon, and the name of a :class:`Task` in it or of a function that
            returns one; the name may be omitted for a file with a single task.

    Raises:
        UnknownNameError: there is no such file, module or name.
        DescriptionError: the named object is no task, or the code raised.
    """
    builder = user_files.load_object(reference, Task, missing=_MISSING.format("task"))
    if isinstance(builder, Task):
        return lambda: builder
    if not callable(builder):
        raise DescriptionError(f"{reference} is a {type(builder).__name__} and no task; name a bricksrl.envs.Task")

    @functools.wraps(builder)
    def build(**options: object) -> Task:
        task = builder(**options)
        if not isinstance(task, Task):
            raise DescriptionError(f"{reference} returns a {type(task).__name__} and no task; let it return a bricksrl.envs.Task")
        return task

    return build


def load_robot(reference: str) -> tuple[Robot, Scene | None]:
    """Robot in the user's code, and the scene if it is given by a task.

    Args:
        reference: as for tasks; names a :class:`bricksrl.robots.Robot` or a task. Without a name it is the file's only task, or
            else its only robot.

    Raises:
        UnknownNameError: there is no such file, module or name, or the file has no single robot.
        DescriptionError: the named object is no robot, or the code raised.
    """
    try:
        value = user_files.load_object(reference, Task)
    except UnknownNameError:
        value = user_files.load_object(reference, Robot, missing=_MISSING.format("robot"))
    if isinstance(value, Task):
        return value.robot, value.scene
    if not isinstance(value, Robot):
        raise DescriptionError(f"{reference} is not a robot; name a bricksrl.robots.Robot that is written there")
    return value, None
