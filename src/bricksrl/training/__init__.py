"""Training: runs from a config to a folder of results. Importing this loads no torch."""

from __future__ import annotations

from bricksrl.training.config import TrainConfig
from bricksrl.training.observer import Episode, Observer, Phase, Progress, RunResult, Together
from bricksrl.training.run import RunFolder
from bricksrl.training.runner import resume, train
from bricksrl.training.saved import load_agent

__all__ = [
    "Episode",
    "Observer",
    "Phase",
    "Progress",
    "RunFolder",
    "RunResult",
    "Together",
    "TrainConfig",
    "load_agent",
    "resume",
    "train",
]
