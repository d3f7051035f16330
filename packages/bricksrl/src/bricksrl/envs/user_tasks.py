"""Loading of tasks from the user's code: ``my_task.py``, ``my_task.py:TASK``, ``package.module:TASK``."""

from __future__ import annotations

import functools
from collections.abc import Callable

from brickhub import user_files
from brickhub.errors import DescriptionError
from bricksrl.envs.task import Task

_MISSING = "`bricksrl new task FILE` writes a file with one"


def load_builder(reference: str) -> Callable[..., Task]:
    """Builder of a task in the user's code, as a function of its options.

    Args:
        reference: a Python file or an importable module, a colon, and the name of a :class:`Task` in it or of a function that
            returns one; the name may be omitted for a file with a single task.

    Raises:
        UnknownNameError: there is no such file, module or name.
        DescriptionError: the named object is no task, or the code raised.
    """
    builder = user_files.load_object(reference, Task, missing=_MISSING)
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
