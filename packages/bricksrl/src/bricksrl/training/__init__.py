"""Training: runs from a config to a folder of results. Importing this loads no torch."""

from bricksrl.training.callbacks import Callback, CallbackList, Episode, Phase, Progress, RobotState, RunResult
from bricksrl.training.config import TrainConfig
from bricksrl.training.restore import load_learner
from bricksrl.training.run import resume, train
from bricksrl.training.run_folder import RunFolder

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
