"""Training: runs from a config to a folder of results. Importing this loads no torch."""

import importlib
from typing import TYPE_CHECKING, Any

from bricksrl.training.callbacks import (
    Callback,
    CallbackList,
    Episode,
    Phase,
    Progress,
    RobotState,
    RunResult,
)
from bricksrl.training.config import TrainConfig
from bricksrl.training.run_folder import RunFolder

if TYPE_CHECKING:
    from bricksrl.training.learners import load_learner as load_learner
    from bricksrl.training.run import resume as resume
    from bricksrl.training.run import train as train

__all__ = [
    "Callback",
    "CallbackList",
    "Episode",
    "Phase",
    "Progress",
    "RobotState",
    "RunFolder",
    "RunResult",
    "TrainConfig",
    "load_learner",
    "resume",
    "train",
]

# These modules load torch, so they are imported only when they are asked for: `bricksrl --help`
# needs none of it.
_MODULES = {"load_learner": "learners", "resume": "run", "train": "run"}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'bricksrl.training' has no attribute '{name}'")
    return getattr(importlib.import_module(f"bricksrl.training.{_MODULES[name]}"), name)
