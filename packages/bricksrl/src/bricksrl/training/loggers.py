"""Experiment trackers by TorchRL's loggers for the columns of `metrics.csv`. None requires an
account."""

import importlib.util
import netrc
import os
from pathlib import Path
from typing import Any

from bricksrl.errors import RunError
from bricksrl.training.callbacks import Callback, Episode, Progress, RunResult
from bricksrl.training.config import TrainConfig

PROJECT = "bricksrl"


class Tracking(Callback):
    """Logs each episode at its number of robot steps. Raises RunError if the tracker's package is
    not installed."""

    def __init__(self, log: str) -> None:
        # A missing package is reported now, and not when the robot is connected.
        if importlib.util.find_spec(log) is None:
            raise RunError(
                f"{log} is not installed; run `pip install {log}`, or omit --log: metrics.csv is "
                "always written"
            )
        self._kind = log

    def on_start(
        self,
        config: TrainConfig,
        run_dir: Path,
        episodes_done: int,
    ) -> None:
        from torchrl.record.loggers import get_logger

        project = {"project": PROJECT, "config": config.to_dict()}
        # Online and without an account, it would ask for one while the robot waits.
        mode = "online" if _logged_in_to_wandb() else "offline"
        wandb = {**project, "mode": mode, "log_env_packages": False}
        # TensorBoard's logs are a folder within the run, but the others' name stands for the run
        # elsewhere.
        name = "tensorboard" if self._kind == "tensorboard" else run_dir.name
        self._log: Any = get_logger(
            self._kind,
            str(run_dir),
            name,
            trackio_kwargs=project,
            wandb_kwargs=wandb,
        )

    def on_episode(
        self,
        episode: Episode,
        progress: Progress,
    ) -> None:
        for name, value in numbers(episode).items():
            self._log.log_scalar(name, value, step=episode.steps)
        # TensorBoard holds back what it logs, but a run takes long enough to look at it meanwhile.
        flush = getattr(self._log.experiment, "flush", None)
        if flush is not None:
            flush()

    def on_end(self, result: RunResult) -> None:
        experiment = self._log.experiment
        # Weights & Biases and Trackio finish a run, while TensorBoard closes a file.
        if hasattr(experiment, "finish"):
            experiment.finish()
        else:
            experiment.close()


def numbers(episode: Episode) -> dict[str, float]:
    """Logged values of an episode."""
    names = (
        "episode",
        "length",
        "success",
        "updates_per_step",
        "evaluation",
        "link_lost",
        "seconds",
    )
    logged = {"return": episode.return_}
    for name in names:
        value = getattr(episode, name)
        # Trackers want numbers, so what an episode does not have is left out.
        if value is not None:
            logged[name] = float(value)
    return logged | episode.measures


def _logged_in_to_wandb() -> bool:
    # `wandb` itself looks in this order: variables, then what `wandb login` has written.
    mode = os.environ.get("WANDB_MODE")
    if mode:
        return mode == "online"
    if os.environ.get("WANDB_API_KEY"):
        return True
    try:
        hosts = netrc.netrc().hosts
    except (OSError, netrc.NetrcParseError):
        return False
    return any("wandb" in host for host in hosts)
