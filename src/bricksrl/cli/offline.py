"""``bricksrl train-offline``: learn from a dataset alone."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from bricksrl.cli.page import PageFlags
from bricksrl.cli.terminal import load_learning
from bricksrl.cli.train import see_through
from bricksrl.errors import RunError


@dataclass(frozen=True)
class TrainOffline(PageFlags):
    """Train an agent from a dataset alone, without the robot.

    Now and then the agent shows in an episode what it has learned. The run folder is that of `bricksrl train`; what was
    learned goes on learning on the robot with `bricksrl train ENV --from RUN`, by
    the same agent or, with `--agent sac`, by another one from its policy.

    Examples:
      bricksrl train-offline Walker-v0 --data datasets/walker
      bricksrl train-offline RunAway-v0 --data runs/first --agent iql --updates 2000
      bricksrl train-offline RoboArm-v0 --data datasets/arm --agent bc --preset paper
    """

    env: Annotated[Positional[str], arg(metavar="ENV")]
    """Environment that the data is of; `bricksrl list` shows them."""
    data: Annotated[Path, arg(metavar="DIR")]
    """Folder of the dataset, or of a run that recorded one."""
    agent: Annotated[str, arg(metavar="NAME")] = "iql"
    """Agent: bc, act, iql, cql, td3bc; or one that is made for learning on the robot, as sac and td3."""
    preset: Annotated[str, arg(metavar="NAME")] = "default"
    """Settings of the agent: default, or paper, those of the BricksRL paper."""
    updates: Annotated[int, arg(metavar="N")] = 5000
    """Updates from the data."""
    episodes: Annotated[int, arg(metavar="N")] = 10
    """Episodes in which the agent shows what it has learned, evenly spread over the updates."""
    seed: Annotated[int, arg(metavar="N")] = 0
    """Of everything random: the same seed gives the same run."""
    run: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder to write to, which must not exist; without it runs/<env>-<agent>-<seed>-<time>."""

    def execute(self) -> int:
        """Train, evaluate, draw."""
        from bricksrl.training import TrainConfig, train
        from bricksrl.training.config import settings_for
        from bricksrl.training.run_folder import file_name

        if self.updates < 1:
            raise RunError(f"updates is {self.updates}; make at least 1")
        load_learning()  # algorithms are known with their modules
        time = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
        config = TrainConfig(
            env=self.env,
            agent=self.agent,
            episodes=self.episodes,
            seed=self.seed,
            settings=settings_for(self.env, self.preset, self.agent),
            data=str(self.data.absolute()),
            updates=self.updates,
            run_dir=self.run or Path("runs") / f"{file_name(self.env)}-{file_name(self.agent)}-{self.seed}-{time}",
        )
        return see_through(lambda shown: train(config, shown.callback, stop=shown.stop), config, self)
