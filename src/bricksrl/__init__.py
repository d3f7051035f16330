"""BricksRL: reinforcement learning on LEGO robots that run Pybricks.

The public names load what they need when they are first used, so that ``import bricksrl`` and ``bricksrl --help`` take little
time. Importing it offers our environments to Gymnasium as ``bricksrl/<id>``; ``gymnasium.make("bricksrl:bricksrl/<id>")`` imports
it by itself.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bricksrl import robots as robots
    from bricksrl.envs import list_envs as list_envs
    from bricksrl.envs import make as make
    from bricksrl.envs import register as register
    from bricksrl.evaluation import evaluate as evaluate
    from bricksrl.training import TrainConfig as TrainConfig
    from bricksrl.training import train as train

__version__ = "0.1.0"
__all__ = ["TrainConfig", "__version__", "evaluate", "list_envs", "make", "register", "robots", "train"]

_HOME = {
    "TrainConfig": "bricksrl.training",
    "evaluate": "bricksrl.evaluation",
    "list_envs": "bricksrl.envs",
    "make": "bricksrl.envs",
    "register": "bricksrl.envs",
    "train": "bricksrl.training",
}
_PACKAGES = ("agents", "envs", "evaluation", "robots", "training")


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    if name in _PACKAGES:
        return importlib.import_module(f"bricksrl.{name}")
    raise AttributeError(f"module 'bricksrl' has no attribute '{name}'")


importlib.import_module("bricksrl.envs")
