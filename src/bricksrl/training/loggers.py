"""Experiment trackers that listen to a run: TensorBoard, Weights & Biases, Trackio. None asks for an account.

The first two through TorchRL's loggers, which has none for Trackio. What they get is what `metrics.csv` has.
"""

from __future__ import annotations

import importlib.util
import netrc
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from bricksrl.errors import RunError
from bricksrl.training.observer import Episode, Observer, Progress, RunResult

if TYPE_CHECKING:
    from bricksrl.training.config import TrainConfig

LOGS = ("none", "tensorboard", "wandb", "trackio")
"""What may listen; the metrics are written as CSV in any case."""

PROJECT = "bricksrl"


class Log(Protocol):
    """The part of TorchRL's loggers that is used here."""

    def log_scalar(self, name: str, value: float, step: int) -> None:
        """Note a number."""


class TrackioLog:
    """Trackio, in the manner of TorchRL's loggers; it keeps its data on this computer."""

    def __init__(self, name: str, config: dict[str, Any]) -> None:
        import trackio

        self.experiment = trackio.init(project=PROJECT, name=name, config=config, resume="allow")

    def log_scalar(self, name: str, value: float, step: int) -> None:
        """Note a number."""
        self.experiment.log({name: value}, step=step)


class Tracking(Observer):
    """Tells a log of each episode, at the robot steps made so far.

    Raises:
        RunError: the package of that log is not installed.
    """

    def __init__(self, log: str) -> None:
        if log not in LOGS:
            raise RunError(f"there is no log '{log}'; choose one of {', '.join(LOGS)}")
        if importlib.util.find_spec(log) is None:
            raise RunError(f"{log} is not installed; run `pip install {log}`, or leave --log away: metrics.csv is always written")
        self._kind = log
        self._log: Log | None = None

    def on_start(self, config: TrainConfig, run_dir: Path, episodes_done: int) -> None:
        self._log = _open(self._kind, run_dir, config.to_dict())

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        if self._log is None:
            return
        for name, value in numbers(episode).items():
            self._log.log_scalar(name, value, step=episode.steps)
        flush = getattr(getattr(self._log, "experiment", None), "flush", None)
        if flush is not None:
            flush()

    def on_end(self, result: RunResult) -> None:
        experiment = getattr(self._log, "experiment", None)
        end = getattr(experiment, "finish", None) or getattr(experiment, "close", None)
        if end is not None:
            end()


def numbers(episode: Episode) -> dict[str, float]:
    """What an episode is told as."""
    found = {"episode": float(episode.episode), "return": episode.return_, "length": float(episode.length), **episode.losses}
    if episode.success is not None:
        found["success"] = float(episode.success)
    if episode.updates_per_step is not None:
        found["updates_per_step"] = episode.updates_per_step
    return {**found, "link_lost": float(episode.link_lost), "seconds": episode.seconds}


def _open(kind: str, run_dir: Path, config: dict[str, Any]) -> Log:
    log: Log
    if kind == "tensorboard":
        from torchrl.record.loggers.tensorboard import TensorboardLogger

        log = TensorboardLogger(exp_name="tensorboard", log_dir=str(run_dir))
    elif kind == "wandb":
        from torchrl.record.loggers.wandb import WandbLogger

        # `mode` keeps a computer without an account from being asked for one
        mode = "online" if _logged_in_to_wandb() else "offline"
        log = WandbLogger(
            exp_name=run_dir.name, save_dir=str(run_dir), project=PROJECT, mode=mode, config=config, log_env_packages=False
        )
    else:
        log = TrackioLog(run_dir.name, config)
    return log


def _logged_in_to_wandb() -> bool:
    if os.environ.get("WANDB_MODE"):
        return os.environ["WANDB_MODE"] == "online"
    if os.environ.get("WANDB_API_KEY"):
        return True
    try:
        known = netrc.netrc().hosts
    except (OSError, netrc.NetrcParseError):
        return False
    return any("wandb" in host for host in known)
