"""Environments: tasks as data and pure functions, and the one environment that runs them over a
link to a hub."""

from brickhub.entry import Entry
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import get_task, list_envs, register
from bricksrl.envs.task import SampledEntry, Task

__all__ = [
    "Entry",
    "EnvOptions",
    "SampledEntry",
    "Task",
    "get_task",
    "list_envs",
    "make",
    "register",
]
