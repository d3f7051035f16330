"""Robots of BricksRL as LeRobot robots: the channels and commands of an environment, in their own
units."""

from __future__ import annotations

import logging
from typing import Any

import torch
from lerobot.robots.robot import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from bricksrl import make
from bricksrl.envs import get_task
from bricksrl.errors import HubError
from lerobot_robot_bricksrl.config import (
    BricksRoboArmConfig,
    BricksRobotConfig,
    BricksTwoWheelerConfig,
    BricksWalkerConfig,
)

_log = logging.getLogger(__name__)


class BricksRobot(Robot):
    """A robot with the commands and channels of an environment.

    `send_action` carries a command out and takes as long as a step of the environment does;
    `get_observation` then gives what was measured at its end.
    """

    config_class = BricksRobotConfig
    name = "bricksrl"

    def __init__(self, config: BricksRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self.task = get_task(config.env)
        self.cameras = self.task.images  # LeRobot counts them
        self._env: Any = None
        self._seen: Any = None

    @property
    def observation_features(self) -> dict[str, Any]:
        images = {key: (px, px, 3) for key, px in self.task.images.items()}
        return {**{entry.name: float for entry in self.task.entries}, **images}

    @property
    def action_features(self) -> dict[str, type]:
        return {command.name: float for command in self.task.interface.commands}

    @property
    def is_connected(self) -> bool:
        return self._seen is not None

    @property
    def is_calibrated(self) -> bool:
        """A virtual robot is; a real one uses what `bricksrl hub calibrate` has found for its
        hub."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Reach the robot; a virtual one is put where an episode starts.

        Raises:
            DeviceAlreadyConnectedError: it is connected.
            ConnectionError: the hub cannot be reached.
        """
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected already")
        virtual = {"realtime": self.config.realtime} if self.config.hub == "virtual" else {}
        place = None if virtual else lambda _rng: None  # whoever records puts the robot back
        self._env = make(
            self.config.env, hub=self.config.hub, seed=self.config.seed, place=place, **virtual
        )
        try:
            self._seen = self._env.reset()
        except HubError as error:
            self._env.close(raise_if_closed=False)
            raise ConnectionError(str(error)) from None
        if calibrate:
            self.calibrate()
        self.configure()

    def calibrate(self) -> None:
        """Nothing on a virtual robot, whose zeros are right; of a real one `bricksrl hub calibrate`
        finds them, once."""
        if self.config.hub != "virtual":
            _log.info(
                "zeros of motors are those that `bricksrl hub calibrate` has saved for this hub"
            )

    def configure(self) -> None:
        """Nothing: limits and speeds are in the program on the hub."""

    def get_observation(self) -> dict[str, Any]:
        """Channels by their names, in their units.

        Raises:
            DeviceNotConnectedError: it is not connected.
        """
        self._check()
        values = self._seen["observation"].tolist()
        found: dict[str, Any] = {
            entry.name: value for entry, value in zip(self.task.entries, values, strict=True)
        }
        return found | {key: self._seen[key].numpy().copy() for key in self.task.images}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Carry out commands by their names, in their units; returns those that were sent, within
        their ranges.

        Raises:
            DeviceNotConnectedError: it is not connected.
            ConnectionError: the link broke; the motors stop, and `connect` may be tried again.
        """
        self._check()
        commands = self.task.interface.commands
        sent = {one.name: min(max(float(action[one.name]), one.low), one.high) for one in commands}
        shares = [2.0 * (sent[one.name] - one.low) / (one.high - one.low) - 1.0 for one in commands]
        self._seen["action"] = torch.tensor(shares)
        after = self._env.step(self._seen)["next"]
        if bool(after["link_lost"]):
            error = self._env.link_error
            self.disconnect()
            raise ConnectionError(str(error))
        self._seen = after.exclude("reward", "done", "terminated", "truncated")
        return sent

    def disconnect(self) -> None:
        """Stop the robot and let go of its hub."""
        self._check()
        self._seen = None
        self._env.close(raise_if_closed=False)

    def _check(self) -> None:
        if not self.is_connected:
            raise DeviceNotConnectedError(f"{self} is not connected; run connect() first")


class BricksWalker(BricksRobot):
    """The Walker."""

    config_class = BricksWalkerConfig
    name = "bricksrl_walker"


class BricksTwoWheeler(BricksRobot):
    """The 2Wheeler."""

    config_class = BricksTwoWheelerConfig
    name = "bricksrl_two_wheeler"


class BricksRoboArm(BricksRobot):
    """The RoboArm."""

    config_class = BricksRoboArmConfig
    name = "bricksrl_robo_arm"
