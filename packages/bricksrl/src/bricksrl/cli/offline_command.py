"""``bricksrl train-offline``: offline reinforcement learning and imitation from a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.options import option
from bricksrl.cli.page import LivePageGroup, PageAddress
from bricksrl.cli.run_options import PageFlag, run_folder
from bricksrl.cli.terminal import load_learning
from bricksrl.cli.train import run_training
from bricksrl.errors import RunError


@dataclass(frozen=True)
class TrainOffline:
    """Train an agent from a dataset alone, without the robot.

    The agent is tested in a few episodes, spread over the updates. The run folder is that of `bricksrl train`. To continue the
    training on the robot, use `bricksrl train ENV --from RUN`, with the same agent or, with `--agent sac`, with another one that
    starts from its policy.

    Examples:
      bricksrl train-offline Walker-v0 --data datasets/walker
      bricksrl train-offline RunAway-v0 --data runs/first --agent iql --updates 2000
      bricksrl train-offline RoboArm-v0 --data datasets/arm --agent bc --preset paper
    """

    env: Annotated[Positional[str], option(metavar="ENV")]
    """Environment of the data; `bricksrl list` shows them."""
    data: Annotated[Path, option(metavar="DIR")]
    """Folder of the dataset, or of a run that recorded one."""
    agent: Annotated[str, option(metavar="NAME")] = "iql"
    """Agent: bc, act, iql, cql, td3bc; or an agent for online learning, such as sac and td3."""
    preset: Annotated[str, option(metavar="NAME")] = "default"
    """Settings of the agent: default, or paper for those of the BricksRL paper."""
    updates: Annotated[int, option(metavar="N")] = 5000
    """Updates from the data."""
    episodes: Annotated[int, option(metavar="N")] = 10
    """Test episodes, spread evenly over the updates."""
    seed: Annotated[int, option(metavar="N")] = 0
    """Seed of all random numbers: the same seed gives the same run."""
    run: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder to write to, which must not exist; by default runs/<env>-<agent>-<seed>-<time>."""
    page: PageFlag = False
    live_page: LivePageGroup = PageAddress()

    def execute(self) -> None:
        from bricksrl.training import TrainConfig, train
        from bricksrl.training.config import settings_for

        address = self.live_page.shown(self.page)
        if self.updates < 1:
            raise RunError(f"updates is {self.updates}; make at least 1")
        load_learning()  # algorithms are registered when their modules are imported
        config = TrainConfig(
            env=self.env,
            agent=self.agent,
            episodes=self.episodes,
            seed=self.seed,
            settings=settings_for(self.env, self.preset, self.agent),
            data=str(self.data.absolute()),
            updates=self.updates,
            run_dir=run_folder(self.run, self.env, self.agent, self.seed),
        )
        run_training(partial(train, config), config, address, can_drive=False)
